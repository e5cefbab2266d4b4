//! The maximal admissible set (16)(27), without redundant rows.
//!
//! Rows that are spent do not enter. Of the others, a row is redundant when its support over the rest is at most its
//! bound; it is then dropped for good, so that of equal rows one remains.

use super::augmented::Augmented;
use super::boxes::Boxes;
use super::support::{RowId, Side, Support};
use crate::error::DesignError;
use crate::matrix::SparseMatrix;
use crate::steady_state::SteadyStates;

/// A polytope {(x, θ) : G (x, θ) ≤ 1} of dimension n + m for tracking, n for regulation, without redundant rows.
#[derive(Clone, Debug, PartialEq)]
pub struct MaximalAdmissibleSet {
    rows: SparseMatrix,
    states: usize,
    /// Constraint row and step of each row; `None` for the step of a row of θ ∈ λΘ.
    origin: Vec<(usize, Option<usize>)>,
}

impl MaximalAdmissibleSet {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.origin.len()
    }

    /// Whether the set has no row, which a bounded one never has.
    pub fn is_empty(&self) -> bool {
        self.origin.is_empty()
    }

    /// G, with columns (x, θ); every right-hand side is 1.
    pub fn rows(&self) -> &SparseMatrix {
        &self.rows
    }

    /// Where row k comes from: the constraint row (an index of [`Problem::rows`](crate::Problem::rows)) and the step of the terminal law, or
    /// `None` for θ ∈ λΘ.
    pub fn origin(&self, k: usize) -> (usize, Option<usize>) {
        self.origin[k]
    }

    /// Whether (x, θ) lies in the set, up to a slack of `tolerance` in rows whose right-hand side is 1. States in
    /// shifted coordinates.
    pub fn contains(&self, x: &[f64], theta: &[f64], tolerance: f64) -> bool {
        let z: Vec<f64> = x.iter().chain(theta).copied().collect();
        z.len() == self.rows.cols()
            && (0..self.len()).all(|k| self.rows.row_dot(k, &z) <= 1.0 + tolerance)
    }

    /// Number of states n.
    pub fn states(&self) -> usize {
        self.states
    }
}

pub(super) fn irredundant(
    system: &mut Augmented,
    boxes: &Boxes,
    steady: &SteadyStates,
    spent: &[usize],
) -> Result<MaximalAdmissibleSet, DesignError> {
    let last = spent.iter().copied().max().unwrap_or(1) - 1;
    system.extend_to(last);
    let alive = |side: Side, step: usize, system: &Augmented| -> bool {
        let pair = &system.pairs[side.pair];
        let row = if side.upper {
            Some(pair.upper)
        } else {
            pair.lower.map(|l| l.0)
        };
        row.is_some_and(|i| step < spent[i])
    };
    let support = Support::of_rows(system, boxes, last, |side, step| alive(side, step, system));
    let kept = support.irredundant()?;
    let n = system.states;
    let mut origin = Vec::with_capacity(kept.len());
    let lists: Vec<Vec<(u32, f64)>> = kept
        .into_iter()
        .map(|id| {
            let (side, step) = match id {
                RowId::Static(side) => (side, None),
                RowId::Moving(side, step) => (side, Some(step)),
            };
            let pair = &system.pairs[side.pair];
            let (row, scale) = match (side.upper, pair.lower) {
                (false, Some((row, bound))) => (row, -1.0 / bound),
                _ => (pair.upper, 1.0),
            };
            origin.push((row, step));
            let z = match step {
                None => system.static_row(side.pair),
                Some(s) => system.moving_row(side.pair, s),
            };
            in_state_coordinates(&z, scale, n, system.parameters, steady)
        })
        .collect();
    Ok(MaximalAdmissibleSet {
        rows: SparseMatrix::from_row_lists(lists.len(), n + system.parameters, lists),
        states: n,
        origin,
    })
}

/// A row r·(e, θ) as a row of (x, θ): e = x − M_θx θ.
fn in_state_coordinates(
    row: &[(usize, f64)],
    scale: f64,
    n: usize,
    parameters: usize,
    steady: &SteadyStates,
) -> Vec<(u32, f64)> {
    let mut sum = std::collections::BTreeMap::<u32, f64>::new();
    for &(j, v) in row {
        *sum.entry(j as u32).or_default() += scale * v;
        if j < n && parameters > 0 {
            for (t, s) in steady.state_basis().row(j) {
                *sum.entry((n + t) as u32).or_default() -= scale * v * s;
            }
        }
    }
    sum.into_iter().collect()
}
