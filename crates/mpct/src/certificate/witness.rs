//! That one step less is too few: a point, evaluated in intervals.

use super::document::Document;
use super::interval::{Interval, add_up, mul_up};
use super::verify::{Checker, VerifyError};

impl Checker {
    /// The witness lies in the set of M̃ − 1 steps and breaks a constraint at step M̃; by how much.
    pub(super) fn witness(&self, document: &Document) -> Result<Option<f64>, VerifyError> {
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
        // What is not known of a row is bounded in the box; a point outside of it counts by as much as it is outside.
        let outside = z
            .iter()
            .zip(&self.beta)
            .fold(1.0_f64, |a, (v, b)| a.max((v.abs() / b).next_up()));
        let value = |entries: &[(usize, f64)]| {
            entries.iter().fold(Interval::ZERO, |s, &(j, v)| {
                if z[j] == 0.0 {
                    s
                } else {
                    s.add(Interval::exact(z[j]).times(v))
                }
            })
        };
        // Where θ is unbounded, w is not known by its box.
        let equilibrium = |i: usize| {
            let row = self.system.rows[i].equilibrium(&self.beta);
            row.fold(Interval::ZERO, |s, (j, v)| {
                if z[j] == 0.0 { s } else { s.add(v.times(z[j])) }
            })
        };
        // In λΘ, and then step by step: the slack of a step is valid once the steps before it are.
        for (i, row) in self.system.rows.iter().enumerate() {
            let w = equilibrium(i);
            let slack = mul_up(row.static_slack(&self.beta), outside);
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
                let v = value(&at.e).add(equilibrium(i));
                for (upper, at_most) in [(true, v.hi), (false, -v.lo)] {
                    let Some(room) = row.room(upper) else {
                        continue;
                    };
                    if !(add_up(at_most, mul_up(at.slack, outside)) <= room.lo) {
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
        let v = value(&at.e).add(equilibrium(witness.constraint));
        let least = if witness.upper { v.lo } else { -v.hi };
        let slack = mul_up(at.slack, outside);
        let beyond = ((least - slack).next_down() / room.hi).next_down() - 1.0;
        if beyond > 0.0 {
            Ok(Some(beyond))
        } else {
            Err(VerifyError::refused(
                "the witness does not show that one step less is too few",
            ))
        }
    }
}
