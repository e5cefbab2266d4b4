//! S with FᵀSF − S + C = 0 on sparse matrices, by the squared Smith iteration.
//!
//! S_{k+1} = S_k + F_kᵀ S_k F_k,  F_{k+1} = F_k². Where F is local its powers are, and entries that rounding would
//! swallow are dropped: those of S against its diagonal, those of F_k against the unit.

use super::MAX_DOUBLINGS;
use crate::clock::Clock;
use crate::matrix::SparseMatrix;

/// Entries |S_ij| ≤ this · √(S_ii S_jj) are dropped. Of a correction to S, too, with the diagonal of S.
const DROP_SUM: f64 = 1e-17;
/// Entries |F_ij| ≤ this are dropped, F in units in which C has a diagonal of ones: what they add to S is smaller
/// than its rounding.
const DROP_POWER: f64 = 1e-18;
/// The same for a correction, whose entries are 1e-12 of those of S at most and need few digits.
const DROP_POWER_OF_CORRECTION: f64 = 1e-8;
/// The iteration ends when an increment is this much smaller than the sum.
const CONVERGED: f64 = 1e-18;
/// With more entries in a power than this share the plant is not local, and full matrices are faster.
const FULL: f64 = 0.35;

/// The sum, and a bound of the spectral radius of F.
pub(super) struct Smith {
    pub(super) sum: SparseMatrix,
    pub(super) spectral_radius: f64,
}

/// `None` when the powers do not vanish, fill up, or the clock rings. `unit` are the units of the states.
pub(super) fn smith(
    f: &SparseMatrix,
    c: &SparseMatrix,
    unit: &[f64],
    clock: &Clock,
) -> Option<Smith> {
    series(f, c, unit, None, clock).filter(|s| s.spectral_radius < 1.0)
}

/// What a sum still lacks: the same equation with its residual on the right, as accurate as the sum can take it.
pub(super) fn correction(
    f: &SparseMatrix,
    residual: &SparseMatrix,
    sum: &SparseMatrix,
    unit: &[f64],
    clock: &Clock,
) -> Option<SparseMatrix> {
    let n = f.rows();
    let size = |i: usize| sum.get(i, i).abs().sqrt() * unit[i];
    let against: Vec<f64> = (0..n).map(size).collect();
    Some(series(f, residual, unit, Some(&against), clock)?.sum)
}

/// `against`: √S_ii of the sum that this one corrects, in units of the states.
fn series(
    f: &SparseMatrix,
    c: &SparseMatrix,
    unit: &[f64],
    against: Option<&[f64]>,
    clock: &Clock,
) -> Option<Smith> {
    let n = f.rows();
    let scaled = |m: &SparseMatrix, by: &dyn Fn(usize, usize) -> f64| -> SparseMatrix {
        SparseMatrix::from_row_lists(
            n,
            n,
            (0..n).map(|i| m.row(i).map(|(j, v)| (j as u32, v * by(i, j))).collect()),
        )
    };
    let mut power = scaled(f, &|i, j| unit[j] / unit[i]);
    let mut sum = scaled(c, &|i, j| unit[i] * unit[j]);
    let drop_power = if let Some(against) = against {
        let negligible = |i: usize, j: usize| DROP_SUM * against[i] * against[j];
        sum = sum.filtered(|i, j, v| v.abs() > negligible(i, j));
        power = power.filtered(|_, _, v| v.abs() > DROP_POWER_OF_CORRECTION);
        DROP_POWER_OF_CORRECTION
    } else {
        DROP_POWER
    };
    let mut radius = f64::INFINITY;
    let mut exponent = 1.0_f64;
    for _ in 0..MAX_DOUBLINGS {
        let norm = row_norm(&power);
        // Gelfand: ρ(F) ≤ ‖Fᵏ‖^{1/k}.
        radius = radius.min(norm.powf(1.0 / exponent));
        if !norm.is_finite() || clock.has_stopped() || power.share() > FULL {
            return None;
        }
        let diagonal: Vec<f64> = match against {
            Some(against) => against.to_vec(),
            None => (0..n).map(|i| sum.get(i, i).abs().sqrt()).collect(),
        };
        let right = sum.mul_with(&power, |_, _| 0.0).0;
        let transposed = power.transpose();
        let (increment, largest) = transposed.mul_with(&right, |i, row| {
            row.retain(|&(j, v)| v.abs() > DROP_SUM * diagonal[i] * diagonal[j as usize]);
            row.iter().fold(0.0_f64, |a, e| a.max(e.1.abs()))
        });
        let small = largest.into_iter().fold(0.0, f64::max);
        let large = diagonal.iter().fold(0.0_f64, |a, v| a.max(v * v));
        sum = sum.combine(1.0, &increment, 1.0);
        sum = sum.combine(0.5, &sum.transpose(), 0.5);
        if small <= CONVERGED * large {
            let sum = scaled(&sum, &|i, j| 1.0 / (unit[i] * unit[j]));
            return Some(Smith {
                sum,
                spectral_radius: radius,
            });
        }
        power = power
            .mul_with(&power, |_, row| {
                row.retain(|e| e.1.abs() > drop_power);
                0.0
            })
            .0;
        exponent *= 2.0;
    }
    None
}

/// Largest sum of a row.
fn row_norm(m: &SparseMatrix) -> f64 {
    (0..m.rows())
        .map(|i| m.row(i).map(|e| e.1.abs()).sum::<f64>())
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// s = 1 + f² s: s = 1/(1 − f²); two coupled states against the residual.
    #[test]
    fn scalar_and_residual() {
        let f = SparseMatrix::from_diagonal(&[0.5]);
        let c = SparseMatrix::identity(1);
        let s = smith(&f, &c, &[1.0], &Clock::unlimited()).map(|s| s.sum.get(0, 0));
        // One state is "full" by its share; a larger diagonal is not.
        assert!(s.is_none());
        let n = 8;
        let f = SparseMatrix::from_diagonal(&vec![0.5; n]);
        let s = smith(
            &f,
            &SparseMatrix::identity(n),
            &vec![1.0; n],
            &Clock::unlimited(),
        )
        .unwrap();
        assert!((s.sum.get(3, 3) - 4.0 / 3.0).abs() < 1e-15);
        assert!((s.spectral_radius - 0.5).abs() < 1e-12);
    }

    /// A sum that lacks a millionth, and what makes it whole.
    #[test]
    fn corrections_make_a_sum_whole() {
        let n = 80;
        let mut entries: Vec<(usize, usize, f64)> = (0..n).map(|i| (i, i, 0.3)).collect();
        entries.extend((1..n).map(|i| (i - 1, i, 0.05)));
        let f = SparseMatrix::from_triplets(n, n, &entries).unwrap();
        let (c, unit) = (SparseMatrix::identity(n), vec![1.0; n]);
        let clock = Clock::unlimited();
        let whole = smith(&f, &c, &unit, &clock).unwrap().sum;
        let lacking = whole.combine(1.0 - 1e-6, &c, 0.0);
        let residual = f
            .transpose()
            .mul(&lacking.mul(&f))
            .combine(1.0, &c, 1.0)
            .combine(1.0, &lacking, -1.0);
        let found = correction(&f, &residual, &lacking, &unit, &clock).unwrap();
        for (i, j, v) in whole.entries() {
            let mended = lacking.get(i, j) + found.get(i, j);
            assert!((mended - v).abs() < 1e-12, "{i} {j}: {mended} and {v}");
        }
    }

    #[test]
    fn an_unstable_matrix_has_no_sum() {
        let n = 8;
        let f = SparseMatrix::from_diagonal(&vec![1.0; n]);
        assert!(
            smith(
                &f,
                &SparseMatrix::identity(n),
                &vec![1.0; n],
                &Clock::unlimited()
            )
            .is_none()
        );
    }
}
