//! The solver of a step when there are ellipsoids: a quadratic program with second-order cones, and the shifted candidate (32)
//! where it has no checked answer. The online solver of the runtime solves the others.

use super::online::{Answer, Limits, OnlineSolver, Program, accumulate};
use crate::error::DesignError;
use crate::linalg::Dense;
use crate::optimization::{ConicLimits, ConicQp, Failure};

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
}

/// A candidate may violate rows and cones (right-hand sides 1) by this: rounding along the prediction.
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
    fn new(
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

    fn solve(&mut self, x: &[f64], r: &[f64], limits: Limits) -> Result<Answer, Failure> {
        let (f, b) = self.program.linear_and_bounds(x, r);
        let offsets: Vec<Vec<f64>> = self.cones.iter().map(|c| c.offset_at(x)).collect();
        let limits = ConicLimits {
            iterations: limits.iterations,
            time: limits.time,
        };
        let failure = match self.qp.solve(&f, &b, &offsets, limits) {
            Ok(solution) => {
                self.plan = Some(solution.z.clone());
                return Ok(Answer {
                    violation: self.qp.violation(&b, &offsets, &solution.z),
                    z: solution.z,
                    optimal: true,
                    iterations: solution.iterations,
                });
            }
            Err(Failure::Infeasible(proof)) => return Err(Failure::Infeasible(proof)),
            Err(failure) => failure,
        };
        let Some(candidate) = self.plan.as_ref().map(|plan| self.shifted(plan)) else {
            return Err(failure);
        };
        let violation = self.qp.violation(&b, &offsets, &candidate);
        if !(violation <= FITS) {
            return Err(failure);
        }
        self.plan = Some(candidate.clone());
        Ok(Answer {
            z: candidate,
            optimal: false,
            iterations: match failure {
                Failure::Unsolved { iterations, .. } => iterations,
                Failure::Infeasible(_) => 0,
            },
            violation,
        })
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

/// The solver of a controller's steps.
pub(crate) enum Solver {
    /// Rows alone.
    Rows(Box<OnlineSolver>),
    /// Rows and cones.
    Cones(Box<ConicSolver>),
}

impl Solver {
    /// `inputs` m is the size of one stage; `stages` N of them stand before θ.
    pub(crate) fn new(
        program: Program,
        cones: Vec<ProgramCone>,
        inputs: usize,
        stages: usize,
    ) -> Result<Self, DesignError> {
        Ok(if cones.is_empty() {
            Self::Rows(Box::new(OnlineSolver::new(program, inputs, stages)?))
        } else {
            Self::Cones(Box::new(ConicSolver::new(program, cones, inputs, stages)?))
        })
    }

    pub(crate) fn program(&self) -> &Program {
        match self {
            Self::Rows(solver) => solver.program(),
            Self::Cones(solver) => &solver.program,
        }
    }

    /// The cones of the program.
    pub(crate) fn cones(&self) -> &[ProgramCone] {
        match self {
            Self::Rows(_) => &[],
            Self::Cones(solver) => &solver.cones,
        }
    }

    /// Forgets the last solution.
    pub(crate) fn reset(&mut self) {
        match self {
            Self::Rows(solver) => solver.reset(),
            Self::Cones(solver) => solver.plan = None,
        }
    }

    /// f and b of the program at (x, r).
    pub(crate) fn linear_and_bounds(&self, x: &[f64], r: &[f64]) -> (Vec<f64>, Vec<f64>) {
        self.program().linear_and_bounds(x, r)
    }

    /// The checked optimum at (x, r); the shifted candidate when there is none.
    pub(crate) fn solve(
        &mut self,
        x: &[f64],
        r: &[f64],
        limits: Limits,
    ) -> Result<Answer, Failure> {
        match self {
            Self::Rows(solver) => solver.solve(x, r, limits),
            Self::Cones(solver) => solver.solve(x, r, limits),
        }
    }
}
