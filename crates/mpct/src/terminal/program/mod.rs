//! One linear program over some of the variables, and what its last iterate proves about the whole one.
//!
//! A row cut to the variables V may be relaxed by what it could at most take outside, Σ_{l ∉ V} |r_l| β_l: the
//! multipliers of this program give the best upper bound of the support that V can give. Or it is left as it is: the
//! points of this program, continued by zero outside V, lie in the set, and the best of them is the best witness that
//! V can give. Both bounds are evaluated from the rows themselves and not from the state of the simplex method, so
//! either program may prove either answer.

mod part;
mod whole;

use super::augmented::Augmented;
use super::bank::{Bank, Key};
use super::simplex::{DualSimplex, Ending};
use crate::clock::Clock;
use std::sync::OnceLock;
use whole::Block;

/// The rows that take part, with their bounds.
pub(super) struct Scene<'a> {
    pub(super) system: &'a Augmented,
    pub(super) bank: &'a Bank,
    /// Sides of rows that do not take part, by key; empty when all do.
    pub(super) absent: Vec<[bool; 2]>,
    /// Every row of steps below `known` as a dense block, once a program had to be solved whole.
    pub(super) block: OnceLock<Block>,
    pub(super) known: usize,
    pub(super) clock: &'a Clock,
}

/// A program: maximise a row over the others.
pub(super) struct Query {
    /// Rows of the layers of θ ∈ λΘ and of steps 0, …, `known` − 1 take part.
    pub(super) known: usize,
    /// A side of a row that does not.
    pub(super) skip: Option<(Key, bool)>,
    /// The answer that is more likely, and that a program is laid out for first.
    pub(super) expected: Expected,
    /// An upper bound of the support that ends a program.
    pub(super) low_enough: f64,
}

/// What a program on some of the variables is laid out for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Expected {
    /// Rows are relaxed: the best upper bound.
    Spent,
    /// Rows are left as they are: the best witness.
    NotSpent,
}

/// What the last iterate of a program proves.
pub(super) struct Answer {
    /// Upper bound of the support.
    pub(super) support: f64,
    /// Part of the objective left to coordinates whose box proves nothing.
    pub(super) artificial: f64,
    /// Value of the objective at a point of the set; −∞ when the method ended before it had one.
    pub(super) value: f64,
    /// Whether the method stopped because the clock rang.
    pub(super) stopped: bool,
}

/// Scratch memory; one per thread.
#[derive(Default)]
pub(super) struct Workspace {
    pub(super) simplex: DualSimplex,
    /// The objective, scaled to a bound of 1.
    pub(super) objective: Vec<(usize, f64)>,
    /// Multipliers of the last program: row, upper side, y.
    pub(super) multipliers: Vec<(Key, bool, f64)>,
    /// The point of the last program, over `chosen`, scaled back into the set.
    pub(super) witness: Vec<(usize, f64)>,
    /// Rows that the point broke before it was scaled back, and by how much.
    pub(super) broken: Vec<(Key, f64)>,
    /// Share left out of the first choice of variables; learns from the answers.
    pub(super) leave_out: Option<f64>,
    /// The pair of the last program and the variables that sufficed for it.
    pub(super) last: Option<(usize, Vec<usize>)>,
    /// A vector over all variables that is zero between uses, and its support.
    pub(super) sum: Vec<f64>,
    pub(super) touched: Vec<usize>,
    /// Place of a variable in the program; `ABSENT` between uses.
    place: Vec<u32>,
    /// Rows already met carry the current stamp.
    seen: Vec<u32>,
    stamp: u32,
    keys: Vec<Key>,
    /// Rows that cannot bind in the relaxed program, but may at a point.
    only_checked: Vec<Key>,
    coefficients: Vec<f64>,
    upper: Vec<f64>,
    lower: Vec<f64>,
    inverse_norms: Vec<f64>,
    weights: Vec<f64>,
}

/// A witness with this value ends a program: far enough above 1 to survive rounding.
const ENOUGH: f64 = 1.0 + 1e-6;
const ABSENT: u32 = u32::MAX;
/// Multipliers below this are rounding; their rows are left over like any other residual.
const SMALLEST_MULTIPLIER: f64 = 1e-13;

impl Workspace {
    /// Makes room for a system.
    pub(super) fn fit(&mut self, scene: &Scene<'_>, known: usize) {
        let d = scene.system.dimension();
        if self.sum.len() != d {
            self.sum = vec![0.0; d];
            self.place = vec![ABSENT; d];
        }
        let rows = scene.bank.rows(known);
        if self.seen.len() < rows {
            self.seen.resize(rows, 0);
        }
    }

    /// Adds `v` to coordinate `j` of the sum.
    #[inline]
    pub(super) fn add(&mut self, j: usize, v: f64) {
        if self.sum[j] == 0.0 {
            self.touched.push(j);
        }
        self.sum[j] += v;
    }

    /// The entries of the sum, which is zero afterwards. A coordinate may come twice, the second time with 0.
    pub(super) fn take_sum(&mut self, mut f: impl FnMut(usize, f64)) {
        for &j in &self.touched {
            f(j, std::mem::take(&mut self.sum[j]));
        }
        self.touched.clear();
    }
}

impl Scene<'_> {
    /// Upper and lower bound of a row.
    pub(super) fn bounds(&self, key: Key) -> (f64, f64) {
        let pair = self.bank.place(key).1;
        let (mut upper, mut lower) = (1.0, self.system.pairs[pair].lower_bound());
        if let Some(absent) = self.absent.get(key as usize) {
            if absent[0] {
                upper = f64::INFINITY;
            }
            if absent[1] {
                lower = f64::INFINITY;
            }
        }
        (upper, lower)
    }

    /// A side that no longer takes part.
    pub(super) fn leave_out(&mut self, key: Key, upper: bool) {
        self.absent[key as usize][usize::from(!upper)] = true;
        if let Some(block) = self.block.get_mut()
            && let Ok(k) = block.keys.binary_search(&key)
        {
            let bound = if upper {
                &mut block.upper
            } else {
                &mut block.lower
            };
            bound[k] = f64::INFINITY;
        }
    }

    /// The upper bound that the multipliers prove: Σ y b + Σ_l |r − Σ y r_k|_l, because |ẑ_l| ≤ 1.
    fn bounded(&self, ws: &mut Workspace, ending: Ending, value: f64) -> Answer {
        for k in 0..ws.objective.len() {
            let (j, v) = ws.objective[k];
            ws.add(j, v);
        }
        ws.multipliers.retain(|m| m.2 > SMALLEST_MULTIPLIER);
        let mut support = 0.0;
        for m in 0..ws.multipliers.len() {
            let (key, side, y) = ws.multipliers[m];
            let signed = if side { y } else { -y };
            self.bank
                .entries(self.system, key, |j, v| ws.add(j, -signed * v));
            let (upper, lower) = self.bounds(key);
            let bound = if side { upper } else { lower };
            support += y * (bound + self.bank.slack(self.system, key));
        }
        let (mut left, mut artificial) = (0.0, 0.0);
        let valid = &self.bank.valid;
        ws.take_sum(|j, v| {
            if valid[j] {
                left += v.abs();
            } else {
                artificial += v.abs();
            }
        });
        Answer {
            support: support + left,
            artificial,
            value,
            stopped: ending == Ending::Stopped,
        }
    }
}
