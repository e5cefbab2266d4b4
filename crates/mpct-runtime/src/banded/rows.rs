//! Rows that come and go, one at a time: the dual active-set method inside of a round.

use super::pricing::Violated;
use super::solve::{Solver, Stop};
use crate::dense::long_dot;
use crate::{Budget, Scalar};

/// More rows than this share of the variables leaving at once: computing the factors is cheaper than updating them.
const MANY: usize = 12;

impl<T: Scalar> Solver<'_, '_, '_, T> {
    /// Removes the active rows whose multiplier has the wrong sign, and their terms from the gradient; there are `count`.
    pub(super) fn leave(&mut self, count: usize) -> Result<(), Stop<T>> {
        let many = count > self.parts.z.len() / MANY;
        let mut k = 0;
        while k < self.state.active {
            let pair = self.parts.active[k] as usize;
            let p = &mut *self.parts;
            if p.is_wrong(pair) {
                self.tables.data.rows.add_row(pair, -p.y[pair], p.gradient);
                self.remove(k, !many)?;
            } else {
                k += 1;
            }
        }
        if many { self.refactor() } else { Ok(()) }
    }

    /// The active row at position `k` leaves.
    fn remove(&mut self, k: usize, update: bool) -> Result<(), Stop<T>> {
        let p = &mut *self.parts;
        let pair = p.active[k] as usize;
        p.active.copy_within(k + 1..self.state.active, k);
        p.slope.copy_within(k + 1..self.state.active, k);
        self.state.active -= 1;
        p.side[pair] = 0;
        p.y[pair] = T::ZERO;
        p.forget_row(self.tables, pair);
        if update {
            self.change(pair, -self.parts.stiff[pair])
        } else {
            Ok(())
        }
    }

    /// The factors after a row came (`weight` > 0) or went.
    pub(super) fn change(&mut self, pair: usize, weight: T) -> Result<(), Stop<T>> {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        if p.factor.update(&d.rows, pair, weight, p.scratch) {
            self.state.changes = self.state.changes.map(|c| c + 1);
            Ok(())
        } else {
            self.refactor()
        }
    }

    /// Brings violated rows in until there is none. Whether there was one.
    pub(super) fn fill_in(&mut self, budget: &mut Budget<'_>) -> Result<bool, Stop<T>> {
        let mut any = false;
        loop {
            match self.parts.price(self.tables) {
                Ok(None) => return Ok(any),
                Ok(Some(row)) => {
                    self.enter(row, budget)?;
                    any = true;
                }
                Err(()) => return Err(Stop::Trouble),
            }
        }
    }

    fn enter(&mut self, row: Violated<T>, budget: &mut Budget<'_>) -> Result<(), Stop<T>> {
        let softness = T::ONE / self.parts.stiff[row.pair];
        let sign = if row.side == 1 { T::ONE } else { -T::ONE };
        let (mut beyond, mut multiplier) = (row.by, T::ZERO);
        loop {
            self.spend(budget)?;
            let (p, d) = (&mut *self.parts, &self.tables.data);
            let range = p.factor.solve_row(&d.rows, row.pair, p.direction);
            let window = d.rows.window(row.pair);
            let compliance = long_dot(d.rows.row(row.pair), &p.direction[window.clone()]);
            // 0 of a row without entries: its multiplier grows, and becomes the proof.
            if !(compliance >= T::ZERO) || !compliance.is_finite() {
                return Err(Stop::Trouble);
            }
            let mut t = (beyond - multiplier * softness) / (compliance + softness);
            // The active rows that feel it: neighbours in the list.
            let active = &p.active[..self.state.active];
            let near = active.partition_point(|&pair| {
                d.rows.window(pair as usize).start + self.state.longest <= range.start
            })
                ..active.partition_point(|&pair| d.rows.window(pair as usize).start < range.end);
            let mut blocking = None;
            for k in near.clone() {
                let pair = active[k] as usize;
                let at = d.rows.window(pair);
                let (from, to) = (at.start.max(range.start), at.end.min(range.end));
                let slope = if from < to {
                    let g = &d.rows.row(pair)[from - at.start..to - at.start];
                    p.stiff[pair] * sign * long_dot(g, &p.direction[from..to])
                } else {
                    T::ZERO
                };
                p.slope[k] = slope;
                let y = p.y[pair];
                // y − t slope must keep its sign.
                let is_falling = if p.side[pair] == 1 {
                    slope > T::ZERO
                } else {
                    slope < T::ZERO
                };
                if is_falling && y.abs() < t * slope.abs() {
                    t = y.abs() / slope.abs();
                    blocking = Some(k);
                }
            }
            if !t.is_finite() {
                return Err(Stop::Trouble);
            }
            t = t.max(T::ZERO);
            for k in near {
                let pair = p.active[k] as usize;
                let y = p.y[pair] - t * p.slope[k];
                p.y[pair] = if p.side[pair] == 1 {
                    y.max(T::ZERO)
                } else {
                    -((-y).max(T::ZERO))
                };
            }
            for (z, &step) in p.z[range.clone()]
                .iter_mut()
                .zip(&p.direction[range.clone()])
            {
                *z -= t * sign * step;
            }
            p.moved_variables(self.tables, self.state.widest, range, t);
            beyond -= t * compliance;
            multiplier += t;
            match blocking {
                Some(k) => self.remove(k, true)?,
                None => return self.insert(row.pair, row.side, sign * multiplier),
            }
        }
    }

    /// A row becomes active.
    fn insert(&mut self, pair: usize, side: u32, y: T) -> Result<(), Stop<T>> {
        let p = &mut *self.parts;
        let active = &p.active[..self.state.active];
        let k = active.partition_point(|&other| (other as usize) < pair);
        if p.side[pair] != 0 || self.state.active >= p.active.len() {
            return Err(Stop::Trouble);
        }
        p.active.copy_within(k..self.state.active, k + 1);
        p.active[k] = pair as u32;
        self.state.active += 1;
        p.side[pair] = side;
        p.y[pair] = y;
        p.forget_row(self.tables, pair);
        self.change(pair, self.parts.stiff[pair])
    }
}
