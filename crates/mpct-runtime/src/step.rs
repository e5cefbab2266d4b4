//! One sampling instant: from the measured state and the set-point to the input.

use crate::active_set::{self, Outcome};
use crate::candidate::{advance, into_limits, shift_plan, violation};
use crate::dense::{all_finite, axpy, dot, gemv_add};
use crate::{Budget, Scalar, TableError, Tables, Workspace};

/// Where the solver starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum WarmStart {
    /// From the working set of the last step, whose factors still hold. No cost; best when the plant is sampled fast.
    #[default]
    Keep,
    /// From that working set moved one stage earlier by the shift map, where the shifted candidate has it. Costs its
    /// factorisation. Same as `Keep` when the tables have no shift map.
    Shift,
    /// From nothing.
    Cold,
}

/// Why a step returns the candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The iterations were used up.
    IterationLimit,
    /// The caller's clock said stop.
    Deadline,
    /// The arithmetic broke down, also on the second attempt from nothing.
    SolverFailed,
}

/// What the input of a step is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepStatus {
    /// The optimum of the problem.
    Optimal,
    /// The shifted candidate (32), or a point of lower cost between it and the lower bound reached. Look at [`Step::violation`]: 0 up to
    /// [`Scalar::PRIMAL`] means that Theorems 3 and 4 apply; more means that the measured state has left the prediction.
    Candidate(Why),
}

/// The result of a step.
#[derive(Clone, Copy, Debug)]
pub struct Step<'s, T> {
    /// Optimum or candidate.
    pub status: StepStatus,
    /// `u`, length `m`. Always in `U` when the tables know `U` (it is scaled towards 0 if it must be).
    pub input: &'s [T],
    /// `θ`, length `m`: the artificial set-point is `M_θ θ`.
    pub theta: &'s [T],
    /// `z = (c_0, …, c_{N−1}, θ)`.
    pub solution: &'s [T],
    /// `½ zᵀHz + fᵀz`; the terms that depend on `x` and `r` only are left out.
    pub cost: T,
    /// Changes of the working set.
    pub iterations: u32,
    /// `max(0, maxᵢ (G z − b(x))ᵢ)`. At an optimum at most [`Scalar::PRIMAL`] on rows that are not active, and within rounding,
    /// relative to `bᵢ(x)`, on those that are.
    pub violation: T,
    /// `‖Hz + f + Gᵀy‖_∞ / max(1, ‖f‖_∞, max|H|·‖z‖_∞, maxᵢ yᵢ‖Gᵢ‖)` of an optimum, the larger of the `c` part and the `θ` part; +∞ of a
    /// candidate, which has no multipliers.
    pub stationarity: T,
}

/// Why a step has no input. The controller stays usable; its plan is shifted as if its input had been applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepError<T> {
    /// `x[index]` is NaN or infinite.
    StateNotFinite {
        /// Which entry.
        index: usize,
    },
    /// `r[index]` is NaN or infinite.
    SetPointNotFinite {
        /// Which entry.
        index: usize,
    },
    /// A slice has the wrong length.
    WrongLength {
        /// Which slice.
        what: &'static str,
        /// Length asked for.
        expected: usize,
        /// Length found.
        found: usize,
    },
    /// No plan exists: [`Controller::proof`] returns multipliers `y ≥ 0` with `Gᵀy ≈ 0` and `b(x)ᵀy < 0`.
    Infeasible {
        /// There is no solution with `‖z‖₁` below this; infinite when `Gᵀy` vanishes exactly.
        radius: T,
    },
    /// The step was cut short and there was no earlier plan.
    NoCandidate {
        /// What cut it short.
        why: Why,
    },
}

impl<T: Scalar> core::fmt::Display for StepError<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::StateNotFinite { index } => write!(f, "state {index} is not finite"),
            Self::SetPointNotFinite { index } => write!(f, "set-point entry {index} is not finite"),
            Self::WrongLength {
                what,
                expected,
                found,
            } => write!(f, "{what} has length {found}, expected {expected}"),
            Self::Infeasible { radius } => {
                write!(
                    f,
                    "infeasible, proved for every solution with 1-norm below {:e}",
                    radius.to_f64()
                )
            }
            Self::NoCandidate {
                why: Why::IterationLimit,
            } => write!(f, "iteration limit, and no earlier plan"),
            Self::NoCandidate { why: Why::Deadline } => write!(f, "deadline, and no earlier plan"),
            Self::NoCandidate {
                why: Why::SolverFailed,
            } => write!(f, "the solver failed, and there is no earlier plan"),
        }
    }
}

impl<T: Scalar> core::error::Error for StepError<T> {}

/// Tables, memory and the plan in force.
///
/// ```
/// use mpct_runtime::{prepare, Budget, Controller, Dims, QpData, StepStatus, Workspace};
/// // x⁺ = 0.8 x + u, K = −0.3, horizon 1; two rows |K x + ½ θ + c_0| ≤ 1.
/// const DIMS: Dims = Dims { states: 1, inputs: 1, horizon: 1, set_point: 2, rows: 2, input_rows: 2 };
/// let data = QpData {
///     dims: DIMS,
///     hessian: &[2.0, 0.0, 0.0, 4.0],
///     linear_state: &[1.0, 0.0],
///     linear_set_point: &[0.0, 0.0, -4.0, 0.0],
///     rows: &[1.0, 0.5, -1.0, -0.5],
///     rows_state: &[0.3, -0.3],
///     gain: &[-0.3],
///     feedforward: &[0.5],
///     input_rows: &[1.0, -1.0],
/// };
/// let (mut buffer, mut scratch) = ([0.0_f64; DIMS.tables_len()], [0.0; DIMS.prepare_len()]);
/// let tables = prepare(&data, &mut buffer, &mut scratch).unwrap();
/// let (mut numbers, mut indices) = ([0.0; DIMS.workspace_len()], [0; DIMS.index_len()]);
/// let workspace = Workspace::new(DIMS, &mut numbers, &mut indices).unwrap();
/// let mut controller = Controller::new(tables, workspace).unwrap();
///
/// let step = controller.step(&[0.2], &[1.0, 0.2], Budget::unlimited()).unwrap();
/// assert_eq!(step.status, StepStatus::Optimal);
/// assert!(step.input[0].abs() <= 1.0);
/// assert!(controller.step(&[f64::NAN], &[1.0, 0.2], Budget::unlimited()).is_err());
/// assert!(controller.step(&[0.1], &[1.0, 0.2], Budget::iterations(0)).is_ok());
/// ```
#[derive(Debug)]
pub struct Controller<'a, T> {
    pub(crate) tables: Tables<'a, T>,
    pub(crate) ws: Workspace<'a, T>,
    pub(crate) warm_start: WarmStart,
    pub(crate) has_plan: bool,
    /// The multipliers belong to the plan.
    pub(crate) is_optimum: bool,
    /// Nothing was loaded since the last reset.
    pub(crate) is_fresh: bool,
    /// The caller's working set replaces the warm start of the next step.
    pub(crate) is_claimed: bool,
}

impl<'a, T: Scalar> Controller<'a, T> {
    /// A controller without a plan. Errors: the workspace was made for other dimensions.
    pub fn new(tables: Tables<'a, T>, workspace: Workspace<'a, T>) -> Result<Self, TableError> {
        if tables.dims != workspace.dims {
            let (expected, found) = (tables.dims.workspace_len(), workspace.dims.workspace_len());
            return Err(TableError::Length {
                what: "workspace",
                expected,
                found,
            });
        }
        let warm_start = WarmStart::default();
        let mut controller = Self {
            tables,
            ws: workspace,
            warm_start,
            has_plan: false,
            is_optimum: false,
            is_fresh: true,
            is_claimed: false,
        };
        controller.reset();
        Ok(controller)
    }

    /// Chooses where later steps start from.
    pub fn set_warm_start(&mut self, warm_start: WarmStart) {
        self.warm_start = warm_start;
    }

    /// Claims that `rows` will be active at the next solution. Any claim is harmless: rows that do not exist, repeat, depend on
    /// others or are not active after all are dropped.
    pub fn claim_active(&mut self, rows: &[u32]) {
        active_set::warm_start(&self.tables, &mut self.ws, &mut rows.iter().copied());
        self.is_claimed = true;
        self.is_optimum = false;
    }

    /// Takes another solver's solution as the plan in force. It is checked before it is used, as every candidate is.
    /// Without effect when the length is wrong or an entry is not finite.
    pub fn set_plan(&mut self, plan: &[T]) {
        if plan.len() == self.ws.plan.len() && all_finite(plan) {
            self.ws.plan.copy_from_slice(plan);
            (self.has_plan, self.is_optimum) = (true, false);
        }
    }

    /// Forgets the past: no plan, no working set.
    pub fn reset(&mut self) {
        self.ws.factor.clear();
        self.ws.pricing.forget();
        self.ws.lambda.fill(T::ZERO);
        self.ws.plan.fill(T::ZERO);
        self.ws.z.fill(T::ZERO);
        self.ws.proof_len = 0;
        (
            self.has_plan,
            self.is_optimum,
            self.is_fresh,
            self.is_claimed,
        ) = (false, false, true, false);
    }

    /// The input for the measured state `x` (length `n`) and the set-point `r` (length `nr`).
    ///
    /// Solves the problem; when the budget ends first, falls back to the shifted candidate. See [`StepStatus`] and [`StepError`].
    /// Time passes with every call, also with one that returns an error: the plan is shifted by one stage.
    pub fn step(
        &mut self,
        x: &[T],
        r: &[T],
        mut budget: Budget<'_>,
    ) -> Result<Step<'_, T>, StepError<T>> {
        let dims = self.tables.dims;
        if self.has_plan {
            shift_plan(self.ws.plan, dims.inputs);
        }
        self.is_optimum = false;
        self.ws.proof_len = 0;
        self.check("state", x, dims.states)?;
        self.check("set-point", r, dims.set_point)?;
        let first = |v: &[T]| v.iter().position(|v| !v.is_finite());
        if !all_finite(x)
            && let Some(index) = first(x)
        {
            return Err(StepError::StateNotFinite { index });
        }
        if !all_finite(r)
            && let Some(index) = first(r)
        {
            return Err(StepError::SetPointNotFinite { index });
        }

        match (self.is_claimed, self.warm_start, self.tables.shift) {
            (true, ..) | (_, WarmStart::Keep, _) | (_, WarmStart::Shift, None) => {}
            (_, WarmStart::Shift, Some(shift)) => {
                active_set::shift_working_set(&self.tables, &mut self.ws, shift)
            }
            (_, WarmStart::Cold, _) => {
                active_set::warm_start(&self.tables, &mut self.ws, &mut core::iter::empty())
            }
        }
        active_set::load(&self.tables, &mut self.ws, x, r, self.is_fresh);
        (self.is_fresh, self.is_claimed) = (false, false);

        let limit = 20 * (dims.rows + dims.variables()) as u64 + 1000;
        if u64::from(budget.iterations) > limit {
            budget.iterations = limit as u32;
        }
        let mut iterations = 0;
        let why = match active_set::solve(&self.tables, &mut self.ws, &mut budget, &mut iterations)
        {
            Outcome::Optimal { violation } => {
                self.ws.plan.copy_from_slice(self.ws.z);
                (self.has_plan, self.is_optimum) = (true, true);
                return Ok(self.report(StepStatus::Optimal, violation, iterations));
            }
            Outcome::Infeasible { radius } => return Err(StepError::Infeasible { radius }),
            Outcome::IterationLimit => Why::IterationLimit,
            Outcome::Deadline => Why::Deadline,
            Outcome::Failed => Why::SolverFailed,
        };
        if !self.has_plan {
            return Err(StepError::NoCandidate { why });
        }
        let violation = self.fall_back(why);
        Ok(self.report(StepStatus::Candidate(why), violation, iterations))
    }

    /// Checks the shifted plan at the measured state and improves it when it is feasible. Returns its violation.
    fn fall_back(&mut self, why: Why) -> T {
        let ws = &mut self.ws;
        let found = violation(&self.tables, ws.x, ws.plan);
        if found <= T::PRIMAL && why != Why::SolverFailed && all_finite(ws.z) {
            advance(&self.tables, ws.x, ws.z, ws.plan, ws.rho);
        }
        found
    }

    /// Input, cost and residuals of the plan.
    fn report(&mut self, status: StepStatus, violation: T, iterations: u32) -> Step<'_, T> {
        let (tables, ws, m) = (&self.tables, &mut self.ws, self.tables.dims.inputs);
        let theta_at = ws.plan.len() - m;
        // At an optimum settling left H z + f behind.
        if !self.is_optimum {
            ws.gradient.fill(T::ZERO);
            tables.hessian_mul_add(ws.plan, ws.gradient);
            axpy(T::ONE, ws.linear, ws.gradient);
        }
        let cost = T::HALF * (dot(ws.plan, ws.gradient) + dot(ws.plan, ws.linear));
        let stationarity = if self.is_optimum {
            ws.stationarity
        } else {
            T::INFINITY
        };

        ws.input.fill(T::ZERO);
        gemv_add(tables.gain, ws.x, ws.input);
        gemv_add(tables.feedforward, &ws.plan[theta_at..], ws.input);
        if theta_at > 0 {
            axpy(T::ONE, &ws.plan[..m], ws.input);
        }
        into_limits(ws.input, |input, each| {
            for row in tables.input_rows.chunks_exact(m) {
                each(dot(row, input));
            }
        });
        Step {
            status,
            input: ws.input,
            theta: &ws.plan[theta_at..],
            solution: ws.plan,
            cost,
            iterations,
            violation,
            stationarity,
        }
    }

    fn check(&self, what: &'static str, slice: &[T], expected: usize) -> Result<(), StepError<T>> {
        if slice.len() == expected {
            Ok(())
        } else {
            Err(StepError::WrongLength {
                what,
                expected,
                found: slice.len(),
            })
        }
    }

    /// The plan in force, `z`: the solution of the last step that had one. `None` before the first.
    pub fn plan(&self) -> Option<&[T]> {
        self.has_plan.then_some(&*self.ws.plan)
    }

    /// The active rows of the last step and their multipliers `yᵢ ≥ 0` (of the rows as given, not scaled).
    /// Empty unless the step was optimal. `Hz + f + Σ yᵢ Gᵢᵀ = 0`.
    pub fn multipliers(&self) -> impl Iterator<Item = (usize, T)> + '_ {
        let count = if self.is_optimum {
            self.ws.factor.len()
        } else {
            0
        };
        let rows = self.ws.factor.index()[..count]
            .iter()
            .zip(self.ws.lambda.iter());
        rows.map(|(&row, &multiplier)| (row as usize, multiplier * self.tables.scale[row as usize]))
    }

    /// The rows and multipliers `yᵢ ≥ 0` that prove the last step infeasible (of the rows as given, not scaled): `Gᵀy ≈ 0`, `b(x)ᵀy < 0`.
    /// Empty unless the last step returned [`StepError::Infeasible`].
    pub fn proof(&self) -> impl Iterator<Item = (usize, T)> + '_ {
        let rows = self.ws.proof_rows[..self.ws.proof_len]
            .iter()
            .zip(self.ws.proof.iter());
        rows.map(|(&row, &multiplier)| (row as usize, multiplier * self.tables.scale[row as usize]))
    }

    /// The tables.
    pub fn tables(&self) -> &Tables<'a, T> {
        &self.tables
    }
}
