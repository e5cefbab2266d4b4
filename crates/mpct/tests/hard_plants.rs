//! Numerically hard plants: the answer of the slow reference, and a certificate that the checker accepts.

mod support;

use mpct::certificate::{Certificate, VerifyOptions, verify};
use mpct::{
    Constraints, DesignOptions, Matrix, Plant, Problem, Progress, TerminalIngredients, Weights,
};
use std::ops::ControlFlow;
use std::sync::Mutex;
use support::cases;
use support::reference::{Form, Reference, Writing};

fn design(problem: &Problem) -> TerminalIngredients {
    TerminalIngredients::design(problem, &DesignOptions::default())
        .unwrap_or_else(|e| panic!("{}: {e}", problem.name()))
}

/// The horizon, proved by its certificate with a witness that one step less is too few.
fn certified(problem: &Problem) -> usize {
    let ingredients = design(problem);
    let text = Certificate::of(&ingredients)
        .unwrap_or_else(|e| panic!("{}: {e}", problem.name()))
        .to_json();
    let verified = verify(&text, VerifyOptions::default())
        .unwrap_or_else(|e| panic!("{}: {e}", problem.name()));
    assert_eq!(verified.rows_to_tolerance, 0, "{}", problem.name());
    assert!(verified.witness.is_some(), "{}", problem.name());
    verified.terminal_horizon
}

/// The same by the reference: M̃ = 1, 2, … with a linear program a row.
fn by_reference(problem: &Problem) -> usize {
    let ingredients = design(problem);
    let terminal = Reference::new(&ingredients).tracking();
    terminal.horizon(Form::First, Writing::Plain, 3000)
}

/// A lightly damped oscillation of period 2π/0.1 steps whose input is expensive: the closed loop keeps its damping.
fn lightly_damped(modulus: f64) -> Problem {
    let (c, s) = (modulus * 0.1_f64.cos(), modulus * 0.1_f64.sin());
    let plant = Plant::discrete(
        Matrix::from_rows(&[[c, s], [-s, c]]),
        Matrix::from_rows(&[[0.0], [1e-2]]),
    )
    .unwrap();
    let constraints = Constraints::new(2, 1)
        .state_bounds(&[-1.0, -2.0], &[1.0, 2.0])
        .unwrap()
        .input_bounds(&[-1.0], &[1.0])
        .unwrap();
    Problem::new(plant, constraints, Weights::new(1.0, 1e6, 1e3))
        .unwrap()
        .with_name(format!("damped {modulus}"))
}

#[test]
fn lightly_damped_plants_agree_with_the_reference() {
    for modulus in [0.9, 0.97, 0.99] {
        let problem = lightly_damped(modulus);
        assert_eq!(certified(&problem), by_reference(&problem), "{modulus}");
    }
}

#[test]
fn the_slowest_modes_are_certified() {
    for modulus in [0.999, 0.9995] {
        let problem = lightly_damped(modulus);
        let radius = design(&problem).spectral_radius();
        assert!((radius - modulus).abs() < 2e-4, "{radius}");
        assert!(certified(&problem) > 5, "{modulus}");
    }
}

/// The academic plant in other units: states of size 1e-6 next to states of size 1e6.
#[test]
fn units_change_neither_horizon_nor_spent_steps() {
    let in_units = |k: f64| {
        let plant = Plant::discrete(
            Matrix::from_rows(&[[1.0, k * k], [0.0, 1.0]]),
            Matrix::from_rows(&[[0.0, 0.5 * k], [1.0 / k, 0.5 / k]]),
        )
        .unwrap();
        let constraints = Constraints::new(2, 2)
            .state_bounds(&[-3.0 * k, -3.0 / k], &[3.0 * k, 3.0 / k])
            .unwrap()
            .input_bounds(&[-2.0; 2], &[2.0; 2])
            .unwrap();
        let weight = |w: f64| vec![w / (k * k), w * k * k];
        Problem::new(
            plant,
            constraints,
            Weights::new(weight(10.0), 100.0, weight(1e4)),
        )
        .unwrap()
        .with_name(format!("units {k}"))
        .with_scaling(0.9)
        .unwrap()
    };
    let plain = cases::academic(0.9);
    let expected = by_reference(&plain);
    let steps = |p: &Problem| design(p).spent_steps();
    for k in [1.0, 1e3, 1e6] {
        let problem = in_units(k);
        assert_eq!(certified(&problem), expected, "{k}");
        assert_eq!(steps(&problem), steps(&plain), "{k}");
    }
}

#[test]
fn nearly_redundant_rows_agree_with_the_reference() {
    for e in [1e-3, 1e-6, 1e-9] {
        let constraints = Constraints::new(2, 2)
            .state_bounds(&[-3.0; 2], &[3.0; 2])
            .unwrap()
            .input_bounds(&[-2.0; 2], &[2.0; 2])
            .unwrap()
            .mixed(
                Matrix::from_rows(&[[1.0, e], [1.0 + e, 0.0], [1.0, -e]]),
                Matrix::zeros(3, 2),
                vec![3.0, 3.0, 3.0 * (1.0 + e)],
            )
            .unwrap();
        let plant = cases::academic(0.9).plant().clone();
        let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))
            .unwrap()
            .with_name(format!("rows {e}"));
        assert_eq!(certified(&problem), by_reference(&problem), "{e}");
    }
}

#[test]
fn nearly_dependent_inputs_agree_with_the_reference() {
    for e in [1e-3, 1e-6, 1e-9] {
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
        let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))
            .unwrap()
            .with_name(format!("inputs {e}"));
        assert_eq!(certified(&problem), by_reference(&problem), "{e}");
    }
}

/// Several λ at once give what each gives alone, row by row.
#[test]
fn a_sweep_is_its_designs() {
    let scalings = [0.5, 0.99, 0.9];
    for problem in [cases::drone(0.9), cases::carts(5, 0.9)] {
        let all = TerminalIngredients::design_all(&problem, &scalings, &DesignOptions::default())
            .unwrap();
        for (scaling, found) in scalings.into_iter().zip(all) {
            let alone = design(&problem.clone().with_scaling(scaling).unwrap());
            let found = found.unwrap();
            assert_eq!(found.terminal_horizon(), alone.terminal_horizon());
            assert_eq!(found.spent_steps(), alone.spent_steps());
        }
    }
}

#[test]
fn progress_names_row_and_step() {
    let told: Mutex<Vec<Progress>> = Mutex::default();
    let tell = |p: &Progress| {
        told.lock().unwrap().push(*p);
        ControlFlow::Continue(())
    };
    let options = DesignOptions {
        progress: Some(&tell),
        ..DesignOptions::default()
    };
    let problem = cases::drone(0.99);
    let found = TerminalIngredients::design(&problem, &options).unwrap();
    let told = told.into_inner().unwrap();
    let last = told.last().unwrap();
    assert!(problem.rows().source.contains(&last.row.unwrap()));
    assert_eq!(last.terminal_horizon_at_least, found.terminal_horizon());
    assert_eq!(last.rows_done, last.rows_total);
    for pair in told.windows(2) {
        assert!(pair[0].terminal_horizon_at_least <= pair[1].terminal_horizon_at_least);
        assert!(pair[0].rows_done <= pair[1].rows_done);
    }
    assert!(told.iter().all(|p| p.step >= 1 && p.step <= 300));
}
