//! How wide the box really has to be.

use super::interval::{add_up, mul_up};

/// What the proofs of the box say about κ_l = max |z_l|/β_l:
///   κ_l ≤ value_l + Σ_j left_over_lj κ_j + slack_l max κ.
///
/// If κ̂ satisfies right-hand side ≤ κ̂ and value > 0, then κ ≤ κ̂: with α = max κ_l/κ̂_l > 1 it would follow that
/// κ ≤ value + α (κ̂ − value) < α κ̂, which contradicts the choice of α. The same with value = 0, on directions in which
/// the set is unbounded, shows that there are none and that κ is finite.
#[derive(Default)]
pub(super) struct Widths {
    pub(super) rows: Vec<WidthRow>,
}

/// One coordinate; the larger of both directions.
#[derive(Default)]
pub(super) struct WidthRow {
    pub(super) value: f64,
    pub(super) slack: f64,
    pub(super) left_over: Vec<(usize, f64)>,
}

impl WidthRow {
    /// Takes the other direction in.
    pub(super) fn join(&mut self, value: f64, slack: f64, left_over: Vec<(usize, f64)>) {
        self.value = self.value.max(value);
        self.slack = self.slack.max(slack);
        self.left_over.extend(left_over);
        self.left_over
            .sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
        self.left_over.dedup_by_key(|e| e.0);
    }
}

/// Rounds in which κ̂ is sought: each proof may rest on coordinates proved before it.
const ROUNDS: usize = 60;
/// κ̂ is made this much larger in every round, so that rounding does not spoil the inequality in the end.
const ROOM: f64 = 1e-12;
/// A box that would have to be widened more than this is no proof of anything.
const WIDEST: f64 = 1e3;

impl Widths {
    /// κ̂; `None` when none is found.
    pub(super) fn solve(&self) -> Option<Vec<f64>> {
        let mut kappa = vec![1.0_f64; self.rows.len()];
        for _ in 0..ROUNDS {
            let largest = kappa.iter().fold(0.0_f64, |a, &k| a.max(k));
            if !(largest < WIDEST) {
                return None;
            }
            let bound = |row: &WidthRow| {
                let value = row.value.max(f64::MIN_POSITIVE);
                let start = add_up(value, mul_up(row.slack, largest));
                let terms = row.left_over.iter();
                terms.fold(start, |s, &(j, q)| add_up(s, mul_up(q, kappa[j])))
            };
            let right: Vec<f64> = self.rows.iter().map(bound).collect();
            if right.iter().zip(&kappa).all(|(r, k)| r <= k) {
                return Some(kappa);
            }
            for (k, r) in kappa.iter_mut().zip(&right) {
                *k = k.max(r * (1.0 + ROOM));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(value: f64, left_over: &[(usize, f64)]) -> WidthRow {
        WidthRow {
            value,
            slack: 1e-15,
            left_over: left_over.to_vec(),
        }
    }

    #[test]
    fn a_coordinate_may_rest_on_another() {
        let widths = Widths {
            rows: vec![row(1.0, &[(0, 1e-16)]), row(0.4, &[(0, 0.6)])],
        };
        let kappa = widths.solve().unwrap();
        assert!(kappa.iter().all(|&k| (1.0..1.0 + 1e-9).contains(&k)));
    }

    #[test]
    fn coordinates_that_rest_on_each_other_are_refused() {
        let widths = Widths {
            rows: vec![row(0.4, &[(1, 1.0)]), row(0.4, &[(0, 1.0)])],
        };
        assert!(widths.solve().is_none());
    }
}
