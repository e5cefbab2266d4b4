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

/// The rows of the augmented system, step by step.
pub(super) struct Augmented {
    /// States n.
    pub(super) states: usize,
    /// Dimension of θ: m for tracking, 0 for regulation.
    pub(super) parameters: usize,
    /// λ.
    pub(super) scaling: f64,
    pub(super) pairs: Vec<Pair>,
    /// w_i for each pair, pairs × parameters.
    pub(super) equilibrium: SparseMatrix,
    /// (C + D K)_i (A + B K)^s for each pair, one matrix a step.
    powers: Vec<Power>,
    closed_loop: Power,
}

/// A matrix in the form in which it is cheaper.
enum Power {
    Dense(Dense),
    Sparse(SparseMatrix),
}

/// Above this share of entries the dense product is faster.
const DENSE_SHARE: f64 = 0.25;
/// Entries this much smaller than the largest of their row are rounding of the product they come from.
const DROP: f64 = 1e-17;

impl Power {
    fn from_dense(m: &Dense) -> Self {
        let sparse = dropped(m);
        let share = sparse.nonzeros() as f64 / (m.nrows() * m.ncols()).max(1) as f64;
        if share > DENSE_SHARE {
            Self::Dense(m.clone())
        } else {
            Self::Sparse(sparse)
        }
    }

    fn times(&self, other: &Self) -> Self {
        match (self, other) {
            (Self::Sparse(a), Self::Sparse(b)) => {
                let product = a.mul(b);
                let share = product.nonzeros() as f64 / (a.rows() * b.cols()).max(1) as f64;
                if share > DENSE_SHARE {
                    Self::Dense(linalg::dense(&product))
                } else {
                    Self::Sparse(dropped_sparse(&product))
                }
            }
            (Self::Dense(a), Self::Dense(b)) => Self::Dense(a * b),
            (Self::Dense(a), Self::Sparse(b)) => Self::Dense(a * linalg::dense(b)),
            (Self::Sparse(a), Self::Dense(b)) => Self::Dense(linalg::dense(a) * b),
        }
    }

    fn row(&self, i: usize) -> Vec<(usize, f64)> {
        match self {
            Self::Dense(m) => (0..m.ncols())
                .map(|j| (j, m[(i, j)]))
                .filter(|e| e.1 != 0.0)
                .collect(),
            Self::Sparse(m) => m.row(i).collect(),
        }
    }
}

fn dropped(m: &Dense) -> SparseMatrix {
    SparseMatrix::from_row_lists(
        m.nrows(),
        m.ncols(),
        (0..m.nrows()).map(|i| {
            let largest = (0..m.ncols()).fold(0.0_f64, |a, j| a.max(m[(i, j)].abs()));
            (0..m.ncols())
                .filter(|&j| m[(i, j)].abs() > DROP * largest)
                .map(|j| (j as u32, m[(i, j)]))
                .collect()
        }),
    )
}

fn dropped_sparse(m: &SparseMatrix) -> SparseMatrix {
    SparseMatrix::from_row_lists(
        m.rows(),
        m.cols(),
        (0..m.rows()).map(|i| {
            let largest = m.row(i).fold(0.0_f64, |a, e| a.max(e.1.abs()));
            m.row(i)
                .filter(|e| e.1.abs() > DROP * largest)
                .map(|(j, v)| (j as u32, v))
                .collect()
        }),
    )
}

impl Augmented {
    pub(super) fn new(
        problem: &Problem,
        gain: &Dense,
        closed_loop: &Dense,
        steady: &SteadyStates,
    ) -> Self {
        let rows = problem.rows();
        let pairs = pair_up(&rows.c, &rows.d);
        let first: Vec<usize> = pairs.iter().map(|p| p.upper).collect();
        let (c, d) = (rows.c.select_rows(&first), rows.d.select_rows(&first));
        let parameters = match problem.task() {
            Task::Tracking => problem.plant().inputs(),
            Task::Regulation => 0,
        };
        let equilibrium = match problem.task() {
            Task::Tracking => {
                c.mul(steady.state_basis())
                    .combine(1.0, &d.mul(steady.input_basis()), 1.0)
            }
            Task::Regulation => SparseMatrix::zeros(pairs.len(), 0),
        };
        let terminal = linalg::dense(&c) + linalg::dense(&d) * gain;
        Self {
            states: problem.plant().states(),
            parameters,
            scaling: problem.scaling(),
            pairs,
            equilibrium: cleaned(&equilibrium),
            powers: vec![Power::from_dense(&terminal)],
            closed_loop: Power::from_dense(closed_loop),
        }
    }

    /// Dimension of z = (e, θ).
    pub(super) fn dimension(&self) -> usize {
        self.states + self.parameters
    }

    /// Makes the rows of steps 0, …, `step` available.
    pub(super) fn extend_to(&mut self, step: usize) {
        while self.powers.len() <= step {
            let next = self.powers[self.powers.len() - 1].times(&self.closed_loop);
            self.powers.push(next);
        }
    }

    /// The row of a pair after `step` steps, as entries of z = (e, θ), columns ascending.
    pub(super) fn moving_row(&self, pair: usize, step: usize) -> Vec<(usize, f64)> {
        let mut row = self.powers[step].row(pair);
        row.extend(
            self.equilibrium
                .row(pair)
                .map(|(j, v)| (self.states + j, v)),
        );
        row
    }

    /// The row of θ ∈ λΘ of a pair; empty when the pair says nothing about equilibria.
    pub(super) fn static_row(&self, pair: usize) -> Vec<(usize, f64)> {
        self.equilibrium
            .row(pair)
            .map(|(j, v)| (self.states + j, v / self.scaling))
            .collect()
    }
}

/// Without entries that are rounding of a sum whose terms cancel: the value of a constraint at an equilibrium basis
/// vector is at most 1 by the choice of the basis.
fn cleaned(w: &SparseMatrix) -> SparseMatrix {
    SparseMatrix::from_row_lists(
        w.rows(),
        w.cols(),
        (0..w.rows()).map(|i| {
            w.row(i)
                .filter(|e| e.1.abs() > 1e-14)
                .map(|(j, v)| (j as u32, v))
                .collect()
        }),
    )
}

/// A row's direction: columns, and entries relative to the first, in units of 1e-12.
type Direction = Vec<(usize, i64)>;

/// Finds opposite rows: C_j = −ρ C_i and D_j = −ρ D_i with ρ > 0.
fn pair_up(c: &SparseMatrix, d: &SparseMatrix) -> Vec<Pair> {
    use std::collections::HashMap;
    let p = c.rows();
    // The direction of a row: its entries divided by the first, which rounding must not separate.
    let key = |i: usize| -> Option<(f64, Direction)> {
        let entries: Vec<(usize, f64)> = c
            .row(i)
            .chain(d.row(i).map(|(j, v)| (j + c.cols(), v)))
            .collect();
        let first = entries.first()?.1;
        let direction = entries
            .iter()
            .map(|&(j, v)| (j, ((v / first) * 1e12).round() as i64))
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
}
