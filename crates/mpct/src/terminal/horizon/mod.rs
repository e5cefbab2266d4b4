//! The terminal horizon: M (20) for regulation, M̃ (29) for tracking.
//!
//! A row spent at one step stays spent, and rows are searched alone: M̃ = max over rows of (first spent step) − 1. In
//! the first, exact form a row at step t is held against O_{t−1}. The range of steps doubles until no row is open;
//! within it a row starts at the step at which a similar row was first spent, so that two programs settle most rows:
//! spent there, not spent one step before. In the second, sufficient form it is held against X_aug,t alone, which is
//! not monotone in t: steps are counted up, and the row that refused the last step is asked first.

mod hints;
mod never_spent;
mod sufficient;

use super::augmented::Augmented;
use super::bank::Bank;
use super::program::{Expected, Workspace};
use super::support::{Side, Support, Verdict};
use super::{Condition, DesignOptions, Progress};
use crate::clock::Clock;
use crate::error::DesignError;
use crate::problem::{Problem, RowSource};
use hints::{Hints, support_profile};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// What the search found.
pub(super) struct Found {
    /// M or M̃.
    pub(super) horizon: usize,
    /// First spent step of each side of each pair (upper, lower); 0 where the problem has no such side.
    pub(super) spent: Vec<[usize; 2]>,
    pub(super) programs: usize,
    /// Time for the rows along the law.
    pub(super) rows: Duration,
}

/// Whether every pair has equal bounds: O = −O, and both sides of a pair have the same support.
pub(super) fn is_symmetric(system: &Augmented) -> bool {
    let equal = |l: f64| (l - 1.0).abs() <= 1e-13;
    system.pairs.iter().all(|p| equal(p.lower_bound()))
}

/// Finds the horizon.
pub(super) fn search(
    problem: &Problem,
    system: &mut Augmented,
    bank: &mut Bank,
    options: &DesignOptions<'_>,
    clock: &Clock,
) -> Result<Found, DesignError> {
    let search = Search {
        problem,
        options,
        clock,
        symmetric: is_symmetric(system),
        done: AtomicUsize::new(0),
        total: AtomicUsize::new(0),
        at_least: AtomicUsize::new(1),
        asked: Default::default(),
        reported: AtomicUsize::new(0),
    };
    match options.condition {
        Condition::Exact => search.exact(system, bank),
        Condition::Sufficient => search.sufficient(system, bank),
    }
}

/// With more open rows than this, a few of them are asked first whether it is worth asking all.
const SCOUTED: usize = 64;
/// Number of rows asked first.
const SCOUTS: usize = 16;
/// Rows searched one after the other by one thread, so that each can start where its neighbours ended: at most so
/// many, and at least so many parts that no thread is idle for long.
const ROWS_PER_TASK: usize = 32;
const TASKS: usize = 16;
/// Time between two reports while rows are searched.
const REPORT: Duration = Duration::from_millis(50);

struct Search<'a> {
    problem: &'a Problem,
    options: &'a DesignOptions<'a>,
    clock: &'a Clock,
    symmetric: bool,
    done: AtomicUsize,
    total: AtomicUsize,
    at_least: AtomicUsize,
    /// The row and step last asked about, as pair · 2 + (lower side) and step.
    asked: [AtomicUsize; 2],
    /// Milliseconds on the clock at the last report.
    reported: AtomicUsize,
}

/// A side that is not spent at step `low`.
#[derive(Clone, Copy)]
struct Open {
    side: Side,
    low: usize,
    /// Its support at `low`, when known.
    support: f64,
}

/// What became of an open side.
enum Outcome {
    Spent(usize),
    Open(Open),
    Stopped(Open),
}

impl Search<'_> {
    /// The sides to be searched.
    fn sides(&self, system: &Augmented) -> Vec<Side> {
        let upper = (0..system.pairs.len()).map(|pair| Side { pair, upper: true });
        let lower = (0..system.pairs.len())
            .filter(|&pair| !self.symmetric && system.pairs[pair].lower.is_some())
            .map(|pair| Side { pair, upper: false });
        upper.chain(lower).collect()
    }

    fn exact(&self, system: &mut Augmented, bank: &mut Bank) -> Result<Found, DesignError> {
        let start = |side| Open {
            side,
            low: 0,
            support: f64::NAN,
        };
        let mut open: Vec<Open> = self.sides(system).into_iter().map(start).collect();
        self.total.store(open.len(), Ordering::Relaxed);
        let mut spent = vec![[0_usize; 2]; system.pairs.len()];
        let (mut programs, mut rows) = (0, Duration::ZERO);
        let mut hints = Hints::default();
        let mut step = 1;
        // The first failing condition is at horizon max_horizon, whose rows stand at one step more.
        let last = self.options.max_horizon.saturating_add(1);
        loop {
            let before = self.clock.elapsed();
            system.extend_to(step);
            bank.extend_to(system, step);
            rows += self.clock.elapsed() - before;
            let support = Support::new(system, bank, step - 1, self.clock);
            let mut done = Vec::new();
            let mut worth = true;
            if open.len() > SCOUTED {
                let stride = open.len() / SCOUTS;
                let scouts: Vec<Open> =
                    (0..SCOUTS).map(|k| open.remove(k * (stride - 1))).collect();
                let found = self.ask(&support, &scouts, &hints, step)?;
                for (scout, outcome) in scouts.iter().zip(&found) {
                    if let Outcome::Spent(at) = outcome {
                        hints.add(support_profile(bank, scout.side, step), *at);
                    }
                }
                let still = found.iter().filter(|o| !matches!(o, Outcome::Spent(_)));
                worth = step == last || 4 * still.count() < SCOUTS;
                done.extend(scouts.into_iter().map(|o| o.side).zip(found));
            }
            let mut waiting = Vec::new();
            if worth && !self.clock.has_stopped() {
                let found = self.ask(&support, &open, &hints, step)?;
                done.extend(open.iter().map(|o| o.side).zip(found));
            } else {
                waiting = open;
            }
            programs += support.programs();
            let mut stopped = self.clock.has_stopped();
            for (side, outcome) in done {
                match outcome {
                    Outcome::Spent(at) => {
                        spent[side.pair][usize::from(!side.upper)] = at;
                        if self.symmetric {
                            spent[side.pair][1] = at;
                        }
                    }
                    Outcome::Open(left) => waiting.push(left),
                    Outcome::Stopped(left) => {
                        stopped = true;
                        waiting.push(left);
                    }
                }
            }
            open = waiting;
            open.sort_by_key(|o| o.side);
            self.report(system);
            if open.is_empty() {
                break;
            }
            if stopped || self.clock.has_stopped() {
                return Err(DesignError::Interrupted {
                    at_least: self.at_least.load(Ordering::Relaxed),
                    rows_left: self.rows_left(system, &open),
                });
            }
            if step >= last {
                let worst = open
                    .iter()
                    .max_by(|a, b| a.support.total_cmp(&b.support))
                    .copied();
                if let Some(worst) = worst {
                    let trend = self.trend(system, bank, worst.side, last)?;
                    return Err(self.not_determined(system, &worst, last - 1, &trend));
                }
            }
            step = (2 * step).min(last);
        }
        let latest = spent.iter().flatten().copied().max().unwrap_or(1);
        Ok(Found {
            horizon: latest.saturating_sub(1).max(1),
            spent,
            programs,
            rows,
        })
    }

    /// First spent steps of rows up to `step`, in order.
    fn ask(
        &self,
        support: &Support<'_>,
        open: &[Open],
        hints: &Hints,
        step: usize,
    ) -> Result<Vec<Outcome>, DesignError> {
        let found: Vec<Result<Vec<Outcome>, DesignError>> = open
            .par_chunks(open.len().div_ceil(TASKS).clamp(1, ROWS_PER_TASK))
            .map_init(Workspace::default, |ws, chunk| {
                let mut hints = hints.clone();
                let mut outcomes = Vec::with_capacity(chunk.len());
                for &row in chunk {
                    let profile = support_profile(support.bank(), row.side, step);
                    let hint = hints.nearest(&profile);
                    let outcome = self.first_spent(ws, support, row, hint, step)?;
                    if let Outcome::Spent(at) = outcome {
                        hints.add(profile, at);
                        self.at_least
                            .fetch_max(at.saturating_sub(1), Ordering::Relaxed);
                        self.done.fetch_add(1, Ordering::Relaxed);
                    }
                    self.report_now_and_then(support.system());
                    outcomes.push(outcome);
                }
                Ok(outcomes)
            })
            .collect();
        let mut outcomes = Vec::with_capacity(open.len());
        for part in found {
            outcomes.extend(part?);
        }
        Ok(outcomes)
    }

    /// First spent step in (row.low, step], or open.
    fn first_spent(
        &self,
        ws: &mut Workspace,
        support: &Support<'_>,
        mut row: Open,
        hint: Option<usize>,
        step: usize,
    ) -> Result<Outcome, DesignError> {
        // Not spent at `row.low`, spent at `high` when that is known.
        let mut high = None;
        let mut next = hint.unwrap_or(step).clamp(row.low + 1, step);
        let mut stride = 1;
        loop {
            if self.clock.has_stopped() {
                return Ok(Outcome::Stopped(row));
            }
            self.note(row.side, next);
            let expected = if high.is_none() {
                Expected::Spent
            } else {
                Expected::NotSpent
            };
            match support.is_spent(ws, row.side, next, next, expected)? {
                Verdict::Spent => {
                    high = Some(next);
                    // A hint is nearly right: ask just below it, then further and further away.
                    next = next.saturating_sub(stride).max(row.low + 1);
                }
                Verdict::NotSpent(value) => {
                    row.low = next;
                    row.support = value;
                    self.at_least.fetch_max(next, Ordering::Relaxed);
                    next += stride;
                }
                Verdict::Stopped => return Ok(Outcome::Stopped(row)),
            }
            stride *= 2;
            match high {
                Some(high) if high == row.low + 1 => return Ok(Outcome::Spent(high)),
                Some(high) if next <= row.low || next >= high => next = (row.low + high) / 2,
                Some(_) => {}
                None if row.low >= step => return Ok(Outcome::Open(row)),
                None => next = next.min(step),
            }
        }
    }

    /// Reports when the last report is old; one thread does, the others go on.
    fn report_now_and_then(&self, system: &Augmented) {
        let now = self.clock.elapsed().as_millis() as usize;
        let last = self.reported.load(Ordering::Relaxed);
        let is_old = now.saturating_sub(last) as u128 >= REPORT.as_millis();
        let order = Ordering::Relaxed;
        if is_old
            && self
                .reported
                .compare_exchange(last, now, order, order)
                .is_ok()
        {
            self.report(system);
        }
    }

    /// Remembers what is asked.
    fn note(&self, side: Side, step: usize) {
        let row = 2 * side.pair + usize::from(!side.upper);
        self.asked[0].store(row, Ordering::Relaxed);
        self.asked[1].store(step, Ordering::Relaxed);
    }

    /// The constraint row that is a side of a pair.
    fn source(&self, system: &Augmented, side: Side) -> Option<RowSource> {
        let pair = system.pairs.get(side.pair)?;
        let row = match pair.lower {
            Some((lower, _)) if !side.upper => lower,
            _ => pair.upper,
        };
        self.problem.rows().source.get(row).copied()
    }

    /// Constraint rows that open sides stand for.
    fn rows_left(&self, system: &Augmented, open: &[Open]) -> usize {
        let rows = |o: &Open| {
            let has_lower = system.pairs[o.side.pair].lower.is_some();
            1 + usize::from(self.symmetric && has_lower)
        };
        open.iter().map(rows).sum()
    }

    fn report(&self, system: &Augmented) {
        if let Some(progress) = self.options.progress {
            let asked = self.asked[0].load(Ordering::Relaxed);
            let asked = Side {
                pair: asked / 2,
                upper: asked.is_multiple_of(2),
            };
            let told = progress(&Progress {
                rows_done: self.done.load(Ordering::Relaxed),
                rows_total: self.total.load(Ordering::Relaxed),
                row: self.source(system, asked),
                step: self.asked[1].load(Ordering::Relaxed),
                terminal_horizon_at_least: self.at_least.load(Ordering::Relaxed),
            });
            if told == ControlFlow::Break(()) {
                self.clock.stop();
            }
        }
    }
}
