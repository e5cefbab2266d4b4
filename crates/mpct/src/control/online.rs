//! The runtime's solver on the desk: the same code as on the target, with buffers from the heap.
//!
//! Its optima and its proofs are checked here from the data of the program. When a check fails, or the solver gives up,
//! the interior-point method of a library is asked for a second opinion, and its answer is checked the same way.

use crate::error::DesignError;
use crate::linalg::Dense;
use crate::optimization::verify::{self, Farkas};
use crate::optimization::{Failure, PreparedQp};
use mpct_runtime as runtime;

/// Data of min ½ zᵀHz + (F_x x + F_r r)ᵀz subject to G z ≤ 1 − V x.
pub(crate) struct Program {
    pub(crate) hessian: Dense,
    pub(crate) from_state: Dense,
    pub(crate) from_set_point: Dense,
    pub(crate) rows: Dense,
    pub(crate) state_rows: Dense,
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

/// Largest residual of an optimum that is accepted, relative as in [`verify::Residuals`].
const ACCEPTED: f64 = 1e-8;
/// A Farkas ray must exclude every solution below this norm, in units in which rows have right-hand sides of one.
const FARKAS_RADIUS: f64 = 1e6;

/// How one solve may end early.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Limits {
    pub(crate) iterations: Option<u32>,
    pub(crate) time: Option<std::time::Duration>,
}

/// A point and what it is worth.
pub(crate) struct Answer {
    pub(crate) z: Vec<f64>,
    pub(crate) optimal: bool,
    pub(crate) iterations: usize,
    /// Largest violation of a row.
    pub(crate) violation: f64,
}

/// A family of programs, and the memory of the last one solved.
pub(crate) struct OnlineSolver {
    program: Program,
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
            input_rows: 0,
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
        let data = runtime::QpData {
            dims,
            hessian: &padded(&program.hessian, nz, nz, 1.0),
            linear_state: &padded(&program.from_state, nz, states, 0.0),
            linear_set_point: &padded(&program.from_set_point, nz, set_point, 0.0),
            rows: &padded(&program.rows, rows, nz, 0.0),
            rows_state: &padded(&negated, rows, states, 0.0),
            // The desk forms the input from z itself.
            gain: &vec![0.0; inputs * states],
            feedforward: &vec![0.0; inputs * inputs],
            input_rows: &[],
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
        let stamp = prepared.stamp();
        let workspace =
            runtime::Workspace::new(dims, &mut numbers, &mut indices).map_err(failed)?;
        let memory = runtime::Controller::new(prepared, workspace)
            .map_err(failed)?
            .suspend();
        Ok(Self {
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

    /// The checked optimum at (x, r); the shifted candidate when the limits end the solve before it.
    pub(crate) fn solve(
        &mut self,
        x: &[f64],
        r: &[f64],
        limits: Limits,
    ) -> Result<Answer, Failure> {
        let (f, b) = self.program.linear_and_bounds(x, r);
        let unsolved = Failure::Unsolved {
            iterations: 0,
            residual: f64::INFINITY,
        };
        let Some(mut controller) = resume(
            self.stamp,
            &self.tables,
            &mut self.numbers,
            &mut self.indices,
            self.memory,
        ) else {
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
        let nz = self.variables;
        let step = controller.step(x, r, budget).map(|step| Answer {
            z: step.solution[..nz].to_vec(),
            optimal: step.status == runtime::StepStatus::Optimal,
            iterations: step.iterations as usize,
            violation: step.violation,
        });
        let sparse: Vec<(usize, f64)> = match &step {
            Ok(answer) if answer.optimal => controller.multipliers().collect(),
            Err(runtime::StepError::Infeasible { .. }) => controller.proof().collect(),
            _ => Vec::new(),
        };
        self.memory = controller.suspend();
        let mut y = vec![0.0; b.len()];
        for (row, multiplier) in sparse {
            y[row] = multiplier;
        }
        let limited = limits != Limits::default();
        match step {
            Ok(answer) if answer.optimal => {
                let p = &self.program;
                let residuals = verify::residuals(&p.hessian, &f, &p.rows, &b, &answer.z, &y);
                if residuals.within(ACCEPTED) {
                    return Ok(answer);
                }
            }
            Ok(answer) if limited => return Ok(answer),
            Err(runtime::StepError::NoCandidate { .. }) if limited => return Err(unsolved),
            Err(runtime::StepError::Infeasible { .. }) => {
                if let Some(proof) = self.proof(&b, &y) {
                    return Err(Failure::Infeasible(proof));
                }
            }
            _ => {}
        }
        self.ask_again(&f, &b)
    }

    fn proof(&self, b: &[f64], y: &[f64]) -> Option<Farkas> {
        verify::farkas(&self.program.rows, b, y).filter(|p| p.radius >= FARKAS_RADIUS)
    }

    /// The library's interior-point method.
    fn ask_again(&mut self, f: &[f64], b: &[f64]) -> Result<Answer, Failure> {
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
        let solution = qp.solve(f, b)?;
        Ok(Answer {
            z: solution.z,
            optimal: true,
            iterations: solution.iterations,
            violation: 0.0,
        })
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
