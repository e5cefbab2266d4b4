//! Two ways to solve the same program online, chosen by what the plant is.
//!
//! The dense regime (`online.rs`) forms every row with all its entries. The banded regime (`local_solver.rs`) is for plants made of many
//! subsystems, whose rows touch a few neighbours each. Both run the runtime's solvers, and both check every answer.

use super::local_solver::LocalSolver;
use super::online::{Answer, Limits, OnlineSolver, Program};
use super::prediction::{RowOrigin, condense};
use super::terminal_cost::ExtraCost;
use crate::error::DesignError;
use crate::linalg::Dense;
use crate::optimization::Failure;
use crate::problem::Formulation;
use crate::terminal::TerminalIngredients;
use std::sync::OnceLock;

/// The solver of a controller.
pub(crate) enum Regime {
    Dense(Box<OnlineSolver>),
    Banded(Box<LocalSolver>),
}

/// A solver, where its rows come from, and what its cost has besides (10).
pub(super) struct Online {
    pub(super) solver: Regime,
    pub(super) origin: Vec<RowOrigin>,
    pub(super) extra: Option<ExtraCost>,
    /// The Hessian of the cost in the state, where it is known; 2 P without `extra`.
    pub(super) state_hessian: OnceLock<Dense>,
}

impl Regime {
    /// The solver for a formulation.
    pub(super) fn new(
        ingredients: &TerminalIngredients,
        formulation: Formulation,
    ) -> Result<Online, DesignError> {
        if let Some((solver, origin)) = LocalSolver::new(ingredients, formulation)? {
            return Ok(Online {
                solver: Self::Banded(Box::new(solver)),
                origin,
                extra: None,
                state_hessian: OnceLock::new(),
            });
        }
        Self::dense(ingredients, formulation)
    }

    /// The dense one.
    pub(super) fn dense(
        ingredients: &TerminalIngredients,
        formulation: Formulation,
    ) -> Result<Online, DesignError> {
        let problem = ingredients.problem();
        let (inputs, stages) = (problem.plant().inputs(), problem.prediction_horizon());
        let condensed = condense(ingredients, formulation)?;
        let program = Program {
            hessian: condensed.hessian,
            from_state: condensed.from_state,
            from_set_point: condensed.from_set_point,
            rows: condensed.rows,
            state_rows: condensed.state_rows,
        };
        Ok(Online {
            solver: Self::Dense(Box::new(OnlineSolver::new(program, inputs, stages)?)),
            origin: condensed.origin,
            extra: condensed.extra,
            state_hessian: OnceLock::from(condensed.state_hessian),
        })
    }

    /// Variables of the program.
    pub(crate) fn variables(&self) -> usize {
        match self {
            Self::Dense(s) => s.program().hessian.nrows(),
            Self::Banded(s) => s.variables(),
        }
    }

    /// Rows of the program.
    pub(crate) fn rows(&self) -> usize {
        match self {
            Self::Dense(s) => s.program().rows.nrows(),
            Self::Banded(s) => s.rows(),
        }
    }

    /// The program with full matrices; made on the first call for the banded regime.
    pub(crate) fn program(&self) -> &Program {
        match self {
            Self::Dense(s) => s.program(),
            Self::Banded(s) => s.program(),
        }
    }

    /// f and b of the program at (x, r).
    pub(crate) fn linear_and_bounds(&self, x: &[f64], r: &[f64]) -> (Vec<f64>, Vec<f64>) {
        match self {
            Self::Dense(s) => s.linear_and_bounds(x, r),
            Self::Banded(s) => s.linear_and_bounds(x, r),
        }
    }

    /// The checked optimum at (x, r); the shifted candidate when the limits end the solve before it.
    pub(crate) fn solve(
        &mut self,
        x: &[f64],
        r: &[f64],
        limits: Limits,
    ) -> Result<Answer, Failure> {
        match self {
            Self::Dense(s) => s.solve(x, r, limits),
            Self::Banded(s) => s.solve(x, r, limits),
        }
    }

    /// Forgets the last solution.
    pub(crate) fn reset(&mut self) {
        match self {
            Self::Dense(s) => s.reset(),
            Self::Banded(s) => s.reset(),
        }
    }
}
