//! The checker. It shares nothing with the search but the file.

use super::document::{ConeMultiplier, Document, FORMAT, Multiplier};
use super::ellipsoids;
use super::interval::{Accumulator, Interval, add_up, mul_up};
use super::rows::{StepRow, System};
use super::widths::{WidthRow, Widths};
use super::{digest, lyapunov};
use rayon::prelude::*;
use std::fmt;
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

/// A row of a support may exceed its bound by this, relatively, to count as spent "to a tolerance": the tolerance of
/// the search, and the rounding of the check.
pub(super) const TOLERANCE: f64 = 2e-9;
/// What was proved.
#[derive(Clone, Debug, PartialEq)]
pub struct Verified {
    /// Name of the problem.
    pub problem: String,
    /// The terminal horizon M̃ (M for regulation).
    pub terminal_horizon: usize,
    /// Smallest of 1 − (proved support)/(bound) over all rows. Negative when a row is implied to a tolerance only.
    pub smallest_margin: f64,
    /// The row with that margin.
    pub tightest_row: String,
    /// Rows and ellipsoids proved rigorously, and those proved to a tolerance of 2e-9 of their bound.
    pub rows_rigorous: usize,
    /// See `rows_rigorous`.
    pub rows_to_tolerance: usize,
    /// How many of them are ellipsoids.
    pub ellipsoids: usize,
    /// Bound of the residual of (3), relative to the stage cost.
    pub lyapunov_residual: f64,
    /// Bound of the residual of the steady states, in units of the box; part of every proof.
    pub steady_state_residual: f64,
    /// By how much the witness breaks its bound after M̃ steps; `None` when the file has no witness, because M̃ = 1 or
    /// the condition is the sufficient one.
    pub witness: Option<f64>,
    states: usize,
    inputs: usize,
}

impl fmt::Display for Verified {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = if self.problem.is_empty() {
            "without a name"
        } else {
            &self.problem
        };
        writeln!(
            f,
            "Verified: problem {name}, {} states, {} inputs, terminal horizon {}.",
            self.states, self.inputs, self.terminal_horizon
        )?;
        writeln!(
            f,
            "For exactly the matrices written in this file, and in exact arithmetic, every state and artificial set-point \
             that satisfies the constraints along steps 0 to {} of the terminal control law stays admissible for ever.",
            self.terminal_horizon
        )?;
        writeln!(f, "Proved with bounds on every rounding error:")?;
        writeln!(
            f,
            "  - A + B K is Schur: P > 0, and x'Px falls in every step by at least 1 - {:.1e} of the stage cost;",
            self.lyapunov_residual
        )?;
        writeln!(
            f,
            "  - {} constraint rows{} are implied by those of the steps before them; smallest margin {:.3e} ({}).",
            self.rows_rigorous - self.ellipsoids.min(self.rows_rigorous),
            match self.ellipsoids {
                0 => String::new(),
                k => format!(" and {k} ellipsoids"),
            },
            self.smallest_margin,
            self.tightest_row
        )?;
        if let Some(beyond) = self.witness {
            writeln!(
                f,
                "  - One step less is too few: a point that satisfies it breaks a constraint by {beyond:.3e} of its bound."
            )?;
        }
        writeln!(f, "To a tolerance only:")?;
        if self.rows_to_tolerance > 0 {
            writeln!(
                f,
                "  - {} rows, up to {TOLERANCE:.0e} of their bound;",
                self.rows_to_tolerance
            )?;
        }
        write!(
            f,
            "  - (3) as an equation holds up to {:.1e} of the stage cost; the steady states up to {:.1e} of the box \
             (this residual is accounted for in the proofs above).",
            self.lyapunov_residual, self.steady_state_residual
        )
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
    if !options.ignore_digest && digest(&document.claim, &document.proof) != document.digest {
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
    let mut found = checker.spent(&document)?;
    let rows = found.proofs;
    found.join(ellipsoids::spent(&checker, &document)?);
    let witness = checker.witness(&document)?;
    Ok(Verified {
        problem: claim.problem.clone(),
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
    /// Half widths of a box that is proved to hold O_0.
    pub(super) beta: Vec<f64>,
    /// Everything at steps 0, …, M̃ + 1.
    pub(super) along: Along,
}

/// Constraints along the terminal law.
pub(super) struct Along {
    /// Constraint, step.
    pub(super) rows: Vec<Vec<StepRow>>,
    /// Ellipsoid, component, step.
    pub(super) norms: Vec<Vec<Vec<StepRow>>>,
}

impl Along {
    fn of(system: &System, last: usize, beta: &[f64]) -> Self {
        let rows = (0..system.rows.len()).into_par_iter();
        let norms = (0..system.norms.len()).into_par_iter();
        Self {
            rows: rows.map(|i| system.along(i, last, beta)).collect(),
            norms: norms.map(|k| system.norm_along(k, last, beta)).collect(),
        }
    }
}

/// A bound on a linear form: at most `value` plus `slack` plus what the box allows of `rest`.
pub(super) struct Implied {
    value: f64,
    slack: f64,
    rest: Vec<(usize, Interval)>,
}

impl Implied {
    pub(super) fn bound(&self, beta: &[f64]) -> f64 {
        let of_rest =
            |s: f64, &(j, v): &(usize, Interval)| add_up(s, mul_up(v.magnitude(), beta[j]));
        self.rest
            .iter()
            .fold(add_up(self.value, self.slack), of_rest)
    }
}

impl Checker {
    fn new(document: &Document, system: System) -> Result<Self, VerifyError> {
        let d = system.dimension();
        let boxes = &document.proof.boxes;
        let mut beta: Vec<f64> = boxes.iter().map(|b| b.half_width).collect();
        if beta.len() != d || beta.iter().any(|b| !(*b > 0.0 && b.is_finite())) {
            return Err(VerifyError::refused(format!(
                "the box needs {d} positive half widths"
            )));
        }
        let at_zero = Along::of(&system, 0, &beta);
        let mut widths = Widths::default();
        let mut sum = Accumulator::new(d);
        for (l, proof) in boxes.iter().enumerate() {
            let mut row = WidthRow::default();
            for (sign, multipliers, cones) in [
                (1.0, &proof.upper, &proof.upper_cones),
                (-1.0, &proof.lower, &proof.lower_cones),
            ] {
                // sign/β_l is rounded, which the slack takes.
                let form = [(l, Interval::exact(sign / beta[l]))];
                let room = Interval::exact(1.0);
                let implied = implied(
                    &system,
                    &at_zero,
                    &beta,
                    &mut sum,
                    &form,
                    room,
                    multipliers,
                    cones,
                    0,
                )?;
                let weighed = |&(j, v): &(usize, Interval)| (j, mul_up(v.magnitude(), beta[j]));
                let left_over = implied.rest.iter().map(weighed).collect();
                let slack = add_up(implied.slack, 2.0 * f64::EPSILON);
                row.join(implied.value, slack, left_over);
            }
            widths.rows.push(row);
        }
        let widening = widths.solve().ok_or_else(|| {
            VerifyError::refused("the coordinates are not proved to lie in the box")
        })?;
        for (b, w) in beta.iter_mut().zip(widening) {
            *b = mul_up(*b, w);
        }
        let last = document.claim.terminal_horizon + 1;
        // A horizon that the proofs do not reach must not cost time.
        let named = document
            .proof
            .spent
            .iter()
            .map(|s| s.step)
            .chain(document.proof.ellipsoids.iter().map(|e| e.step))
            .max()
            .unwrap_or(0);
        if named > last {
            return Err(VerifyError::refused(
                "a row is spent only after the terminal horizon",
            ));
        }
        if document.claim.condition == "exact"
            && named < last
            && document.claim.terminal_horizon > 1
        {
            return Err(VerifyError::refused(
                "no row needs the terminal horizon that is claimed",
            ));
        }
        let along = Along::of(&system, last.min(named.max(1)), &beta);
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
                    if p.step == 0 || p.step > document.claim.terminal_horizon + 1 {
                        return Err(VerifyError::refused(format!("{name} is spent at step {}", p.step)));
                    }
                    let at = &self.along.rows[p.constraint][p.step];
                    let sign = if p.upper { 1.0 } else { -1.0 };
                    let form: Vec<(usize, Interval)> = at
                        .e
                        .iter()
                        .chain(&row.w)
                        .map(|&(j, v)| (j, Interval::exact(sign * v)))
                        .collect();
                    let implied = implied(
                        &self.system,
                        &self.along,
                        &self.beta,
                        sum,
                        &form,
                        room,
                        &p.multipliers,
                        &p.cones,
                        p.step - 1,
                    )?;
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

    /// The witness lies in the set of M̃ − 1 steps and breaks a constraint at step M̃; by how much.
    fn witness(&self, document: &Document) -> Result<Option<f64>, VerifyError> {
        let horizon = document.claim.terminal_horizon;
        let needed = horizon > 1 && document.claim.condition == "exact";
        let Some(witness) = &document.proof.witness else {
            return if needed {
                Err(VerifyError::refused(
                    "nothing shows that one step less is too few",
                ))
            } else {
                Ok(None)
            };
        };
        if !needed {
            return Err(VerifyError::refused("a witness where none belongs"));
        }
        let d = self.system.dimension();
        let mut z = vec![0.0; d];
        for &(j, v) in &witness.point {
            if j >= d || !v.is_finite() {
                return Err(VerifyError::refused("the witness is no point of the space"));
            }
            z[j] = v;
        }
        let value = |entries: &[(usize, f64)]| {
            entries.iter().fold(Interval::ZERO, |s, &(j, v)| {
                if z[j] == 0.0 {
                    s
                } else {
                    s.add(Interval::exact(z[j]).times(v))
                }
            })
        };
        // In λΘ, and then step by step: the slack of a step is valid once the steps before it are.
        for row in &self.system.rows {
            let w = value(&row.w);
            let slack = row.static_slack(&self.beta);
            for (upper, at) in [(true, w.hi), (false, -w.lo)] {
                let Some(room) = row.room(upper) else {
                    continue;
                };
                let bound = (self.system.scaling * room.lo).next_down();
                if !(add_up(at, slack) <= bound) {
                    return Err(VerifyError::refused("the witness lies outside λΘ"));
                }
            }
        }
        for step in 0..horizon {
            for (i, row) in self.system.rows.iter().enumerate() {
                let at = &self.along.rows[i][step];
                let v = value(&at.e).add(value(&row.w));
                for (upper, at_most) in [(true, v.hi), (false, -v.lo)] {
                    let Some(room) = row.room(upper) else {
                        continue;
                    };
                    if !(add_up(at_most, at.slack) <= room.lo) {
                        let name = &document.claim.constraints[i].name;
                        return Err(VerifyError::refused(format!(
                            "the witness breaks {name} at step {step}"
                        )));
                    }
                }
            }
        }
        let row = self
            .system
            .rows
            .get(witness.constraint)
            .ok_or_else(|| VerifyError::refused("the witness names no row"))?;
        let room = row
            .room(witness.upper)
            .ok_or_else(|| VerifyError::refused("the witness names no row"))?;
        let at = &self.along.rows[witness.constraint][horizon];
        let v = value(&at.e).add(value(&row.w));
        let least = if witness.upper { v.lo } else { -v.hi };
        let beyond = ((least - at.slack).next_down() / room.hi).next_down() - 1.0;
        if beyond > 0.0 {
            Ok(Some(beyond))
        } else {
            Err(VerifyError::refused(
                "the witness does not show that one step less is too few",
            ))
        }
    }
}

/// Bounds a linear form by rows and ellipsoids of steps up to `last`. `room` is the room of the form, by which multipliers are scaled.
#[allow(clippy::too_many_arguments)]
pub(super) fn implied(
    system: &System,
    along: &Along,
    beta: &[f64],
    sum: &mut Accumulator,
    form: &[(usize, Interval)],
    room: Interval,
    multipliers: &[Multiplier],
    cones: &[ConeMultiplier],
    last: usize,
) -> Result<Implied, VerifyError> {
    form.iter().for_each(|&(j, v)| sum.add(j, v));
    let (mut value, mut slack) = (0.0, 0.0);
    for &(i, upper, step, y) in multipliers {
        let row = system
            .rows
            .get(i)
            .ok_or_else(|| VerifyError::refused("a multiplier names no row"))?;
        let own = row.room(upper).ok_or_else(|| {
            VerifyError::refused("a multiplier names a side that is no constraint")
        })?;
        if !(y >= 0.0 && y.is_finite()) || step.is_some_and(|s| s > last) {
            return Err(VerifyError::refused(
                "a multiplier is negative, or names a step that comes too late",
            ));
        }
        // Any non-negative double will do; this one makes the sum close.
        let factor = y * room.hi / own.hi;
        let signed = if upper { -factor } else { factor };
        row.w
            .iter()
            .for_each(|&(j, v)| sum.add(j, Interval::exact(v).times(signed)));
        let (bound, error) = match step {
            None => (mul_up(system.scaling, own.hi), row.static_slack(beta)),
            Some(s) => {
                let at = &along.rows[i][s];
                at.e.iter()
                    .for_each(|&(j, v)| sum.add(j, Interval::exact(v).times(signed)));
                (own.hi, at.slack)
            }
        };
        value = add_up(value, mul_up(factor, bound));
        slack = add_up(slack, mul_up(factor, error));
    }
    for cone in cones {
        let (bound, error) = ellipsoids::subtract(system, along, beta, sum, room, cone, last)?;
        value = add_up(value, bound);
        slack = add_up(slack, error);
    }
    Ok(Implied {
        value,
        slack,
        rest: sum.take(),
    })
}
