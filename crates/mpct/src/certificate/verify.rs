//! The checker. It shares nothing with the search but the file.

use super::document::{ConeMultiplier, Document, FORMAT, Multiplier};
use super::ellipsoids;
use super::implied::{Along, Known, implied};
use super::interval::{Accumulator, Interval, add_up, mul_up};
use super::rows::System;
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
    // The witness is held against rows alone.
    if claim.condition == "exact" && !claim.ellipsoids.is_empty() {
        return Err(VerifyError::refused(
            "with ellipsoids only the sufficient condition can be claimed",
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
    let mut found = checker.spent(&document)?;
    let rows = found.proofs;
    found.join(ellipsoids::spent(&checker, &document)?);
    let witness = checker.witness(&document)?;
    Ok(Verified {
        problem: claim.problem.clone(),
        digest,
        digest_fits,
        scaling: claim.scaling,
        terminal_horizon: claim.terminal_horizon,
        smallest_margin: 1.0 - found.worst,
        tightest_row: found.tightest,
        rows_rigorous: found.proofs - found.tolerated,
        rows_to_tolerance: found.tolerated,
        ellipsoids: found.proofs - rows,
        lyapunov_residual,
        steady_state_residual: checker.system.largest_drift(&checker.beta),
        witness,
        states: checker.system.states,
        inputs: claim.b.columns,
        parameters: checker.system.parameters,
    })
}

/// What was proved to be spent.
pub(super) struct Spent {
    /// Number of proofs, and of those that hold to a tolerance only.
    pub(super) proofs: usize,
    pub(super) tolerated: usize,
    /// Largest support, relative to the bound, and the name of its constraint.
    pub(super) worst: f64,
    pub(super) tightest: String,
}

impl Spent {
    pub(super) fn nothing() -> Self {
        Self {
            proofs: 0,
            tolerated: 0,
            worst: f64::NEG_INFINITY,
            tightest: String::new(),
        }
    }

    /// Takes a support in.
    pub(super) fn add(&mut self, support: f64, name: &str) {
        self.proofs += 1;
        self.tolerated += usize::from(support > 1.0);
        if support > self.worst {
            self.worst = support;
            self.tightest = name.into();
        }
    }

    fn join(&mut self, other: Self) {
        self.proofs += other.proofs;
        self.tolerated += other.tolerated;
        if other.worst > self.worst {
            self.worst = other.worst;
            self.tightest = other.tightest;
        }
    }
}

pub(super) struct Checker {
    pub(super) system: System,
    /// Half widths of a box that is proved to hold the set of `box_steps` steps.
    pub(super) beta: Vec<f64>,
    /// Everything at steps 0, …, M̃ + 1.
    pub(super) along: Along,
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
        let of_rows = document.proof.spent.iter().map(|s| s.step);
        let steps = of_rows.chain(document.proof.ellipsoids.iter().map(|e| e.step));
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
        let early = Along::of(&system, box_steps, &beta, box_steps);
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
            let mut direction =
                |sign: f64, multipliers: &[Multiplier], cones: &[ConeMultiplier]| {
                    // sign/β_l is rounded, which the slack takes.
                    let form = [(l, Interval::exact(sign / beta[l]))];
                    let room = Interval::exact(1.0);
                    let implied = implied(&known, &mut sum, &form, room, multipliers, cones)?;
                    let weighed = |&(j, v): &(usize, Interval)| (j, mul_up(v.magnitude(), beta[j]));
                    Ok(WidthRow {
                        value: implied.value,
                        slack: add_up(implied.slack, 2.0 * f64::EPSILON),
                        left_over: implied.rest.iter().map(weighed).collect(),
                    })
                };
            let up = direction(1.0, &proof.upper, &proof.upper_cones)?;
            let down = direction(-1.0, &proof.lower, &proof.lower_cones)?;
            widths.rows.push([up, down]);
        }
        let widening = widths.solve().ok_or_else(|| {
            VerifyError::refused("the coordinates are not proved to lie in the box")
        })?;
        for (b, w) in beta.iter_mut().zip(widening) {
            *b = mul_up(*b, w);
        }
        let along = Along::of(&system, named, &beta, box_steps);
        Ok(Self {
            system,
            beta,
            along,
        })
    }

    /// Every side of every constraint is spent at some step ≤ M̃ + 1.
    fn spent(&self, document: &Document) -> Result<Spent, VerifyError> {
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
        if proofs.is_empty() && self.system.norms.is_empty() {
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
                    let at = &self.along.rows[p.constraint][p.step];
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
                    let implied = implied(&known, sum, &form, room, &p.multipliers, &p.cones)?;
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
        let mut found = Spent::nothing();
        for (p, support) in proofs.iter().zip(supports) {
            found.add(support?, &document.claim.constraints[p.constraint].name);
        }
        Ok(found)
    }
}
