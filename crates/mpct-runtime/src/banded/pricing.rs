//! Which row is violated, without looking at most rows.
//!
//! Rows are looked at in groups of neighbours. A group remembers the largest excess of its rows when it was last measured, and
//! how far its rows can have moved since: at most ‖G D^(−1/2)‖ times the movement of D^(1/2) z inside of its window, and ‖V‖ times that of the
//! state. A group is measured again only when nothing else is known to be violated, and then only when one of its rows can be. What happens in one subsystem does not
//! reach the groups of the far ones, and costs them nothing.

use super::tables::BandedTables;
use super::workspace::{BLOCK, Parts};
use crate::Scalar;
use core::ops::Range;

/// A row to bring in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Violated<T> {
    pub pair: usize,
    /// 1 upper, 2 lower.
    pub side: u32,
    /// By how much the penalised bound is exceeded.
    pub by: T,
}

impl<T: Scalar> Parts<'_, T> {
    /// G z + V x of a pair.
    #[inline(always)]
    pub fn value(&self, tables: &BandedTables<'_, T>, pair: usize) -> T {
        tables.data.rows.dot(pair, self.z) + tables.data.rows_state.dot(pair, self.x)
    }

    /// How far the row of each side lies beyond its penalised bound, b − centre / ρ: (upper, lower).
    #[inline(always)]
    fn beyond(&self, tables: &BandedTables<'_, T>, pair: usize) -> (T, T) {
        let value = tables.data.rows.dot(pair, self.z) + self.of_state[pair];
        let centre = self.centre[pair] / self.stiff[pair];
        (
            value - tables.data.upper[pair] + centre.max(T::ZERO),
            -value - tables.data.lower[pair] + (-centre).max(T::ZERO),
        )
    }

    /// Measures a group.
    fn measure(&mut self, tables: &BandedTables<'_, T>, group: usize) {
        let d = &tables.data;
        let pairs = d.groups[group] as usize..d.groups[group + 1] as usize;
        if self.is_dated[group] == 0 {
            for pair in pairs.clone() {
                self.of_state[pair] = d.rows_state.dot(pair, self.x);
            }
            self.is_dated[group] = 1;
        }
        let (mut known, mut best) = (-T::INFINITY, 0);
        for pair in pairs {
            if self.side[pair] != 0 {
                continue;
            }
            let (upper, lower) = self.beyond(tables, pair);
            let excess = upper.max(lower) - T::PRIMAL * d.scale[pair];
            // Written so that NaN is found and not skipped.
            if !(excess <= known) {
                (known, best) = (excess, pair as u32);
                if known.is_nan() {
                    break;
                }
            }
        }
        (self.known[group], self.best[group], self.moved[group]) = (known, best, T::ZERO);
    }

    /// Measures a group unless what is known of it is exact. `Err` when an excess is not a number.
    #[inline]
    fn know(&mut self, tables: &BandedTables<'_, T>, group: usize) -> Result<T, ()> {
        // Written so that a movement that is not a number is measured.
        if !(self.moved[group] <= T::ZERO) || !(self.known[group] < T::INFINITY) {
            self.measure(tables, group);
        }
        // An infinite excess would be measured for ever.
        if self.known[group] < T::INFINITY {
            Ok(self.known[group])
        } else {
            Err(())
        }
    }

    /// A violated row that is not active: the most violated one of the group that was worst when it was last measured.
    /// `Err` when an excess is not a number.
    ///
    /// What a change does far away is looked at last: a group is measured when it is the worst of those that are known to be
    /// violated, and when none is, those that can be.
    pub fn price(&mut self, tables: &BandedTables<'_, T>) -> Result<Option<Violated<T>>, ()> {
        let worst = loop {
            let (mut worst, mut excess) = (None, T::ZERO);
            for (group, &known) in self.known.iter().enumerate() {
                if !(known <= excess) {
                    (worst, excess) = (Some(group), known);
                }
            }
            let Some(group) = worst else { break None };
            let is_exact = self.moved[group] <= T::ZERO && excess < T::INFINITY;
            if self.know(tables, group)? > T::ZERO && is_exact {
                break Some(group);
            }
        };
        let group = match worst {
            Some(group) => group,
            None => {
                let (mut worst, mut excess) = (None, T::ZERO);
                for group in 0..self.known.len() {
                    if !(self.known[group] + self.moved[group] <= excess) {
                        let found = self.know(tables, group)?;
                        if found > excess {
                            (worst, excess) = (Some(group), found);
                        }
                    }
                }
                match worst {
                    Some(group) => group,
                    None => return Ok(None),
                }
            }
        };
        let pair = self.best[group] as usize;
        let (upper, lower) = self.beyond(tables, pair);
        let (side, by) = if upper >= lower {
            (1, upper)
        } else {
            (2, lower)
        };
        Ok(Some(Violated { pair, side, by }))
    }

    /// The group of a pair must be measured again: a row of it became inactive.
    pub fn forget_group_of(&mut self, tables: &BandedTables<'_, T>, pair: usize) {
        let group = tables
            .data
            .groups
            .partition_point(|&first| first as usize <= pair);
        self.known[group - 1] = T::INFINITY;
    }

    /// `z` moved by `t · direction` in `range`.
    pub fn moved_variables(&mut self, range: Range<usize>, t: T) {
        if range.is_empty() {
            return;
        }
        let first = range.start / BLOCK;
        let last = (range.end - 1) / BLOCK;
        for block in first..=last {
            let mut sum = T::ZERO;
            let to = ((block + 1) * BLOCK).min(range.end);
            for v in (block * BLOCK).max(range.start)..to {
                let move_of = self.unit[v] * self.direction[v];
                sum += move_of * move_of;
            }
            self.blocks[block] = sum;
        }
        let t = t.abs();
        for group in 0..self.known.len() {
            let (from, to) = (self.spans[0][group] as usize, self.spans[1][group] as usize);
            if from >= range.end || to <= range.start || to == 0 {
                continue;
            }
            let mut sum = T::ZERO;
            for block in (from / BLOCK).max(first)..=((to - 1) / BLOCK).min(last) {
                sum += self.blocks[block];
            }
            self.add_movement(group, t * self.reach[0][group], sum);
        }
    }

    /// A new state; `x` in the order of the caller. Finite: the caller has checked it.
    pub fn measure_state(&mut self, tables: &BandedTables<'_, T>, x: &[T]) {
        self.is_dated.fill(0);
        let order = tables.data.state_order;
        for block in 0..order.len().div_ceil(BLOCK) {
            let mut sum = T::ZERO;
            for i in block * BLOCK..((block + 1) * BLOCK).min(order.len()) {
                let new = x[order[i] as usize];
                let difference = new - self.x[i];
                sum += difference * difference;
                self.x[i] = new;
            }
            self.blocks[block] = sum;
        }
        for group in 0..self.known.len() {
            let (from, to) = (self.spans[2][group] as usize, self.spans[3][group] as usize);
            if to == 0 {
                continue;
            }
            let mut sum = T::ZERO;
            for block in from / BLOCK..=(to - 1) / BLOCK {
                sum += self.blocks[block];
            }
            self.add_movement(group, self.reach[1][group], sum);
        }
    }

    /// Rounded up: movements far smaller than what they are added to would be lost otherwise, and a slow drift never be seen. What is not
    /// finite is measured.
    #[inline(always)]
    fn add_movement(&mut self, group: usize, reach: T, square: T) {
        if !square.is_finite() {
            self.moved[group] = T::INFINITY;
        } else if square > T::ZERO {
            let by = reach * square.sqrt_upper();
            self.moved[group] = (self.moved[group] + by) * (T::ONE + T::EPSILON);
        }
    }
}

#[cfg(test)]
#[path = "pricing_tests.rs"]
mod tests;
