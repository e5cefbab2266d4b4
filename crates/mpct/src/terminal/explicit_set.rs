//! The maximal admissible set (16)(27), without redundant rows.
//!
//! Rows that are spent do not enter. Of the others, a row is redundant when its support over the rest is at most its
//! bound; it is then dropped for good, so that of equal rows one remains.

use super::augmented::Augmented;
use super::bank::{Bank, Key};
use super::program::{Expected, Query, Workspace};
use super::support::{RowId, Support, Verdict};
use crate::clock::Clock;
use crate::error::DesignError;
use crate::matrix::SparseMatrix;
use crate::steady_state::SteadyStates;
use rayon::prelude::*;

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

/// The rows of θ ∈ λΘ and the rows before they are spent, less redundant ones.
pub(super) fn irredundant(
    system: &mut Augmented,
    bank: &mut Bank,
    steady: &SteadyStates,
    spent: &[usize],
) -> Result<MaximalAdmissibleSet, DesignError> {
    let last = spent.iter().copied().max().unwrap_or(1) - 1;
    system.extend_to(last);
    bank.extend_to(system, last);
    // A side takes part in a layer when the problem has it and it is not spent there.
    let mut absent = Vec::with_capacity(bank.rows(last + 1));
    for layer in 0..=last + 1 {
        for pair in &system.pairs {
            let gone = |row: usize| layer > spent[row];
            absent.push([gone(pair.upper), pair.lower.is_none_or(|l| gone(l.0))]);
        }
    }
    let clock = Clock::unlimited();
    let kept = Support::without(system, bank, last, absent, &clock).irredundant(last + 1)?;
    let n = system.states;
    let mut origin = Vec::with_capacity(kept.len());
    let lists: Vec<Vec<(u32, f64)>> = kept
        .into_iter()
        .map(|(id, upper)| {
            let (pair, step, z) = match id {
                RowId::Static(pair) => (pair, None, system.static_row(pair)),
                RowId::Moving(pair, step) => (pair, Some(step), system.moving_row(pair, step)),
            };
            let (row, scale) = match (upper, system.pairs[pair].lower) {
                (false, Some((row, bound))) => (row, -1.0 / bound),
                _ => (system.pairs[pair].upper, 1.0),
            };
            origin.push((row, step));
            in_state_coordinates(&z, scale, n, system.parameters, steady)
        })
        .collect();
    Ok(MaximalAdmissibleSet {
        rows: SparseMatrix::from_row_lists(lists.len(), n + system.parameters, lists),
        states: n,
        origin,
    })
}

impl Support<'_> {
    /// The sides that are not implied by the others, of equal ones the first.
    fn irredundant(mut self, known: usize) -> Result<Vec<(RowId, bool)>, DesignError> {
        let candidates: Vec<(Key, bool)> = (0..self.scene.bank.rows(known) as Key)
            .flat_map(|k| [(k, true), (k, false)])
            .filter(|&(k, upper)| {
                let (u, l) = self.scene.bounds(k);
                (if upper { u } else { l }).is_finite() && self.scene.bank.total(k) > 0.0
            })
            .collect();
        // A row that some point of all the others violates stays, whatever else is dropped.
        let needed: Vec<Result<bool, DesignError>> = candidates
            .par_iter()
            .map_init(Workspace::default, |ws, &c| self.is_needed(ws, c, known))
            .collect();
        let mut kept = Vec::new();
        let mut ws = Workspace::default();
        for (&(key, upper), needed) in candidates.iter().zip(needed) {
            // The others may have been each other's excuse: ask again with the dropped ones gone.
            if needed? || self.is_needed(&mut ws, (key, upper), known)? {
                kept.push((self.id(key), upper));
            } else {
                self.scene.leave_out(key, upper);
            }
        }
        Ok(kept)
    }

    fn is_needed(
        &self,
        ws: &mut Workspace,
        (key, upper): (Key, bool),
        known: usize,
    ) -> Result<bool, DesignError> {
        let (u, l) = self.scene.bounds(key);
        let query = Query {
            known,
            skip: Some((key, upper)),
            expected: Expected::NotSpent,
            low_enough: 1.0,
        };
        let bound = if upper { u } else { l };
        let verdict = self.decide(ws, key, upper, bound, &query)?;
        Ok(!matches!(verdict, Verdict::Spent))
    }
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
