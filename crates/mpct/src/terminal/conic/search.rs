//! The terminal horizon: every row and ellipsoid is searched alone, by doubling and bisection.

use super::ConicSystem;
use super::spent::{Question, Verdict};
use crate::clock::Clock;
use crate::error::DesignError;
use crate::problem::{Problem, RowSource};
use crate::terminal::{Condition, DesignOptions, Progress};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What the search found.
pub(in crate::terminal) struct Found {
    /// M or M̃.
    pub(in crate::terminal) horizon: usize,
    /// First step at which each row, then each ellipsoid, is proved spent.
    pub(in crate::terminal) spent: Vec<usize>,
    /// A point shows that one step less is too few.
    pub(in crate::terminal) minimal: bool,
    pub(in crate::terminal) programs: usize,
}

/// Finds the horizon. `polytope` holds, by row, steps at which the rows alone imply it.
pub(in crate::terminal) fn search(
    problem: &Problem,
    system: &mut ConicSystem,
    polytope: Option<&[usize]>,
    options: &DesignOptions<'_>,
    clock: &Clock,
) -> Result<Found, DesignError> {
    let mut search = Search {
        problem,
        options,
        clock,
        programs: AtomicUsize::new(0),
        done: AtomicUsize::new(0),
        at_least: AtomicUsize::new(1),
        spent: vec![usize::MAX; system.items()],
    };
    if let Some(polytope) = polytope {
        search.spent[..polytope.len()].copy_from_slice(polytope);
    }
    match options.condition {
        Condition::Exact => search.exact(system),
        Condition::Sufficient => search.sufficient(system),
    }
}

struct Search<'a> {
    problem: &'a Problem,
    options: &'a DesignOptions<'a>,
    clock: &'a Clock,
    programs: AtomicUsize,
    done: AtomicUsize,
    at_least: AtomicUsize,
    /// Steps at which items are known to be spent.
    spent: Vec<usize>,
}

/// An item: not shown to be spent at `low`.
#[derive(Clone, Copy)]
struct Open {
    item: usize,
    low: usize,
    /// The largest step at which a point refutes it.
    refuted: usize,
    /// Its largest value or smallest bound at `low`.
    support: f64,
}

impl Search<'_> {
    fn exact(mut self, system: &mut ConicSystem) -> Result<Found, DesignError> {
        let start = |item| Open {
            item,
            low: 0,
            refuted: 0,
            support: f64::NAN,
        };
        let mut open: Vec<Open> = (0..system.items()).map(start).collect();
        let mut refuted = vec![0; system.items()];
        let last = self.options.max_horizon.saturating_add(1);
        let mut step = 1;
        while !open.is_empty() {
            system.extend_to(step);
            let found: Vec<Result<(Open, Option<usize>), DesignError>> = open
                .par_iter()
                .map(|&item| self.first_spent(system, item, step))
                .collect();
            let mut left = Vec::new();
            for outcome in found {
                match outcome? {
                    (item, Some(at)) => {
                        self.spent[item.item] = at;
                        refuted[item.item] = item.refuted;
                    }
                    (item, None) => left.push(item),
                }
            }
            open = left;
            if step >= last
                && let Some(worst) = open.iter().max_by(|a, b| a.support.total_cmp(&b.support))
            {
                return Err(self.not_determined(worst, last - 1));
            }
            step = (2 * step).min(last);
        }
        let horizon = self.spent.iter().max().map_or(1, |s| s - 1).max(1);
        let by = |(&at, &refuted): (&usize, &usize)| at == horizon + 1 && refuted == horizon;
        Ok(Found {
            horizon,
            minimal: horizon == 1 || self.spent.iter().zip(&refuted).any(by),
            spent: self.spent,
            programs: self.programs.into_inner(),
        })
    }

    /// The first step in (low, step] at which the item is shown to be spent, by bisection.
    fn first_spent(
        &self,
        system: &ConicSystem,
        mut item: Open,
        step: usize,
    ) -> Result<(Open, Option<usize>), DesignError> {
        let known = self.spent[item.item];
        let mut high = (known <= step).then_some(known);
        while high.is_none_or(|h| h > item.low + 1) {
            let at = high.map_or(step, |h| usize::midpoint(item.low, h));
            if at == item.low {
                break;
            }
            match self.ask(system, item.item, at, at)? {
                Verdict::Spent(_) => high = Some(at),
                Verdict::NotSpent(value) => {
                    self.at_least.fetch_max(at, Ordering::Relaxed);
                    (item.low, item.refuted, item.support) = (at, at, value);
                }
                Verdict::Undecided(bound) => (item.low, item.support) = (at, bound),
            }
        }
        if high.is_some() {
            self.done.fetch_add(1, Ordering::Relaxed);
        }
        Ok((item, high))
    }

    fn ask(
        &self,
        system: &ConicSystem,
        item: usize,
        step: usize,
        known: usize,
    ) -> Result<Verdict, DesignError> {
        if let Some(progress) = self.options.progress {
            let told = progress(&Progress {
                rows_done: self.done.load(Ordering::Relaxed),
                rows_total: system.items(),
                row: Some(self.source(item)),
                step,
                terminal_horizon_at_least: self.at_least.load(Ordering::Relaxed),
            });
            if told == ControlFlow::Break(()) {
                self.clock.stop();
            }
        }
        if self.clock.has_stopped() {
            return Err(DesignError::Interrupted {
                at_least: self.at_least.load(Ordering::Relaxed),
                rows_left: system.items() - self.done.load(Ordering::Relaxed).min(system.items()),
            });
        }
        let spent = &self.spent;
        Ok(system.decide(
            Question {
                item,
                step,
                known,
                spent,
            },
            &self.programs,
        ))
    }

    fn sufficient(self, system: &mut ConicSystem) -> Result<Found, DesignError> {
        let items = system.items();
        let mut first = 0;
        for horizon in 1..=self.options.max_horizon {
            let step = horizon + 1;
            system.extend_to(step);
            let mut refused = None;
            for k in 0..items {
                // The item that refused the last step is asked first.
                let item = (first + k) % items;
                let support = match self.ask(system, item, step, 1)? {
                    Verdict::Spent(_) => continue,
                    Verdict::NotSpent(value) => value,
                    Verdict::Undecided(bound) => bound,
                };
                refused = Some(Open {
                    item,
                    low: step,
                    refuted: 0,
                    support,
                });
                first = item;
                break;
            }
            match refused {
                None => {
                    return Ok(Found {
                        horizon,
                        spent: vec![step; items],
                        minimal: horizon == 1,
                        programs: self.programs.into_inner(),
                    });
                }
                Some(item) if horizon == self.options.max_horizon => {
                    return Err(self.not_determined(&item, horizon));
                }
                Some(_) => self.at_least.store(horizon, Ordering::Relaxed),
            }
        }
        Err(DesignError::OutOfRange {
            what: "the largest terminal horizon".into(),
            expected: "at least 1".into(),
            found: self.options.max_horizon.to_string(),
        })
    }

    fn source(&self, item: usize) -> RowSource {
        let rows = self.problem.rows();
        match item.checked_sub(rows.len()) {
            None => rows.source[item],
            Some(k) => self.problem.norms()[k].source,
        }
    }

    fn not_determined(&self, item: &Open, reached: usize) -> DesignError {
        let source = self.source(item.item);
        let shown = if item.refuted > 0 {
            format!("it is at least {}", item.refuted + 1)
        } else {
            "no point shows that fewer steps are too few, but no proof was found".into()
        };
        DesignError::HorizonNotDetermined {
            reached,
            row: source.to_string(),
            support: item.support,
            known: shown,
            hint: format!(
                "Allow more steps (max_horizon), lower the scaling ({}), choose a faster gain, or widen that bound",
                self.problem.scaling()
            ),
        }
    }
}
