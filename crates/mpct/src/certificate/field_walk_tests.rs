//! Every number, flag and index of a small certificate is changed, one at a time, with the digest ignored.
//!
//! [`FIELDS`] says of each kind of field what must happen. Some changes are no lie: a file is a claim and a proof, and the
//! checker owes an answer about the file as it is, not about the one it was made from. What is accepted is therefore put to
//! a second judge: a changed claim is designed anew, with the gain of the file, and must have the horizon that it claims.

use super::tests::{BLIND, certificate, skew};
use super::*;
use crate::{Constraints, DesignOptions, Matrix, Plant, Problem, TerminalIngredients, Weights};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// An integrator with a bound on one side of its position: equilibria are unbounded, and so is one coordinate of the proof.
fn one_sided() -> Problem {
    let plant = Plant::discrete(
        Matrix::from_rows(&[[1.0, 0.5], [0.0, 0.9]]),
        Matrix::from_rows(&[[0.0], [0.4]]),
    )
    .unwrap();
    let constraints = Constraints::new(2, 1)
        .state_bounds(&[f64::NEG_INFINITY, -1.0], &[2.0, 1.0])
        .unwrap()
        .input_bounds(&[-1.0], &[1.5])
        .unwrap();
    Problem::new(plant, constraints, Weights::new(1.0, 2.0, 1e3)).unwrap()
}

/// Bounds on the input alone: two steps of the law bound both states.
fn input_only() -> Problem {
    let plant = Plant::discrete(
        Matrix::from_rows(&[[0.9, 0.4], [-0.2, 0.8]]),
        Matrix::from_rows(&[[0.1], [0.7]]),
    )
    .unwrap();
    let constraints = Constraints::new(2, 1)
        .input_bounds(&[-1.0], &[1.5])
        .unwrap();
    Problem::new(plant, constraints, Weights::new(1.0, 2.0, 1e3)).unwrap()
}

/// A stable state that is bounded from above and seen by nothing else is unbounded for ever.
#[test]
fn states_that_stay_unbounded_are_named() {
    let plant = Plant::discrete(
        Matrix::from_rows(&[[0.5, 0.0], [0.0, 0.5]]),
        Matrix::from_rows(&[[0.0], [1.0]]),
    )
    .unwrap();
    let constraints = Constraints::new(2, 1)
        .state_bounds(&[f64::NEG_INFINITY, -1.0], &[1.0, 1.0])
        .unwrap()
        .input_bounds(&[-1.0], &[1.0])
        .unwrap();
    let problem = Problem::new(plant, constraints, Weights::new(1.0, 1.0, 1.0)).unwrap();
    let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default()).unwrap();
    let refusal = Certificate::of(&ingredients).unwrap_err().to_string();
    assert!(refusal.contains("e[0]"), "{refusal}");
    assert!(refusal.contains("State the missing bounds"), "{refusal}");
}

/// The paths of all numbers and flags below a value.
fn leaves(value: &Value, path: &str, out: &mut Vec<String>) {
    match value {
        Value::Object(map) => map
            .iter()
            .for_each(|(key, v)| leaves(v, &format!("{path}/{key}"), out)),
        Value::Array(list) => list
            .iter()
            .enumerate()
            .for_each(|(k, v)| leaves(v, &format!("{path}/{k}"), out)),
        Value::Number(_) | Value::Bool(_) => out.push(path.into()),
        Value::Null | Value::String(_) => {}
    }
}

/// What a leaf is changed to, in words and as a value.
fn changes(value: &Value) -> Vec<(String, Value)> {
    match value {
        Value::Bool(b) => vec![("flipped".into(), json!(!b))],
        Value::Number(n) if n.is_u64() => {
            let n = n.as_u64().unwrap();
            let mut to = vec![n + 1, n + 1000, u64::MAX];
            to.extend(n.checked_sub(1));
            to.into_iter()
                .map(|v| (format!("to {v}"), json!(v)))
                .collect()
        }
        _ => {
            let v = value.as_f64().unwrap();
            let by = [0.0, -1.0, 0.5, 0.9, 1.1, 2.0, 1e12];
            by.iter()
                .filter(|&&by| v * by != v)
                .map(|&by| (format!("by {by}"), json!(v * by)))
                .collect()
        }
    }
}

/// A path with * for the numbers in it.
fn pattern(path: &str) -> String {
    let parts = path.split('/').map(|p| {
        if !p.is_empty() && p.bytes().all(|b| b.is_ascii_digit()) {
            "*"
        } else {
            p
        }
    });
    parts.collect::<Vec<_>>().join("/")
}

/// What a change of a field may come to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    /// Every change is refused.
    Refused,
    /// Another problem: accepted only where the claim is true of that problem as well.
    Judged,
    /// Another proof of the same claim: accepted where it still is one. The claim is the true one, so nothing false is
    /// believed, and most changes break the proof.
    SameClaim,
}

/// Every kind of field with a number or a flag in it.
const FIELDS: [(&str, Fate, &str); 22] = {
    use Fate::{Judged, Refused, SameClaim};
    [
        ("/claim/a/columns", Refused, "shapes must fit"),
        (
            "/claim/a/rows/*/*/*",
            Refused,
            "P no longer satisfies (3), M_θ no longer rests",
        ),
        ("/claim/b/columns", Refused, "shapes must fit"),
        (
            "/claim/b/rows/*/*/*",
            Refused,
            "P no longer satisfies (3), M_θ no longer rests",
        ),
        ("/claim/q/columns", Refused, "shapes must fit"),
        ("/claim/q/rows/*/*/*", Refused, "P no longer satisfies (3)"),
        ("/claim/r/columns", Refused, "shapes must fit"),
        ("/claim/r/rows/*/*/*", Refused, "P no longer satisfies (3)"),
        ("/claim/gain/columns", Refused, "shapes must fit"),
        (
            "/claim/gain/rows/*/*/*",
            Refused,
            "P belongs to this K alone",
        ),
        ("/claim/weight/columns", Refused, "shapes must fit"),
        ("/claim/weight/rows/*/*/*", Refused, "(3) has one solution"),
        ("/claim/state_basis/columns", Refused, "shapes must fit"),
        ("/claim/input_basis/columns", Refused, "shapes must fit"),
        (
            "/claim/operating_*/*",
            Judged,
            "moves the room of every row",
        ),
        ("/claim/constraints/*/c/*/*", Judged, "another row"),
        ("/claim/constraints/*/d/*/*", Judged, "another row"),
        ("/claim/constraints/*/bound", Judged, "another row"),
        (
            "/claim/terminal_horizon",
            Refused,
            "the last spent step and the witness fix it",
        ),
        ("/claim/scaling", Judged, "another λΘ"),
        (
            "/claim/*_basis/rows/*/*/*",
            Judged,
            "another basis of the same equilibria",
        ),
        (
            "/proof",
            SameClaim,
            "any multipliers, box and point that prove the claim will do",
        ),
    ]
};

/// The kind of a path.
fn field(path: &str) -> (&'static str, Fate) {
    let pattern = pattern(path)
        .replace("/operating_state/", "/operating_*/")
        .replace("/operating_input/", "/operating_*/")
        .replace("/state_basis/rows", "/*_basis/rows")
        .replace("/input_basis/rows", "/*_basis/rows")
        .replace("/lower", "/bound")
        .replace("/upper", "/bound");
    let fits =
        |f: &&(&str, Fate, &str)| f.0 == pattern || (f.0 == "/proof" && path.starts_with(f.0));
    let found = FIELDS.iter().find(fits);
    let found = found.unwrap_or_else(|| panic!("{path} is of no kind"));
    (found.0, found.1)
}

fn matrix(value: &Value) -> Matrix {
    let columns = value["columns"].as_u64().unwrap() as usize;
    dense(value["rows"].as_array().unwrap(), columns)
}

fn dense(rows: &[Value], columns: usize) -> Matrix {
    let mut m = Matrix::zeros(rows.len(), columns);
    for (i, row) in rows.iter().enumerate() {
        for entry in row.as_array().unwrap() {
            let j = entry[0].as_u64().unwrap() as usize;
            m.set(i, j, entry[1].as_f64().unwrap());
        }
    }
    m
}

/// The horizon that a design of the problem in a claim finds, with the gain of the claim. Every side is a mixed row.
fn second_opinion(claim: &Value) -> usize {
    let numbers = |v: &Value| -> Vec<f64> {
        let list = v.as_array().unwrap().iter();
        list.map(|x| x.as_f64().unwrap()).collect()
    };
    let (a, b) = (matrix(&claim["a"]), matrix(&claim["b"]));
    let (n, m) = (a.rows(), b.cols());
    let (mut c, mut d, mut bounds) = (Vec::new(), Vec::new(), Vec::new());
    for row in claim["constraints"].as_array().unwrap() {
        for (side, sign) in [("upper", 1.0), ("lower", -1.0)] {
            if let Some(bound) = row[side].as_f64() {
                let signed = |key: &str, columns| {
                    let row = dense(std::slice::from_ref(&row[key]), columns);
                    (0..columns)
                        .map(|j| sign * row.get(0, j))
                        .collect::<Vec<f64>>()
                };
                c.push(signed("c", n));
                d.push(signed("d", m));
                bounds.push(sign * bound);
            }
        }
    }
    let constraints = Constraints::new(n, m)
        .mixed(
            Matrix::from_vecs("C", &c).unwrap(),
            Matrix::from_vecs("D", &d).unwrap(),
            bounds,
        )
        .unwrap();
    let plant = Plant::discrete(a, b)
        .unwrap()
        .with_operating_point(
            numbers(&claim["operating_state"]),
            numbers(&claim["operating_input"]),
        )
        .unwrap();
    let weights = Weights::new(matrix(&claim["q"]), matrix(&claim["r"]), 1.0);
    let problem = Problem::new(plant, constraints, weights)
        .unwrap()
        .with_scaling(claim["scaling"].as_f64().unwrap())
        .unwrap()
        .with_gain(matrix(&claim["gain"]))
        .unwrap();
    TerminalIngredients::design(&problem, &DesignOptions::default())
        .unwrap()
        .terminal_horizon()
}

#[test]
fn every_number_is_walked_over() {
    // Refused and accepted changes of each kind of field.
    let mut met: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for (problem, box_steps) in [(skew(), 0), (one_sided(), 0), (input_only(), 1)] {
        let (_, text) = certificate(&problem);
        let value: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(value["proof"]["box_steps"], box_steps);
        let horizon = value["claim"]["terminal_horizon"].as_u64().unwrap() as usize;
        assert_eq!(second_opinion(&value["claim"]), horizon);
        let mut paths = Vec::new();
        leaves(&value, "", &mut paths);
        assert!(paths.len() > 100, "{} leaves", paths.len());
        for path in paths {
            let (kind, fate) = field(&path);
            let before = value.pointer(&path).unwrap();
            for (what, after) in changes(before) {
                let mut changed = value.clone();
                *changed.pointer_mut(&path).unwrap() = after;
                let counts = met.entry(kind).or_default();
                match verify(&changed.to_string(), BLIND) {
                    Err(_) => counts[0] += 1,
                    Ok(_) if fate == Fate::Refused => panic!("{path} {before} {what}: accepted"),
                    Ok(verified) => {
                        counts[1] += 1;
                        assert!(!verified.digest_fits);
                        assert_eq!(verified.terminal_horizon, horizon);
                        if fate == Fate::Judged {
                            let judged = second_opinion(&changed["claim"]);
                            assert_eq!(judged, horizon, "{path} {before} {what}");
                        }
                    }
                }
            }
        }
    }
    for (kind, _, why) in FIELDS {
        let [refused, accepted] = met.remove(kind).unwrap_or_default();
        assert!(
            refused > accepted,
            "{kind} ({why}): {refused} refused, {accepted} accepted"
        );
    }
}
