//! How the end of the prediction is treated: terminal constraint, terminal cost.

use crate::error::DesignError;
use serde::{Deserialize, Serialize};

/// How the terminal constraint is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Formulation {
    /// The terminal law runs for M̃ more steps (30).
    #[default]
    Implicit,
    /// The irredundant rows of the maximal admissible set (9).
    Explicit,
    /// The terminal law runs for M̄ more steps, fewer than M̃, and the terminal cost is weighted by γ (35). Needs
    /// [`NoTerminalConstraint`]. The guarantees hold in
    /// [`StabilityRegion`](crate::analysis::StabilityRegion), not wherever the program is feasible.
    NoTerminalConstraint,
}

/// The terminal cost V_F(x_N, θ).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TerminalCost {
    /// ‖x_N − x_s^a‖²_P with P from (3): the exact cost-to-go of the terminal law.
    #[default]
    Exact,
    /// Remark 2: (1 − ε)⁻¹ times the cost of the first M̃ steps of the terminal law, with the smallest ε. See
    /// [`ImplicitTerminalCost`](crate::ImplicitTerminalCost).
    Implicit,
}

/// The choices of section 3.5: M̄, γ and α.
///
/// ```
/// use mpct::NoTerminalConstraint;
/// let choices = NoTerminalConstraint::new(2, 20.0)?.with_alpha(25.0)?;
/// assert_eq!(choices.horizon_extension(), 2);
/// assert!(NoTerminalConstraint::new(2, 0.5).is_err());
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoTerminalConstraint {
    horizon_extension: usize,
    gamma: f64,
    alpha: Option<f64>,
}

impl NoTerminalConstraint {
    /// M̄ ≥ 0 more steps of the terminal law, and the factor γ ≥ 1 of the terminal cost.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] for γ.
    pub fn new(horizon_extension: usize, gamma: f64) -> Result<Self, DesignError> {
        if gamma >= 1.0 && gamma.is_finite() {
            Ok(Self {
                horizon_extension,
                gamma,
                alpha: None,
            })
        } else {
            Err(DesignError::OutOfRange {
                what: "controller.gamma".into(),
                expected: "a finite number >= 1, the factor of the terminal cost in (35)".into(),
                found: gamma.to_string(),
            })
        }
    }

    /// States α > 0, the level of Ψα (34). Unless stated, the largest admissible one is taken.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`]. Whether it is too large is known once a set-point is.
    pub fn with_alpha(mut self, alpha: f64) -> Result<Self, DesignError> {
        if alpha > 0.0 && alpha.is_finite() {
            self.alpha = Some(alpha);
            Ok(self)
        } else {
            Err(DesignError::OutOfRange {
                what: "controller.alpha".into(),
                expected: "a finite number > 0, the level of the terminal cost in (34)".into(),
                found: alpha.to_string(),
            })
        }
    }

    /// M̄.
    pub fn horizon_extension(&self) -> usize {
        self.horizon_extension
    }

    /// γ.
    pub fn gamma(&self) -> f64 {
        self.gamma
    }

    /// α, when stated.
    pub fn alpha(&self) -> Option<f64> {
        self.alpha
    }
}
