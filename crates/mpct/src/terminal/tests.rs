//! Horizons with known values, and the local search against the whole one.

use super::watched;
use crate::certificate::{Certificate, VerifyOptions, verify};
use crate::clock::Clock;
use crate::{
    Condition, Constraints, DesignError, DesignOptions, Matrix, Plant, Problem, SparseMatrix,
    TerminalIngredients, Weights,
};
use std::ops::ControlFlow;
use std::time::Duration;

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

/// Section 4.2 of the paper; k, h, m, N and O are not printed there.
fn carts(n: usize) -> Problem {
    let (mut a, mut b) = (Vec::new(), Vec::new());
    for i in 0..n {
        a.push((2 * i, 2 * i + 1, 1.0));
        b.push((2 * i + 1, i, 50.0));
        for j in [i.wrapping_sub(1), i + 1] {
            if j < n {
                for (at, v) in [(i, -1.0), (j, 1.0)] {
                    a.push((2 * i + 1, 2 * at, 0.5 * v));
                    a.push((2 * i + 1, 2 * at + 1, 0.2 * v));
                }
            }
        }
    }
    let plant = Plant::continuous(
        SparseMatrix::from_triplets(2 * n, 2 * n, &a).unwrap(),
        SparseMatrix::from_triplets(2 * n, n, &b).unwrap(),
        0.02,
    )
    .unwrap();
    let upper: Vec<f64> = [4.0, 1.0].repeat(n);
    let lower: Vec<f64> = upper.iter().map(|v| -v).collect();
    let constraints = Constraints::new(2 * n, n)
        .state_bounds(&lower, &upper)
        .unwrap()
        .input_bounds(&vec![-1.0; n], &vec![1.0; n])
        .unwrap();
    let weights = Weights::new([1.0, 1.5].repeat(n), 20.0, 1e4);
    Problem::new(plant, constraints, weights).unwrap()
}

const SCALINGS: [f64; 8] = [0.99, 0.9, 0.89, 0.79, 0.69, 0.59, 0.49, 0.39];

#[test]
fn academic_horizons_of_both_forms() {
    for (condition, expected) in [
        (Condition::Exact, [10, 5, 5, 4, 3, 3, 3, 2]),
        (Condition::Sufficient, [13, 6, 6, 5, 5, 4, 4, 4]),
    ] {
        let options = DesignOptions {
            condition,
            ..DesignOptions::default()
        };
        let designs = TerminalIngredients::design_all(&academic(), &SCALINGS, &options).unwrap();
        let found: Vec<usize> = designs
            .iter()
            .map(|d| d.as_ref().unwrap().terminal_horizon())
            .collect();
        assert_eq!(found, expected, "{condition}");
    }
}

/// Per cart, position rows are spent at step 6 at the latest, velocity rows at 14, input rows at 1.
#[test]
fn carts_are_searched_locally() {
    for n in [5, 40] {
        let problem = carts(n);
        let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default()).unwrap();
        assert_eq!(ingredients.terminal_horizon(), 13);
        let latest = |rows: &dyn Fn(usize) -> bool| {
            let spent = ingredients.spent_steps();
            let chosen = spent.iter().enumerate().filter(|(i, _)| rows(*i));
            chosen.map(|(_, s)| s.1).max().unwrap()
        };
        // Rows come state by state, upper and lower, then the inputs.
        assert_eq!(latest(&|i| i < 4 * n && i % 4 < 2), 6);
        assert_eq!(latest(&|i| i < 4 * n && i % 4 >= 2), 14);
        assert_eq!(latest(&|i| i >= 4 * n), 1);
        let text = Certificate::of(&ingredients).unwrap().to_json();
        let verified = verify(&text, VerifyOptions::default()).unwrap();
        assert_eq!(verified.rows_rigorous, 6 * n);
    }
}

#[test]
fn two_hundred_carts_are_certified() {
    let ingredients = TerminalIngredients::design(&carts(200), &DesignOptions::default()).unwrap();
    assert_eq!(ingredients.terminal_horizon(), 13);
    let text = Certificate::of(&ingredients).unwrap().to_json();
    assert!(
        verify(&text, VerifyOptions::default())
            .unwrap()
            .smallest_margin
            > 0.0
    );
}

/// Two lightly damped modes of the same period that no input reaches beat against each other.
fn slow(modulus: f64, scaling: f64) -> Problem {
    let (c, s) = (modulus * 0.01_f64.cos(), modulus * 0.01_f64.sin());
    let plant = Plant::discrete(
        Matrix::from_rows(&[[c, s], [-s, c]]),
        Matrix::from_rows(&[[0.0], [1e-4]]),
    )
    .unwrap();
    let constraints = Constraints::new(2, 1)
        .state_bounds(&[-1.0; 2], &[1.0; 2])
        .unwrap()
        .input_bounds(&[-1.0], &[1.0])
        .unwrap();
    Problem::new(plant, constraints, Weights::new(1.0, 1e4, 1e3))
        .unwrap()
        .with_scaling(scaling)
        .unwrap()
}

#[test]
fn lightly_damped_plants_are_certified() {
    for modulus in [0.99, 0.999, 0.9995] {
        let ingredients =
            TerminalIngredients::design(&slow(modulus, 0.9), &DesignOptions::default()).unwrap();
        let text = Certificate::of(&ingredients).unwrap().to_json();
        let verified = verify(&text, VerifyOptions::default()).unwrap();
        assert_eq!(verified.rows_to_tolerance, 0);
    }
}

#[test]
fn a_row_that_is_not_spent_is_named() {
    let options = DesignOptions {
        max_horizon: 20,
        ..DesignOptions::default()
    };
    match TerminalIngredients::design(&slow(0.9995, 0.9), &options) {
        Err(DesignError::HorizonNotDetermined {
            reached,
            row,
            support,
            hint,
            ..
        }) => {
            assert_eq!(reached, 20);
            assert!(row.starts_with("state_"), "{row}");
            assert!(support > 1.0);
            assert!(
                hint.contains("at step 21") && hint.contains("0.9"),
                "{hint}"
            );
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_search_can_be_stopped() {
    let stop = |_: &crate::Progress| ControlFlow::Break(());
    let options = DesignOptions {
        progress: Some(&stop),
        ..DesignOptions::default()
    };
    let stopped = TerminalIngredients::design(&carts(40), &options);
    assert!(matches!(stopped, Err(DesignError::Interrupted { .. })));
    let options = DesignOptions {
        time_limit: Some(Duration::ZERO),
        ..DesignOptions::default()
    };
    let stopped = TerminalIngredients::design(&carts(40), &options);
    assert!(matches!(stopped, Err(DesignError::Interrupted { .. })));
}

/// Work that goes on until the clock rings, which only the watcher beside it can make it do.
#[test]
fn work_without_progress_can_be_stopped() {
    let stop = |_: &crate::Progress| ControlFlow::Break(());
    let options = DesignOptions {
        progress: Some(&stop),
        ..DesignOptions::default()
    };
    let clock = Clock::unlimited();
    let rounds = watched(&options, &clock, || {
        let mut rounds = 0_u64;
        while !clock.has_stopped() {
            std::thread::yield_now();
            rounds += 1;
        }
        rounds
    });
    assert!(rounds > 0);
    // Work that ends by itself is not held up, and nobody stops the clock.
    let go_on = |_: &crate::Progress| ControlFlow::Continue(());
    let options = DesignOptions {
        progress: Some(&go_on),
        ..DesignOptions::default()
    };
    let clock = Clock::unlimited();
    assert_eq!(watched(&options, &clock, || 7), 7);
    assert!(!clock.has_stopped());
}

/// Units do not matter when the weights are stated in them.
#[test]
fn units_do_not_change_the_horizon() {
    let problem = |k: f64| {
        let plant = Plant::discrete(
            Matrix::from_rows(&[[1.0, 0.1 * k * k], [0.0, 0.95]]),
            Matrix::from_rows(&[[0.0], [0.1 / k]]),
        )
        .unwrap();
        let constraints = Constraints::new(2, 1)
            .state_bounds(&[-k, -1.0 / k], &[k, 1.0 / k])
            .unwrap()
            .input_bounds(&[-1.0], &[1.0])
            .unwrap();
        let q = vec![1.0 / (k * k), k * k];
        Problem::new(plant, constraints, Weights::new(q.clone(), 1.0, q)).unwrap()
    };
    for k in [1.0, 1e3, 1e6] {
        let ingredients =
            TerminalIngredients::design(&problem(k), &DesignOptions::default()).unwrap();
        assert_eq!(ingredients.terminal_horizon(), 20, "{k}");
        let text = Certificate::of(&ingredients).unwrap().to_json();
        assert!(verify(&text, VerifyOptions::default()).is_ok());
    }
}

/// Weights that do not fit the units: K and P lose all digits, and the design says so.
#[test]
fn a_terminal_cost_that_cannot_be_verified_is_refused() {
    for k in [1e3, 1e6] {
        let plant = Plant::discrete(
            Matrix::from_rows(&[[1.0, 0.1 * k * k], [0.0, 0.95]]),
            Matrix::from_rows(&[[0.0], [0.1 / k]]),
        )
        .unwrap();
        let constraints = Constraints::new(2, 1)
            .state_bounds(&[-k, -1.0 / k], &[k, 1.0 / k])
            .unwrap()
            .input_bounds(&[-1.0], &[1.0])
            .unwrap();
        let problem = Problem::new(plant, constraints, Weights::new(1.0, 1.0, 1e3)).unwrap();
        match TerminalIngredients::design(&problem, &DesignOptions::default()) {
            Err(DesignError::Solver { what, detail }) => {
                assert_eq!(what, "P of (3)");
                assert!(detail.contains("of the stage cost"), "{detail}");
            }
            other => panic!("{k}: {other:?}"),
        }
    }
}

/// Inputs that do nearly the same, and rows that say nearly the same.
#[test]
fn nearly_dependent_inputs_and_rows_change_nothing() {
    for e in [1e-3, 1e-6, 1e-9, 1e-12] {
        let plant = Plant::discrete(
            Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
            Matrix::from_rows(&[[0.0, 0.0], [1.0, 1.0 + e]]),
        )
        .unwrap();
        let constraints = Constraints::new(2, 2)
            .state_bounds(&[-3.0; 2], &[3.0; 2])
            .unwrap()
            .input_bounds(&[-2.0; 2], &[2.0; 2])
            .unwrap();
        let alike =
            Problem::new(plant, constraints.clone(), Weights::new(10.0, 100.0, 1e4)).unwrap();
        let rows = Matrix::from_rows(&[[1.0, e], [1.0 + e, 0.0], [1.0, -e]]);
        let bounds = vec![3.0, 3.0, 3.0 * (1.0 + e)];
        let constraints = constraints
            .mixed(rows, Matrix::zeros(3, 2), bounds)
            .unwrap();
        let crowded = Problem::new(
            academic().plant().clone(),
            constraints,
            Weights::new(10.0, 100.0, 1e4),
        )
        .unwrap();
        for problem in [alike, crowded] {
            let ingredients =
                TerminalIngredients::design(&problem, &DesignOptions::default()).unwrap();
            assert_eq!(ingredients.terminal_horizon(), 5, "{e}");
            let text = Certificate::of(&ingredients).unwrap().to_json();
            let verified = verify(&text, VerifyOptions::default()).unwrap();
            assert_eq!(verified.rows_to_tolerance, 0);
        }
    }
}
