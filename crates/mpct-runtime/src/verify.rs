//! Is `(z, y)` a solution? Shares no code with the solver.

use crate::Scalar;

/// Residuals of the optimality conditions of `min ½ zᵀHz + fᵀz  s.t.  G z ≤ b` at `(z, y)`, as they are, not scaled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verification<T> {
    /// `max(0, maxᵢ (G z − b)ᵢ)`.
    pub primal: T,
    /// `max(0, maxᵢ −yᵢ)`.
    pub dual: T,
    /// `‖H z + f + Gᵀy‖_∞`.
    pub stationarity: T,
    /// `maxᵢ |yᵢ (G z − b)ᵢ|`.
    pub complementarity: T,
    /// `|zᵀHz + fᵀz + bᵀy|`: primal minus dual cost.
    pub gap: T,
    /// The size of the terms in the stationarity condition: `max(1, ‖Hz‖_∞, ‖f‖_∞, ‖Gᵀy‖_∞)`.
    pub scale: T,
}

impl<T: Scalar> Verification<T> {
    /// The largest of primal, dual and stationarity (over `scale`), complementarity and gap (over `scale`).
    pub fn worst(&self) -> T {
        let mut worst = self.primal;
        for other in [
            self.dual / self.scale,
            self.stationarity / self.scale,
            self.complementarity / self.scale,
            self.gap / self.scale,
        ] {
            // Written so that NaN counts as worst.
            if !(other <= worst) {
                worst = other;
            }
        }
        worst
    }
}

/// Computes [`Verification`]. Shapes: `h: nz × nz`, `f, z: nz`, `g: rows × nz`, `b, y: rows`, all row-major.
/// `None` when a length does not fit. Entries that are not finite give residuals that are not finite.
///
/// ```
/// // min ½ z² − 2 z  s.t.  z ≤ 1: the solution is 1 with multiplier 1.
/// let v = mpct_runtime::verify(&[1.0], &[-2.0], &[1.0], &[1.0], &[1.0], &[1.0]).unwrap();
/// assert_eq!(v.worst(), 0.0);
/// let v = mpct_runtime::verify(&[1.0], &[-2.0], &[1.0], &[1.0], &[2.0], &[0.0]).unwrap();
/// assert_eq!(v.primal, 1.0);
/// ```
pub fn verify<T: Scalar>(
    h: &[T],
    f: &[T],
    g: &[T],
    b: &[T],
    z: &[T],
    y: &[T],
) -> Option<Verification<T>> {
    let (nz, rows) = (f.len(), b.len());
    if h.len() != nz * nz || g.len() != rows * nz || z.len() != nz || y.len() != rows {
        return None;
    }
    let (mut primal, mut dual, mut complementarity, mut gap) = (T::ZERO, T::ZERO, T::ZERO, T::ZERO);
    for i in 0..rows {
        let mut q = -b[i];
        for j in 0..nz {
            q += g[i * nz + j] * z[j];
        }
        primal = larger(primal, q);
        dual = larger(dual, -y[i]);
        complementarity = larger(complementarity, magnitude(y[i] * q));
        gap += b[i] * y[i];
    }
    let (mut stationarity, mut scale) = (T::ZERO, T::ONE);
    for j in 0..nz {
        let (mut hz, mut gy) = (T::ZERO, T::ZERO);
        for k in 0..nz {
            hz += h[j * nz + k] * z[k];
        }
        for i in 0..rows {
            gy += g[i * nz + j] * y[i];
        }
        gap += z[j] * (hz + f[j]);
        stationarity = larger(stationarity, magnitude(hz + f[j] + gy));
        scale = larger(
            larger(scale, magnitude(hz)),
            larger(magnitude(f[j]), magnitude(gy)),
        );
    }
    Some(Verification {
        primal,
        dual,
        stationarity,
        complementarity,
        gap: magnitude(gap),
        scale,
    })
}

fn magnitude<T: Scalar>(v: T) -> T {
    if v < T::ZERO { -v } else { v }
}

/// The larger one; NaN wins.
fn larger<T: Scalar>(a: T, b: T) -> T {
    if b <= a { a } else { b }
}
