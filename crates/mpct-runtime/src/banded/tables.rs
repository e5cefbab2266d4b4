//! The constant data of a banded controller: borrowed arrays, checked against each other.
//!
//! ```text
//! min ½ zᵀHz + f(x, r)ᵀz   s.t.  −l ≤ G z + V x ≤ u,     f = F_x x + F_r r,     first input = K x + C z
//! ```
//!
//! `z` holds the same numbers as in the dense regime, (c_0, …, c_{N−1}, θ), in the order of the subsystems; states and
//! set-point likewise. A pair of opposite rows is stored once, with two bounds. Each pair is multiplied by a power of two that
//! brings ‖G_i D^(−1/2)‖, D the diagonal of H, into [1, 2): a violation then says how far the optimum has to move.

use super::Windows;
use super::movement::blocks_of;
use crate::dense::all_finite;
use crate::tables::NO_ROW;
use crate::{Scalar, TableError};
use core::ops::Range;

/// The arrays of a banded controller. [`BandedTables::new`] checks them.
#[derive(Clone, Copy, Debug)]
pub struct BandedData<'a, T> {
    /// H by rows of its upper triangle: the window of row `v` begins at column `v`.
    pub hessian: Windows<'a, T>,
    /// F_x: variables × states.
    pub linear_state: Windows<'a, T>,
    /// F_r: variables × set-point.
    pub linear_set_point: Windows<'a, T>,
    /// G: pairs × variables, scaled, ordered by first column.
    pub rows: Windows<'a, T>,
    /// V: pairs × states, scaled.
    pub rows_state: Windows<'a, T>,
    /// u, scaled; +∞ for none.
    pub upper: &'a [T],
    /// l, scaled; +∞ for none.
    pub lower: &'a [T],
    /// The powers of two that the pairs were multiplied by.
    pub scale: &'a [T],
    /// First pair of each group, and the number of pairs: neighbours that are looked at together.
    pub groups: &'a [u32],
    /// K: inputs × states.
    pub gain: Windows<'a, T>,
    /// C: inputs × variables; the first input is K x + C z.
    pub first_input: Windows<'a, T>,
    /// E of U = {u : E u ≤ 1}; may have no rows.
    pub input_rows: Windows<'a, T>,
    /// Where each state stands in the caller's order.
    pub state_order: &'a [u32],
    /// Where each set-point entry stands in the caller's order.
    pub set_point_order: &'a [u32],
    /// The variable that takes the place of each one a stage later; [`NO_ROW`] for the last stage, itself for θ.
    pub next_stage: &'a [u32],
}

/// Checked data of a banded controller.
#[derive(Clone, Copy, Debug)]
pub struct BandedTables<'a, T> {
    pub(crate) data: BandedData<'a, T>,
    factor: usize,
    weights: usize,
}

fn length(what: &'static str, expected: usize, found: usize) -> Result<(), TableError> {
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

/// The smallest range that covers both; an empty one covers nothing.
fn hull(a: Range<usize>, b: Range<usize>) -> Range<usize> {
    if b.is_empty() {
        a
    } else if a.is_empty() {
        b
    } else {
        a.start.min(b.start)..a.end.max(b.end)
    }
}

/// Every number below `count` occurs, in `order` of that length.
fn permutation(what: &'static str, order: &[u32]) -> Result<(), TableError> {
    // Without memory to mark what was seen: the sum and the sum of squares of a permutation are those of 0, …, count − 1.
    // A table that fools both gives a wrong controller, as any wrong number in it would, and no panic.
    let count = order.len() as u64;
    let (mut sum, mut squares) = (0_u64, 0_u64);
    for (index, &o) in order.iter().enumerate() {
        if u64::from(o) >= count {
            return Err(TableError::Order { what, index });
        }
        sum = sum.wrapping_add(u64::from(o));
        squares = squares.wrapping_add(u64::from(o) * u64::from(o));
    }
    let (mut of_all, mut of_squares) = (0_u64, 0_u64);
    for o in 0..count {
        of_all = of_all.wrapping_add(o);
        of_squares = of_squares.wrapping_add(o * o);
    }
    if (sum, squares) == (of_all, of_squares) {
        Ok(())
    } else {
        Err(TableError::Order {
            what,
            index: order.len(),
        })
    }
}

impl<'a, T: Scalar> BandedTables<'a, T> {
    /// Checks shapes, orders and windows: one pass over the index arrays, none over the values.
    ///
    /// Errors: [`TableError::Length`], [`TableError::Window`], [`TableError::Order`], [`TableError::Dimensions`].
    pub fn new(data: BandedData<'a, T>) -> Result<Self, TableError> {
        let (variables, pairs) = (data.hessian.rows(), data.rows.rows());
        let (inputs, states) = (data.gain.rows(), data.state_order.len());
        let set_point = data.set_point_order.len();
        if variables == 0 || inputs == 0 || states == 0 || pairs >= (u32::MAX / 2) as usize {
            return Err(TableError::Dimensions);
        }
        for (what, expected, found) in [
            ("columns of H", variables, data.hessian.columns()),
            ("rows of F_x", variables, data.linear_state.rows()),
            ("columns of F_x", states, data.linear_state.columns()),
            ("rows of F_r", variables, data.linear_set_point.rows()),
            ("columns of F_r", set_point, data.linear_set_point.columns()),
            ("columns of G", variables, data.rows.columns()),
            ("rows of V", pairs, data.rows_state.rows()),
            ("columns of V", states, data.rows_state.columns()),
            ("upper bounds", pairs, data.upper.len()),
            ("lower bounds", pairs, data.lower.len()),
            ("scales", pairs, data.scale.len()),
            ("columns of K", states, data.gain.columns()),
            ("rows of C", inputs, data.first_input.rows()),
            ("columns of C", variables, data.first_input.columns()),
            ("columns of E", inputs, data.input_rows.columns()),
            ("stages of variables", variables, data.next_stage.len()),
        ] {
            length(what, expected, found)?;
        }
        for v in 0..variables {
            // The diagonal leads its row.
            if data.hessian.window(v).start != v || data.hessian.row(v).is_empty() {
                return Err(TableError::Window { row: v });
            }
        }
        let mut before = 0;
        for pair in 0..pairs {
            let first = data.rows.window(pair).start;
            if first < before {
                return Err(TableError::Window { row: pair });
            }
            before = first;
        }
        permutation("the order of states", data.state_order)?;
        permutation("the order of the set-point", data.set_point_order)?;
        for (index, &next) in data.next_stage.iter().enumerate() {
            if next != NO_ROW && next as usize >= variables {
                return Err(TableError::Order {
                    what: "the stages of variables",
                    index,
                });
            }
        }
        let (mut last, groups) = (0, data.groups);
        if groups.first() != Some(&0) || groups.last().map(|&g| g as usize) != Some(pairs) {
            return Err(TableError::Order {
                what: "groups",
                index: 0,
            });
        }
        for (index, &g) in groups.iter().enumerate() {
            if g < last {
                return Err(TableError::Order {
                    what: "groups",
                    index,
                });
            }
            last = g;
        }
        let mut tables = Self {
            data,
            factor: 0,
            weights: 0,
        };
        let mut factor = 0_usize;
        tables.for_each_reach(|v, end| factor += end - v - 1);
        if factor >= u32::MAX as usize {
            return Err(TableError::Dimensions);
        }
        tables.factor = factor;
        for group in 0..tables.groups() {
            let [z, x] = tables.spans_of(group).map(|span| blocks_of(&span).len());
            tables.weights += 2 * z + x;
        }
        if tables.weights >= u32::MAX as usize {
            return Err(TableError::Dimensions);
        }
        Ok(tables)
    }

    /// One pass over all values: the first that is not a number the solver can use.
    ///
    /// Errors: [`TableError::NotFinite`]; [`TableError::Damaged`] when a scale or a bound is not positive;
    /// [`TableError::NotPositiveDefinite`] when a diagonal entry of H is not positive.
    pub fn check_values(&self) -> Result<(), TableError> {
        let d = &self.data;
        for (what, windows) in [
            ("H", &d.hessian),
            ("F_x", &d.linear_state),
            ("F_r", &d.linear_set_point),
            ("G", &d.rows),
            ("V", &d.rows_state),
            ("K", &d.gain),
            ("C", &d.first_input),
            ("E", &d.input_rows),
        ] {
            if let Some(index) = windows.first_not_finite() {
                return Err(TableError::NotFinite { what, index });
            }
        }
        for row in 0..self.pairs() {
            let scale = d.scale[row];
            let sound = scale > T::ZERO
                && all_finite(&[scale])
                && scale.inverse_power_of_two() * scale == T::ONE
                && d.upper[row] > T::ZERO
                && d.lower[row] > T::ZERO;
            if !sound {
                return Err(TableError::Damaged { row });
            }
        }
        for v in 0..self.variables() {
            let pivot = d.hessian.row(v)[0];
            if !(pivot > T::ZERO) {
                return Err(TableError::NotPositiveDefinite {
                    index: v,
                    pivot: pivot.to_f64(),
                });
            }
        }
        Ok(())
    }

    /// Calls `f(v, end)`: column v of the factor of H + ρ GᵀG has entries in the rows v + 1, …, end − 1. Ends never descend.
    pub(crate) fn for_each_reach(&self, mut f: impl FnMut(usize, usize)) {
        let (mut pair, mut end) = (0, 0);
        for v in 0..self.variables() {
            end = end.max(self.data.hessian.window(v).end).max(v + 1);
            while pair < self.pairs() && self.data.rows.window(pair).start <= v {
                end = end.max(self.data.rows.window(pair).end);
                pair += 1;
            }
            f(v, end);
        }
    }

    /// The pairs of a group.
    pub(crate) fn pairs_of(&self, group: usize) -> Range<usize> {
        self.data.groups[group] as usize..self.data.groups[group + 1] as usize
    }

    /// What the rows of a group touch: variables, states. The first variables of groups never descend.
    pub(crate) fn spans_of(&self, group: usize) -> [Range<usize>; 2] {
        let mut spans = [0..0, 0..0];
        if let Some(first) = self.data.groups.get(group)
            && (*first as usize) < self.pairs()
        {
            let first = self.data.rows.window(*first as usize).start;
            spans[0] = first..first;
        }
        for pair in self.pairs_of(group) {
            let windows = [
                self.data.rows.window(pair),
                self.data.rows_state.window(pair),
            ];
            for (span, window) in spans.iter_mut().zip(windows) {
                *span = hull(span.clone(), window);
            }
        }
        spans
    }

    /// 0 for an entry of c, 1 for one of θ.
    #[inline(always)]
    pub(crate) fn part(&self, v: usize) -> usize {
        usize::from(self.data.next_stage[v] as usize == v)
    }

    /// Weights of blocks, see `movement.rs`.
    pub(crate) fn weights(&self) -> usize {
        self.weights
    }

    /// Variables nz.
    pub fn variables(&self) -> usize {
        self.data.hessian.rows()
    }

    /// Pairs of rows.
    pub fn pairs(&self) -> usize {
        self.data.rows.rows()
    }

    /// Groups of pairs.
    pub fn groups(&self) -> usize {
        self.data.groups.len() - 1
    }

    /// States n.
    pub fn states(&self) -> usize {
        self.data.state_order.len()
    }

    /// Inputs m.
    pub fn inputs(&self) -> usize {
        self.data.gain.rows()
    }

    /// Entries of the set-point.
    pub fn set_point(&self) -> usize {
        self.data.set_point_order.len()
    }

    /// Entries of the factor below its diagonal.
    pub fn factor_entries(&self) -> usize {
        self.factor
    }

    /// Numbers a controller needs: `factor + 10 nz + 2 ⌈max(nz, n)/8⌉ + n + nr + m + 9 pairs + 6 groups + weights`, a weight for c and
    /// one for θ of every block of 8 variables and one of every block of 8 states that the rows of a group touch; see [`super`].
    pub fn workspace_len(&self) -> usize {
        super::workspace::numbers(self)
    }

    /// Indices of 4 bytes a controller needs: `2 nz + 1 + 3 pairs + 6 groups`.
    pub fn index_len(&self) -> usize {
        super::workspace::indices(self)
    }
}
