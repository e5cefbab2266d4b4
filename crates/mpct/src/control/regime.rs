//! Two ways to solve the same program online, chosen by what the plant is.
//!
//! The dense regime (`online.rs`) forms every row with all its entries. The banded regime (`local_solver.rs`) is for plants made of many
//! subsystems, whose rows touch a few neighbours each. Both run the runtime's solvers, and both check every answer.

use super::local_solver::LocalSolver;
use super::online::{Answer, InputLaw, Limits, OnlineSolver, Program};
use super::prediction::{RowOrigin, condense};
use super::terminal_cost::ExtraCost;
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::optimization::Failure;
use crate::problem::{Formulation, Task};
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
            law: Some(input_law(ingredients)),
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

    /// Rows and multipliers that prove the last step infeasible; empty unless it was.
    pub(crate) fn proof(&self) -> &[(usize, f64)] {
        match self {
            Self::Dense(s) => s.proof(),
            Self::Banded(s) => s.proof(),
        }
    }

    /// The dense tables of the runtime and their sizes.
    pub(crate) fn tables(&self) -> Option<(mpct_runtime::Dims, &[f64])> {
        match self {
            Self::Dense(s) => Some(s.tables()),
            Self::Banded(_) => None,
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

/// u = K x + L θ + c_0 with L = M_θu − K M_θx, and the rows that speak of the input alone.
fn input_law(ingredients: &TerminalIngredients) -> InputLaw {
    let problem = ingredients.problem();
    let rows = problem.rows();
    let steady = ingredients.steady_states();
    let gain = &ingredients.law().gain;
    let feedforward = match problem.task() {
        Task::Tracking => {
            linalg::dense(steady.input_basis()) - gain * linalg::dense(steady.state_basis())
        }
        Task::Regulation => Dense::zeros(gain.nrows(), gain.nrows()),
    };
    let of_input: Vec<usize> = (0..rows.len())
        .filter(|&i| rows.c.row(i).len() == 0 && rows.d.row(i).len() > 0)
        .collect();
    InputLaw {
        gain: gain.clone(),
        feedforward,
        input_rows: linalg::dense(&rows.d.select_rows(&of_input)),
    }
}
