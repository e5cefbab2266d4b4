//! A matrix whose rows are stored from their first to their last entry.
//!
//! With variables in the order of the subsystems, what a row of the problem touches lies close together: a window. Inside
//! of a window everything is contiguous, so products are those of dense vectors, and no column index is read.

use crate::dense::{axpy, long_dot};
use crate::{Scalar, TableError};
use core::ops::Range;

/// Rows of a matrix, one window each: row `i` has its entries in the columns `first[i] .. first[i] + start[i+1] − start[i]`.
///
/// ```
/// use mpct_runtime::banded::Windows;
/// // [1 2 0]
/// // [0 3 4]
/// let a = Windows::new(3, &[0, 1], &[0, 2, 4], &[1.0, 2.0, 3.0, 4.0]).unwrap();
/// assert_eq!(a.dot(0, &[1.0, 1.0, 1.0]), 3.0);
/// assert_eq!(a.dot(1, &[1.0, 1.0, 1.0]), 7.0);
/// // A window that leaves the matrix is refused.
/// assert!(Windows::new(3, &[2], &[0, 2], &[1.0, 2.0]).is_err());
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Windows<'a, T> {
    columns: usize,
    first: &'a [u32],
    start: &'a [u32],
    values: &'a [T],
}

impl<'a, T: Scalar> Windows<'a, T> {
    /// The rows; `start` has one entry more than `first`. Costs one pass over `first` and `start`.
    ///
    /// Errors: [`TableError::Length`] of `start` or `values`; [`TableError::Window`] when a window leaves the matrix or
    /// the starts descend.
    pub fn new(
        columns: usize,
        first: &'a [u32],
        start: &'a [u32],
        values: &'a [T],
    ) -> Result<Self, TableError> {
        if start.len() != first.len() + 1 {
            return Err(TableError::Length {
                what: "starts of windows",
                expected: first.len() + 1,
                found: start.len(),
            });
        }
        let mut before = 0;
        for (row, (&column, ends)) in first.iter().zip(start.windows(2)).enumerate() {
            let (from, to) = (ends[0] as usize, ends[1] as usize);
            let fits = from == before
                && to >= from
                && (column as usize)
                    .checked_add(to - from)
                    .is_some_and(|end| end <= columns);
            if !fits {
                return Err(TableError::Window { row });
            }
            before = to;
        }
        if values.len() != before {
            return Err(TableError::Length {
                what: "values of windows",
                expected: before,
                found: values.len(),
            });
        }
        Ok(Self {
            columns,
            first,
            start,
            values,
        })
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.first.len()
    }

    /// Columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Stored entries.
    pub fn entries(&self) -> usize {
        self.values.len()
    }

    /// Whether every entry is finite.
    pub fn first_not_finite(&self) -> Option<usize> {
        self.values.iter().position(|v| !v.is_finite())
    }

    /// The columns of row `row`. Panics when the row does not exist.
    #[inline(always)]
    pub fn window(&self, row: usize) -> Range<usize> {
        let first = self.first[row] as usize;
        first..first + (self.start[row + 1] - self.start[row]) as usize
    }

    /// The entries of row `row`. Panics when the row does not exist.
    #[inline(always)]
    pub fn row(&self, row: usize) -> &'a [T] {
        &self.values[self.start[row] as usize..self.start[row + 1] as usize]
    }

    /// Row `row` times `x`. Panics when the row does not exist or `x` has fewer entries than there are columns.
    #[inline(always)]
    pub fn dot(&self, row: usize, x: &[T]) -> T {
        long_dot(self.row(row), &x[self.window(row)])
    }

    /// `out += s ·` row `row`.
    #[inline(always)]
    pub(crate) fn add_row(&self, row: usize, s: T, out: &mut [T]) {
        axpy(s, self.row(row), &mut out[self.window(row)]);
    }

    /// `out += A x`.
    pub(crate) fn add_product(&self, x: &[T], out: &mut [T]) {
        for (row, o) in out.iter_mut().enumerate().take(self.rows()) {
            *o += self.dot(row, x);
        }
    }
}

/// `out += H x` of a symmetric `H` of which row `v` holds the columns `v, v + 1, …`.
pub(crate) fn add_symmetric_product<T: Scalar>(h: &Windows<'_, T>, x: &[T], out: &mut [T]) {
    for v in 0..h.rows() {
        let row = h.row(v);
        let Some((&diagonal, rest)) = row.split_first() else {
            continue;
        };
        let after = v + 1..v + row.len();
        out[v] += diagonal * x[v] + long_dot(rest, &x[after.clone()]);
        axpy(x[v], rest, &mut out[after]);
    }
}
