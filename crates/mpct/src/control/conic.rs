//! The solver of a step when there are ellipsoids: a quadratic program with second-order cones, and the shifted candidate (32)
//! where it has no checked answer. The online solver of the runtime solves the others.

use super::online::{Answer, Limits, Program, accumulate};
use crate::error::DesignError;
use crate::linalg::Dense;
use crate::optimization::{ConicLimits, ConicQp, Failure};
use mpct_runtime::Why;
use std::time::Instant;

/// ‖S x + T z + t‖ ≤ 1.
#[derive(Clone, Debug)]
pub(crate) struct ProgramCone {
    /// T, q × variables.
    pub(crate) map: Dense,
    /// S, q × n.
    pub(crate) from_state: Dense,
    /// t.
    pub(crate) offset: Vec<f64>,
}

impl ProgramCone {
    /// S x + t.
    pub(crate) fn offset_at(&self, x: &[f64]) -> Vec<f64> {
        let mut offset = self.offset.clone();
        accumulate(&mut offset, &self.from_state, x, 1.0);
        offset
    }

    /// T z.
    pub(crate) fn image(&self, z: &[f64]) -> Vec<f64> {
        let mut image = vec![0.0; self.offset.len()];
        accumulate(&mut image, &self.map, z, 1.0);
        image
    }
}

/// A candidate that stands in for a solver that failed may violate rows and cones (right-hand sides 1) by this: rounding along the
/// prediction.
const FITS: f64 = 1e-6;

/// The programs of a controller with ellipsoids, and the last plan.
pub(crate) struct ConicSolver {
    program: Program,
    cones: Vec<ProgramCone>,
    qp: ConicQp,
    inputs: usize,
    stages: usize,
    plan: Option<Vec<f64>>,
}

impl ConicSolver {
    /// `inputs` m is the size of one stage; `stages` N of them stand before θ.
    pub(crate) fn new(
        program: Program,
        cones: Vec<ProgramCone>,
        inputs: usize,
        stages: usize,
    ) -> Result<Self, DesignError> {
        let qp = ConicQp::new(
            "the program of a step",
            program.hessian.clone(),
            program.rows.clone(),
            cones.iter().map(|c| c.map.clone()).collect(),
            vec![1.0; cones.len()],
        )?;
        Ok(Self {
            program,
            cones,
            qp,
            inputs,
            stages,
            plan: None,
        })
    }

    pub(crate) fn program(&self) -> &Program {
        &self.program
    }

    pub(crate) fn cones(&self) -> &[ProgramCone] {
        &self.cones
    }

    /// Forgets the last solution.
    pub(crate) fn reset(&mut self) {
        self.plan = None;
    }

    /// The checked optimum at (x, r); the shifted candidate when the limits end the solve before it, or when nobody finds an
    /// optimum and the candidate is feasible.
    pub(crate) fn solve(
        &mut self,
        x: &[f64],
        r: &[f64],
        limits: Limits,
    ) -> Result<Answer, Failure> {
        let started = Instant::now();
        let (f, b) = self.program.linear_and_bounds(x, r);
        let offsets: Vec<Vec<f64>> = self.cones.iter().map(|c| c.offset_at(x)).collect();
        let conic_limits = ConicLimits {
            iterations: limits.iterations,
            time: limits.time,
        };
        let (failure, iterations) = match self.qp.solve(&f, &b, &offsets, conic_limits) {
            Ok(solution) => {
                self.plan = Some(solution.z.clone());
                return Ok(Answer {
                    violation: self.qp.violation(&b, &offsets, &solution.z),
                    input: self.input(x, &solution.z),
                    z: solution.z,
                    why: None,
                    iterations: solution.iterations,
                });
            }
            Err(Failure::Infeasible(proof)) => return Err(Failure::Infeasible(proof)),
            Err(failure @ Failure::Unsolved { iterations, .. }) => (failure, iterations),
        };
        let why = if limits.time.is_some_and(|t| started.elapsed() >= t) {
            Why::Deadline
        } else if limits.iterations.is_some_and(|i| iterations >= i as usize) {
            Why::IterationLimit
        } else {
            Why::SolverFailed
        };
        let Some(candidate) = self.plan.as_ref().map(|plan| self.shifted(plan)) else {
            return Err(failure);
        };
        let violation = self.qp.violation(&b, &offsets, &candidate);
        if why == Why::SolverFailed && !(violation <= FITS) {
            return Err(failure);
        }
        self.plan = Some(candidate.clone());
        Ok(Answer {
            input: self.input(x, &candidate),
            z: candidate,
            why: Some(why),
            iterations,
            violation,
        })
    }

    fn input(&self, x: &[f64], z: &[f64]) -> Vec<f64> {
        let law = self.program.law.as_ref();
        law.map_or_else(Vec::new, |law| law.input(x, z, self.stages))
    }

    /// (c_1, …, c_{N−1}, 0, θ).
    fn shifted(&self, plan: &[f64]) -> Vec<f64> {
        let (m, end) = (self.inputs, self.inputs * self.stages);
        let mut out = plan.to_vec();
        if end >= m {
            out.copy_within(m..end, 0);
            out[end - m..end].fill(0.0);
        }
        out
    }
}
