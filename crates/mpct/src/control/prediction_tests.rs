//! The condensed program against predictions made step by step from the plant.

use super::prediction::{Condensed, RowOrigin, condense};
use crate::linalg;
use crate::{
    Constraints, DesignOptions, Formulation, Matrix, Plant, Problem, TerminalIngredients, Weights,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Three states, two inputs, asymmetric bounds, a mixed row, full weights, and a gain that is not the LQR gain.
fn problem(own_gain: bool) -> Problem {
    let a = Matrix::from_rows(&[[1.0, 0.2, 0.0], [0.0, 0.9, 0.3], [0.1, 0.0, 0.7]]);
    let b = Matrix::from_rows(&[[0.0, 0.1], [0.4, 0.0], [0.2, 0.5]]);
    let constraints = Constraints::new(3, 2)
        .state_bounds(&[-3.0, -1.0, -2.0], &[2.0, 1.5, 2.5])
        .unwrap()
        .input_bounds(&[-1.0, -0.5], &[0.8, 1.0])
        .unwrap()
        .mixed(
            Matrix::from_rows(&[[0.5, -0.2, 0.1]]),
            Matrix::from_rows(&[[0.3, 0.7]]),
            vec![1.1],
        )
        .unwrap();
    let q = Matrix::from_rows(&[[2.0, 0.3, 0.0], [0.3, 1.0, 0.1], [0.0, 0.1, 1.5]]);
    let weights = Weights::new(q, vec![0.5, 2.0], 50.0).with_offset_input(3.0);
    let problem = Problem::new(Plant::discrete(a, b).unwrap(), constraints, weights)
        .unwrap()
        .with_prediction_horizon(4)
        .unwrap();
    if own_gain {
        problem
            .with_gain(Matrix::from_rows(&[[-0.4, -0.6, -0.2], [-0.1, 0.1, -0.5]]))
            .unwrap()
    } else {
        problem
    }
}

struct Prediction {
    cost: f64,
    /// x_0, …, x_{N+T}.
    states: Vec<Vec<f64>>,
    inputs: Vec<Vec<f64>>,
    theta: Vec<f64>,
}

/// Cost (10) and the trajectory of z, by simulation only.
fn predict(
    design: &TerminalIngredients,
    x: &[f64],
    r: &[f64],
    z: &[f64],
    extra: usize,
) -> Prediction {
    let problem = design.problem();
    let (n, m, horizon) = (3, 2, problem.prediction_horizon());
    let theta = z[horizon * m..].to_vec();
    let xs = design.steady_states().state_basis().mul_vec(&theta);
    let us = design.steady_states().input_basis().mul_vec(&theta);
    let minus =
        |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
    let square = |w: &crate::SparseMatrix, v: &[f64]| -> f64 {
        w.mul_vec(v).iter().zip(v).map(|(a, b)| a * b).sum()
    };
    let (mut states, mut inputs, mut cost) = (vec![x.to_vec()], Vec::new(), 0.0);
    for j in 0..horizon + extra + 1 {
        let e = minus(&states[j], &xs);
        let mut u = design.gain().mul_vec(&e);
        for i in 0..m {
            u[i] += us[i] + if j < horizon { z[j * m + i] } else { 0.0 };
        }
        if j < horizon {
            cost += square(problem.state_weight(), &e)
                + square(problem.input_weight(), &minus(&u, &us));
        }
        if j == horizon {
            cost += square(design.terminal_weight(), &e);
        }
        let ax = problem.plant().a().mul_vec(&states[j]);
        let bu = problem.plant().b().mul_vec(&u);
        states.push((0..n).map(|i| ax[i] + bu[i]).collect());
        inputs.push(u);
    }
    cost += square(problem.offset_weight(), &minus(&xs, &r[..n]))
        + square(problem.offset_input_weight(), &minus(&us, &r[n..]));
    Prediction {
        cost,
        states,
        inputs,
        theta,
    }
}

fn objective(program: &Condensed, x: &[f64], r: &[f64], z: &[f64]) -> f64 {
    let nz = z.len();
    let mut value = 0.0;
    for i in 0..nz {
        let hz: f64 = (0..nz).map(|j| program.hessian[(i, j)] * z[j]).sum();
        let fx: f64 = (0..x.len())
            .map(|j| program.from_state[(i, j)] * x[j])
            .sum();
        let fr: f64 = (0..r.len())
            .map(|j| program.from_set_point[(i, j)] * r[j])
            .sum();
        value += z[i] * (0.5 * hz + fx + fr);
    }
    value
}

#[test]
fn cost_and_rows_are_those_of_the_predicted_trajectory() {
    for (own_gain, formulation) in [
        (false, Formulation::Implicit),
        (true, Formulation::Implicit),
        (true, Formulation::Explicit),
    ] {
        let problem = problem(own_gain);
        let design = TerminalIngredients::design(&problem, &DesignOptions::default()).unwrap();
        let program = condense(&design, formulation).unwrap();
        let nz = program.hessian.nrows();
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut vector =
            |k: usize| -> Vec<f64> { (0..k).map(|_| 2.0 * random.random::<f64>() - 1.0).collect() };
        for _ in 0..20 {
            let (x, r, z, z0) = (vector(3), vector(5), vector(nz), vector(nz));
            let last = design.terminal_horizon();
            let (here, there) = (
                predict(&design, &x, &r, &z, last),
                predict(&design, &x, &r, &z0, last),
            );
            // The program leaves out what does not depend on z: differences must agree.
            let expected = here.cost - there.cost;
            let found = objective(&program, &x, &r, &z) - objective(&program, &x, &r, &z0);
            assert!(
                (found - expected).abs() <= 1e-9 * here.cost.abs().max(there.cost.abs()),
                "{found} {expected}"
            );
            for (k, &from) in program.origin.iter().enumerate() {
                let left: f64 = (0..nz).map(|j| program.rows[(k, j)] * z[j]).sum::<f64>()
                    + (0..3)
                        .map(|j| program.state_rows[(k, j)] * x[j])
                        .sum::<f64>();
                let rows = problem.rows();
                let at = |row: usize, j: usize| {
                    rows.c.row_dot(row, &here.states[j]) + rows.d.row_dot(row, &here.inputs[j])
                };
                let expected = match from {
                    RowOrigin::Stage { row, step } => at(row, step),
                    RowOrigin::Terminal { row, step } => {
                        at(row, problem.prediction_horizon() + step)
                    }
                    RowOrigin::Equilibrium { row } => {
                        let xs = design.steady_states().state_basis().mul_vec(&here.theta);
                        let us = design.steady_states().input_basis().mul_vec(&here.theta);
                        (rows.c.row_dot(row, &xs) + rows.d.row_dot(row, &us)) / problem.scaling()
                    }
                };
                assert!(
                    (left - expected).abs() < 1e-9,
                    "{from:?}: {left} {expected}"
                );
            }
        }
        // Every constraint is there: stage rows but for states at step 0, all unspent rows, and λΘ.
        let p = problem.rows().len();
        let stage = (0..p)
            .map(|i| {
                if problem.rows().d.row(i).len() > 0 {
                    4
                } else {
                    3
                }
            })
            .sum::<usize>();
        let spent: usize = design.spent_steps().iter().map(|s| s.1).sum();
        if formulation == Formulation::Implicit {
            assert_eq!(program.origin.len(), stage + spent + p);
        }
        assert!(linalg::cholesky("H", &program.hessian).is_ok());
    }
}

/// Symmetric bounds: all rows in pairs. The problem above: its bounds are symmetric nowhere.
#[test]
fn opposite_rows_stand_together() {
    let opposite = |program: &Condensed, k: usize| {
        let (g, w) = (&program.rows, &program.state_rows);
        (0..g.ncols()).all(|j| g[(2 * k, j)] == -g[(2 * k + 1, j)])
            && (0..w.ncols()).all(|j| w[(2 * k, j)] == -w[(2 * k + 1, j)])
    };
    for file in [crate::cases::academic(), crate::cases::drone()] {
        let design = TerminalIngredients::design(&file.problem, &DesignOptions::default()).unwrap();
        let program = condense(&design, Formulation::Implicit).unwrap();
        let rows = program.rows.nrows();
        assert_eq!(rows % 2, 0);
        assert!((0..rows / 2).all(|k| opposite(&program, k)));
    }
    let design = TerminalIngredients::design(&problem(false), &DesignOptions::default()).unwrap();
    let program = condense(&design, Formulation::Implicit).unwrap();
    assert!((0..program.rows.nrows() / 2).all(|k| !opposite(&program, k)));
}
