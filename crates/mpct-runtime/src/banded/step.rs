//! One sampling instant in the banded regime.

use super::solve::{Outcome, Solver};
use super::tables::BandedTables;
use super::workspace::{Parts, State, divide, sizes};
use crate::candidate::into_limits;
use crate::dense::{all_finite, axpy, dot};
use crate::tables::NO_ROW;
use crate::{Budget, Scalar, StepError, StepStatus, TableError, Why};

/// The result of a step.
#[derive(Clone, Copy, Debug)]
pub struct BandedStep<'s, T> {
    /// Optimum or candidate.
    pub status: StepStatus,
    /// `u`, length `m`. Always in `U` when the tables know `U`; 0 when the numbers do not reach for it.
    pub input: &'s [T],
    /// `z`, in the order of the tables.
    pub solution: &'s [T],
    /// `½ zᵀHz + fᵀz`; the terms that depend on `x` and `r` only are left out.
    pub cost: T,
    /// Rows that came or went one by one, and solutions on all active rows.
    pub iterations: u32,
    /// Of a candidate, the largest violation of a row, in units of right-hand sides. Of an optimum, the largest residual of
    /// an active row: at most [`Scalar::PRIMAL`] or the rounding of its terms, whichever is larger. Rows that are not active are
    /// violated by [`Scalar::PRIMAL`] at most.
    pub violation: T,
    /// `‖Hz + f + Gᵀy‖_∞` over the size of its terms; +∞ of a candidate.
    pub stationarity: T,
}

/// Memory and plan of a banded controller. Buffers are borrowed (`&mut [T]`) or owned (`Vec<T>`); the tables are lent to each
/// step and may lie in flash.
///
/// ```
/// use mpct_runtime::banded::{BandedController, BandedData, BandedTables, Windows};
/// use mpct_runtime::{Budget, NO_ROW, StepStatus};
/// // x⁺ = 0.8 x + u, K = −0.3, horizon 1, z = (c, θ); |K x + ½ θ + c| ≤ 1.
/// let tables = BandedTables::new(BandedData {
///     hessian: Windows::new(2, &[0, 1], &[0, 1, 2], &[2.0, 4.0]).unwrap(),
///     linear_state: Windows::new(1, &[0, 0], &[0, 1, 1], &[1.0]).unwrap(),
///     linear_set_point: Windows::new(1, &[0, 0], &[0, 0, 1], &[-4.0]).unwrap(),
///     rows: Windows::new(2, &[0], &[0, 2], &[1.0, 0.5]).unwrap(),
///     rows_state: Windows::new(1, &[0], &[0, 1], &[-0.3]).unwrap(),
///     upper: &[1.0],
///     lower: &[1.0],
///     scale: &[1.0],
///     groups: &[0, 1],
///     gain: Windows::new(1, &[0], &[0, 1], &[-0.3]).unwrap(),
///     first_input: Windows::new(2, &[0], &[0, 2], &[1.0, 0.5]).unwrap(),
///     input_rows: Windows::new(1, &[0, 0], &[0, 1, 2], &[1.0, -1.0]).unwrap(),
///     state_order: &[0],
///     set_point_order: &[0],
///     next_stage: &[NO_ROW, 1],
/// })
/// .unwrap();
/// tables.check_values().unwrap();
/// let numbers = vec![0.0_f64; tables.workspace_len()]; // or an array
/// let indices = vec![0; tables.index_len()];
/// let mut controller = BandedController::new(&tables, numbers, indices).unwrap();
/// let step = controller.step(&tables, &[0.2], &[4.0], Budget::unlimited()).unwrap();
/// assert_eq!(step.status, StepStatus::Optimal);
/// assert!((step.input[0] - 1.0).abs() < 1e-9); // the limit is active
/// assert!(controller.step(&tables, &[0.2], &[4.0], Budget::iterations(0)).is_ok());
/// ```
#[derive(Clone, Debug)]
pub struct BandedController<T, N, I> {
    numbers: N,
    indices: I,
    state: State<T>,
}

impl<T, N, I> BandedController<T, N, I>
where
    T: Scalar,
    N: AsRef<[T]> + AsMut<[T]>,
    I: AsRef<[u32]> + AsMut<[u32]>,
{
    /// A controller without a plan; `numbers` and `indices` have the lengths that the tables name.
    ///
    /// Errors: [`TableError::Length`].
    pub fn new(
        tables: &BandedTables<'_, T>,
        mut numbers: N,
        mut indices: I,
    ) -> Result<Self, TableError> {
        for (what, expected, found) in [
            (
                "workspace numbers",
                tables.workspace_len(),
                numbers.as_mut().len(),
            ),
            (
                "workspace indices",
                tables.index_len(),
                indices.as_mut().len(),
            ),
        ] {
            if expected != found {
                return Err(TableError::Length {
                    what,
                    expected,
                    found,
                });
            }
        }
        let mut controller = Self {
            numbers,
            indices,
            state: State::new(),
        };
        controller.reset(tables);
        Ok(controller)
    }

    /// Forgets the past: no plan, no active rows. Also to be called when the tables change.
    pub fn reset(&mut self, tables: &BandedTables<'_, T>) {
        self.state = State::new();
        if let Some(mut parts) = divide(tables, self.numbers.as_mut(), self.indices.as_mut()) {
            [self.state.longest, self.state.widest] = parts.clear(tables);
            self.state.sizes = sizes(tables);
        }
    }

    /// The input for the measured state `x` (length `n`) and the set-point `r`, both in the caller's order.
    ///
    /// Solves the problem; when the budget ends first, falls back to the shifted candidate (32). Time passes with every call, also with
    /// one that returns an error: the plan is shifted by one stage. `tables` must be those that the memory was made for; others of
    /// the same sizes give other inputs, and others are refused (without a shift of the plan).
    ///
    /// Errors: see [`StepError`].
    pub fn step(
        &mut self,
        tables: &BandedTables<'_, T>,
        x: &[T],
        r: &[T],
        mut budget: Budget<'_>,
    ) -> Result<BandedStep<'_, T>, StepError<T>> {
        let (expected, found) = (tables.workspace_len(), self.numbers.as_ref().len());
        let refused = StepError::WrongLength {
            what: "workspace",
            expected,
            found,
        };
        let state = &mut self.state;
        if state.sizes != sizes(tables) {
            return Err(refused);
        }
        let Some(mut parts) = divide(tables, self.numbers.as_mut(), self.indices.as_mut()) else {
            return Err(refused);
        };
        if state.has_plan {
            shift(tables, &mut parts);
        }
        state.is_optimum = false;
        state.has_proof = false;
        for (what, slice, expected) in [
            ("state", x, tables.states()),
            ("set-point", r, tables.set_point()),
        ] {
            if slice.len() != expected {
                return Err(StepError::WrongLength {
                    what,
                    expected,
                    found: slice.len(),
                });
            }
        }
        if let Some(index) = x.iter().position(|v| !v.is_finite()) {
            return Err(StepError::StateNotFinite { index });
        }
        if let Some(index) = r.iter().position(|v| !v.is_finite()) {
            return Err(StepError::SetPointNotFinite { index });
        }
        let limit = 20 * (2 * tables.pairs() + tables.variables()) as u64 + 1000;
        if u64::from(budget.iterations) > limit {
            budget.iterations = limit as u32;
        }
        let mut solver = Solver {
            tables,
            parts: &mut parts,
            state: &mut *state,
            iterations: 0,
        };
        solver.load(x, r);
        let outcome = solver.solve(&mut budget);
        let iterations = solver.iterations;
        let why = match outcome {
            Outcome::Optimal => {
                let cost = solver.cost();
                parts.plan.copy_from_slice(parts.z);
                (state.has_plan, state.is_optimum) = (true, true);
                let (violation, stationarity) = (state.violation, state.stationarity);
                return Ok(report(
                    tables,
                    parts,
                    StepStatus::Optimal,
                    cost,
                    iterations,
                    violation,
                    stationarity,
                ));
            }
            Outcome::Infeasible { radius } => return Err(StepError::Infeasible { radius }),
            Outcome::IterationLimit => Why::IterationLimit,
            Outcome::Deadline => Why::Deadline,
            Outcome::Failed => Why::SolverFailed,
        };
        if !state.has_plan {
            return Err(StepError::NoCandidate { why });
        }
        let violation = fall_back(tables, &mut parts, why);
        let cost = cost_of_plan(tables, &mut parts);
        Ok(report(
            tables,
            parts,
            StepStatus::Candidate(why),
            cost,
            iterations,
            violation,
            T::INFINITY,
        ))
    }

    /// The active pairs of the last step and their multipliers (of the rows as given, not scaled): positive of the upper row,
    /// negative of the lower. Empty unless the step was optimal. `Hz + f + Σ yᵢ Gᵢᵀ = 0`.
    pub fn multipliers<'s>(
        &'s self,
        tables: &'s BandedTables<'_, T>,
    ) -> impl Iterator<Item = (usize, T)> + 's {
        let (pairs, is_optimum) = (tables.pairs(), self.state.is_optimum);
        let y = self.vector(tables, Vector::Multipliers);
        let scale = tables.data.scale;
        (0..if is_optimum { pairs.min(y.len()) } else { 0 })
            .map(move |pair| (pair, y[pair] * scale[pair]))
            .filter(|e| e.1 != T::ZERO)
    }

    /// The pairs and multipliers that prove the last step infeasible, signed like [`BandedController::multipliers`]. Empty unless the last step returned
    /// [`StepError::Infeasible`].
    pub fn proof<'s>(
        &'s self,
        tables: &'s BandedTables<'_, T>,
    ) -> impl Iterator<Item = (usize, T)> + 's {
        let (pairs, has_proof) = (tables.pairs(), self.state.has_proof);
        let y = self.vector(tables, Vector::Proof);
        let scale = tables.data.scale;
        (0..if has_proof { pairs.min(y.len()) } else { 0 })
            .map(move |pair| (pair, y[pair] * scale[pair]))
            .filter(|e| e.1 != T::ZERO)
    }

    /// A vector of the workspace, by its place in [`divide`].
    fn vector(&self, tables: &BandedTables<'_, T>, which: Vector) -> &[T] {
        let numbers = self.numbers.as_ref();
        let (pairs, groups) = (tables.pairs(), tables.groups());
        let from_end = match which {
            Vector::Multipliers => 9 * pairs + 6 * groups + tables.weights(),
            Vector::Proof => 6 * pairs + 6 * groups + tables.weights(),
        };
        match numbers.len().checked_sub(from_end) {
            Some(at) if self.state.sizes == sizes(tables) => &numbers[at..at + pairs],
            _ => &[],
        }
    }
}

enum Vector {
    Multipliers,
    Proof,
}

/// The shifted candidate (32): (c_1, …, c_{N−1}, 0, θ).
fn shift<T: Scalar>(tables: &BandedTables<'_, T>, parts: &mut Parts<'_, T>) {
    parts.direction.copy_from_slice(parts.plan);
    for (to, &next) in parts.plan.iter_mut().zip(tables.data.next_stage) {
        *to = if next == NO_ROW {
            T::ZERO
        } else {
            parts.direction[next as usize]
        };
    }
}

/// Excess of the worse side of a pair at `z`, scaled.
fn excess<T: Scalar>(tables: &BandedTables<'_, T>, x: &[T], z: &[T], pair: usize) -> T {
    let d = &tables.data;
    let value = d.rows.dot(pair, z) + d.rows_state.dot(pair, x);
    let (upper, lower) = (value - d.upper[pair], -value - d.lower[pair]);
    if upper >= lower { upper } else { lower }
}

/// Checks the shifted plan at the measured state and, when it is feasible, moves it towards the point that the solver has reached as far
/// as all rows allow: that point costs less than the optimum, the cost is convex, so every point between costs no more than the plan.
/// Returns the violation of the plan.
fn fall_back<T: Scalar>(tables: &BandedTables<'_, T>, parts: &mut Parts<'_, T>, why: Why) -> T {
    let d = &tables.data;
    let mut violation = T::ZERO;
    for pair in 0..tables.pairs() {
        let found = excess(tables, parts.x, parts.plan, pair) / d.scale[pair];
        // −∞ of a pair without bounds.
        if !(found < T::INFINITY) {
            return T::INFINITY;
        }
        violation = violation.max(found);
    }
    if !(violation <= T::PRIMAL) || why == Why::SolverFailed || !all_finite(parts.z) {
        return violation;
    }
    // The point reached must cost less than the plan: an inner problem that was cut short promises that only up to its penalty.
    for ((to, &z), &plan) in parts
        .direction
        .iter_mut()
        .zip(parts.z.iter())
        .zip(parts.plan.iter())
    {
        *to = z - plan;
    }
    parts.gradient.copy_from_slice(parts.linear);
    super::windows::add_symmetric_product(&d.hessian, parts.plan, parts.gradient);
    let slope = dot(parts.gradient, parts.direction);
    parts.gradient.fill(T::ZERO);
    super::windows::add_symmetric_product(&d.hessian, parts.direction, parts.gradient);
    let curvature = dot(parts.gradient, parts.direction);
    if !(slope < T::ZERO) || !(curvature > T::ZERO) {
        return violation;
    }
    let mut t = T::ONE;
    if -slope < t * curvature {
        t = -slope / curvature;
    }
    for pair in 0..tables.pairs() {
        let rise = d.rows.dot(pair, parts.direction);
        let value = d.rows.dot(pair, parts.plan) + d.rows_state.dot(pair, parts.x);
        let (rise, slack) = if rise > T::ZERO {
            (rise, d.upper[pair] - value)
        } else if rise < T::ZERO {
            (-rise, d.lower[pair] + value)
        } else if rise == T::ZERO {
            continue;
        } else {
            return violation;
        };
        if !(slack > T::ZERO) {
            return violation;
        }
        if slack < t * rise {
            t = slack / rise;
        }
    }
    axpy(t, parts.direction, parts.plan);
    violation
}

/// `½ zᵀHz + fᵀz` of the plan.
fn cost_of_plan<T: Scalar>(tables: &BandedTables<'_, T>, parts: &mut Parts<'_, T>) -> T {
    let hessian = &tables.data.hessian;
    parts.direction.copy_from_slice(parts.linear);
    super::windows::add_symmetric_product(hessian, parts.plan, parts.direction);
    T::HALF * (dot(parts.plan, parts.direction) + dot(parts.plan, parts.linear))
}

/// The input of the plan.
fn report<'w, T: Scalar>(
    tables: &BandedTables<'_, T>,
    parts: Parts<'w, T>,
    status: StepStatus,
    cost: T,
    iterations: u32,
    violation: T,
    stationarity: T,
) -> BandedStep<'w, T> {
    let d = &tables.data;
    let Parts { plan, x, input, .. } = parts;
    input.fill(T::ZERO);
    d.gain.add_product(x, input);
    d.first_input.add_product(plan, input);
    into_limits(input, |input, each| {
        for row in 0..d.input_rows.rows() {
            each(d.input_rows.dot(row, input));
        }
    });
    BandedStep {
        status,
        input,
        solution: plan,
        cost,
        iterations,
        violation,
        stationarity,
    }
}
