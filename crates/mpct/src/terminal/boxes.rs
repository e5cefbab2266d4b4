//! A box around the terminal constraints, in which programs start and by which what is left over is bounded.

use super::augmented::Augmented;
use super::proofs::Multipliers;
use super::simplex::{DualSimplex, Rows};
use super::support::RowId;
use crate::clock::Clock;
use crate::error::DesignError;
use crate::linalg::{self, Dense};

/// |z_l| ≤ β_l.
pub(super) struct Boxes {
    pub(super) beta: Vec<f64>,
    /// Whether O_0 lies inside the box in this coordinate. Otherwise only O at later steps does, well inside.
    pub(super) valid: Vec<bool>,
    /// The rows that prove ẑ_l ≤ 1 and −ẑ_l ≤ 1, ẑ_l = z_l / β_l, where step 0 alone does.
    pub(super) proofs: Vec<Option<[Multipliers; 2]>>,
}

/// How far the rows of some steps let a coordinate go, in units of its first guess, and the rows that stop it on both
/// sides.
struct Reach {
    coordinate: usize,
    first_guess: f64,
    reach: f64,
    sides: [Multipliers; 2],
}

/// First guess of a box, in units of the nearest constraint: further out than any bound of a sensible problem.
const FAR: f64 = 1e7;
/// A coordinate that step 0 alone does not bound gets this many times its bound over more steps.
const ROOM: f64 = 1e2;
/// A coordinate that no step bounds on both sides gets this box, in units of the nearest constraint. The larger, the
/// more rounding of a multiplier looks like a multiplier of the box.
const FREE: f64 = 1e3;
/// Steps looked at to bound a coordinate that step 0 does not bound.
const STEPS: usize = 64;
/// Relative size below which a singular value counts as zero.
const RANK_TOLERANCE: f64 = 1e-10;

impl Boxes {
    /// The box of a system; `name` names state i in errors.
    ///
    /// # Errors
    /// [`DesignError::Unbounded`] when a direction is neither bounded nor observed by the constraints.
    pub(super) fn of(system: &mut Augmented, clock: &Clock) -> Result<Self, DesignError> {
        let d = system.dimension();
        let mut boxes = Self {
            beta: vec![f64::INFINITY; d],
            valid: vec![true; d],
            proofs: vec![None; d],
        };
        boxes.read_off(system);
        if boxes.beta.iter().all(|b| b.is_finite()) {
            return Ok(boxes);
        }
        check_equilibria(system)?;
        let open = boxes.open();
        if open.iter().any(|&l| l < system.states) {
            check_states(system)?;
        }
        boxes.close(system, &open, 0, clock);
        let open = boxes.open();
        if !open.is_empty() {
            // One-sided constraints. Programs that end at this box only ever prove that a row is not spent.
            let last = STEPS.min(system.states);
            system.extend_to(last);
            for found in boxes.reaches(system, &open, last, clock) {
                let width = if found.is_bounded() {
                    found.reach * ROOM
                } else {
                    FREE / FAR
                };
                boxes.beta[found.coordinate] = found.first_guess * width;
                boxes.valid[found.coordinate] = false;
            }
        }
        Ok(boxes)
    }

    /// A box that holds the set of a few steps, with its proofs, and these steps: 0, 1, 2, 4, … up to `most`, until every
    /// coordinate is bounded. Coordinates that stay unbounded have an infinite β. What the rows of step 0 bound is read
    /// off there.
    pub(super) fn of_steps(system: &mut Augmented, most: usize, clock: &Clock) -> (Self, usize) {
        let d = system.dimension();
        let mut boxes = Self {
            beta: vec![f64::INFINITY; d],
            valid: vec![true; d],
            proofs: vec![None; d],
        };
        boxes.read_off(system);
        let (mut steps, mut last) = (0, 0);
        loop {
            let open = boxes.open();
            boxes.close(system, &open, last, clock);
            let left = boxes.open().len();
            if left < open.len() {
                steps = last;
            }
            if left == 0 || last >= most {
                return (boxes, steps);
            }
            last = (2 * last).max(1).min(most);
            system.extend_to(last);
        }
    }

    /// Takes over the coordinates for which `proved` has a box.
    pub(super) fn narrow_to(&mut self, proved: Self) {
        for (l, proof) in proved.proofs.into_iter().enumerate() {
            if proof.is_some() {
                self.beta[l] = proved.beta[l];
                self.valid[l] = true;
                self.proofs[l] = proof;
            }
        }
    }

    /// Coordinates without a box.
    fn open(&self) -> Vec<usize> {
        (0..self.beta.len())
            .filter(|&l| self.beta[l].is_infinite())
            .collect()
    }

    /// Gives the coordinates that the rows of steps 0, …, `last` bound their box and its proof.
    fn close(&mut self, system: &Augmented, open: &[usize], last: usize, clock: &Clock) {
        for mut found in self.reaches(system, open, last, clock) {
            if found.is_bounded() {
                let l = found.coordinate;
                // A little wider than computed, so that rounding does not cut the set.
                self.beta[l] = found.reach * found.first_guess * (1.0 + 1e-6);
                for m in found.sides.iter_mut().flatten() {
                    m.2 *= found.first_guess / self.beta[l];
                }
                self.proofs[l] = Some(found.sides);
            }
        }
    }

    /// The box of the same system with any one row relaxed to twice its bound: what a row may reach when it is left out
    /// to see whether the others imply it. If a point of the others breaks the row at all, the segment to the origin has
    /// one that breaks it by less than a factor of two.
    pub(super) fn doubled(&self) -> Self {
        Self {
            beta: self.beta.iter().map(|b| 2.0 * b).collect(),
            valid: self.valid.clone(),
            proofs: vec![None; self.beta.len()],
        }
    }

    /// Bounds that stand in the problem: a row with one entry in e, or in θ.
    fn read_off(&mut self, system: &Augmented) {
        let n = system.states;
        for (k, pair) in system.pairs.iter().enumerate() {
            let lower = pair.lower_bound();
            if lower.is_infinite() {
                continue;
            }
            if let [(j, v)] = system.static_row(k)[..] {
                let beta = lower.max(1.0) / v.abs();
                if beta < self.beta[j] {
                    let y = 1.0 / (v.abs() * beta);
                    let side = |upper: bool| vec![(RowId::Static(k), upper == (v > 0.0), y)];
                    self.beta[j] = beta;
                    self.proofs[j] = Some([side(true), side(false)]);
                }
            }
            let row = system.moving_row(k, 0);
            let equilibrium = row.iter().any(|e| e.0 >= n);
            if let [(j, v)] = row.iter().filter(|e| e.0 < n).copied().collect::<Vec<_>>()[..] {
                // c e = (c e + w θ) − w θ, and −λ l ≤ w θ ≤ λ.
                let width = if equilibrium {
                    (1.0 + system.scaling * lower).max(lower + system.scaling)
                } else {
                    lower.max(1.0)
                };
                let beta = width / v.abs();
                if beta < self.beta[j] {
                    let y = 1.0 / (v.abs() * beta);
                    let side = |upper: bool| {
                        let above = upper == (v > 0.0);
                        let mut rows = vec![(RowId::Moving(k, 0), above, y)];
                        if equilibrium {
                            rows.push((RowId::Static(k), !above, y * system.scaling));
                        }
                        rows
                    };
                    self.beta[j] = beta;
                    self.proofs[j] = Some([side(true), side(false)]);
                }
            }
        }
    }

    /// Two linear programs a coordinate over the rows of steps 0, …, `last`.
    fn reaches(
        &self,
        system: &Augmented,
        open: &[usize],
        last: usize,
        clock: &Clock,
    ) -> Vec<Reach> {
        let d = system.dimension();
        let mut rows = Vec::new();
        let mut ids = Vec::new();
        let mut lower = Vec::new();
        for k in 0..system.pairs.len() {
            let fixed = std::iter::once((RowId::Static(k), system.static_row(k)));
            let moving = (0..=last).map(|s| (RowId::Moving(k, s), system.moving_row(k, s)));
            for (id, row) in fixed.chain(moving) {
                if !row.is_empty() {
                    rows.push(row);
                    ids.push(id);
                    lower.push(system.pairs[k].lower_bound());
                }
            }
        }
        // Scale of a coordinate: where a row alone would stop it.
        let mut scale = vec![0.0_f64; d];
        for &(j, v) in rows.iter().flatten() {
            scale[j] = scale[j].max(v.abs());
        }
        let far: Vec<f64> = (0..d)
            .map(|l| {
                if self.beta[l].is_finite() {
                    self.beta[l]
                } else {
                    FAR / scale[l].max(1e-300)
                }
            })
            .collect();
        let mut dense = vec![0.0; rows.len() * d];
        let mut norms = Vec::with_capacity(rows.len());
        for (row, out) in rows.iter().zip(dense.chunks_exact_mut(d)) {
            for &(j, v) in row {
                out[j] = v * far[j];
            }
            norms.push(out.iter().map(|v| v * v).sum::<f64>().sqrt().recip());
        }
        let upper = vec![1.0; rows.len()];
        let rows = Rows {
            width: d,
            coefficients: &dense,
            upper: &upper,
            lower: &lower,
            inverse_norms: &norms,
        };
        let mut simplex = DualSimplex::default();
        let mut found = Vec::new();
        for &l in open {
            let mut reach = 0.0_f64;
            let mut sides = [Vec::new(), Vec::new()];
            for (sign, side) in [1.0, -1.0].into_iter().zip(&mut sides) {
                let mut w = vec![0.0; d];
                w[l] = sign;
                simplex.maximise(&w, &rows, [0.0, f64::INFINITY], None, clock);
                reach = reach.max(simplex.bound(&rows));
                *side = simplex
                    .multipliers()
                    .map(|(k, s, y)| (ids[k], s, y))
                    .collect();
            }
            found.push(Reach {
                coordinate: l,
                first_guess: far[l],
                reach,
                sides,
            });
        }
        found
    }
}

impl Reach {
    /// Whether rows stop the coordinate, and not the first guess.
    fn is_bounded(&self) -> bool {
        self.reach < 0.5
    }
}

/// Θ is bounded only when no equilibrium direction is free of constraints.
fn check_equilibria(system: &Augmented) -> Result<(), DesignError> {
    if system.parameters == 0 {
        return Ok(());
    }
    let w = theta_columns(system);
    match null_direction(&w)? {
        None => Ok(()),
        Some(direction) => Err(DesignError::Unbounded {
            direction: format!("the equilibria along {}", named(&direction, "theta")),
        }),
    }
}

/// w of every pair, pairs × parameters.
fn theta_columns(system: &Augmented) -> Dense {
    let mut w = Dense::zeros(system.pairs.len(), system.parameters);
    for (i, j, v) in system.equilibrium().entries() {
        w[(i, j - system.states)] = v;
    }
    w
}

/// (C + D K, A + B K) must be observable.
fn check_states(system: &mut Augmented) -> Result<(), DesignError> {
    let n = system.states;
    // Observability is decided by n steps; the rank is taken of the columns scaled to equal size.
    let steps = n.min(STEPS);
    system.extend_to(steps);
    let q = system.pairs.len();
    let mut stacked = Dense::zeros((q * steps).max(1), n);
    for s in 0..steps {
        for k in 0..q {
            for (j, v) in system.moving_row(k, s) {
                if j < n {
                    stacked[(s * q + k, j)] = v;
                }
            }
        }
    }
    match null_direction(&stacked)? {
        None => Ok(()),
        Some(direction) => Err(DesignError::Unbounded {
            direction: format!("the direction {} of the state", named(&direction, "x")),
        }),
    }
}

/// A direction that a matrix maps to (nearly) nothing, if there is one.
fn null_direction(m: &Dense) -> Result<Option<Vec<f64>>, DesignError> {
    let d = m.ncols();
    let mut scaled = m.clone();
    let mut unit = vec![1.0; d];
    for j in 0..d {
        let norm = (0..m.nrows())
            .map(|i| m[(i, j)].powi(2))
            .sum::<f64>()
            .sqrt();
        if !(norm > 0.0) {
            let mut direction = vec![0.0; d];
            direction[j] = 1.0;
            return Ok(Some(direction));
        }
        unit[j] = norm;
        for i in 0..m.nrows() {
            scaled[(i, j)] /= norm;
        }
    }
    // Fewer rows than columns always leave a direction free; pad so that every column has its singular value.
    if scaled.nrows() < d {
        scaled = Dense::from_fn(
            d,
            d,
            |i, j| if i < m.nrows() { scaled[(i, j)] } else { 0.0 },
        );
    }
    let (_, s, v) = linalg::svd("observability of the constraints", &scaled)?;
    let (largest, smallest) = (s[0], s[d - 1]);
    Ok((!(smallest > RANK_TOLERANCE * largest))
        .then(|| (0..d).map(|j| v[(j, d - 1)] / unit[j]).collect()))
}

/// The largest parts of a direction, in words.
fn named(direction: &[f64], symbol: &str) -> String {
    let largest = direction.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    let mut parts: Vec<(usize, f64)> = direction
        .iter()
        .map(|v| v / largest)
        .enumerate()
        .filter(|e| e.1.abs() > 1e-3)
        .collect();
    parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let more = parts.len().saturating_sub(4);
    let mut text = parts
        .iter()
        .take(4)
        .map(|&(j, v)| format!("{v:+.3} {symbol}[{j}]"))
        .collect::<Vec<_>>()
        .join(" ");
    if more > 0 {
        text.push_str(&format!(" and {more} more"));
    }
    text
}
