//! What is said of a row that is not spent within the horizon allowed.

use super::{Open, Search};
use crate::error::DesignError;
use crate::terminal::augmented::Augmented;
use crate::terminal::bank::Bank;
use crate::terminal::program::{Expected, Workspace};
use crate::terminal::support::{Side, Support, Verdict};

impl Search<'_> {
    /// The support of a side over the steps, in words.
    pub(super) fn trend(
        &self,
        system: &Augmented,
        bank: &Bank,
        side: Side,
        last: usize,
    ) -> Result<String, DesignError> {
        let support = Support::new(system, bank, last - 1, self.clock);
        let mut ws = Workspace::default();
        let mut text = Vec::new();
        for quarter in 1..=4 {
            let step = (last * quarter / 4).max(1);
            if let Verdict::NotSpent(value) =
                support.is_spent(&mut ws, side, step, step, Expected::NotSpent)?
            {
                text.push(format!("{value:.6} at step {step}"));
            }
        }
        text.dedup();
        Ok(text.join(", "))
    }

    pub(super) fn not_determined(
        &self,
        system: &Augmented,
        row: &Open,
        reached: usize,
        trend: &str,
    ) -> DesignError {
        let mut hint = if trend.is_empty() {
            String::new()
        } else {
            format!("Its support over the steps: {trend}. ")
        };
        hint.push_str(&format!(
            "Allow more steps (max_horizon), lower the scaling ({}), choose a faster gain, or widen that bound",
            self.problem.scaling()
        ));
        DesignError::HorizonNotDetermined {
            reached,
            row: self
                .source(system, row.side)
                .map_or_else(String::new, |r| r.to_string()),
            support: row.support,
            known: format!("it is at least {}", reached + 1),
            hint,
        }
    }
}
