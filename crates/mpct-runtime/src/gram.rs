//! The products of all rows with each other, for problems small enough to store them.
//!
//! With `v = R⁻ᵀf` and the rows `M = G R⁻¹`, the residuals of all rows at the minimiser for given multipliers are
//! `G z − W x = −M v − W x − (M Mᵀ) λ`. A table of `M Mᵀ` turns one change of the working set into a few additions of vectors as long as
//! there are rows, without `z`: see `walk.rs`. The table grows with the square of the rows, so it is worth its place while it fits into
//! the fastest memory: 52 pairs of rows need 22 kB in `f64`.
//!
//! A *unit* is a pair of opposite rows, or a row that has none. Numbers, `units (1 + n + nz + m + units)`:
//!
//! ```text
//! right-hand sides (scales)   units
//! Wᵀ                          n × units
//! M                           units × nz
//! the θ part of M, transposed m × units
//! M Mᵀ                        units × units
//! ```

use crate::dense::dot;
use crate::{Dims, Scalar, TableError, Tables};

/// Borrowed from the end of the tables. The second rows of pairs have the opposite sign.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gram<'a, T> {
    pub units: usize,
    pub scale: &'a [T],
    pub state: &'a [T],
    pub rows: &'a [T],
    pub theta: &'a [T],
    pub products: &'a [T],
}

/// Roundings, in units of [`Scalar::EPSILON`], of the smallest problem.
pub(crate) const LEAST: f64 = 8.0;

impl<'a, T: Scalar> Gram<'a, T> {
    /// Divides a slice of length [`Dims::gram_len`].
    pub fn lay_out(dims: Dims, units: usize, slice: &'a [T]) -> Self {
        let (scale, rest) = slice.split_at(units);
        let (state, rest) = rest.split_at(dims.states * units);
        let (rows, rest) = rest.split_at(dims.variables() * units);
        let (theta, products) = rest.split_at(dims.inputs * units);
        Self {
            units,
            scale,
            state,
            rows,
            theta,
            products,
        }
    }

    /// Row `unit` of `M Mᵀ`.
    #[inline(always)]
    pub fn products_of(&self, unit: usize) -> &'a [T] {
        &self.products[unit * self.units..(unit + 1) * self.units]
    }
}

/// Unit of a row, and the sign the row has in it.
#[inline(always)]
pub(crate) fn unit_of<T: Scalar>(row: usize, pairs: usize) -> (usize, T) {
    if row >= 2 * pairs {
        (row - pairs, T::ONE)
    } else if row.is_multiple_of(2) {
        (row / 2, T::ONE)
    } else {
        (row / 2, -T::ONE)
    }
}

/// The first row of a unit.
#[inline(always)]
pub(crate) fn row_of(unit: usize, pairs: usize) -> usize {
    if unit < pairs { 2 * unit } else { unit + pairs }
}

/// Writes the products of the rows of `tables` into `out`, of length [`Tables::gram_len`].
///
/// Tables and products one after the other in one slice are read by [`Tables::from_slice`], and the solver uses them.
/// Cost: `units · nz (nz + units)`. Errors: the length; a product that is not finite.
///
/// ```
/// use mpct_runtime::{Dims, QpData, Tables, prepare, prepare_gram};
/// const DIMS: Dims = Dims { states: 1, inputs: 1, horizon: 1, set_point: 2, rows: 2, input_rows: 2 };
/// let data = QpData {
///     dims: DIMS,
///     hessian: &[2.0, 0.0, 0.0, 4.0],
///     linear_state: &[1.0, 0.0],
///     linear_set_point: &[0.0, 0.0, -4.0, 0.0],
///     rows: &[1.0, 0.5, -1.0, -0.5],
///     rows_state: &[0.3, -0.3],
///     gain: &[-0.3],
///     feedforward: &[0.5],
///     input_rows: &[1.0, -1.0],
/// };
/// // The two rows are opposite: one unit.
/// const GRAM: usize = DIMS.gram_len(1);
/// let mut buffer = [0.0_f64; DIMS.tables_len() + GRAM];
/// let (head, tail) = buffer.split_at_mut(DIMS.tables_len());
/// let tables = prepare(&data, head, &mut [0.0; DIMS.prepare_len()]).unwrap();
/// assert_eq!(tables.gram_len(), GRAM);
/// prepare_gram(&tables, tail).unwrap();
/// assert!(Tables::from_slice(DIMS, &buffer).unwrap().has_gram());
/// ```
pub fn prepare_gram<T: Scalar>(tables: &Tables<'_, T>, out: &mut [T]) -> Result<(), TableError> {
    let dims = tables.dims;
    let (n, nz, m, units) = (dims.states, dims.variables(), dims.inputs, tables.units());
    let expected = tables.gram_len();
    if out.len() != expected {
        return Err(TableError::Length {
            what: "products of rows",
            expected,
            found: out.len(),
        });
    }
    if units == 0 {
        return Ok(());
    }
    let (scale, rest) = out.split_at_mut(units);
    let (state, rest) = rest.split_at_mut(n * units);
    let (rows, rest) = rest.split_at_mut(nz * units);
    let (theta, products) = rest.split_at_mut(m * units);
    for unit in 0..units {
        let row = row_of(unit, tables.found.pairs);
        scale[unit] = tables.scale[row];
        for (l, &w) in tables.w_row(row).iter().enumerate() {
            state[l * units + unit] = w;
        }
        let image = &mut rows[unit * nz..(unit + 1) * nz];
        tables.root_transpose_mul(tables.g_row(row), image);
        for (j, &v) in image[nz - m..].iter().enumerate() {
            theta[j * units + unit] = v;
        }
    }
    for (row, of_row) in rows.chunks_exact(nz).zip(products.chunks_exact_mut(units)) {
        for (product, other) in of_row.iter_mut().zip(rows.chunks_exact(nz)) {
            *product = dot(row, other);
        }
    }
    match out.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(index) => Err(TableError::NotFinite {
            what: "products of rows",
            index,
        }),
    }
}

/// Checks products against the tables they belong to. Returns the number `κ` by which rounding makes residuals computed with them differ
/// from those of the rows: at most `κ` times the roundings of a term times `1 + ‖x‖_∞ + ‖v‖₂ + 2 Σ λ`, in units of right-hand sides.
///
/// The terms of a residual are `gᵀR⁻¹(v + Mᵀλ)` and `wᵀx`; `κ` is the largest `(‖|gᵀ||R⁻¹|‖₂ + ‖w‖₁ + s) / s`, and rows of `M`
/// are shorter than 2.
pub(crate) fn check<T: Scalar>(
    tables: &Tables<'_, T>,
    gram: &Gram<'_, T>,
) -> Result<T, TableError> {
    let dims = tables.dims;
    let (n, nz, m, units) = (dims.states, dims.variables(), dims.inputs, gram.units);
    let roundings = T::from_f64((4 * nz + 2 * n + 16) as f64) * T::EPSILON;
    let mut error = T::ZERO;
    for unit in 0..units {
        let row = row_of(unit, tables.found.pairs);
        let damaged = Err(TableError::Damaged { row });
        let w = tables.w_row(row);
        let is_state = (0..n).all(|l| gram.state[l * units + unit] == w[l]);
        if gram.scale[unit] != tables.scale[row] || !is_state {
            return damaged;
        }
        // |g| |R⁻¹|, entry by entry, and the entry of M.
        let image = &gram.rows[unit * nz..(unit + 1) * nz];
        let g = tables.g_row(row);
        let mut mass = T::ZERO;
        for (j, &found) in image.iter().enumerate() {
            let (mut size, mut value) = (T::ZERO, T::ZERO);
            for k in 0..=j {
                let term = g[k] * tables.root_inverse_entry(k, j);
                value += term;
                size += term.abs();
            }
            if !((found - value).abs() <= roundings * size) {
                return damaged;
            }
            mass += size * size;
        }
        if (0..m).any(|j| gram.theta[j * units + unit] != image[nz - m + j]) {
            return damaged;
        }
        for (other, &product) in gram.products_of(unit).iter().enumerate() {
            let row = &gram.rows[other * nz..(other + 1) * nz];
            let (mut size, mut value) = (T::ZERO, T::ZERO);
            for (&a, &b) in image.iter().zip(row) {
                value += a * b;
                size += (a * b).abs();
            }
            if !((product - value).abs() <= roundings * size) {
                return damaged;
            }
        }
        let of_state = w.iter().fold(T::ZERO, |sum, &v| sum + v.abs());
        let scale = tables.scale[row];
        error = error.max((mass.sqrt_upper() + of_state + scale) / scale);
    }
    if error.is_finite() {
        Ok(error)
    } else {
        Err(TableError::Dimensions)
    }
}
