//! Zero-order hold: [A_d B_d; 0 I] = exp([A B; 0 0] T), by scaling and squaring of a Padé approximant.
//!
//! Small or full plants use the [13/13] approximant. On large sparse ones the Taylor series of the scaled matrix is
//! summed instead: its terms are sparse products, entries far from the couplings fall off faster than any power, and
//! what rounding would swallow is dropped.
//!
//! Source: Higham, "The scaling and squaring method for the matrix exponential revisited", SIAM Review 51(4), 2009.

use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::matrix::SparseMatrix;
use faer::Scale;

/// Coefficients of the [13/13] Padé approximant of exp.
const PADE: [f64; 14] = [
    64764752532480000.0,
    32382376266240000.0,
    7771770303897600.0,
    1187353796428800.0,
    129060195264000.0,
    10559470521600.0,
    670442572800.0,
    33522128640.0,
    1323241920.0,
    40840800.0,
    960960.0,
    16380.0,
    182.0,
    1.0,
];

/// Largest 1-norm for which the [13/13] approximant is accurate to double precision (Higham, table 10.2).
const THETA_13: f64 = 5.371920351148152;

/// From this order on, a sparse plant is discretised by sparse products.
const SPARSE_FROM: usize = 64;
/// A plant with more entries than this share counts as full.
const FULL: f64 = 0.1;
/// Entries this much smaller than the largest of their row are dropped. Rounding alone is 1e-16; the rest leaves room
/// for states in units that differ by a factor of a thousand.
const DROP: f64 = 1e-19;
/// Largest 1-norm of the scaled matrix, and the terms after which its Taylor series has converged: 0.5¹⁷/17! < 1e-19.
const TAYLOR: (f64, usize) = (0.5, 17);

/// A_d = e^{A T} and B_d = ∫₀ᵀ e^{A τ} dτ B.
pub(super) fn zero_order_hold(
    a: &SparseMatrix,
    b: &SparseMatrix,
    sampling_time: f64,
) -> Result<(SparseMatrix, SparseMatrix), DesignError> {
    let (n, m) = (a.rows(), b.cols());
    let overflow = || DesignError::OutOfRange {
        what: "plant.sampling_time with these A and B".into(),
        expected: "a discretised plant without overflow (shorten the sampling time)".into(),
        found: format!("{sampling_time} s"),
    };
    if n >= SPARSE_FROM && a.share() < FULL && b.share() < FULL {
        let lists = (0..n + m).map(|i| {
            if i >= n {
                return Vec::new();
            }
            let states = a.row(i).map(|(j, v)| (j, v * sampling_time));
            let inputs = b.row(i).map(|(j, v)| (n + j, v * sampling_time));
            states.chain(inputs).map(|(j, v)| (j as u32, v)).collect()
        });
        let ab = SparseMatrix::from_row_lists(n + m, n + m, lists);
        let e = sparse_exponential(&ab).ok_or_else(overflow)?;
        let block = |from: usize, to: usize| {
            let row = |i: usize| e.row(i).filter(move |c| from <= c.0 && c.0 < to);
            let lists = (0..n).map(|i| row(i).map(|(j, v)| ((j - from) as u32, v)).collect());
            SparseMatrix::from_row_lists(n, to - from, lists)
        };
        return Ok((block(0, n), block(n, n + m)));
    }
    let mut ab = Dense::zeros(n + m, n + m);
    for (i, j, v) in a.entries() {
        ab[(i, j)] = v * sampling_time;
    }
    for (i, j, v) in b.entries() {
        ab[(i, n + j)] = v * sampling_time;
    }
    let e = exponential(&ab).ok_or_else(overflow)?;
    Ok((
        linalg::sparse(&e.submatrix(0, 0, n, n).to_owned()),
        linalg::sparse(&e.submatrix(0, n, n, m).to_owned()),
    ))
}

/// exp(M) of a sparse matrix, or `None` when it overflows.
fn sparse_exponential(m: &SparseMatrix) -> Option<SparseMatrix> {
    let n = m.rows();
    let mut columns = vec![0.0_f64; n];
    m.entries().for_each(|(_, j, v)| columns[j] += v.abs());
    let norm = columns.into_iter().fold(0.0, f64::max);
    if !(norm < LARGEST_NORM) {
        return None;
    }
    let squarings = (norm / TAYLOR.0).log2().ceil().max(0.0) as i32;
    let x = scaled(m, 0.5_f64.powi(squarings));
    let product = |a: &SparseMatrix, b: &SparseMatrix| {
        a.mul_with(b, |_, row| {
            let largest = row.iter().fold(0.0_f64, |a, e| a.max(e.1.abs()));
            row.retain(|e| e.1.abs() > DROP * largest);
            0.0
        })
        .0
    };
    // Horner: e = I + x (I + x/2 (I + x/3 (…))).
    let identity = SparseMatrix::identity(n);
    let mut e = identity.clone();
    for k in (1..=TAYLOR.1).rev() {
        e = identity.combine(1.0, &product(&x, &e), 1.0 / k as f64);
    }
    for _ in 0..squarings {
        e = product(&e, &e);
    }
    let finite = e.entries().all(|c| c.2.abs() < f64::MAX);
    finite.then_some(e)
}

fn scaled(m: &SparseMatrix, by: f64) -> SparseMatrix {
    m.combine(by, &SparseMatrix::zeros(m.rows(), m.cols()), 0.0)
}

/// exp overflows beyond a norm of 709; this leaves room for stable plants whose norm is large.
const LARGEST_NORM: f64 = 1e4;

/// exp(M), or `None` when it overflows.
fn exponential(m: &Dense) -> Option<Dense> {
    let order = m.nrows();
    let norm = m
        .col_iter()
        .map(|c| c.iter().map(|v| v.abs()).sum::<f64>())
        .fold(0.0, f64::max);
    if !(norm < LARGEST_NORM) {
        return None;
    }
    let squarings = if norm > THETA_13 {
        (norm / THETA_13).log2().ceil() as i32
    } else {
        0
    };
    let x = m * Scale(0.5_f64.powi(squarings));
    let identity = Dense::identity(order, order);
    let x2 = &x * &x;
    let x4 = &x2 * &x2;
    let x6 = &x4 * &x2;
    let sum = |c: [f64; 4]| -> Dense {
        &x6 * Scale(c[3]) + &x4 * Scale(c[2]) + &x2 * Scale(c[1]) + &identity * Scale(c[0])
    };
    let odd_high = sum([0.0, PADE[9], PADE[11], PADE[13]]);
    let even_high = sum([0.0, PADE[8], PADE[10], PADE[12]]);
    let odd = &x * (&x6 * odd_high + sum([PADE[1], PADE[3], PADE[5], PADE[7]]));
    let even = &x6 * even_high + sum([PADE[0], PADE[2], PADE[4], PADE[6]]);
    let mut e = linalg::solve(&(&even - &odd), &(&even + &odd));
    for _ in 0..squarings {
        e = &e * &e;
    }
    linalg::is_finite(&e).then_some(e)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Matrix;

    #[test]
    fn rotation_has_its_closed_form() {
        // ẋ = [0 w; -w 0] x + [0; 1] u with w T = 40: many squarings.
        let (w, t) = (20.0, 2.0);
        let a = Matrix::from_rows(&[[0.0, w], [-w, 0.0]]).into();
        let b = Matrix::from_rows(&[[0.0], [1.0]]).into();
        let (ad, bd) = zero_order_hold(&a, &b, t).unwrap();
        let (s, c) = (w * t).sin_cos();
        let expected = [(0, 0, c), (0, 1, s), (1, 0, -s), (1, 1, c)];
        for (i, j, v) in expected {
            assert!((ad.get(i, j) - v).abs() < 1e-12, "{i} {j}");
        }
        assert!((bd.get(0, 0) - (1.0 - c) / w).abs() < 1e-13);
        assert!((bd.get(1, 0) - s / w).abs() < 1e-13);
    }

    #[test]
    fn double_integrator_is_exact() {
        let a = Matrix::from_rows(&[[0.0, 1.0], [0.0, 0.0]]).into();
        let b = Matrix::from_rows(&[[0.0], [1.0]]).into();
        let (ad, bd) = zero_order_hold(&a, &b, 0.5).unwrap();
        assert!((ad.get(0, 1) - 0.5).abs() < 1e-15);
        assert!((bd.get(0, 0) - 0.125).abs() < 1e-15);
        assert!((bd.get(1, 0) - 0.5).abs() < 1e-15);
    }

    #[test]
    fn sparse_and_full_agree() {
        // A chain of 60 carts, and the same matrices through the full approximant.
        let n: usize = 60;
        let mut a = Vec::new();
        for i in 0..n {
            a.push((2 * i, 2 * i + 1, 1.0));
            for j in [i.wrapping_sub(1), i + 1] {
                if j < n {
                    a.push((2 * i + 1, 2 * i, -5.0));
                    a.push((2 * i + 1, 2 * j, 5.0));
                    a.push((2 * i + 1, 2 * j + 1, 0.7));
                }
            }
        }
        let b: Vec<_> = (0..n).map(|i| (2 * i + 1, i, 50.0)).collect();
        let a = SparseMatrix::from_triplets(2 * n, 2 * n, &a).unwrap();
        let b = SparseMatrix::from_triplets(2 * n, n, &b).unwrap();
        let (ad, bd) = zero_order_hold(&a, &b, 0.3).unwrap();
        let mut ab = Dense::zeros(3 * n, 3 * n);
        a.entries().for_each(|(i, j, v)| ab[(i, j)] = 0.3 * v);
        b.entries()
            .for_each(|(i, j, v)| ab[(i, 2 * n + j)] = 0.3 * v);
        let e = exponential(&ab).unwrap();
        for i in 0..2 * n {
            for j in 0..3 * n {
                let sparse = if j < 2 * n {
                    ad.get(i, j)
                } else {
                    bd.get(i, j - 2 * n)
                };
                assert!((sparse - e[(i, j)]).abs() < 1e-13, "{i} {j}");
            }
        }
    }

    #[test]
    fn overflow_is_refused() {
        let a = Matrix::from_rows(&[[1e6]]).into();
        let b = Matrix::from_rows(&[[1.0]]).into();
        assert!(zero_order_hold(&a, &b, 1.0).is_err());
    }
}
