//! The dual simplex method for the linear programs of the terminal set.
//!
//! maximise w·z  subject to  −l_k ≤ r_k·z ≤ u_k  (k = 1, …, rows)  and  |z_j| ≤ 1,   with 0 < l_k, u_k.
//!
//! The family is special, and the method follows from it: the origin is always feasible, the box gives a vertex
//! whose multipliers are non-negative at once, and only the question "is the optimum above 1?" matters. Every
//! iterate carries multipliers y ≥ 0 with Σ y_k r_k = w, so Σ y_k b_k is an upper bound of the optimum *before* the
//! method has ended, and most questions end early.
//!
//! A step takes the product of B⁻¹ with the entering row, the change of B⁻¹ ([`basis`]), and a look at the rows: that of
//! all rows would dominate. A pass over all of them therefore keeps its worst few; pivots are chosen among these until
//! they are satisfied or stale, and only then all rows are looked at again ([`pricing`]).
//!
//! Source: dual simplex with an explicit inverse, Bertsimas and Tsitsiklis, "Introduction to Linear Optimization",
//! section 4.5; bounded rows as in Maros, "Computational Techniques of the Simplex Method", chapter 10, multiple
//! pricing in chapter 9.

mod basis;
mod pivot;
mod pricing;

use crate::clock::Clock;
use crate::kernels::Kernels;
use pivot::Pivot;

/// Rows −l ≤ r·z ≤ u, dense, row-major. An infinite bound is no bound.
pub(super) struct Rows<'a> {
    /// Number of variables.
    pub(super) width: usize,
    /// `count × width` coefficients.
    pub(super) coefficients: &'a [f64],
    /// u.
    pub(super) upper: &'a [f64],
    /// l.
    pub(super) lower: &'a [f64],
    /// 1/‖r_k‖₂, to compare violations; 0 for a row of zeros.
    pub(super) inverse_norms: &'a [f64],
}

impl Rows<'_> {
    fn row(&self, k: usize) -> &[f64] {
        &self.coefficients[k * self.width..(k + 1) * self.width]
    }
}

/// How the method ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    /// z is feasible and optimal.
    Optimal,
    /// The upper bound fell to the lower threshold; z need not be feasible.
    Below,
    /// z scaled back until it is feasible has a value above the upper threshold.
    Above,
    /// Neither, within the pivots allowed.
    PivotLimit,
    /// The clock rang.
    Stopped,
}

/// Pivots after which the inverse is computed anew, so that rounding does not pile up in it.
const REFRESH: usize = 100;
/// Pivots after which the inverse is not trusted to end the method.
const WORN: usize = 16;
/// Entering rows refused for want of a pivot before the method gives up.
const REFUSALS: usize = 50;
/// Pivots between two looks at the clock.
const CLOCK: usize = 16;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Basic {
    /// Box of variable j; +1 or −1.
    Box(usize, f64),
    /// Row k; +1 at its upper, −1 at its lower side.
    Row(usize, f64),
}

/// Scratch memory and method; one per thread. After [`DualSimplex::maximise`] it holds the last iterate.
#[derive(Default)]
pub(super) struct DualSimplex {
    kernels: Kernels,
    /// Columns of B⁻¹, one after the other.
    inverse: Vec<f64>,
    basis: Vec<Basic>,
    y: Vec<f64>,
    z: Vec<f64>,
    alpha: Vec<f64>,
    /// A column of B⁻¹, and the values of all rows.
    column: Vec<f64>,
    values: Vec<f64>,
    /// Rows among the candidates, and their values.
    places: Vec<usize>,
    candidate_values: Vec<f64>,
    /// Basic rows whose multipliers fall, and when they reach zero.
    falling: Vec<(f64, usize)>,
    candidates: Vec<(f64, Basic)>,
    /// Violation of the worst candidate when all rows were last looked at.
    worst: f64,
    /// How far z, when all rows were looked at, was beyond the rows: z/reach is feasible. Infinite after a pivot.
    reach: f64,
    pivots: usize,
    /// Pivots since the inverse was computed from the basis.
    since_fresh: usize,
}

impl DualSimplex {
    /// Runs until the optimum is found, proved to be at most `thresholds[0]`, or proved to be more than
    /// `thresholds[1]`. `skip` is a row left out.
    pub(super) fn maximise(
        &mut self,
        w: &[f64],
        rows: &Rows<'_>,
        thresholds: [f64; 2],
        skip: Option<(usize, bool)>,
        clock: &Clock,
    ) -> Ending {
        let d = rows.width;
        self.start_at_box(w);
        let limit = 1000 + 40 * d;
        let mut refused = 0;
        loop {
            let bound = self.bound(rows);
            // Rank-one updates wear the inverse out: a long run looks once more with a fresh one before it ends.
            if bound <= thresholds[0] {
                if self.is_worn() && self.refresh(rows, w) {
                    continue;
                }
                return Ending::Below;
            }
            let Some((entering, violation)) = self.entering(rows, skip) else {
                if self.is_worn() && self.refresh(rows, w) {
                    continue;
                }
                return Ending::Optimal;
            };
            // w·z is the bound, at every basis.
            if bound > thresholds[1] * self.reach {
                return Ending::Above;
            }
            let fresh = self.since_fresh == 0;
            match self.pivot(rows, entering, violation, skip, fresh) {
                Pivot::Made => {
                    self.pivots += 1;
                    self.since_fresh += 1;
                    if self.pivots >= limit
                        || (self.since_fresh == REFRESH && !self.refresh(rows, w))
                    {
                        return Ending::PivotLimit;
                    }
                }
                Pivot::Doubtful | Pivot::None if !fresh => {
                    if !self.refresh(rows, w) {
                        return Ending::PivotLimit;
                    }
                }
                Pivot::Doubtful | Pivot::None => {
                    // Exact arithmetic has a pivot for every row: this one depends on the basis up to rounding.
                    self.candidates.retain(|c| c.1 != entering);
                    refused += 1;
                    if refused == REFUSALS {
                        return Ending::PivotLimit;
                    }
                }
            }
            if self.pivots.is_multiple_of(CLOCK) && clock.has_stopped() {
                return Ending::Stopped;
            }
        }
    }

    fn is_worn(&self) -> bool {
        self.since_fresh > WORN
    }

    /// The vertex.
    pub(super) fn point(&self) -> &[f64] {
        &self.z
    }

    /// (row, true for its upper side, multiplier > 0).
    pub(super) fn multipliers(&self) -> impl Iterator<Item = (usize, bool, f64)> + '_ {
        self.basis
            .iter()
            .zip(&self.y)
            .filter_map(|(b, &y)| match *b {
                Basic::Row(k, side) if y > 0.0 => Some((k, side > 0.0, y)),
                _ => None,
            })
    }

    /// Σ y b, box included: an upper bound of the optimum.
    pub(super) fn bound(&self, rows: &Rows<'_>) -> f64 {
        self.basis
            .iter()
            .zip(&self.y)
            .map(|(b, &y)| match *b {
                Basic::Box(..) => y,
                Basic::Row(k, side) if side > 0.0 => y * rows.upper[k],
                Basic::Row(k, _) => y * rows.lower[k],
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// max z₀ + z₁ with z₀ + 2 z₁ ≤ 1 and |z| ≤ 1: the vertex (1, 0) of value 1.
    #[test]
    fn two_variables_by_hand() {
        let rows = Rows {
            width: 2,
            coefficients: &[1.0, 2.0],
            upper: &[1.0],
            lower: &[f64::INFINITY],
            inverse_norms: &[5.0_f64.sqrt().recip()],
        };
        let mut simplex = DualSimplex::default();
        let clock = Clock::unlimited();
        let ending = simplex.maximise(&[1.0, 1.0], &rows, [0.0, f64::INFINITY], None, &clock);
        assert_eq!(ending, Ending::Optimal);
        assert!((simplex.bound(&rows) - 1.0).abs() < 1e-15);
        assert!((simplex.point()[0] - 1.0).abs() < 1e-15);
        assert!(simplex.point()[1].abs() < 1e-15);
        // The bound is proved early when that is enough.
        let ending = simplex.maximise(&[1.0, 1.0], &rows, [2.0, f64::INFINITY], None, &clock);
        assert_eq!(ending, Ending::Below);
        // Without its row the box decides.
        simplex.maximise(
            &[1.0, 1.0],
            &rows,
            [0.0, f64::INFINITY],
            Some((0, true)),
            &clock,
        );
        assert_eq!(simplex.bound(&rows), 2.0);
    }

    #[test]
    fn a_fresh_inverse_changes_nothing() {
        let rows = Rows {
            width: 2,
            coefficients: &[1.0, 2.0, 3.0, 1.0],
            upper: &[1.0, 1.0],
            lower: &[1.0, 1.0],
            inverse_norms: &[5.0_f64.sqrt().recip(), 10.0_f64.sqrt().recip()],
        };
        let mut simplex = DualSimplex::default();
        let w = [1.0, 1.0];
        simplex.maximise(&w, &rows, [0.0, f64::INFINITY], None, &Clock::unlimited());
        let (z, y) = (simplex.z.clone(), simplex.y.clone());
        assert!(simplex.refresh(&rows, &w));
        for (a, b) in z.iter().chain(&y).zip(simplex.z.iter().chain(&simplex.y)) {
            assert!((a - b).abs() < 1e-14);
        }
    }
}
