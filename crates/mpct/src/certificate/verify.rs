//! The checker. It shares nothing with the search but the file.

use super::document::{Document, FORMAT, Multiplier};
use super::implied::{Known, implied};
use super::interval::{Accumulator, Interval, add_up, mul_up};
use super::rows::{StepRow, System};
use super::statement::{TOLERANCE, Verified};
use super::widths::{WidthRow, Widths};
use super::{digest, lyapunov};
use rayon::prelude::*;
use thiserror::Error;

/// How a certificate is read.
#[derive(Clone, Copy, Debug, Default)]
pub struct VerifyOptions {
    /// Check the claim even when the digest does not fit the file.
    pub ignore_digest: bool,
}

/// Why a certificate was refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum VerifyError {
    /// The file is no certificate.
    #[error("not a certificate: {0}")]
    Unreadable(String),
    /// The file was changed after it was written.
    #[error("the digest does not fit: the file was changed after it was written")]
    Digest,
    /// The claim does not follow from the proof.
    #[error("refused: {0}")]
    Refused(String),
}

impl VerifyError {
    pub(super) fn refused(why: impl Into<String>) -> Self {
        Self::Refused(why.into())
    }
}

/// Checks a certificate.
///
/// # Errors
/// [`VerifyError`] when the file is none, was changed, or its claim does not follow.
pub fn verify(text: &str, options: VerifyOptions) -> Result<Verified, VerifyError> {
    let document: Document =
        serde_json::from_str(text).map_err(|e| VerifyError::Unreadable(e.to_string()))?;
    if document.format != FORMAT {
        return Err(VerifyError::Unreadable(format!(
            "format {:?}",
            document.format
        )));
    }
    let digest = digest(&document.claim, &document.proof);
    let digest_fits = digest == document.digest;
    if !(digest_fits || options.ignore_digest) {
        return Err(VerifyError::Digest);
    }
    let claim = &document.claim;
    if !["exact", "sufficient"].contains(&claim.condition.as_str()) {
        return Err(VerifyError::refused(
            "the condition is neither exact nor sufficient",
        ));
    }
    if claim.terminal_horizon == 0 {
        return Err(VerifyError::refused(
            "the terminal horizon must be at least 1",
        ));
    }
    let system = System::of(claim)?;
    let lyapunov_residual = lyapunov::check(claim, &system)?;
    let checker = Checker::new(&document, system)?;
    let (rows, tolerated, smallest_margin, tightest) = checker.spent(&document)?;
    let witness = checker.witness(&document)?;
    Ok(Verified {
        problem: claim.problem.clone(),
        digest,
        digest_fits,
        scaling: claim.scaling,
        terminal_horizon: claim.terminal_horizon,
        smallest_margin,
        tightest_row: claim.constraints[tightest].name.clone(),
        rows_rigorous: rows - tolerated,
        rows_to_tolerance: tolerated,
        lyapunov_residual,
        steady_state_residual: checker.system.largest_drift(&checker.beta),
        witness,
        states: checker.system.states,
        inputs: claim.b.columns,
        parameters: checker.system.parameters,
    })
}

pub(super) struct Checker {
    pub(super) system: System,
    /// Half widths of a box that is proved to hold the set of `box_steps` steps.
    pub(super) beta: Vec<f64>,
    /// Each constraint at steps 0, …, M̃ + 1.
    pub(super) along: Vec<Vec<StepRow>>,
}

impl Checker {
    fn new(document: &Document, system: System) -> Result<Self, VerifyError> {
        let d = system.dimension();
        let boxes = &document.proof.boxes;
        let widths = boxes.iter().map(|b| b.half_width);
        let fine = widths.clone().flatten().all(|b| b > 0.0 && b.is_finite());
        let mut beta: Vec<f64> = widths.map(|b| b.unwrap_or(f64::INFINITY)).collect();
        if beta.len() != d || !fine {
            return Err(VerifyError::refused(format!(
                "the box needs {d} positive half widths"
            )));
        }
        let box_steps = document.proof.box_steps;
        let last = document.claim.terminal_horizon.saturating_add(1);
        let steps = document.proof.spent.iter().map(|s| s.step);
        let (first, named) = steps.fold((usize::MAX, 0), |a, s| (a.0.min(s), a.1.max(s)));
        if named > last {
            return Err(VerifyError::refused(
                "a row is spent only after the terminal horizon",
            ));
        }
        // A horizon that the proofs do not reach must not cost time.
        if document.claim.condition == "exact" && named < last && last > 2 {
            return Err(VerifyError::refused(
                "no row needs the terminal horizon that is claimed",
            ));
        }
        // What is left over is bounded in the box, which holds the set of `box_steps` steps and none before.
        if !(first > box_steps && first <= named) {
            return Err(VerifyError::refused(format!(
                "rows are spent from step {first} on, and their box is proved by steps 0 to {box_steps}"
            )));
        }
        let count = system.rows.len();
        let along = |last: usize, beta: &[f64]| -> Vec<Vec<StepRow>> {
            let rows = (0..count).into_par_iter();
            rows.map(|i| system.along(i, last, beta, box_steps))
                .collect()
        };
        let early = along(box_steps, &beta);
        let known = Known {
            system: &system,
            along: &early,
            beta: &beta,
            last: box_steps,
        };
        let mut widths = Widths::default();
        let mut sum = Accumulator::new(d);
        for (l, proof) in boxes.iter().enumerate() {
            if beta[l].is_infinite() {
                widths.rows.push(Default::default());
                continue;
            }
            let mut direction = |sign: f64, multipliers: &[Multiplier]| {
                // sign/β_l is rounded, which the slack takes.
                let form = [(l, Interval::exact(sign / beta[l]))];
                let room = Interval::exact(1.0);
                let implied = implied(&known, &mut sum, &form, room, multipliers)?;
                let weighed = |&(j, v): &(usize, Interval)| (j, mul_up(v.magnitude(), beta[j]));
                Ok(WidthRow {
                    value: implied.value,
                    slack: add_up(implied.slack, 2.0 * f64::EPSILON),
                    left_over: implied.rest.iter().map(weighed).collect(),
                })
            };
            let up = direction(1.0, &proof.upper)?;
            let down = direction(-1.0, &proof.lower)?;
            widths.rows.push([up, down]);
        }
        let widening = widths.solve().ok_or_else(|| {
            VerifyError::refused("the coordinates are not proved to lie in the box")
        })?;
        for (b, w) in beta.iter_mut().zip(widening) {
            *b = mul_up(*b, w);
        }
        let along = along(named, &beta);
        Ok(Self {
            system,
            beta,
            along,
        })
    }

    /// Every side of every constraint is spent at some step ≤ M̃ + 1: number of rows, of those proved to a tolerance
    /// only, smallest margin and its constraint.
    fn spent(&self, document: &Document) -> Result<(usize, usize, f64, usize), VerifyError> {
        let proofs = &document.proof.spent;
        let mut missing: Vec<[bool; 2]> = self
            .system
            .rows
            .iter()
            .map(|r| [r.room(true).is_some(), r.room(false).is_some()])
            .collect();
        for p in proofs {
            let side = missing
                .get_mut(p.constraint)
                .map(|m| &mut m[usize::from(!p.upper)]);
            match side {
                Some(side) if *side => *side = false,
                _ => {
                    return Err(VerifyError::refused(
                        "a proof is about no row, or there twice",
                    ));
                }
            }
        }
        if let Some(i) = missing.iter().position(|m| m[0] || m[1]) {
            let name = &document.claim.constraints[i].name;
            return Err(VerifyError::refused(format!("{name} has no proof")));
        }
        if proofs.is_empty() {
            return Err(VerifyError::refused("there are no constraints"));
        }
        let supports: Vec<Result<f64, VerifyError>> = proofs
            .par_iter()
            .map_init(
                || Accumulator::new(self.system.dimension()),
                |sum, p| {
                    let row = &self.system.rows[p.constraint];
                    let room = row.room(p.upper).ok_or_else(|| VerifyError::refused("no such side"))?;
                    let name = &document.claim.constraints[p.constraint].name;
                    if p.step == 0 || p.step > document.claim.terminal_horizon.saturating_add(1) {
                        return Err(VerifyError::refused(format!("{name} is spent at step {}", p.step)));
                    }
                    let at = &self.along[p.constraint][p.step];
                    let e = at.e.iter().map(|&(j, v)| (j, Interval::exact(v)));
                    let form: Vec<(usize, Interval)> = e
                        .chain(row.equilibrium(&self.beta))
                        .map(|(j, v)| (j, if p.upper { v } else { v.neg() }))
                        .collect();
                    let known = Known {
                        system: &self.system,
                        along: &self.along,
                        beta: &self.beta,
                        last: p.step - 1,
                    };
                    let implied = implied(&known, sum, &form, room, &p.multipliers)?;
                    let bound = add_up(implied.bound(&self.beta), at.slack);
                    let support = (bound / room.lo).next_up();
                    if support <= 1.0 + TOLERANCE {
                        Ok(support)
                    } else {
                        Err(VerifyError::refused(format!(
                            "{name} is not implied at step {}: its support is proved to be at most {support:.9} of its bound",
                            p.step
                        )))
                    }
                },
            )
            .collect();
        let (mut tolerated, mut worst, mut tightest) = (0, f64::NEG_INFINITY, 0);
        for (p, support) in proofs.iter().zip(supports) {
            let support = support?;
            tolerated += usize::from(support > 1.0);
            if support > worst {
                worst = support;
                tightest = p.constraint;
            }
        }
        Ok((proofs.len(), tolerated, 1.0 - worst, tightest))
    }
}
