//! The augmented system (7)(21)–(24) in coordinates in which it is block diagonal.
//!
//! With e = x − M_θx θ the terminal dynamics are e⁺ = (A + B K) e, θ⁺ = θ, and a row of X_aug,t after s steps reads
//!   (C + D K)_i (A + B K)^s e + w_i θ ≤ 1,   w_i = (C M_θx + D M_θu)_i,
//! while θ ∈ λΘ reads w_i θ / λ ≤ 1 whatever s. Two things follow. The θ part never changes, so nothing drifts; and a
//! row tends to λ times a row of λΘ, which is why it is spent after finitely many steps.
//!
//! Rows come in opposite pairs (lower and upper bounds); a pair is kept once, as −l ≤ r·z ≤ u.

use crate::linalg::{self, Dense};
use crate::matrix::SparseMatrix;
use crate::problem::{Problem, Task};
use crate::steady_state::SteadyStates;

/// One direction with an upper and, where the problem has it, a lower side.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    /// The constraint row that bounds it from above; the pair is scaled so that this bound is 1.
    pub(super) upper: usize,
    /// The constraint row that bounds it from below, and that bound l.
    pub(super) lower: Option<(usize, f64)>,
}

impl Pair {
    pub(super) fn lower_bound(&self) -> f64 {
        self.lower.map_or(f64::INFINITY, |l| l.1)
    }
}

/// The rows along the terminal law, for the program of the controller.
pub(crate) struct LawRows {
    /// For each pair the row that bounds it from above by 1, and the row that bounds it from below, with that bound.
    pub(crate) pairs: Vec<(usize, Option<(usize, f64)>)>,
    /// C M_θx + D M_θu, pairs × m; no columns for regulation.
    pub(crate) equilibrium: SparseMatrix,
    /// (C + D K)(A + B K)^s, pairs × n, for s = 0, 1, …
    pub(crate) powers: Vec<SparseMatrix>,
}

/// The rows of the augmented system, step by step.
///
/// Where subsystems are coupled weakly, rows are local: their entries decay with the distance. Entries that the box
/// |z_l| ≤ β_l makes smaller than rounding are dropped, and what they could amount to is kept with the row. With
/// r_s = r_{s−1} A_K − d_s the stored row is r_0 A_Kˢ − Σ_t d_t A_K^{s−t}, and because A_Kᵗ z stays in the box for
/// every z of O_{s−1}, the slack of a stored row is Σ_t Σ_l |d_t|_l β_l: it adds up and does not grow.
pub(super) struct Augmented {
    /// States n.
    pub(super) states: usize,
    /// Dimension of θ: m for tracking, 0 for regulation.
    pub(super) parameters: usize,
    /// λ.
    pub(super) scaling: f64,
    pub(super) pairs: Vec<Pair>,
    /// w_i for each pair, in the columns n, …, n + m − 1 of z.
    equilibrium: SparseMatrix,
    /// (C + D K)_i (A + B K)^s for each pair, one matrix a step.
    powers: Vec<SparseMatrix>,
    /// Slack of each of these rows.
    slack: Vec<Vec<f64>>,
    closed_loop: SparseMatrix,
    /// The same, when it is full enough for the dense product.
    dense: Option<Dense>,
    /// β; empty until a box is known, and nothing is dropped before.
    beta: Vec<f64>,
}

/// Above this share of entries the plant is not local: nothing is dropped, and full products are faster.
const DENSE_SHARE: f64 = 0.6;
/// Entries with |r_l| β_l below this, where the bound of the row is 1, are dropped. A row of a thousand such entries
/// moves a support by 1e-12 a step, far below the tolerance of a verdict, to which it is added all the same.
const DROP: f64 = 1e-15;

impl Augmented {
    pub(super) fn new(
        problem: &Problem,
        gain: &SparseMatrix,
        closed_loop: &SparseMatrix,
        steady: &SteadyStates,
    ) -> Self {
        let rows = problem.rows();
        let pairs = pair_up(&rows.c, &rows.d);
        let first: Vec<usize> = pairs.iter().map(|p| p.upper).collect();
        let (c, d) = (rows.c.select_rows(&first), rows.d.select_rows(&first));
        let n = problem.plant().states();
        let (parameters, equilibrium) = match problem.task() {
            Task::Tracking => {
                let m = problem.plant().inputs();
                let w = c
                    .mul(steady.state_basis())
                    .combine(1.0, &d.mul(steady.input_basis()), 1.0);
                (m, in_columns_of_z(&w, n))
            }
            Task::Regulation => (0, SparseMatrix::zeros(pairs.len(), n)),
        };
        let terminal = c.combine(1.0, &d.mul(gain), 1.0);
        Self {
            states: n,
            parameters,
            scaling: problem.scaling(),
            slack: vec![vec![0.0; pairs.len()]],
            pairs,
            equilibrium,
            powers: vec![terminal],
            dense: (closed_loop.share() > DENSE_SHARE).then(|| linalg::dense(closed_loop)),
            closed_loop: closed_loop.clone(),
            beta: Vec::new(),
        }
    }

    /// Dimension of z = (e, θ).
    pub(super) fn dimension(&self) -> usize {
        self.states + self.parameters
    }

    /// Another λ. Rows that are already there stay as they are: they do not depend on it.
    pub(super) fn scale_to(&mut self, scaling: f64) {
        self.scaling = scaling;
    }

    /// Rows from here on drop what the box |z_l| ≤ β_l makes negligible. A box that is known stays when it is wider.
    pub(super) fn drop_within(&mut self, beta: &[f64]) {
        if self.beta.is_empty() {
            self.beta = beta.to_vec();
        } else {
            for (old, new) in self.beta.iter_mut().zip(beta) {
                *old = old.max(*new);
            }
        }
    }

    /// Makes the rows of steps 0, …, `step` available.
    pub(super) fn extend_to(&mut self, step: usize) {
        while self.powers.len() <= step {
            let last = self.powers.len() - 1;
            let (next, slack) = match &self.dense {
                Some(closed_loop) => (
                    linalg::sparse(&(linalg::dense(&self.powers[last]) * closed_loop)),
                    self.slack[last].clone(),
                ),
                None => {
                    let (next, dropped) =
                        self.powers[last].mul_with(&self.closed_loop, |i, row| self.drop(i, row));
                    let before = &self.slack[last];
                    (
                        next,
                        before.iter().zip(dropped).map(|(a, b)| a + b).collect(),
                    )
                }
            };
            self.powers.push(next);
            self.slack.push(slack);
        }
    }

    /// Drops what is negligible from a row of pair i; returns what it could amount to.
    fn drop(&self, i: usize, row: &mut Vec<(u32, f64)>) -> f64 {
        if self.beta.is_empty() {
            return 0.0;
        }
        let negligible = DROP * self.pairs[i].lower_bound().min(1.0);
        let mut dropped = 0.0;
        row.retain(|&(j, v)| {
            let reach = v.abs() * self.beta[j as usize];
            let keep = reach > negligible;
            if !keep {
                dropped += reach;
            }
            keep
        });
        dropped
    }

    /// The e part of the row of a pair after `step` steps: columns and values.
    pub(super) fn e_part(&self, pair: usize, step: usize) -> (&[u32], &[f64]) {
        self.powers[step].row_slices(pair)
    }

    /// w of a pair: columns of z and values.
    pub(super) fn w(&self, pair: usize) -> (&[u32], &[f64]) {
        self.equilibrium.row_slices(pair)
    }

    /// What the dropped entries of a row could amount to, for every z in the set its step belongs to.
    pub(super) fn slack(&self, pair: usize, step: usize) -> f64 {
        self.slack[step][pair]
    }

    /// The row of a pair after `step` steps, as entries of z = (e, θ), columns ascending.
    pub(super) fn moving_row(&self, pair: usize, step: usize) -> Vec<(usize, f64)> {
        self.powers[step]
            .row(pair)
            .chain(self.equilibrium.row(pair))
            .collect()
    }

    /// The row of θ ∈ λΘ of a pair; empty when the pair says nothing about equilibria.
    pub(super) fn static_row(&self, pair: usize) -> Vec<(usize, f64)> {
        self.equilibrium
            .row(pair)
            .map(|(j, v)| (j, v / self.scaling))
            .collect()
    }

    /// What the program of a controller needs of this; m is the number of inputs.
    pub(super) fn into_law_rows(self, m: usize) -> LawRows {
        let n = self.states;
        let parameters = if self.parameters > 0 { m } else { 0 };
        let equilibrium = SparseMatrix::from_row_lists(
            self.pairs.len(),
            parameters,
            (0..self.pairs.len()).map(|i| {
                self.equilibrium
                    .row(i)
                    .map(|(j, v)| ((j - n) as u32, v))
                    .collect()
            }),
        );
        LawRows {
            pairs: self.pairs.iter().map(|p| (p.upper, p.lower)).collect(),
            equilibrium,
            powers: self.powers,
        }
    }

    /// C M_θx + D M_θu of the pairs, in columns of z.
    pub(super) fn equilibrium(&self) -> &SparseMatrix {
        &self.equilibrium
    }
}

/// Moves w to the columns of θ in z. Entries that are rounding of a sum whose terms cancel are left out: the value of
/// a constraint at an equilibrium basis vector is at most 1 by the choice of the basis.
fn in_columns_of_z(w: &SparseMatrix, n: usize) -> SparseMatrix {
    SparseMatrix::from_row_lists(
        w.rows(),
        n + w.cols(),
        (0..w.rows()).map(|i| {
            w.row(i)
                .filter(|e| e.1.abs() > 1e-14)
                .map(|(j, v)| ((n + j) as u32, v))
                .collect()
        }),
    )
}

/// Entries of a row divided by the largest, rounded.
type Direction = Vec<(usize, i64)>;

/// Finds opposite rows: C_j = −ρ C_i and D_j = −ρ D_i with ρ > 0.
fn pair_up(c: &SparseMatrix, d: &SparseMatrix) -> Vec<Pair> {
    use std::collections::HashMap;
    let p = c.rows();
    // The direction of a row: its entries divided by the largest, which rounding must not separate. Divided by an entry
    // that is itself rounding, different rows would look alike.
    let key = |i: usize| -> Option<(f64, Direction)> {
        let entries: Vec<(usize, f64)> = c
            .row(i)
            .chain(d.row(i).map(|(j, v)| (j + c.cols(), v)))
            .collect();
        let first = entries.iter().fold(0.0_f64, |a, e| {
            if e.1.abs() > a.abs() * (1.0 + 1e-9) {
                e.1
            } else {
                a
            }
        });
        if first == 0.0 {
            return None;
        }
        let direction = entries
            .iter()
            .map(|&(j, v)| (j, ((v / first) * 1e12).round() as i64))
            .filter(|e| e.1 != 0)
            .collect();
        Some((first, direction))
    };
    let mut open: HashMap<Direction, Vec<(usize, f64)>> = HashMap::new();
    let mut pairs: Vec<Pair> = Vec::with_capacity(p / 2 + 1);
    for i in 0..p {
        let Some((first, direction)) = key(i) else {
            continue;
        };
        let waiting = open.entry(direction).or_default();
        // `waiting` holds pairs without a lower side.
        match waiting.iter().position(|&(_, f)| f * first < 0.0) {
            Some(k) => {
                let (pair, f) = waiting.swap_remove(k);
                // −row_i ≤ 1 with row_i = (first/f) row: row ≥ f/first·1 … the bound is |f/first|.
                pairs[pair].lower = Some((i, (f / first).abs()));
            }
            None => {
                waiting.push((pairs.len(), first));
                pairs.push(Pair {
                    upper: i,
                    lower: None,
                });
            }
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Matrix;

    #[test]
    fn opposite_rows_are_kept_once() {
        // x ≤ 2, x ≥ −4, x + u ≤ 1, normalised to right-hand sides 1.
        let c = (&Matrix::from_rows(&[[0.5], [-0.25], [1.0]])).into();
        let d = (&Matrix::from_rows(&[[0.0], [0.0], [1.0]])).into();
        let pairs = pair_up(&c, &d);
        assert_eq!(pairs.len(), 2);
        assert_eq!(pairs[0].upper, 0);
        // 0.5 x ≥ −2 is x ≥ −4.
        assert_eq!(pairs[0].lower, Some((1, 2.0)));
        assert!(pairs[1].lower.is_none());
    }

    #[test]
    fn entries_that_are_rounding_do_not_decide_the_bound_of_the_opposite_row() {
        // (0, 1) and (0, -1), of a polygon whose rows are cosines and sines.
        let c = (&Matrix::from_rows(&[[6.1e-17, 0.5], [-1.8e-16, -0.25]])).into();
        let pairs = pair_up(&c, &(&Matrix::zeros(2, 1)).into());
        assert_eq!(pairs.len(), 1);
        assert_eq!(pairs[0].lower, Some((1, 2.0)));
    }
}
