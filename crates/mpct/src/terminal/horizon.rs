//! The terminal horizon: M (20) for regulation, M̃ (29) for tracking.
//!
//! A row spent at one step stays spent, and rows are searched alone: M̃ = max over rows of (first spent step) − 1. In
//! the first, exact form a row at step t is held against O_{t−1}; the steps 1, 2, 4, 8, … are tried for the rows still
//! open, then the first spent step lies between two of them and is found by bisection, starting where a neighbouring
//! row was found. In the second, sufficient form it is held against X_aug,t alone, which is not monotone in t: steps
//! are counted up, and the row that refused the last step is asked first.

use super::augmented::Augmented;
use super::boxes::Boxes;
use super::simplex::DualSimplex;
use super::support::{Side, Support, Verdict};
use super::{Condition, DesignOptions, Progress};
use crate::error::DesignError;
use crate::problem::{Problem, RowSource};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

/// What the search found.
pub(super) struct Found {
    /// M or M̃.
    pub(super) horizon: usize,
    /// First spent step of each side of each pair (upper, lower); 0 where the problem has no such side.
    pub(super) spent: Vec<[usize; 2]>,
    pub(super) programs: usize,
}

/// Finds the horizon.
pub(super) fn search(
    problem: &Problem,
    system: &mut Augmented,
    boxes: &Boxes,
    options: &DesignOptions<'_>,
    started: Instant,
) -> Result<Found, DesignError> {
    let search = Search {
        problem,
        boxes,
        options,
        started,
        symmetric: system
            .pairs
            .iter()
            .all(|p| p.lower.is_some_and(|l| (l.1 - 1.0).abs() <= 1e-13)),
        stop: AtomicBool::new(false),
        done: AtomicUsize::new(0),
        at_least: AtomicUsize::new(1),
    };
    match options.condition {
        Condition::Exact => search.exact(system),
        Condition::Sufficient => search.sufficient(system),
    }
}

struct Search<'a> {
    problem: &'a Problem,
    boxes: &'a Boxes,
    options: &'a DesignOptions<'a>,
    started: Instant,
    /// Every pair has equal bounds: O = −O, and both sides of a pair have the same support.
    symmetric: bool,
    stop: AtomicBool,
    done: AtomicUsize,
    at_least: AtomicUsize,
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

    fn exact(&self, system: &mut Augmented) -> Result<Found, DesignError> {
        let mut open = self.sides(system);
        let total = open.len();
        let mut spent = vec![[0_usize; 2]; system.pairs.len()];
        let mut programs = 0;
        let (mut before, mut step) = (0, 1);
        // The first failing condition is at horizon max_horizon, whose rows stand at one step more.
        let last = self.options.max_horizon.saturating_add(1);
        while !open.is_empty() {
            system.extend_to(step);
            let support = Support::new(system, self.boxes, step - 1);
            let hints = Hints::default();
            let answers: Vec<(Side, Result<Outcome, DesignError>)> = open
                .par_iter()
                .map_init(DualSimplex::default, |simplex, &side| {
                    (
                        side,
                        self.first_spent(simplex, &support, &hints, side, before, step),
                    )
                })
                .collect();
            programs += support.programs();
            let mut still = Vec::new();
            let mut worst: Option<(Side, f64)> = None;
            for (side, answer) in answers {
                match answer? {
                    Outcome::Spent(at) => {
                        spent[side.pair][usize::from(!side.upper)] = at;
                        if self.symmetric {
                            spent[side.pair][1] = at;
                        }
                    }
                    Outcome::Open(value) => {
                        if worst.is_none_or(|w| value > w.1) {
                            worst = Some((side, value));
                        }
                        still.push(side);
                    }
                    Outcome::Stopped => still.push(side),
                }
            }
            open = still;
            self.report(
                total - open.len(),
                total,
                if open.is_empty() { 1 } else { step },
            );
            if self.stop.load(Ordering::Relaxed) {
                return Err(DesignError::Interrupted {
                    at_least: step.max(1),
                    rows_left: open.len(),
                });
            }
            if let (Some((side, value)), true) = (worst, step >= last) {
                return Err(self.not_determined(system, side, value, last - 1));
            }
            before = step;
            step = (2 * step).min(last);
        }
        let latest = spent.iter().flatten().copied().max().unwrap_or(1);
        Ok(Found {
            horizon: latest.saturating_sub(1).max(1),
            spent,
            programs,
        })
    }

    /// First spent step in (before, step], or open.
    fn first_spent(
        &self,
        simplex: &mut DualSimplex,
        support: &Support<'_>,
        hints: &Hints,
        side: Side,
        before: usize,
        step: usize,
    ) -> Result<Outcome, DesignError> {
        if self.must_stop() {
            return Ok(Outcome::Stopped);
        }
        match support.is_spent(simplex, side, step, step)? {
            Verdict::NotSpent { support, .. } => return Ok(Outcome::Open(support)),
            Verdict::Spent { .. } => {}
        }
        // Not spent at `low`, spent at `high`.
        let (mut low, mut high) = (before, step);
        while high - low > 1 {
            if self.must_stop() {
                return Ok(Outcome::Stopped);
            }
            let middle = hints.next(low, high);
            match support.is_spent(simplex, side, middle, middle)? {
                Verdict::Spent { .. } => high = middle,
                Verdict::NotSpent { .. } => low = middle,
            }
        }
        hints.found(high);
        self.at_least
            .fetch_max(high.saturating_sub(1), Ordering::Relaxed);
        let done = 1 + self.done.fetch_add(1, Ordering::Relaxed);
        if done.is_multiple_of(64) {
            self.report(done, 0, 0);
        }
        Ok(Outcome::Spent(high))
    }

    fn sufficient(&self, system: &mut Augmented) -> Result<Found, DesignError> {
        let sides = self.sides(system);
        let mut simplex = DualSimplex::default();
        let mut programs = 0;
        let mut first = 0;
        for horizon in 1..=self.options.max_horizon {
            // In blocks, so that the rows are laid out once for many steps.
            let step = horizon + 1;
            system.extend_to(step);
            let support = Support::new(system, self.boxes, 0);
            let mut refused = None;
            for k in 0..sides.len() {
                let side = sides[(first + k) % sides.len()];
                if self.must_stop() {
                    return Err(DesignError::Interrupted {
                        at_least: horizon,
                        rows_left: sides.len(),
                    });
                }
                if let Verdict::NotSpent { support: value, .. } =
                    support.is_spent(&mut simplex, side, step, 1)?
                {
                    refused = Some((side, value));
                    first = (first + k) % sides.len();
                    break;
                }
            }
            programs += support.programs();
            self.at_least.fetch_max(horizon, Ordering::Relaxed);
            self.report(0, sides.len(), horizon);
            match refused {
                None => {
                    let both = [step, step];
                    return Ok(Found {
                        horizon,
                        spent: vec![both; system.pairs.len()],
                        programs,
                    });
                }
                Some((side, value)) if horizon == self.options.max_horizon => {
                    return Err(self.not_determined(system, side, value, horizon));
                }
                Some(_) => {}
            }
        }
        Err(DesignError::OutOfRange {
            what: "the largest terminal horizon".into(),
            expected: "at least 1".into(),
            found: self.options.max_horizon.to_string(),
        })
    }

    fn must_stop(&self) -> bool {
        if self
            .options
            .time_limit
            .is_some_and(|limit| self.started.elapsed() > limit)
        {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.stop.load(Ordering::Relaxed)
    }

    fn report(&self, rows_done: usize, rows_total: usize, at_least: usize) {
        let at_least = self
            .at_least
            .fetch_max(at_least, Ordering::Relaxed)
            .max(at_least);
        if let Some(progress) = self.options.progress {
            let told = progress(&Progress {
                rows_done,
                rows_total,
                terminal_horizon_at_least: at_least,
            });
            if told == ControlFlow::Break(()) {
                self.stop.store(true, Ordering::Relaxed);
            }
        }
    }

    fn not_determined(
        &self,
        system: &Augmented,
        side: Side,
        support: f64,
        reached: usize,
    ) -> DesignError {
        let pair = &system.pairs[side.pair];
        let row = if side.upper {
            pair.upper
        } else {
            pair.lower.map_or(pair.upper, |l| l.0)
        };
        let source: RowSource = self.problem.rows().source[row];
        DesignError::HorizonNotDetermined {
            reached,
            row: source.to_string(),
            support,
            known: format!("it is at least {}", reached + 1),
            hint: format!(
                "Allow more steps (max_horizon), lower the scaling ({}), choose a faster gain, or widen that bound",
                self.problem.scaling()
            ),
        }
    }
}

enum Outcome {
    Spent(usize),
    /// Not spent at the last step asked; the value of a witness.
    Open(f64),
    Stopped,
}

/// Where the rows found so far were first spent; neighbours often agree.
#[derive(Default)]
struct Hints {
    last: AtomicUsize,
}

impl Hints {
    fn found(&self, step: usize) {
        self.last.store(step, Ordering::Relaxed);
    }

    /// The step to ask next between `low` (not spent) and `high` (spent).
    fn next(&self, low: usize, high: usize) -> usize {
        let last = self.last.load(Ordering::Relaxed);
        // If the neighbour's step fits, ask just before it and at it: two programs settle the row.
        if last < high && last > low {
            last
        } else if last == high || last == low + 1 {
            high - 1
        } else {
            low + (high - low) / 2
        }
        .clamp(low + 1, high - 1)
    }
}
