//! Which row is violated, without looking at most rows.
//!
//! Rows are looked at in groups of neighbours. A group remembers the largest excess of its rows when they were last measured, and
//! how far its rows can have moved since (`movement.rs`). It is looked at again only when nothing else is known to be violated, and then only when one of
//! its rows can be; of its rows those are measured that can be violated themselves. What happens in one subsystem does not
//! reach the groups of the far ones, and costs them nothing.

use super::tables::BandedTables;
use super::workspace::Parts;
use crate::Scalar;

/// Groups that are worked on together. More, and one does not fit into the memory near the processor; fewer, and rows come and go that
/// their neighbours would have decided.
const NEIGHBOURHOOD: usize = 32;

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
    /// V x of a pair, computed when it is first asked for in a step.
    #[inline(always)]
    pub fn of_state(&mut self, tables: &BandedTables<'_, T>, pair: usize) -> T {
        if self.of_state[pair].is_nan() {
            self.of_state[pair] = tables.data.rows_state.dot(pair, self.x);
        }
        self.of_state[pair]
    }

    /// What G z + V x of an active pair should be: u, or −l.
    #[inline(always)]
    pub fn bound(&self, tables: &BandedTables<'_, T>, pair: usize) -> T {
        if self.side[pair] == 1 {
            tables.data.upper[pair]
        } else {
            -tables.data.lower[pair]
        }
    }

    /// Whether the multiplier of an active pair has the wrong sign.
    #[inline(always)]
    pub fn is_wrong(&self, pair: usize) -> bool {
        if self.side[pair] == 1 {
            self.y[pair] < T::ZERO
        } else {
            self.y[pair] > T::ZERO
        }
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

    /// Measures the rows of a group that can be violated.
    fn measure(&mut self, tables: &BandedTables<'_, T>, group: usize) {
        let d = &tables.data;
        let pairs = tables.pairs_of(group);
        let (mut known, mut best, mut nearest) = (-T::INFINITY, 0, -T::INFINITY);
        // Sums too long to be accurate start again.
        if self.begin_again(group) {
            self.key[pairs.clone()].fill(-T::INFINITY);
        }
        for pair in pairs {
            if self.side[pair] != 0 {
                continue;
            }
            let (reached, scale) = (self.reached(group, pair), d.scale[pair]);
            let at_most = reached - self.key[pair];
            if at_most <= T::ZERO {
                nearest = nearest.max(at_most);
                known = known.max(at_most * scale);
                continue;
            }
            self.of_state(tables, pair);
            let (upper, lower) = self.beyond(tables, pair);
            let excess = upper.max(lower) - T::PRIMAL * scale;
            self.key[pair] = reached - excess / scale;
            nearest = nearest.max(excess / scale);
            // Written so that NaN is found and not skipped.
            if !(excess <= known) {
                (known, best) = (excess, pair as u32);
                if known.is_nan() {
                    break;
                }
            }
        }
        (self.known[group], self.best[group]) = (known, best);
        (self.nearest[group], self.moved[group]) = (nearest, T::ZERO);
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

    /// A violated row that is not active: the most violated one of the group that was worst when it was last measured, in the
    /// neighbourhood that is being worked on. `Err` when an excess is not a number.
    ///
    /// What a change does far away is looked at last: a group is measured when it is the worst of those that are known to be
    /// violated, and when none is, those that can be. Neighbourhoods are worked off one after another, so that what they need stays near the
    /// processor; the method is free to add any violated row.
    pub fn price(&mut self, tables: &BandedTables<'_, T>) -> Result<Option<Violated<T>>, ()> {
        let mut worst = None;
        let neighbourhoods = self.known.len().div_ceil(NEIGHBOURHOOD);
        for turn in 0..neighbourhoods {
            let here = (self.turn + turn) % neighbourhoods;
            worst = self.known_worst(tables, here)?;
            if worst.is_some() {
                self.turn = here;
                break;
            }
        }
        let group = match worst {
            Some(group) => group,
            None => {
                let (mut worst, mut excess) = (None, T::ZERO);
                for group in 0..self.known.len() {
                    let can_be = !(self.nearest[group] + self.moved[group] <= T::ZERO);
                    if can_be || !(self.known[group] < T::INFINITY) {
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

    /// The worst group of a neighbourhood that is known to be violated, measured.
    fn known_worst(
        &mut self,
        tables: &BandedTables<'_, T>,
        neighbourhood: usize,
    ) -> Result<Option<usize>, ()> {
        let first = neighbourhood * NEIGHBOURHOOD;
        let end = (first + NEIGHBOURHOOD).min(self.known.len());
        loop {
            let (mut worst, mut excess) = (None, T::ZERO);
            for group in first..end {
                let known = self.known[group];
                if !(known <= excess) {
                    (worst, excess) = (Some(group), known);
                }
            }
            let Some(group) = worst else { return Ok(None) };
            let is_exact = self.moved[group] <= T::ZERO && excess < T::INFINITY;
            if self.know(tables, group)? > T::ZERO && is_exact {
                return Ok(Some(group));
            }
        }
    }

    /// A row became active or inactive: its group must be looked at again, and nothing is known of the row.
    pub fn forget_row(&mut self, tables: &BandedTables<'_, T>, pair: usize) {
        let group = tables
            .data
            .groups
            .partition_point(|&first| first as usize <= pair);
        self.known[group - 1] = T::INFINITY;
        self.key[pair] = -T::INFINITY;
    }
}

#[cfg(test)]
#[path = "pricing_tests.rs"]
mod tests;
