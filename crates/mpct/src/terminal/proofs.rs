//! The proofs behind a design, once more and in full: multipliers for every row, and a witness.

use super::augmented::Augmented;
use super::bank::Bank;
use super::boxes::Boxes;
use super::horizon::is_symmetric;
use super::program::{Expected, Workspace};
use super::support::{RowId, Side, Support, Verdict};
use super::{Condition, TerminalIngredients};
use crate::clock::Clock;
use crate::error::DesignError;
use rayon::prelude::*;

/// Multipliers of rows: row, upper side, y.
pub(crate) type Multipliers = Vec<(RowId, bool, f64)>;

/// |z_l| ≤ half_width, with the rows that imply both sides.
pub(crate) struct BoxSides {
    pub(crate) half_width: f64,
    pub(crate) sides: [Multipliers; 2],
}

/// A side of a pair is spent at a step.
pub(crate) struct Spent {
    pub(crate) pair: usize,
    pub(crate) upper: bool,
    pub(crate) step: usize,
    pub(crate) multipliers: Multipliers,
}

/// A point of the set of M̃ − 1 steps from which a side is broken at step M̃.
pub(crate) struct Refutation {
    pub(crate) pair: usize,
    pub(crate) upper: bool,
    pub(crate) point: Vec<(usize, f64)>,
}

/// Everything.
pub(crate) struct Proofs {
    /// Rows of the problem that make up each pair: the upper one, the lower one with its bound.
    pub(crate) pairs: Vec<(usize, Option<(usize, f64)>)>,
    pub(crate) boxes: Vec<BoxSides>,
    pub(crate) spent: Vec<Spent>,
    pub(crate) witness: Option<Refutation>,
}

/// A witness is pulled this far towards the origin, so that it lies inside whatever rounding does.
const INSIDE: f64 = 1e-10;

impl TerminalIngredients {
    /// The proofs behind this design: one linear program a row, and one for the witness.
    pub(crate) fn proofs(&self) -> Result<Proofs, DesignError> {
        let clock = Clock::unlimited();
        let mut system = self.augmented();
        let boxes = Boxes::of(&mut system, &clock)?;
        let box_proofs = box_proofs(&system, &boxes)?;
        system.drop_within(&boxes.beta);
        let mut bank = Bank::new(&system, &boxes);
        let last = self.terminal_horizon + 1;
        system.extend_to(last);
        bank.extend_to(&system, last);
        let support = Support::new(&system, &bank, last - 1, &clock);
        let symmetric = is_symmetric(&system);
        let pairs = (0..system.pairs.len()).into_par_iter();
        let spent: Vec<Result<Vec<Spent>, DesignError>> = pairs
            .map_init(Workspace::default, |ws, pair| {
                self.spent_proofs(ws, &support, &system, pair, symmetric)
            })
            .collect();
        let mut all = Vec::new();
        for part in spent {
            all.extend(part?);
        }
        let witness = match self.condition {
            Condition::Exact if self.terminal_horizon > 1 => {
                Some(refutation(&support, &all, self.terminal_horizon)?)
            }
            _ => None,
        };
        let row = |p: &super::augmented::Pair| (p.upper, p.lower);
        Ok(Proofs {
            pairs: system.pairs.iter().map(row).collect(),
            boxes: box_proofs,
            spent: all,
            witness,
        })
    }

    fn spent_proofs(
        &self,
        ws: &mut Workspace,
        support: &Support<'_>,
        system: &Augmented,
        pair: usize,
        symmetric: bool,
    ) -> Result<Vec<Spent>, DesignError> {
        let above = self.spent_proof(ws, support, system, Side { pair, upper: true })?;
        if system.pairs[pair].lower.is_none() {
            return Ok(vec![above]);
        }
        let below = if symmetric {
            // O = −O: the same multipliers on the opposite rows.
            Spent {
                upper: false,
                multipliers: above.multipliers.iter().map(|m| (m.0, !m.1, m.2)).collect(),
                ..above
            }
        } else {
            self.spent_proof(ws, support, system, Side { pair, upper: false })?
        };
        Ok(vec![above, below])
    }

    fn spent_proof(
        &self,
        ws: &mut Workspace,
        support: &Support<'_>,
        system: &Augmented,
        side: Side,
    ) -> Result<Spent, DesignError> {
        let pair = &system.pairs[side.pair];
        let row = match pair.lower {
            Some((lower, _)) if !side.upper => lower,
            _ => pair.upper,
        };
        let step = self.spent[row];
        let known = match self.condition {
            Condition::Exact => step,
            Condition::Sufficient => 1,
        };
        match support.is_spent(ws, side, step, known, Expected::Spent)? {
            Verdict::Spent => Ok(Spent {
                pair: side.pair,
                upper: side.upper,
                step,
                multipliers: support.proof(ws),
            }),
            _ => Err(DesignError::Solver {
                what: "the certificate".into(),
                detail: format!(
                    "{} is not spent at step {step}",
                    self.problem.rows().source[row]
                ),
            }),
        }
    }
}

/// The point that shows that one step less is too few.
fn refutation(
    support: &Support<'_>,
    spent: &[Spent],
    horizon: usize,
) -> Result<Refutation, DesignError> {
    let mut ws = Workspace::default();
    for proof in spent.iter().filter(|p| p.step == horizon + 1) {
        let side = Side {
            pair: proof.pair,
            upper: proof.upper,
        };
        let verdict = support.is_spent(&mut ws, side, horizon, horizon, Expected::NotSpent)?;
        if let Verdict::NotSpent(_) = verdict {
            let inside = |(j, v): (usize, f64)| (j, v * (1.0 - INSIDE));
            return Ok(Refutation {
                pair: side.pair,
                upper: side.upper,
                point: support.witness(&ws).into_iter().map(inside).collect(),
            });
        }
    }
    Err(DesignError::Solver {
        what: "the certificate".into(),
        detail: "no witness of the horizon was found".into(),
    })
}

/// Multipliers that prove the box.
fn box_proofs(system: &Augmented, boxes: &Boxes) -> Result<Vec<BoxSides>, DesignError> {
    let proof = |l: usize| {
        let sides = boxes.proofs[l].clone().filter(|_| boxes.valid[l]);
        let sides = sides.ok_or_else(|| DesignError::Solver {
            what: "the certificate".into(),
            detail: format!(
                "coordinate {l} is not bounded by the constraints of the first step alone, which a certificate needs"
            ),
        })?;
        Ok(BoxSides {
            half_width: boxes.beta[l],
            sides,
        })
    };
    (0..system.dimension()).map(proof).collect()
}
