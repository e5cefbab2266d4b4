//! The controller behind one door: `step(x, set_point) -> u`.

use super::prediction::{Condensed, condense};
use super::set_point::{SetPoint, weighted_square};
use crate::error::{DesignError, StepError};
use crate::matrix::Matrix;
use crate::optimization::{Failure, PreparedQp};
use crate::problem::{Formulation, Task};
use crate::terminal::TerminalIngredients;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::{Duration, Instant};

/// How the input of a step was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum StepStatus {
    /// The optimum, checked.
    Optimal,
    /// The shifted candidate (32): feasible and cheaper than the last step, used because the solver gave no answer.
    Candidate,
}

impl fmt::Display for StepStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Optimal => "optimal",
            Self::Candidate => "candidate",
        })
    }
}

/// One step of the controller; everything in physical coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// u, the input to apply, length m.
    pub input: Vec<f64>,
    /// x_s^a, length n.
    pub artificial_state: Vec<f64>,
    /// u_s^a, length m.
    pub artificial_input: Vec<f64>,
    /// The cost (10) of the prediction.
    pub cost: f64,
    /// The part of it that penalises the artificial set-point's distance from the set-point.
    pub offset_cost: f64,
    /// Whether the set-point is admissible. If not, the artificial set-point converges to the closest that is.
    pub admissible: bool,
    /// x_0, …, x_N.
    pub predicted_states: Vec<Vec<f64>>,
    /// u_0, …, u_{N−1}.
    pub predicted_inputs: Vec<Vec<f64>>,
    /// How the input was found.
    pub status: StepStatus,
    /// Iterations of the solver.
    pub iterations: usize,
    /// Time of the whole step.
    pub elapsed: Duration,
}

/// The quadratic program of one step, for other solvers: min ½ zᵀHz + fᵀz subject to G z ≤ b.
///
/// z = (c_0, …, c_{N−1}, θ), and the first input is u = K x + L θ + c_0 in shifted coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct CondensedQp {
    /// H, variables × variables.
    pub hessian: Matrix,
    /// f.
    pub linear: Vec<f64>,
    /// G, rows × variables.
    pub rows: Matrix,
    /// b.
    pub bounds: Vec<f64>,
}

/// A controller with its guarantees.
///
/// ```
/// use mpct::{Constraints, Controller, DesignOptions, Matrix, Plant, Problem, SetPoint, TerminalIngredients, Weights};
/// let plant = Plant::discrete(
///     Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
///     Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
/// )?;
/// let constraints = Constraints::new(2, 2)
///     .state_bounds(&[-3.0; 2], &[3.0; 2])?
///     .input_bounds(&[-2.0; 2], &[2.0; 2])?;
/// let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))?;
/// let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
/// let mut controller = Controller::new(ingredients)?;
/// let step = controller.step(&[0.0, 0.0], &SetPoint::state([2.0, 0.0]))?;
/// assert!(step.admissible);
/// assert!(step.input.iter().all(|u| u.abs() <= 2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Controller {
    ingredients: TerminalIngredients,
    condensed: Condensed,
    qp: PreparedQp,
    /// z of the last step, in use for the shifted candidate.
    last: Option<Vec<f64>>,
    /// The last set-point asked for, and whether it is admissible.
    known: Option<(SetPoint, bool)>,
}

impl fmt::Debug for Controller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Controller")
            .field("problem", &self.ingredients.problem().name())
            .field("formulation", &self.ingredients.problem().formulation())
            .field("terminal_horizon", &self.ingredients.terminal_horizon())
            .field("variables", &self.variables())
            .field("rows", &self.rows())
            .finish_non_exhaustive()
    }
}

/// A candidate may violate a row (right-hand sides are 1 at the operating point) by this and still be applied.
const CANDIDATE_TOLERANCE: f64 = 1e-9;

impl Controller {
    /// A controller for the formulation and task of the problem.
    ///
    /// # Errors
    /// [`DesignError::Solver`] when the explicit set or the program cannot be formed.
    pub fn new(ingredients: TerminalIngredients) -> Result<Self, DesignError> {
        let formulation = ingredients.problem().formulation();
        Self::with_formulation(ingredients, formulation)
    }

    /// A controller with another formulation than the problem names.
    ///
    /// # Errors
    /// As [`Controller::new`].
    pub fn with_formulation(
        ingredients: TerminalIngredients,
        formulation: Formulation,
    ) -> Result<Self, DesignError> {
        let condensed = condense(&ingredients, formulation)?;
        let qp = PreparedQp::new(
            "the tracking problem",
            condensed.hessian.clone(),
            condensed.rows.clone(),
        )?;
        Ok(Self {
            ingredients,
            condensed,
            qp,
            last: None,
            known: None,
        })
    }

    /// The terminal ingredients.
    pub fn ingredients(&self) -> &TerminalIngredients {
        &self.ingredients
    }

    /// Variables of the quadratic program.
    pub fn variables(&self) -> usize {
        self.condensed.hessian.nrows()
    }

    /// Rows of the quadratic program.
    pub fn rows(&self) -> usize {
        self.condensed.rows.nrows()
    }

    /// Forgets the last step; the next one has no candidate to fall back on.
    pub fn reset(&mut self) {
        self.last = None;
    }

    /// The input for a measured state and a set-point, both in physical coordinates.
    ///
    /// The set-point may be anything finite: when it is not admissible the controller goes to the closest equilibrium
    /// that is.
    ///
    /// # Errors
    /// [`StepError::WrongLength`], [`StepError::StateNotFinite`], [`StepError::SetPointNotFinite`];
    /// [`StepError::Infeasible`] with a checked proof; [`StepError::IterationLimit`] when the solver failed and the
    /// shifted candidate does not fit the measured state.
    pub fn step(&mut self, state: &[f64], set_point: &SetPoint) -> Result<Step, StepError> {
        let started = Instant::now();
        let (x, r) = self.shifted(state, set_point)?;
        let (f, b) = self.linear_and_bounds(&x, &r);
        let candidate = self.last.take().map(|z| self.shift(&z));
        let (z, status, iterations) = match self.qp.solve(&f, &b) {
            Ok(solution) => (solution.z, StepStatus::Optimal, solution.iterations),
            Err(Failure::Infeasible(proof)) => {
                return Err(StepError::Infeasible {
                    gap: proof.gap,
                    radius: proof.radius,
                });
            }
            Err(Failure::Unsolved {
                iterations,
                residual,
            }) => match candidate {
                Some(z) if self.violation(&z, &b) <= CANDIDATE_TOLERANCE => {
                    (z, StepStatus::Candidate, iterations)
                }
                _ => {
                    return Err(StepError::IterationLimit {
                        iterations,
                        residual,
                    });
                }
            },
        };
        let admissible = self.is_admissible(set_point);
        let mut step = self.describe(&x, &r, &z);
        step.status = status;
        step.iterations = iterations;
        step.admissible = admissible;
        self.last = Some(z);
        step.elapsed = started.elapsed();
        Ok(step)
    }

    /// The quadratic program that a step at this state and set-point solves.
    ///
    /// # Errors
    /// [`StepError::WrongLength`], [`StepError::StateNotFinite`], [`StepError::SetPointNotFinite`].
    pub fn qp(&self, state: &[f64], set_point: &SetPoint) -> Result<CondensedQp, StepError> {
        let (x, r) = self.shifted(state, set_point)?;
        let (linear, bounds) = self.linear_and_bounds(&x, &r);
        Ok(CondensedQp {
            hessian: crate::linalg::to_matrix(self.qp.hessian()),
            linear,
            rows: crate::linalg::to_matrix(self.qp.rows()),
            bounds,
        })
    }

    /// Checked and shifted state and set-point (state, input).
    fn shifted(
        &self,
        state: &[f64],
        set_point: &SetPoint,
    ) -> Result<(Vec<f64>, Vec<f64>), StepError> {
        let plant = self.ingredients.problem().plant();
        let (n, m) = (plant.states(), plant.inputs());
        let length = |what, v: &[f64], expected| {
            if v.len() == expected {
                Ok(())
            } else {
                Err(StepError::WrongLength {
                    what,
                    expected,
                    found: v.len(),
                })
            }
        };
        length("the state", state, n)?;
        length("the set-point's state", &set_point.state, n)?;
        if let Some(u) = &set_point.input {
            length("the set-point's input", u, m)?;
        }
        if let Some(index) = state.iter().position(|v| !v.is_finite()) {
            return Err(StepError::StateNotFinite {
                index,
                value: state[index],
            });
        }
        let at = plant.operating_point();
        let x = state.iter().zip(&at.state).map(|(x, o)| x - o).collect();
        let mut r: Vec<f64> = set_point
            .state
            .iter()
            .zip(&at.state)
            .map(|(x, o)| x - o)
            .collect();
        match &set_point.input {
            Some(u) => r.extend(u.iter().zip(&at.input).map(|(u, o)| u - o)),
            None => r.extend(std::iter::repeat_n(0.0, m)),
        }
        if let Some(index) = r.iter().position(|v| !v.is_finite()) {
            let value = if index < n {
                set_point.state[index]
            } else {
                set_point.input.as_ref().map_or(f64::NAN, |u| u[index - n])
            };
            return Err(StepError::SetPointNotFinite { index, value });
        }
        Ok((x, r))
    }

    fn linear_and_bounds(&self, x: &[f64], r: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut f = vec![0.0; self.variables()];
        accumulate(&mut f, &self.condensed.from_state, x, 1.0);
        accumulate(&mut f, &self.condensed.from_set_point, r, 1.0);
        let mut b = vec![1.0; self.rows()];
        accumulate(&mut b, &self.condensed.state_rows, x, -1.0);
        (f, b)
    }

    /// (c_1, …, c_{N−1}, 0, θ).
    fn shift(&self, z: &[f64]) -> Vec<f64> {
        let m = self.ingredients.problem().plant().inputs();
        let inputs = self.ingredients.problem().prediction_horizon() * m;
        let mut next = z.to_vec();
        next.copy_within(m..inputs, 0);
        next[inputs - m..inputs].fill(0.0);
        next
    }

    /// Largest violation of G z ≤ b.
    fn violation(&self, z: &[f64], b: &[f64]) -> f64 {
        let mut slack = b.to_vec();
        accumulate(&mut slack, &self.condensed.rows, z, -1.0);
        slack.iter().fold(
            0.0,
            |a, s| if s.is_nan() { f64::INFINITY } else { a.max(-s) },
        )
    }

    fn is_admissible(&mut self, set_point: &SetPoint) -> bool {
        if let Some((known, admissible)) = &self.known
            && known == set_point
        {
            return *admissible;
        }
        let problem = self.ingredients.problem();
        let admissible = match problem.task() {
            Task::Regulation => set_point.state == problem.plant().operating_point().state,
            Task::Tracking => self
                .ingredients
                .steady_states()
                .closest_admissible(problem, set_point)
                .is_ok_and(|closest| closest.admissible),
        };
        self.known = Some((set_point.clone(), admissible));
        admissible
    }

    /// Predictions and costs of z, from the plant itself.
    fn describe(&self, x: &[f64], r: &[f64], z: &[f64]) -> Step {
        let problem = self.ingredients.problem();
        let plant = problem.plant();
        let (n, m, horizon) = (plant.states(), plant.inputs(), problem.prediction_horizon());
        let steady = self.ingredients.steady_states();
        let (xs, us) = match problem.task() {
            Task::Tracking => {
                let theta = &z[horizon * m..];
                (
                    steady.state_basis().mul_vec(theta),
                    steady.input_basis().mul_vec(theta),
                )
            }
            Task::Regulation => (vec![0.0; n], vec![0.0; m]),
        };
        let minus =
            |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
        let (mut states, mut inputs) = (vec![x.to_vec()], Vec::with_capacity(horizon));
        let mut cost = 0.0;
        for j in 0..horizon {
            let e = minus(&states[j], &xs);
            let mut du = self.ingredients.gain().mul_vec(&e);
            for (d, c) in du.iter_mut().zip(&z[j * m..(j + 1) * m]) {
                *d += c;
            }
            cost += weighted_square(problem.state_weight(), &e)
                + weighted_square(problem.input_weight(), &du);
            let u: Vec<f64> = du.iter().zip(&us).map(|(d, u)| d + u).collect();
            let ax = plant.a().mul_vec(&states[j]);
            let bu = plant.b().mul_vec(&u);
            states.push(ax.iter().zip(&bu).map(|(a, b)| a + b).collect());
            inputs.push(u);
        }
        cost += weighted_square(
            self.ingredients.terminal_weight(),
            &minus(&states[horizon], &xs),
        );
        let offset_cost = match problem.task() {
            Task::Tracking => {
                weighted_square(problem.offset_weight(), &minus(&xs, &r[..n]))
                    + weighted_square(problem.offset_input_weight(), &minus(&us, &r[n..]))
            }
            Task::Regulation => 0.0,
        };
        let at = plant.operating_point();
        let physical =
            |v: Vec<f64>, o: &[f64]| -> Vec<f64> { v.iter().zip(o).map(|(v, o)| v + o).collect() };
        let inputs: Vec<Vec<f64>> = inputs.into_iter().map(|u| physical(u, &at.input)).collect();
        Step {
            input: inputs[0].clone(),
            artificial_state: physical(xs, &at.state),
            artificial_input: physical(us, &at.input),
            cost: cost + offset_cost,
            offset_cost,
            admissible: false,
            predicted_states: states.into_iter().map(|x| physical(x, &at.state)).collect(),
            predicted_inputs: inputs,
            status: StepStatus::Optimal,
            iterations: 0,
            elapsed: Duration::ZERO,
        }
    }
}

/// out += factor · M v.
fn accumulate(out: &mut [f64], m: &crate::linalg::Dense, v: &[f64], factor: f64) {
    for (j, &vj) in v.iter().enumerate() {
        if vj != 0.0 {
            for (o, &c) in out.iter_mut().zip(m.col(j).iter()) {
                *o += factor * vj * c;
            }
        }
    }
}
