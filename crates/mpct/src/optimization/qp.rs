//! A family of quadratic programs that differ in f and b only.
//!
//! H = L Lᵀ turns the program into a least-distance problem, min ½‖y‖² + (L⁻¹f)·y over rows of unit norm. The offset
//! weight (1e6 in the drone's case) then no longer drowns the other terms in the solver's tolerance. An interior-point
//! answer is polished on its active rows, and the result is checked from H, f, G, b.

use super::verify::{self, Farkas, Residuals};
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};

/// Tolerance asked of the interior-point method. It often stops a little short of it; the check decides.
const SOLVER_TOLERANCE: f64 = 1e-10;
/// Largest residual of an answer that is accepted.
const ACCEPTED: f64 = 1e-8;
/// A Farkas ray must exclude every solution below this norm, in units in which rows have right-hand sides of one.
const FARKAS_RADIUS: f64 = 1e6;
/// Rounds of exchange when polishing.
const POLISH_ROUNDS: usize = 30;
/// Regularisation of the polishing system, removed by refinement; keeps dependent rows from stopping it.
const POLISH_SHIFT: f64 = 1e-10;

/// An accepted answer.
#[derive(Clone, Debug)]
pub(crate) struct QpSolution {
    pub(crate) z: Vec<f64>,
    /// Multipliers ≥ 0 of the rows.
    pub(crate) y: Vec<f64>,
    pub(crate) iterations: usize,
}

/// No answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Failure {
    /// Proved.
    Infeasible(Farkas),
    /// The solver's last point does not pass the check.
    Unsolved { iterations: usize, residual: f64 },
}

/// H and G, factored and scaled.
#[derive(Clone, Debug)]
pub(crate) struct PreparedQp {
    h: Dense,
    g: Dense,
    /// L with H = L Lᵀ.
    factor: Dense,
    /// Rows of G L⁻ᵀ, scaled to unit norm, transposed: variables × rows.
    scaled_t: Dense,
    /// 1/norm of each row of G L⁻ᵀ; 0 for rows without coefficients.
    row_scale: Vec<f64>,
    p_csc: CscMatrix<f64>,
    a_csc: CscMatrix<f64>,
}

impl PreparedQp {
    pub(crate) fn new(what: &str, h: Dense, g: Dense) -> Result<Self, DesignError> {
        let nz = h.nrows();
        let factor = linalg::cholesky(what, &h)?;
        let mut scaled_t = g.transpose().to_owned();
        factor
            .as_ref()
            .solve_lower_triangular_in_place(scaled_t.as_mut());
        let mut row_scale = Vec::with_capacity(g.nrows());
        for i in 0..g.nrows() {
            let norm = scaled_t.col(i).norm_l2();
            let scale = if norm > 0.0 { norm.recip() } else { 0.0 };
            scaled_t.col_mut(i).iter_mut().for_each(|v| *v *= scale);
            row_scale.push(scale);
        }
        let a = Dense::from_fn(g.nrows(), nz, |i, j| scaled_t[(j, i)]);
        Ok(Self {
            p_csc: CscMatrix::identity(nz),
            a_csc: to_csc(&a),
            h,
            g,
            factor,
            scaled_t,
            row_scale,
        })
    }

    /// The checked optimum for one f and b.
    pub(crate) fn solve(&self, f: &[f64], b: &[f64]) -> Result<QpSolution, Failure> {
        let nz = f.len();
        let mut scaled_f = Dense::from_fn(nz, 1, |i, _| f[i]);
        self.factor
            .as_ref()
            .solve_lower_triangular_in_place(scaled_f.as_mut());
        // The program is homogeneous: dividing f and b by one number divides the answer by it, and the solver then works
        // with numbers around one whatever the distance to the set-point.
        let size = scaled_f.norm_max().max(1.0);
        let scaled_f: Vec<f64> = scaled_f.col(0).iter().map(|v| v / size).collect();
        let scaled_b: Vec<f64> = b
            .iter()
            .zip(&self.row_scale)
            .map(|(b, &s)| if s > 0.0 { b * s / size } else { *b })
            .collect();
        let settings = DefaultSettings {
            verbose: false,
            presolve_enable: false,
            max_threads: 1,
            tol_gap_abs: SOLVER_TOLERANCE,
            tol_gap_rel: SOLVER_TOLERANCE,
            tol_feas: SOLVER_TOLERANCE,
            ..DefaultSettings::default()
        };
        let cones = [NonnegativeConeT(b.len())];
        let unsolved = Failure::Unsolved {
            iterations: 0,
            residual: f64::INFINITY,
        };
        let mut solver = DefaultSolver::new(
            &self.p_csc,
            &scaled_f,
            &self.a_csc,
            &scaled_b,
            &cones,
            settings,
        )
        .map_err(|_| unsolved)?;
        solver.solve();
        let solution = &solver.solution;
        let iterations = solution.iterations as usize;
        if matches!(
            solution.status,
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible
        ) {
            let y: Vec<f64> = self.unscale_multipliers(&solution.z, 1.0);
            if let Some(proof) =
                verify::farkas(&self.g, b, &y).filter(|p| p.radius >= FARKAS_RADIUS)
            {
                return Err(Failure::Infeasible(proof));
            }
        }
        let accept = |scaled_y: &[f64]| -> (QpSolution, Residuals) {
            // z from stationarity, y as it stands: then only the rows are left to be checked.
            let mut v = Dense::from_fn(nz, 1, |i, _| -scaled_f[i] * size);
            for (k, &m) in scaled_y.iter().enumerate() {
                if m != 0.0 {
                    for (v, s) in v.col_mut(0).iter_mut().zip(self.scaled_t.col(k).iter()) {
                        *v -= m * size * s;
                    }
                }
            }
            self.factor
                .transpose()
                .solve_upper_triangular_in_place(v.as_mut());
            let z: Vec<f64> = v.col(0).iter().copied().collect();
            let y = self.unscale_multipliers(scaled_y, size);
            let residuals = verify::residuals(&self.h, f, &self.g, b, &z, &y);
            (QpSolution { z, y, iterations }, residuals)
        };
        let active: Vec<usize> = (0..b.len())
            .filter(|&k| solution.z[k] > solution.s[k].abs() && self.row_scale[k] > 0.0)
            .collect();
        let mut best: Option<(QpSolution, Residuals)> = None;
        for answer in [
            self.polish(&scaled_f, &scaled_b, active),
            Some(solution.z.clone()),
        ]
        .into_iter()
        .flatten()
        {
            let (candidate, residuals) = accept(&answer);
            if residuals.within(1e-3 * ACCEPTED) {
                return Ok(candidate);
            }
            if best
                .as_ref()
                .is_none_or(|b| residuals.largest() < b.1.largest())
            {
                best = Some((candidate, residuals));
            }
        }
        match best {
            Some((solution, residuals)) if residuals.within(ACCEPTED) => Ok(solution),
            other => Err(Failure::Unsolved {
                iterations,
                residual: other.map_or(f64::INFINITY, |b| b.1.largest()),
            }),
        }
    }

    fn unscale_multipliers(&self, y: &[f64], size: f64) -> Vec<f64> {
        y.iter()
            .zip(&self.row_scale)
            .map(|(y, &s)| {
                if s > 0.0 {
                    (y * s * size).max(0.0)
                } else {
                    0.0
                }
            })
            .collect()
    }

    /// Multipliers of the least-distance problem whose active rows are nearly known: solve on them, drop negative
    /// multipliers, add the most violated row, until nothing changes.
    fn polish(&self, f: &[f64], b: &[f64], mut active: Vec<usize>) -> Option<Vec<f64>> {
        let rows = b.len();
        for _ in 0..POLISH_ROUNDS {
            let mu = self.multipliers_on(f, b, &active)?;
            let negative = active
                .iter()
                .zip(&mu)
                .enumerate()
                .filter(|(_, (_, m))| **m < 0.0)
                .min_by(|a, b| a.1.1.total_cmp(b.1.1));
            if let Some((k, _)) = negative {
                active.remove(k);
                continue;
            }
            let mut y: Vec<f64> = f.iter().map(|v| -v).collect();
            for (&k, &m) in active.iter().zip(&mu) {
                for (y, s) in y.iter_mut().zip(self.scaled_t.col(k).iter()) {
                    *y -= m * s;
                }
            }
            let worst = (0..rows)
                .filter(|&k| self.row_scale[k] > 0.0)
                .map(|k| {
                    let at: f64 = self
                        .scaled_t
                        .col(k)
                        .iter()
                        .zip(&y)
                        .map(|(s, y)| s * y)
                        .sum();
                    (k, at - b[k])
                })
                .max_by(|a, b| a.1.total_cmp(&b.1))?;
            if worst.1 <= 1e-12 || active.contains(&worst.0) {
                let mut out = vec![0.0; rows];
                for (&k, &m) in active.iter().zip(&mu) {
                    out[k] = m;
                }
                return Some(out);
            }
            active.push(worst.0);
        }
        None
    }

    /// μ with (S Sᵀ) μ = −(b + S f) on the rows S of `active`; proximal refinement where S Sᵀ is singular.
    fn multipliers_on(&self, f: &[f64], b: &[f64], active: &[usize]) -> Option<Vec<f64>> {
        let k = active.len();
        if k == 0 {
            return Some(Vec::new());
        }
        let s = Dense::from_fn(f.len(), k, |i, j| self.scaled_t[(i, active[j])]);
        let gram = s.transpose() * &s;
        let shifted = Dense::from_fn(k, k, |i, j| {
            gram[(i, j)] + if i == j { POLISH_SHIFT } else { 0.0 }
        });
        let factor = linalg::cholesky("polishing", &shifted).ok()?;
        let fs = Dense::from_fn(f.len(), 1, |i, _| f[i]);
        let right = {
            let sf = s.transpose() * &fs;
            Dense::from_fn(k, 1, |i, _| -(b[active[i]] + sf[(i, 0)]))
        };
        let mut mu = Dense::zeros(k, 1);
        for _ in 0..6 {
            let mut r = &right - &gram * &mu;
            factor.as_ref().solve_lower_triangular_in_place(r.as_mut());
            factor
                .transpose()
                .solve_upper_triangular_in_place(r.as_mut());
            mu += r;
        }
        let mu: Vec<f64> = mu.col(0).iter().copied().collect();
        mu.iter().all(|m| m.is_finite()).then_some(mu)
    }
}

fn to_csc(m: &Dense) -> CscMatrix<f64> {
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for j in 0..m.ncols() {
        for (i, &v) in m.col(j).iter().enumerate() {
            if v != 0.0 {
                rows.push(i);
                values.push(v);
            }
        }
        starts.push(rows.len());
    }
    CscMatrix::new(m.nrows(), m.ncols(), starts, rows, values)
}
