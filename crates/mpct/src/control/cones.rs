//! The ellipsoids of the tracking problem (30) as cones in the variables z = (c_0, …, c_{N−1}, θ), as `prediction.rs` has the rows.
//!
//! At prediction step j < N an ellipsoid reads ‖F x_j + G u_j + h‖ ≤ 1; after t steps of the terminal law, t before it is spent,
//! ‖(F + G K)(A + B K)ᵗ e_N + Wθ + h‖ ≤ 1, W = F M_θx + G M_θu; and θ ∈ λΘ reads ‖Wθ/λ + h‖ ≤ 1.

use super::conic::ProgramCone;
use super::prediction::RowOrigin;
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::problem::{Formulation, Task};
use crate::terminal::TerminalIngredients;

/// The cones, and where each comes from: the index in the origin is that of the ellipsoid.
pub(crate) fn condense_cones(
    ingredients: &TerminalIngredients,
    formulation: Formulation,
) -> Result<(Vec<ProgramCone>, Vec<RowOrigin>), DesignError> {
    let problem = ingredients.problem();
    if problem.norms().is_empty() {
        return Ok((Vec::new(), Vec::new()));
    }
    refuse_other_than_implicit(formulation)?;
    let plant = problem.plant();
    let (n, m, horizon) = (plant.states(), plant.inputs(), problem.prediction_horizon());
    let parameters = match problem.task() {
        Task::Tracking => m,
        Task::Regulation => 0,
    };
    let theta = horizon * m;
    let law = ingredients.law();
    let b = linalg::dense(plant.b());
    let (mx, mu) = (
        linalg::dense(ingredients.steady_states().state_basis()),
        linalg::dense(ingredients.steady_states().input_basis()),
    );
    let (mut cones, mut origin) = (Vec::new(), Vec::new());
    for (k, bound) in problem.norms().iter().enumerate() {
        let (f, g, q) = (
            linalg::dense(&bound.f),
            linalg::dense(&bound.g),
            bound.dimension(),
        );
        let w = &f * &mx + &g * &mu;
        let spent = ingredients.spent_norm_step(k);
        // (F + G K)(A + B K)ᵗ for t = 0, …, N + spent − 1.
        let mut powers = vec![&f + &g * &law.gain];
        for t in 1..horizon + spent {
            let next = &powers[t - 1] * &law.closed_loop;
            powers.push(next);
        }
        let steps = (0..horizon + spent).filter(|&s| s > 0 || bound.has_input());
        for step in steps {
            let (stage, power) = (step.min(horizon), step.saturating_sub(horizon));
            let mut map = Dense::zeros(q, theta + parameters);
            for i in 0..stage {
                put(&mut map, i * m, &(&powers[power + stage - 1 - i] * &b));
            }
            if step < horizon {
                put(&mut map, step * m, &g);
            }
            if parameters > 0 {
                put(&mut map, theta, &(&w - &powers[step] * &mx));
            }
            cones.push(ProgramCone {
                map,
                from_state: powers[step].clone(),
                offset: bound.offset.clone(),
            });
            origin.push(if step < horizon {
                RowOrigin::Stage { row: k, step }
            } else {
                RowOrigin::Terminal {
                    row: k,
                    step: power,
                }
            });
        }
        if parameters > 0 && linalg::max_abs(w.as_ref()) > 0.0 {
            let mut map = Dense::zeros(q, theta + parameters);
            put(
                &mut map,
                theta,
                &(&w * faer::Scale(1.0 / problem.scaling())),
            );
            cones.push(ProgramCone {
                map,
                from_state: Dense::zeros(q, n),
                offset: bound.offset.clone(),
            });
            origin.push(RowOrigin::Equilibrium { row: k });
        }
    }
    Ok((cones, origin))
}

/// With ellipsoids only the implicit formulation has its guarantees.
pub(super) fn refuse_other_than_implicit(formulation: Formulation) -> Result<(), DesignError> {
    let found = match formulation {
        Formulation::Implicit => return Ok(()),
        Formulation::Explicit => "\"explicit\": the terminal set is no polytope with ellipsoids",
        Formulation::NoTerminalConstraint => {
            "\"no_terminal_constraint\": its stability region is not derived for ellipsoids"
        }
    };
    Err(DesignError::OutOfRange {
        what: "controller.formulation".into(),
        expected: "\"implicit\" with ellipsoidal constraints".into(),
        found: found.into(),
    })
}

fn put(into: &mut Dense, column: usize, block: &Dense) {
    for j in 0..block.ncols() {
        for i in 0..block.nrows() {
            into[(i, column + j)] += block[(i, j)];
        }
    }
}
