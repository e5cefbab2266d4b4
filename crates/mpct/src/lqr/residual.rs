//! Whether P satisfies (3) in floating point.
//!
//! With W the residual of (3), D = diag Q and Q ⪰ c D, ‖D^{−1/2} W D^{−1/2}‖_∞ ≤ ε gives
//! P − (A+BK)ᵀP(A+BK) ⪰ (1 − ε/c)(Q + KᵀRK): the terminal cost falls by all but the share ε/c of the stage cost.
//! A larger share is no longer the theory's terminal cost, and the design says so instead of using it.

use crate::error::DesignError;
use crate::linalg;
use crate::matrix::SparseMatrix;
use crate::problem::Problem;

/// Largest ε/c accepted. Double precision gives 1e-12 on plants in ordinary units; the certificate's checker accepts
/// no more than this either.
const LARGEST: f64 = 1e-6;

/// Refuses a P whose residual, given by its entries, is too large.
pub(super) fn check(
    problem: &Problem,
    residual: impl Iterator<Item = (usize, usize, f64)>,
) -> Result<(), DesignError> {
    let q = problem.state_weight();
    let n = q.rows();
    let unit = super::units(q);
    let mut sums = vec![0.0; n];
    for (i, j, v) in residual {
        sums[i] += v.abs() * unit[i] * unit[j];
    }
    let share = smallest_share(problem, &unit)?;
    let (worst, norm) = sums.iter().copied().enumerate().fold((0, 0.0), |a, b| {
        // NaN counts as the largest.
        if b.1 <= a.1 { a } else { b }
    });
    let found = norm / share;
    if found <= LARGEST {
        return Ok(());
    }
    Err(DesignError::Solver {
        what: "P of (3)".into(),
        detail: format!(
            "its residual is {found:.1e} of the stage cost and may be {LARGEST:.0e}, the largest in the row of state \
             {worst}: the terminal cost is not verified. Weights far from 1/bound² or states in very different units \
             do this; state Q, R and the units so that the states are worth about the same"
        ),
    })
}

/// The largest c that is easily shown with Q ⪰ c diag Q.
fn smallest_share(problem: &Problem, unit: &[f64]) -> Result<f64, DesignError> {
    let q = problem.state_weight();
    // Gerschgorin; exact for a diagonal Q.
    let off = |i: usize| -> f64 {
        let row = q.row(i).filter(|&(j, _)| j != i);
        row.map(|(j, v)| v.abs() * unit[i] * unit[j]).sum()
    };
    let share = (0..q.rows()).map(|i| 1.0 - off(i)).fold(1.0, f64::min);
    if share > 0.1 {
        return Ok(share);
    }
    let scaled: Vec<_> = q
        .entries()
        .map(|(i, j, v)| (i, j, v * unit[i] * unit[j]))
        .collect();
    let scaled = SparseMatrix::from_triplets(q.rows(), q.rows(), &scaled)?;
    let smallest = linalg::smallest_symmetric_eigenvalue("weights.Q", &scaled)?;
    Ok(smallest.max(f64::EPSILON))
}
