//! The proofs behind a design with ellipsoids, once more and in full.

use super::fan::Direction;
use super::spent::{Question, Reason, Verdict, combination};
use super::{At, ConicSystem, Set};
use crate::error::DesignError;
use crate::problem::RowSource;
use crate::terminal::{Condition, TerminalIngredients};
use std::sync::atomic::AtomicUsize;

/// Multipliers of a linear form: rows as (row, step, y) and ellipsoids as (ellipsoid, step, w), of constraints whose right-hand
/// sides are 1. Without a step they belong to θ ∈ λΘ, in the form w_iθ/λ ≤ 1 and ‖W_kθ/λ + h‖ ≤ 1.
#[derive(Clone, Debug, Default)]
pub(crate) struct ConicMultiplier {
    pub(crate) rows: Vec<(usize, Option<usize>, f64)>,
    pub(crate) norms: Vec<(usize, Option<usize>, Vec<f64>)>,
}

/// The support of an ellipsoid's vector in a direction.
pub(crate) struct DirectionProof {
    pub(crate) direction: Direction,
    pub(crate) multipliers: ConicMultiplier,
}

/// An ellipsoid is spent at a step.
pub(crate) struct NormSpent {
    pub(crate) norm: usize,
    pub(crate) step: usize,
    /// The supports are those of the e part alone.
    pub(crate) split: bool,
    pub(crate) supports: Vec<DirectionProof>,
}

/// Everything.
pub(crate) struct ConicProofs {
    /// Half widths of the box, with what implies the upper and the lower side.
    pub(crate) boxes: Vec<(f64, [ConicMultiplier; 2])>,
    /// Row, step, multipliers.
    pub(crate) rows: Vec<(usize, usize, ConicMultiplier)>,
    pub(crate) norms: Vec<NormSpent>,
}

impl TerminalIngredients {
    /// The proofs behind a design with ellipsoids.
    pub(crate) fn conic_proofs(&self) -> Result<ConicProofs, DesignError> {
        let mut system = ConicSystem::new(&self.problem, self.law(), &self.steady_states)?;
        if system.bounded_from > 1 {
            return Err(failed("a coordinate is not bounded by the constraints of the first step alone, which a certificate needs".into()));
        }
        let spent: Vec<usize> = self
            .spent
            .iter()
            .chain(&self.spent_norms)
            .copied()
            .collect();
        system.extend_to(self.terminal_horizon + 1);
        let d = system.dimension();
        let of_box = system.set(1, &spent);
        let mut boxes = Vec::with_capacity(d);
        for l in 0..d {
            let side = |sign: f64| {
                let mut c = vec![0.0; d];
                c[l] = sign;
                of_box.proof(&c)
            };
            boxes.push((system.beta[l], [side(1.0)?, side(-1.0)?]));
        }
        let mut proofs = ConicProofs {
            boxes,
            rows: Vec::new(),
            norms: Vec::new(),
        };
        for item in 0..system.items() {
            let step = spent[item];
            let known = match self.condition {
                Condition::Exact => step,
                Condition::Sufficient => 1,
            };
            let question = Question {
                item,
                step,
                known,
                spent: &spent,
            };
            let verdict = system.decide(question, &AtomicUsize::new(0));
            let Verdict::Spent(reason) = verdict else {
                return Err(failed(format!(
                    "{} is not spent at step {step}",
                    self.source(item)
                )));
            };
            let set = system.set(known, &spent);
            match reason {
                Reason::Row => {
                    let form = system.form(item, Some(step));
                    proofs.rows.push((item, step, set.proof(&form)?));
                }
                Reason::Norm { split, directions } => {
                    let norm = item - system.rows;
                    let (first, q) = system.norms[norm];
                    let forms: Vec<Vec<f64>> = (first..first + q)
                        .map(|f| {
                            if split {
                                system.transient(f, step)
                            } else {
                                system.form(f, Some(step))
                            }
                        })
                        .collect();
                    let supports = directions
                        .into_iter()
                        .map(|direction| {
                            let real: Vec<f64> = direction.iter().map(|v| *v as f64).collect();
                            Ok(DirectionProof {
                                multipliers: set.proof(&combination(&forms, &real))?,
                                direction,
                            })
                        })
                        .collect::<Result<_, DesignError>>()?;
                    proofs.norms.push(NormSpent {
                        norm,
                        step,
                        split,
                        supports,
                    });
                }
            }
        }
        Ok(proofs)
    }

    fn source(&self, item: usize) -> RowSource {
        let rows = self.problem.rows();
        match item.checked_sub(rows.len()) {
            None => rows.source[item],
            Some(k) => self.problem.norms()[k].source,
        }
    }
}

fn failed(detail: String) -> DesignError {
    DesignError::Solver {
        what: "the certificate".into(),
        detail,
    }
}

impl Set {
    /// The multipliers of max cᵀz.
    fn proof(&self, c: &[f64]) -> Result<ConicMultiplier, DesignError> {
        let support = self
            .support(c)
            .ok_or_else(|| failed("a support has no answer".into()))?;
        let rows = self.rows.iter().zip(&support.multipliers.rows);
        let balls = self.balls.iter().zip(support.multipliers.balls);
        let with = |at: &At, y: f64| (at.0, at.1, y);
        Ok(ConicMultiplier {
            rows: rows.map(|(at, y)| with(at, *y)).collect(),
            norms: balls.map(|(at, w)| (at.0, at.1, w)).collect(),
        })
    }
}
