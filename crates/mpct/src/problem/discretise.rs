//! Zero-order hold: [A_d B_d; 0 I] = exp([A B; 0 0] T), by scaling and squaring of a Padé approximant.
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

/// A_d = e^{A T} and B_d = ∫₀ᵀ e^{A τ} dτ B.
pub(super) fn zero_order_hold(
    a: &SparseMatrix,
    b: &SparseMatrix,
    sampling_time: f64,
) -> Result<(SparseMatrix, SparseMatrix), DesignError> {
    let (n, m) = (a.rows(), b.cols());
    let mut ab = Dense::zeros(n + m, n + m);
    for (i, j, v) in a.entries() {
        ab[(i, j)] = v * sampling_time;
    }
    for (i, j, v) in b.entries() {
        ab[(i, n + j)] = v * sampling_time;
    }
    let e = exponential(&ab).ok_or_else(|| DesignError::OutOfRange {
        what: "plant.sampling_time with these A and B".into(),
        expected: "a discretised plant without overflow (shorten the sampling time)".into(),
        found: format!("{sampling_time} s"),
    })?;
    Ok((
        linalg::sparse(&e.submatrix(0, 0, n, n).to_owned()),
        linalg::sparse(&e.submatrix(0, n, n, m).to_owned()),
    ))
}

/// exp(M), or `None` when it overflows.
fn exponential(m: &Dense) -> Option<Dense> {
    let order = m.nrows();
    let norm = m
        .col_iter()
        .map(|c| c.iter().map(|v| v.abs()).sum::<f64>())
        .fold(0.0, f64::max);
    // exp overflows beyond 709; 1e4 leaves room for stable plants whose norm is large.
    if !(norm < 1e4) {
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
    fn overflow_is_refused() {
        let a = Matrix::from_rows(&[[1e6]]).into();
        let b = Matrix::from_rows(&[[1.0]]).into();
        assert!(zero_order_hold(&a, &b, 1.0).is_err());
    }
}
