//! A walk of many equal rounds in one.
//!
//! Active rows that depend on each other and cannot all hold with equality leave a residual that no stiffness removes: every round adds
//! the same y − ȳ, along which G_Wᵀy stays and the dual cost grows linearly, until a multiplier that falls reaches zero and its row leaves.
//! With a residual of 1e-8 and multipliers of 1e6 that is a hundred thousand rounds. Here the multipliers go there at once. Any
//! multipliers of the right signs may be the next centre: what comes out is checked as after every round.

use super::solve::Solver;
use crate::Scalar;

/// A walk of fewer rounds is left to the rounds.
const SHORT: f64 = 2.0;

/// A multiplier that changes by a smaller part of the largest change falls by rounding: where no point satisfies all rows, none falls.
const PART: f64 = 1e-3;

impl<T: Scalar> Solver<'_, '_, '_, T> {
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
