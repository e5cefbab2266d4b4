//! One linear program over some of the variables, and what its last iterate proves about the whole one.
//!
//! A row cut to the variables V may be relaxed by what it could at most take outside, Σ_{l ∉ V} |r_l| β_l: the
//! multipliers of this program give the best upper bound of the support that V can give. Or it is left as it is: the
//! points of this program, continued by zero outside V, lie in the set, and the best of them is the best witness that
//! V can give. Both bounds are evaluated from the rows themselves and not from the state of the simplex method, so
//! either program may prove either answer.

use super::augmented::Augmented;
use super::bank::{Bank, Key};
use super::simplex::{DualSimplex, Ending, Rows};
use crate::clock::Clock;
use std::sync::OnceLock;

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

/// Rows over all variables.
pub(super) struct Block {
    keys: Vec<Key>,
    coefficients: Vec<f64>,
    upper: Vec<f64>,
    lower: Vec<f64>,
    inverse_norms: Vec<f64>,
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

impl<'a> Scene<'a> {
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

    /// All rows that take part as one block.
    fn lay_out(&self) -> Block {
        let d = self.system.dimension();
        let valid = self.bank.valid.iter().all(|&v| v);
        let mut block = Block {
            keys: Vec::new(),
            coefficients: Vec::new(),
            upper: Vec::new(),
            lower: Vec::new(),
            inverse_norms: Vec::new(),
        };
        for key in 0..self.bank.rows(self.known) as Key {
            let (upper, lower) = self.bounds(key);
            // Rows that no point of the box can violate, or that are absent, would only cost time.
            if self.bank.total(key) <= upper.min(lower) && valid {
                continue;
            }
            let start = block.coefficients.len();
            block.coefficients.resize(start + d, 0.0);
            let row = &mut block.coefficients[start..];
            self.bank.entries(self.system, key, |j, v| row[j] = v);
            let norm = row.iter().map(|v| v * v).sum::<f64>().sqrt();
            block.keys.push(key);
            block.upper.push(upper);
            block.lower.push(lower);
            block.inverse_norms.push(norm.recip());
        }
        block
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

    /// Solves the program on all variables, with the box of those that it does not hold wider by a factor.
    pub(super) fn solve_whole(&self, ws: &mut Workspace, query: &Query, widening: f64) -> Answer {
        let block = self.block.get_or_init(|| self.lay_out());
        let d = self.system.dimension();
        let valid = &self.bank.valid;
        let factor = |j: usize| if valid[j] { 1.0 } else { widening };
        let end = self.bank.rows(query.known) as Key;
        let count = block.keys.partition_point(|&k| k < end);
        ws.weights.clear();
        ws.weights.resize(d, 0.0);
        for &(j, v) in &ws.objective {
            ws.weights[j] = v * factor(j);
        }
        let mut widened = Vec::new();
        let coefficients = if widening == 1.0 {
            &block.coefficients[..count * d]
        } else {
            let entries = block.coefficients[..count * d].iter().enumerate();
            widened.extend(entries.map(|(i, v)| v * factor(i % d)));
            &widened[..]
        };
        let rows = Rows {
            width: d,
            coefficients,
            upper: &block.upper[..count],
            lower: &block.lower[..count],
            inverse_norms: &block.inverse_norms[..count],
        };
        let skip = query.skip.and_then(|(key, side)| {
            let k = block.keys[..count].binary_search(&key).ok()?;
            Some((k, side))
        });
        // A bound that rests on a box that proves nothing is none: go on until the multipliers have left it.
        let below = if valid.iter().all(|&v| v) {
            query.low_enough
        } else {
            f64::NEG_INFINITY
        };
        let ending = ws
            .simplex
            .maximise(&ws.weights, &rows, [below, ENOUGH], skip, self.clock);
        let value = if ending == Ending::Below {
            f64::NEG_INFINITY
        } else {
            let z = ws.simplex.point();
            let mut reach = z.iter().fold(1.0_f64, |a, v| a.max(v.abs()));
            for (k, row) in rows.coefficients.chunks_exact(d).enumerate() {
                let at: f64 = row.iter().zip(z).map(|(a, b)| a * b).sum();
                if skip != Some((k, true)) {
                    reach = reach.max(at / rows.upper[k]);
                }
                if skip != Some((k, false)) {
                    reach = reach.max(-at / rows.lower[k]);
                }
            }
            ws.witness.clear();
            ws.witness.extend(
                z.iter()
                    .enumerate()
                    .map(|(j, v)| (j, v * factor(j) / reach))
                    .filter(|e| e.1 != 0.0),
            );
            ws.weights.iter().zip(z).map(|(w, v)| w * v).sum::<f64>() / reach
        };
        ws.multipliers.clear();
        let simplex = &ws.simplex;
        ws.multipliers.extend(
            simplex
                .multipliers()
                .map(|(k, side, y)| (block.keys[k], side, y)),
        );
        self.bounded(ws, ending, value)
    }

    /// Solves the program on the variables `chosen`.
    pub(super) fn solve_on(
        &self,
        ws: &mut Workspace,
        chosen: &[usize],
        query: &Query,
        expected: Expected,
    ) -> Answer {
        self.gather(ws, chosen, query, expected);
        let v = chosen.len();
        ws.weights.clear();
        ws.weights.resize(v, 0.0);
        let mut outside = 0.0;
        for &(j, value) in &ws.objective {
            match ws.place[j] {
                ABSENT => outside += value.abs(),
                i => ws.weights[i as usize] = value,
            }
        }
        let rows = Rows {
            width: v,
            coefficients: &ws.coefficients,
            upper: &ws.upper,
            lower: &ws.lower,
            inverse_norms: &ws.inverse_norms,
        };
        let skip = query
            .skip
            .and_then(|(key, side)| Some((ws.keys.iter().position(|&k| k == key)?, side)));
        let thresholds = match expected {
            Expected::Spent => [query.low_enough - outside, f64::INFINITY],
            Expected::NotSpent => [query.low_enough, ENOUGH],
        };
        let ending = ws
            .simplex
            .maximise(&ws.weights, &rows, thresholds, skip, self.clock);
        let value = if ending == Ending::Below {
            f64::NEG_INFINITY
        } else {
            self.scaled_back(ws, chosen, query)
        };
        for &j in chosen {
            ws.place[j] = ABSENT;
        }
        ws.multipliers.clear();
        let (simplex, keys) = (&ws.simplex, &ws.keys);
        ws.multipliers
            .extend(simplex.multipliers().map(|(k, side, y)| (keys[k], side, y)));
        self.bounded(ws, ending, value)
    }

    /// Lays out the rows that touch `chosen`, cut to it and relaxed.
    fn gather(&self, ws: &mut Workspace, chosen: &[usize], query: &Query, expected: Expected) {
        let v = chosen.len();
        for (i, &j) in chosen.iter().enumerate() {
            ws.place[j] = i as u32;
        }
        ws.stamp = ws.stamp.wrapping_add(1);
        if ws.stamp == 0 {
            ws.seen.fill(0);
            ws.stamp = 1;
        }
        ws.keys.clear();
        ws.only_checked.clear();
        ws.coefficients.clear();
        ws.upper.clear();
        ws.lower.clear();
        ws.inverse_norms.clear();
        for layer in 0..=query.known {
            let first = self.bank.rows(layer) - self.system.pairs.len();
            for &variable in chosen {
                for &pair in self.bank.touching(layer, variable) {
                    let key = (first + pair as usize) as Key;
                    if ws.seen[key as usize] == ws.stamp {
                        continue;
                    }
                    ws.seen[key as usize] = ws.stamp;
                    let (upper, lower) = self.bounds(key);
                    let start = ws.coefficients.len();
                    ws.coefficients.resize(start + v, 0.0);
                    let row = &mut ws.coefficients[start..];
                    let (mut inside, mut square) = (0.0, 0.0);
                    let place = &ws.place;
                    self.bank.entries(self.system, key, |j, value| {
                        let i = place[j];
                        if i != ABSENT {
                            row[i as usize] = value;
                            inside += value.abs();
                            square += value * value;
                        }
                    });
                    let slack = match expected {
                        Expected::Spent => {
                            (self.bank.total(key) - inside).max(0.0)
                                + self.bank.slack(self.system, key)
                        }
                        Expected::NotSpent => 0.0,
                    };
                    let nearest = upper.min(lower);
                    if inside > nearest + slack {
                        ws.keys.push(key);
                        ws.upper.push(upper + slack);
                        ws.lower.push(lower + slack);
                        ws.inverse_norms.push(square.sqrt().recip());
                    } else {
                        ws.coefficients.truncate(start);
                        if inside > nearest {
                            ws.only_checked.push(key);
                        }
                    }
                }
            }
        }
    }

    /// Scales the point back until every row holds, without its relaxation; the value of the objective there.
    fn scaled_back(&self, ws: &mut Workspace, chosen: &[usize], query: &Query) -> f64 {
        let z = ws.simplex.point();
        let mut reach = z.iter().fold(1.0_f64, |a, v| a.max(v.abs()));
        let broken = &mut ws.broken;
        broken.clear();
        let mut check = |key: Key, at: f64| {
            let (upper, lower) = self.bounds(key);
            let mut beyond = 1.0_f64;
            if query.skip != Some((key, true)) {
                beyond = beyond.max(at / upper);
            }
            if query.skip != Some((key, false)) {
                beyond = beyond.max(-at / lower);
            }
            if beyond > 1.0 {
                broken.push((key, beyond - 1.0));
                reach = reach.max(beyond);
            }
        };
        for (&key, row) in ws.keys.iter().zip(ws.coefficients.chunks_exact(z.len())) {
            check(key, row.iter().zip(z).map(|(a, b)| a * b).sum());
        }
        let place = &ws.place;
        for &key in &ws.only_checked {
            let mut at = 0.0;
            self.bank.entries(self.system, key, |j, v| {
                if place[j] != ABSENT {
                    at += v * z[place[j] as usize];
                }
            });
            check(key, at);
        }
        let value: f64 = ws.weights.iter().zip(z).map(|(a, b)| a * b).sum();
        ws.witness.clear();
        ws.witness
            .extend(chosen.iter().copied().zip(z.iter().map(|v| v / reach)));
        value / reach
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
