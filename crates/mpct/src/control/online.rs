//! The runtime's solver on the desk: the same code as on the target, with buffers from the heap.
//!
//! Its optima and its proofs are checked here from the data of the program. When a check fails, or the solver gives up,
//! the interior-point method of a library is asked for a second opinion, and its answer is checked the same way.

use crate::error::DesignError;
use crate::linalg::Dense;
use crate::optimization::{Checker, Failure, PreparedQp, dot};
use mpct_runtime as runtime;

/// Data of min ½ zᵀHz + (F_x x + F_r r)ᵀz subject to G z ≤ 1 − V x.
pub(crate) struct Program {
    pub(crate) hessian: Dense,
    pub(crate) from_state: Dense,
    pub(crate) from_set_point: Dense,
    pub(crate) rows: Dense,
    pub(crate) state_rows: Dense,
    /// How the first input follows; `None` when nobody asks for it.
    pub(crate) law: Option<InputLaw>,
}

impl Program {
    /// f and b of the program at (x, r).
    pub(crate) fn linear_and_bounds(&self, x: &[f64], r: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut f = vec![0.0; self.hessian.nrows()];
        accumulate(&mut f, &self.from_state, x, 1.0);
        accumulate(&mut f, &self.from_set_point, r, 1.0);
        let mut b = vec![1.0; self.rows.nrows()];
        accumulate(&mut b, &self.state_rows, x, -1.0);
        (f, b)
    }
}

/// u = K x + L θ + c_0, and U = {u : E u ≤ 1, ‖G_k u + h_k‖ ≤ 1}.
pub(crate) struct InputLaw {
    pub(crate) gain: Dense,
    pub(crate) feedforward: Dense,
    pub(crate) input_rows: Dense,
    /// G_k and h_k of the ellipsoids that speak of the input alone.
    pub(crate) input_norms: Vec<(Dense, Vec<f64>)>,
}

impl InputLaw {
    /// The first input of z with N stages, drawn towards 0 if rounding, or a candidate, has left it outside of U.
    pub(crate) fn input(&self, x: &[f64], z: &[f64], stages: usize) -> Vec<f64> {
        let m = self.gain.nrows();
        let mut u: Vec<f64> = if stages > 0 {
            z[..m].to_vec()
        } else {
            vec![0.0; m]
        };
        accumulate(&mut u, &self.gain, x, 1.0);
        accumulate(&mut u, &self.feedforward, &z[stages * m..], 1.0);
        let mut rows = vec![0.0; self.input_rows.nrows()];
        accumulate(&mut rows, &self.input_rows, &u, 1.0);
        let mut outside = rows.iter().fold(1.0_f64, |a, &v| a.max(v));
        for (g, h) in &self.input_norms {
            let mut gu = vec![0.0; h.len()];
            accumulate(&mut gu, g, &u, 1.0);
            outside = outside.max(beyond(&gu, h));
        }
        u.iter().map(|v| v / outside).collect()
    }
}

/// The number t ≥ 1 by which v must be divided so that ‖v/t + h‖ ≤ 1, where ‖h‖ < 1: the positive root of
/// (1 − ‖h‖²) t² − 2 hᵀv t − ‖v‖² = 0.
pub(super) fn beyond(v: &[f64], h: &[f64]) -> f64 {
    let room = 1.0 - dot(h, h);
    let along = dot(h, v);
    let t = (along + (along * along + room * dot(v, v)).sqrt()) / room;
    t.max(1.0)
}

/// Largest residual of an optimum that is accepted, relative as in [`Residuals`](crate::optimization::verify::Residuals).
const ACCEPTED: f64 = 1e-8;
/// A Farkas ray must exclude every solution below this norm, in units in which rows have right-hand sides of one.
const FARKAS_RADIUS: f64 = 1e6;

/// Products of rows are stored up to this length. 6 000 numbers stay near the processor; the 69 000 of a drone made its steps a quarter slower
/// (`step_time` example of the runtime).
const PRODUCTS: usize = 8_000;

/// A point that violates no row by more than this counts as feasible. Right-hand sides are one; a predicted state that the plant
/// meets to rounding is off by less.
const FEASIBLE: f64 = 1e-8;

/// How one solve may end early.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Limits {
    pub(crate) iterations: Option<u32>,
    pub(crate) time: Option<std::time::Duration>,
}

/// A point and what it is worth.
pub(crate) struct Answer {
    pub(crate) z: Vec<f64>,
    /// The first input, in U; without entries when the program has no [`InputLaw`].
    pub(crate) input: Vec<f64>,
    /// Why it is not the optimum; `None` for the optimum.
    pub(crate) why: Option<runtime::Why>,
    pub(crate) iterations: usize,
    /// Largest violation of a row, checked.
    pub(crate) violation: f64,
}

/// A family of programs, and the memory of the last one solved.
pub(crate) struct OnlineSolver {
    program: Program,
    checker: Checker,
    /// Rows and multipliers of the last optimum or proof.
    multipliers: Vec<(usize, f64)>,
    /// Whether `multipliers` prove that the last step had no solution.
    is_proof: bool,
    /// Prepared when it is first needed.
    second_opinion: Option<PreparedQp>,
    /// Variables of the program; the runtime's may be more, for its θ.
    variables: usize,
    stamp: runtime::TablesStamp<f64>,
    tables: Vec<f64>,
    numbers: Vec<f64>,
    indices: Vec<u32>,
    memory: runtime::Memory<f64>,
}

impl OnlineSolver {
    /// `inputs` m is the size of one stage; `stages` N of them stand before θ. A program without θ gets one that is zero.
    pub(crate) fn new(program: Program, inputs: usize, stages: usize) -> Result<Self, DesignError> {
        let variables = program.hessian.nrows();
        let (rows, states) = (program.rows.nrows(), program.from_state.ncols());
        let set_point = program.from_set_point.ncols();
        let dims = runtime::Dims {
            states,
            inputs,
            horizon: stages,
            set_point,
            rows,
            input_rows: program.law.as_ref().map_or(0, |l| l.input_rows.nrows()),
        };
        let nz = dims.variables();
        let padded = |m: &Dense, rows: usize, columns: usize, diagonal: f64| -> Vec<f64> {
            let mut out = vec![0.0; rows * columns];
            for i in 0..rows {
                for j in 0..columns {
                    out[i * columns + j] = if i < m.nrows() && j < m.ncols() {
                        m[(i, j)]
                    } else if i == j {
                        diagonal
                    } else {
                        0.0
                    };
                }
            }
            out
        };
        let negated = &program.state_rows * faer::Scale(-1.0);
        let empty = InputLaw {
            gain: Dense::zeros(inputs, states),
            feedforward: Dense::zeros(inputs, inputs),
            input_rows: Dense::zeros(0, inputs),
            input_norms: Vec::new(),
        };
        let law = program.law.as_ref().unwrap_or(&empty);
        let data = runtime::QpData {
            dims,
            hessian: &padded(&program.hessian, nz, nz, 1.0),
            linear_state: &padded(&program.from_state, nz, states, 0.0),
            linear_set_point: &padded(&program.from_set_point, nz, set_point, 0.0),
            rows: &padded(&program.rows, rows, nz, 0.0),
            rows_state: &padded(&negated, rows, states, 0.0),
            gain: &padded(&law.gain, inputs, states, 0.0),
            feedforward: &padded(&law.feedforward, inputs, inputs, 0.0),
            input_rows: &padded(&law.input_rows, law.input_rows.nrows(), inputs, 0.0),
        };
        let failed = |e: runtime::TableError| DesignError::Solver {
            what: "the tables of the online solver".into(),
            detail: e.to_string(),
        };
        let mut tables = vec![0.0; dims.tables_len()];
        let mut numbers = vec![0.0; dims.workspace_len()];
        let mut indices = vec![0; dims.index_len()];
        let prepared = runtime::prepare(&data, &mut tables, &mut vec![0.0; dims.prepare_len()])
            .map_err(failed)?;
        let (mut stamp, length) = (prepared.stamp(), prepared.gram_len());
        if length <= PRODUCTS {
            let mut products = vec![0.0; length];
            runtime::prepare_gram(&prepared, &mut products).map_err(failed)?;
            tables.extend(products);
            stamp = runtime::Tables::from_slice(dims, &tables)
                .map_err(failed)?
                .stamp();
        }
        let prepared = runtime::Tables::reopen(stamp, &tables).map_err(failed)?;
        let workspace =
            runtime::Workspace::new(dims, &mut numbers, &mut indices).map_err(failed)?;
        let memory = runtime::Controller::new(prepared, workspace)
            .map_err(failed)?
            .suspend();
        Ok(Self {
            checker: Checker::new(
                &program.hessian,
                &program.from_state,
                &program.from_set_point,
                &program.rows,
                &program.state_rows,
            ),
            multipliers: Vec::new(),
            is_proof: false,
            program,
            second_opinion: None,
            variables,
            stamp,
            tables,
            numbers,
            indices,
            memory,
        })
    }

    pub(crate) fn program(&self) -> &Program {
        &self.program
    }

    /// The runtime's tables and their sizes.
    pub(crate) fn tables(&self) -> (runtime::Dims, &[f64]) {
        (self.stamp.dims(), &self.tables)
    }

    /// Rows and multipliers that prove the last step infeasible; empty unless it was.
    pub(crate) fn proof(&self) -> &[(usize, f64)] {
        if self.is_proof {
            &self.multipliers
        } else {
            &[]
        }
    }

    /// Forgets the last solution.
    pub(crate) fn reset(&mut self) {
        if let Some(mut controller) = resume(
            self.stamp,
            &self.tables,
            &mut self.numbers,
            &mut self.indices,
            self.memory,
        ) {
            controller.reset();
            self.memory = controller.suspend();
        }
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
        self.multipliers.clear();
        self.is_proof = false;
        let Some(mut controller) = resume(
            self.stamp,
            &self.tables,
            &mut self.numbers,
            &mut self.indices,
            self.memory,
        ) else {
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
        let nz = self.variables;
        let has_law = self.program.law.is_some();
        let step = controller.step(x, r, budget).map(|step| Answer {
            z: step.solution[..nz].to_vec(),
            input: if has_law {
                step.input.to_vec()
            } else {
                Vec::new()
            },
            why: match step.status {
                runtime::StepStatus::Optimal => None,
                runtime::StepStatus::Candidate(why) => Some(why),
            },
            iterations: step.iterations as usize,
            violation: f64::INFINITY,
        });
        match &step {
            Ok(answer) if answer.why.is_none() => self.multipliers.extend(controller.multipliers()),
            Err(runtime::StepError::Infeasible { .. }) => {
                self.multipliers.extend(controller.proof());
            }
            _ => {}
        }
        self.memory = controller.suspend();
        let mut fallback = None;
        match step {
            Ok(mut answer) if answer.why.is_none() => {
                let residuals = self.checker.residuals(x, r, &answer.z, &self.multipliers);
                answer.violation = residuals.primal;
                if residuals.within(ACCEPTED) {
                    return Ok(answer);
                }
                answer.why = Some(runtime::Why::SolverFailed);
                fallback = Some(answer);
            }
            Ok(mut answer) => {
                answer.violation = self.checker.violation(x, &answer.z);
                if answer.why != Some(runtime::Why::SolverFailed) {
                    return Ok(answer);
                }
                fallback = Some(answer);
            }
            Err(runtime::StepError::NoCandidate { why }) if why != runtime::Why::SolverFailed => {
                return Err(unsolved);
            }
            Err(runtime::StepError::Infeasible { .. }) => {
                let proof = self.checker.farkas(x, &self.multipliers);
                if let Some(proof) = proof.filter(|p| p.radius >= FARKAS_RADIUS) {
                    self.is_proof = true;
                    return Err(Failure::Infeasible(proof));
                }
            }
            Err(_) => {}
        }
        self.multipliers.clear();
        match (self.ask_again(x, r), fallback) {
            (Err(Failure::Unsolved { .. }), Some(answer)) if answer.violation <= FEASIBLE => {
                Ok(answer)
            }
            (other, _) => other,
        }
    }

    /// The library's interior-point method.
    fn ask_again(&mut self, x: &[f64], r: &[f64]) -> Result<Answer, Failure> {
        let (f, b) = self.program.linear_and_bounds(x, r);
        let qp = match &mut self.second_opinion {
            Some(qp) => qp,
            empty => {
                let p = &self.program;
                let prepared =
                    PreparedQp::new("the second opinion", p.hessian.clone(), p.rows.clone());
                empty.insert(prepared.map_err(|_| Failure::Unsolved {
                    iterations: 0,
                    residual: f64::INFINITY,
                })?)
            }
        };
        let solution = qp.solve(&f, &b)?;
        let (z, y) = (solution.z, solution.y);
        self.multipliers
            .extend(y.into_iter().enumerate().filter(|(_, y)| *y > 0.0));
        // The next candidate is the shift of what is applied now.
        if let Some(mut controller) = resume(
            self.stamp,
            &self.tables,
            &mut self.numbers,
            &mut self.indices,
            self.memory,
        ) {
            let mut plan = z.clone();
            plan.resize(self.stamp.dims().variables(), 0.0);
            controller.set_plan(&plan);
            self.memory = controller.suspend();
        }
        Ok(Answer {
            violation: self.checker.violation(x, &z),
            input: self.first_input(x, &z),
            z,
            why: None,
            iterations: solution.iterations,
        })
    }

    fn first_input(&self, x: &[f64], z: &[f64]) -> Vec<f64> {
        let law = self.program.law.as_ref();
        law.map_or_else(Vec::new, |law| law.input(x, z, self.stamp.dims().horizon))
    }
}

fn resume<'a>(
    stamp: runtime::TablesStamp<f64>,
    tables: &'a [f64],
    numbers: &'a mut [f64],
    indices: &'a mut [u32],
    memory: runtime::Memory<f64>,
) -> Option<runtime::Controller<'a, f64>> {
    let tables = runtime::Tables::reopen(stamp, tables).ok()?;
    runtime::Controller::resume(tables, numbers, indices, memory).ok()
}

/// out += factor · M v.
pub(super) fn accumulate(out: &mut [f64], m: &Dense, v: &[f64], factor: f64) {
    for (j, &vj) in v.iter().enumerate() {
        if vj != 0.0 {
            for (o, &c) in out.iter_mut().zip(m.col(j).iter()) {
                *o += factor * vj * c;
            }
        }
    }
}
