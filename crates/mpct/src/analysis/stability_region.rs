//! The stability region Υ of the controller without terminal constraint (section 3.5).
//!
//! Υ = {x : V*(x) − V° ≤ (N + M̄) d + γ α}, with V* the optimal cost of (35) and V° the offset cost of the closest
//! admissible equilibrium. The paper prints V_O*(x), the offset part of the optimum *at x*, in the place of V°. That set is
//! larger: V_O*(x) ≥ V°. But V* − V_O* need not fall along the closed loop, because the optimum may trade offset cost for
//! stage cost; V* − V° falls at every step as V* does, so that Υ as defined here is invariant. [`Attraction::as_printed`]
//! gives the other number. For a state in Υ the stage and terminal costs of the optimum add up to at most
//! (N + M̄) d + γ α, so the terminal state lies in Ψα: otherwise every stage would cost more than d and the end more than
//! γ α (had an earlier state been in Ψα, going on by the terminal law would be cheaper).
//!
//! V* is convex, so Υ is; membership is one quadratic program. Its shape is asked in `region_shape.rs`.

use super::alpha::{AlphaBounds, AlphaScope};
use super::program::StateProgram;
use crate::control::{Controller, no_terminal_constraint};
use crate::error::{DesignError, StepError};
use crate::optimization::PreparedQp;
use crate::problem::Formulation;
use crate::{AdmissibleSetPoint, SetPoint};
use serde::Serialize;

/// Whether a state is in the stability region, and by how much.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Attraction {
    /// V*(x) − V°; infinite where the program is infeasible.
    pub cost: f64,
    /// (N + M̄) d + γ α. The state is inside when the cost is at most this.
    pub level: f64,
    /// V*(x) − V_O*(x), the paper's left-hand side.
    pub as_printed: f64,
}

impl Attraction {
    /// Whether the state is inside.
    pub fn is_inside(&self) -> bool {
        self.cost <= self.level
    }
}

/// Υ of a controller without terminal constraint, for one set-point.
///
/// ```
/// use mpct::{Controller, DesignOptions, NoTerminalConstraint, SetPoint, TerminalIngredients};
/// use mpct::analysis::{AlphaScope, StabilityRegion};
/// let problem = mpct::cases::academic().problem
///     .with_no_terminal_constraint(NoTerminalConstraint::new(2, 20.0)?);
/// let controller = Controller::new(TerminalIngredients::design(&problem, &DesignOptions::default())?)?;
/// let set_point = SetPoint::state([0.0, 0.0]);
/// let region = StabilityRegion::of(&controller, &set_point, AlphaScope::EveryEquilibrium)?;
/// assert!(region.contains(&[0.1, 0.0])?.is_inside());
/// # Ok::<(), mpct::DesignError>(())
/// ```
pub struct StabilityRegion<'a> {
    pub(super) controller: &'a Controller,
    pub(super) qp: PreparedQp,
    pub(super) set_point: SetPoint,
    pub(super) closest: AdmissibleSetPoint,
    scope: AlphaScope,
    alpha: f64,
    d: f64,
    pub(super) level: f64,
}

impl<'a> StabilityRegion<'a> {
    /// The region for the problem's α, or the largest of the scope where none is stated.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] for another formulation and for an α too large for the scope; those of
    /// [`AlphaBounds::of`].
    pub fn of(
        controller: &'a Controller,
        set_point: &SetPoint,
        scope: AlphaScope,
    ) -> Result<Self, DesignError> {
        if controller.formulation() != Formulation::NoTerminalConstraint {
            return Err(DesignError::OutOfRange {
                what: "the formulation".into(),
                expected: "\"no_terminal_constraint\"; the others attract their whole domain (DomainOfAttraction)".into(),
                found: format!("{:?}", controller.formulation()),
            });
        }
        let ingredients = controller.ingredients();
        let choices = no_terminal_constraint(ingredients)?;
        let bounds = AlphaBounds::of(ingredients, set_point)?;
        let alpha = match choices.alpha() {
            Some(alpha) => bounds.check(alpha, scope)?,
            None => bounds.check(bounds.largest(scope), scope)?,
        };
        let d = alpha * bounds.stage_cost_ratio;
        let steps = ingredients.problem().prediction_horizon() + choices.horizon_extension();
        let (h, ..) = controller.program_cost();
        let qp = PreparedQp::new(
            "membership in the stability region",
            h.clone(),
            controller.program_rows().1.clone(),
        )?;
        Ok(Self {
            controller,
            qp,
            set_point: set_point.clone(),
            closest: bounds.closest,
            scope,
            alpha,
            d,
            level: steps as f64 * d + choices.gamma() * alpha,
        })
    }

    /// α.
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// d = α λ_min(P⁻¹Q), the infimum of the stage cost outside Ψα.
    pub fn stage_cost_bound(&self) -> f64 {
        self.d
    }

    /// (N + M̄) d + γ α.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// For which artificial set-points α was checked.
    pub fn scope(&self) -> AlphaScope {
        self.scope
    }

    /// Whether a state (physical coordinates) is in the region.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`], [`DesignError::Solver`].
    pub fn contains(&self, state: &[f64]) -> Result<Attraction, DesignError> {
        let program = StateProgram::of(self.controller);
        let x = program.shifted("state", state)?;
        let outside = Attraction {
            cost: f64::INFINITY,
            level: self.level,
            as_printed: f64::INFINITY,
        };
        let rows = self.controller.ingredients().problem().rows();
        let breaks =
            |i: usize| rows.d.row(i).len() == 0 && rows.c.row_dot(i, &x) > 1.0 + super::MEMBERSHIP;
        if (0..rows.len()).any(breaks) {
            return Ok(outside);
        }
        match self.controller.evaluate(&self.qp, state, &self.set_point) {
            Ok(step) => Ok(Attraction {
                cost: step.cost - self.closest.offset_cost,
                as_printed: step.cost - step.offset_cost,
                level: self.level,
            }),
            Err(StepError::Infeasible { .. }) => Ok(outside),
            Err(error) => Err(DesignError::Solver {
                what: "membership in the stability region".into(),
                detail: error.to_string(),
            }),
        }
    }
}
