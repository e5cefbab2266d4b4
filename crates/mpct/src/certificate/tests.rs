//! True certificates are accepted; every kind of false one is refused, with the digest ignored.

use super::*;
use crate::{
    Condition, Constraints, DesignOptions, Matrix, Plant, Problem, Task, TerminalIngredients,
    Weights,
};
use serde_json::{Value, json};

pub(super) const BLIND: VerifyOptions = VerifyOptions {
    ignore_digest: true,
};

fn academic() -> Problem {
    let plant = Plant::discrete(
        Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
        Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
    )
    .unwrap();
    let constraints = Constraints::new(2, 2)
        .state_bounds(&[-3.0; 2], &[3.0; 2])
        .unwrap()
        .input_bounds(&[-2.0; 2], &[2.0; 2])
        .unwrap();
    Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4)).unwrap()
}

/// Unequal bounds, a mixed row, an operating point, weights with off-diagonal entries.
pub(super) fn skew() -> Problem {
    let plant = Plant::discrete(
        Matrix::from_rows(&[[0.9, 0.4], [-0.2, 0.8]]),
        Matrix::from_rows(&[[0.1], [0.7]]),
    )
    .unwrap()
    .with_operating_point(vec![0.3, -0.1], vec![0.2])
    .unwrap();
    let constraints = Constraints::new(2, 1)
        .state_bounds(&[-1.0, -2.0], &[3.0, 1.5])
        .unwrap()
        .input_bounds(&[-0.7], &[1.1])
        .unwrap()
        .mixed(
            Matrix::from_rows(&[[1.0, 2.0]]),
            Matrix::from_rows(&[[-0.5]]),
            vec![2.5],
        )
        .unwrap();
    let q = Matrix::from_rows(&[[2.0, 0.3], [0.3, 1.0]]);
    Problem::new(plant, constraints, Weights::new(q, 0.5, 1e3)).unwrap()
}

pub(super) fn certificate(problem: &Problem) -> (TerminalIngredients, String) {
    let ingredients = TerminalIngredients::design(problem, &DesignOptions::default()).unwrap();
    let text = Certificate::of(&ingredients).unwrap().to_json();
    (ingredients, text)
}

#[test]
fn true_certificates_are_accepted() {
    let regulation = academic().with_task(Task::Regulation);
    for problem in [academic(), skew(), regulation] {
        let (ingredients, text) = certificate(&problem);
        let verified = verify(&text, VerifyOptions::default()).unwrap();
        assert_eq!(verified.terminal_horizon, ingredients.terminal_horizon());
        assert_eq!(verified.rows_rigorous, problem.rows().len());
        assert_eq!(verified.rows_to_tolerance, 0);
        assert!(verified.smallest_margin > 0.0);
        assert_eq!(verified.witness.is_some(), verified.terminal_horizon > 1);
        assert!(verified.to_string().contains("stays admissible for ever"));
    }
}

#[test]
fn the_sufficient_form_is_proved_as_well() {
    let options = DesignOptions {
        condition: Condition::Sufficient,
        ..DesignOptions::default()
    };
    let ingredients = TerminalIngredients::design(&academic(), &options).unwrap();
    let text = Certificate::of(&ingredients).unwrap().to_json();
    assert_eq!(
        verify(&text, VerifyOptions::default())
            .unwrap()
            .terminal_horizon,
        6
    );
}

/// Changes the file and expects a refusal, first by the digest and then by the proof.
fn refused(text: &str, what: &str, change: impl Fn(&mut Value)) {
    let mut value: Value = serde_json::from_str(text).unwrap();
    change(&mut value);
    let changed = value.to_string();
    assert_ne!(changed, text, "{what}: nothing was changed");
    let with_digest = verify(&changed, VerifyOptions::default());
    assert!(with_digest.is_err(), "{what}: passed the digest");
    let blind = verify(&changed, BLIND);
    assert!(blind.is_err(), "{what}: accepted: {blind:?}");
}

fn scale(value: &mut Value, by: f64) {
    *value = json!(value.as_f64().unwrap() * by);
}

#[test]
fn every_kind_of_change_is_refused() {
    for problem in [academic(), skew()] {
        let (_, text) = certificate(&problem);
        let claim = |path: &'static str, by: f64| {
            refused(&text, &format!("{path} by {by}"), |v| {
                scale(v.pointer_mut(path).unwrap(), by);
            });
        };
        for by in [0.9, 1.1] {
            for path in [
                "/claim/a/rows/0/0/1",
                "/claim/a/rows/1/0/1",
                "/claim/q/rows/0/0/1",
                "/claim/r/rows/0/0/1",
                "/claim/gain/rows/0/0/1",
                "/claim/weight/rows/1/1/1",
            ] {
                claim(path, by);
            }
            for key in ["b", "state_basis", "input_basis"] {
                refused(&text, &format!("{key} by {by}"), |v| {
                    let rows = v["claim"][key]["rows"].as_array_mut().unwrap();
                    let row = rows.iter_mut().find(|r| !r.as_array().unwrap().is_empty());
                    scale(&mut row.unwrap()[0][1], by);
                });
            }
        }
        // Another half width of the box is no lie: the checker finds out how wide it has to be. This one is no width.
        claim("/proof/boxes/1/half_width", -1.0);
        claim("/claim/scaling", 1.1);
        claim("/proof/witness/point/0/1", 1.5);
        claim("/proof/witness/point/0/1", -1.0);
        for (k, m) in [(-1_i64, "smaller"), (1, "larger")] {
            refused(&text, &format!("{m} horizon"), |v| {
                let h = v["claim"]["terminal_horizon"].as_i64().unwrap();
                v["claim"]["terminal_horizon"] = json!(h + k);
            });
        }
        refused(&text, "smaller horizon, smaller steps, no witness", |v| {
            v["claim"]["terminal_horizon"] = json!(1);
            v["proof"]["witness"] = Value::Null;
            for proof in v["proof"]["spent"].as_array_mut().unwrap() {
                let step = proof["step"].as_i64().unwrap();
                proof["step"] = json!(step.min(2));
            }
        });
        refused(&text, "no witness", |v| v["proof"]["witness"] = Value::Null);
        refused(&text, "tighter bound", |v| {
            scale(&mut v["claim"]["constraints"][0]["upper"], 0.8)
        });
        refused(&text, "wider bound", |v| {
            scale(&mut v["claim"]["constraints"][1]["upper"], 1.5)
        });
        refused(&text, "no constraint coefficient", |v| {
            v["claim"]["constraints"][0]["c"] = json!([])
        });
        refused(&text, "another constraint", |v| {
            v["claim"]["constraints"][0]["c"][0][1] = json!(2.0)
        });
        refused(&text, "bound left out", |v| {
            v["claim"]["constraints"].as_array_mut().unwrap().pop();
        });
        refused(&text, "row left out", |v| {
            v["proof"]["spent"].as_array_mut().unwrap().pop();
        });
        refused(&text, "unknown condition", |v| {
            v["claim"]["condition"] = json!("hoped")
        });
        refused(&text, "unknown format", |v| {
            v["format"] = json!("mpct certificate 9")
        });
        refused(&text, "another key", |v| v["claim"]["surprise"] = json!(1));
        refused(&text, "origin outside", |v| {
            v["claim"]["operating_state"][0] = json!(9.0)
        });
    }
}

/// Rows with little room to spare: every multiplier of the tightest rows matters.
#[test]
fn scaled_and_dropped_multipliers_are_refused() {
    for problem in [academic(), skew()] {
        let (_, text) = certificate(&problem);
        let value: Value = serde_json::from_str(&text).unwrap();
        let proofs = value["proof"]["spent"].as_array().unwrap();
        let mut tried = 0;
        for (k, proof) in proofs.iter().enumerate() {
            let count = proof["multipliers"].as_array().unwrap().len();
            for m in 0..count {
                let y = proof["multipliers"][m][3].as_f64().unwrap();
                if y < 0.1 {
                    continue;
                }
                tried += 1;
                for by in [0.0, -1.0, 20.0] {
                    refused(&text, &format!("proof {k} multiplier {m} by {by}"), |v| {
                        scale(&mut v["proof"]["spent"][k]["multipliers"][m][3], by);
                    });
                }
                refused(&text, "a multiplier of a later step", |v| {
                    v["proof"]["spent"][k]["multipliers"][m][2] =
                        v["proof"]["spent"][k]["step"].clone();
                });
            }
        }
        assert!(tried > 3);
        for l in 0..3 {
            refused(&text, "a box without its rows", |v| {
                v["proof"]["boxes"][l]["upper"] = json!([])
            });
        }
    }
}

/// An edit that changes nothing the claim rests on is the digest's business alone.
#[test]
fn the_digest_sees_what_the_proof_does_not() {
    let (_, text) = certificate(&academic());
    let changed = text.replacen("\"problem\":\"\"", "\"problem\":\"another\"", 1);
    assert_eq!(
        verify(&changed, VerifyOptions::default()),
        Err(VerifyError::Digest)
    );
    assert!(verify(&changed, BLIND).is_ok());
    assert!(matches!(
        verify("{}", BLIND),
        Err(VerifyError::Unreadable(_))
    ));
}

/// Discs, one off center, one beside rows; and a plant with three states, whose fans have triangles.
fn with_ellipsoids() -> [Problem; 3] {
    let discs = |c: Constraints, q: f64| {
        let academic = academic();
        Problem::new(academic.plant().clone(), c, Weights::new(q, 100.0, 1e4)).unwrap()
    };
    let two = Constraints::new(2, 2)
        .state_ellipsoid_around(1.0 / 9.0, vec![0.3, -0.1])
        .unwrap()
        .input_ellipsoid(vec![0.25, 0.3])
        .unwrap();
    let beside_rows = academic()
        .constraints()
        .clone()
        .state_ellipsoid(Matrix::from_rows(&[[0.2, 0.05], [0.05, 0.3]]))
        .unwrap();
    let three = Plant::discrete(
        Matrix::from_rows(&[[0.9, 0.3, 0.1], [-0.2, 0.8, 0.2], [0.1, 0.0, 0.9]]),
        Matrix::from_rows(&[[0.1, 0.3], [0.7, 0.0], [0.2, 0.5]]),
    )
    .unwrap();
    let balls = Constraints::new(3, 2)
        .state_ellipsoid(0.25)
        .unwrap()
        .norm_bound(
            Matrix::from_rows(&[[0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]),
            Matrix::from_rows(&[[0.8, 0.0], [0.0, 0.8]]),
        )
        .unwrap();
    let three = Problem::new(three, balls, Weights::new(1.0, 1.0, 1e3)).unwrap();
    [discs(two, 10.0), discs(beside_rows, 10.0), three]
}

#[test]
fn certificates_with_ellipsoids_are_accepted() {
    for problem in with_ellipsoids() {
        for task in [Task::Tracking, Task::Regulation] {
            let (ingredients, text) = certificate(&problem.clone().with_task(task));
            let verified = verify(&text, VerifyOptions::default()).unwrap();
            assert_eq!(verified.terminal_horizon, ingredients.terminal_horizon());
            assert_eq!(verified.ellipsoids, problem.norms().len());
            assert_eq!(verified.rows_to_tolerance, 0);
            assert!(verified.smallest_margin > 0.0);
            assert!(verified.to_string().contains("ellipsoids are implied"));
        }
    }
}

#[test]
fn every_kind_of_change_to_ellipsoids_is_refused() {
    for problem in with_ellipsoids() {
        let (_, text) = certificate(&problem);
        let value: Value = serde_json::from_str(&text).unwrap();
        let proofs = value["proof"]["ellipsoids"].as_array().unwrap().clone();
        // The ellipsoid with the smallest margin is spent last.
        let (k, last) = proofs
            .iter()
            .enumerate()
            .max_by_key(|p| p.1["step"].as_u64())
            .unwrap();
        let of = last["ellipsoid"].as_u64().unwrap() as usize;
        assert!(last["step"].as_u64().unwrap() > 1);
        refused(&text, "a smaller ellipsoid", |v| {
            for row in v["claim"]["ellipsoids"][of]["f"]["rows"]
                .as_array_mut()
                .unwrap()
            {
                row.as_array_mut()
                    .unwrap()
                    .iter_mut()
                    .for_each(|e| scale(&mut e[1], 1.2));
            }
        });
        refused(&text, "another center", |v| {
            v["claim"]["ellipsoids"][of]["center_state"][0] = json!(50.0)
        });
        refused(&text, "an ellipsoid of another plant", |v| {
            v["claim"]["ellipsoids"][of]["center_state"] = json!([0.0])
        });
        refused(&text, "an ellipsoid left out", |v| {
            v["claim"]["ellipsoids"].as_array_mut().unwrap().remove(of);
        });
        refused(&text, "a proof left out", |v| {
            v["proof"]["ellipsoids"].as_array_mut().unwrap().remove(k);
        });
        refused(&text, "a proof twice", |v| {
            let proof = v["proof"]["ellipsoids"][k].clone();
            v["proof"]["ellipsoids"].as_array_mut().unwrap().push(proof);
        });
        refused(&text, "an earlier step", |v| {
            v["proof"]["ellipsoids"][k]["step"] = json!(1)
        });
        refused(&text, "a later step than the horizon allows", |v| {
            let horizon = v["claim"]["terminal_horizon"].as_u64().unwrap();
            v["proof"]["ellipsoids"][k]["step"] = json!(horizon + 2)
        });
        refused(&text, "a larger scaling", |v| {
            scale(&mut v["claim"]["scaling"], 1.05)
        });
        let supports = last["supports"].as_array().unwrap();
        refused(&text, "an axis left out", |v| {
            let list = v["proof"]["ellipsoids"][k]["supports"]
                .as_array_mut()
                .unwrap();
            let axis = list.iter().position(|s| {
                let d = s["direction"].as_array().unwrap();
                d.iter().map(|v| v.as_i64().unwrap().abs()).sum::<i64>() == 1
            });
            list.remove(axis.unwrap());
        });
        refused(&text, "a direction of another space", |v| {
            v["proof"]["ellipsoids"][k]["supports"][0]["direction"]
                .as_array_mut()
                .unwrap()
                .push(json!(0))
        });
        refused(&text, "a direction without end", |v| {
            v["proof"]["ellipsoids"][k]["supports"][0]["direction"][0] = json!(i64::MAX)
        });
        refused(&text, "the whole called split", |v| {
            let split = v["proof"]["ellipsoids"][k]["split"].as_bool().unwrap();
            v["proof"]["ellipsoids"][k]["split"] = json!(!split)
        });
        // Multipliers of the directions in which the ellipsoid reaches furthest.
        let (mut tried, mut missed) = (0, 0);
        for (s, support) in supports.iter().enumerate() {
            for (c, cone) in support["cones"].as_array().unwrap().iter().enumerate() {
                let w: Vec<f64> = cone[2]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|w| w.as_f64().unwrap())
                    .collect();
                if w.iter().fold(0.0_f64, |a, w| a.max(w.abs())) < 0.5 {
                    continue;
                }
                tried += 1;
                let path = format!("/proof/ellipsoids/{k}/supports/{s}/cones/{c}");
                let times = |v: &mut Value, by: f64| {
                    let w = v.pointer_mut(&path).unwrap()[2].as_array_mut().unwrap();
                    w.iter_mut().for_each(|w| scale(w, by));
                };
                for by in [-1.0, 20.0, 1e308] {
                    refused(&text, &format!("{path} by {by}"), |v| times(v, by));
                }
                // In directions with room to spare the box alone may do.
                let mut without = value.clone();
                times(&mut without, 0.0);
                missed += usize::from(verify(&without.to_string(), BLIND).is_err());
                refused(&text, "a cone of a later step", |v| {
                    v.pointer_mut(&path).unwrap()[1] = last["step"].clone()
                });
                refused(&text, "a cone of no ellipsoid", |v| {
                    v.pointer_mut(&path).unwrap()[0] = json!(9)
                });
            }
        }
        assert!(tried > 1 && missed > 0, "{tried} {missed}");
    }
}
