//! Convex bodies {v : G v ≤ h, ‖F_k v + f_k‖ ≤ ρ_k} with a known interior point, and their support functions.
//!
//! A support query max cᵀv is a linear program when there is no ball and a second-order cone program when there is one.
//! The answer is an interval, both ends of which are checked here from the data alone: the lower end is the value at
//! a point that was drawn towards the interior point until it satisfies every row; the upper end comes from
//! multipliers y ≥ 0 and w_k, by weak duality:
//!   cᵀv = yᵀG v + Σ w_kᵀF_k v + leakᵀv ≤ yᵀh + Σ (‖w_k‖ ρ_k − w_kᵀf_k) + ‖leak‖∞ ‖v‖₁.

use crate::linalg::{self, Dense};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus,
    SupportedConeT,
};

/// Tolerance asked of the interior-point method. What it delivers is measured afterwards.
const SOLVER_TOLERANCE: f64 = 1e-10;
/// The upper end is proved for all v whose 1-norm is below this many times that of the answer (and of 1). It only has
/// to be larger than the body; rounding of the multipliers is multiplied by it.
const LEAK_RADIUS: f64 = 1e3;
/// Rounds of refinement that make the multipliers stationary; each gains several digits.
const REFINEMENTS: usize = 4;
/// Regularisation of the refinement, relative to the trace; removed by the rounds.
const REFINEMENT_SHIFT: f64 = 1e-13;
/// Rows of a point that was drawn inside may still be exceeded by this rounding (right-hand sides are about 1).
const ROUNDING: f64 = 1e-13;

/// ‖F v + f‖ ≤ ρ.
#[derive(Clone, Debug)]
pub(crate) struct Ball {
    pub(crate) map: Dense,
    pub(crate) offset: Vec<f64>,
    pub(crate) radius: f64,
}

impl Ball {
    fn norm_at(&self, v: &[f64]) -> f64 {
        let mut at = self.offset.clone();
        add_product(&mut at, &self.map, v, 1.0);
        norm(&at)
    }
}

/// G v ≤ h and balls.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    pub(crate) rows: Dense,
    pub(crate) bounds: Vec<f64>,
    pub(crate) balls: Vec<Ball>,
}

/// An answer to max cᵀv, checked: lower ≤ max ≤ upper.
#[derive(Clone, Debug)]
pub(crate) struct SupportValue {
    /// A point of the body.
    pub(crate) point: Vec<f64>,
    /// cᵀ point.
    pub(crate) lower: f64,
    pub(crate) upper: f64,
    /// The multipliers behind `upper`: y ≥ 0 of the rows, w_k of the balls.
    pub(crate) multipliers: Multipliers,
}

/// Multipliers of a body: y ≥ 0 of its rows, w_k of its balls.
#[derive(Clone, Debug, Default)]
pub(crate) struct Multipliers {
    pub(crate) rows: Vec<f64>,
    pub(crate) balls: Vec<Vec<f64>>,
}

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum BodyFailure {
    /// The objective grows without bound.
    Unbounded,
    /// The solver's answer is of no use.
    Unsolved(String),
}

/// The point that is deepest inside, in the sense of max t with G v + t ≤ h, ‖F_k v + f_k‖ + t ≤ ρ_k, t ≤ 1, and what proves
/// that no other is deeper.
#[derive(Clone, Debug)]
pub(crate) struct Deepest {
    pub(crate) point: Vec<f64>,
    /// The least of h − G v and ρ_k − ‖F_k v + f_k‖ at the point, at most 1.
    pub(crate) depth: f64,
    /// Multipliers y ≥ 0 of the rows: without balls, Σ y ≤ 1, and G v ≤ h contradicts itself when hᵀy < 0 and Gᵀy = 0.
    pub(crate) multipliers: Vec<f64>,
    /// Multipliers w_k of the balls.
    pub(crate) balls: Vec<Vec<f64>>,
}

impl Body {
    pub(crate) fn variables(&self) -> usize {
        self.rows.ncols()
    }

    /// Largest violation of a row or ball; negative when v is strictly inside.
    pub(crate) fn violation(&self, v: &[f64]) -> f64 {
        let mut slack = self.bounds.clone();
        add_product(&mut slack, &self.rows, v, -1.0);
        let rows = slack.iter().fold(f64::NEG_INFINITY, |a, s| {
            if s.is_nan() { f64::INFINITY } else { a.max(-s) }
        });
        self.balls
            .iter()
            .map(|b| b.norm_at(v) - b.radius)
            .fold(rows, f64::max)
    }

    /// max cᵀv, with both ends checked. `inside` is a point strictly inside.
    pub(crate) fn support(&self, c: &[f64], inside: &[f64]) -> Result<SupportValue, BodyFailure> {
        let (v, y, w) = self.solve(c, None)?;
        let point = self.drawn_inside(&v, inside)?;
        let lower = dot(c, &point);
        let (upper, multipliers) = self.upper_end(c, &v, y, w);
        if !(lower.is_finite() && upper.is_finite()) {
            return Err(BodyFailure::Unsolved(format!(
                "the support lies between {lower} and {upper}"
            )));
        }
        Ok(SupportValue {
            point,
            lower,
            upper: upper.max(lower),
            multipliers,
        })
    }

    /// The deepest point.
    pub(crate) fn deepest(&self) -> Result<Deepest, BodyFailure> {
        let (p, nv) = (self.rows.nrows(), self.variables());
        let rows = Dense::from_fn(p + 1, nv + 1, |i, j| {
            if j == nv {
                1.0
            } else if i == p {
                0.0
            } else {
                self.rows[(i, j)]
            }
        });
        let mut bounds = self.bounds.clone();
        bounds.push(1.0);
        let balls = self.balls.iter().map(|ball| Ball {
            map: Dense::from_fn(ball.map.nrows(), nv + 1, |i, j| {
                if j < nv { ball.map[(i, j)] } else { 0.0 }
            }),
            ..ball.clone()
        });
        let lifted = Body {
            rows,
            bounds,
            balls: balls.collect(),
        };
        let mut c = vec![0.0; nv + 1];
        c[nv] = 1.0;
        let (v, mut y, mut w) = lifted.solve(&c, Some(nv))?;
        let point = v[..nv].to_vec();
        let mut slack = self.bounds.clone();
        add_product(&mut slack, &self.rows, &point, -1.0);
        slack.extend(self.balls.iter().map(|b| b.radius - b.norm_at(&point)));
        let depth = slack.iter().fold(1.0_f64, |a, s| {
            if s.is_nan() {
                f64::NEG_INFINITY
            } else {
                a.min(*s)
            }
        });
        if self.balls.is_empty() {
            lifted.refine(&c, &mut y, &mut []);
            y.truncate(p);
        } else {
            // What a contradiction needs: Gᵀy + Σ F_kᵀw_k = 0.
            y.truncate(p);
            self.refine(&vec![0.0; nv], &mut y, &mut w);
        }
        Ok(Deepest {
            point,
            depth,
            multipliers: y,
            balls: w,
        })
    }

    /// The point of the segment from `inside` to v that is nearest to v and satisfies everything.
    fn drawn_inside(&self, v: &[f64], inside: &[f64]) -> Result<Vec<f64>, BodyFailure> {
        let mut share = 1.0_f64;
        let mut at_v = self.bounds.clone();
        add_product(&mut at_v, &self.rows, v, -1.0);
        let mut at_inside = self.bounds.clone();
        add_product(&mut at_inside, &self.rows, inside, -1.0);
        let balls = self.balls.iter().map(|b| {
            (
                b.radius - b.norm_at(v),
                // The norm is convex: what holds for a row holds for it with "at most".
                b.radius - b.norm_at(inside),
            )
        });
        for (out, ins) in at_v.into_iter().zip(at_inside).chain(balls) {
            if out < 0.0 && ins > 0.0 {
                share = share.min(ins / (ins - out));
            }
        }
        let at = |share: f64| -> Vec<f64> {
            inside
                .iter()
                .zip(v)
                .map(|(i, v)| i + share * (v - i))
                .collect()
        };
        let point = at(share);
        if self.violation(&point) <= ROUNDING {
            return Ok(point);
        }
        // Rounding of a body far from the origin: a little further in.
        let point = at(share * (1.0 - 1e-12));
        let violation = self.violation(&point);
        if violation <= 100.0 * ROUNDING {
            Ok(point)
        } else {
            Err(BodyFailure::Unsolved(format!(
                "no point inside was found: a row is exceeded by {violation:.3e}"
            )))
        }
    }

    /// The weak-duality bound of (y, w) after refinement.
    fn upper_end(
        &self,
        c: &[f64],
        v: &[f64],
        mut y: Vec<f64>,
        mut w: Vec<Vec<f64>>,
    ) -> (f64, Multipliers) {
        self.refine(c, &mut y, &mut w);
        let leak = self
            .leak(c, &y, &w)
            .iter()
            .fold(0.0_f64, |a, l| a.max(l.abs()));
        let balls: f64 = self
            .balls
            .iter()
            .zip(&w)
            .map(|(b, w)| norm(w) * b.radius - dot(w, &b.offset))
            .sum();
        let size: f64 = v.iter().map(|x| x.abs()).sum();
        let upper = dot(&y, &self.bounds) + balls + leak * LEAK_RADIUS * size.max(1.0);
        (upper, Multipliers { rows: y, balls: w })
    }

    /// c − Gᵀy − Σ F_kᵀ w_k.
    fn leak(&self, c: &[f64], y: &[f64], w: &[Vec<f64>]) -> Vec<f64> {
        let mut leak = c.to_vec();
        for j in 0..self.variables() {
            leak[j] -= dot_column(&self.rows, j, y);
            for (ball, w) in self.balls.iter().zip(w) {
                leak[j] -= dot_column(&ball.map, j, w);
            }
        }
        leak
    }

    /// Moves y, in proportion to itself, and w until the leak is rounding.
    fn refine(&self, c: &[f64], y: &mut [f64], w: &mut [Vec<f64>]) {
        let nv = self.variables();
        for _ in 0..REFINEMENTS {
            let leak = self.leak(c, y, w);
            let scaled = Dense::from_fn(self.rows.nrows(), nv, |i, j| y[i] * self.rows[(i, j)]);
            let mut gram = self.rows.transpose() * &scaled;
            for (ball, w) in self.balls.iter().zip(w.iter()) {
                let weight = norm(w) / ball.radius;
                gram += ball.map.transpose() * &ball.map * faer::Scale(weight);
            }
            let shift =
                REFINEMENT_SHIFT * (0..nv).map(|i| gram[(i, i)]).sum::<f64>() + f64::MIN_POSITIVE;
            for i in 0..nv {
                gram[(i, i)] += shift;
            }
            let right = Dense::from_fn(nv, 1, |i, _| leak[i]);
            let Ok(step) =
                linalg::solve_positive("refinement", &linalg::symmetrised(&gram), &right)
            else {
                return;
            };
            let step: Vec<f64> = step.col(0).iter().copied().collect();
            let mut trial = y.to_vec();
            let mut row_step = vec![0.0; y.len()];
            add_product(&mut row_step, &self.rows, &step, 1.0);
            for (t, s) in trial.iter_mut().zip(&row_step) {
                *t = (*t * (1.0 + s)).max(0.0);
            }
            let mut trial_w = w.to_vec();
            for (ball, w) in self.balls.iter().zip(&mut trial_w) {
                let weight = norm(w) / ball.radius;
                add_product(w, &ball.map, &step, weight);
            }
            let largest = |leak: &[f64]| leak.iter().fold(0.0_f64, |a, l| a.max(l.abs()));
            let improved = largest(&self.leak(c, &trial, &trial_w)) < largest(&leak);
            if !improved {
                return;
            }
            y.copy_from_slice(&trial);
            for (w, t) in w.iter_mut().zip(trial_w) {
                *w = t;
            }
        }
    }

    /// The solver's v, y ≥ 0 and w, unchecked. The variable `shrink` is taken from every radius.
    #[allow(clippy::type_complexity)]
    fn solve(
        &self,
        c: &[f64],
        shrink: Option<usize>,
    ) -> Result<(Vec<f64>, Vec<f64>, Vec<Vec<f64>>), BodyFailure> {
        let (p, nv) = (self.rows.nrows(), self.variables());
        let total = p + self.balls.iter().map(|b| 1 + b.map.nrows()).sum::<usize>();
        let (mut starts, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
        for j in 0..nv {
            let mut push = |i: usize, v: f64| {
                if v != 0.0 {
                    indices.push(i);
                    values.push(v);
                }
            };
            for (i, &v) in self.rows.col(j).iter().enumerate() {
                push(i, v);
            }
            let mut at = p;
            for ball in &self.balls {
                if shrink == Some(j) {
                    push(at, 1.0);
                }
                for (i, &v) in ball.map.col(j).iter().enumerate() {
                    push(at + 1 + i, -v);
                }
                at += 1 + ball.map.nrows();
            }
            starts.push(indices.len());
        }
        let mut b = self.bounds.clone();
        let mut cones: Vec<SupportedConeT<f64>> = Vec::with_capacity(1 + self.balls.len());
        if p > 0 {
            cones.push(NonnegativeConeT(p));
        }
        for ball in &self.balls {
            b.push(ball.radius);
            b.extend(&ball.offset);
            cones.push(SecondOrderConeT(1 + ball.map.nrows()));
        }
        let size = norm(c).max(f64::MIN_POSITIVE);
        let q: Vec<f64> = c.iter().map(|v| -v / size).collect();
        let settings = DefaultSettings {
            verbose: false,
            presolve_enable: false,
            max_threads: 1,
            tol_gap_abs: SOLVER_TOLERANCE,
            tol_gap_rel: SOLVER_TOLERANCE,
            tol_feas: SOLVER_TOLERANCE,
            ..DefaultSettings::default()
        };
        let mut solver = DefaultSolver::new(
            &CscMatrix::zeros((nv, nv)),
            &q,
            &CscMatrix::new(total, nv, starts, indices, values),
            &b,
            &cones,
            settings,
        )
        .map_err(|e| BodyFailure::Unsolved(format!("{e:?}")))?;
        solver.solve();
        let solution = &solver.solution;
        match solution.status {
            SolverStatus::DualInfeasible | SolverStatus::AlmostDualInfeasible => {
                return Err(BodyFailure::Unbounded);
            }
            _ if solution.x.iter().all(|v| v.is_finite()) => {}
            status => return Err(BodyFailure::Unsolved(format!("{status:?}"))),
        }
        let y = solution.z[..p]
            .iter()
            .map(|y| (y * size).max(0.0))
            .collect();
        let mut at = p;
        let w = self
            .balls
            .iter()
            .map(|ball| {
                let k = ball.map.nrows();
                let w = solution.z[at + 1..at + 1 + k]
                    .iter()
                    .map(|z| -z * size)
                    .collect();
                at += 1 + k;
                w
            })
            .collect();
        Ok((solution.x.clone(), y, w))
    }
}

/// out += factor · M v.
pub(crate) fn add_product(out: &mut [f64], m: &Dense, v: &[f64], factor: f64) {
    for (j, &vj) in v.iter().enumerate() {
        if vj != 0.0 {
            for (o, &c) in out.iter_mut().zip(m.col(j).iter()) {
                *o += factor * vj * c;
            }
        }
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn dot_column(m: &Dense, j: usize, v: &[f64]) -> f64 {
    m.col(j).iter().zip(v).map(|(a, b)| a * b).sum()
}

pub(crate) fn norm(v: &[f64]) -> f64 {
    dot(v, v).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Body {
        Body {
            rows: Dense::from_fn(4, 2, |i, j| match (i, j) {
                (0, 0) | (2, 1) => 1.0,
                (1, 0) | (3, 1) => -1.0,
                _ => 0.0,
            }),
            bounds: vec![1.0; 4],
            balls: Vec::new(),
        }
    }

    #[test]
    fn the_support_of_a_square_and_of_a_disc_are_what_geometry_says() {
        let body = square();
        let s = body.support(&[1.0, 2.0], &[0.0, 0.0]).expect("support");
        assert!(s.lower <= 3.0 + 1e-12 && s.upper >= 3.0 - 1e-12);
        assert!(s.upper - s.lower < 1e-8, "{s:?}");
        let disc = Body {
            balls: vec![Ball {
                map: Dense::identity(2, 2),
                offset: vec![-0.2, 0.0],
                radius: 0.5,
            }],
            ..square()
        };
        // Centre (0.2, 0), radius 1/2: support in direction (3, 4)/5 is 0.12 + 0.5.
        let s = disc.support(&[0.6, 0.8], &[0.2, 0.0]).expect("support");
        assert!(
            (s.lower - 0.62).abs() < 1e-7 && (s.upper - 0.62).abs() < 1e-7,
            "{s:?}"
        );
        assert!(s.lower <= 0.62 + 1e-12 && s.upper >= 0.62 - 1e-12);
    }

    #[test]
    fn contradicting_rows_have_negative_depth_and_a_proof() {
        let mut body = square();
        body.bounds = vec![-1.0, -1.0, 1.0, 1.0];
        let d = body.deepest().expect("depth");
        assert!((d.depth + 1.0).abs() < 1e-8, "{d:?}");
        assert!((dot(&d.multipliers, &body.bounds) + 1.0).abs() < 1e-8);
    }

    #[test]
    fn balls_have_a_depth_and_contradict_rows() {
        // The square and a disc of radius 2 around (2, 0): deepest at (1/2, 0)? The rows give 1 − v, the disc v: 1/2.
        let mut body = Body {
            balls: vec![Ball {
                map: Dense::identity(2, 2),
                offset: vec![-2.0, 0.0],
                radius: 2.0,
            }],
            ..square()
        };
        let d = body.deepest().expect("depth");
        assert!((d.depth - 0.5).abs() < 1e-7, "{d:?}");
        // Radius 1/2: the disc begins at 3/2, the square ends at 1.
        body.balls[0].radius = 0.5;
        let d = body.deepest().expect("depth");
        assert!((d.depth + 0.25).abs() < 1e-7, "{d:?}");
        let value = dot(&d.multipliers, &body.bounds) + norm(&d.balls[0]) * 0.5
            - dot(&d.balls[0], &body.balls[0].offset);
        assert!(value < 0.0, "{d:?}");
    }

    #[test]
    fn an_open_direction_is_called_unbounded() {
        let mut body = square();
        body.rows = Dense::from_fn(1, 2, |_, j| if j == 0 { 1.0 } else { 0.0 });
        body.bounds = vec![1.0];
        assert_eq!(
            body.support(&[0.0, 1.0], &[0.0, 0.0]).err(),
            Some(BodyFailure::Unbounded)
        );
    }
}
