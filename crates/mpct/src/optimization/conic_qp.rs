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
const POLISH_STEPS: usize = 12;
/// Exchanges of active rows and cones in the polish.
const EXCHANGES: usize = 40;
/// A scaled row or cone that is violated by more than this becomes active in the polish.
const VIOLATED: f64 = 1e-12;
/// Proximal term of the multipliers in the polish, where rows have unit norm; Newton's steps remove its effect.
const PROXIMAL: f64 = 1e-12;

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

/// How the interior-point method ended.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Status {
    Ended,
    /// By a limit of the caller.
    CutShort,
    Infeasible,
}

struct Attempt {
    status: Status,
    iterations: usize,
    point: Point,
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
        Ok(Self {
            h,
            g,
            maps,
            radii,
            factor,
            rows,
            row_scale,
            scaled,
            cone_scale,
            a,
        })
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
        let (mut iterations, mut best) = (0, f64::INFINITY);
        for plain in [false, true] {
            let Some(attempt) = self.attempt(&data, plain, limits) else {
                continue;
            };
            iterations += attempt.iterations;
            if attempt.status == Status::Infeasible {
                let (y, w) = self.multipliers(&attempt.point, 1.0);
                let proof = conic_verify::farkas(&self.g, b, &cones, &y, &w);
                if let Some(proof) = proof.filter(|p| p.radius >= FARKAS_RADIUS) {
                    return Err(Failure::Infeasible(proof));
                }
                continue;
            }
            let is_cut_short = attempt.status == Status::CutShort;
            let polished = (!is_cut_short)
                .then(|| self.polish(&data, &attempt.point))
                .flatten();
            for point in [polished, Some(attempt.point)].into_iter().flatten() {
                let z = self.unscaled(&point.v, data.size);
                let (y, w) = self.multipliers(&point, data.size);
                let residuals = conic_verify::residuals(&self.h, f, &self.g, b, &cones, &z, &y, &w);
                if residuals.within(ACCEPTED) {
                    return Ok(ConicSolution { z, iterations });
                }
                best = best.min(residuals.largest());
            }
            if is_cut_short {
                break;
            }
        }
        Err(Failure::Unsolved {
            iterations,
            residual: best,
        })
    }

    /// One run of the interior-point method: on the least-distance problem, or (`plain`) in the variables as they are, which
    /// suits costs that are nearly flat in some directions. The point is that of the least-distance problem.
    fn attempt(&self, data: &Scaled, plain: bool, limits: ConicLimits) -> Option<Attempt> {
        let settings = DefaultSettings {
            verbose: false,
            presolve_enable: false,
            max_threads: 1,
            tol_gap_abs: SOLVER_TOLERANCE,
            tol_gap_rel: SOLVER_TOLERANCE,
            tol_feas: SOLVER_TOLERANCE,
            max_iter: limits
                .iterations
                .unwrap_or(DefaultSettings::<f64>::default().max_iter),
            time_limit: limits.time.map_or(f64::INFINITY, |t| t.as_secs_f64()),
            ..DefaultSettings::default()
        };
        let mut right = data.b.clone();
        let mut kinds: Vec<SupportedConeT<f64>> = Vec::with_capacity(1 + self.scaled.len());
        if !right.is_empty() {
            kinds.push(NonnegativeConeT(right.len()));
        }
        for (offset, radius) in data.offsets.iter().zip(&data.radii) {
            right.push(*radius);
            right.extend(offset);
            kinds.push(SecondOrderConeT(1 + offset.len()));
        }
        let nv = data.f.len();
        let mut solver = if plain {
            // v = Lᵀζ: rows S Lᵀ, cost ½ ζᵀHζ + (L f)ᵀζ, divided by the size of H.
            let to_rows = |m: &Dense| m * self.factor.transpose();
            let cones: Vec<Dense> = self.scaled.iter().map(to_rows).collect();
            let scale = linalg::max_abs(self.h.as_ref()).recip();
            let hessian = upper_triangle(&self.h, scale);
            let linear = &self.factor * Dense::from_fn(nv, 1, |i, _| data.f[i] * scale);
            let linear: Vec<f64> = linear.col(0).iter().copied().collect();
            let a = stacked(&to_rows(&self.rows), &cones);
            let mut solver =
                DefaultSolver::new(&hessian, &linear, &a, &right, &kinds, settings).ok()?;
            solver.solve();
            let v = self.factor.transpose() * Dense::from_fn(nv, 1, |i, _| solver.solution.x[i]);
            solver.solution.x = v.col(0).iter().copied().collect();
            solver.solution.z.iter_mut().for_each(|z| *z /= scale);
            solver
        } else {
            let hessian = CscMatrix::identity(nv);
            let mut solver =
                DefaultSolver::new(&hessian, &data.f, &self.a, &right, &kinds, settings).ok()?;
            solver.solve();
            solver
        };
        let solution = &mut solver.solution;
        Some(Attempt {
            status: match solution.status {
                SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                    Status::Infeasible
                }
                SolverStatus::MaxIterations if limits.iterations.is_some() => Status::CutShort,
                SolverStatus::MaxTime => Status::CutShort,
                _ => Status::Ended,
            },
            iterations: solution.iterations as usize,
            point: self.point(&solution.x, &solution.z),
        })
    }

    /// Largest violation of a row or cone.
    pub(crate) fn violation(&self, b: &[f64], offsets: &[Vec<f64>], z: &[f64]) -> f64 {
        conic_verify::violation(&self.g, b, &self.cones(offsets), z)
    }

    fn cones<'a>(&'a self, offsets: &'a [Vec<f64>]) -> Vec<Cone<'a>> {
        let data = self.maps.iter().zip(offsets).zip(&self.radii);
        data.map(|((map, offset), radius)| Cone {
            map,
            offset,
            radius: *radius,
        })
        .collect()
    }

    /// The program is homogeneous: dividing everything by one number divides the answer by it, and the solver then works
    /// with numbers around one whatever the distance to the set-point.
    fn scale(&self, f: &[f64], b: &[f64], offsets: &[Vec<f64>]) -> Scaled {
        let mut scaled = Dense::from_fn(f.len(), 1, |i, _| f[i]);
        self.factor
            .as_ref()
            .solve_lower_triangular_in_place(scaled.as_mut());
        let size = scaled.norm_max().max(1.0);
        let by = |s: f64| if s > 0.0 { s / size } else { 1.0 };
        let cone = |k: usize| by(self.cone_scale[k]);
        Scaled {
            f: scaled.col(0).iter().map(|v| v / size).collect(),
            b: b.iter()
                .zip(&self.row_scale)
                .map(|(b, s)| b * by(*s))
                .collect(),
            offsets: offsets
                .iter()
                .enumerate()
                .map(|(k, t)| t.iter().map(|v| v * cone(k)).collect())
                .collect(),
            radii: self
                .radii
                .iter()
                .enumerate()
                .map(|(k, r)| r * cone(k))
                .collect(),
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
        self.factor
            .transpose()
            .solve_upper_triangular_in_place(z.as_mut());
        z.col(0).iter().copied().collect()
    }

    /// The multipliers in the units of the program.
    fn multipliers(&self, point: &Point, size: f64) -> (Vec<f64>, Vec<Vec<f64>>) {
        let y = point
            .y
            .iter()
            .zip(&self.row_scale)
            .map(|(y, s)| y * s * size)
            .collect();
        let w = point.w.iter().zip(&self.cone_scale);
        let w = w
            .map(|(w, s)| w.iter().map(|w| w * s * size).collect())
            .collect();
        (y, w)
    }

    /// The answer on the rows and cones that are active: solve on them, drop the most negative multiplier, add the most
    /// violated row or cone, until nothing changes. `None` when that does not end.
    fn polish(&self, data: &Scaled, from: &Point) -> Option<Point> {
        let mut slack = data.b.clone();
        add_product(&mut slack, &self.rows, &from.v, -1.0);
        let mut guess = Active {
            rows: (0..slack.len())
                .filter(|&i| self.row_scale[i] > 0.0 && from.y[i] > slack[i].abs())
                .map(|i| (i, from.y[i]))
                .collect(),
            cones: (0..self.scaled.len())
                .filter(|&k| self.cone_scale[k] > 0.0)
                .map(|k| (k, norm(&from.w[k])))
                .filter(|&(k, mu)| mu > (data.radii[k] - norm(&self.at(data, k, &from.v))).abs())
                .collect(),
            v: from.v.clone(),
        };
        for _ in 0..EXCHANGES {
            let found = self.newton(data, guess.clone())?;
            if guess.drop_negative(&found) {
                continue;
            }
            guess = found;
            let Some(worst) = self.most_violated(data, &guess.v) else {
                return Some(guess.into_point(self, data));
            };
            let added = match worst {
                Violated::Row(i) => insert(&mut guess.rows, i),
                Violated::Cone(k) => insert(&mut guess.cones, k),
            };
            if !added {
                return None;
            }
        }
        None
    }

    /// T v + t.
    fn at(&self, data: &Scaled, k: usize, v: &[f64]) -> Vec<f64> {
        let mut a = data.offsets[k].clone();
        add_product(&mut a, &self.scaled[k], v, 1.0);
        a
    }

    fn most_violated(&self, data: &Scaled, v: &[f64]) -> Option<Violated> {
        let mut over: Vec<f64> = data.b.iter().map(|b| -b).collect();
        add_product(&mut over, &self.rows, v, 1.0);
        let rows = over
            .into_iter()
            .enumerate()
            .map(|(i, v)| (v, Violated::Row(i)));
        let cones = (0..self.scaled.len()).map(|k| {
            (
                norm(&self.at(data, k, v)) - data.radii[k],
                Violated::Cone(k),
            )
        });
        rows.chain(cones)
            .filter(|o| o.0 > VIOLATED)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|o| o.1)
    }

    /// Newton's method on the conditions with active rows as equations and active cones as ½(‖a‖² − ρ²)/ρ = 0,
    /// a = T v + t, w = μ a/ρ. The multipliers carry a small proximal term, which dependent rows need.
    fn newton(&self, data: &Scaled, mut now: Active) -> Option<Active> {
        let nv = data.f.len();
        let (na, nc) = (now.rows.len(), now.cones.len());
        for _ in 0..POLISH_STEPS {
            let order = nv + na + nc;
            let mut jacobian = Dense::zeros(order, order);
            let mut right = Dense::zeros(order, 1);
            for i in 0..nv {
                jacobian[(i, i)] = 1.0;
                right[(i, 0)] = -(now.v[i] + data.f[i]);
            }
            for (c, &(i, y)) in now.rows.iter().enumerate() {
                let mut value = -data.b[i];
                for j in 0..nv {
                    let g = self.rows[(i, j)];
                    jacobian[(nv + c, j)] = g;
                    jacobian[(j, nv + c)] = g;
                    right[(j, 0)] -= g * y;
                    value += g * now.v[j];
                }
                right[(nv + c, 0)] = -value;
            }
            for (c, &(k, mu)) in now.cones.iter().enumerate() {
                let (a, radius) = (self.at(data, k, &now.v), data.radii[k]);
                let t = &self.scaled[k];
                let gram = t.transpose() * t * faer::Scale(mu / radius);
                let at = nv + na + c;
                for j in 0..nv {
                    let slope = t.col(j).iter().zip(&a).map(|(t, a)| t * a).sum::<f64>() / radius;
                    jacobian[(at, j)] = slope;
                    jacobian[(j, at)] = slope;
                    right[(j, 0)] -= mu * slope;
                    for i in 0..nv {
                        jacobian[(i, j)] += gram[(i, j)];
                    }
                }
                right[(at, 0)] = 0.5 * (radius - dot(&a, &a) / radius);
            }
            for i in nv..order {
                jacobian[(i, i)] = -PROXIMAL;
            }
            let step = linalg::solve(&jacobian, &right);
            if !linalg::is_finite(&step) {
                return None;
            }
            now.v
                .iter_mut()
                .enumerate()
                .for_each(|(i, v)| *v += step[(i, 0)]);
            let multipliers = now.rows.iter_mut().chain(&mut now.cones);
            multipliers
                .enumerate()
                .for_each(|(i, m)| m.1 += step[(nv + i, 0)]);
            if step.norm_max() <= f64::EPSILON * (1.0 + norm(&now.v)) {
                break;
            }
        }
        Some(now)
    }
}

/// A guess of what is active, with multipliers.
#[derive(Clone)]
struct Active {
    rows: Vec<(usize, f64)>,
    cones: Vec<(usize, f64)>,
    v: Vec<f64>,
}

enum Violated {
    Row(usize),
    Cone(usize),
}

/// Adds an index without a multiplier yet; false when it is there.
fn insert(list: &mut Vec<(usize, f64)>, index: usize) -> bool {
    let new = list.iter().all(|e| e.0 != index);
    if new {
        list.push((index, 0.0));
    }
    new
}

impl Active {
    /// Takes out what has the most negative multiplier in the answer; false when none has.
    fn drop_negative(&mut self, found: &Self) -> bool {
        let least = |list: &[(usize, f64)]| -> Option<(usize, f64)> {
            let lowest = list.iter().enumerate().map(|(at, e)| (at, e.1));
            lowest
                .filter(|e| !(e.1 >= 0.0))
                .min_by(|a, b| a.1.total_cmp(&b.1))
        };
        match (least(&found.rows), least(&found.cones)) {
            (None, None) => return false,
            (Some(row), Some(cone)) if row.1 <= cone.1 => self.rows.remove(row.0),
            (Some(row), None) => self.rows.remove(row.0),
            (_, Some(cone)) => self.cones.remove(cone.0),
        };
        true
    }

    fn into_point(self, qp: &ConicQp, data: &Scaled) -> Point {
        let mut y = vec![0.0; data.b.len()];
        let mut w: Vec<Vec<f64>> = data.offsets.iter().map(|t| vec![0.0; t.len()]).collect();
        self.rows.iter().for_each(|e| y[e.0] = e.1);
        for &(k, mu) in &self.cones {
            let scale = mu / data.radii[k];
            w[k] = qp.at(data, k, &self.v).iter().map(|a| a * scale).collect();
        }
        Point { v: self.v, y, w }
    }
}

/// The upper triangle of a symmetric matrix, times a number.
fn upper_triangle(h: &Dense, scale: f64) -> CscMatrix<f64> {
    let (mut starts, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
    for j in 0..h.ncols() {
        for i in 0..=j {
            if h[(i, j)] != 0.0 {
                indices.push(i);
                values.push(h[(i, j)] * scale);
            }
        }
        starts.push(indices.len());
    }
    CscMatrix::new(h.nrows(), h.ncols(), starts, indices, values)
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
        rows.col(j)
            .iter()
            .enumerate()
            .for_each(|(i, v)| push(i, *v));
        let mut at = p;
        for t in cones {
            t.col(j)
                .iter()
                .enumerate()
                .for_each(|(i, v)| push(at + 1 + i, -*v));
            at += 1 + t.nrows();
        }
        starts.push(indices.len());
    }
    CscMatrix::new(total, nv, starts, indices, values)
}
