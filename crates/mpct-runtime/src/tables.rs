//! Everything about the problem that never changes, in one borrowed slice.
//!
//! ```text
//! min ½ zᵀHz + f(x, r)ᵀz   s.t.  G z ≤ b(x),     f = F_x x + F_r r,   b = 1 + W x,   u = K x + L θ + c_0
//! z = (c_0, …, c_{N−1}, θ)
//! ```
//!
//! With `H = RᵀR` and `w = R (z + H⁻¹f)` this is a least-distance problem: `min ½ |w|²  s.t.  M w ≤ b + G H⁻¹f`, `M = G R⁻¹`. The tables hold `R⁻¹`; the rows of `M` are formed when a row becomes
//! active, so that `G` is stored once only.
//!
//! Two things are looked for when tables are read, and used when found: a Hessian that is block diagonal (every `c_j` and `θ` apart, as for the
//! LQR gain), and opposite rows that stand together (`±`, as from symmetric bounds), which share one product.
//!
//! Every row of `(G, W, 1)` is multiplied by a power of two that brings its row of `M` to a length in `[1, 2)`.
//! Powers of two are exact: the stored rows *are* the rows of the problem.

use crate::dense::{all_finite, dot, max_abs};
use crate::dims::ROW_BLOCK;
use crate::gram::{self, Gram};
use crate::{Dims, Scalar, TableError};

/// The constant data of one controller, borrowed. See the module text for the formulas.
///
/// Made by [`prepare`](crate::prepare) or, from an array in flash, by [`Tables::from_slice`].
///
/// ```
/// use mpct_runtime::{prepare, Dims, QpData, Tables};
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
/// let mut buffer = [0.0_f64; DIMS.tables_len()];
/// let mut scratch = [0.0; DIMS.prepare_len()];
/// let tables = prepare(&data, &mut buffer, &mut scratch).unwrap();
/// assert_eq!(tables.dims().variables(), 2);
/// // The same from an exported array:
/// let exported: [f64; DIMS.tables_len()] = buffer;
/// assert!(Tables::from_slice(DIMS, &exported).is_ok());
/// assert!(Tables::from_slice(DIMS, &exported[1..]).is_err());
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Tables<'a, T> {
    pub(crate) dims: Dims,
    /// `H`, `nz × nz`.
    pub(crate) hessian: &'a [T],
    /// `R⁻¹`, upper triangle by rows.
    pub(crate) root_inverse: &'a [T],
    /// `F_x`, `nz × n`.
    pub(crate) linear_state: &'a [T],
    /// `F_r`, `nz × nr`.
    pub(crate) linear_set_point: &'a [T],
    /// `G`, scaled, `rows × nz`.
    pub(crate) g: &'a [T],
    /// `W`, scaled, `rows × n`.
    pub(crate) w: &'a [T],
    /// The scales: powers of two.
    pub(crate) scale: &'a [T],
    /// Bound of how much a row moves per unit of `c`, of `θ` and of `x` (2-norms of the parts of the row, rounded up).
    pub(crate) reach: [&'a [T]; 3],
    /// The largest of each part of `reach` in every group of 16 rows.
    pub(crate) block_reach: [&'a [T]; 3],
    /// What was found about the entries.
    pub(crate) found: Found<T>,
    /// `K`, `m × n`.
    pub(crate) gain: &'a [T],
    /// `L`, `m × m`.
    pub(crate) feedforward: &'a [T],
    /// `E` of `U = {u : E u ≤ 1}`, `input_rows × m`.
    pub(crate) input_rows: &'a [T],
    /// Row index one stage earlier, or [`NO_ROW`].
    pub(crate) shift: Option<&'a [u32]>,
    /// Products of rows, when the slice had them.
    pub(crate) gram: Option<Gram<'a, T>>,
}

/// What reading the entries of tables found.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found<T> {
    /// The largest of each part of `reach`, per unit of right-hand side.
    pub reach_max: [T; 3],
    /// Largest `|H_jk|` in the rows of `c` and in the rows of `θ`.
    pub hessian_max: [T; 2],
    /// `H` has no entry outside diagonal blocks of this size: `m`, or `nz` when it is not block diagonal.
    pub block: usize,
    /// Rows of `F_x` before the first are zero, rows of `F_r` before the second.
    pub linear_from: [usize; 2],
    /// Rows `2 k` and `2 k + 1` are opposite for every `k` below this.
    pub pairs: usize,
    /// How rounding shows in residuals computed with the products of rows, see `gram::check`; infinite without products.
    pub gram_error: T,
}

/// What a check of tables found; see [`Tables::stamp`].
#[derive(Clone, Copy, Debug)]
pub struct TablesStamp<T> {
    pub(crate) dims: Dims,
    found: Found<T>,
}

impl<T> TablesStamp<T> {
    /// The dimensions of the tables.
    pub fn dims(&self) -> Dims {
        self.dims
    }
}

/// "No row one stage earlier" in a shift map.
pub const NO_ROW: u32 = u32::MAX;

/// The tables, and what follows them.
fn divide<T>(dims: Dims, slice: &[T]) -> Result<(&[T], &[T]), TableError> {
    slice
        .split_at_checked(dims.tables_len())
        .ok_or(TableError::Length {
            what: "tables",
            expected: dims.tables_len(),
            found: slice.len(),
        })
}

impl<'a, T: Scalar> Tables<'a, T> {
    /// Divides a slice of the right length.
    fn lay_out(dims: Dims, slice: &'a [T]) -> Self {
        let (n, m, nz, nr, rows) = (
            dims.states,
            dims.inputs,
            dims.variables(),
            dims.set_point,
            dims.rows,
        );
        let mut rest = slice;
        let mut take = |len: usize| {
            let (head, tail) = rest.split_at(len);
            rest = tail;
            head
        };
        Self {
            dims,
            hessian: take(nz * nz),
            root_inverse: take(nz * (nz + 1) / 2),
            linear_state: take(nz * n),
            linear_set_point: take(nz * nr),
            g: take(rows * nz),
            w: take(rows * n),
            scale: take(rows),
            reach: [take(rows), take(rows), take(rows)],
            block_reach: [
                take(dims.row_blocks()),
                take(dims.row_blocks()),
                take(dims.row_blocks()),
            ],
            found: Found {
                reach_max: [T::ZERO; 3],
                hessian_max: [T::ZERO; 2],
                block: nz,
                linear_from: [0; 2],
                pairs: 0,
                gram_error: T::INFINITY,
            },
            gain: take(m * n),
            feedforward: take(m * m),
            input_rows: take(dims.input_rows * m),
            shift: None,
            gram: None,
        }
    }

    /// Reads again a slice that [`Tables::from_slice`] has accepted, without checking its entries. Other tables give other
    /// inputs, and the inputs of tables that are not finite are worth nothing, but nothing panics.
    ///
    /// Errors: the length.
    pub fn reopen(stamp: TablesStamp<T>, slice: &'a [T]) -> Result<Self, TableError> {
        let (head, products) = divide(stamp.dims, slice)?;
        let mut tables = Self::lay_out(stamp.dims, head);
        tables.found = stamp.found;
        // Products that were not checked, or found of no use, stay out.
        let is_checked = stamp.found.gram_error.is_finite();
        tables.gram = tables.lay_out_gram(products)?.filter(|_| is_checked);
        Ok(tables)
    }

    /// What a check of these tables found, for [`Tables::reopen`].
    pub fn stamp(&self) -> TablesStamp<T> {
        TablesStamp {
            dims: self.dims,
            found: self.found,
        }
    }

    /// Reads tables of length [`Dims::tables_len`], as written by [`prepare`](crate::prepare). They may be followed by the products of
    /// [`prepare_gram`](crate::prepare_gram), which are checked against the rows and make steps faster.
    ///
    /// Costs one pass over the rows, once. Errors: length, an entry that is not finite, damaged rows.
    /// Example: see [`Tables`].
    pub fn from_slice(dims: Dims, slice: &'a [T]) -> Result<Self, TableError> {
        dims.check()?;
        let (head, products) = divide(dims, slice)?;
        if let Some(index) = slice.iter().position(|v| !v.is_finite()) {
            return Err(TableError::NotFinite {
                what: "tables",
                index,
            });
        }
        let mut tables = Self::lay_out(dims, head);
        let (nz, m, rows) = (dims.variables(), dims.inputs, dims.rows);
        let (of_c, of_theta) = tables.hessian.split_at((nz - m) * nz);
        tables.found.hessian_max = [max_abs(of_c), max_abs(of_theta)];
        for row in 0..rows {
            let scale = tables.scale[row];
            if !(scale > T::ZERO) || scale.inverse_power_of_two() * scale != T::ONE {
                return Err(TableError::Damaged { row });
            }
            let (c, theta) = tables.g_row(row).split_at(nz - m);
            for (part, group) in [c, theta, tables.w_row(row)].into_iter().enumerate() {
                let reach = tables.reach[part][row];
                if !(reach * reach >= dot(group, group)) {
                    return Err(TableError::Damaged { row });
                }
                if !(tables.block_reach[part][row / ROW_BLOCK] >= reach) {
                    return Err(TableError::Damaged { row });
                }
                tables.found.reach_max[part] = tables.found.reach_max[part].max(reach / scale);
            }
        }
        if !all_finite(&tables.found.reach_max) {
            return Err(TableError::Dimensions);
        }
        tables.found.block = if tables.is_block_diagonal() { m } else { nz };
        let first = |m: &[T], width: usize| {
            m.iter()
                .position(|&v| v != T::ZERO)
                .map_or(nz, |i| i / width)
        };
        tables.found.linear_from = [
            first(tables.linear_state, dims.states),
            first(tables.linear_set_point, dims.set_point.max(1)),
        ];
        tables.found.pairs = (0..rows / 2)
            .position(|k| !tables.is_pair(2 * k))
            .unwrap_or(rows / 2);
        tables.with_gram(products)
    }

    /// The same tables with the products of their rows, checked; the same without products.
    pub(crate) fn with_gram(mut self, products: &'a [T]) -> Result<Self, TableError> {
        let Some(gram) = self.lay_out_gram(products)? else {
            return Ok(self);
        };
        let error = gram::check(&self, &gram)?;
        // Where rounding alone is beyond the tolerance, as in f32, the rows would have to be asked every time.
        if error * T::from_f64(gram::LEAST) * T::EPSILON <= T::HALF * T::PRIMAL {
            (self.gram, self.found.gram_error) = (Some(gram), error);
        }
        Ok(self)
    }

    fn lay_out_gram(&self, products: &'a [T]) -> Result<Option<Gram<'a, T>>, TableError> {
        if products.is_empty() {
            return Ok(None);
        }
        if products.len() != self.gram_len() {
            return Err(TableError::Length {
                what: "products of rows after the tables",
                expected: self.gram_len(),
                found: products.len(),
            });
        }
        Ok(Some(Gram::lay_out(self.dims, self.units(), products)))
    }

    /// Rows of which opposite ones, when they stand together, count once.
    pub(crate) fn units(&self) -> usize {
        self.dims.rows - self.found.pairs
    }

    /// Length of the products of rows that [`prepare_gram`](crate::prepare_gram) writes for these tables.
    pub fn gram_len(&self) -> usize {
        self.dims.gram_len(self.units())
    }

    /// Whether the slice had products of rows after the tables that the solver uses: in `f32` their rounding is beyond its tolerance.
    pub fn has_gram(&self) -> bool {
        self.gram.is_some()
    }

    /// The same tables with a shift map (length `rows`): entry `i` is the row that says one stage earlier what row `i` says,
    /// or [`NO_ROW`]. With it the active set can be warm started from the shifted solution.
    ///
    /// Errors: length, a row that does not exist.
    pub fn with_shift(mut self, shift: &'a [u32]) -> Result<Self, TableError> {
        if shift.len() != self.dims.rows {
            return Err(TableError::Length {
                what: "shift map",
                expected: self.dims.rows,
                found: shift.len(),
            });
        }
        for (row, &found) in shift.iter().enumerate() {
            if found != NO_ROW && found as usize >= self.dims.rows {
                return Err(TableError::Shift { row, found });
            }
        }
        self.shift = Some(shift);
        Ok(self)
    }

    /// The dimensions.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// Row `row` of `G`, scaled by [`Tables::row_scale`]. Panics when the row does not exist.
    pub fn g_row(&self, row: usize) -> &'a [T] {
        let nz = self.dims.variables();
        &self.g[row * nz..(row + 1) * nz]
    }

    /// Row `row` of `W`, scaled. Panics when the row does not exist.
    pub fn w_row(&self, row: usize) -> &'a [T] {
        let n = self.dims.states;
        &self.w[row * n..(row + 1) * n]
    }

    /// The power of two that row `row` of `(G, W, 1)` was multiplied by. Panics when the row does not exist.
    pub fn row_scale(&self, row: usize) -> T {
        self.scale[row]
    }

    /// `H`, `nz × nz`, row-major.
    pub fn hessian(&self) -> &'a [T] {
        self.hessian
    }

    /// Whether `H` and `R⁻¹` have no entry outside diagonal blocks of `m`.
    fn is_block_diagonal(&self) -> bool {
        let (nz, m) = (self.dims.variables(), self.dims.inputs);
        let mut rest = self.root_inverse;
        (0..nz).all(|k| {
            let first = k / m * m;
            let (head, tail) = rest.split_at(nz - k);
            rest = tail;
            let row = &self.hessian[k * nz..(k + 1) * nz];
            let outside = row[..first].iter().chain(&row[first + m..]);
            outside.chain(&head[first + m - k..]).all(|&v| v == T::ZERO)
        })
    }

    /// Whether rows `row` and `row + 1` are opposite, to the last bit.
    fn is_pair(&self, row: usize) -> bool {
        let opposite = |a: &[T], b: &[T]| a.iter().zip(b).all(|(&a, &b)| a == -b);
        self.scale[row] == self.scale[row + 1]
            && opposite(self.g_row(row), self.g_row(row + 1))
            && opposite(self.w_row(row), self.w_row(row + 1))
    }

    /// Entry `(k, j)` of `R⁻¹`, `k ≤ j`.
    pub(crate) fn root_inverse_entry(&self, k: usize, j: usize) -> T {
        let nz = self.dims.variables();
        self.root_inverse[k * nz - k * k.saturating_sub(1) / 2 + j - k]
    }

    /// `Gᵢz − bᵢ(x)` of the scaled row: positive when violated.
    #[inline(always)]
    pub(crate) fn residual(&self, row: usize, x: &[T], z: &[T]) -> T {
        dot(self.g_row(row), z) - self.bound(row, x)
    }

    /// `bᵢ(x)`, scaled.
    #[inline(always)]
    pub(crate) fn bound(&self, row: usize, x: &[T]) -> T {
        self.scale[row] + dot(self.w_row(row), x)
    }
}
