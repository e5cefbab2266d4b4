//! The runtime's banded regime on the desk: the same code as on a target, with buffers from the heap.
//!
//! As in `online.rs`, every optimum and every proof is checked from the data of the program by code that shares nothing with
//! the solver.

use super::local_order::{Order, order};
use super::local_program::{LocalProgram, condense_locally};
use super::local_tables::OwnedTables;
use super::online::{Answer, Limits, Program};
use super::prediction::RowOrigin;
use crate::error::DesignError;
use crate::linalg;
use crate::matrix::SparseMatrix;
use crate::optimization::verify::Farkas;
use crate::optimization::{Failure, PreparedQp, verify_pairs};
use crate::problem::{Formulation, Task};
use crate::terminal::TerminalIngredients;
use mpct_runtime as runtime;
use mpct_runtime::banded::BandedController;

/// Fewer variables, and the dense regime is faster: see `benchmarks/results/closed_loop.md`.
const LEAST_VARIABLES: usize = 100;
/// Rows that reach further than this share of the variables leave nothing to exploit.
const LARGEST_SHARE: f64 = 0.5;
/// Plants whose A + B K is fuller than this are not looked at.
const FULL: f64 = 0.6;
/// Largest residual of an optimum that is accepted, as in `online.rs`.
const ACCEPTED: f64 = 1e-8;
/// A Farkas ray must exclude every solution below this norm, as in `online.rs`.
const FARKAS_RADIUS: f64 = 1e6;
/// Entries of the dense matrices up to which the interior-point method is asked for a second opinion.
const SECOND_OPINION: usize = 1_000_000;

/// A program of many subsystems, and the memory of the last solution.
pub(crate) struct LocalSolver {
    program: LocalProgram,
    order: Order,
    tables: OwnedTables,
    controller: BandedController<f64, Vec<f64>, Vec<u32>>,
    /// For each row of the program as it is told to others: pair and side.
    rows: Vec<(u32, u8)>,
    /// The whole program with full matrices, when somebody asks for it.
    full: std::sync::OnceLock<Program>,
    second_opinion: Option<PreparedQp>,
}

fn failed(e: runtime::TableError) -> DesignError {
    DesignError::Solver {
        what: "the tables of the online solver".into(),
        detail: e.to_string(),
    }
}

impl LocalSolver {
    /// The solver and the origin of its rows; `None` when the plant has no structure to exploit, or is small.
    pub(crate) fn new(
        ingredients: &TerminalIngredients,
        formulation: Formulation,
    ) -> Result<Option<(Self, Vec<RowOrigin>)>, DesignError> {
        let problem = ingredients.problem();
        let (m, stages) = (problem.plant().inputs(), problem.prediction_horizon());
        let parameters = usize::from(problem.task() == Task::Tracking);
        if (stages + parameters) * m < LEAST_VARIABLES
            || ingredients.sparse_law().closed_loop.share() > FULL
        {
            return Ok(None);
        }
        let Some(program) = condense_locally(ingredients, formulation)? else {
            return Ok(None);
        };
        let order = order(&program, m, stages);
        let tables = OwnedTables::new(&program, &order, ingredients, stages);
        if tables.mean_window() > LARGEST_SHARE * program.hessian.rows() as f64 {
            return Ok(None);
        }
        let view = tables.view().map_err(failed)?;
        view.check_values().map_err(failed)?;
        let (numbers, indices) = (
            vec![0.0; view.workspace_len()],
            vec![0; view.index_len()],
        );
        let controller = BandedController::new(&view, numbers, indices).map_err(failed)?;
        let (mut rows, mut origin) = (Vec::new(), Vec::new());
        for (pair, sides) in program.sides.iter().enumerate() {
            for (k, side) in sides.iter().enumerate() {
                if let Some(side) = side {
                    rows.push((pair as u32, k as u8));
                    origin.push(side.origin);
                }
            }
        }
        Ok(Some((
            Self {
                program,
                order,
                tables,
                controller,
                rows,
                full: std::sync::OnceLock::new(),
                second_opinion: None,
            },
            origin,
        )))
    }

    pub(crate) fn variables(&self) -> usize {
        self.program.hessian.rows()
    }

    pub(crate) fn rows(&self) -> usize {
        self.rows.len()
    }

    /// Forgets the last solution.
    pub(crate) fn reset(&mut self) {
        if let Ok(view) = self.tables.view() {
            self.controller.reset(&view);
        }
    }

    /// Row k as the program tells it: G and V times this factor have right-hand side 1.
    fn factor(&self, k: usize) -> (usize, f64) {
        let (pair, side) = self.rows[k];
        let pair = pair as usize;
        match self.program.sides[pair][side as usize] {
            Some(s) if side == 0 => (pair, 1.0 / s.bound),
            Some(s) => (pair, -1.0 / s.bound),
            None => (pair, 0.0),
        }
    }

    /// The program with full matrices.
    pub(crate) fn program(&self) -> &Program {
        self.full.get_or_init(|| {
            let spread = |m: &SparseMatrix| {
                let mut out = linalg::Dense::zeros(self.rows.len(), m.cols());
                for k in 0..self.rows.len() {
                    let (pair, factor) = self.factor(k);
                    for (j, v) in m.row(pair) {
                        out[(k, j)] = factor * v;
                    }
                }
                out
            };
            Program {
                hessian: linalg::dense(&self.program.hessian),
                from_state: linalg::dense(&self.program.from_state),
                from_set_point: linalg::dense(&self.program.from_set_point),
                rows: spread(&self.program.rows),
                state_rows: spread(&self.program.state_rows),
            }
        })
    }

    /// f and b of the program at (x, r).
    pub(crate) fn linear_and_bounds(&self, x: &[f64], r: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let v = self.program.state_rows.mul_vec(x);
        let b = (0..self.rows.len())
            .map(|k| {
                let (pair, factor) = self.factor(k);
                1.0 - factor * v[pair]
            })
            .collect();
        (self.linear(x, r), b)
    }

    fn linear(&self, x: &[f64], r: &[f64]) -> Vec<f64> {
        let mut f = self.program.from_state.mul_vec(x);
        for (f, v) in f.iter_mut().zip(self.program.from_set_point.mul_vec(r)) {
            *f += v;
        }
        f
    }

    /// The checked optimum at (x, r); the shifted candidate when the limits end the solve before it.
    pub(crate) fn solve(&mut self, x: &[f64], r: &[f64], limits: Limits) -> Result<Answer, Failure> {
        let unsolved = Failure::Unsolved {
            iterations: 0,
            residual: f64::INFINITY,
        };
        let Ok(view) = self.tables.view() else {
            return Err(unsolved);
        };
        let started = std::time::Instant::now();
        let mut late = || limits.time.is_some_and(|t| started.elapsed() >= t);
        let mut budget = limits
            .iterations
            .map_or_else(runtime::Budget::unlimited, runtime::Budget::iterations);
        if limits.time.is_some() {
            budget = budget.until(&mut late);
        }
        let size = self.order.variables.len();
        let step = self.controller.step(&view, x, r, budget).map(|step| {
            let mut z = vec![0.0; size];
            for (&v, &value) in self.order.variables.iter().zip(step.solution) {
                z[v as usize] = value;
            }
            Answer {
                z,
                optimal: step.status == runtime::StepStatus::Optimal,
                iterations: step.iterations as usize,
                violation: step.violation,
            }
        });
        let mut y = vec![0.0; self.program.sides.len()];
        let place = |pair: usize| self.order.pairs[pair] as usize;
        match &step {
            Ok(answer) if answer.optimal => {
                for (pair, value) in self.controller.multipliers(&view) {
                    y[place(pair)] = value;
                }
            }
            Err(runtime::StepError::Infeasible { .. }) => {
                for (pair, value) in self.controller.proof(&view) {
                    y[place(pair)] = value;
                }
            }
            _ => {}
        }
        let limited = limits != Limits::default();
        match step {
            Ok(answer) if answer.optimal => {
                let p = &self.program;
                let checked = verify_pairs::residuals(
                    &p.hessian,
                    &self.linear(x, r),
                    &self.pairs(x),
                    &answer.z,
                    &y,
                );
                if checked.within(ACCEPTED) {
                    return Ok(answer);
                }
            }
            Ok(answer) if limited => return Ok(answer),
            Err(runtime::StepError::NoCandidate { .. }) if limited => return Err(unsolved),
            Err(runtime::StepError::Infeasible { .. }) => {
                if let Some(proof) = verify_pairs::farkas(&self.pairs(x), &y)
                    .filter(|p: &Farkas| p.radius >= FARKAS_RADIUS)
                {
                    return Err(Failure::Infeasible(proof));
                }
            }
            _ => {}
        }
        self.ask_again(x, r)
    }

    /// The rows at a state, for the checks.
    fn pairs(&self, x: &[f64]) -> verify_pairs::Pairs<'_> {
        let bound = |k: usize| {
            self.program
                .sides
                .iter()
                .map(|s| s[k].map_or(f64::INFINITY, |s| s.bound))
                .collect()
        };
        verify_pairs::Pairs {
            rows: &self.program.rows,
            from_state: self.program.state_rows.mul_vec(x),
            upper: bound(0),
            lower: bound(1),
        }
    }

    /// A library's interior-point method, where its matrices are of a size for it.
    fn ask_again(&mut self, x: &[f64], r: &[f64]) -> Result<Answer, Failure> {
        let unsolved = Failure::Unsolved {
            iterations: 0,
            residual: f64::INFINITY,
        };
        if self.rows.len() * self.variables() > SECOND_OPINION {
            return Err(unsolved);
        }
        let (f, b) = self.linear_and_bounds(x, r);
        if self.second_opinion.is_none() {
            let p = self.program();
            let prepared =
                PreparedQp::new("the second opinion", p.hessian.clone(), p.rows.clone());
            self.second_opinion = prepared.ok();
        }
        let solution = match &self.second_opinion {
            Some(qp) => qp.solve(&f, &b)?,
            None => return Err(unsolved),
        };
        Ok(Answer {
            z: solution.z,
            optimal: true,
            iterations: solution.iterations,
            violation: 0.0,
        })
    }
}
