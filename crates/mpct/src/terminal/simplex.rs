//! The dual simplex method for the linear programs of the terminal set.
//!
//! maximise w·z  subject to  −l_k ≤ r_k·z ≤ u_k  (k = 1, …, rows)  and  |z_j| ≤ 1,   with 0 < l_k, u_k.
//!
//! The family is special, and the method follows from it: the origin is always feasible, the box gives a vertex
//! whose multipliers are non-negative at once, and only the question "is the optimum above 1?" matters. Every
//! iterate carries multipliers y ≥ 0 with Σ y_k r_k = w, so Σ y_k b_k is an upper bound of the optimum *before* the
//! method has ended, and most questions end early.
//!
//! Source: dual simplex with an explicit inverse, Bertsimas and Tsitsiklis, "Introduction to Linear Optimization",
//! section 4.5; bounded rows as in Maros, "Computational Techniques of the Simplex Method", chapter 10.

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
    /// 1/‖r_k‖₂, to compare violations.
    pub(super) inverse_norms: &'a [f64],
}

impl Rows<'_> {
    pub(super) fn row(&self, k: usize) -> &[f64] {
        &self.coefficients[k * self.width..(k + 1) * self.width]
    }
}

/// How the method ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    /// z is feasible and optimal.
    Optimal,
    /// The upper bound fell to the threshold; z need not be feasible.
    Below,
    /// Neither, within the pivots allowed.
    PivotLimit,
}

/// The last iterate.
pub(super) struct Solution {
    pub(super) ending: Ending,
    /// The vertex.
    pub(super) z: Vec<f64>,
    /// (row, true for its upper side, multiplier > 0).
    pub(super) multipliers: Vec<(usize, bool, f64)>,
    /// Σ y b, box included: an upper bound of the optimum.
    pub(super) bound: f64,
}

/// A row violated by less than this, relative to its norm, counts as satisfied. The answers are checked against
/// their own bound afterwards, so this only has to stop the method from chasing rounding.
const FEASIBILITY: f64 = 1e-11;
/// Pivots smaller than this, relative to the largest candidate, spoil the inverse.
const PIVOT: f64 = 1e-9;
/// Ties of the ratio test within this are broken by the larger pivot.
const TIE: f64 = 1e-12;

/// Pivots after which the inverse is computed afresh.
const REFACTOR: usize = 100;
/// Times the method goes on after a look with a fresh inverse.
const ROUNDS: usize = 4;

#[derive(Clone, Copy, PartialEq)]
enum Basic {
    /// Box of variable j; +1 or −1.
    Box(usize, f64),
    /// Row k; +1 at its upper, −1 at its lower side.
    Row(usize, f64),
}

/// Scratch memory and method; one per thread.
#[derive(Default)]
pub(super) struct DualSimplex {
    /// Columns of B⁻¹, one after the other.
    inverse: Vec<f64>,
    basis: Vec<Basic>,
    y: Vec<f64>,
    z: Vec<f64>,
    alpha: Vec<f64>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four partial sums let the compiler vectorise without reordering one sum.
    let mut s = [0.0; 4];
    let (ca, cb) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = ca
        .remainder()
        .iter()
        .zip(cb.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in ca.zip(cb) {
        for i in 0..4 {
            s[i] += x[i] * y[i];
        }
    }
    (s[0] + s[1]) + (s[2] + s[3]) + tail
}

impl DualSimplex {
    /// Runs until the optimum is found or proved to be at most `threshold`. `skip` is a row left out.
    pub(super) fn maximise(
        &mut self,
        w: &[f64],
        rows: &Rows<'_>,
        threshold: f64,
        skip: Option<(usize, bool)>,
    ) -> Solution {
        let d = rows.width;
        self.start_at_box(w);
        let limit = 200 + 20 * d;
        let (mut pivots, mut since, mut rounds) = (0, 0, 0);
        let ending = loop {
            // Rank-one updates wear the inverse out: it is computed afresh now and then, and before an end is believed.
            if since >= REFACTOR && !self.refactor(w, rows) {
                break Ending::PivotLimit;
            }
            if since >= REFACTOR {
                since = 0;
            }
            let bound = self.bound(rows);
            if bound <= threshold && (since == 0 || rounds > 0) {
                break Ending::Below;
            }
            let entering = if bound <= threshold {
                None
            } else {
                self.most_violated(rows, skip)
            };
            let moved = match entering {
                Some((entering, side)) if pivots < limit * (rounds + 1) => {
                    self.pivot(rows, entering, side)
                }
                _ => false,
            };
            if moved {
                pivots += 1;
                since += 1;
                continue;
            }
            // Stuck or done. Believe it when the inverse is fresh; otherwise look again.
            if since > 0 && rounds < ROUNDS && self.refactor(w, rows) {
                since = 0;
                rounds += 1;
                continue;
            }
            break if entering.is_none() {
                Ending::Optimal
            } else {
                Ending::PivotLimit
            };
        };
        Solution {
            ending,
            z: self.z.clone(),
            multipliers: self
                .basis
                .iter()
                .zip(&self.y)
                .filter_map(|(b, &y)| match *b {
                    Basic::Row(k, side) if y > 0.0 => Some((k, side > 0.0, y)),
                    _ => None,
                })
                .collect(),
            bound: self.bound(rows),
        }
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
        for (j, &wj) in w.iter().enumerate() {
            let side = if wj < 0.0 { -1.0 } else { 1.0 };
            self.inverse[j * d + j] = side;
            self.basis.push(Basic::Box(j, side));
            self.y.push(wj.abs());
            self.z.push(side);
        }
    }

    /// The inverse, the vertex and the multipliers of the basis from the rows; false when the basis is singular. A
    /// multiplier that turns out negative ends the method's guarantee of descent but not that of its bounds, which the
    /// caller takes from the rows.
    fn refactor(&mut self, w: &[f64], rows: &Rows<'_>) -> bool {
        let d = rows.width;
        // B side by side with the identity, rows of 2 d, eliminated to the identity side by side with B⁻¹.
        let mut table = vec![0.0; 2 * d * d];
        for (i, line) in table.chunks_exact_mut(2 * d).enumerate() {
            match self.basis[i] {
                Basic::Box(j, side) => line[j] = side,
                Basic::Row(k, side) => line[..d]
                    .iter_mut()
                    .zip(rows.row(k))
                    .for_each(|(l, v)| *l = side * v),
            }
            line[d + i] = 1.0;
        }
        for c in 0..d {
            let Some(p) = (c..d).max_by(|&a, &b| {
                table[a * 2 * d + c]
                    .abs()
                    .total_cmp(&table[b * 2 * d + c].abs())
            }) else {
                return false;
            };
            if !(table[p * 2 * d + c].abs() > f64::MIN_POSITIVE) {
                return false;
            }
            for t in 0..2 * d {
                table.swap(c * 2 * d + t, p * 2 * d + t);
            }
            let pivot = table[c * 2 * d + c];
            table[c * 2 * d..(c + 1) * 2 * d]
                .iter_mut()
                .for_each(|v| *v /= pivot);
            let (head, rest) = table.split_at_mut(c * 2 * d);
            let (line, tail) = rest.split_at_mut(2 * d);
            for other in head
                .chunks_exact_mut(2 * d)
                .chain(tail.chunks_exact_mut(2 * d))
            {
                let factor = other[c];
                if factor != 0.0 {
                    other
                        .iter_mut()
                        .zip(line.iter())
                        .for_each(|(o, v)| *o -= factor * v);
                }
            }
        }
        for i in 0..d {
            for c in 0..d {
                self.inverse[c * d + i] = table[i * 2 * d + d + c];
            }
        }
        self.z.fill(0.0);
        for (c, column) in self.inverse.chunks_exact(d).enumerate() {
            self.y[c] = dot(column, w).max(0.0);
            let bound = match self.basis[c] {
                Basic::Box(..) => 1.0,
                Basic::Row(k, side) => {
                    if side > 0.0 {
                        rows.upper[k]
                    } else {
                        rows.lower[k]
                    }
                }
            };
            self.z
                .iter_mut()
                .zip(column)
                .for_each(|(z, v)| *z += bound * v);
        }
        true
    }

    fn bound(&self, rows: &Rows<'_>) -> f64 {
        self.basis
            .iter()
            .zip(&self.y)
            .map(|(b, &y)| match *b {
                Basic::Box(..) => y,
                Basic::Row(k, side) => {
                    y * if side > 0.0 {
                        rows.upper[k]
                    } else {
                        rows.lower[k]
                    }
                }
            })
            .sum()
    }

    /// The row, or side of the box, that z violates most relative to its norm.
    fn most_violated(&self, rows: &Rows<'_>, skip: Option<(usize, bool)>) -> Option<(Basic, f64)> {
        let mut worst = FEASIBILITY;
        let mut found = None;
        for (k, row) in rows.coefficients.chunks_exact(rows.width).enumerate() {
            let value = dot(row, &self.z);
            let above = (value - rows.upper[k]) * rows.inverse_norms[k];
            let below = (-value - rows.lower[k]) * rows.inverse_norms[k];
            if above > worst && skip != Some((k, true)) {
                worst = above;
                found = Some((Basic::Row(k, 1.0), value - rows.upper[k]));
            }
            if below > worst && skip != Some((k, false)) {
                worst = below;
                found = Some((Basic::Row(k, -1.0), -value - rows.lower[k]));
            }
        }
        for (j, &zj) in self.z.iter().enumerate() {
            if zj.abs() - 1.0 > worst {
                worst = zj.abs() - 1.0;
                found = Some((Basic::Box(j, zj.signum()), worst));
            }
        }
        found
    }

    /// Exchanges the entering row for the one whose multiplier reaches zero first. False when no row can leave,
    /// which exact arithmetic excludes: the origin is feasible.
    fn pivot(&mut self, rows: &Rows<'_>, entering: Basic, violation: f64) -> bool {
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
        let mut leaving = None;
        let mut step = f64::INFINITY;
        for (c, &a) in self.alpha.iter().enumerate() {
            if a > PIVOT * largest {
                let ratio = self.y[c] / a;
                let better = match leaving {
                    None => true,
                    Some(l) => ratio < step - TIE || (ratio < step + TIE && a > self.alpha[l]),
                };
                if better {
                    step = ratio;
                    leaving = Some(c);
                }
            }
        }
        let Some(l) = leaving else { return false };
        let pivot = self.alpha[l];
        for (c, y) in self.y.iter_mut().enumerate() {
            *y = (*y - step * self.alpha[c]).max(0.0);
        }
        self.y[l] = step.max(0.0);
        self.basis[l] = entering;
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
        true
    }
}
