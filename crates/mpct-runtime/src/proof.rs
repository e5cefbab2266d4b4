//! "Infeasible" is said with a proof only: `y ≥ 0` with `Gᵀy ≈ 0` and `b(x)ᵀy < 0` (Farkas).
//!
//! Every `z` with `G z ≤ b` satisfies `yᵀG z ≤ bᵀy`, and `yᵀG z ≥ −‖Gᵀy‖_∞ ‖z‖₁`. So there is none with
//! `‖z‖₁ < −bᵀy / ‖Gᵀy‖_∞`. That number is the radius of the proof; it is infinite when `Gᵀy` vanishes exactly.

use crate::dense::{axpy, dot, max_abs};
use crate::{Scalar, Tables};

/// The radius for which `y` (multipliers of the scaled rows `rows`) proves infeasibility at `x`; `None` when it proves nothing.
///
/// `image` is scratch of length `nz`; it returns with `Gᵀy`.
pub(crate) fn proof_radius<T: Scalar>(
    tables: &Tables<'_, T>,
    x: &[T],
    rows: &[u32],
    y: &[T],
    image: &mut [T],
) -> Option<T> {
    image.fill(T::ZERO);
    let (mut bound, mut magnitude) = (T::ZERO, T::ZERO);
    for (&row, &yi) in rows.iter().zip(y) {
        if !(yi >= T::ZERO) {
            return None;
        }
        let row = row as usize;
        axpy(yi, tables.g_row(row), image);
        let state = dot(tables.w_row(row), x);
        bound += yi * (tables.scale[row] + state);
        magnitude += yi * (tables.scale[row] + state.abs());
    }
    // Written so that NaN proves nothing.
    if !(-bound > T::PROOF_MARGIN * magnitude) {
        return None;
    }
    let size = max_abs(image);
    let radius = if size > T::ZERO {
        -bound / size
    } else {
        T::INFINITY
    };
    if radius > T::PROOF_RADIUS {
        Some(radius)
    } else {
        None
    }
}
