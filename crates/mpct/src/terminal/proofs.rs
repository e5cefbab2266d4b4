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
    /// `None` for a coordinate that no step bounds.
    pub(crate) boxes: Vec<Option<BoxSides>>,
    /// The box holds the set of this many steps.
    pub(crate) box_steps: usize,
    pub(crate) spent: Vec<Spent>,
    pub(crate) witness: Option<Refutation>,
}

impl TerminalIngredients {
    /// The proofs behind this design: one linear program a row, and one for the witness.
    ///
    /// With one-sided constraints the box holds the set of b > 0 steps. What is left over of a row can then be bounded
    /// from step b + 1 on only, and that is where rows spent earlier are proved spent: spent rows stay so. Where the sets
    /// are bounded at all, the one of M̃ steps is, and b ≤ M̃.
    pub(crate) fn proofs(&self) -> Result<Proofs, DesignError> {
        let clock = Clock::unlimited();
        let mut system = self.augmented();
        let mut boxes = Boxes::of(&mut system, &clock)?;
        let at_once = boxes.valid.iter().all(|&v| v);
        let mut box_steps = 0;
        if at_once {
            system.drop_within(&boxes.beta);
        } else {
            let (proved, steps) = Boxes::of_steps(&mut system, self.terminal_horizon, &clock);
            self.check_states_bounded(&proved)?;
            boxes.narrow_to(proved);
            box_steps = steps;
        }
        let box_proofs = box_proofs(&boxes);
        let mut bank = Bank::new(&system, &boxes);
        let last = self.terminal_horizon + 1;
        system.extend_to(last);
        bank.extend_to(&system, last);
        let support = Support::new(&system, &bank, last - 1, &clock);
        let symmetric = is_symmetric(&system);
        let pairs = (0..system.pairs.len()).into_par_iter();
        let spent: Vec<Result<Vec<Spent>, DesignError>> = pairs
            .map_init(Workspace::default, |ws, pair| {
                self.spent_proofs(ws, &support, &system, pair, symmetric, box_steps)
            })
            .collect();
        let mut all = Vec::new();
        for part in spent {
            all.extend(part?);
        }
        let witness = match self.condition {
            Condition::Exact if self.terminal_horizon > 1 && at_once => {
                Some(self.refutation(&support, &system)?)
            }
            Condition::Exact if self.terminal_horizon > 1 => {
                // The set of M̃ − 1 steps need not lie in the box that was proved.
                let wide = Boxes::of(&mut system, &clock)?;
                let mut bank = Bank::new(&system, &wide);
                bank.extend_to(&system, last);
                let support = Support::new(&system, &bank, last - 1, &clock);
                Some(self.refutation(&support, &system)?)
            }
            _ => None,
        };
        let row = |p: &super::augmented::Pair| (p.upper, p.lower);
        Ok(Proofs {
            pairs: system.pairs.iter().map(row).collect(),
            boxes: box_proofs,
            box_steps,
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
        box_steps: usize,
    ) -> Result<Vec<Spent>, DesignError> {
        let side = |upper| Side { pair, upper };
        let above = self.spent_proof(ws, support, system, side(true), box_steps)?;
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
            self.spent_proof(ws, support, system, side(false), box_steps)?
        };
        Ok(vec![above, below])
    }

    fn spent_proof(
        &self,
        ws: &mut Workspace,
        support: &Support<'_>,
        system: &Augmented,
        side: Side,
        box_steps: usize,
    ) -> Result<Spent, DesignError> {
        let row = row_of(system, side);
        let step = self.spent[row].max(box_steps + 1);
        let known = match self.condition {
            Condition::Exact => step,
            Condition::Sufficient => 1,
        };
        match support.is_clearly_spent(ws, side, step, known)? {
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

    /// The point that shows that one step less is too few.
    fn refutation(
        &self,
        support: &Support<'_>,
        system: &Augmented,
    ) -> Result<Refutation, DesignError> {
        let horizon = self.terminal_horizon;
        let mut ws = Workspace::default();
        let sides = (0..system.pairs.len()).flat_map(|pair| {
            let has_lower = system.pairs[pair].lower.is_some();
            let lower = has_lower.then_some(Side { pair, upper: false });
            std::iter::once(Side { pair, upper: true }).chain(lower)
        });
        for side in sides.filter(|&s| self.spent[row_of(system, s)] == horizon + 1) {
            let verdict = support.is_spent(&mut ws, side, horizon, horizon, Expected::NotSpent)?;
            if let Verdict::NotSpent(value) = verdict
                && value.is_finite()
            {
                // Halfway between its bound and where it must be beyond the bound, so that it stays there whatever
                // rounding does.
                let pull = (1.0 + value) / (2.0 * value);
                let inside = |(j, v): (usize, f64)| (j, v * pull);
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

    /// Equilibria may be unbounded: multipliers can be mended until nothing is left over of θ. Of states something always
    /// is, because A + B K is rounded.
    fn check_states_bounded(&self, boxes: &Boxes) -> Result<(), DesignError> {
        let states = 0..self.problem.plant().states();
        let open: Vec<usize> = states.filter(|&l| boxes.beta[l].is_infinite()).collect();
        if open.is_empty() {
            return Ok(());
        }
        let mut names: Vec<String> = open.iter().take(4).map(|l| format!("e[{l}]")).collect();
        if open.len() > names.len() {
            names.push(format!("and {} more", open.len() - names.len()));
        }
        Err(DesignError::Solver {
            what: "the certificate".into(),
            detail: format!(
                "the constraints along {} steps leave {} unbounded, e = x - M_theta_x theta: what rounding leaves over of a \
                 multiplier sum has no bound there. State the missing bounds, however wide",
                self.terminal_horizon,
                names.join(", ")
            ),
        })
    }
}

/// The row of the problem that is a side of a pair.
fn row_of(system: &Augmented, side: Side) -> usize {
    let pair = &system.pairs[side.pair];
    match pair.lower {
        Some((lower, _)) if !side.upper => lower,
        _ => pair.upper,
    }
}

/// Multipliers that prove the box.
fn box_proofs(boxes: &Boxes) -> Vec<Option<BoxSides>> {
    let sides = boxes.proofs.iter().zip(&boxes.beta);
    sides
        .map(|(sides, &half_width)| {
            let sides = sides.clone()?;
            Some(BoxSides { half_width, sides })
        })
        .collect()
}
