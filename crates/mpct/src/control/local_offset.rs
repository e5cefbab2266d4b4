//! The offset cost of plants made of many subsystems, sparse.

use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::matrix::SparseMatrix;
use crate::problem::Problem;
use crate::steady_state::SteadyStates;

/// Columns of M_θx are independent when their correlation matrix exceeds this times the identity, as in `set_point.rs`.
const SAME_STATE: f64 = 1e-9;
/// Largest number of inputs whose correlation matrix is factored with full matrices: 32 MB.
const LARGEST_DENSE: usize = 2000;

/// The offset cost as a quadratic in θ: ½ θᵀ H θ − (F_x x_r + F_u u_r)ᵀ θ + const, in shifted coordinates.
pub(super) struct LocalOffsetCost {
    /// 2 (M_θxᵀ O M_θx + M_θuᵀ T M_θu).
    pub(super) hessian: SparseMatrix,
    /// 2 M_θxᵀ O, m × n.
    pub(super) from_state: SparseMatrix,
    /// 2 M_θuᵀ T, m × m.
    pub(super) from_input: SparseMatrix,
}

impl LocalOffsetCost {
    /// The cost; `None` when equilibria may differ in the input alone, which takes the tie-break of `set_point.rs`.
    pub(super) fn of(
        problem: &Problem,
        steady: &SteadyStates,
    ) -> Result<Option<Self>, DesignError> {
        let (mx, mu) = (steady.state_basis(), steady.input_basis());
        if !is_independent(&mx.transpose().mul(mx)) {
            return Ok(None);
        }
        let from_state = mx.transpose().mul(problem.offset_weight());
        let from_input = mu.transpose().mul(problem.offset_input_weight());
        let twice = |m: &SparseMatrix| m.combine(2.0, m, 0.0);
        Ok(Some(Self {
            hessian: from_state.mul(mx).combine(2.0, &from_input.mul(mu), 2.0),
            from_state: twice(&from_state),
            from_input: twice(&from_input),
        }))
    }
}

/// Whether a Gram matrix, scaled to ones on its diagonal, exceeds [`SAME_STATE`] times the identity.
fn is_independent(gram: &SparseMatrix) -> bool {
    let m = gram.rows();
    let scale: Vec<f64> = (0..m).map(|j| gram.get(j, j).sqrt()).collect();
    if !scale.iter().all(|&s| s > 0.0) {
        return false;
    }
    // Gershgorin: rows that their diagonal outweighs need no factorisation.
    let is_dominant = (0..m).all(|i| {
        let beside: f64 = gram
            .row(i)
            .filter(|e| e.0 != i)
            .map(|(j, v)| v.abs() / (scale[i] * scale[j]))
            .sum();
        beside < 1.0 - SAME_STATE
    });
    if is_dominant {
        return true;
    }
    if m > LARGEST_DENSE {
        return false;
    }
    let mut correlation = Dense::zeros(m, m);
    for (i, j, v) in gram.entries() {
        correlation[(i, j)] = v / (scale[i] * scale[j]) - if i == j { SAME_STATE } else { 0.0 };
    }
    linalg::cholesky("M_θx", &correlation).is_ok()
}
