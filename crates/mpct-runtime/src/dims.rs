//! The sizes of a controller and of the arrays it needs.

use crate::TableError;

/// The sizes of one controller. All lengths are `const fn`, so arrays can be declared without a heap.
///
/// ```
/// use mpct_runtime::Dims;
/// const DIMS: Dims = Dims { states: 2, inputs: 2, horizon: 10, set_point: 4, rows: 120, input_rows: 4 };
/// static TABLES: [f32; DIMS.tables_len()] = [0.0; DIMS.tables_len()];
/// let workspace = [0.0_f32; DIMS.workspace_len()];
/// assert_eq!(DIMS.variables(), 22);
/// assert!(core::mem::size_of_val(&workspace) < 8 * 1024 && TABLES.len() < 6000);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dims {
    /// `n`.
    pub states: usize,
    /// `m`.
    pub inputs: usize,
    /// `N`.
    pub horizon: usize,
    /// Length of the set-point `r`, usually `n + m`.
    pub set_point: usize,
    /// Rows of `G`.
    pub rows: usize,
    /// Rows of `E` in `U = {u : E u ≤ 1}`; 0 when the tables do not know `U`.
    pub input_rows: usize,
}

impl Dims {
    /// `nz = (N + 1) m`.
    pub const fn variables(&self) -> usize {
        (self.horizon + 1) * self.inputs
    }

    /// Numbers in the tables:
    /// `nz² + nz(nz+1)/2 + nz (n + nr) + rows (nz + n + 4) + 3 blocks + m (n + m + input_rows)`, `blocks = ⌈rows/16⌉`.
    pub const fn tables_len(&self) -> usize {
        let nz = self.variables();
        nz * nz
            + nz * (nz + 1) / 2
            + nz * (self.states + self.set_point)
            + self.rows * (nz + self.states + 4)
            + 3 * self.row_blocks()
            + self.inputs * (self.states + self.inputs + self.input_rows)
    }

    /// Numbers of the products of rows, `units (1 + n + nz + m + units)`, which may follow the tables: see
    /// [`prepare_gram`](crate::prepare_gram). Opposite rows count once: `rows/2` units for symmetric bounds.
    pub const fn gram_len(&self, units: usize) -> usize {
        units * (1 + self.states + self.variables() + self.inputs + units)
    }

    /// Groups of 16 rows whose bounds of movement are looked at together.
    pub const fn row_blocks(&self) -> usize {
        self.rows.div_ceil(ROW_BLOCK)
    }

    /// Numbers [`prepare`](crate::prepare) needs while it runs: `nz`.
    pub const fn prepare_len(&self) -> usize {
        self.variables()
    }

    /// Numbers in the workspace: `nz² + nz(nz−1)/2 + 16 nz + 2 rows + blocks + 2 n + nr + m + 1`, `blocks = ⌈rows/16⌉`.
    pub const fn workspace_len(&self) -> usize {
        let nz = self.variables();
        nz * nz
            + nz * (nz - 1) / 2
            + WORK_VECTORS * nz
            + 2 * self.rows
            + self.row_blocks()
            + 2 * self.states
            + self.set_point
            + self.inputs
            + 1
    }

    /// Indices in the workspace: `2 nz + 1`.
    pub const fn index_len(&self) -> usize {
        2 * self.variables() + 1
    }

    pub(crate) fn check(&self) -> Result<(), TableError> {
        let nz = self
            .horizon
            .checked_add(1)
            .and_then(|s| s.checked_mul(self.inputs));
        let fits = |a: usize, b: usize| a.checked_mul(b).is_some_and(|p| p < usize::MAX / 64);
        match nz {
            Some(nz)
                if self.states > 0
                    && self.inputs > 0
                    && self.rows < u32::MAX as usize
                    && fits(nz, nz)
                    && fits(
                        nz.saturating_add(self.states).saturating_add(4),
                        self.rows.saturating_add(1),
                    )
                    && fits(nz, self.states.saturating_add(self.set_point))
                    && fits(
                        self.inputs,
                        self.states
                            .saturating_add(self.inputs)
                            .saturating_add(self.input_rows),
                    ) =>
            {
                Ok(())
            }
            _ => Err(TableError::Dimensions),
        }
    }
}

/// Rows whose bounds of movement are looked at together, see `pricing.rs`. Even, so that no pair of opposite rows is divided.
pub(crate) const ROW_BLOCK: usize = 16;

/// Vectors of length `nz` in the workspace, see `workspace.rs`.
pub(crate) const WORK_VECTORS: usize = 16;
