//! A bound on a linear form from multipliers, with every rounding error in it.

use super::document::{ConeMultiplier, Multiplier};
use super::ellipsoids;
use super::interval::{Accumulator, Interval, add_up, mul_up};
use super::rows::{StepRow, System, weighted};
use super::verify::VerifyError;
use rayon::prelude::*;

/// A bound on a linear form: at most `value` plus `slack` plus what the box allows of `rest`.
pub(super) struct Implied {
    pub(super) value: f64,
    pub(super) slack: f64,
    pub(super) rest: Vec<(usize, Interval)>,
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

/// Constraints along the terminal law.
pub(super) struct Along {
    /// Constraint, step.
    pub(super) rows: Vec<Vec<StepRow>>,
    /// Ellipsoid, component, step.
    pub(super) norms: Vec<Vec<Vec<StepRow>>>,
}

impl Along {
    /// Steps 0, …, `last`; see [`System::along`].
    pub(super) fn of(system: &System, last: usize, beta: &[f64], box_steps: usize) -> Self {
        let rows = (0..system.rows.len()).into_par_iter();
        let norms = (0..system.norms.len()).into_par_iter();
        Self {
            rows: rows
                .map(|i| system.along(i, last, beta, box_steps))
                .collect(),
            norms: norms
                .map(|k| system.norm_along(k, last, beta, box_steps))
                .collect(),
        }
    }
}

/// The rows and ellipsoids that multipliers may name.
#[derive(Clone, Copy)]
pub(super) struct Known<'a> {
    pub(super) system: &'a System,
    pub(super) along: &'a Along,
    pub(super) beta: &'a [f64],
    /// Steps after this one do not count.
    pub(super) last: usize,
}

/// Bounds a linear form by what is known. `room` is the room of the form, by which multipliers are scaled.
pub(super) fn implied(
    known: &Known<'_>,
    sum: &mut Accumulator,
    form: &[(usize, Interval)],
    room: Interval,
    multipliers: &[Multiplier],
    cones: &[ConeMultiplier],
) -> Result<Implied, VerifyError> {
    let Known {
        system,
        along,
        beta,
        last,
    } = *known;
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
        row.equilibrium(beta)
            .for_each(|(j, v)| sum.add(j, v.times(signed)));
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
        let (bound, error) = ellipsoids::subtract(known, sum, room, cone)?;
        value = add_up(value, bound);
        slack = add_up(slack, error);
    }
    let mut implied = Implied {
        value,
        slack,
        rest: sum.take(),
    };
    mend(known, &mut implied, room, multipliers)?;
    Ok(implied)
}

/// Coordinates of θ without a box: nothing may be left over there. Between the multipliers of the file and real numbers
/// with which the sum closes exactly lies a rounding error, and it is enough that such numbers exist: one multiplier
/// is moved by |rest/w|, which moves everything else by at most as much times its row.
fn mend(
    known: &Known<'_>,
    implied: &mut Implied,
    room: Interval,
    multipliers: &[Multiplier],
) -> Result<(), VerifyError> {
    let Known { system, beta, .. } = *known;
    let is_open = |&(j, v): &(usize, Interval)| beta[j].is_infinite() && v != Interval::ZERO;
    let open: Vec<(usize, Interval)> = implied.rest.iter().copied().filter(is_open).collect();
    implied.rest.retain(|e| !beta[e.0].is_infinite());
    for (j, left) in open {
        // A row whose only coordinate without a box is this one.
        let alone = |w: &[(usize, f64)]| {
            let mut open = w.iter().filter(|e| beta[e.0].is_infinite());
            open.next()
                .filter(|e| e.0 == j)
                .filter(|_| open.next().is_none())
                .map(|e| e.1)
        };
        let mended = multipliers.iter().find_map(|&(i, upper, step, y)| {
            let row = &system.rows[i];
            let (own, w) = (row.room(upper)?, alone(&row.w)?);
            let w = (w.abs() - row.w_error_at(j)).next_down();
            let factor = y * room.hi / own.hi;
            let by = (left.magnitude() / w).next_up();
            (w > 0.0 && by <= factor).then_some((i, step, own, by))
        });
        let (i, step, own, by) = mended.ok_or_else(|| {
            VerifyError::refused(format!(
                "coordinate {j} is not bounded, and something is left over there"
            ))
        })?;
        let row = &system.rows[i];
        let (e, error, bound) = match step {
            None => (
                &[][..],
                row.static_slack(beta),
                mul_up(system.scaling, own.hi),
            ),
            Some(s) => {
                let at = &known.along.rows[i][s];
                (&at.e[..], at.slack, own.hi)
            }
        };
        let others: Vec<(usize, f64)> = row.w.iter().copied().filter(|e| e.0 != j).collect();
        let moved = add_up(weighted(e, beta), weighted(&others, beta));
        implied.value = add_up(implied.value, mul_up(by, bound));
        implied.slack = add_up(implied.slack, mul_up(by, add_up(error, moved)));
    }
    Ok(())
}
