//! What a step answers.

use crate::matrix::Matrix;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::Duration;

/// Why a step returns the candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum CandidateReason {
    /// The iterations of [`Controller::set_limits`](crate::Controller::set_limits) were used up.
    IterationLimit,
    /// The time of [`Controller::set_limits`](crate::Controller::set_limits) was used up.
    Deadline,
    /// No solver gave an answer that passes the check.
    SolverFailed,
}

impl fmt::Display for CandidateReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::IterationLimit => "iteration limit",
            Self::Deadline => "deadline",
            Self::SolverFailed => "solver failed",
        })
    }
}

impl From<mpct_runtime::Why> for CandidateReason {
    fn from(why: mpct_runtime::Why) -> Self {
        match why {
            mpct_runtime::Why::IterationLimit => Self::IterationLimit,
            mpct_runtime::Why::Deadline => Self::Deadline,
            mpct_runtime::Why::SolverFailed => Self::SolverFailed,
        }
    }
}

/// How the input of a step was found. Printed and stored as "optimal" or "candidate", without the reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StepStatus {
    /// The optimum, checked.
    Optimal,
    /// The shifted candidate (32), or a better point on the way from it to the optimum. Feasible and cheaper than the last step when
    /// [`Step::violation`] is rounding; otherwise the state has left the prediction.
    Candidate(CandidateReason),
}

impl fmt::Display for StepStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Optimal => "optimal",
            Self::Candidate(_) => "candidate",
        })
    }
}

impl Serialize for StepStatus {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// One step of the controller; everything in physical coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// u, the input to apply, length m. Always in U: drawn towards the operating point if a candidate that violates its rows would leave it.
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
    /// Largest violation of a row of the program by the prediction, where right-hand sides are 1 at the operating point:
    /// rounding for an optimum. A candidate that violates more tells that the state has left the prediction.
    pub violation: f64,
    /// Iterations of the solver.
    pub iterations: usize,
    /// Time of the whole step.
    pub elapsed: Duration,
}

/// The quadratic program of one step, for other solvers: min ½ zᵀHz + fᵀz subject to G z ≤ b, and to ‖T z + t‖ ≤ 1 for each
/// cone.
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
    /// The second-order cones; none without ellipsoids.
    pub cones: Vec<CondensedCone>,
}

/// ‖T z + t‖ ≤ 1 in a [`CondensedQp`].
#[derive(Clone, Debug, PartialEq)]
pub struct CondensedCone {
    /// T, q × variables.
    pub map: Matrix,
    /// t, length q.
    pub offset: Vec<f64>,
}
