//! How far rows can have moved since they were measured, without looking at them.
//!
//! Variables and states are cut into blocks. A movement of `z` moves row `i` by at most `Σ_b ‖G_{i,b} D^(−1/2)‖ · ‖D^(1/2) Δz_b‖`; the c part and the θ part
//! of a block count apart, because the offset cost makes D^(1/2) θ a hundred times larger than what it does. The rows of a group share the
//! weights `ω_b`, the largest of these norms, and each row has three shares `φ_i ≤ 1`, of c, of θ and of x, with `‖G_{i,b} D^(−1/2)‖ ≤ φ_i ω_b` in every
//! block. So a movement costs a group one short product, and a row three multiplications when somebody asks. Everything is in units
//! of right-hand sides, in which a slack is at most 1 or 2.

use super::tables::BandedTables;
use super::workspace::Parts;
use crate::Scalar;
use crate::dense::dot;
use core::ops::Range;

/// Variables or states whose movement is measured together.
const BLOCK: usize = 8;

/// The blocks that a range touches.
pub(super) fn blocks_of(range: &Range<usize>) -> Range<usize> {
    if range.is_empty() {
        0..0
    } else {
        range.start / BLOCK..(range.end - 1) / BLOCK + 1
    }
}

/// Blocks that cover `size` entries.
pub(super) fn blocks(size: usize) -> usize {
    size.div_ceil(BLOCK)
}

/// The entries of a block within a range.
fn within(block: usize, range: &Range<usize>) -> Range<usize> {
    (block * BLOCK).max(range.start)..((block + 1) * BLOCK).min(range.end)
}

impl<T: Scalar> Parts<'_, T> {
    /// Weights and shares, from the tables. Returns the longest window of a row and the longest span of a group.
    pub fn weigh(&mut self, tables: &BandedTables<'_, T>) -> [usize; 2] {
        let (mut longest, mut widest, mut start) = (0, 0, 0);
        for group in 0..tables.groups() {
            let [z, x] = tables.spans_of(group);
            widest = widest.max(z.len());
            let ends = [z.start, z.end, x.start, x.end];
            for (span, value) in self.spans.iter_mut().zip(ends) {
                span[group] = value as u32;
            }
            self.weight_start[group] = start as u32;
            let len = 2 * blocks_of(&z).len() + blocks_of(&x).len();
            self.weights[start..start + len].fill(T::ZERO);
            start += len;
            let of_group = [z, x].map(|span| blocks_of(&span));
            for pair in tables.pairs_of(group) {
                longest = longest.max(tables.data.rows.window(pair).len());
                self.for_each_block(tables, group, &of_group, pair, |weight, _, norm| {
                    *weight = weight.max(norm);
                });
            }
            for pair in tables.pairs_of(group) {
                let mut shares = [T::ZERO; 3];
                self.for_each_block(tables, group, &of_group, pair, |weight, part, norm| {
                    if norm > T::ZERO {
                        shares[part] = shares[part].max(norm / *weight);
                    }
                });
                for (own, share) in self.share.iter_mut().zip(shares) {
                    own[pair] = share * margin();
                }
            }
        }
        [longest, widest]
    }

    /// Calls `f(weight, part, norm)` for the blocks of a row: its norm there, in units of its right-hand side.
    fn for_each_block(
        &mut self,
        tables: &BandedTables<'_, T>,
        group: usize,
        [of_z, of_x]: &[Range<usize>; 2],
        pair: usize,
        mut f: impl FnMut(&mut T, usize, T),
    ) {
        let d = &tables.data;
        let weights = &mut self.weights[self.weight_start[group] as usize..];
        let norm = |square: T| square.sqrt_upper() * margin() / d.scale[pair];
        let (window, row) = (d.rows.window(pair), d.rows.row(pair));
        for block in blocks_of(&window) {
            let mut squares = [T::ZERO; 2];
            for v in within(block, &window) {
                let g = row[v - window.start] / self.unit[v];
                squares[tables.part(v)] += g * g;
            }
            for (part, square) in squares.into_iter().enumerate() {
                let at = part * of_z.len() + block - of_z.start;
                f(&mut weights[at], part, norm(square));
            }
        }
        let (window, row) = (d.rows_state.window(pair), d.rows_state.row(pair));
        for block in blocks_of(&window) {
            let entries = within(block, &window);
            let v = &row[entries.start - window.start..entries.end - window.start];
            let at = 2 * of_z.len() + block - of_x.start;
            f(&mut weights[at], 2, norm(dot(v, v)));
        }
    }

    /// How far a pair can have moved since the paths of its group began, in units of right-hand sides.
    #[inline(always)]
    pub fn reached(&self, group: usize, pair: usize) -> T {
        let [c, theta, x] = self.share.each_ref().map(|share| share[pair]);
        c * self.path[0][group] + theta * self.path[1][group] + x * self.path[2][group]
    }

    /// Whether the paths of a group had become too long to be accurate and begin again.
    pub fn begin_again(&mut self, group: usize) -> bool {
        let mut total = T::ZERO;
        for path in &self.path {
            total += path[group];
        }
        if total < T::REACH {
            return false;
        }
        for path in &mut self.path {
            path[group] = T::ZERO;
        }
        true
    }

    /// `z` moved by `t · direction` in `range`; `widest` is the longest span of variables of a group.
    pub fn moved_variables(
        &mut self,
        tables: &BandedTables<'_, T>,
        widest: usize,
        range: Range<usize>,
        t: T,
    ) {
        if range.is_empty() {
            return;
        }
        let moved = blocks_of(&range);
        for block in moved.clone() {
            let mut sums = [T::ZERO; 2];
            for v in within(block, &range) {
                let move_of = self.unit[v] * self.direction[v];
                sums[tables.part(v)] += move_of * move_of;
            }
            for (part, sum) in sums.into_iter().enumerate() {
                self.blocks[part][block] = t.abs() * length(sum);
            }
        }
        // Groups stand in the order of their first variables.
        let reaches = |&first: &u32| first as usize + widest <= range.start;
        let near = self.spans[0].partition_point(reaches)
            ..self.spans[0].partition_point(|&first| (first as usize) < range.end);
        for group in near {
            let (from, to) = (self.spans[0][group] as usize, self.spans[1][group] as usize);
            if to <= range.start {
                continue;
            }
            let of_group = blocks_of(&(from..to));
            let common = moved.start.max(of_group.start)..moved.end.min(of_group.end);
            for part in 0..2 {
                let at = self.weight_start[group] as usize + part * of_group.len();
                let weights = &self.weights[at..at + of_group.len()];
                let weights = &weights[common.start - of_group.start..common.end - of_group.start];
                let by = dot(weights, &self.blocks[part][common.clone()]);
                self.add_movement(group, part, by);
            }
        }
    }

    /// A new state; `x` in the order of the caller. Finite: the caller has checked it.
    pub fn measure_state(&mut self, tables: &BandedTables<'_, T>, x: &[T]) {
        self.of_state.fill(T::NAN);
        let all = 0..tables.states();
        for block in blocks_of(&all) {
            let mut sum = T::ZERO;
            for i in within(block, &all) {
                let new = x[tables.data.state_order[i] as usize];
                let difference = new - self.x[i];
                sum += difference * difference;
                self.x[i] = new;
            }
            self.blocks[0][block] = length(sum);
        }
        for group in 0..self.known.len() {
            let [z, x] = [0, 2].map(|i| {
                blocks_of(&(self.spans[i][group] as usize..self.spans[i + 1][group] as usize))
            });
            let at = self.weight_start[group] as usize + 2 * z.len();
            let by = dot(&self.weights[at..at + x.len()], &self.blocks[0][x]);
            self.add_movement(group, 2, by);
        }
    }

    /// Rounded up: movements far smaller than what they are added to would be lost otherwise, and a slow drift never be seen. What is not
    /// finite is measured.
    #[inline(always)]
    fn add_movement(&mut self, group: usize, part: usize, by: T) {
        let path = &mut self.path[part][group];
        if !by.is_finite() {
            (*path, self.moved[group]) = (T::INFINITY, T::INFINITY);
        } else if by > T::ZERO {
            let up = T::ONE + T::EPSILON;
            *path = (*path + by) * up;
            self.moved[group] = (self.moved[group] + by) * up;
        }
    }
}

/// The root, rounded up; what is not a number has moved without limit.
fn length<T: Scalar>(square: T) -> T {
    if square.is_finite() {
        square.sqrt_upper()
    } else {
        T::INFINITY
    }
}

/// A little more than 1, for the rounding of what norms bound.
fn margin<T: Scalar>() -> T {
    T::ONE + T::from_f64(1e3) * T::EPSILON
}
