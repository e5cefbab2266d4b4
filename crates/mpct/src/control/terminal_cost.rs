//! Terminal costs other than ‖x_N − x_s^a‖²_P: the implicit one of Remark 2, and γ V_F of section 3.5.
//!
//! **Remark 2.** With e = x − x_s^a, F = A + B K and Q_K = Q + KᵀR K, the implicit terminal cost is
//!   V(e) = (1 − ε)⁻¹ Σ_{j<M̃} ‖Fʲe‖²_{Q_K} = ‖e‖²_{P_ε},   P_ε = (1 − ε)⁻¹ (P − (F^M̃)ᵀ P F^M̃).
//! Theorem 4 needs that it falls along the terminal law by at least the stage cost, V(F e) ≤ V(e) − ‖e‖²_{Q_K}:
//!   V(e) − V(F e) = (1 − ε)⁻¹ (‖e‖²_{Q_K} − ‖F^M̃ e‖²_{Q_K}) ≥ ‖e‖²_{Q_K}  for all e
//!   ⟺  (F^M̃)ᵀ Q_K F^M̃ ≼ ε Q_K.
//! Summing that inequality along the law gives V(e) ≥ Σ_{j≥0} ‖Fʲe‖²_{Q_K} = ‖e‖²_P: an upper bound of the cost-to-go.
//! The smallest ε is the largest generalised eigenvalue of the pair, ‖L⁻¹(F^M̃)ᵀL‖² with Q_K = L Lᵀ; it must be < 1.
//!
//! In the condensed program both costs are ‖e_N‖²_P plus a non-negative quadratic form of a later e; only that form is
//! added.

use super::cones::refuse_other_than_implicit;
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::matrix::SparseMatrix;
use crate::problem::{Formulation, NoTerminalConstraint, TerminalCost};
use crate::terminal::TerminalIngredients;
use faer::Scale;

/// The implicit terminal cost of Remark 2.
///
/// ```
/// use mpct::{DesignOptions, ImplicitTerminalCost, TerminalIngredients};
/// let problem = mpct::cases::academic().problem;
/// let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
/// let cost = ImplicitTerminalCost::of(&ingredients)?;
/// assert!(cost.epsilon() < 0.2);
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug)]
pub struct ImplicitTerminalCost {
    epsilon: f64,
    weight: Dense,
}

impl ImplicitTerminalCost {
    /// The cost with the smallest ε for these ingredients' M̃.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] when no ε < 1 exists: M̃ steps of the law do not contract in the stage cost.
    pub fn of(ingredients: &TerminalIngredients) -> Result<Self, DesignError> {
        let (law, problem) = (ingredients.law(), ingredients.problem());
        let r = linalg::dense(problem.input_weight());
        let q_k = linalg::symmetrised(
            &(linalg::dense(problem.state_weight()) + law.gain.transpose() * &r * &law.gain),
        );
        let steps = ingredients.terminal_horizon();
        let f = power(&law.closed_loop, steps);
        let l = linalg::cholesky("Q + K'RK", &q_k)?;
        // L⁻¹ (F^M̃)ᵀ L, whose singular values squared are the generalised eigenvalues.
        let mut m = f.transpose() * &l;
        l.as_ref().solve_lower_triangular_in_place(m.as_mut());
        let (_, s, _) = linalg::svd("the contraction of the terminal law", &m)?;
        let epsilon = s.first().map_or(0.0, |s| s * s);
        if !(epsilon < 1.0) {
            return Err(DesignError::OutOfRange {
                what: "epsilon of the implicit terminal cost (Remark 2)".into(),
                expected: format!(
                    "a number < 1; {steps} steps of the terminal law do not contract, so use the exact terminal cost or a faster gain"
                ),
                found: format!("{epsilon:.6}"),
            });
        }
        let p = &law.weight;
        let weight =
            linalg::symmetrised(&(p - f.transpose() * p * &f)) * Scale(1.0 / (1.0 - epsilon));
        Ok(Self { epsilon, weight })
    }

    /// The smallest ε.
    pub fn epsilon(&self) -> f64 {
        self.epsilon
    }

    /// P_ε, n × n: the cost is ‖x_N − x_s^a‖² in this weight.
    pub fn weight(&self) -> SparseMatrix {
        linalg::sparse(&self.weight)
    }
}

/// ‖(A + B K)^steps e_N‖²_weight, added to the cost (10).
#[derive(Clone, Debug)]
pub(crate) struct ExtraCost {
    pub(crate) steps: usize,
    /// Positive semidefinite, n × n.
    pub(crate) weight: Dense,
}

impl ExtraCost {
    /// What the formulation and the terminal cost add; `None` for the plain cost.
    pub(super) fn of(
        ingredients: &TerminalIngredients,
        formulation: Formulation,
    ) -> Result<Option<Self>, DesignError> {
        let p = &ingredients.law().weight;
        if formulation == Formulation::NoTerminalConstraint {
            let choices = no_terminal_constraint(ingredients)?;
            if ingredients.problem().terminal_cost() == TerminalCost::Implicit {
                return Err(DesignError::OutOfRange {
                    what: "controller.terminal_cost".into(),
                    expected: "\"exact\" for the formulation without terminal constraint, whose cost is gamma times it".into(),
                    found: "\"implicit\"".into(),
                });
            }
            return Ok((choices.gamma() > 1.0).then(|| Self {
                steps: choices.horizon_extension(),
                weight: p * Scale(choices.gamma() - 1.0),
            }));
        }
        match ingredients.problem().terminal_cost() {
            TerminalCost::Exact => Ok(None),
            TerminalCost::Implicit => Ok(Some(Self {
                steps: 0,
                weight: ImplicitTerminalCost::of(ingredients)?.weight - p,
            })),
        }
    }
}

/// The choices of section 3.5, checked against the terminal horizon.
pub(crate) fn no_terminal_constraint(
    ingredients: &TerminalIngredients,
) -> Result<NoTerminalConstraint, DesignError> {
    let Some(choices) = ingredients.problem().no_terminal_constraint() else {
        return Err(DesignError::OutOfRange {
            what: "controller.horizon_extension and controller.gamma".into(),
            expected: "stated for the formulation \"no_terminal_constraint\"".into(),
            found: "nothing".into(),
        });
    };
    if !ingredients.problem().norms().is_empty() {
        refuse_other_than_implicit(Formulation::NoTerminalConstraint)?;
    }
    let horizon = ingredients.terminal_horizon();
    if choices.horizon_extension() < horizon {
        Ok(choices)
    } else {
        Err(DesignError::OutOfRange {
            what: "controller.horizon_extension".into(),
            expected: format!(
                "fewer steps than the terminal horizon, {horizon}; with as many, the formulation \"implicit\" has its guarantees wherever it is feasible"
            ),
            found: choices.horizon_extension().to_string(),
        })
    }
}

/// Mᵏ.
pub(crate) fn power(m: &Dense, k: usize) -> Dense {
    let (mut out, mut square, mut k) = (Dense::identity(m.nrows(), m.nrows()), m.clone(), k);
    while k > 0 {
        if k % 2 == 1 {
            out = &out * &square;
        }
        square = &square * &square;
        k /= 2;
    }
    out
}
