//! Is a row spent? One linear program, answered with a proof either way.
//!
//! A row r at step t is spent when h(O_{t−1}, r) ≤ b: its constraint follows from those of the steps before.
//! *Spent* is proved by multipliers y ≥ 0 with Σ y_k r_k ≈ r and Σ y_k b_k + (what is left over) ≤ b, where the rest
//! r − Σ y_k r_k is bounded by a box that holds O_{t−1}. *Not spent* is proved by a point of O_{t−1} beyond b.
//! Both are evaluated here from the rows themselves and not from the state of the simplex method.
//!
//! Where rows are local, so is the program. Only the variables V that matter are kept: a row cut to V is relaxed by
//! what it could at most take outside, |r_l| β_l, so an upper bound stays one; a point is continued by zero outside
//! V and scaled back into O_{t−1}, so a witness stays one. V grows until either proof holds.

use super::augmented::Augmented;
use super::boxes::Boxes;
use super::simplex::{DualSimplex, Ending, Rows, Solution};
use crate::error::DesignError;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A support up to 1 + this counts as at most 1. The terminal horizons of the paper's cases do not change for any
/// tolerance between 0 and 1e-6; without it, rows whose support is exactly 1 would never be spent.
pub(super) const SPENT_TOLERANCE: f64 = 1e-9;
/// Below this many variables the whole program is solved at once.
const WHOLE: usize = 48;
/// Share of the objective left out of the first choice of V.
const FIRST_LEFTOVER: f64 = 1e-3;

/// Factors by which an artificial box is widened when it stops a program.
const WIDENINGS: [f64; 3] = [1.0, 1e2, 1e4];

/// One side of a pair at a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Side {
    pub(super) pair: usize,
    pub(super) upper: bool,
}

/// A row that takes part in a proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum RowId {
    /// θ ∈ λΘ.
    Static(Side),
    /// A constraint after some steps of the terminal law.
    Moving(Side, usize),
}

/// The answer, with its proof.
#[derive(Clone, Debug)]
#[allow(
    dead_code,
    reason = "the search needs the answer alone; the proofs are for whoever does not believe it"
)]
pub(super) enum Verdict {
    Spent {
        /// Upper bound of the support, relative to the row's bound.
        support: f64,
        /// The proof.
        multipliers: Vec<(RowId, f64)>,
    },
    NotSpent {
        /// The value of the row at the witness, relative to the row's bound.
        support: f64,
        /// The witness, in coordinates z = (e, θ).
        witness: Vec<(usize, f64)>,
    },
}

/// The rows of a system up to some step, in scaled coordinates ẑ_l = z_l / β_l, ready for queries.
pub(super) struct Support<'a> {
    system: &'a Augmented,
    /// β: half widths of a box.
    beta: Vec<f64>,
    /// Whether the box of a coordinate holds O_0; others are larger than O at later steps only.
    valid: Vec<bool>,
    bank: Bank,
    programs: AtomicUsize,
}

struct Bank {
    ids: Vec<(RowKind, usize)>,
    /// Scaled rows, one list each.
    rows: Vec<Vec<(usize, f64)>>,
    /// Σ |r_l| β_l.
    totals: Vec<f64>,
    upper: Vec<f64>,
    lower: Vec<f64>,
    norms: Vec<f64>,
    /// Rows in which a coordinate stands, ascending.
    touching: Vec<Vec<u32>>,
    /// All rows as one dense block, when programs are solved whole.
    dense: Vec<f64>,
    /// Number of rows before the rows of each step: static rows, then step 0, ….
    before_step: Vec<usize>,
}

impl Bank {
    fn bound(&self, (k, upper): (usize, bool)) -> f64 {
        if upper { self.upper[k] } else { self.lower[k] }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RowKind {
    Static,
    Step(usize),
}

impl<'a> Support<'a> {
    /// Rows of steps 0, …, `last`.
    pub(super) fn new(system: &'a Augmented, boxes: &Boxes, last: usize) -> Self {
        Self::of_rows(system, boxes, last, |_, _| true)
    }

    /// Rows of λΘ and, of steps 0, …, `last`, the sides that `alive` admits.
    pub(super) fn of_rows(
        system: &'a Augmented,
        boxes: &Boxes,
        last: usize,
        alive: impl Fn(Side, usize) -> bool,
    ) -> Self {
        let d = system.dimension();
        let q = system.pairs.len();
        let mut bank = Bank {
            ids: Vec::new(),
            rows: Vec::new(),
            totals: Vec::new(),
            upper: Vec::new(),
            lower: Vec::new(),
            norms: Vec::new(),
            touching: vec![Vec::new(); d],
            dense: Vec::new(),
            before_step: Vec::new(),
        };
        let mut push = |kind: RowKind, pair: usize, row: Vec<(usize, f64)>| {
            if row.is_empty() {
                return;
            }
            let k = bank.rows.len() as u32;
            let row: Vec<(usize, f64)> = row
                .into_iter()
                .map(|(j, v)| (j, v * boxes.beta[j]))
                .collect();
            for &(j, _) in &row {
                bank.touching[j].push(k);
            }
            bank.ids.push((kind, pair));
            bank.totals.push(row.iter().map(|e| e.1.abs()).sum());
            let bound = |upper: bool, value: f64| match kind {
                RowKind::Step(step) if !alive(Side { pair, upper }, step) => f64::INFINITY,
                _ => value,
            };
            bank.upper.push(bound(true, 1.0));
            bank.lower
                .push(bound(false, system.pairs[pair].lower_bound()));
            bank.norms
                .push(row.iter().map(|e| e.1 * e.1).sum::<f64>().sqrt().recip());
            bank.rows.push(row);
        };
        let mut counts = Vec::with_capacity(last + 2);
        let mut total = 0;
        for pair in 0..q {
            let row = system.static_row(pair);
            total += usize::from(!row.is_empty());
            push(RowKind::Static, pair, row);
        }
        for step in 0..=last {
            counts.push(total);
            for pair in 0..q {
                let row = system.moving_row(pair, step);
                total += usize::from(!row.is_empty());
                push(RowKind::Step(step), pair, row);
            }
        }
        counts.push(total);
        bank.before_step = counts;
        let nonzeros: usize = bank.rows.iter().map(Vec::len).sum();
        if d <= WHOLE
            || nonzeros as f64 > 0.3 * (d * bank.rows.len()) as f64
            || !boxes.valid.iter().all(|&v| v)
        {
            bank.dense = vec![0.0; d * bank.rows.len()];
            for (row, out) in bank.rows.iter().zip(bank.dense.chunks_exact_mut(d)) {
                for &(j, v) in row {
                    out[j] = v;
                }
            }
        }
        Self {
            system,
            beta: boxes.beta.clone(),
            valid: boxes.valid.clone(),
            bank,
            programs: AtomicUsize::new(0),
        }
    }

    /// Linear programs solved so far.
    pub(super) fn programs(&self) -> usize {
        self.programs.load(Ordering::Relaxed)
    }

    /// Is the side of a pair at step `step` implied by the rows of steps 0, …, `known` − 1 and θ ∈ λΘ?
    pub(super) fn is_spent(
        &self,
        simplex: &mut DualSimplex,
        side: Side,
        step: usize,
        known: usize,
    ) -> Result<Verdict, DesignError> {
        let objective = self.scaled(&self.system.moving_row(side.pair, step), side.upper);
        let bound = self.bound_of(side);
        self.decide(
            simplex,
            &objective,
            bound,
            self.bank.before_step[known],
            None,
        )
    }

    /// The rows that are not implied by the others, of equal ones the first.
    pub(super) fn irredundant(mut self) -> Result<Vec<RowId>, DesignError> {
        let candidates: Vec<(usize, bool)> = (0..self.bank.rows.len())
            .flat_map(|k| [(k, true), (k, false)])
            .filter(|&c| self.bank.bound(c).is_finite())
            .collect();
        // A row that some point of all the others violates stays, whatever else is dropped.
        let needed: Vec<Result<bool, DesignError>> = candidates
            .par_iter()
            .map_init(DualSimplex::default, |simplex, &c| {
                self.is_needed(simplex, c)
            })
            .collect();
        let mut kept = Vec::new();
        let mut simplex = DualSimplex::default();
        for (&c, needed) in candidates.iter().zip(needed) {
            // The others may have been each other's excuse: ask again with the dropped ones gone.
            if needed? || self.is_needed(&mut simplex, c)? {
                kept.push(self.id(c.0, c.1));
            } else if c.1 {
                self.bank.upper[c.0] = f64::INFINITY;
            } else {
                self.bank.lower[c.0] = f64::INFINITY;
            }
        }
        Ok(kept)
    }

    fn is_needed(
        &self,
        simplex: &mut DualSimplex,
        row: (usize, bool),
    ) -> Result<bool, DesignError> {
        let (k, upper) = row;
        let sign = if upper { 1.0 } else { -1.0 };
        let objective: Vec<(usize, f64)> = self.bank.rows[k]
            .iter()
            .map(|&(j, v)| (j, sign * v))
            .collect();
        let count = self.bank.rows.len();
        let verdict = self.decide(simplex, &objective, self.bank.bound(row), count, Some(row))?;
        Ok(matches!(verdict, Verdict::NotSpent { .. }))
    }

    /// Bound of one side of a pair.
    fn bound_of(&self, side: Side) -> f64 {
        if side.upper {
            1.0
        } else {
            self.system.pairs[side.pair].lower_bound()
        }
    }

    fn scaled(&self, row: &[(usize, f64)], upper: bool) -> Vec<(usize, f64)> {
        let sign = if upper { 1.0 } else { -1.0 };
        row.iter()
            .map(|&(j, v)| (j, sign * v * self.beta[j]))
            .collect()
    }

    /// Decides whether max objective·ẑ ≤ bound over the first `count` rows of the bank, less `skip`.
    fn decide(
        &self,
        simplex: &mut DualSimplex,
        objective: &[(usize, f64)],
        bound: f64,
        count: usize,
        skip: Option<(usize, bool)>,
    ) -> Result<Verdict, DesignError> {
        let objective: Vec<(usize, f64)> = objective.iter().map(|&(j, v)| (j, v / bound)).collect();
        // θ rows of an equilibrium-free pair can vanish altogether.
        if objective.is_empty() {
            return Ok(Verdict::Spent {
                support: 0.0,
                multipliers: Vec::new(),
            });
        }
        let d = self.system.dimension();
        let mut last = (f64::INFINITY, f64::NEG_INFINITY);
        if self.bank.dense.is_empty() {
            let mut chosen = self.first_variables(&objective);
            loop {
                let answer = self.solve_on(simplex, &objective, &chosen, count, skip);
                last = (answer.support, answer.value);
                match self.judge(answer, &objective) {
                    Judged::Verdict(v) => return Ok(v),
                    Judged::Grow(more) => {
                        let before = chosen.len();
                        chosen.extend(more);
                        chosen.sort_unstable();
                        chosen.dedup();
                        if chosen.len() == before || chosen.len() * 2 > d {
                            break;
                        }
                    }
                }
            }
        }
        let all: Vec<usize> = (0..d).collect();
        // Where the box does not hold O it must not stop the program short: it is widened until it no longer does, or
        // until a witness turns up.
        let widenings = if self.valid.iter().all(|&v| v) {
            &WIDENINGS[..1]
        } else {
            &WIDENINGS[..]
        };
        let mut share = 0.0;
        for &widening in widenings {
            let answer = if self.bank.dense.is_empty() {
                self.solve_on(simplex, &objective, &all, count, skip)
            } else {
                self.solve_whole(simplex, &objective, &all, count, skip, widening)
            };
            last = (answer.support, answer.value);
            share = answer.artificial;
            if let Judged::Verdict(v) = self.judge(answer, &objective) {
                return Ok(v);
            }
        }
        if share > SPENT_TOLERANCE {
            // However wide the box, it stops the program: no constraint does, and the support has no bound.
            return Ok(Verdict::NotSpent {
                support: f64::INFINITY,
                witness: Vec::new(),
            });
        }
        Err(DesignError::Solver {
            what: "a support of the terminal set".into(),
            detail: format!(
                "its proved bounds {:.12} and {:.12} do not decide against 1 (share of the box: {share:.3e})",
                last.1, last.0
            ),
        })
    }

    /// The variables that make up the objective but for a small share.
    fn first_variables(&self, objective: &[(usize, f64)]) -> Vec<usize> {
        let mut order: Vec<(usize, f64)> = objective.to_vec();
        order.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        let total: f64 = order.iter().map(|e| e.1.abs()).sum();
        let mut left = total;
        let mut chosen = Vec::new();
        for (j, v) in order {
            if left <= FIRST_LEFTOVER * total {
                break;
            }
            left -= v.abs();
            chosen.push(j);
        }
        chosen.sort_unstable();
        chosen
    }

    /// Solves the program on all variables, with the box of those whose box is not valid wider by a factor.
    fn solve_whole(
        &self,
        simplex: &mut DualSimplex,
        objective: &[(usize, f64)],
        all: &[usize],
        count: usize,
        skip: Option<(usize, bool)>,
        widening: f64,
    ) -> Answer {
        self.programs.fetch_add(1, Ordering::Relaxed);
        let d = all.len();
        let mut w = vec![0.0; d];
        for &(j, value) in objective {
            w[j] = value;
        }
        let factor = |j: usize| if self.valid[j] { 1.0 } else { widening };
        let mut widened = Vec::new();
        let coefficients = if widening == 1.0 {
            &self.bank.dense[..count * d]
        } else {
            widened.extend(
                self.bank.dense[..count * d]
                    .iter()
                    .enumerate()
                    .map(|(i, v)| v * factor(i % d)),
            );
            w.iter_mut().enumerate().for_each(|(j, v)| *v *= factor(j));
            &widened[..]
        };
        let rows = Rows {
            width: d,
            coefficients,
            upper: &self.bank.upper[..count],
            lower: &self.bank.lower[..count],
            inverse_norms: &self.bank.norms[..count],
        };
        // Where the box is not known to hold O, multipliers of the box prove nothing: go on to the optimum.
        let threshold = if self.valid.iter().all(|&v| v) {
            1.0
        } else {
            f64::NEG_INFINITY
        };
        let mut solution = simplex.maximise(&w, &rows, threshold, skip);
        solution
            .z
            .iter_mut()
            .enumerate()
            .for_each(|(j, z)| *z *= factor(j));
        self.evaluate(solution, objective, all, None, count, skip)
    }

    /// Solves the program on the variables `chosen` (ascending).
    fn solve_on(
        &self,
        simplex: &mut DualSimplex,
        objective: &[(usize, f64)],
        chosen: &[usize],
        count: usize,
        skip: Option<(usize, bool)>,
    ) -> Answer {
        self.programs.fetch_add(1, Ordering::Relaxed);
        let v = chosen.len();
        let mut place = std::collections::HashMap::with_capacity(v);
        for (i, &j) in chosen.iter().enumerate() {
            place.insert(j, i);
        }
        let mut ids: Vec<u32> = chosen
            .iter()
            .flat_map(|&j| {
                self.bank.touching[j]
                    .iter()
                    .copied()
                    .take_while(|&k| (k as usize) < count)
            })
            .collect();
        ids.sort_unstable();
        ids.dedup();
        let mut coefficients = vec![0.0; ids.len() * v];
        let (mut upper, mut lower, mut norms) = (Vec::new(), Vec::new(), Vec::new());
        for (&k, out) in ids.iter().zip(coefficients.chunks_exact_mut(v)) {
            let k = k as usize;
            let mut inside = 0.0;
            let mut square = 0.0;
            for &(j, value) in &self.bank.rows[k] {
                if let Some(&i) = place.get(&j) {
                    out[i] = value;
                    inside += value.abs();
                    square += value * value;
                }
            }
            let slack = (self.bank.totals[k] - inside).max(0.0);
            upper.push(self.bank.upper[k] + slack);
            lower.push(self.bank.lower[k] + slack);
            norms.push(if square > 0.0 {
                square.sqrt().recip()
            } else {
                0.0
            });
        }
        let mut w = vec![0.0; v];
        let mut outside = 0.0;
        for &(j, value) in objective {
            match place.get(&j) {
                Some(&i) => w[i] = value,
                None => outside += value.abs(),
            }
        }
        let rows = Rows {
            width: v,
            coefficients: &coefficients,
            upper: &upper,
            lower: &lower,
            inverse_norms: &norms,
        };
        let local_skip =
            skip.and_then(|(k, s)| ids.binary_search(&(k as u32)).ok().map(|i| (i, s)));
        let solution = simplex.maximise(&w, &rows, 1.0 - outside, local_skip);
        self.evaluate(solution, objective, chosen, Some(&ids), count, skip)
    }

    /// Both bounds of a program from the rows themselves.
    fn evaluate(
        &self,
        solution: Solution,
        objective: &[(usize, f64)],
        chosen: &[usize],
        ids: Option<&[u32]>,
        count: usize,
        skip: Option<(usize, bool)>,
    ) -> Answer {
        let global = |i: usize| ids.map_or(i, |ids| ids[i] as usize);
        // Upper bound: Σ y b + Σ_l |r − Σ y r_k|_l, because |ẑ_l| ≤ 1.
        let mut rest: std::collections::BTreeMap<usize, f64> = objective.iter().copied().collect();
        let mut support = 0.0;
        let mut multipliers = Vec::with_capacity(solution.multipliers.len());
        for &(i, upper, y) in &solution.multipliers {
            let k = global(i);
            let sign = if upper { y } else { -y };
            for &(j, v) in &self.bank.rows[k] {
                *rest.entry(j).or_insert(0.0) -= sign * v;
            }
            support += y * if upper {
                self.bank.upper[k]
            } else {
                self.bank.lower[k]
            };
            multipliers.push((k, upper, y));
        }
        let mut artificial = 0.0;
        for (&j, &v) in &rest {
            if self.valid[j] {
                support += v.abs();
            } else {
                artificial += v.abs();
            }
        }
        // Lower bound: the point, scaled back until every row holds.
        let mut value = f64::NEG_INFINITY;
        let mut witness = Vec::new();
        if solution.ending != Ending::Below {
            let scaled: Vec<(usize, f64)> = chosen
                .iter()
                .copied()
                .zip(solution.z.iter().copied())
                .collect();
            let mut reach = 1.0_f64;
            let mut check = |k: usize, z: &dyn Fn(usize) -> f64| {
                let at: f64 = self.bank.rows[k].iter().map(|&(j, v)| v * z(j)).sum();
                if skip != Some((k, true)) {
                    reach = reach.max(at / self.bank.upper[k]);
                }
                if skip != Some((k, false)) && self.bank.lower[k].is_finite() {
                    reach = reach.max(-at / self.bank.lower[k]);
                }
            };
            let d = self.system.dimension();
            let mut point = vec![0.0; d];
            for &(j, z) in &scaled {
                point[j] = z;
            }
            match ids {
                None => (0..count).for_each(|k| check(k, &|j| point[j])),
                Some(ids) => ids.iter().for_each(|&k| check(k as usize, &|j| point[j])),
            }
            value = objective.iter().map(|&(j, v)| v * point[j]).sum::<f64>() / reach;
            witness = scaled
                .iter()
                .map(|&(j, z)| (j, z * self.beta[j] / reach))
                .collect();
        }
        Answer {
            support,
            artificial,
            multipliers,
            value,
            witness,
        }
    }

    fn judge(&self, answer: Answer, objective: &[(usize, f64)]) -> Judged {
        if answer.artificial <= SPENT_TOLERANCE && answer.support <= 1.0 + SPENT_TOLERANCE {
            let multipliers = answer
                .multipliers
                .iter()
                .map(|&(k, upper, y)| (self.id(k, upper), y))
                .collect();
            return Judged::Verdict(Verdict::Spent {
                support: answer.support,
                multipliers,
            });
        }
        if answer.value > 1.0 + SPENT_TOLERANCE {
            return Judged::Verdict(Verdict::NotSpent {
                support: answer.value,
                witness: answer.witness,
            });
        }
        // Grow where something is left over: the objective first, then the rows that bind.
        let mut weight: std::collections::BTreeMap<usize, f64> =
            objective.iter().map(|&(j, v)| (j, v.abs())).collect();
        for &(k, _, y) in &answer.multipliers {
            for &(j, v) in &self.bank.rows[k] {
                *weight.entry(j).or_insert(0.0) += y * v.abs();
            }
        }
        let gap = (answer.support - answer.value.max(0.0)).abs().max(1e-12);
        let mut more: Vec<(usize, f64)> = weight.into_iter().collect();
        more.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut left: f64 = more.iter().map(|e| e.1).sum();
        let mut chosen = Vec::new();
        // Enough variables that what stays outside is a fraction of the gap between the two bounds.
        for (j, v) in more {
            if left <= 0.05 * gap {
                break;
            }
            left -= v;
            chosen.push(j);
        }
        Judged::Grow(chosen)
    }

    fn id(&self, k: usize, upper: bool) -> RowId {
        let (kind, pair) = self.bank.ids[k];
        let side = Side { pair, upper };
        match kind {
            RowKind::Static => RowId::Static(side),
            RowKind::Step(s) => RowId::Moving(side, s),
        }
    }
}

struct Answer {
    support: f64,
    artificial: f64,
    multipliers: Vec<(usize, bool, f64)>,
    value: f64,
    witness: Vec<(usize, f64)>,
}

enum Judged {
    Verdict(Verdict),
    Grow(Vec<usize>),
}
