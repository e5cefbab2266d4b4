//! The plan that is always there: the shifted candidate (32).
//!
//! In the variables `z = (c, θ)` it reads `c⁺ = (c_1, …, c_{N−1}, 0)`, `θ⁺ = θ`. At the predicted state it satisfies every row
//! (Theorem 3) and costs less than the last solution (Theorem 4). At another state it is checked first.

use crate::dense::{all_finite, axpy, dot};
use crate::{Scalar, Tables};

/// Shifts a plan of inputs `c_0 … c_{N−1}` by one stage, in place.
pub(crate) fn shift_plan<T: Scalar>(plan: &mut [T], inputs: usize) {
    let horizon_end = plan.len() - inputs;
    if horizon_end >= inputs {
        plan.copy_within(inputs..horizon_end, 0);
        plan[horizon_end - inputs..horizon_end].fill(T::ZERO);
    }
}

/// Largest `Gᵢz − bᵢ(x)` in units of right-hand sides, not below 0. +∞ when a row is not finite.
pub(crate) fn violation<T: Scalar>(tables: &Tables<'_, T>, x: &[T], z: &[T]) -> T {
    let mut largest = T::ZERO;
    for row in 0..tables.dims.rows {
        let q = tables.residual(row, x, z) / tables.scale[row];
        if !q.is_finite() {
            return T::INFINITY;
        }
        largest = largest.max(q);
    }
    largest
}

/// Moves a feasible `plan` towards `z` as far as all rows allow.
///
/// When a dual method is cut short, `z` violates rows but its cost is a lower bound of the optimum. The cost is convex,
/// so every point between costs no more than `plan`: half a solution is not lost.
/// Writes `z − plan` into `direction`; returns the step in `[0, 1]`.
pub(crate) fn advance<T: Scalar>(
    tables: &Tables<'_, T>,
    x: &[T],
    z: &[T],
    plan: &mut [T],
    direction: &mut [T],
) -> T {
    for ((d, &to), &from) in direction.iter_mut().zip(z).zip(plan.iter()) {
        *d = to - from;
    }
    let mut t = T::ONE;
    for row in 0..tables.dims.rows {
        let rise = dot(tables.g_row(row), direction);
        let slack = -tables.residual(row, x, plan);
        if rise > T::ZERO {
            if !(slack > T::ZERO) {
                return T::ZERO;
            }
            if slack < t * rise {
                t = slack / rise;
            }
        } else if !(rise <= T::ZERO) {
            return T::ZERO;
        }
    }
    axpy(t, direction, plan);
    t
}

/// Draws an input into U = {u : E u ≤ 1}, which contains 0 and is convex: scaling towards 0 always ends inside. What is beyond all
/// numbers becomes 0.
pub(crate) fn into_limits<T: Scalar>(input: &mut [T], rows: impl Fn(&[T], &mut dyn FnMut(T))) {
    let mut outside = T::ONE;
    rows(input, &mut |found| {
        outside = outside.max(if found.is_nan() { T::INFINITY } else { found });
    });
    if !all_finite(input) {
        input.fill(T::ZERO);
    } else if outside > T::ONE {
        for u in input.iter_mut() {
            *u = *u / outside;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_end_in_their_limits() {
        // |u_i| ≤ 2 as rows ± u_i / 2 ≤ 1.
        let limited = |mut u: [f64; 2]| {
            into_limits(&mut u, |input, each| {
                for v in input {
                    each(v / 2.0);
                    each(v / -2.0);
                }
            });
            u
        };
        assert_eq!(limited([1.0, -2.0]), [1.0, -2.0]);
        assert_eq!(limited([4.0, -2.0]), [2.0, -1.0]);
        assert_eq!(limited([f64::NEG_INFINITY, 1.0]), [0.0, 0.0]);
        assert_eq!(limited([f64::NAN, 1.0]), [0.0, 0.0]);
    }
}
