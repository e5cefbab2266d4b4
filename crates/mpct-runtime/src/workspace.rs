//! Everything that changes, in two borrowed buffers.

use crate::dims::WORK_VECTORS;
use crate::factor::Factor;
use crate::pricing::Pricing;
use crate::{Dims, Scalar, TableError};

/// The memory of one controller: a slice of numbers ([`Dims::workspace_len`]) and a slice of indices ([`Dims::index_len`]).
///
/// Whatever the buffers contain at first is overwritten.
///
/// ```
/// use mpct_runtime::{Dims, Workspace};
/// const DIMS: Dims = Dims { states: 2, inputs: 1, horizon: 3, set_point: 3, rows: 20, input_rows: 2 };
/// let (mut numbers, mut indices) = ([0.0_f32; DIMS.workspace_len()], [0; DIMS.index_len()]);
/// assert!(Workspace::new(DIMS, &mut numbers, &mut indices).is_ok());
/// assert!(Workspace::new(DIMS, &mut numbers[1..], &mut indices).is_err());
/// ```
#[derive(Debug)]
pub struct Workspace<'a, T> {
    pub(crate) dims: Dims,
    pub(crate) factor: Factor<'a, T>,
    pub(crate) pricing: Pricing<'a, T>,
    /// Multipliers of the working set, scaled rows; always `≥ 0`.
    pub(crate) lambda: &'a mut [T],
    /// `F_r r`, kept while the set-point stays.
    pub(crate) linear_set_point: &'a mut [T],
    /// `f(x, r)`.
    pub(crate) linear: &'a mut [T],
    pub(crate) z: &'a mut [T],
    /// A movement of `z`.
    pub(crate) direction: &'a mut [T],
    /// Row of `M` under consideration, its coefficients and remainder.
    pub(crate) m: &'a mut [T],
    pub(crate) a: &'a mut [T],
    pub(crate) rho: &'a mut [T],
    /// Two halves, see `Factor::project`.
    pub(crate) half: &'a mut [T],
    /// The plan in force: the last accepted solution, shifted as time went by.
    pub(crate) plan: &'a mut [T],
    /// `H z + f`.
    pub(crate) gradient: &'a mut [T],
    /// `‖H z + f + G_Wᵀλ‖_∞` over the size of its terms, from the last settling.
    pub(crate) stationarity: T,
    pub(crate) set_point: &'a mut [T],
    /// The set-point is another one than at the last step, or there was none.
    pub(crate) has_jumped: bool,
    /// Nothing has changed since the last step.
    pub(crate) is_still: bool,
    pub(crate) x: &'a mut [T],
    pub(crate) input: &'a mut [T],
    /// Multiplier of the last row of a proof of infeasibility; the others are in `a`, the row numbers in `proof_rows`.
    pub(crate) proof_rows: &'a mut [u32],
    pub(crate) proof_len: usize,
    pub(crate) proof: &'a mut [T],
}

impl<'a, T: Scalar> Workspace<'a, T> {
    /// Divides the buffers. Errors: a length is wrong, a dimension is zero.
    pub fn new(
        dims: Dims,
        numbers: &'a mut [T],
        indices: &'a mut [u32],
    ) -> Result<Self, TableError> {
        dims.check()?;
        if numbers.len() != dims.workspace_len() {
            let (expected, found) = (dims.workspace_len(), numbers.len());
            return Err(TableError::Length {
                what: "workspace numbers",
                expected,
                found,
            });
        }
        if indices.len() != dims.index_len() {
            let (expected, found) = (dims.index_len(), indices.len());
            return Err(TableError::Length {
                what: "workspace indices",
                expected,
                found,
            });
        }
        numbers.fill(T::ZERO);
        indices.fill(0);
        Ok(Self::lay_out(dims, numbers, indices))
    }

    /// Divides buffers of the right lengths, whatever they contain.
    pub(crate) fn lay_out(dims: Dims, numbers: &'a mut [T], indices: &'a mut [u32]) -> Self {
        let nz = dims.variables();
        let mut rest = numbers;
        let mut take = |len: usize| {
            let (head, tail) = core::mem::take(&mut rest).split_at_mut(len);
            rest = tail;
            head
        };
        let (active, proof_rows) = indices.split_at_mut(nz);
        // Vectors of length nz: 2 for the factors, 1 for pricing, 13 below (`half` counts twice, `proof` has one more entry).
        const { assert!(WORK_VECTORS == 2 + 1 + 13) };
        Self {
            dims,
            factor: Factor::new(
                nz,
                active,
                take(nz * nz),
                take(nz * (nz - 1) / 2),
                take(nz),
                take(nz),
            ),
            pricing: Pricing::new(
                take(dims.rows),
                take(dims.row_blocks()),
                take(dims.rows),
                take(dims.states),
                take(nz),
            ),
            lambda: take(nz),
            linear_set_point: take(nz),
            linear: take(nz),
            z: take(nz),
            direction: take(nz),
            m: take(nz),
            a: take(nz),
            rho: take(nz),
            half: take(2 * nz),
            plan: take(nz),
            gradient: take(nz),
            stationarity: T::INFINITY,
            set_point: take(dims.set_point),
            has_jumped: true,
            is_still: false,
            x: take(dims.states),
            input: take(dims.inputs),
            proof_rows,
            proof_len: 0,
            proof: take(nz + 1),
        }
    }
}
