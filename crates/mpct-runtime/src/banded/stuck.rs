//! What is done when a round makes no progress.
//!
//! Either the residuals are rounding, or no point satisfies all rows and y − ȳ proves it, or active rows depend on each other and
//! cannot all hold with equality. In that case every round adds the same y − ȳ, along which G_Wᵀy stays and the dual cost grows linearly, until a
//! multiplier that falls reaches zero and its row leaves. A round walks there by ρ times the residual: stiffer rows make it faster; with a
//! residual of 1e-8 and multipliers of 1e6 it is still a hundred rounds, and the multipliers go there at once. Any multipliers of the
//! right signs may be the next centre: what comes out is checked as after every round.

use super::solve::{Solver, Stop, stiffness};
use crate::Scalar;
use crate::dense::max_abs;

/// A proof of infeasibility must also hold for points this many times larger than the one reached, in the 1-norm. Smaller, and with hundreds
/// of variables in f32 it would leave room for a solution.
const FARTHER: f64 = 2.0;
/// A radius beyond which nothing is asked of a proof.
const FAR: f64 = 1e6;
/// A residual below this many units in the last place of its terms is rounding. Smaller, and f32 would walk on the spot.
const ROUNDING: f64 = 4.0;

/// A walk of fewer rounds is left to the rounds.
const SHORT: f64 = 2.0;

/// A multiplier that changes by a smaller part of the largest change falls by rounding: where no point satisfies all rows, none falls.
const PART: f64 = 1e-3;

/// Factor by which rows are stiffened that walk, twice at most. Larger, and nothing would be left of H beside them.
fn harder<T: Scalar>() -> T {
    if T::EPSILON.to_f64() < 1e-10 {
        T::from_f64(1e3)
    } else {
        T::from_f64(30.0)
    }
}

impl<T: Scalar> Solver<'_, '_, '_, T> {
    /// Whether what the residuals of the active rows have beyond [`Scalar::PRIMAL`] is the rounding of their terms.
    pub(super) fn is_rounding(&self) -> bool {
        let (p, d) = (&*self.parts, &self.tables.data);
        let terms = |row: &[T], x: &[T]| {
            let mut sum = T::ZERO;
            for (&a, &b) in row.iter().zip(x) {
                sum += (a * b).abs();
            }
            sum
        };
        p.active[..self.state.active]
            .iter()
            .zip(p.slope.iter())
            .all(|(&pair, residual)| {
                let pair = pair as usize;
                let of_z = terms(d.rows.row(pair), &p.z[d.rows.window(pair)]);
                let of_x = terms(d.rows_state.row(pair), &p.x[d.rows_state.window(pair)]);
                let noise = T::from_f64(ROUNDING) * T::EPSILON * (of_z + of_x);
                residual.abs() <= (T::PRIMAL * d.scale[pair]).max(noise)
            })
    }

    /// y − ȳ as a proof of infeasibility: where no point satisfies all rows, the multipliers grow along one.
    /// Leaves it in `slope` by pairs. Returns the radius, see the dense regime.
    pub(super) fn prove(&mut self) -> Option<T> {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        p.slope.fill(T::ZERO);
        p.direction.fill(T::ZERO);
        let (mut bound, mut magnitude) = (T::ZERO, T::ZERO);
        for &pair in &p.active[..self.state.active] {
            let pair = pair as usize;
            let grown = p.y[pair] - p.centre[pair];
            let (multiplier, limit) = if p.side[pair] == 1 {
                (grown.max(T::ZERO), d.upper[pair])
            } else {
                (-((-grown).max(T::ZERO)), d.lower[pair])
            };
            if multiplier == T::ZERO {
                continue;
            }
            p.slope[pair] = multiplier;
            d.rows.add_row(pair, multiplier, p.direction);
            let state = multiplier * d.rows_state.dot(pair, p.x);
            bound += multiplier.abs() * limit - state;
            magnitude += multiplier.abs() * limit + state.abs();
        }
        if !(-bound > T::PROOF_MARGIN * magnitude) {
            return None;
        }
        let size = max_abs(p.direction);
        let radius = if size > T::ZERO {
            -bound / size
        } else {
            T::INFINITY
        };
        let mut reached = T::ZERO;
        for z in p.z.iter() {
            reached += z.abs();
        }
        let beyond = T::from_f64(FARTHER) * reached;
        let enough = if beyond < T::from_f64(FAR) {
            beyond
        } else {
            T::from_f64(FAR)
        };
        if radius > T::PROOF_RADIUS.max(enough) {
            self.state.has_proof = true;
            Some(radius)
        } else {
            None
        }
    }

    /// Stiffens the active rows that do not hold with equality yet, or brings all back to the usual stiffness. Whether any changed.
    ///
    /// Rows that depend on each other and cannot all hold with equality make the dual cost linear along a direction in which one of
    /// their multipliers falls, until its row leaves. A round walks along it by ρ times the residual: with 1e5 that can take hundreds
    /// of rounds, with a thousand or a million times as much it takes one. Left stiff, they would carry the rounding of z into their multipliers.
    pub(super) fn stiffen(&mut self, more: bool) -> Result<bool, Stop<T>> {
        let (base, mut changed) = (stiffness::<T>(), false);
        for k in 0..self.state.active {
            let (p, d) = (&mut *self.parts, &self.tables.data);
            let pair = p.active[k] as usize;
            let old = p.stiff[pair];
            let new = if !more {
                base
            } else if p.slope[k].abs() > T::REFINE * d.scale[pair] && old <= base * harder::<T>() {
                old * harder::<T>()
            } else {
                old
            };
            if new != old {
                changed = true;
                p.stiff[pair] = new;
                self.change(pair, new - old)?;
            }
        }
        self.state.is_stiff = more;
        self.state.has_pull &= !changed;
        Ok(changed)
    }

    /// Continues y − ȳ until the first multiplier is zero.
    pub(super) fn walk(&mut self) {
        let p = &mut *self.parts;
        let active = &p.active[..self.state.active];
        let (mut rounds, mut most) = (T::INFINITY, T::ZERO);
        for &pair in active {
            most = most.max((p.y[pair as usize] - p.centre[pair as usize]).abs());
        }
        for &pair in active {
            let pair = pair as usize;
            let (y, grown) = (p.y[pair], p.y[pair] - p.centre[pair]);
            let is_falling = (grown < T::ZERO) == (p.side[pair] == 1) && grown != T::ZERO;
            if is_falling && grown.abs() > T::from_f64(PART) * most {
                let left = y.abs() / grown.abs();
                if left < rounds {
                    rounds = left;
                }
            }
        }
        if !(rounds > T::from_f64(SHORT)) || !rounds.is_finite() {
            return;
        }
        for &pair in active {
            let pair = pair as usize;
            let y = p.y[pair] + rounds * (p.y[pair] - p.centre[pair]);
            p.y[pair] = if p.side[pair] == 1 {
                y.max(T::ZERO)
            } else {
                -((-y).max(T::ZERO))
            };
        }
    }
}
