//! The program of a controller, for analyses and other solvers.

use super::Controller;
use crate::analysis::ProgramRow;
use crate::control::conic::ProgramCone;
use crate::control::prediction::RowOrigin;
use crate::control::{SetPoint, Step};
use crate::error::StepError;
use crate::linalg::{self, Dense};
use crate::optimization::{Failure, PreparedQp};

impl Controller {
    /// The cones of the program, in shifted coordinates.
    pub(crate) fn program_cones(&self) -> &[ProgramCone] {
        self.solver.cones()
    }

    /// W and G of the program's rows W x + G z ≤ 1, in shifted coordinates.
    pub(crate) fn program_rows(&self) -> (&Dense, &Dense) {
        let program = self.solver.program();
        (&program.state_rows, &program.rows)
    }

    /// H, F_x, F_r and the Hessian in the state: the cost is ½ zᵀHz + (F_x x + F_r r)ᵀz + ½ xᵀ H_x x + a constant of r.
    pub(crate) fn program_cost(&self) -> (&Dense, &Dense, &Dense, &Dense) {
        let p = self.solver.program();
        (
            &p.hessian,
            &p.from_state,
            &p.from_set_point,
            self.state_hessian.get_or_init(|| {
                linalg::dense(&self.ingredients.sparse_law().weight) * faer::Scale(2.0)
            }),
        )
    }

    /// The checked optimum at a state by another solver than the controller's own, without taking a step. `qp` holds the
    /// program's H and G.
    pub(crate) fn evaluate(
        &self,
        qp: &PreparedQp,
        state: &[f64],
        set_point: &SetPoint,
    ) -> Result<Step, StepError> {
        let (x, r) = self.shifted(state, set_point)?;
        let z = self.optimum(qp, state, set_point)?;
        Ok(self.describe(&x, &r, &z))
    }

    /// z of that optimum.
    pub(crate) fn optimum(
        &self,
        qp: &PreparedQp,
        state: &[f64],
        set_point: &SetPoint,
    ) -> Result<Vec<f64>, StepError> {
        let (x, r) = self.shifted(state, set_point)?;
        let (f, b) = self.solver.linear_and_bounds(&x, &r);
        match qp.solve(&f, &b) {
            Ok(solution) => Ok(solution.z),
            Err(Failure::Infeasible(proof)) => Err(StepError::Infeasible {
                gap: proof.gap,
                radius: proof.radius,
            }),
            Err(Failure::Unsolved {
                iterations,
                residual,
            }) => Err(StepError::IterationLimit {
                iterations,
                residual,
            }),
        }
    }

    /// What each of them comes from.
    pub(crate) fn program_row_names(&self) -> Vec<ProgramRow> {
        let problem = self.ingredients.problem();
        let horizon = problem.prediction_horizon();
        let source = &problem.rows().source;
        let named = |row: usize, step| ProgramRow {
            source: source[row],
            step,
        };
        self.origin
            .iter()
            .map(|origin| match *origin {
                RowOrigin::Stage { row, step } => named(row, Some(step)),
                RowOrigin::Terminal { row, step } => named(row, Some(horizon + step)),
                RowOrigin::Equilibrium { row } => named(row, None),
            })
            .collect()
    }

    /// What each of its cones comes from.
    pub(crate) fn program_cone_names(&self) -> Vec<ProgramRow> {
        let horizon = self.ingredients.problem().prediction_horizon();
        let norms = self.ingredients.problem().norms();
        let named = |k: usize, step| ProgramRow {
            source: norms[k].source,
            step,
        };
        self.cone_origin
            .iter()
            .map(|origin| match *origin {
                RowOrigin::Stage { row, step } => named(row, Some(step)),
                RowOrigin::Terminal { row, step } => named(row, Some(horizon + step)),
                RowOrigin::Equilibrium { row } => named(row, None),
            })
            .collect()
    }
}
