//! The runtime's banded regime on the desk: the same code as on a target, with buffers from the heap.
//!
//! As in `online.rs`, every optimum and every proof is checked from the data of the program by code that shares nothing with
//! the solver.

use super::local_order::{Order, order};
use super::local_program::{LocalProgram, Side, condense_locally};
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
/// Largest residual of an optimum that is accepted, as in `online.rs`.
const ACCEPTED: f64 = 1e-8;
/// A Farkas ray must exclude every solution below this norm, as in `online.rs`.
const FARKAS_RADIUS: f64 = 1e6;
/// A point that violates no row by more than this counts as feasible, as in `online.rs`.
const FEASIBLE: f64 = 1e-8;
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
    /// Upper and lower bound of each pair.
    bounds: [Vec<f64>; 2],
    /// The whole program with full matrices, when somebody asks for it.
    full: std::sync::OnceLock<Program>,
    second_opinion: Option<PreparedQp>,
    /// Rows and multipliers that proved the last step infeasible.
    proof: Vec<(usize, f64)>,
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
        if (stages + parameters) * m < LEAST_VARIABLES {
            return Ok(None);
        }
        let Some(program) = condense_locally(ingredients, formulation)? else {
            return Ok(None);
        };
        if program.rows.share() > LARGEST_SHARE {
            return Ok(None);
        }
        let order = order(&program, m, stages);
        let tables = OwnedTables::new(&program, &order, ingredients, stages);
        if tables.mean_window() > LARGEST_SHARE * program.hessian.rows() as f64 {
            return Ok(None);
        }
        let view = tables.view().map_err(failed)?;
        view.check_values().map_err(failed)?;
        let (numbers, indices) = (vec![0.0; view.workspace_len()], vec![0; view.index_len()]);
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
        let bounds = [0, 1].map(|k: usize| {
            let side = |s: &[Option<_>; 2]| s[k].map_or(f64::INFINITY, |s: Side| s.bound);
            program.sides.iter().map(side).collect()
        });
        Ok(Some((
            Self {
                bounds,
                program,
                order,
                tables,
                controller,
                rows,
                full: std::sync::OnceLock::new(),
                second_opinion: None,
                proof: Vec::new(),
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

    /// The runtime's tables.
    pub(crate) fn tables(&self) -> Option<runtime::banded::BandedTables<'_, f64>> {
        self.tables.view().ok()
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
                law: None,
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

    /// Rows and multipliers that prove the last step infeasible; empty unless it was.
    pub(crate) fn proof(&self) -> &[(usize, f64)] {
        &self.proof
    }

    /// The checked optimum at (x, r); the shifted candidate when the limits end the solve before it, or when nobody finds an
    /// optimum and the candidate is feasible.
    pub(crate) fn solve(
        &mut self,
        x: &[f64],
        r: &[f64],
        limits: Limits,
    ) -> Result<Answer, Failure> {
        let unsolved = Failure::Unsolved {
            iterations: 0,
            residual: f64::INFINITY,
        };
        self.proof.clear();
        let Ok(view) = self.tables.view() else {
            return Err(unsolved);
        };
        let started = limits.time.map(|limit| (std::time::Instant::now(), limit));
        let mut late = || started.is_some_and(|(start, limit)| start.elapsed() >= limit);
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
                input: step.input.to_vec(),
                why: match step.status {
                    runtime::StepStatus::Optimal => None,
                    runtime::StepStatus::Candidate(why) => Some(why),
                },
                iterations: step.iterations as usize,
                violation: f64::INFINITY,
            }
        });
        let mut y = vec![0.0; self.program.sides.len()];
        let place = |pair: usize| self.order.pairs[pair] as usize;
        match &step {
            Ok(answer) if answer.why.is_none() => {
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
        let mut fallback = None;
        match step {
            Ok(mut answer) => {
                let checked = verify_pairs::residuals(
                    &self.program.hessian,
                    &self.linear(x, r),
                    &self.pairs(x),
                    &answer.z,
                    &y,
                );
                answer.violation = checked.primal;
                match answer.why {
                    None if checked.within(ACCEPTED) => return Ok(answer),
                    None => answer.why = Some(runtime::Why::SolverFailed),
                    Some(runtime::Why::SolverFailed) => {}
                    Some(_) => return Ok(answer),
                }
                fallback = Some(answer);
            }
            Err(runtime::StepError::NoCandidate { why }) if why != runtime::Why::SolverFailed => {
                return Err(unsolved);
            }
            Err(runtime::StepError::Infeasible { .. }) => {
                let proof = verify_pairs::farkas(&self.pairs(x), &y);
                if let Some(proof) = proof.filter(|p: &Farkas| p.radius >= FARKAS_RADIUS) {
                    self.proof = self.by_rows(&y);
                    return Err(Failure::Infeasible(proof));
                }
            }
            Err(_) => {}
        }
        match (self.ask_again(x, r), fallback) {
            (Err(Failure::Unsolved { .. }), Some(answer)) if answer.violation <= FEASIBLE => {
                Ok(answer)
            }
            (other, _) => other,
        }
    }

    /// Multipliers of pairs as multipliers of the rows that others are told.
    fn by_rows(&self, y: &[f64]) -> Vec<(usize, f64)> {
        (0..self.rows.len())
            .filter_map(|k| {
                let (pair, factor) = self.factor(k);
                let multiplier = y[pair] / factor;
                (multiplier > 0.0 && multiplier.is_finite()).then_some((k, multiplier))
            })
            .collect()
    }

    /// The rows at a state, for the checks.
    fn pairs(&self, x: &[f64]) -> verify_pairs::Pairs<'_> {
        verify_pairs::Pairs {
            rows: &self.program.rows,
            from_state: self.program.state_rows.mul_vec(x),
            upper: &self.bounds[0],
            lower: &self.bounds[1],
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
            let prepared = PreparedQp::new("the second opinion", p.hessian.clone(), p.rows.clone());
            self.second_opinion = prepared.ok();
        }
        let solution = match &self.second_opinion {
            Some(qp) => qp.solve(&f, &b)?,
            None => return Err(unsolved),
        };
        // What the controller's own solver would shift next time is not what is applied now.
        self.reset();
        let zero = vec![0.0; self.program.sides.len()];
        let checked = verify_pairs::residuals(
            &self.program.hessian,
            &f,
            &self.pairs(x),
            &solution.z,
            &zero,
        );
        Ok(Answer {
            input: self.tables.first_input(&self.order, x, &solution.z),
            z: solution.z,
            why: None,
            iterations: solution.iterations,
            violation: checked.primal,
        })
    }
}
