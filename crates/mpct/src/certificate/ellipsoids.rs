//! Ellipsoids in the checker: as premises, with multipliers w, and as what is to be shown.
//!
//! As a premise, ‖v‖ ≤ 1 gives wᵀv ≤ ‖w‖ for any w. To be shown is ‖v‖ ≤ 1 for v = components + h at some step, from upper
//! bounds of d·v in directions d of whole numbers. If d = Σ α_k d_k with α ≥ 0, then d·v ≤ Σ α_k b_k = a·d where D a = b; so on a
//! wedge of directions ‖v‖, reached for d = v/‖v‖, is at most ‖a‖. The wedges start as the orthants and are cut along
//! the sum of two of their directions, which covers them exactly. With `split`, the e part alone is bounded by the box of its
//! supports along the axes, and ‖Wθ + h‖ ≤ λ + (1 − λ)‖h‖ by θ ∈ λΘ.

use super::document::{ConeMultiplier, Document, EllipsoidProof};
use super::implied::{Known, implied};
use super::interval::{Accumulator, Interval, add_up, mul_up};
use super::statement::TOLERANCE;
use super::verify::{Checker, Spent, VerifyError};
use rayon::prelude::*;
use std::collections::HashMap;

/// Directions with larger entries are refused, so that nothing overflows.
const LARGEST: i64 = 1 << 20;
/// Orthants are walked up to this dimension; beyond, the box must do.
const WALKED: usize = 8;
/// Wedges looked at before a proof is refused as too long.
const WEDGES: usize = 2_000_000;

/// Subtracts wᵀv of an ellipsoid from a linear form; returns what that adds to the bound, and to the slack.
pub(super) fn subtract(
    known: &Known<'_>,
    sum: &mut Accumulator,
    room: Interval,
    (k, step, w): &ConeMultiplier,
) -> Result<(f64, f64), VerifyError> {
    let Known {
        system,
        along,
        beta,
        last,
    } = *known;
    let norm = system
        .norms
        .get(*k)
        .ok_or_else(|| VerifyError::refused("a multiplier names no ellipsoid"))?;
    if w.len() != norm.components.len()
        || w.iter().any(|w| !w.is_finite())
        || step.is_some_and(|s| s > last)
    {
        return Err(VerifyError::refused(
            "a multiplier does not fit its ellipsoid, or names a step that comes too late",
        ));
    }
    let (mut slack, mut size) = (0.0, 0.0);
    let mut shift = Interval::ZERO;
    for (j, component) in norm.components.iter().enumerate() {
        // Any w will do; this one makes the sum close.
        let w = w[j] * room.hi;
        component
            .equilibrium(beta)
            .for_each(|(l, v)| sum.add(l, v.times(-w)));
        let error = match step {
            None => component.static_slack(beta),
            Some(s) => {
                let at = &along.norms[*k][j][*s];
                for &(l, v) in &at.e {
                    sum.add(l, Interval::exact(v).times(-w));
                }
                at.slack
            }
        };
        slack = add_up(slack, mul_up(w.abs(), error));
        size = add_up(size, mul_up(w.abs(), w.abs()));
        shift = shift.add(norm.offset[j].times(-w));
    }
    let scale = if step.is_some() { 1.0 } else { system.scaling };
    let bound = Interval::exact(size.sqrt().next_up())
        .add(shift)
        .times(scale);
    if bound.hi.is_finite() && slack.is_finite() {
        Ok((bound.hi, slack))
    } else {
        Err(VerifyError::refused(
            "a multiplier of an ellipsoid is too large",
        ))
    }
}

/// Every ellipsoid is spent at some step ≤ M̃ + 1.
pub(super) fn spent(checker: &Checker, document: &Document) -> Result<Spent, VerifyError> {
    let claimed = &document.claim.ellipsoids;
    let mut missing = vec![true; claimed.len()];
    for p in &document.proof.ellipsoids {
        match missing.get_mut(p.ellipsoid) {
            Some(missing) if *missing => *missing = false,
            _ => {
                return Err(VerifyError::refused(
                    "a proof is about no ellipsoid, or there twice",
                ));
            }
        }
    }
    if let Some(k) = missing.iter().position(|m| *m) {
        return Err(VerifyError::refused(format!(
            "{} has no proof",
            claimed[k].name
        )));
    }
    let mut found = Spent::nothing();
    for p in &document.proof.ellipsoids {
        let name = &claimed[p.ellipsoid].name;
        if p.step == 0 || p.step > document.claim.terminal_horizon.saturating_add(1) {
            return Err(VerifyError::refused(format!(
                "{name} is spent at step {}",
                p.step
            )));
        }
        let largest = largest_norm(checker, p)?;
        if !(largest <= 1.0 + TOLERANCE) {
            return Err(VerifyError::refused(format!(
                "{name} is not implied at step {}: its norm is proved to be at most {largest:.9}",
                p.step
            )));
        }
        found.add(largest, name);
    }
    Ok(found)
}

/// An upper bound of ‖v‖ at the step of the proof.
fn largest_norm(checker: &Checker, p: &EllipsoidProof) -> Result<f64, VerifyError> {
    let system = &checker.system;
    let norm = &system.norms[p.ellipsoid];
    let q = norm.components.len();
    let fits = |d: &[i64]| d.len() == q && d.iter().all(|v| v.abs() <= LARGEST);
    if !p.supports.iter().all(|s| fits(&s.direction)) {
        return Err(VerifyError::refused(
            "a direction does not fit its ellipsoid",
        ));
    }
    let bounds: Vec<Result<f64, VerifyError>> = p
        .supports
        .par_iter()
        .map_init(
            || Accumulator::new(system.dimension()),
            |sum, support| {
                let mut own = Accumulator::new(system.dimension());
                let mut slack = 0.0;
                let mut shift = Interval::ZERO;
                for (j, component) in norm.components.iter().enumerate() {
                    let d = support.direction[j] as f64;
                    let at = &checker.along.norms[p.ellipsoid][j][p.step];
                    at.e.iter()
                        .for_each(|&(l, v)| own.add(l, Interval::exact(v).times(d)));
                    if !p.split {
                        component
                            .equilibrium(&checker.beta)
                            .for_each(|(l, v)| own.add(l, v.times(d)));
                        shift = shift.add(norm.offset[j].times(d));
                    }
                    slack = add_up(slack, mul_up(d.abs(), at.slack));
                }
                let known = Known {
                    system,
                    along: &checker.along,
                    beta: &checker.beta,
                    last: p.step - 1,
                };
                let implied = implied(
                    &known,
                    sum,
                    &own.take(),
                    Interval::exact(1.0),
                    &support.multipliers,
                    &support.cones,
                )?;
                Ok(add_up(
                    add_up(implied.bound(&checker.beta), slack),
                    shift.hi,
                ))
            },
        )
        .collect();
    let mut known: HashMap<&[i64], f64> = HashMap::with_capacity(bounds.len());
    for (support, bound) in p.supports.iter().zip(bounds) {
        known.insert(&support.direction, bound?);
    }
    let in_box = corner(q, &known)?;
    if p.split {
        let h = size(&norm.offset);
        // λ + (1 − λ)‖h‖ for tracking, ‖h‖ for regulation.
        let taken = if system.parameters > 0 {
            system.scaling
        } else {
            0.0
        };
        let rest = mul_up((1.0 - taken).next_up(), h);
        return Ok(add_up(in_box, add_up(taken, rest)));
    }
    if in_box <= 1.0 || q > WALKED {
        return Ok(in_box);
    }
    walk(q, &known)
}

/// ‖v‖ for intervals, from above.
fn size(v: &[Interval]) -> f64 {
    let square = |a: f64, v: &Interval| add_up(a, mul_up(v.magnitude(), v.magnitude()));
    v.iter().fold(0.0, square).sqrt().next_up()
}

/// √Σ max(b(e_k), b(−e_k), 0)².
fn corner(q: usize, known: &HashMap<&[i64], f64>) -> Result<f64, VerifyError> {
    let mut sum = 0.0;
    for k in 0..q {
        let mut side = 0.0_f64;
        for sign in [1, -1] {
            let mut axis = vec![0; q];
            axis[k] = sign;
            match known.get(axis.as_slice()) {
                Some(b) if !b.is_nan() => side = side.max(*b),
                _ => return Err(VerifyError::refused("a support along an axis is missing")),
            }
        }
        sum = add_up(sum, mul_up(side, side));
    }
    Ok(sum.sqrt().next_up())
}

/// Directions, and the inverse of the matrix whose rows they are.
struct Wedge {
    directions: Vec<Vec<i64>>,
    inverse: Vec<Vec<i64>>,
}

impl Wedge {
    /// ‖D⁻¹ b‖ from above.
    fn bound(&self, known: &HashMap<&[i64], f64>) -> Option<f64> {
        let b = self
            .directions
            .iter()
            .map(|d| known.get(d.as_slice()).copied())
            .collect::<Option<Vec<f64>>>()?;
        let a: Vec<Interval> = self
            .inverse
            .iter()
            .map(|row| {
                let terms = row.iter().zip(&b);
                terms.fold(Interval::ZERO, |s, (i, b)| {
                    s.add(Interval::exact(*b).times(*i as f64))
                })
            })
            .collect();
        Some(size(&a))
    }

    /// The parts on both sides of the sum of directions i and j.
    fn cut(&self, i: usize, j: usize, sum: &[i64]) -> Option<[Self; 2]> {
        // With d_b replaced by d_a + d_b, column a of the inverse loses column b.
        let part = |a: usize, b: usize| -> Option<Self> {
            let mut directions = self.directions.clone();
            directions[b] = sum.to_vec();
            let mut inverse = self.inverse.clone();
            for row in &mut inverse {
                row[a] = row[a].checked_sub(row[b]).filter(|v| v.abs() <= LARGEST)?;
            }
            Some(Self {
                directions,
                inverse,
            })
        };
        Some([part(i, j)?, part(j, i)?])
    }

    /// The two directions with the widest angle whose sum is known, and the sum.
    fn widest_cut(&self, known: &HashMap<&[i64], f64>) -> Option<(usize, usize, Vec<i64>)> {
        let dot =
            |a: &[i64], b: &[i64]| -> f64 { a.iter().zip(b).map(|(x, y)| (*x * *y) as f64).sum() };
        let (mut widest, mut cut) = (f64::INFINITY, None);
        for i in 0..self.directions.len() {
            for j in i + 1..self.directions.len() {
                let (a, b) = (&self.directions[i], &self.directions[j]);
                let sum: Vec<i64> = a.iter().zip(b).map(|(x, y)| x + y).collect();
                let cosine = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt();
                if cosine < widest && known.contains_key(sum.as_slice()) {
                    widest = cosine;
                    cut = Some((i, j, sum));
                }
            }
        }
        cut
    }
}

/// The largest bound over a fan of wedges that covers all directions, each cut as long as it exceeds 1.
fn walk(q: usize, known: &HashMap<&[i64], f64>) -> Result<f64, VerifyError> {
    let mut open: Vec<Wedge> = (0..1_usize << q)
        .map(|signs| {
            let axis = |k: usize| -> Vec<i64> {
                let sign = if signs >> k & 1 == 1 { -1 } else { 1 };
                (0..q).map(|i| if i == k { sign } else { 0 }).collect()
            };
            let directions: Vec<Vec<i64>> = (0..q).map(axis).collect();
            // A diagonal of signs is its own inverse.
            Wedge {
                inverse: directions.clone(),
                directions,
            }
        })
        .collect();
    let (mut largest, mut count) = (0.0_f64, 0);
    while let Some(wedge) = open.pop() {
        count += 1;
        let bound = wedge
            .bound(known)
            .filter(|b| !b.is_nan() && count <= WEDGES)
            .ok_or_else(|| VerifyError::refused("a fan of directions is not complete"))?;
        let cut = (bound > 1.0).then(|| wedge.widest_cut(known)).flatten();
        match cut.and_then(|(i, j, sum)| wedge.cut(i, j, &sum)) {
            Some(parts) => open.extend(parts),
            None => largest = largest.max(bound),
        }
    }
    Ok(largest)
}
