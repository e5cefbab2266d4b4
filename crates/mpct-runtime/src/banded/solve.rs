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
//! 2. *fill in*: a violated row enters. Its multiplier grows until it reaches ρ times its violation; a row whose
//!    multiplier reaches zero on the way leaves. Repeat until no row is violated. The dual cost grows with every row: finite;
//! 3. stop when the active rows hold with equality; else go to 1. Each round divides their residual by about 1 + ρσ, σ the smallest
//!    eigenvalue of G_W H⁻¹G_Wᵀ.
//!
//! In a quiet closed loop W changes by a few rows a step, and each change costs a solution and an update of the factors around it.
//!
//! Sources: the method of multipliers as a proximal method on the dual, Rockafellar, Mathematics of Operations Research 1, 1976; the
//! dual active-set method, Goldfarb and Idnani, Mathematical Programming 27, 1983.

use super::residuals::{Look, Residuals};
use super::tables::BandedTables;
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
/// A round that leaves more than this part of the residual of the active rows made no progress.
const PROGRESS: f64 = 0.3;

/// Rows that should be active and are this many right-hand sides away belong to another world, such as a state of 1e300 at the last step: what it
/// left behind would round away everything.
const ABSURD: f64 = 1e8;

/// ρ, in units of D^(1/2): rows have about length 1 there. Smaller, and there are more rounds; larger, and rounding of `ρ · residual` shows in
/// the multipliers.
pub(crate) fn stiffness<T: Scalar>() -> T {
    if T::EPSILON.to_f64() < 1e-10 {
        T::from_f64(1e5)
    } else {
        T::from_f64(1e2)
    }
}

/// What ends a solve early.
pub(super) enum Stop<T> {
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
        // What is known of the active rows at the end of the last step moves with the state.
        let active = if self.state.is_settled {
            self.state.active
        } else {
            0
        };
        for k in 0..active {
            p.slope[k] -= p.of_state[p.active[k] as usize];
        }
        p.measure_state(self.tables, x);
        for k in 0..active {
            let pair = p.active[k] as usize;
            let now = p.of_state(self.tables, pair);
            p.slope[k] += now;
        }
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
        p.direction.copy_from_slice(p.linear_set_point);
        d.linear_state.add_product(p.x, p.direction);
        for (v, &new) in p.direction.iter().enumerate() {
            p.gradient[v] += new - p.linear[v];
            p.linear[v] = new;
        }
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
        p.key.fill(-T::INFINITY);
        p.moved.fill(T::ZERO);
        self.state.active = 0;
        self.state.centred = 0;
        self.state.changes = None;
        self.state.is_stiff = false;
        self.state.is_settled = false;
    }

    fn run(&mut self, budget: &mut Budget<'_>) -> Result<Outcome<T>, Stop<T>> {
        // Only an optimum leaves something to begin with.
        let is_settled = core::mem::take(&mut self.state.is_settled);
        if budget.is_over() {
            return Err(Stop::Ended(Outcome::Deadline));
        }
        // Computing the factors costs about a quarter of their band in solutions.
        let worth = self.tables.factor_entries() / (4 * self.tables.variables());
        let is_inexact = self.state.refined as usize > worth;
        if is_inexact || self.state.changes.is_none_or(|c| c > WORN) {
            self.refactor()?;
        }
        let (mut before, mut round) = (T::INFINITY, 0);
        let mut found = if is_settled {
            self.summary(true)
        } else {
            self.residuals(Look::At)
        };
        self.state.has_pull = false;
        if !(found.error < T::from_f64(ABSURD)) {
            self.forget();
            self.refactor()?;
            found = self.residuals(Look::At);
        }
        loop {
            let Residuals {
                stationarity,
                error,
                is_fresh,
                ..
            } = found;
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
                if (is_exact || is_usable) && !is_fresh {
                    found = self.residuals(Look::At);
                    continue;
                }
                if is_exact || is_usable {
                    self.state.is_settled = true;
                    self.state.stationarity = stationarity;
                    self.state.violation = error;
                    return Ok(Outcome::Optimal);
                }
                if round == 1 && error <= T::REFINE && self.state.changes != Some(0) {
                    self.state.refined += 1;
                }
                if is_stuck {
                    if let Some(radius) = self.prove() {
                        return Ok(Outcome::Infeasible { radius });
                    }
                    // The proof was tried in the place of the residuals.
                    self.residuals(Look::At);
                    if !self.stiffen(true)? {
                        self.walk();
                        self.residuals(Look::At);
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
            // The first round leaves about 1e-4 of the residuals: too much to look closely.
            let look = if round == 0 { Look::Along } else { Look::After };
            found = self.solve_on_active(look, budget)?;
            if self.fill_in(budget)? {
                found = self.residuals(Look::At);
            }
            round += 1;
        }
    }

    pub(super) fn refactor(&mut self) -> Result<(), Stop<T>> {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        let active = &p.active[..self.state.active];
        if p.factor.compute(&d.hessian, &d.rows, active, p.stiff) {
            self.state.changes = Some(0);
            self.state.refined = 0;
            Ok(())
        } else {
            self.state.changes = None;
            Err(Stop::Trouble)
        }
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
    ///
    /// Around ȳ = y the right-hand side is `−(gradient + pull)`. When rows have left, the multipliers of the others are still
    /// `ȳ + ρ · residual`, so that it is what is left of the gradient without the terms of those rows.
    fn solve_on_active(
        &mut self,
        look: Look,
        budget: &mut Budget<'_>,
    ) -> Result<Residuals<T>, Stop<T>> {
        let mut is_first = true;
        self.pull();
        loop {
            self.spend(budget)?;
            let p = &mut *self.parts;
            let sources = p.gradient.iter().zip(p.pull.iter());
            for (to, (&gradient, &pull)) in p.direction.iter_mut().zip(sources) {
                *to = if is_first {
                    -(gradient + pull)
                } else {
                    -gradient
                };
            }
            is_first = false;
            p.factor.solve(p.direction);
            if !max_abs(p.direction).is_finite() {
                return Err(Stop::Trouble);
            }
            for (z, &step) in p.z.iter_mut().zip(p.direction.iter()) {
                *z += step;
            }
            let size = p.z.len();
            p.moved_variables(self.tables, self.state.widest, 0..size, T::ONE);
            let found = self.residuals(look);
            if found.leaving == 0 {
                return Ok(found);
            }
            self.leave(found.leaving)?;
        }
    }

    pub(super) fn spend(&mut self, budget: &mut Budget<'_>) -> Result<(), Stop<T>> {
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
