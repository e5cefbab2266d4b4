//! The second, sufficient form: every row of a step against X_aug,t alone.

use super::{Found, Open, Search};
use crate::error::DesignError;
use crate::terminal::augmented::Augmented;
use crate::terminal::bank::Bank;
use crate::terminal::program::{Expected, Workspace};
use crate::terminal::support::{Side, Support, Verdict};
use std::sync::atomic::Ordering;
use std::time::Duration;

impl Search<'_> {
    pub(super) fn sufficient(
        &self,
        system: &mut Augmented,
        bank: &mut Bank,
    ) -> Result<Found, DesignError> {
        let sides = self.sides(system);
        self.total.store(sides.len(), Ordering::Relaxed);
        let mut ws = Workspace::default();
        let (mut programs, mut rows) = (0, Duration::ZERO);
        let mut first = 0;
        for horizon in 1..=self.options.max_horizon {
            let step = horizon + 1;
            let before = self.clock.elapsed();
            system.extend_to(step);
            bank.extend_to(system, step);
            rows += self.clock.elapsed() - before;
            let support = Support::new(system, bank, 0, self.clock);
            let mut refused = None;
            let ask = |ws: &mut Workspace, side: Side| match support.is_spent(
                ws,
                side,
                step,
                1,
                Expected::Spent,
            )? {
                Verdict::Spent => Ok(None),
                Verdict::NotSpent(value) => Ok(Some((side, value))),
                Verdict::Stopped => Err(DesignError::Interrupted {
                    at_least: horizon,
                    rows_left: self.problem.rows().len(),
                }),
            };
            for k in 0..sides.len() {
                let at = (first + k) % sides.len();
                if self.clock.has_stopped() {
                    return Err(DesignError::Interrupted {
                        at_least: horizon,
                        rows_left: self.problem.rows().len(),
                    });
                }
                self.note(sides[at], step);
                if let Some(found) = ask(&mut ws, sides[at])? {
                    refused = Some(found);
                    first = at;
                    break;
                }
            }
            programs += support.programs();
            self.at_least.fetch_max(horizon, Ordering::Relaxed);
            self.report(system);
            match refused {
                None => {
                    let both = [step, step];
                    return Ok(Found {
                        horizon,
                        spent: vec![both; system.pairs.len()],
                        programs,
                        rows,
                    });
                }
                Some((side, support)) if horizon == self.options.max_horizon => {
                    let row = Open {
                        side,
                        low: step,
                        support,
                    };
                    return Err(self.not_determined(system, &row, horizon, ""));
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
}
