//! A + B K is Schur, and P satisfies (3).
//!
//! P ≻ 0 and P − ÂᵀP Â ≻ 0 prove that Â is Schur. The second follows from (3) when its residual
//!   W = P − ÂᵀPÂ − (Q + KᵀRK)
//! is small against Q: with D = diag Q and Q ⪰ c D, ‖D^{−1/2} W D^{−1/2}‖_∞ ≤ ε gives
//! P − ÂᵀPÂ ⪰ (1 − ε/c)(Q + KᵀRK), which is also the decrease of the terminal cost that stability needs.
//!
//! Positive definiteness is proved by a Cholesky factorisation in ordinary doubles of the matrix less a multiple of the
//! identity: if it runs to its end, the matrix is positive definite (Rump, "Verification of positive definiteness",
//! BIT 46, 2006).

use super::document::{Claim, Sparse};
use super::interval::{IntervalRows, combined, mul_up, product, transposed};
use super::rows::{System, checked};
use super::verify::VerifyError;

/// Largest ε/c accepted.
const LARGEST_RESIDUAL: f64 = 1e-6;

/// The bound ε/c.
pub(super) fn check(claim: &Claim, system: &System) -> Result<f64, VerifyError> {
    let (n, m) = (system.states, claim.b.columns);
    let p = symmetric("P", &claim.weight, n)?;
    let q = symmetric("Q", &claim.q, n)?;
    let r = symmetric("R", &claim.r, m)?;
    let k = checked("K", &claim.gain, m, n)?;
    for (what, matrix) in [("P", &claim.weight), ("Q", &claim.q), ("R", &claim.r)] {
        if !is_positive(matrix, 0.0) {
            return Err(VerifyError::refused(format!(
                "{what} is not proved positive definite"
            )));
        }
    }
    let f = &system.closed_loop;
    let decrease = combined(
        &p,
        &product(&transposed(f, n), &product(&p, f, n), n),
        -1.0,
        n,
    );
    let stage = combined(
        &q,
        &product(&transposed(&k, n), &product(&r, &k, n), n),
        1.0,
        n,
    );
    let residual = combined(&decrease, &stage, -1.0, n);
    let scale: Vec<f64> = (0..n)
        .map(|i| diagonal(&claim.q, i).sqrt().next_down())
        .collect();
    let norm = residual
        .iter()
        .enumerate()
        .map(|(i, row)| {
            row.iter().fold(0.0_f64, |s, &(j, v)| {
                (s + (v.magnitude() / scale[i]).next_up() / scale[j])
                    .next_up()
                    .next_up()
            })
        })
        .fold(0.0, f64::max);
    let is_diagonal = claim
        .q
        .rows
        .iter()
        .enumerate()
        .all(|(i, r)| r.iter().all(|e| e.0 == i));
    let shares: &[f64] = if is_diagonal {
        &[1.0]
    } else {
        &[0.5, 1e-1, 1e-2, 1e-4, 1e-6, 1e-8]
    };
    let share = shares
        .iter()
        .find(|&&c| is_diagonal || is_positive(&claim.q, c))
        .ok_or_else(|| {
            VerifyError::refused("Q is too close to singular to bound the residual of (3)")
        })?;
    let bound = mul_up(norm, (1.0 / share).next_up());
    if bound <= LARGEST_RESIDUAL {
        Ok(bound)
    } else {
        Err(VerifyError::refused(format!(
            "P does not satisfy (3): its residual is {bound:.3e} of the stage cost, and may be {LARGEST_RESIDUAL:.0e}"
        )))
    }
}

fn diagonal(m: &Sparse, i: usize) -> f64 {
    m.rows[i].iter().find(|e| e.0 == i).map_or(0.0, |e| e.1)
}

fn symmetric(what: &str, m: &Sparse, n: usize) -> Result<IntervalRows, VerifyError> {
    let rows = checked(what, m, n, n)?;
    let transpose = transposed(&rows, n);
    if rows == transpose {
        Ok(rows)
    } else {
        Err(VerifyError::refused(format!("{what} is not symmetric")))
    }
}

/// Whether M − share · diag M is proved positive definite.
fn is_positive(m: &Sparse, share: f64) -> bool {
    let n = m.rows.len();
    // Scaled by powers of two, which is exact, to a diagonal between 1/2 and 2.
    let mut unit = Vec::with_capacity(n);
    for i in 0..n {
        let d = diagonal(m, i);
        if !(d > 0.0) {
            return false;
        }
        unit.push(2.0_f64.powi((-0.5 * d.log2()).round() as i32));
    }
    // Rump: the factorisation of order n has a backward error of at most γ/(1 − 2γ) times the trace, γ = (n + 2) u;
    // the trace is at most 2 n. Twice that also covers the rounding of the shift itself and of M − share · diag M.
    let order = n as f64 + 4.0;
    let shift = 2.0 * order * f64::EPSILON * (2.0 * order);
    // Rows of the factor from their first entry on.
    let mut factor: Vec<(usize, Vec<f64>)> = Vec::with_capacity(n);
    for i in 0..n {
        let first = m.rows[i].first().map_or(i, |e| e.0.min(i));
        let mut row = vec![0.0; i - first + 1];
        for &(j, v) in m.rows[i].iter().filter(|e| e.0 <= i) {
            row[j - first] = v * unit[i] * unit[j];
        }
        row[i - first] = row[i - first] * (1.0 - share) - shift;
        for j in first..i {
            let (start, other) = &factor[j];
            let from = first.max(*start);
            let (x, y) = (
                &row[from.min(j) - first..j - first],
                &other[from.min(j) - start..j - start],
            );
            let dot: f64 = x.iter().zip(y).map(|(a, b)| a * b).sum();
            row[j - first] = (row[j - first] - dot) / other[j - start];
        }
        let (last, head) = row.split_last().map_or((0.0, &[][..]), |(l, h)| (*l, h));
        let pivot = last - head.iter().map(|v| v * v).sum::<f64>();
        if !(pivot > 0.0) {
            return false;
        }
        let end = row.len() - 1;
        row[end] = pivot.sqrt();
        factor.push((first, row));
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full(rows: &[&[f64]]) -> Sparse {
        Sparse {
            columns: rows.len(),
            rows: rows
                .iter()
                .map(|r| r.iter().copied().enumerate().collect())
                .collect(),
        }
    }

    #[test]
    fn definiteness_is_decided() {
        assert!(is_positive(&full(&[&[2.0, 1.0], &[1.0, 2.0]]), 0.0));
        assert!(is_positive(&full(&[&[2.0, 1.0], &[1.0, 2.0]]), 0.25));
        assert!(!is_positive(&full(&[&[2.0, 1.0], &[1.0, 2.0]]), 0.75));
        assert!(!is_positive(&full(&[&[1.0, 2.0], &[2.0, 1.0]]), 0.0));
        // Singular: no proof.
        assert!(!is_positive(&full(&[&[1.0, 1.0], &[1.0, 1.0]]), 0.0));
        // Badly scaled is no obstacle.
        assert!(is_positive(&full(&[&[2e-12, 1e-9], &[1e-9, 2.0]]), 0.0));
    }
}
