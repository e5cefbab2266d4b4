//! From the matrices of a problem to its tables: once, on the desk or at start-up.

use crate::dense::{dot, upper_transpose_mul};
use crate::dims::ROW_BLOCK;
use crate::gram::prepare_gram;
use crate::{Dims, Scalar, TableError, Tables};

/// The matrices of one controller, all row-major. See [`Tables`] for an example.
#[derive(Clone, Copy, Debug)]
pub struct QpData<'a, T> {
    /// The sizes.
    pub dims: Dims,
    /// `H`, `nz × nz`, symmetric positive definite.
    pub hessian: &'a [T],
    /// `F_x`, `nz × n`.
    pub linear_state: &'a [T],
    /// `F_r`, `nz × nr`.
    pub linear_set_point: &'a [T],
    /// `G`, `rows × nz`.
    pub rows: &'a [T],
    /// `W`, `rows × n`: `b(x) = 1 + W x`.
    pub rows_state: &'a [T],
    /// `K`, `m × n`.
    pub gain: &'a [T],
    /// `L`, `m × m`.
    pub feedforward: &'a [T],
    /// `E`, `input_rows × m`: `U = {u : E u ≤ 1}`.
    pub input_rows: &'a [T],
}

/// Writes the tables of `data` into `out` (length [`Dims::tables_len`]) and reads them back.
///
/// `scratch` has length [`Dims::prepare_len`]. Cost: `O(nz³ + nz²(n + nr + rows))`.
/// Errors: a wrong length, an entry that is not finite, an `H` that is not positive definite.
/// Example: see [`Tables`].
pub fn prepare<'t, T: Scalar>(
    data: &QpData<'_, T>,
    out: &'t mut [T],
    scratch: &mut [T],
) -> Result<Tables<'t, T>, TableError> {
    let dims = data.dims;
    dims.check()?;
    let (n, m, nz, nr, rows) = (
        dims.states,
        dims.inputs,
        dims.variables(),
        dims.set_point,
        dims.rows,
    );
    expect("tables", dims.tables_len(), out.len())?;
    expect("scratch", dims.prepare_len(), scratch.len())?;
    for (what, slice, len) in [
        ("hessian", data.hessian, nz * nz),
        ("linear_state", data.linear_state, nz * n),
        ("linear_set_point", data.linear_set_point, nz * nr),
        ("rows", data.rows, rows * nz),
        ("rows_state", data.rows_state, rows * n),
        ("gain", data.gain, m * n),
        ("feedforward", data.feedforward, m * m),
        ("input_rows", data.input_rows, dims.input_rows * m),
    ] {
        expect(what, len, slice.len())?;
        if let Some(index) = slice.iter().position(|v| !v.is_finite()) {
            return Err(TableError::NotFinite { what, index });
        }
    }

    let mut rest = &mut *out;
    let hessian = take(&mut rest, nz * nz);
    hessian.copy_from_slice(data.hessian);
    let root = take(&mut rest, nz * (nz + 1) / 2);
    cholesky_packed(nz, hessian, root)?;
    invert_upper_packed(nz, root);
    take(&mut rest, nz * n).copy_from_slice(data.linear_state);
    take(&mut rest, nz * nr).copy_from_slice(data.linear_set_point);

    let g = take(&mut rest, rows * nz);
    let w = take(&mut rest, rows * n);
    let scale = take(&mut rest, rows);
    let reach = [
        take(&mut rest, rows),
        take(&mut rest, rows),
        take(&mut rest, rows),
    ];
    for row in 0..rows {
        let given = &data.rows[row * nz..(row + 1) * nz];
        let image = &mut scratch[..nz];
        upper_transpose_mul(root, given, image);
        scale[row] = row_scale(dot(image, image).sqrt_core());
        let g_row = &mut g[row * nz..(row + 1) * nz];
        let w_row = &mut w[row * n..(row + 1) * n];
        scaled_copy(scale[row], given, g_row);
        scaled_copy(scale[row], &data.rows_state[row * n..(row + 1) * n], w_row);
        let (c, theta) = g_row.split_at(nz - m);
        reach[0][row] = norm_upper(c);
        reach[1][row] = norm_upper(theta);
        reach[2][row] = norm_upper(w_row);
    }
    for reach in &reach {
        block_maxima(reach, take(&mut rest, dims.row_blocks()));
    }
    take(&mut rest, m * n).copy_from_slice(data.gain);
    take(&mut rest, m * m).copy_from_slice(data.feedforward);
    take(&mut rest, dims.input_rows * m).copy_from_slice(data.input_rows);
    Tables::from_slice(dims, out)
}

/// Copies tables into another number type, say from the desk's `f64` to the target's `f32`.
///
/// Better than [`prepare`] in `f32`: the factorisation keeps the accuracy of the source. Products of rows
/// ([`prepare_gram`]) that follow the tables are computed anew, or left away when `to` ends with the tables.
/// Errors: a wrong length, a number that does not fit.
///
/// ```
/// # use mpct_runtime::{prepare, cast_tables, Dims, QpData};
/// # const DIMS: Dims = Dims { states: 1, inputs: 1, horizon: 0, set_point: 0, rows: 1, input_rows: 0 };
/// # let data = QpData { dims: DIMS, hessian: &[2.0], linear_state: &[1.0], linear_set_point: &[], rows: &[0.1],
/// #     rows_state: &[0.3], gain: &[-0.3], feedforward: &[0.5], input_rows: &[] };
/// # let (mut buffer, mut scratch) = ([0.0_f64; DIMS.tables_len()], [0.0; DIMS.prepare_len()]);
/// prepare(&data, &mut buffer, &mut scratch).unwrap();
/// let mut single = [0.0_f32; DIMS.tables_len()];
/// let tables = cast_tables(DIMS, &buffer, &mut single).unwrap();
/// assert_eq!(tables.hessian(), &[2.0_f32]);
/// ```
pub fn cast_tables<'t, T: Scalar, U: Scalar>(
    dims: Dims,
    from: &[T],
    to: &'t mut [U],
) -> Result<Tables<'t, U>, TableError> {
    dims.check()?;
    if from.len() < dims.tables_len() {
        expect("tables", dims.tables_len(), from.len())?;
    }
    if to.len() != dims.tables_len() {
        expect("tables", from.len(), to.len())?;
    }
    let (to, products) = to.split_at_mut(dims.tables_len());
    for (target, source) in to.iter_mut().zip(from) {
        *target = U::from_f64(source.to_f64());
    }
    // The bounds of movement must be bounds of the rounded rows.
    let (n, m, nz, rows) = (dims.states, dims.inputs, dims.variables(), dims.rows);
    let start = nz * nz + nz * (nz + 1) / 2 + nz * (n + dims.set_point);
    let (matrices, vectors) = to[start..].split_at_mut(rows * (nz + n));
    let (g, w) = matrices.split_at(rows * nz);
    for row in 0..rows {
        let (c, theta) = g[row * nz..(row + 1) * nz].split_at(nz - m);
        vectors[rows + row] = norm_upper(c);
        vectors[2 * rows + row] = norm_upper(theta);
        vectors[3 * rows + row] = norm_upper(&w[row * n..(row + 1) * n]);
    }
    let (vectors, blocks) = vectors.split_at_mut(4 * rows);
    let parts = blocks.chunks_exact_mut(dims.row_blocks().max(1));
    for (reach, blocks) in vectors[rows..].chunks_exact(rows.max(1)).zip(parts) {
        block_maxima(reach, blocks);
    }
    let tables = Tables::from_slice(dims, to)?;
    if products.is_empty() {
        return Ok(tables);
    }
    // Products of the rounded rows, not rounded products.
    prepare_gram(&tables, products)?;
    tables.with_gram(products)
}

fn expect(what: &'static str, expected: usize, found: usize) -> Result<(), TableError> {
    if expected == found {
        Ok(())
    } else {
        Err(TableError::Length {
            what,
            expected,
            found,
        })
    }
}

fn take<'s, T>(rest: &mut &'s mut [T], len: usize) -> &'s mut [T] {
    let (head, tail) = core::mem::take(rest).split_at_mut(len);
    *rest = tail;
    head
}

fn scaled_copy<T: Scalar>(scale: T, from: &[T], to: &mut [T]) {
    for (target, &source) in to.iter_mut().zip(from) {
        *target = scale * source;
    }
}

/// `‖x‖₂`, rounded up.
fn norm_upper<T: Scalar>(x: &[T]) -> T {
    dot(x, x).sqrt_core() * (T::ONE + T::from_f64(64.0) * T::EPSILON)
}

/// The largest of every group of rows.
fn block_maxima<T: Scalar>(reach: &[T], blocks: &mut [T]) {
    for (block, group) in blocks.iter_mut().zip(reach.chunks(ROW_BLOCK)) {
        *block = group.iter().fold(T::ZERO, |a, &v| a.max(v));
    }
}

/// The power of two that brings `length` into `[1, 2)`, within bounds.
fn row_scale<T: Scalar>(length: T) -> T {
    let scale = length.inverse_power_of_two();
    if scale <= T::MAX_ROW_SCALE && scale * T::MAX_ROW_SCALE >= T::ONE {
        scale
    } else {
        T::ONE
    }
}

/// Where row `k` of a packed upper triangle begins, minus `k`: entry `(k, j)` is at `base + j`.
fn base(nz: usize, k: usize) -> usize {
    k * nz - k * (k + 1) / 2
}

/// `R` with `RᵀR = H`, upper triangle by rows.
fn cholesky_packed<T: Scalar>(nz: usize, h: &[T], r: &mut [T]) -> Result<(), TableError> {
    for k in 0..nz {
        for j in k..nz {
            let mut sum = h[k * nz + j];
            for p in 0..k {
                sum -= r[base(nz, p) + k] * r[base(nz, p) + j];
            }
            r[base(nz, k) + j] = sum;
        }
        let pivot = r[base(nz, k) + k];
        // A pivot that is all rounding is as bad as a negative one.
        if !(pivot > T::EPSILON * h[k * nz + k]) {
            return Err(TableError::NotPositiveDefinite {
                index: k,
                pivot: pivot.to_f64(),
            });
        }
        let inverse = T::ONE / pivot.sqrt_core();
        for j in k..nz {
            let entry = &mut r[base(nz, k) + j];
            *entry = *entry * inverse;
        }
    }
    Ok(())
}

/// `R⁻¹` in place of `R`.
fn invert_upper_packed<T: Scalar>(nz: usize, r: &mut [T]) {
    for j in 0..nz {
        let diagonal = T::ONE / r[base(nz, j) + j];
        for i in 0..j {
            let mut sum = T::ZERO;
            for k in i..j {
                sum += r[base(nz, i) + k] * r[base(nz, k) + j];
            }
            r[base(nz, i) + j] = -sum * diagonal;
        }
        r[base(nz, j) + j] = diagonal;
    }
}
