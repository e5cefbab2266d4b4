//! Checks of answers, from the data of the program alone. Nothing here calls, or is called by, a solver.

use crate::linalg::Dense;

/// Residuals of the Karush–Kuhn–Tucker conditions, each in the units of the program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Residuals {
    /// max(0, G z − b).
    pub(crate) primal: f64,
    /// max(0, −y).
    pub(crate) dual: f64,
    /// |H z + f + Gᵀy|, worst component, relative to 1 + the largest of |H z|, |f| and Σ_k |y_k G_k|. So an answer that satisfies the
    /// rows is the optimum of a program whose f and G differ by this much, entry by entry. Multipliers grow with the distance to
    /// the set-point while they cancel in Gᵀy: relative to their sum no set-point would be near enough.
    pub(crate) stationarity: f64,
    /// Σ y_k (b − G z)_k, absolute value of each term summed, relative to 1 + |objective|.
    pub(crate) gap: f64,
}

impl Residuals {
    /// Whether every residual is at most `tolerance`. NaN is not.
    pub(crate) fn within(&self, tolerance: f64) -> bool {
        [self.primal, self.dual, self.stationarity, self.gap]
            .iter()
            .all(|&r| r <= tolerance)
    }

    /// The largest of them; NaN counts as infinite.
    pub(crate) fn largest(&self) -> f64 {
        [self.primal, self.dual, self.stationarity, self.gap]
            .iter()
            .fold(
                0.0,
                |a, &r| if r.is_nan() { f64::INFINITY } else { a.max(r) },
            )
    }
}

/// Residuals of (z, y) for min ½ zᵀHz + fᵀz subject to G z ≤ b.
pub(crate) fn residuals(
    h: &Dense,
    f: &[f64],
    g: &Dense,
    b: &[f64],
    z: &[f64],
    y: &[f64],
) -> Residuals {
    let (rows, nz) = (g.nrows(), g.ncols());
    let mut slack = b.to_vec();
    let (mut gty, mut terms) = (vec![0.0; nz], vec![0.0; nz]);
    for j in 0..nz {
        let column = g.col(j);
        for (i, &v) in column.iter().enumerate() {
            slack[i] -= v * z[j];
            gty[j] += v * y[i];
            terms[j] += (v * y[i]).abs();
        }
    }
    let mut stationarity = 0.0_f64;
    let mut objective = 0.0;
    for i in 0..nz {
        let hz: f64 = (0..nz).map(|j| h[(i, j)] * z[j]).sum();
        objective += z[i] * (0.5 * hz + f[i]);
        let scale = 1.0 + hz.abs().max(f[i].abs()).max(terms[i]);
        let r = (hz + f[i] + gty[i]).abs() / scale;
        stationarity = if r.is_nan() {
            f64::NAN
        } else {
            stationarity.max(r)
        };
    }
    let nan_max = |values: &mut dyn Iterator<Item = f64>| {
        values.fold(0.0_f64, |a, v| {
            if v.is_nan() || a.is_nan() {
                f64::NAN
            } else {
                a.max(v)
            }
        })
    };
    Residuals {
        primal: nan_max(&mut slack.iter().map(|s| -s)),
        dual: nan_max(&mut y.iter().map(|v| -v)),
        stationarity,
        gap: (0..rows).map(|i| (y[i] * slack[i]).abs()).sum::<f64>() / (1.0 + objective.abs()),
    }
}

/// A checked proof that G z ≤ b has no solution with ‖z‖₁ < radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Farkas {
    /// −bᵀy for y scaled to Σ y = 1.
    pub(crate) gap: f64,
    /// −bᵀy / ‖Gᵀy‖∞.
    pub(crate) radius: f64,
}

/// Any solution would satisfy 0 ≤ yᵀ(b − G z) ≤ bᵀy + ‖Gᵀy‖∞ ‖z‖₁. `None` when y proves nothing.
pub(crate) fn farkas(g: &Dense, b: &[f64], y: &[f64]) -> Option<Farkas> {
    let y: Vec<f64> = y.iter().map(|v| v.max(0.0)).collect();
    let total: f64 = y.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    let gap = -b.iter().zip(&y).map(|(b, y)| b * y).sum::<f64>() / total;
    let leak = (0..g.ncols())
        .map(|j| {
            g.col(j)
                .iter()
                .zip(&y)
                .map(|(g, y)| g * y)
                .sum::<f64>()
                .abs()
                / total
        })
        .fold(0.0_f64, f64::max);
    let radius = if leak > 0.0 {
        gap / leak
    } else {
        f64::INFINITY
    };
    (gap > 0.0 && !radius.is_nan()).then_some(Farkas { gap, radius })
}
