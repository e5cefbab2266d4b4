//! Where to look first: rows that fade alike are spent alike.

use crate::terminal::bank::Bank;
use crate::terminal::support::Side;
use std::collections::VecDeque;

/// How a row fades: the value of its e part over the box after 0, 1, 2, 4, … steps, as logarithms.
pub(super) type Profile = Vec<f64>;

pub(super) fn support_profile(bank: &Bank, side: Side, last: usize) -> Profile {
    let steps = std::iter::once(0).chain((0..).map(|k| 1_usize << k));
    steps
        .take_while(|&s| s < last)
        .map(|s| bank.total(bank.moving(side.pair, s)).max(1e-300).ln())
        .collect()
}

/// Where rows were first spent. Rows that fade alike are spent alike.
#[derive(Clone, Default)]
pub(super) struct Hints {
    recent: VecDeque<(Profile, usize)>,
}

/// Rows remembered.
const REMEMBERED: usize = 24;

impl Hints {
    pub(super) fn add(&mut self, profile: Profile, at: usize) {
        if self.recent.len() == REMEMBERED {
            self.recent.pop_front();
        }
        self.recent.push_back((profile, at));
    }

    pub(super) fn nearest(&self, profile: &[f64]) -> Option<usize> {
        let distance = |other: &[f64]| -> f64 {
            let parts = profile.iter().zip(other).map(|(a, b)| (a - b).abs());
            parts.sum()
        };
        self.recent
            .iter()
            .map(|(p, at)| (distance(p), *at))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|best| best.1)
    }
}
