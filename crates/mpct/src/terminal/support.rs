//! Is a row spent? One linear program, answered with a proof either way.
//!
//! A row r at step t is spent when h(O_{t−1}, r) ≤ b: its constraint follows from those of the steps before.
//! *Spent* is proved by multipliers y ≥ 0 with Σ y_k r_k ≈ r and Σ y_k b_k + (what is left over) ≤ b, where the rest
//! r − Σ y_k r_k is bounded by a box that holds O_{t−1}. *Not spent* is proved by a point of O_{t−1} beyond b.
//!
//! Where rows are local, so is the program: it starts with the few variables that make up the row, and more are added
//! until either proof holds.

use super::augmented::Augmented;
use super::bank::{Bank, Key};
use super::program::{Answer, Expected, Query, Scene, Workspace};
use crate::clock::Clock;
use crate::error::DesignError;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A support up to 1 + this counts as at most 1. The terminal horizons of the paper's cases do not change for any
/// tolerance between 0 and 1e-6; without it, rows whose support is exactly 1 would never be spent.
pub(super) const SPENT_TOLERANCE: f64 = 1e-9;
/// Multipliers that are written down prove a support at most this much below 1, where it is so low. The checker's bounds on
/// rounding take about 1e-12 of that.
const ROOM_FOR_ROUNDING: f64 = 1e-8;
/// Factors by which a box that does not hold O is widened when it stops a program.
const WIDENINGS: [f64; 3] = [1.0, 1e2, 1e4];
/// Below this many variables the whole program is solved at once.
const WHOLE: usize = 20;
/// Share of the objective left out of the first choice of variables, before anything is known.
const FIRST_LEFTOVER: f64 = 1e-2;
/// Range of that share while it learns.
const LEFTOVERS: [f64; 2] = [1e-6, 1e-1];
/// At least so many variables are added at once.
const LEAST_GROWTH: usize = 10;
/// More variables are taken until those left out could move the bounds by this share of the gap between them.
const GAP_SHARE: f64 = 0.05;

/// After so many programs that needed all variables after all, the plant counts as not local.
const FAILURES: usize = 8;

/// One side of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Side {
    pub(super) pair: usize,
    pub(super) upper: bool,
}

/// A row that takes part in a proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum RowId {
    /// θ ∈ λΘ.
    Static(usize),
    /// A constraint after some steps of the terminal law.
    Moving(usize, usize),
}

/// The answer.
#[derive(Clone, Debug)]
pub(super) enum Verdict {
    /// An upper bound of the support is at most the row's bound.
    Spent,
    /// With the value of the row at a witness, relative to the row's bound.
    NotSpent(f64),
    /// The clock rang first.
    Stopped,
}

/// The rows of a system up to some step, ready for queries.
pub(super) struct Support<'a> {
    pub(super) scene: Scene<'a>,
    /// Whether programs on some of the variables are tried first.
    local: bool,
    programs: AtomicUsize,
    /// Programs that needed all variables after all.
    failures: AtomicUsize,
}

impl<'a> Support<'a> {
    /// Rows of θ ∈ λΘ and of steps 0, …, `last`.
    pub(super) fn new(
        system: &'a Augmented,
        bank: &'a Bank,
        last: usize,
        clock: &'a Clock,
    ) -> Self {
        Self::without(system, bank, last, Vec::new(), clock)
    }

    /// The same, less some sides.
    pub(super) fn without(
        system: &'a Augmented,
        bank: &'a Bank,
        last: usize,
        absent: Vec<[bool; 2]>,
        clock: &'a Clock,
    ) -> Self {
        Self {
            local: system.dimension() > WHOLE && bank.valid.iter().all(|&v| v),
            scene: Scene {
                system,
                bank,
                absent,
                block: OnceLock::new(),
                known: last + 1,
                clock,
            },
            programs: AtomicUsize::new(0),
            failures: AtomicUsize::new(0),
        }
    }

    /// The system.
    pub(super) fn system(&self) -> &Augmented {
        self.scene.system
    }

    /// The rows.
    pub(super) fn bank(&self) -> &Bank {
        self.scene.bank
    }

    /// Linear programs solved so far.
    pub(super) fn programs(&self) -> usize {
        self.programs.load(Ordering::Relaxed)
    }

    /// Is the side of a pair at step `step` implied by the rows of steps 0, …, `known` − 1 and θ ∈ λΘ?
    pub(super) fn is_spent(
        &self,
        ws: &mut Workspace,
        side: Side,
        step: usize,
        known: usize,
        expected: Expected,
    ) -> Result<Verdict, DesignError> {
        let key = self.scene.bank.moving(side.pair, step);
        let pair = &self.scene.system.pairs[side.pair];
        let bound = if side.upper { 1.0 } else { pair.lower_bound() };
        let query = Query {
            known,
            skip: None,
            expected,
            low_enough: 1.0,
        };
        self.decide(ws, key, side.upper, bound, &query)
    }

    /// The same for a side that is spent, with multipliers that leave the checker room for its rounding where there is.
    pub(super) fn is_clearly_spent(
        &self,
        ws: &mut Workspace,
        side: Side,
        step: usize,
        known: usize,
    ) -> Result<Verdict, DesignError> {
        let key = self.scene.bank.moving(side.pair, step);
        let pair = &self.scene.system.pairs[side.pair];
        let bound = if side.upper { 1.0 } else { pair.lower_bound() };
        let query = Query {
            known,
            skip: None,
            expected: Expected::Spent,
            low_enough: 1.0 - ROOM_FOR_ROUNDING,
        };
        self.decide(ws, key, side.upper, bound, &query)
    }

    /// The multipliers of the last verdict *spent*.
    pub(super) fn proof(&self, ws: &Workspace) -> Vec<(RowId, bool, f64)> {
        ws.multipliers
            .iter()
            .map(|&(key, upper, y)| (self.id(key), upper, y))
            .collect()
    }

    /// The witness of the last verdict *not spent*, in coordinates z = (e, θ).
    pub(super) fn witness(&self, ws: &Workspace) -> Vec<(usize, f64)> {
        ws.witness
            .iter()
            .map(|&(j, v)| (j, v * self.scene.bank.beta[j]))
            .collect()
    }

    /// Decides whether the side of a row is at most `bound` over the rows of the query.
    pub(super) fn decide(
        &self,
        ws: &mut Workspace,
        key: Key,
        upper: bool,
        bound: f64,
        query: &Query,
    ) -> Result<Verdict, DesignError> {
        let scene = &self.scene;
        ws.fit(scene, query.known);
        ws.objective.clear();
        let factor = if upper { 1.0 } else { -1.0 } / bound;
        let objective = &mut ws.objective;
        scene
            .bank
            .entries(scene.system, key, |j, v| objective.push((j, v * factor)));
        // What the objective itself may have lost.
        let lost = scene.bank.slack(scene.system, key) / bound;
        // Over the box alone: nothing else is needed where rows have decayed.
        let total: f64 = ws.objective.iter().map(|e| e.1.abs()).sum();
        if total == 0.0 || (total + lost <= 1.0 && scene.bank.valid.iter().all(|&v| v)) {
            ws.multipliers.clear();
            return Ok(Verdict::Spent);
        }
        if self.local
            && self.failures.load(Ordering::Relaxed) < FAILURES
            && let Some(verdict) = self.decide_locally(ws, key, lost, query)
        {
            return Ok(verdict);
        }
        // Where the box does not hold O it must not stop the program short: it is widened until it no longer does, or
        // until a witness turns up.
        let valid = scene.bank.valid.iter().all(|&v| v);
        let widenings = if valid {
            &WIDENINGS[..1]
        } else {
            &WIDENINGS[..]
        };
        let (mut bounds, mut artificial) = ([0.0; 2], 0.0);
        for &widening in widenings {
            self.programs.fetch_add(1, Ordering::Relaxed);
            let answer = scene.solve_whole(ws, query, widening);
            if let Some(verdict) = judged(&answer, lost) {
                return Ok(verdict);
            }
            bounds = [answer.value, answer.support + lost];
            artificial = answer.artificial;
        }
        if artificial > SPENT_TOLERANCE {
            // However wide the box, it stops the program: no constraint does, and the support has no bound.
            return Ok(Verdict::NotSpent(f64::INFINITY));
        }
        Err(DesignError::Solver {
            what: "a support of the terminal set".into(),
            detail: format!(
                "its proved bounds {:.12} and {:.12} do not decide against 1 (share of the box: {artificial:.3e})",
                bounds[0], bounds[1]
            ),
        })
    }

    /// Programs on more and more variables; `None` when these become too many for that.
    fn decide_locally(
        &self,
        ws: &mut Workspace,
        key: Key,
        lost: f64,
        query: &Query,
    ) -> Option<Verdict> {
        let d = self.scene.system.dimension();
        let (layer, pair) = self.scene.bank.place(key);
        let leave_out = ws.leave_out.unwrap_or(FIRST_LEFTOVER);
        let mut chosen = match ws.last.take() {
            Some((last, chosen)) if last == pair => chosen,
            _ => self.first_choice(ws, pair, layer, leave_out),
        };
        let mut rounds = 0;
        loop {
            if chosen.len() * 2 > d {
                self.failures.fetch_add(1, Ordering::Relaxed);
                return None;
            }
            let mut gap = [f64::INFINITY, 0.0];
            for expected in match query.expected {
                Expected::Spent => [Expected::Spent, Expected::NotSpent],
                Expected::NotSpent => [Expected::NotSpent, Expected::Spent],
            } {
                self.programs.fetch_add(1, Ordering::Relaxed);
                let answer = self.scene.solve_on(ws, &chosen, query, expected);
                if let Some(verdict) = judged(&answer, lost) {
                    // The next row probably needs as much.
                    let factor = if rounds == 0 { 1.3 } else { 0.5 };
                    let [least, most] = LEFTOVERS;
                    ws.leave_out = Some((leave_out * factor).clamp(least, most));
                    ws.last = Some((pair, chosen));
                    return Some(verdict);
                }
                gap = [gap[0].min(answer.support), gap[1].max(answer.value)];
            }
            rounds += 1;
            let more = self.wanted(ws, gap[0] - gap[1], &chosen);
            if more.is_empty() {
                self.failures.fetch_add(1, Ordering::Relaxed);
                return None;
            }
            chosen.extend(more);
            chosen.sort_unstable();
        }
    }

    /// The variables that make up a row over its steps, but for a small share.
    fn first_choice(
        &self,
        ws: &mut Workspace,
        pair: usize,
        last: usize,
        leave_out: f64,
    ) -> Vec<usize> {
        for layer in 0..=last {
            let key = (layer * self.scene.system.pairs.len() + pair) as Key;
            let bank = self.scene.bank;
            bank.entries(self.scene.system, key, |j, v| ws.add(j, v.abs()));
        }
        let mut weights = Vec::with_capacity(ws.touched.len());
        ws.take_sum(|j, v| weights.push((j, v)));
        let total: f64 = weights.iter().map(|e| e.1).sum();
        let mut chosen = heaviest(weights, leave_out * total, usize::MAX);
        chosen.sort_unstable();
        chosen
    }

    /// Variables in which something is left over: of the objective, of the rows that bind, and of the rows that the
    /// point breaks.
    fn wanted(&self, ws: &mut Workspace, gap: f64, chosen: &[usize]) -> Vec<usize> {
        for k in 0..ws.objective.len() {
            let (j, v) = ws.objective[k];
            ws.add(j, v.abs());
        }
        let bank = self.scene.bank;
        for m in 0..ws.multipliers.len() {
            let (key, _, y) = ws.multipliers[m];
            bank.entries(self.scene.system, key, |j, v| ws.add(j, y * v.abs()));
        }
        for b in 0..ws.broken.len() {
            let (key, beyond) = ws.broken[b];
            bank.entries(self.scene.system, key, |j, v| ws.add(j, beyond * v.abs()));
        }
        let mut weights = Vec::with_capacity(ws.touched.len());
        ws.take_sum(|j, v| {
            if v > 0.0 && chosen.binary_search(&j).is_err() {
                weights.push((j, v));
            }
        });
        let at_most = LEAST_GROWTH.max(chosen.len() / 2);
        let more = heaviest(weights.clone(), GAP_SHARE * gap, at_most);
        if more.is_empty() {
            heaviest(weights, 0.0, LEAST_GROWTH)
        } else {
            more
        }
    }

    pub(super) fn id(&self, key: Key) -> RowId {
        match self.scene.bank.place(key) {
            (0, pair) => RowId::Static(pair),
            (layer, pair) => RowId::Moving(pair, layer - 1),
        }
    }
}

/// What an answer proves, if anything.
fn judged(answer: &Answer, lost: f64) -> Option<Verdict> {
    if answer.stopped {
        Some(Verdict::Stopped)
    } else if answer.artificial <= SPENT_TOLERANCE && answer.support + lost <= 1.0 + SPENT_TOLERANCE
    {
        Some(Verdict::Spent)
    } else if answer.value - lost > 1.0 + SPENT_TOLERANCE {
        Some(Verdict::NotSpent(answer.value))
    } else {
        None
    }
}

/// The coordinates of the largest entries, at most so many, such that the others sum up to at most `left_out`.
fn heaviest(mut entries: Vec<(usize, f64)>, left_out: f64, at_most: usize) -> Vec<usize> {
    entries.sort_unstable_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let mut left: f64 = entries.iter().map(|e| e.1.abs()).sum();
    let mut chosen = Vec::new();
    for (j, v) in entries {
        if left <= left_out || v == 0.0 || chosen.len() == at_most {
            break;
        }
        left -= v.abs();
        chosen.push(j);
    }
    chosen
}
