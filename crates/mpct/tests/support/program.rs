//! Linear and quadratic programs by Clarabel, every answer checked here.
//!
//!   min ½ zᵀ H z + fᵀ z   subject to   E z = e,  G z ≤ g
//!
//! An optimum must satisfy the constraints, have multipliers of the right sign that cancel the gradient, and leave no
//! gap between primal and dual value. "Infeasible" must come with multipliers that contradict the constraints,
//! "unbounded" with a direction. Anything else fails the test.

use super::linear::{self, Mat, dot, largest};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};

/// `(column, value)`.
pub type Row = Vec<(usize, f64)>;

#[derive(Clone, Debug, Default)]
pub struct Program {
    pub variables: usize,
    /// Upper triangle of H as `(row, column, value)`; entries at the same place add up.
    pub hessian: Vec<(usize, usize, f64)>,
    pub linear: Vec<f64>,
    pub equal: Vec<(Row, f64)>,
    pub at_most: Vec<(Row, f64)>,
}

#[derive(Clone, Debug)]
pub struct Solution {
    pub z: Vec<f64>,
    /// ½ zᵀ H z + fᵀ z.
    pub value: f64,
    /// Multipliers of the equations.
    pub equal: Vec<f64>,
    /// Multipliers of the inequalities, ≥ 0.
    pub at_most: Vec<f64>,
}

#[derive(Clone, Debug)]
pub enum Answer {
    Optimal(Solution),
    /// No z with ‖z‖₁ < `radius` satisfies the constraints.
    Infeasible {
        radius: f64,
    },
    Unbounded,
}

/// Asked of the solver.
const SOLVER_TOLERANCE: f64 = 1e-10;
/// Demanded of its answer, relative to the size of what is compared.
const CHECK_TOLERANCE: f64 = 1e-7;
/// Demanded of an answer that is sharpened afterwards.
const START_TOLERANCE: f64 = 1e-5;
/// Demanded of a sharpened answer.
const SHARP_TOLERANCE: f64 = 1e-9;
/// A proof of infeasibility must reach this far.
const PROOF_RADIUS: f64 = 1e5;

pub fn sparse(row: &[f64]) -> Row {
    row.iter()
        .copied()
        .enumerate()
        .filter(|e| e.1 != 0.0)
        .collect()
}

fn row_dot(row: &Row, z: &[f64]) -> f64 {
    row.iter().map(|&(j, v)| v * z[j]).sum()
}

impl Program {
    pub fn new(variables: usize) -> Self {
        Self {
            variables,
            linear: vec![0.0; variables],
            ..Self::default()
        }
    }

    /// Adds ½ (T z + c)ᵀ W (T z + c) times `factor`, for T given by sparse rows; returns the constant ½ cᵀ W c.
    pub fn add_square(&mut self, factor: f64, weight: &Mat, rows: &[Row], constant: &[f64]) -> f64 {
        for (i, w) in weight.iter().enumerate() {
            for (j, &wij) in w.iter().enumerate() {
                if wij == 0.0 {
                    continue;
                }
                for &(a, va) in &rows[i] {
                    for &(b, vb) in &rows[j] {
                        if a <= b {
                            self.hessian.push((a, b, factor * wij * va * vb));
                        }
                    }
                    self.linear[a] += factor * wij * va * constant[j];
                }
            }
        }
        0.5 * factor * linear::quadratic(weight, constant)
    }

    fn gradient(&self, z: &[f64]) -> Vec<f64> {
        let mut g = self.linear.clone();
        for &(i, j, v) in &self.hessian {
            g[i] += v * z[j];
            if i != j {
                g[j] += v * z[i];
            }
        }
        g
    }

    pub fn value(&self, z: &[f64]) -> f64 {
        0.5 * (dot(&self.gradient(z), z) + dot(&self.linear, z))
    }

    /// Largest violation of the constraints.
    pub fn violation(&self, z: &[f64]) -> f64 {
        let equal = self.equal.iter().map(|(r, b)| (row_dot(r, z) - b).abs());
        let at_most = self.at_most.iter().map(|(r, b)| row_dot(r, z) - b);
        equal.chain(at_most).fold(0.0, f64::max)
    }

    /// Solves, and checks the answer.
    pub fn solve(&self) -> Answer {
        self.solve_within(CHECK_TOLERANCE)
    }

    /// Now and then an interior-point method stops short of its tolerance; other settings then do better.
    fn solve_within(&self, tolerance: f64) -> Answer {
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: SOLVER_TOLERANCE,
            tol_gap_rel: SOLVER_TOLERANCE,
            tol_feas: SOLVER_TOLERANCE,
            max_threads: 1,
            ..DefaultSettings::default()
        };
        let looser = DefaultSettings {
            tol_gap_abs: 10.0 * SOLVER_TOLERANCE,
            tol_gap_rel: 10.0 * SOLVER_TOLERANCE,
            tol_feas: 10.0 * SOLVER_TOLERANCE,
            ..settings.clone()
        };
        let unscaled = DefaultSettings {
            equilibrate_enable: false,
            ..settings.clone()
        };
        let plain = DefaultSettings {
            presolve_enable: false,
            static_regularization_constant: 1e-10,
            ..settings.clone()
        };
        let mut refused = Vec::new();
        for attempt in [settings, looser, unscaled, plain] {
            match self.attempt(attempt, tolerance) {
                Ok(answer) => return answer,
                Err(reason) => refused.push(reason),
            }
        }
        panic!("the reference's solver: {}", refused.join("; "));
    }

    fn attempt(&self, settings: DefaultSettings<f64>, tolerance: f64) -> Result<Answer, String> {
        // Only the ratio of costs matters: Clarabel's tolerances are absolute where values are below 1.
        let size = largest(&self.linear)
            .max(self.hessian.iter().fold(0.0, |a, e| a.max(e.2.abs())))
            .max(1e-300);
        let mut columns = Triplets::default();
        let mut bounds = Vec::new();
        for (row, bound) in self.equal.iter().chain(&self.at_most) {
            for &(j, v) in row {
                columns.push(bounds.len(), j, v);
            }
            bounds.push(*bound);
        }
        let mut hessian = Triplets::default();
        for &(i, j, v) in &self.hessian {
            hessian.push(i, j, v / size);
        }
        let f: Vec<f64> = self.linear.iter().map(|v| v / size).collect();
        let cones = [
            ZeroConeT(self.equal.len()),
            NonnegativeConeT(self.at_most.len()),
        ];
        let mut solver = DefaultSolver::new(
            &hessian.compressed(self.variables, self.variables),
            &f,
            &columns.compressed(bounds.len(), self.variables),
            &bounds,
            &cones,
            settings,
        )
        .expect("settings are valid");
        solver.solve();
        let status = solver.solution.status;
        let x = solver.solution.x.clone();
        let y: Vec<f64> = solver.solution.z.clone();
        match status {
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                self.check_infeasible(&y)
            }
            SolverStatus::DualInfeasible | SolverStatus::AlmostDualInfeasible => {
                self.check_unbounded(&x)
            }
            _ => {
                let y: Vec<f64> = y.iter().map(|v| v * size).collect();
                let (equal, at_most) = y.split_at(self.equal.len());
                let solution = Solution {
                    value: self.value(&x),
                    z: x,
                    equal: equal.to_vec(),
                    at_most: at_most.iter().map(|v| v.max(0.0)).collect(),
                };
                let error = self.error(&solution);
                // NaN fails.
                if error <= tolerance {
                    Ok(Answer::Optimal(solution))
                } else {
                    Err(format!(
                        "{status:?}, error {error:.3e}, {} variables, {} rows",
                        self.variables,
                        bounds.len()
                    ))
                }
            }
        }
    }

    /// Largest relative error of a claimed optimum: constraints, signs, stationarity, gap.
    pub fn error(&self, s: &Solution) -> f64 {
        let gradient = self.gradient(&s.z);
        let mut pull = vec![0.0; self.variables];
        let mut bound = 0.0;
        let rows = self.equal.iter().chain(&self.at_most);
        let mut terms: f64 = 0.0;
        for ((row, b), y) in rows.zip(s.equal.iter().chain(&s.at_most)) {
            for &(j, v) in row {
                pull[j] += v * y;
                terms = terms.max((v * y).abs());
            }
            bound += b * y;
        }
        let residual: Vec<f64> = gradient.iter().zip(&pull).map(|(g, p)| g + p).collect();
        // In units of the weights: an optimum at the origin has no gradient to compare with.
        let scale = largest(&self.linear)
            .max(self.hessian.iter().fold(0.0, |a, e| a.max(e.2.abs())))
            .max(largest(&gradient))
            .max(terms)
            .max(1e-300);
        // Dual value: −½ zᵀHz − bᵀy.
        let curvature = dot(&gradient, &s.z) - dot(&self.linear, &s.z);
        let dual = -0.5 * curvature - bound;
        let gap =
            (s.value - dual).abs() / s.value.abs().max(dual.abs()).max(bound.abs()).max(scale);
        let size = 1.0 + largest(&s.z);
        let negative = s.at_most.iter().fold(0.0_f64, |a, y| a.max(-y));
        (self.violation(&s.z) / size)
            .max(negative / scale)
            .max(largest(&residual) / scale)
            .max(gap)
    }

    fn check_infeasible(&self, y: &[f64]) -> Result<Answer, String> {
        let mut pull = vec![0.0; self.variables];
        let mut bound = 0.0;
        for (k, (row, b)) in self.equal.iter().chain(&self.at_most).enumerate() {
            let v = if k < self.equal.len() {
                y[k]
            } else {
                y[k].max(0.0)
            };
            for &(j, c) in row {
                pull[j] += c * v;
            }
            bound += b * v;
        }
        // (Gᵀy)ᵀ z ≤ bᵀ y < 0 needs ‖z‖₁ ≥ −bᵀy / ‖Gᵀy‖∞.
        let radius = -bound / largest(&pull).max(1e-300);
        if bound < 0.0 && radius > PROOF_RADIUS {
            Ok(Answer::Infeasible { radius })
        } else {
            Err(format!(
                "no proof of infeasibility: bᵀy = {bound:.3e}, radius {radius:.3e}"
            ))
        }
    }

    fn check_unbounded(&self, x: &[f64]) -> Result<Answer, String> {
        let size = largest(x).max(1e-300);
        let slope = dot(&self.linear, x) / size / largest(&self.linear).max(1e-300);
        let curvature = largest(&minus(&self.gradient(x), &self.linear)) / size;
        let equal = self.equal.iter().map(|(r, _)| row_dot(r, x).abs() / size);
        let at_most = self.at_most.iter().map(|(r, _)| row_dot(r, x) / size);
        let leaving = equal.chain(at_most).fold(0.0, f64::max);
        if slope < -1e-6 && leaving < 1e-6 && curvature < 1e-6 {
            Ok(Answer::Unbounded)
        } else {
            Err(format!(
                "no proof of unboundedness: slope {slope:.3e}, {leaving:.3e}, {curvature:.3e}"
            ))
        }
    }

    /// Solves to rounding level: from the solver's answer the active rows are guessed, the equations of Karush, Kuhn
    /// and Tucker solved by elimination, and the guess mended until multipliers and slacks have the right sign. Needs
    /// a unique optimum, and few variables.
    pub fn solve_sharply(&self) -> Answer {
        let start = match self.solve_within(START_TOLERANCE) {
            Answer::Optimal(s) => s,
            other => return other,
        };
        let slack = |z: &[f64], k: usize| self.at_most[k].1 - row_dot(&self.at_most[k].0, z);
        let scale = largest(&start.at_most).max(1e-300);
        let mut active: Vec<bool> = (0..self.at_most.len())
            .map(|k| start.at_most[k] / scale > slack(&start.z, k))
            .collect();
        let mut best = start.clone();
        for _ in 0..50 {
            let Some(solution) = self.equality_solution(&active) else {
                break;
            };
            if self.error(&solution) < self.error(&best) {
                best = solution.clone();
            }
            let scale = largest(&solution.at_most).max(1e-300);
            // The worst offender of each sort changes sides.
            let leave = (0..active.len())
                .filter(|&k| active[k] && solution.raw(k) < -1e-10 * scale)
                .min_by(|&a, &b| solution.raw(a).total_cmp(&solution.raw(b)));
            let enter = (0..active.len())
                .filter(|&k| !active[k] && slack(&solution.z, k) < -1e-11)
                .min_by(|&a, &b| slack(&solution.z, a).total_cmp(&slack(&solution.z, b)));
            if leave.is_none() && enter.is_none() {
                break;
            }
            if let Some(k) = leave {
                active[k] = false;
            }
            if let Some(k) = enter {
                active[k] = true;
            }
        }
        for y in &mut best.at_most {
            *y = y.max(0.0);
        }
        let error = self.error(&best);
        assert!(
            error <= SHARP_TOLERANCE,
            "the reference's sharp solution: error {error:.3e}"
        );
        Answer::Optimal(best)
    }

    /// The optimum with the active rows as equations, regularised against dependent rows and refined.
    fn equality_solution(&self, active: &[bool]) -> Option<Solution> {
        let n = self.variables;
        let rows: Vec<(&Row, f64)> = self
            .equal
            .iter()
            .map(|(r, b)| (r, *b))
            .chain(
                self.at_most
                    .iter()
                    .zip(active)
                    .filter(|e| *e.1)
                    .map(|((r, b), _)| (r, *b)),
            )
            .collect();
        let size = n + rows.len();
        let mut kkt = linear::zeros(size, size);
        for &(i, j, v) in &self.hessian {
            kkt[i][j] += v;
            if i != j {
                kkt[j][i] += v;
            }
        }
        // Rows in units in which the weights stand.
        let unit = (0..n)
            .fold(0.0_f64, |a, i| a.max(kkt[i][i].abs()))
            .max(1e-300);
        for (k, (row, _)) in rows.iter().enumerate() {
            for &(j, v) in *row {
                kkt[n + k][j] = v * unit;
                kkt[j][n + k] = v * unit;
            }
        }
        let exact = kkt.clone();
        let delta = 1e-9 * unit;
        for i in 0..size {
            kkt[i][i] += if i < n { 1e-4 * delta } else { -delta };
        }
        let inverse = linear::solve(&kkt, &linear::identity(size))?;
        let right: Vec<f64> = self
            .linear
            .iter()
            .map(|v| -v)
            .chain(rows.iter().map(|r| r.1 * unit))
            .collect();
        let mut solution = vec![0.0; size];
        for _ in 0..12 {
            let residual = linear::minus(&right, &linear::apply(&exact, &solution));
            solution = linear::plus(&solution, &linear::apply(&inverse, &residual));
        }
        if solution.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let z = solution[..n].to_vec();
        let mut multipliers = solution[n..].iter().map(|v| v * unit);
        let equal: Vec<f64> = multipliers.by_ref().take(self.equal.len()).collect();
        let at_most = active
            .iter()
            .map(|&a| {
                if a {
                    multipliers.next().unwrap_or(0.0)
                } else {
                    0.0
                }
            })
            .collect();
        Some(Solution {
            value: self.value(&z),
            z,
            equal,
            at_most,
        })
    }
}

impl Solution {
    fn raw(&self, k: usize) -> f64 {
        self.at_most[k]
    }
}

impl Answer {
    /// The optimum; fails the test when there is none.
    pub fn optimum(self) -> Solution {
        match self {
            Self::Optimal(s) => s,
            other => panic!("an optimum was expected: {other:?}"),
        }
    }
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    linear::minus(a, b)
}

#[derive(Default)]
struct Triplets {
    rows: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
}

impl Triplets {
    fn push(&mut self, row: usize, column: usize, value: f64) {
        self.rows.push(row);
        self.columns.push(column);
        self.values.push(value);
    }

    fn compressed(self, rows: usize, columns: usize) -> CscMatrix<f64> {
        CscMatrix::new_from_triplets(rows, columns, self.rows, self.columns, self.values)
    }
}
