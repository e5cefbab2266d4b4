//! α and d of section 3.5: how large the level set Ψα (34) of the terminal cost may be.
//!
//! Ψα = {(x, θ): ‖x − M_θx θ‖²_P ≤ α} is invariant under the terminal law for every α, because P solves (3). What has to
//! be checked is that it lies in the constraints. At an equilibrium θ, row i of X_aug,t holds on all of Ψα iff
//!   √α a_i ≤ 1 − w_iθ,   a_i = ‖(C + D K)_i‖_{P⁻¹},   w_i = (C M_θx + D M_θu)_i,
//! so that α depends on the equilibria θ that the artificial set-point may take:
//!
//! - *every equilibrium* of λΘ: w_iθ ≤ max over λΘ. Safe for any set-point, the default;
//! - *around the set-point* alone: θ = θ_s. It proves a step only while the artificial set-point stands at the
//!   set-point;
//! - *throughout the region*: in Υ the offset cost exceeds its least value V° by at most L = (N + M̄) d + γ α, and
//!   V_O(θ) ≥ V° + ‖θ − θ_s‖²_H with H = M_θxᵀ O M_θx + M_θuᵀ O_u M_θu (θ_s minimises V_O over a convex set), so that
//!   w_iθ ≤ w_iθ_s + √L ‖w_i‖_{H⁻¹}. With d = κ α this is again linear in √α:
//!   √α (a_i + √((N + M̄) κ + γ) ‖w_i‖_{H⁻¹}) ≤ 1 − w_iθ_s. Row by row the better of this and the first bound is taken.
//!   For Figure 2 of the paper this allows α ≤ 83.05: its α = 25, too large for every equilibrium, is safe in Υ.
//!
//! d is the infimum of the stage cost outside Ψα with the input free: d = κ α, κ = λ_min(P⁻¹Q).

use super::program::failure;
use crate::control::{OffsetCost, no_terminal_constraint};
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::optimization::Body;
use crate::problem::{RowSource, Task};
use crate::terminal::TerminalIngredients;
use crate::{AdmissibleSetPoint, SetPoint};
use serde::{Deserialize, Serialize};
use std::fmt;

/// An α counts as admissible up to this relative excess: rounding of a bound that was printed and typed in again.
const TYPED: f64 = 1e-9;

/// For which artificial set-points Ψα has to lie in the constraints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlphaScope {
    /// Every admissible equilibrium, θ ∈ λΘ.
    #[default]
    EveryEquilibrium,
    /// Every equilibrium that the artificial set-point can take in the stability region of this set-point.
    ThroughoutRegion,
    /// The set-point itself (the closest admissible one). The guarantee then holds only while the artificial
    /// set-point stands there.
    AroundSetPoint,
}

impl fmt::Display for AlphaScope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::EveryEquilibrium => "every admissible equilibrium",
            Self::ThroughoutRegion => "every artificial set-point in the stability region",
            Self::AroundSetPoint => "the set-point alone",
        })
    }
}

/// The largest α for each scope, and the row that limits it.
///
/// ```
/// use mpct::{DesignOptions, NoTerminalConstraint, SetPoint, TerminalIngredients};
/// use mpct::analysis::{AlphaBounds, AlphaScope};
/// let problem = mpct::cases::academic().problem
///     .with_no_terminal_constraint(NoTerminalConstraint::new(2, 20.0)?);
/// let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
/// let bounds = AlphaBounds::of(&ingredients, &SetPoint::state([-0.5688, -0.0523]))?;
/// let every = bounds.largest(AlphaScope::EveryEquilibrium);
/// assert!((every - 1.845).abs() < 1e-3);
/// // The paper's α = 25 is not admissible at every equilibrium, but at all that the stability region allows.
/// assert!(every < 25.0 && bounds.largest(AlphaScope::ThroughoutRegion) > 25.0);
/// // d for that α.
/// assert!((25.0 * bounds.stage_cost_ratio - 2.2253).abs() < 1e-4);
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct AlphaBounds {
    every: (f64, RowSource),
    throughout: (f64, RowSource),
    around: (f64, RowSource),
    /// κ = λ_min(P⁻¹Q), in (0, 1]: d = κ α.
    pub stage_cost_ratio: f64,
    /// The closest admissible set-point, around which the two other scopes are taken.
    pub closest: AdmissibleSetPoint,
}

impl AlphaBounds {
    /// The bounds for ingredients whose problem has the choices of section 3.5, and a set-point (physical coordinates).
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] without those choices or with M̄ ≥ M̃; errors of
    /// [`SteadyStates::closest_admissible`](crate::SteadyStates::closest_admissible); [`DesignError::Solver`].
    pub fn of(
        ingredients: &TerminalIngredients,
        set_point: &SetPoint,
    ) -> Result<Self, DesignError> {
        let choices = no_terminal_constraint(ingredients)?;
        let problem = ingredients.problem();
        let (n, m) = (problem.plant().states(), problem.plant().inputs());
        let law = ingredients.law();
        let ratio = stage_cost_ratio(ingredients)?;
        let rows = problem.rows();
        let p = rows.len();
        let g = linalg::dense(&rows.c) + linalg::dense(&rows.d) * &law.gain;
        let a = dual_norms("P", &law.weight, &g)?;
        let steps = (problem.prediction_horizon() + choices.horizon_extension()) as f64;
        let level_ratio = (steps * ratio + choices.gamma()).sqrt();
        let (mut largest, mut at, mut b) = (vec![0.0; p], vec![0.0; p], vec![0.0; p]);
        let steady = ingredients.steady_states();
        let closest = match problem.task() {
            Task::Tracking => steady.closest_admissible(problem, set_point)?,
            Task::Regulation => {
                let home = problem.plant().operating_point();
                AdmissibleSetPoint {
                    state: home.state.clone(),
                    input: home.input.clone(),
                    parameter: vec![0.0; m],
                    offset_cost: 0.0,
                    admissible: set_point.state == home.state,
                    limiting: Vec::new(),
                }
            }
        };
        if problem.task() == Task::Tracking {
            let w = linalg::dense(&ingredients.equilibrium_rows());
            largest = supports_of_equilibria(&w, problem.scaling())?;
            for i in 0..p {
                at[i] = (0..m).map(|t| w[(i, t)] * closest.parameter[t]).sum();
            }
            let hessian = OffsetCost::of(problem, steady)?.hessian * faer::Scale(0.5);
            // Without full column rank of M_θx the offset cost says nothing about some directions of θ.
            b = dual_norms("the offset cost", &hessian, &w).unwrap_or(vec![f64::INFINITY; p]);
        }
        debug_assert_eq!(g.ncols(), n);
        let smallest = |bound: &dyn Fn(usize) -> f64| {
            (0..p)
                .map(|i| (bound(i).max(0.0).powi(2), rows.source[i]))
                .min_by(|x, y| x.0.total_cmp(&y.0))
                .unwrap_or((f64::INFINITY, RowSource::StateUpper(0)))
        };
        let every = |i: usize| (1.0 - largest[i]) / a[i];
        Ok(Self {
            every: smallest(&every),
            throughout: smallest(&|i| every(i).max((1.0 - at[i]) / (a[i] + level_ratio * b[i]))),
            around: smallest(&|i| (1.0 - at[i]) / a[i]),
            stage_cost_ratio: ratio,
            closest,
        })
    }

    /// The largest α for a scope.
    pub fn largest(&self, scope: AlphaScope) -> f64 {
        self.bound(scope).0
    }

    /// The row that limits it.
    pub fn limiting(&self, scope: AlphaScope) -> RowSource {
        self.bound(scope).1
    }

    fn bound(&self, scope: AlphaScope) -> (f64, RowSource) {
        match scope {
            AlphaScope::EveryEquilibrium => self.every,
            AlphaScope::ThroughoutRegion => self.throughout,
            AlphaScope::AroundSetPoint => self.around,
        }
    }

    /// α when it is admissible for the scope.
    pub(super) fn check(&self, alpha: f64, scope: AlphaScope) -> Result<f64, DesignError> {
        let (largest, row) = self.bound(scope);
        if alpha > 0.0 && alpha <= largest * (1.0 + TYPED) {
            return Ok(alpha);
        }
        Err(DesignError::OutOfRange {
            what: "controller.alpha".into(),
            expected: format!(
                "a number in (0, {largest:.6}]: for {scope}, {row} cuts larger level sets (largest for every admissible equilibrium {:.6}, throughout the stability region {:.6}, around the set-point {:.6})",
                self.every.0, self.throughout.0, self.around.0
            ),
            found: alpha.to_string(),
        })
    }
}

/// κ = λ_min(P⁻¹Q): the stage cost outside Ψα is at least κ α.
fn stage_cost_ratio(ingredients: &TerminalIngredients) -> Result<f64, DesignError> {
    let l = linalg::cholesky("P", &ingredients.law().weight)?;
    let q = linalg::dense(ingredients.problem().state_weight());
    // L⁻¹ Q L⁻ᵀ.
    let mut half = q;
    l.as_ref().solve_lower_triangular_in_place(half.as_mut());
    let mut whole = half.transpose().to_owned();
    l.as_ref().solve_lower_triangular_in_place(whole.as_mut());
    let (values, _) = linalg::symmetric_eigen("P^-1 Q", &linalg::symmetrised(&whole))?;
    Ok(values.first().copied().unwrap_or(0.0))
}

/// ‖row_i‖_{W⁻¹} for every row of g.
fn dual_norms(what: &str, weight: &Dense, g: &Dense) -> Result<Vec<f64>, DesignError> {
    let l = linalg::cholesky(what, weight)?;
    let mut t = g.transpose().to_owned();
    l.as_ref().solve_lower_triangular_in_place(t.as_mut());
    Ok((0..g.nrows()).map(|i| t.col(i).norm_l2()).collect())
}

/// max w_iθ over λΘ for every row, from above.
fn supports_of_equilibria(w: &Dense, scaling: f64) -> Result<Vec<f64>, DesignError> {
    let m = w.ncols();
    let body = Body {
        rows: w * faer::Scale(1.0 / scaling),
        bounds: vec![1.0; w.nrows()],
        balls: Vec::new(),
    };
    (0..w.nrows())
        .map(|i| {
            let c: Vec<f64> = (0..m).map(|t| w[(i, t)]).collect();
            if c.iter().all(|v| *v == 0.0) {
                return Ok(0.0);
            }
            let what = "the largest admissible equilibrium";
            body.support(&c, &vec![0.0; m])
                .map(|v| v.upper.min(scaling))
                .map_err(|e| failure(what, "an equilibrium", e))
        })
        .collect()
}
