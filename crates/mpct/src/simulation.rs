//! Closed loops: a controller, its plant, a schedule of set-points, and a bounded disturbance if wanted.

use crate::control::{Controller, SetPoint, StepStatus, weighted_square};
use crate::error::{DesignError, StepError};
use crate::problem::plant::check_vector;
use crate::problem::{RowSource, Task};
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::ops::ControlFlow;
use thiserror::Error;

/// A set-point that holds from a step on.
#[derive(Clone, Debug, PartialEq)]
pub struct ScheduledSetPoint {
    /// First step, 0-based.
    pub from_step: usize,
    /// The set-point, in physical coordinates.
    pub set_point: SetPoint,
}

/// A disturbance w added to the state: x⁺ = A x + B u + w, each |w_i| ≤ bound_i, drawn uniformly.
#[derive(Clone, Debug, PartialEq)]
pub struct Disturbance {
    /// Length n, each ≥ 0.
    pub bound: Vec<f64>,
    /// The same seed gives the same disturbance.
    pub seed: u64,
}

/// What to simulate.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// x at step 0, in physical coordinates.
    pub initial_state: Vec<f64>,
    /// Number of steps ≥ 1.
    pub steps: usize,
    /// Set-points by ascending first step. Before the first, and without any, the operating point is the set-point.
    pub set_points: Vec<ScheduledSetPoint>,
    /// A disturbance; none by default.
    pub disturbance: Option<Disturbance>,
}

/// Why a simulation did not reach its end.
#[derive(Clone, Debug, Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// The simulation is stated wrongly.
    #[error(transparent)]
    Setting(#[from] DesignError),
    /// The initial state violates a constraint, and is thereby outside the domain of attraction.
    #[error(
        "the initial state is outside the domain of attraction: it violates {row} by {violation:.6e}"
    )]
    InitialState {
        /// The row.
        row: RowSource,
        /// By how much, in the units of the row.
        violation: f64,
    },
    /// A step of the controller failed.
    #[error("step {step}: {error}")]
    Step {
        /// The step.
        step: usize,
        /// Its error.
        error: StepError,
        /// What was done before.
        run: Box<Run>,
    },
    /// [`simulate_until`] was told to end.
    #[error("the simulation was interrupted after {} steps", run.steps.len())]
    Interrupted {
        /// What was done before.
        run: Box<Run>,
    },
}

/// One step of a closed loop, in physical coordinates.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunStep {
    /// The step.
    pub k: usize,
    /// The state before u acts.
    pub x: Vec<f64>,
    /// The input.
    pub u: Vec<f64>,
    /// x_s^a.
    pub artificial_state: Vec<f64>,
    /// u_s^a.
    pub artificial_input: Vec<f64>,
    /// State of the set-point.
    pub setpoint: Vec<f64>,
    /// The cost (10) of the prediction.
    pub cost: f64,
    /// Its offset part.
    pub offset_cost: f64,
    /// Whether the set-point is admissible.
    pub admissible: bool,
    /// How the input was found.
    pub status: StepStatus,
    /// Iterations of the solver.
    pub iterations: usize,
    /// Time of the step in seconds.
    pub solve_seconds: f64,
}

/// Figures of a closed loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Vcc of section 4.1: Σ_k ‖x_k − x_s,k^a‖²_Q + ‖u_k − u_s,k^a‖²_R + ‖x_s,k^a − x_s^r‖²_O.
    pub cumulative_cost: f64,
    /// Mean time of a step.
    pub mean_solve_seconds: f64,
    /// Largest time of a step.
    pub max_solve_seconds: f64,
    /// The state after the last input.
    pub final_state: Vec<f64>,
    /// The last artificial state.
    pub final_artificial_state: Vec<f64>,
    /// The largest violation of a constraint at any step, in the units of its row, of an ellipsoid as ‖F x + G u + h‖ − 1; 0 when
    /// there is none.
    pub worst_violation: f64,
}

/// A closed loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Run {
    /// Step by step.
    pub steps: Vec<RunStep>,
    /// Its figures.
    pub summary: Summary,
}

impl Simulation {
    pub(crate) fn check(&self, n: usize, m: usize) -> Result<(), DesignError> {
        check_vector("simulation.initial_state", &self.initial_state, n)?;
        let range = |what: String, expected: &str, found: String| DesignError::OutOfRange {
            what,
            expected: expected.into(),
            found,
        };
        if self.steps == 0 {
            return Err(range(
                "simulation.steps".into(),
                "a whole number >= 1",
                "0".into(),
            ));
        }
        for (i, s) in self.set_points.iter().enumerate() {
            check_vector(
                &format!("simulation.setpoint[{i}].state"),
                &s.set_point.state,
                n,
            )?;
            if let Some(u) = &s.set_point.input {
                check_vector(&format!("simulation.setpoint[{i}].input"), u, m)?;
            }
            if i > 0 && s.from_step <= self.set_points[i - 1].from_step {
                return Err(range(
                    format!("simulation.setpoint[{i}].from_step"),
                    "a step after the one before",
                    format!("{} after {}", s.from_step, self.set_points[i - 1].from_step),
                ));
            }
        }
        if let Some(d) = &self.disturbance {
            check_vector("simulation.disturbance.bound", &d.bound, n)?;
            if let Some(i) = d.bound.iter().position(|&b| !(b >= 0.0)) {
                return Err(range(
                    format!("simulation.disturbance.bound[{i}]"),
                    "a number >= 0",
                    d.bound[i].to_string(),
                ));
            }
        }
        Ok(())
    }
}

/// A state may leave a constraint by this, in units in which the row has the right-hand side 1, and count as inside:
/// rounding of the step before.
const INSIDE: f64 = 1e-8;

/// Runs a closed loop with the model as plant. `progress` is told the number of steps done.
///
/// # Errors
/// [`SimulationError::Setting`], [`SimulationError::InitialState`], [`SimulationError::Step`] with what was done.
pub fn simulate(
    controller: &mut Controller,
    simulation: &Simulation,
    progress: Option<&dyn Fn(usize)>,
) -> Result<Run, SimulationError> {
    simulate_until(controller, simulation, &|done| {
        if let Some(progress) = progress {
            progress(done);
        }
        ControlFlow::Continue(())
    })
}

/// As [`simulate`], with a `progress` that may end the run.
///
/// # Errors
/// Those of [`simulate`], and [`SimulationError::Interrupted`] with what was done after a `Break` before the last step.
pub fn simulate_until(
    controller: &mut Controller,
    simulation: &Simulation,
    progress: &dyn Fn(usize) -> ControlFlow<()>,
) -> Result<Run, SimulationError> {
    let problem = controller.ingredients().problem().clone();
    let plant = problem.plant();
    let (n, m) = (plant.states(), plant.inputs());
    simulation.check(n, m)?;
    controller.reset();
    let at = plant.operating_point().clone();
    let home = ScheduledSetPoint {
        from_step: 0,
        set_point: SetPoint::state(at.state.clone()),
    };
    let mut random = simulation
        .disturbance
        .as_ref()
        .map(|d| (ChaCha8Rng::seed_from_u64(d.seed), d.bound.clone()));
    let minus =
        |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
    let rows = problem.rows();
    // Rows of the state alone must hold from the start: no input can mend them.
    let start = minus(&simulation.initial_state, &at.state);
    let outside = (0..rows.len())
        .filter(|&i| rows.d.row(i).len() == 0)
        .map(|i| (i, rows.c.row_dot(i, &start) - 1.0))
        .filter(|r| r.1 > INSIDE)
        .max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((i, by)) = outside {
        return Err(SimulationError::InitialState {
            row: rows.source[i],
            violation: by * rows.scale[i],
        });
    }
    let no_input = vec![0.0; m];
    for bound in problem.norms().iter().filter(|b| !b.has_input()) {
        let by = bound.value(&start, &no_input) - 1.0;
        if by > INSIDE {
            return Err(SimulationError::InitialState {
                row: bound.source,
                violation: by,
            });
        }
    }
    let mut x = simulation.initial_state.clone();
    let mut run = Run {
        steps: Vec::with_capacity(simulation.steps.min(1 << 20)),
        summary: Summary {
            cumulative_cost: 0.0,
            mean_solve_seconds: 0.0,
            max_solve_seconds: 0.0,
            final_state: x.clone(),
            final_artificial_state: Vec::new(),
            worst_violation: 0.0,
        },
    };
    for k in 0..simulation.steps {
        let scheduled = simulation
            .set_points
            .iter()
            .rev()
            .find(|s| s.from_step <= k)
            .unwrap_or(&home);
        let set_point = match problem.task() {
            Task::Tracking => &scheduled.set_point,
            Task::Regulation => &home.set_point,
        };
        let step = match controller.step(&x, set_point) {
            Ok(step) => step,
            Err(error) => {
                return Err(SimulationError::Step {
                    step: k,
                    error,
                    run: Box::new(run),
                });
            }
        };
        let (shifted_x, shifted_u) = (minus(&x, &at.state), minus(&step.input, &at.input));
        let summary = &mut run.summary;
        summary.cumulative_cost +=
            weighted_square(problem.state_weight(), &minus(&x, &step.artificial_state))
                + weighted_square(
                    problem.input_weight(),
                    &minus(&step.input, &step.artificial_input),
                )
                + weighted_square(
                    problem.offset_weight(),
                    &minus(&step.artificial_state, &set_point.state),
                );
        let seconds = step.elapsed.as_secs_f64();
        summary.max_solve_seconds = summary.max_solve_seconds.max(seconds);
        summary.mean_solve_seconds += (seconds - summary.mean_solve_seconds) / (k + 1) as f64;
        if let Some((_, by)) = rows.worst_violation(&shifted_x, &shifted_u) {
            summary.worst_violation = summary.worst_violation.max(by);
        }
        for bound in problem.norms() {
            let by = bound.value(&shifted_x, &shifted_u) - 1.0;
            summary.worst_violation = summary.worst_violation.max(by);
        }
        summary
            .final_artificial_state
            .clone_from(&step.artificial_state);
        let (ax, bu) = (plant.a().mul_vec(&shifted_x), plant.b().mul_vec(&shifted_u));
        let next: Vec<f64> = (0..n)
            .map(|i| {
                let w = match &mut random {
                    Some((rng, bound)) => bound[i] * (2.0 * rng.random::<f64>() - 1.0),
                    None => 0.0,
                };
                at.state[i] + ax[i] + bu[i] + w
            })
            .collect();
        summary.final_state.clone_from(&next);
        run.steps.push(RunStep {
            k,
            x: std::mem::replace(&mut x, next),
            u: step.input,
            artificial_state: step.artificial_state,
            artificial_input: step.artificial_input,
            setpoint: set_point.state.clone(),
            cost: step.cost,
            offset_cost: step.offset_cost,
            admissible: step.admissible,
            status: step.status,
            iterations: step.iterations,
            solve_seconds: seconds,
        });
        if progress(k + 1).is_break() && k + 1 < simulation.steps {
            return Err(SimulationError::Interrupted { run: Box::new(run) });
        }
    }
    Ok(run)
}
