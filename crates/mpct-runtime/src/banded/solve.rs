//! The method of multipliers, whose inner problems a dual active-set method solves on banded factors.
//!
//! Around multipliers ȳ (the centre) the inner problem is
//! ```text
//! min ½ zᵀHz + fᵀz + (ρ/2) Σ_i max(0, G_i z + V_i x − u_i + ȳ_i/ρ)²            (both sides of every pair)
//! ```
//! On a set W of active rows it is the linear system (H + ρ G_WᵀG_W) z = −f − G_Wᵀ(ȳ + ρ(V x − u)), whose matrix is positive definite
//! whatever W is: rows that depend on each other do no harm. The loop is:
//!
//! 1. *centre*: ȳ = y; solve on W; rows whose multiplier has the wrong sign leave, until none has;
//! 2. *fill in*: the most violated row enters. Its multiplier grows until it reaches ρ times its violation; a row whose
//!    multiplier reaches zero on the way leaves. Repeat until no row is violated. The dual cost grows with every row: finite;
//! 3. stop when the active rows hold with equality; else go to 1. Each round divides their residual by about 1 + ρσ, σ the smallest
//!    eigenvalue of G_W H⁻¹G_Wᵀ.
//!
//! In a quiet closed loop W changes by a few rows a step, and each change costs a solution and an update of the factors around it.
//!
//! Sources: the method of multipliers as a proximal method on the dual, Rockafellar, Mathematics of Operations Research 1, 1976; the
//! dual active-set method, Goldfarb and Idnani, Mathematical Programming 27, 1983.

use super::tables::BandedTables;
use super::windows::add_symmetric_product;
use super::workspace::{Parts, State};
use crate::dense::{all_finite, max_abs};
use crate::{Budget, Scalar};

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outcome<T> {
    Optimal,
    Infeasible { radius: T },
    IterationLimit,
    Deadline,
    Failed,
}

/// Rounds after which the multipliers are said not to converge.
const ROUNDS: u32 = 60;
/// Changes after which the factors are computed afresh, so that their rounding does not add up.
const WORN: u32 = 2000;
/// More rows than this share of the variables leaving at once: computing the factors is cheaper than updating them.
const MANY: usize = 12;
/// A round that leaves more than this part of the residual of the active rows made no progress.
const PROGRESS: f64 = 0.3;

/// A proof of infeasibility must also hold for points this many times larger than the one reached, in the 1-norm. Smaller, and with hundreds
/// of variables in f32 it would leave room for a solution.
const FARTHER: f64 = 2.0;
/// A radius beyond which nothing is asked of a proof.
const FAR: f64 = 1e6;
/// A residual below this many units in the last place of its terms is rounding. Smaller, and f32 would walk on the spot.
const ROUNDING: f64 = 4.0;

/// ρ, in units of D^(1/2): rows have about length 1 there. Smaller, and there are more rounds; larger, and rounding of `ρ · residual` shows in
/// the multipliers.
pub(crate) fn stiffness<T: Scalar>() -> T {
    if T::EPSILON.to_f64() < 1e-10 {
        T::from_f64(1e5)
    } else {
        T::from_f64(1e2)
    }
}

/// Factor by which rows are stiffened that walk, twice at most. Larger, and nothing would be left of H beside them.
fn harder<T: Scalar>() -> T {
    if T::EPSILON.to_f64() < 1e-10 {
        T::from_f64(1e3)
    } else {
        T::from_f64(30.0)
    }
}

enum Stop<T> {
    Ended(Outcome<T>),
    Trouble,
}

pub(crate) struct Solver<'s, 'a, 'w, T> {
    pub tables: &'s BandedTables<'a, T>,
    pub parts: &'s mut Parts<'w, T>,
    pub state: &'s mut State<T>,
    pub iterations: u32,
}

impl<T: Scalar> Solver<'_, '_, '_, T> {
    /// Loads a measured state and a set-point.
    pub fn load(&mut self, x: &[T], r: &[T]) {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        p.measure_state(self.tables, x);
        let mut is_new = self.state.is_fresh;
        for (own, &at) in p.r.iter_mut().zip(d.set_point_order) {
            let new = r[at as usize];
            is_new |= *own != new;
            *own = new;
        }
        if is_new {
            p.linear_set_point.fill(T::ZERO);
            d.linear_set_point.add_product(p.r, p.linear_set_point);
        }
        p.linear.copy_from_slice(p.linear_set_point);
        d.linear_state.add_product(p.x, p.linear);
        self.state.is_fresh = false;
        self.state.has_proof = false;
    }

    /// Solves what was loaded.
    pub fn solve(&mut self, budget: &mut Budget<'_>) -> Outcome<T> {
        // A second attempt starts from nothing.
        for attempt in 0..2 {
            if attempt > 0 {
                self.forget();
            }
            match self.run(budget) {
                Ok(outcome) | Err(Stop::Ended(outcome)) => return outcome,
                Err(Stop::Trouble) => {}
            }
        }
        self.forget();
        Outcome::Failed
    }

    /// No active rows, no multipliers.
    pub fn forget(&mut self) {
        let p = &mut *self.parts;
        p.z.fill(T::ZERO);
        p.y.fill(T::ZERO);
        p.centre.fill(T::ZERO);
        p.stiff.fill(stiffness());
        p.side.fill(0);
        p.scratch.fill(T::ZERO);
        p.known.fill(T::INFINITY);
        p.moved.fill(T::ZERO);
        self.state.active = 0;
        self.state.centred = 0;
        self.state.changes = None;
        self.state.is_stiff = false;
    }

    fn run(&mut self, budget: &mut Budget<'_>) -> Result<Outcome<T>, Stop<T>> {
        if budget.is_over() {
            return Err(Stop::Ended(Outcome::Deadline));
        }
        if self.state.changes.is_none_or(|c| c > WORN) {
            self.refactor()?;
        }
        let (mut before, mut round) = (T::INFINITY, 0);
        loop {
            let (stationarity, error) = self.residuals();
            if !all_finite(&[stationarity, error]) {
                return Err(Stop::Trouble);
            }
            if round > 0 {
                let is_stuck = round > 1 && !(error < T::from_f64(PROGRESS) * before);
                let is_exact = stationarity <= T::STATIONARY && error <= T::REFINE;
                // As accurate as the numbers allow.
                let is_usable = is_stuck
                    && stationarity <= T::PRIMAL
                    && (error <= T::PRIMAL || self.is_rounding());
                if is_exact || is_usable {
                    self.state.stationarity = stationarity;
                    self.state.violation = error;
                    return Ok(Outcome::Optimal);
                }
                if is_stuck {
                    if let Some(radius) = self.prove() {
                        return Ok(Outcome::Infeasible { radius });
                    }
                    // The proof was tried in the place of the residuals.
                    self.residuals();
                }
                if is_stuck {
                    if !self.stiffen(true)? {
                        self.walk();
                    }
                } else if self.state.is_stiff {
                    self.stiffen(false)?;
                }
                if round > ROUNDS {
                    return Err(Stop::Trouble);
                }
                before = error;
            }
            self.centre();
            self.solve_on_active(budget)?;
            self.fill_in(budget)?;
            round += 1;
        }
    }

    fn refactor(&mut self) -> Result<(), Stop<T>> {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        let active = &p.active[..self.state.active];
        if p.factor.compute(&d.hessian, &d.rows, active, p.stiff) {
            self.state.changes = Some(0);
            Ok(())
        } else {
            self.state.changes = None;
            Err(Stop::Trouble)
        }
    }

    /// `gradient = H z + f`, `slope` = residual of each active row. Returns ‖H z + f + Gᵀy‖_∞ over the size of its terms, the larger of
    /// the c part and the θ part, and the largest residual in units of right-hand sides.
    fn residuals(&mut self) -> (T, T) {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        p.gradient.copy_from_slice(p.linear);
        add_symmetric_product(&d.hessian, p.z, p.gradient);
        p.direction.copy_from_slice(p.gradient);
        let mut error = T::ZERO;
        for k in 0..self.state.active {
            let pair = p.active[k] as usize;
            let value = p.value(self.tables, pair);
            let residual = if p.side[pair] == 1 {
                value - d.upper[pair]
            } else {
                value + d.lower[pair]
            };
            p.slope[k] = residual;
            error = larger(error, residual.abs() / d.scale[pair]);
            d.rows.add_row(pair, p.y[pair], p.direction);
        }
        let (mut left, mut size) = ([T::ZERO; 2], [T::ONE; 2]);
        for v in 0..p.z.len() {
            let part = usize::from(d.next_stage[v] as usize == v);
            left[part] = larger(left[part], p.direction[v].abs());
            let terms = p.linear[v]
                .abs()
                .max((p.unit[v] * p.unit[v] * p.z[v]).abs());
            size[part] = size[part].max(terms);
        }
        (larger(left[0] / size[0], left[1] / size[1]), error)
    }

    /// Whether what the residuals of the active rows have beyond [`Scalar::PRIMAL`] is the rounding of their terms.
    fn is_rounding(&self) -> bool {
        let (p, d) = (&*self.parts, &self.tables.data);
        let terms = |row: &[T], x: &[T]| {
            let mut sum = T::ZERO;
            for (&a, &b) in row.iter().zip(x) {
                sum += (a * b).abs();
            }
            sum
        };
        p.active[..self.state.active]
            .iter()
            .zip(p.slope.iter())
            .all(|(&pair, residual)| {
                let pair = pair as usize;
                let of_z = terms(d.rows.row(pair), &p.z[d.rows.window(pair)]);
                let of_x = terms(d.rows_state.row(pair), &p.x[d.rows_state.window(pair)]);
                let noise = T::from_f64(ROUNDING) * T::EPSILON * (of_z + of_x);
                residual.abs() <= (T::PRIMAL * d.scale[pair]).max(noise)
            })
    }

    /// ȳ = y.
    fn centre(&mut self) {
        let p = &mut *self.parts;
        for k in 0..self.state.centred {
            let pair = p.centred[k] as usize;
            if p.side[pair] == 0 {
                // Its penalised bound moves away: what is known of its group remains a bound.
                p.centre[pair] = T::ZERO;
                p.stiff[pair] = stiffness();
            }
        }
        for k in 0..self.state.active {
            let pair = p.active[k];
            p.centred[k] = pair;
            p.centre[pair as usize] = p.y[pair as usize];
        }
        self.state.centred = self.state.active;
    }

    /// Solves the inner problem on the active rows; those whose multiplier has the wrong sign leave, until none has.
    fn solve_on_active(&mut self, budget: &mut Budget<'_>) -> Result<(), Stop<T>> {
        loop {
            self.spend(budget)?;
            let (p, d) = (&mut *self.parts, &self.tables.data);
            for (to, &g) in p.direction.iter_mut().zip(p.gradient.iter()) {
                *to = -g;
            }
            for k in 0..self.state.active {
                let pair = p.active[k] as usize;
                let pull = p.centre[pair] + p.stiff[pair] * p.slope[k];
                d.rows.add_row(pair, -pull, p.direction);
            }
            p.factor.solve(p.direction);
            if !max_abs(p.direction).is_finite() {
                return Err(Stop::Trouble);
            }
            for (z, &step) in p.z.iter_mut().zip(p.direction.iter()) {
                *z += step;
            }
            let size = p.z.len();
            p.moved_variables(0..size, T::ONE);
            let mut leaving = 0;
            for k in 0..self.state.active {
                let pair = p.active[k] as usize;
                let residual = p.slope[k] + d.rows.dot(pair, p.direction);
                let y = p.centre[pair] + p.stiff[pair] * residual;
                p.y[pair] = y;
                let is_wrong = if p.side[pair] == 1 {
                    y < T::ZERO
                } else {
                    y > T::ZERO
                };
                leaving += usize::from(is_wrong);
            }
            if leaving == 0 {
                return Ok(());
            }
            self.leave(leaving)?;
            self.residuals();
        }
    }

    /// Removes the active rows whose multiplier has the wrong sign; there are `count`.
    fn leave(&mut self, count: usize) -> Result<(), Stop<T>> {
        let many = count > self.parts.z.len() / MANY;
        let mut k = 0;
        while k < self.state.active {
            let pair = self.parts.active[k] as usize;
            let y = self.parts.y[pair];
            let is_wrong = if self.parts.side[pair] == 1 {
                y < T::ZERO
            } else {
                y > T::ZERO
            };
            if is_wrong {
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
        p.forget_group_of(self.tables, pair);
        if update {
            self.change(pair, -self.parts.stiff[pair])
        } else {
            Ok(())
        }
    }

    /// The factors after a row came (`weight` > 0) or went.
    fn change(&mut self, pair: usize, weight: T) -> Result<(), Stop<T>> {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        if p.factor.update(&d.rows, pair, weight, p.scratch) {
            self.state.changes = self.state.changes.map(|c| c + 1);
            Ok(())
        } else {
            self.refactor()
        }
    }

    /// Brings violated rows in until there is none.
    fn fill_in(&mut self, budget: &mut Budget<'_>) -> Result<(), Stop<T>> {
        loop {
            match self.parts.price(self.tables) {
                Ok(None) => return Ok(()),
                Ok(Some(row)) => self.enter(row, budget)?,
                Err(()) => return Err(Stop::Trouble),
            }
        }
    }

    fn enter(
        &mut self,
        row: super::pricing::Violated<T>,
        budget: &mut Budget<'_>,
    ) -> Result<(), Stop<T>> {
        let softness = T::ONE / self.parts.stiff[row.pair];
        let sign = if row.side == 1 { T::ONE } else { -T::ONE };
        let (mut beyond, mut multiplier) = (row.by, T::ZERO);
        loop {
            self.spend(budget)?;
            let (p, d) = (&mut *self.parts, &self.tables.data);
            let range = p.factor.solve_row(&d.rows, row.pair, p.direction);
            let window = d.rows.window(row.pair);
            let compliance = crate::dense::dot(d.rows.row(row.pair), &p.direction[window.clone()]);
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
                    p.stiff[pair] * sign * crate::dense::dot(g, &p.direction[from..to])
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
            p.moved_variables(range, t);
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
        p.forget_group_of(self.tables, pair);
        self.change(pair, self.parts.stiff[pair])
    }

    /// y − ȳ as a proof of infeasibility: where no point satisfies all rows, the multipliers grow along one.
    /// Leaves it in `slope` by pairs. Returns the radius, see the dense regime.
    fn prove(&mut self) -> Option<T> {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        p.slope.fill(T::ZERO);
        p.direction.fill(T::ZERO);
        let (mut bound, mut magnitude) = (T::ZERO, T::ZERO);
        for &pair in &p.active[..self.state.active] {
            let pair = pair as usize;
            let grown = p.y[pair] - p.centre[pair];
            let (multiplier, limit) = if p.side[pair] == 1 {
                (grown.max(T::ZERO), d.upper[pair])
            } else {
                (-((-grown).max(T::ZERO)), d.lower[pair])
            };
            if multiplier == T::ZERO {
                continue;
            }
            p.slope[pair] = multiplier;
            d.rows.add_row(pair, multiplier, p.direction);
            let state = multiplier * d.rows_state.dot(pair, p.x);
            bound += multiplier.abs() * limit - state;
            magnitude += multiplier.abs() * limit + state.abs();
        }
        if !(-bound > T::PROOF_MARGIN * magnitude) {
            return None;
        }
        let size = max_abs(p.direction);
        let radius = if size > T::ZERO {
            -bound / size
        } else {
            T::INFINITY
        };
        let mut reached = T::ZERO;
        for z in p.z.iter() {
            reached += z.abs();
        }
        let beyond = T::from_f64(FARTHER) * reached;
        let enough = if beyond < T::from_f64(FAR) {
            beyond
        } else {
            T::from_f64(FAR)
        };
        if radius > T::PROOF_RADIUS.max(enough) {
            self.state.has_proof = true;
            Some(radius)
        } else {
            None
        }
    }

    /// Stiffens the active rows that do not hold with equality yet, or brings all back to the usual stiffness. Whether any changed.
    ///
    /// Rows that depend on each other and cannot all hold with equality make the dual cost linear along a direction in which one of
    /// their multipliers falls, until its row leaves. A round walks along it by ρ times the residual: with 1e5 that can take hundreds
    /// of rounds, with a thousand or a million times as much it takes one. Left stiff, they would carry the rounding of z into their multipliers.
    fn stiffen(&mut self, more: bool) -> Result<bool, Stop<T>> {
        let (base, mut changed) = (stiffness::<T>(), false);
        for k in 0..self.state.active {
            let (p, d) = (&mut *self.parts, &self.tables.data);
            let pair = p.active[k] as usize;
            let old = p.stiff[pair];
            let new = if !more {
                base
            } else if p.slope[k].abs() > T::REFINE * d.scale[pair] && old <= base * harder::<T>() {
                old * harder::<T>()
            } else {
                old
            };
            if new != old {
                changed = true;
                p.stiff[pair] = new;
                self.change(pair, new - old)?;
            }
        }
        self.state.is_stiff = more;
        Ok(changed)
    }

    fn spend(&mut self, budget: &mut Budget<'_>) -> Result<(), Stop<T>> {
        if self.iterations >= budget.iterations {
            return Err(Stop::Ended(Outcome::IterationLimit));
        }
        if budget.is_over() {
            return Err(Stop::Ended(Outcome::Deadline));
        }
        self.iterations += 1;
        Ok(())
    }
}

/// The larger one; NaN wins.
fn larger<T: Scalar>(a: T, b: T) -> T {
    if b <= a { a } else { b }
}
