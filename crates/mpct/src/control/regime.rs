//! Three ways to solve a program online, chosen by what the problem is.
//!
//! The dense regime (`online.rs`) forms every row with all its entries. The banded regime (`local_solver.rs`) is for plants made of many
//! subsystems, whose rows touch a few neighbours each. Both run the runtime's solvers. A problem with ellipsoids, whatever its plant, has
//! second-order cones beside its rows and goes to the conic regime (`conic.rs`). All check every answer.

use super::cones::condense_cones;
use super::conic::{ConicSolver, ProgramCone};
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
    Conic(Box<ConicSolver>),
}

/// A solver, where its rows come from, and what its cost has besides (10).
pub(super) struct Online {
    pub(super) solver: Regime,
    pub(super) origin: Vec<RowOrigin>,
    /// The same for its cones; rows are ellipsoids there.
    pub(super) cone_origin: Vec<RowOrigin>,
    pub(super) extra: Option<ExtraCost>,
    /// The Hessian of the cost in the state, where it is known; 2 P without `extra`.
    pub(super) state_hessian: OnceLock<Dense>,
}

impl Regime {
    /// The solver for a formulation.
    pub(super) fn choose(
        ingredients: &TerminalIngredients,
        formulation: Formulation,
    ) -> Result<Online, DesignError> {
        if ingredients.problem().norms().is_empty()
            && let Some((solver, origin)) = LocalSolver::new(ingredients, formulation)?
        {
            return Ok(Online {
                solver: Self::Banded(Box::new(solver)),
                origin,
                cone_origin: Vec::new(),
                extra: None,
                state_hessian: OnceLock::new(),
            });
        }
        Self::full(ingredients, formulation)
    }

    /// The one with full matrices: dense, or conic where there are ellipsoids.
    pub(super) fn full(
        ingredients: &TerminalIngredients,
        formulation: Formulation,
    ) -> Result<Online, DesignError> {
        let problem = ingredients.problem();
        let (inputs, stages) = (problem.plant().inputs(), problem.prediction_horizon());
        let (cones, cone_origin) = condense_cones(ingredients, formulation)?;
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
            solver: Self::of_program(program, cones, inputs, stages)?,
            origin: condensed.origin,
            cone_origin,
            extra: condensed.extra,
            state_hessian: OnceLock::from(condensed.state_hessian),
        })
    }

    /// The solver of a program with full matrices. `inputs` m is the size of one stage; `stages` N of them stand before θ.
    pub(super) fn of_program(
        program: Program,
        cones: Vec<ProgramCone>,
        inputs: usize,
        stages: usize,
    ) -> Result<Self, DesignError> {
        Ok(if cones.is_empty() {
            Self::Dense(Box::new(OnlineSolver::new(program, inputs, stages)?))
        } else {
            Self::Conic(Box::new(ConicSolver::new(program, cones, inputs, stages)?))
        })
    }

    /// Variables of the program.
    pub(crate) fn variables(&self) -> usize {
        match self {
            Self::Dense(s) => s.program().hessian.nrows(),
            Self::Banded(s) => s.variables(),
            Self::Conic(s) => s.program().hessian.nrows(),
        }
    }

    /// Rows of the program.
    pub(crate) fn rows(&self) -> usize {
        match self {
            Self::Dense(s) => s.program().rows.nrows(),
            Self::Banded(s) => s.rows(),
            Self::Conic(s) => s.program().rows.nrows(),
        }
    }

    /// The cones of the program.
    pub(crate) fn cones(&self) -> &[ProgramCone] {
        match self {
            Self::Dense(_) | Self::Banded(_) => &[],
            Self::Conic(s) => s.cones(),
        }
    }

    /// The program with full matrices; made on the first call for the banded regime.
    pub(crate) fn program(&self) -> &Program {
        match self {
            Self::Dense(s) => s.program(),
            Self::Banded(s) => s.program(),
            Self::Conic(s) => s.program(),
        }
    }

    /// f and b of the program at (x, r).
    pub(crate) fn linear_and_bounds(&self, x: &[f64], r: &[f64]) -> (Vec<f64>, Vec<f64>) {
        match self {
            Self::Dense(s) => s.program().linear_and_bounds(x, r),
            Self::Banded(s) => s.linear_and_bounds(x, r),
            Self::Conic(s) => s.program().linear_and_bounds(x, r),
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
            Self::Conic(s) => s.solve(x, r, limits),
        }
    }

    /// Rows and multipliers that prove the last step infeasible; empty unless it was, and in the conic regime.
    pub(crate) fn proof(&self) -> &[(usize, f64)] {
        match self {
            Self::Dense(s) => s.proof(),
            Self::Banded(s) => s.proof(),
            Self::Conic(_) => &[],
        }
    }

    /// The dense tables of the runtime and their sizes.
    pub(crate) fn tables(&self) -> Option<(mpct_runtime::Dims, &[f64])> {
        match self {
            Self::Dense(s) => Some(s.tables()),
            Self::Banded(_) | Self::Conic(_) => None,
        }
    }

    /// The banded tables of the runtime.
    pub(crate) fn banded_tables(&self) -> Option<mpct_runtime::banded::BandedTables<'_, f64>> {
        match self {
            Self::Banded(s) => s.tables(),
            Self::Dense(_) | Self::Conic(_) => None,
        }
    }

    /// Forgets the last solution.
    pub(crate) fn reset(&mut self) {
        match self {
            Self::Dense(s) => s.reset(),
            Self::Banded(s) => s.reset(),
            Self::Conic(s) => s.reset(),
        }
    }
}

/// u = K x + L θ + c_0 with L = M_θu − K M_θx, and the rows and ellipsoids that speak of the input alone.
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
        input_norms: problem
            .norms()
            .iter()
            .filter(|b| (0..b.dimension()).all(|k| b.f.row(k).len() == 0))
            .map(|b| (linalg::dense(&b.g), b.offset.clone()))
            .collect(),
    }
}
