//! The checks of `verify.rs` for sparse rows in pairs, −l ≤ G z + v ≤ u. Nothing here calls, or is called by, a solver.

use super::verify::{Farkas, Residuals};
use crate::matrix::SparseMatrix;

/// Rows −l ≤ G z + v ≤ u; +∞ is no bound. Multipliers are signed: positive on the upper side, negative on the lower.
pub(crate) struct Pairs<'a> {
    pub(crate) rows: &'a SparseMatrix,
    pub(crate) from_state: Vec<f64>,
    pub(crate) upper: &'a [f64],
    pub(crate) lower: &'a [f64],
}

/// The larger one; NaN wins.
fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() {
        f64::NAN
    } else {
        a.max(b)
    }
}

/// Residuals of (z, y) for min ½ zᵀHz + fᵀz over the rows, relative as those of `verify.rs`.
pub(crate) fn residuals(
    h: &SparseMatrix,
    f: &[f64],
    pairs: &Pairs<'_>,
    z: &[f64],
    y: &[f64],
) -> Residuals {
    let (mut primal, mut slackness) = (0.0_f64, 0.0_f64);
    let mut gty = vec![0.0; z.len()];
    for i in 0..y.len() {
        let (columns, values) = pairs.rows.row_slices(i);
        let mut value = pairs.from_state[i];
        for (&j, &g) in columns.iter().zip(values) {
            value += g * z[j as usize];
        }
        let (above, below) = (value - pairs.upper[i], -value - pairs.lower[i]);
        // A row is written with right-hand side 1, its violation in units of that.
        for (violation, bound) in [(above, pairs.upper[i]), (below, pairs.lower[i])] {
            if bound < f64::INFINITY {
                primal = worse(primal, violation / bound);
            }
        }
        if y[i] != 0.0 {
            // A multiplier of a side that is no constraint gives ∞ here.
            slackness += (y[i] * if y[i] > 0.0 { above } else { below }).abs();
            for (j, g) in pairs.rows.row(i) {
                gty[j] += g * y[i];
            }
        }
    }
    let (mut stationarity, mut objective) = (0.0_f64, 0.0);
    for i in 0..z.len() {
        let mut hz = 0.0;
        for (j, v) in h.row(i) {
            hz += v * z[j];
        }
        objective += z[i] * (0.5 * hz + f[i]);
        let scale = 1.0 + hz.abs().max(f[i].abs()).max(gty[i].abs());
        stationarity = worse(stationarity, (hz + f[i] + gty[i]).abs() / scale);
    }
    Residuals {
        primal,
        // The sign of a multiplier says which side it belongs to: none is negative.
        dual: 0.0,
        stationarity,
        gap: slackness / (1.0 + objective.abs()),
    }
}

/// A proof that the rows have no solution below a radius, as in `verify.rs`; `None` when y proves nothing.
pub(crate) fn farkas(pairs: &Pairs<'_>, y: &[f64]) -> Option<Farkas> {
    let (mut total, mut bound) = (0.0, 0.0);
    let mut gty = vec![0.0; pairs.rows.cols()];
    for (i, &multiplier) in y.iter().enumerate() {
        if multiplier == 0.0 {
            continue;
        }
        let limit = if multiplier > 0.0 {
            pairs.upper[i]
        } else {
            pairs.lower[i]
        };
        total += multiplier.abs();
        bound += multiplier.abs() * limit - multiplier * pairs.from_state[i];
        for (j, g) in pairs.rows.row(i) {
            gty[j] += g * multiplier;
        }
    }
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    let gap = -bound / total;
    let leak = gty.iter().fold(0.0_f64, |a, v| worse(a, v.abs())) / total;
    let radius = if leak > 0.0 {
        gap / leak
    } else if leak == 0.0 {
        f64::INFINITY
    } else {
        f64::NAN
    };
    (gap > 0.0 && !radius.is_nan()).then_some(Farkas { gap, radius })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// min ½ z² − 2 z over −1 ≤ z ≤ 1: z = 1 with multiplier 1.
    #[test]
    fn a_solution_passes_and_others_do_not() {
        let one = SparseMatrix::identity(1);
        let pairs = Pairs {
            rows: &one,
            from_state: vec![0.0],
            upper: &[1.0],
            lower: &[1.0],
        };
        let at = |z: f64, y: f64| residuals(&one, &[-2.0], &pairs, &[z], &[y]);
        assert!(at(1.0, 1.0).within(1e-15));
        assert!(!at(1.1, 0.9).within(0.05));
        assert!(!at(1.0, 0.9).within(0.02));
        assert!(!at(0.5, 1.5).within(0.1));
        assert!(!at(1.0, -1.0).within(0.1));
        assert!(!at(f64::NAN, 1.0).within(1.0));
    }

    #[test]
    fn a_ray_proves_what_it_proves() {
        // z ≤ 1 and z ≥ 2.
        let rows = SparseMatrix::from_triplets(2, 1, &[(0, 0, 1.0), (1, 0, 1.0)]).unwrap();
        let pairs = Pairs {
            rows: &rows,
            from_state: vec![0.0, -3.0],
            upper: &[1.0, f64::INFINITY],
            lower: &[f64::INFINITY, 1.0],
        };
        // −(z − 3) ≤ 1 is z ≥ 2.
        assert!(farkas(&pairs, &[1.0, -1.0]).is_some_and(|p| p.radius == f64::INFINITY));
        assert!(farkas(&pairs, &[1.0, 0.0]).is_none());
        // A multiplier of a side that is no constraint.
        assert!(farkas(&pairs, &[-1.0, 1.0]).is_none());
    }
}
