//! Quadratic programs with rows and second-order cones: min ½ zᵀHz + fᵀz, G z ≤ b, ‖T_k z + t_k‖ ≤ ρ_k, with constant H, G, T_k.
//!
//! With H = L Lᵀ and v = Lᵀz it is a least-distance problem over scaled rows and cones, solved by an interior-point method.
//! Newton's method on the active rows and cones then makes the answer exact to rounding; the answer is checked from the data.

use super::body::{add_product, dot, norm};
use super::conic_verify::{self, Cone};
use super::qp::Failure;
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus,
    SupportedConeT,
};
use std::time::Duration;

/// Tolerance asked of the interior-point method; the check decides.
const SOLVER_TOLERANCE: f64 = 1e-10;
/// Largest residual of an answer that is accepted, as for programs without cones.
const ACCEPTED: f64 = 1e-8;
/// A proof of infeasibility must exclude every solution below this norm, in units in which right-hand sides are one.
const FARKAS_RADIUS: f64 = 1e6;
/// Newton steps of the polish; each doubles the number of right digits.
const POLISH_STEPS: usize = 8;

/// A family of programs.
#[derive(Clone, Debug)]
pub(crate) struct ConicQp {
    h: Dense,
    g: Dense,
    maps: Vec<Dense>,
    radii: Vec<f64>,
    /// L with H = L Lᵀ.
    factor: Dense,
    /// Rows of G L⁻ᵀ to unit norm.
    rows: Dense,
    row_scale: Vec<f64>,
    /// T_k L⁻ᵀ, each cone to unit norm.
    scaled: Vec<Dense>,
    cone_scale: Vec<f64>,
    a: CscMatrix<f64>,
}

/// An accepted answer.
#[derive(Clone, Debug)]
pub(crate) struct ConicSolution {
    pub(crate) z: Vec<f64>,
    pub(crate) iterations: usize,
}

/// How a solve may end early.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ConicLimits {
    pub(crate) iterations: Option<u32>,
    pub(crate) time: Option<Duration>,
}

/// v, y and w of the scaled program.
struct Point {
    v: Vec<f64>,
    y: Vec<f64>,
    w: Vec<Vec<f64>>,
}

/// f, b and t_k of the scaled program.
struct Scaled {
    f: Vec<f64>,
    b: Vec<f64>,
    offsets: Vec<Vec<f64>>,
    radii: Vec<f64>,
    size: f64,
}

impl ConicQp {
    pub(crate) fn new(
        what: &str,
        h: Dense,
        g: Dense,
        maps: Vec<Dense>,
        radii: Vec<f64>,
    ) -> Result<Self, DesignError> {
        let factor = linalg::cholesky(what, &h)?;
        // M L⁻ᵀ, divided by `norms` of groups of rows.
        let divided = |m: &Dense| {
            let mut t = m.transpose().to_owned();
            factor.as_ref().solve_lower_triangular_in_place(t.as_mut());
            t.transpose().to_owned()
        };
        let inverse = |norm: f64| if norm > 0.0 { norm.recip() } else { 0.0 };
        let mut rows = divided(&g);
        let mut row_scale = Vec::with_capacity(g.nrows());
        for i in 0..rows.nrows() {
            let scale = inverse(rows.row(i).norm_l2());
            rows.row_mut(i).iter_mut().for_each(|v| *v *= scale);
            row_scale.push(scale);
        }
        let mut cone_scale = Vec::with_capacity(maps.len());
        let scaled: Vec<Dense> = maps
            .iter()
            .map(|m| {
                let t = divided(m);
                let scale = inverse(t.norm_l2());
                cone_scale.push(scale);
                t * faer::Scale(scale)
            })
            .collect();
        let a = stacked(&rows, &scaled);
        Ok(Self { h, g, maps, radii, factor, rows, row_scale, scaled, cone_scale, a })
    }

    /// The checked optimum for one f, b and t.
    pub(crate) fn solve(
        &self,
        f: &[f64],
        b: &[f64],
        offsets: &[Vec<f64>],
        limits: ConicLimits,
    ) -> Result<ConicSolution, Failure> {
        let cones: Vec<Cone<'_>> = self.cones(offsets);
        let data = self.scale(f, b, offsets);
        let unsolved = |iterations, residual| Failure::Unsolved { iterations, residual };
        let settings = DefaultSettings {
            verbose: false,
            presolve_enable: false,
            max_threads: 1,
            tol_gap_abs: SOLVER_TOLERANCE,
            tol_gap_rel: SOLVER_TOLERANCE,
            tol_feas: SOLVER_TOLERANCE,
            max_iter: limits.iterations.map_or(DefaultSettings::<f64>::default().max_iter, |i| i),
            time_limit: limits.time.map_or(f64::INFINITY, |t| t.as_secs_f64()),
            ..DefaultSettings::default()
        };
        let mut right = data.b.clone();
        let mut kinds: Vec<SupportedConeT<f64>> = Vec::with_capacity(1 + cones.len());
        if !right.is_empty() {
            kinds.push(NonnegativeConeT(right.len()));
        }
        for (offset, radius) in data.offsets.iter().zip(&data.radii) {
            right.push(*radius);
            right.extend(offset);
            kinds.push(SecondOrderConeT(1 + offset.len()));
        }
        let hessian = CscMatrix::identity(f.len());
        let mut solver =
            DefaultSolver::new(&hessian, &data.f, &self.a, &right, &kinds, settings)
                .map_err(|_| unsolved(0, f64::INFINITY))?;
        solver.solve();
        let solution = &solver.solution;
        let iterations = solution.iterations as usize;
        let point = self.point(&solution.x, &solution.z);
        if matches!(
            solution.status,
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible
        ) {
            let (y, w) = self.multipliers(&point, 1.0);
            return match conic_verify::farkas(&self.g, b, &cones, &y, &w) {
                Some(proof) if proof.radius >= FARKAS_RADIUS => Err(Failure::Infeasible(proof)),
                _ => Err(unsolved(iterations, f64::INFINITY)),
            };
        }
        let mut best = f64::INFINITY;
        for point in [self.polish(&data, &point), Some(point)].into_iter().flatten() {
            let z = self.unscaled(&point.v, data.size);
            let (y, w) = self.multipliers(&point, data.size);
            let residuals = conic_verify::residuals(&self.h, f, &self.g, b, &cones, &z, &y, &w);
            if residuals.within(ACCEPTED) {
                return Ok(ConicSolution { z, iterations });
            }
            best = best.min(residuals.largest());
        }
        Err(unsolved(iterations, best))
    }

    /// Largest violation of a row or cone.
    pub(crate) fn violation(&self, b: &[f64], offsets: &[Vec<f64>], z: &[f64]) -> f64 {
        conic_verify::violation(&self.g, b, &self.cones(offsets), z)
    }

    fn cones<'a>(&'a self, offsets: &'a [Vec<f64>]) -> Vec<Cone<'a>> {
        let data = self.maps.iter().zip(offsets).zip(&self.radii);
        data.map(|((map, offset), radius)| Cone { map, offset, radius: *radius }).collect()
    }

    /// The program is homogeneous: dividing everything by one number divides the answer by it, and the solver then works
    /// with numbers around one whatever the distance to the set-point.
    fn scale(&self, f: &[f64], b: &[f64], offsets: &[Vec<f64>]) -> Scaled {
        let mut scaled = Dense::from_fn(f.len(), 1, |i, _| f[i]);
        self.factor.as_ref().solve_lower_triangular_in_place(scaled.as_mut());
        let size = scaled.norm_max().max(1.0);
        let by = |s: f64| if s > 0.0 { s / size } else { 1.0 };
        let cone = |k: usize| by(self.cone_scale[k]);
        Scaled {
            f: scaled.col(0).iter().map(|v| v / size).collect(),
            b: b.iter().zip(&self.row_scale).map(|(b, s)| b * by(*s)).collect(),
            offsets: offsets
                .iter()
                .enumerate()
                .map(|(k, t)| t.iter().map(|v| v * cone(k)).collect())
                .collect(),
            radii: self.radii.iter().enumerate().map(|(k, r)| r * cone(k)).collect(),
            size,
        }
    }

    /// The solver's answer.
    fn point(&self, x: &[f64], dual: &[f64]) -> Point {
        let p = self.row_scale.len();
        let mut at = p;
        let w = self
            .scaled
            .iter()
            .map(|t| {
                let q = t.nrows();
                let w = dual[at + 1..at + 1 + q].iter().map(|z| -z).collect();
                at += 1 + q;
                w
            })
            .collect();
        Point {
            v: x.to_vec(),
            y: dual[..p].iter().map(|y| y.max(0.0)).collect(),
            w,
        }
    }

    /// z = L⁻ᵀ v.
    fn unscaled(&self, v: &[f64], size: f64) -> Vec<f64> {
        let mut z = Dense::from_fn(v.len(), 1, |i, _| v[i] * size);
        self.factor.transpose().solve_upper_triangular_in_place(z.as_mut());
        z.col(0).iter().copied().collect()
    }

    /// The multipliers in the units of the program.
    fn multipliers(&self, point: &Point, size: f64) -> (Vec<f64>, Vec<Vec<f64>>) {
        let y = point.y.iter().zip(&self.row_scale).map(|(y, s)| y * s * size).collect();
        let w = point.w.iter().zip(&self.cone_scale);
        let w = w.map(|(w, s)| w.iter().map(|w| w * s * size).collect()).collect();
        (y, w)
    }

    /// Newton's method on the conditions with the active rows as equations and the active cones as ½(‖a‖² − ρ²)/ρ = 0,
    /// a = T v + t, w = μ a/ρ. `None` when the guess of what is active was wrong.
    fn polish(&self, data: &Scaled, from: &Point) -> Option<Point> {
        let nv = data.f.len();
        let mut slack = data.b.clone();
        add_product(&mut slack, &self.rows, &from.v, -1.0);
        let rows: Vec<usize> = (0..slack.len())
            .filter(|&i| self.row_scale[i] > 0.0 && from.y[i] > slack[i].abs())
            .collect();
        let at = |k: usize, v: &[f64]| -> Vec<f64> {
            let mut a = data.offsets[k].clone();
            add_product(&mut a, &self.scaled[k], v, 1.0);
            a
        };
        let cones: Vec<usize> = (0..self.scaled.len())
            .filter(|&k| self.cone_scale[k] > 0.0)
            .filter(|&k| norm(&from.w[k]) > (data.radii[k] - norm(&at(k, &from.v))).abs())
            .collect();
        let (na, nc) = (rows.len(), cones.len());
        let mut v = from.v.clone();
        let mut y: Vec<f64> = rows.iter().map(|&i| from.y[i]).collect();
        let mut mu: Vec<f64> = cones.iter().map(|&k| norm(&from.w[k])).collect();
        for _ in 0..POLISH_STEPS {
            let order = nv + na + nc;
            let mut jacobian = Dense::zeros(order, order);
            let mut right = Dense::zeros(order, 1);
            for i in 0..nv {
                jacobian[(i, i)] = 1.0;
                right[(i, 0)] = -(v[i] + data.f[i]);
            }
            for (c, &i) in rows.iter().enumerate() {
                let mut value = -data.b[i];
                for j in 0..nv {
                    let g = self.rows[(i, j)];
                    jacobian[(nv + c, j)] = g;
                    jacobian[(j, nv + c)] = g;
                    right[(j, 0)] -= g * y[c];
                    value += g * v[j];
                }
                right[(nv + c, 0)] = -value;
            }
            for (c, &k) in cones.iter().enumerate() {
                let (a, radius) = (at(k, &v), data.radii[k]);
                let t = &self.scaled[k];
                let gram = t.transpose() * t * faer::Scale(mu[c] / radius);
                for j in 0..nv {
                    let slope = t.col(j).iter().zip(&a).map(|(t, a)| t * a).sum::<f64>() / radius;
                    jacobian[(nv + na + c, j)] = slope;
                    jacobian[(j, nv + na + c)] = slope;
                    right[(j, 0)] -= mu[c] * slope;
                    for i in 0..nv {
                        jacobian[(i, j)] += gram[(i, j)];
                    }
                }
                right[(nv + na + c, 0)] = 0.5 * (radius - dot(&a, &a) / radius);
            }
            let step = linalg::solve(&jacobian, &right);
            if !linalg::is_finite(&step) {
                return None;
            }
            v.iter_mut().enumerate().for_each(|(i, v)| *v += step[(i, 0)]);
            y.iter_mut().enumerate().for_each(|(i, y)| *y += step[(nv + i, 0)]);
            mu.iter_mut().enumerate().for_each(|(i, m)| *m += step[(nv + na + i, 0)]);
            if step.norm_max() <= f64::EPSILON * (1.0 + norm(&v)) {
                break;
            }
        }
        if y.iter().chain(&mu).any(|m| !(*m >= 0.0)) {
            return None;
        }
        let mut point = Point {
            y: vec![0.0; data.b.len()],
            w: data.offsets.iter().map(|t| vec![0.0; t.len()]).collect(),
            v,
        };
        for (&i, y) in rows.iter().zip(y) {
            point.y[i] = y;
        }
        for (&k, mu) in cones.iter().zip(mu) {
            point.w[k] = at(k, &point.v).iter().map(|a| mu * a / data.radii[k]).collect();
        }
        Some(point)
    }
}

/// Rows, and for each cone an empty row for its radius and −T.
fn stacked(rows: &Dense, cones: &[Dense]) -> CscMatrix<f64> {
    let (p, nv) = (rows.nrows(), rows.ncols());
    let total = p + cones.iter().map(|t| 1 + t.nrows()).sum::<usize>();
    let (mut starts, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
    for j in 0..nv {
        let mut push = |i: usize, v: f64| {
            if v != 0.0 {
                indices.push(i);
                values.push(v);
            }
        };
        rows.col(j).iter().enumerate().for_each(|(i, v)| push(i, *v));
        let mut at = p;
        for t in cones {
            t.col(j).iter().enumerate().for_each(|(i, v)| push(at + 1 + i, -*v));
            at += 1 + t.nrows();
        }
        starts.push(indices.len());
    }
    CscMatrix::new(total, nv, starts, indices, values)
}
