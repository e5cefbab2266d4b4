//! The dual simplex method for the linear programs of the terminal set.
//!
//! maximise w·z  subject to  −l_k ≤ r_k·z ≤ u_k  (k = 1, …, rows)  and  |z_j| ≤ 1,   with 0 < l_k, u_k.
//!
//! The family is special, and the method follows from it: the origin is always feasible, the box gives a vertex
//! whose multipliers are non-negative at once, and only the question "is the optimum above 1?" matters. Every
//! iterate carries multipliers y ≥ 0 with Σ y_k r_k = w, so Σ y_k b_k is an upper bound of the optimum *before* the
//! method has ended, and most questions end early.
//!
//! Nearly all of the time goes into the products r_k·z. A pass over all rows therefore keeps its worst few; pivots
//! are chosen among these until they are satisfied or stale, and only then all rows are looked at again.
//!
//! Source: dual simplex with an explicit inverse, Bertsimas and Tsitsiklis, "Introduction to Linear Optimization",
//! section 4.5; bounded rows as in Maros, "Computational Techniques of the Simplex Method", chapter 10, multiple
//! pricing in chapter 9.

use crate::clock::Clock;
use crate::linalg::{self, Dense};

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

/// A row violated by less than this, relative to its norm, counts as satisfied. The answers are checked against
/// their own bound afterwards, so this only has to stop the method from chasing rounding.
const FEASIBILITY: f64 = 1e-11;
/// Entries of α smaller than this, relative to the largest, are no pivots.
const PIVOT: f64 = 1e-9;
/// Pivots smaller than this, relative to the largest candidate, are taken only from a fresh inverse.
const DOUBTFUL: f64 = 1e-5;
/// The ratio test lets multipliers become this negative if that gives a larger pivot (Harris). The verdict counts
/// negative multipliers as left over.
const HARRIS: f64 = 1e-12;
/// Rows kept from a pass over all of them.
const CANDIDATES: usize = 60;
/// A candidate is stale when it is violated by less than this share of the worst at the last pass. Choosing always the
/// worst of all rows costs twice the pivots: on dense plants of 120 variables 620 against 330.
const STALE: f64 = 0.05;
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
    /// Columns of B⁻¹, one after the other.
    inverse: Vec<f64>,
    basis: Vec<Basic>,
    y: Vec<f64>,
    z: Vec<f64>,
    alpha: Vec<f64>,
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

/// What became of a pivot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pivot {
    Made,
    /// Only a small one was found, and the inverse is not fresh: nothing was changed.
    Doubtful,
    /// No row can leave, which exact arithmetic excludes: the origin is feasible.
    None,
}

/// Distance between the two sides of a basic row; infinite when the other side is no constraint.
fn width(rows: &Rows<'_>, skip: Option<(usize, bool)>, basic: Basic) -> f64 {
    match basic {
        Basic::Box(..) => 2.0,
        Basic::Row(k, side) if skip == Some((k, side < 0.0)) => f64::INFINITY,
        Basic::Row(k, _) => rows.upper[k] + rows.lower[k],
    }
}

/// Σ a_i b_i.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Partial sums let the compiler vectorise without reordering one sum.
    let mut s = [0.0; 8];
    let (ca, cb) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = ca
        .remainder()
        .iter()
        .zip(cb.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in ca.zip(cb) {
        for i in 0..8 {
            s[i] += x[i] * y[i];
        }
    }
    ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7])) + tail
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

    /// The vertex of the box in the direction of w: its multipliers are |w|.
    fn start_at_box(&mut self, w: &[f64]) {
        let d = w.len();
        self.inverse.clear();
        self.inverse.resize(d * d, 0.0);
        self.basis.clear();
        self.y.clear();
        self.z.clear();
        self.alpha.clear();
        self.alpha.resize(d, 0.0);
        self.candidates.clear();
        self.worst = f64::INFINITY;
        self.reach = f64::INFINITY;
        self.pivots = 0;
        self.since_fresh = 0;
        for (j, &wj) in w.iter().enumerate() {
            let side = if wj < 0.0 { -1.0 } else { 1.0 };
            self.inverse[j * d + j] = side;
            self.basis.push(Basic::Box(j, side));
            self.y.push(wj.abs());
            self.z.push(side);
        }
    }

    /// The row, or side of the box, to enter the basis, with its violation.
    fn entering(&mut self, rows: &Rows<'_>, skip: Option<(usize, bool)>) -> Option<(Basic, f64)> {
        if let Some((scaled, basic, violation)) = self.worst_candidate(rows)
            && scaled > STALE * self.worst
        {
            return Some((basic, violation));
        }
        self.look_at_all(rows, skip);
        let (scaled, basic, violation) = self.worst_candidate(rows)?;
        self.worst = scaled;
        Some((basic, violation))
    }

    /// The candidate violated most: relative to its norm, and absolutely.
    fn worst_candidate(&self, rows: &Rows<'_>) -> Option<(f64, Basic, f64)> {
        let mut worst = FEASIBILITY;
        let mut found = None;
        for &(_, basic) in &self.candidates {
            let (violation, inverse_norm) = match basic {
                Basic::Box(j, side) => (side * self.z[j] - 1.0, 1.0),
                Basic::Row(k, side) => {
                    let bound = if side > 0.0 {
                        rows.upper[k]
                    } else {
                        rows.lower[k]
                    };
                    (
                        side * dot(rows.row(k), &self.z) - bound,
                        rows.inverse_norms[k],
                    )
                }
            };
            let scaled = violation * inverse_norm;
            if scaled > worst {
                worst = scaled;
                found = Some((scaled, basic, violation));
            }
        }
        found
    }

    /// Keeps the rows and sides of the box that z violates most.
    fn look_at_all(&mut self, rows: &Rows<'_>, skip: Option<(usize, bool)>) {
        let Self { candidates, z, .. } = self;
        let mut reach = 1.0_f64;
        candidates.clear();
        for (k, row) in rows.coefficients.chunks_exact(rows.width).enumerate() {
            let value = dot(row, z);
            let above = (value - rows.upper[k]) * rows.inverse_norms[k];
            let below = (-value - rows.lower[k]) * rows.inverse_norms[k];
            if above > FEASIBILITY && skip != Some((k, true)) {
                reach = reach.max(value / rows.upper[k]);
                candidates.push((above, Basic::Row(k, 1.0)));
            }
            if below > FEASIBILITY && skip != Some((k, false)) {
                reach = reach.max(-value / rows.lower[k]);
                candidates.push((below, Basic::Row(k, -1.0)));
            }
        }
        for (j, &zj) in z.iter().enumerate() {
            if zj.abs() - 1.0 > FEASIBILITY {
                reach = reach.max(zj.abs());
                candidates.push((zj.abs() - 1.0, Basic::Box(j, zj.signum())));
            }
        }
        if candidates.len() > CANDIDATES {
            candidates.select_nth_unstable_by(CANDIDATES, |a, b| b.0.total_cmp(&a.0));
            candidates.truncate(CANDIDATES);
        }
        self.reach = reach;
    }

    /// Exchanges the entering row for one whose multiplier reaches zero first, up to rounding.
    ///
    /// A row whose multiplier would change its sign may also stay in the basis at its opposite bound (Maros, section
    /// 7.6): z then moves by the width of that row, and as long as the entering row stays violated the bound goes on
    /// falling. One pivot does the work of several.
    fn pivot(
        &mut self,
        rows: &Rows<'_>,
        entering: Basic,
        violation: f64,
        skip: Option<(usize, bool)>,
        fresh: bool,
    ) -> Pivot {
        let d = rows.width;
        // α = B⁻ᵀ r: the entering row as a combination of the basic ones.
        let mut largest = 0.0_f64;
        for (c, column) in self.inverse.chunks_exact(d).enumerate() {
            let a = match entering {
                Basic::Row(k, side) => side * dot(rows.row(k), column),
                Basic::Box(j, side) => side * column[j],
            };
            self.alpha[c] = a;
            largest = largest.max(a.abs());
        }
        let smallest = PIVOT * largest;
        let Self {
            alpha, y, falling, ..
        } = self;
        falling.clear();
        let entries = alpha.iter().zip(y.iter()).enumerate();
        falling.extend(
            entries
                .filter(|(_, (a, _))| **a > smallest)
                .map(|(c, (a, y))| (y.max(0.0) / a, c)),
        );
        falling.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        // Rows before `first` go to their opposite bounds.
        let (mut first, mut left) = (0, violation);
        let leaving = loop {
            let Some(rest) = falling.get(first..).filter(|r| !r.is_empty()) else {
                return Pivot::None;
            };
            // Multipliers may become a little negative if that gives a larger pivot (Harris).
            let step = rest
                .iter()
                .map(|&(ratio, c)| ratio + HARRIS / alpha[c])
                .fold(f64::INFINITY, f64::min);
            let count = rest.partition_point(|r| r.0 <= step).max(1);
            let width: f64 = rest[..count]
                .iter()
                .map(|&(_, c)| alpha[c] * width(rows, skip, self.basis[c]))
                .sum();
            if left > width {
                left -= width;
                first += count;
                continue;
            }
            let best = rest[..count]
                .iter()
                .max_by(|a, b| alpha[a.1].total_cmp(&alpha[b.1]));
            match best {
                Some(&(_, c)) => break c,
                None => return Pivot::None,
            }
        };
        if !fresh && self.alpha[leaving] < DOUBTFUL * largest {
            return Pivot::Doubtful;
        }
        for at in 0..first {
            let c = self.falling[at].1;
            let width = width(rows, skip, self.basis[c]);
            let column = &mut self.inverse[c * d..(c + 1) * d];
            for (z, v) in self.z.iter_mut().zip(column.iter_mut()) {
                *z -= width * *v;
                *v = -*v;
            }
            self.alpha[c] = -self.alpha[c];
            self.y[c] = -self.y[c];
            self.basis[c] = match self.basis[c] {
                Basic::Box(j, side) => Basic::Box(j, -side),
                Basic::Row(k, side) => Basic::Row(k, -side),
            };
        }
        self.exchange(d, leaving, entering, left);
        Pivot::Made
    }

    /// Puts `entering` in the place of the basic row `l`; `violation` is what is left of its violation.
    fn exchange(&mut self, d: usize, l: usize, entering: Basic, violation: f64) {
        let pivot = self.alpha[l];
        // Of a multiplier that was flipped the sign has changed, and with it what may be clipped.
        let step = self.y[l].max(0.0) / pivot;
        for (c, y) in self.y.iter_mut().enumerate() {
            *y -= step * self.alpha[c];
        }
        self.y[l] = step;
        self.basis[l] = entering;
        self.reach = f64::INFINITY;
        let (before, rest) = self.inverse.split_at_mut(l * d);
        let (column, after) = rest.split_at_mut(d);
        for v in column.iter_mut() {
            *v /= pivot;
        }
        for (z, v) in self.z.iter_mut().zip(column.iter()) {
            *z -= violation * v;
        }
        let others = before.chunks_exact_mut(d).zip(&self.alpha[..l]);
        let others = others.chain(after.chunks_exact_mut(d).zip(&self.alpha[l + 1..]));
        for (other, &a) in others {
            if a != 0.0 {
                for (o, v) in other.iter_mut().zip(column.iter()) {
                    *o -= a * v;
                }
            }
        }
    }

    /// B⁻¹, y and z from the basis itself. False when the basis is singular.
    fn refresh(&mut self, rows: &Rows<'_>, w: &[f64]) -> bool {
        let d = rows.width;
        let b = Dense::from_fn(d, d, |c, j| match self.basis[c] {
            Basic::Box(k, side) if k == j => side,
            Basic::Box(..) => 0.0,
            Basic::Row(k, side) => side * rows.row(k)[j],
        });
        let Some(inverse) = linalg::inverse(&b) else {
            return false;
        };
        for (c, column) in self.inverse.chunks_exact_mut(d).enumerate() {
            for (i, v) in column.iter_mut().enumerate() {
                *v = inverse[(i, c)];
            }
        }
        // Bᵀ y = w and B z = b.
        self.since_fresh = 0;
        self.z.iter_mut().for_each(|z| *z = 0.0);
        for (c, column) in self.inverse.chunks_exact(d).enumerate() {
            self.y[c] = dot(column, w);
            let bound = match self.basis[c] {
                Basic::Box(..) => 1.0,
                Basic::Row(k, side) if side > 0.0 => rows.upper[k],
                Basic::Row(k, _) => rows.lower[k],
            };
            for (z, v) in self.z.iter_mut().zip(column) {
                *z += bound * v;
            }
        }
        true
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
