//! The dual active-set method of Goldfarb and Idnani (1983) for the least-distance problem
//! `min ½|w|²  s.t.  M w ≤ d`, started from any working set.
//!
//! At every moment `H z + f + G_Wᵀ λ = 0` with `λ ≥ 0`: the optimum of a problem with fewer or looser rows, so its cost is a lower bound
//! that only grows. Two moves:
//!
//! - *settle*: correct `z` by the residual of this equation, then move `λ` until `G_W z = b_W`. When a multiplier would
//!   become negative, stop there, drop its row, go on. This leads from the solution of the past to the new data, and at the
//!   end it is the iterative refinement. Everything is a correction to `z`, so rounding errors are relative to the
//!   solution and not to the (far larger) minimum without rows; this is what makes `f32` work.
//! - *add* the most violated row `j`: raise its multiplier and keep the working set active until either row `j` is satisfied
//!   with equality (it enters), or another multiplier reaches zero (it leaves), or nothing stops the growth (infeasible).
//!
//! As in Arnström, Bemporad and Axehill (2022) the factors are of the Gram matrix of the working set, `L D Lᵀ`. They depend on the
//! working set only, hence survive from one sampling instant to the next and a warm start costs no factorisation.

use crate::dense::{all_finite, axpy, gemv_add, max_abs};
use crate::gram::Gram;
use crate::proof::proof_radius;
use crate::tables::NO_ROW;
use crate::walk::{reply, walk};
use crate::{Budget, Scalar, Tables, Workspace};

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outcome<T> {
    Optimal { violation: T },
    Infeasible { radius: T },
    IterationLimit,
    Deadline,
    Failed,
}

/// Additions in a row that may fail to raise the lower bound before the solver calls it cycling.
/// Fewer, and a heap of parallel rows would be taken for a cycle; more only wastes time.
const STALLED: u32 = 30;
/// Corrections in one settling before the factors are suspected. Two suffice when they are sound.
const CORRECTIONS: u32 = 4;

/// Why the inner moves end the solve.
pub(crate) enum Stop<T> {
    Budget(Outcome<T>),
    Trouble,
}

/// Computes `f` for the new data. What depends on the set-point only is kept while it stays.
pub(crate) fn load<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &mut Workspace<'_, T>,
    x: &[T],
    r: &[T],
    fresh: bool,
) {
    ws.has_jumped = fresh || ws.set_point != r;
    if ws.has_jumped {
        ws.set_point.copy_from_slice(r);
        ws.linear_set_point.fill(T::ZERO);
        let from = tables.found.linear_from[1];
        gemv_add(
            &tables.linear_set_point[from * r.len()..],
            r,
            &mut ws.linear_set_point[from..],
        );
    }
    ws.x.copy_from_slice(x);
    ws.linear.copy_from_slice(ws.linear_set_point);
    let from = tables.found.linear_from[0];
    gemv_add(
        &tables.linear_state[from * x.len()..],
        x,
        &mut ws.linear[from..],
    );
    let distance = ws.pricing.measure(x);
    ws.is_still = !ws.has_jumped && distance <= T::REFINE;
}

/// Solves the problem loaded by [`load`]. Iterations are counted in `iterations`.
pub(crate) fn solve<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &mut Workspace<'_, T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Outcome<T> {
    // A second attempt starts from nothing: neither old factors nor old multipliers.
    for attempt in 0..2 {
        if attempt > 0 || ws.factor.is_worn() {
            if attempt > 0 {
                ws.factor.clear();
                ws.z.fill(T::ZERO);
            } else {
                let Workspace {
                    factor,
                    half,
                    a,
                    rho,
                    m,
                    ..
                } = ws;
                factor.rebuild(half, a, rho, m);
                // Rebuilding keeps the order unless a row proved dependent; then no multiplier is known.
                ws.lambda.fill(T::ZERO);
            }
            ws.pricing.forget();
        }
        // The second attempt goes by the rows alone.
        let gram = if attempt == 0 { tables.gram } else { None };
        match run(tables, gram, ws, budget, iterations) {
            Ok(outcome) | Err(Stop::Budget(outcome)) => return outcome,
            Err(Stop::Trouble) => {}
        }
    }
    ws.factor.clear();
    ws.z.fill(T::ZERO);
    ws.pricing.forget();
    Outcome::Failed
}

fn run<T: Scalar>(
    tables: &Tables<'_, T>,
    gram: Option<Gram<'_, T>>,
    ws: &mut Workspace<'_, T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<Outcome<T>, Stop<T>> {
    let (mut gained, mut stalled, mut is_settled, mut settlings) = (T::ZERO, 0, true, 0);
    if budget.is_over() {
        return Err(Stop::Budget(Outcome::Deadline));
    }
    // After a jump the working set will change: the products find the new one before `z` is touched. In a quiet loop the bounds of the
    // pricing are cheaper still, as long as they rule most rows out.
    let mut gram = gram;
    let is_quiet = !ws.has_jumped && !ws.pricing.knows_nothing();
    // At rest the last solution is the solution, as settling sees at once.
    let stays = is_quiet && (ws.is_still || gram.is_some_and(|gram| reply(tables, &gram, ws)));
    if !stays
        && let Some(gram) = gram.take()
        && let Some(outcome) = walk_and_settle(tables, &gram, ws, budget, iterations)?
    {
        return Ok(outcome);
    }
    settle(tables, ws, budget, iterations)?;
    loop {
        let priced = ws
            .pricing
            .price(tables, ws.z, ws.factor.index(), gram.is_some());
        if priced.broken {
            return Err(Stop::Trouble);
        }
        if priced.worst.is_some() || priced.is_spared {
            is_settled = false;
            if let Some(gram) = gram.take() {
                match walk_and_settle(tables, &gram, ws, budget, iterations)? {
                    Some(outcome) => return Ok(outcome),
                    None => continue,
                }
            }
        }
        let Some((row, q)) = priced.worst else {
            // Refine after changes. Where the arithmetic cannot meet the tolerances every settling moves `z` a little.
            if !is_settled && settlings < 3 {
                settlings += 1;
                is_settled = !settle(tables, ws, budget, iterations)?;
                continue;
            }
            return Ok(optimal(tables, ws, priced.violation));
        };
        settlings = 0;
        match add(tables, ws, row, q, budget, iterations)? {
            Added::Entered { gain } => {
                // The lower bound must grow; when it does not for long, rounding is running in circles.
                if !gain.is_finite() {
                    return Err(Stop::Trouble);
                }
                stalled = if gain > T::EPSILON * gained {
                    0
                } else {
                    stalled + 1
                };
                gained += gain;
                if stalled > STALLED {
                    return Err(Stop::Trouble);
                }
            }
            Added::Infeasible(radius) => return Ok(Outcome::Infeasible { radius }),
            // Dependent, nothing to drop, and no proof: rounding hides whether the problem is feasible.
            Added::Undecided => return Err(Stop::Trouble),
        }
    }
}

/// Finds the working set by the products of rows, and `z` with it. The outcome, when no row needs to be looked at any more.
fn walk_and_settle<T: Scalar>(
    tables: &Tables<'_, T>,
    gram: &Gram<'_, T>,
    ws: &mut Workspace<'_, T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<Option<Outcome<T>>, Stop<T>> {
    let vouched = walk(tables, gram, ws, budget, iterations)?;
    let has_moved = settle(tables, ws, budget, iterations)?;
    Ok(vouched
        .filter(|_| !has_moved)
        .map(|vouched| optimal(tables, ws, vouched.violation)))
}

/// The optimum, whose largest violation outside the working set is known. Settling left the residuals of the working set in `half`.
fn optimal<T: Scalar>(tables: &Tables<'_, T>, ws: &Workspace<'_, T>, outside: T) -> Outcome<T> {
    let mut violation = outside;
    for (&row, &q) in ws.factor.index().iter().zip(ws.half.iter()) {
        violation = violation.max(q / tables.scale[row as usize]);
    }
    Outcome::Optimal { violation }
}

/// `gradient = H z + f`, `rho = H z + f + G_Wᵀ λ`. Returns `‖rho‖_∞` over the size of its terms, the larger of the `c` part and the
/// `θ` part: the offset cost makes the terms of `θ` so large that an error in `c` would vanish beside them.
fn stationarity<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>) -> T {
    ws.gradient.fill(T::ZERO);
    tables.hessian_mul_add(ws.z, ws.gradient);
    let split = ws.z.len() - tables.dims.inputs;
    let z_max = max_abs(ws.z);
    let mut size_c = max_abs(&ws.linear[..split])
        .max(tables.found.hessian_max[0] * z_max)
        .max(T::ONE);
    let mut size_theta = max_abs(&ws.linear[split..])
        .max(tables.found.hessian_max[1] * z_max)
        .max(T::ONE);
    axpy(T::ONE, ws.linear, ws.gradient);
    ws.rho.copy_from_slice(ws.gradient);
    for (&row, &multiplier) in ws.factor.index().iter().zip(ws.lambda.iter()) {
        let row = row as usize;
        axpy(multiplier, tables.g_row(row), ws.rho);
        size_c = size_c.max(multiplier * tables.reach[0][row]);
        size_theta = size_theta.max(multiplier * tables.reach[1][row]);
    }
    let (c, theta) = ws.rho.split_at(split);
    let (in_c, in_theta) = (max_abs(c) / size_c, max_abs(theta) / size_theta);
    // NaN (∞ over ∞) must come out as the larger one.
    if in_c <= in_theta || in_theta.is_nan() {
        in_theta
    } else {
        in_c
    }
}

/// `q_W = G_W z − b_W` into `a` and `half`. Returns the largest error in units of right-hand sides, over the size of these.
fn activity<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>) -> T {
    let (mut error, mut size) = (T::ZERO, T::ONE);
    for i in 0..ws.factor.len() {
        let row = ws.factor.index()[i] as usize;
        let q = ws.pricing.residual(tables, row, ws.z);
        (ws.half[i], ws.a[i]) = (q, q);
        error = error.max(q.abs() / tables.scale[row]);
        size = size.max(ws.pricing.bound(tables, row).abs() / tables.scale[row]);
    }
    error / size
}

/// Brings `H z + f + G_Wᵀλ` and `G_W z − b_W` to zero. Returns whether `z` moved. Leaves `H z + f` in `gradient`, the residuals of
/// the working set in `half`, and the stationarity in the workspace.
fn settle<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &mut Workspace<'_, T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<bool, Stop<T>> {
    let mut corrections = 0;
    loop {
        ws.stationarity = stationarity(tables, ws);
        // Far from stationary: `z` moves before the rows matter.
        let is_far = !(ws.stationarity <= T::STATIONARY) && corrections == 0;
        let error = if is_far {
            T::ZERO
        } else {
            activity(tables, ws)
        };
        if ws.stationarity <= T::STATIONARY && error <= T::REFINE {
            return Ok(corrections > 0);
        }
        if !all_finite(&[ws.stationarity, error]) || !all_finite(ws.z) {
            return Err(Stop::Trouble);
        }
        if corrections > CORRECTIONS {
            // As accurate as the numbers allow, or the factors are wrong.
            let usable = ws.stationarity <= T::PRIMAL && error <= T::PRIMAL;
            return if usable { Ok(true) } else { Err(Stop::Trouble) };
        }
        corrections += 1;
        // z −= H⁻¹ρ, unless ρ is rounding already: in f32 that would only disturb the active rows.
        if !(ws.stationarity <= T::STATIONARY) {
            tables.root_transpose_mul(ws.rho, ws.m);
            subtract_root(tables, ws.m, T::ONE, ws.direction, ws.z);
        }
        while ws.factor.len() > 0 {
            activity(tables, ws);
            ws.factor.solve(ws.a);
            // λ + t a ≥ 0.
            let (mut t, mut blocking) = (T::ONE, None);
            for i in 0..ws.factor.len() {
                if ws.lambda[i] + t * ws.a[i] < T::ZERO {
                    t = ws.lambda[i] / -ws.a[i];
                    blocking = Some(i);
                }
            }
            for i in 0..ws.factor.len() {
                // `z` takes the movement itself, not the difference of rounded multipliers: these may be 10⁶ times larger.
                ws.a[i] = t * ws.a[i];
                ws.lambda[i] = (ws.lambda[i] + ws.a[i]).max(T::ZERO);
            }
            ws.m.fill(T::ZERO);
            ws.factor.subtract(ws.a, ws.m);
            subtract_root(tables, ws.m, -T::ONE, ws.direction, ws.z);
            let Some(i) = blocking else { break };
            spend(budget, iterations)?;
            drop_row(tables, ws, i);
            corrections = 1;
        }
    }
}

/// `z −= t R⁻¹ m`.
fn subtract_root<T: Scalar>(
    tables: &Tables<'_, T>,
    m: &[T],
    t: T,
    direction: &mut [T],
    z: &mut [T],
) {
    direction.fill(T::ZERO);
    tables.root_mul_add(m, direction);
    for (zi, &d) in z.iter_mut().zip(direction.iter()) {
        let moved = *zi - t * d;
        // What a correction leaves of a number that should be zero shrinks from step to step.
        *zi = if moved.abs() < T::TINY {
            T::ZERO
        } else {
            moved
        };
    }
}

enum Added<T> {
    /// And raised the lower bound by `gain`.
    Entered {
        gain: T,
    },
    Infeasible(T),
    Undecided,
}

/// Brings row `j`, violated by `q`, into the working set.
fn add<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &mut Workspace<'_, T>,
    j: usize,
    mut q: T,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<Added<T>, Stop<T>> {
    tables.root_transpose_mul(tables.g_row(j), ws.m);
    let (mut lambda_j, mut gain) = (T::ZERO, T::ZERO);
    loop {
        spend(budget, iterations)?;
        let p = ws.factor.project(ws.m, ws.half, ws.a, ws.rho);
        let independent = p.outside > T::DEPENDENT * p.length;
        // Largest step: until a multiplier reaches zero, or row j is active.
        let (mut t, mut blocking) = (T::INFINITY, None);
        for i in 0..ws.factor.len() {
            if ws.a[i] > T::ZERO && ws.lambda[i] < t * ws.a[i] {
                t = ws.lambda[i] / ws.a[i];
                blocking = Some(i);
            }
        }
        if independent && q / p.outside <= t {
            t = q / p.outside;
            blocking = None;
        } else if blocking.is_none() {
            return Ok(prove(tables, ws, j).map_or(Added::Undecided, Added::Infeasible));
        }
        for i in 0..ws.factor.len() {
            ws.lambda[i] = (ws.lambda[i] - t * ws.a[i]).max(T::ZERO);
        }
        lambda_j += t;
        if independent {
            subtract_root(tables, ws.rho, t, ws.direction, ws.z);
            gain += t * (q - T::HALF * t * p.outside);
            q -= t * p.outside;
        } else {
            gain += t * q;
        }
        if !all_finite(&[t, q, lambda_j]) {
            return Err(Stop::Trouble);
        }
        if let Some(i) = blocking {
            drop_row(tables, ws, i);
            continue;
        }
        let k = ws.factor.len();
        if !ws.factor.append(j as u32, ws.m, ws.half, p.outside) {
            return Err(Stop::Trouble);
        }
        ws.lambda[k] = lambda_j;
        ws.pricing.hide(tables, j);
        return Ok(Added::Entered { gain });
    }
}

/// Row `j = M_Wᵀ a` with `a ≤ 0`: `y = (−a, 1)` is the candidate of a proof.
fn prove<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>, j: usize) -> Option<T> {
    let k = ws.factor.len();
    ws.proof_rows[..k].copy_from_slice(ws.factor.index());
    ws.proof_rows[k] = j as u32;
    for i in 0..k {
        ws.proof[i] = (-ws.a[i]).max(T::ZERO);
    }
    ws.proof[k] = T::ONE;
    let radius = proof_radius(tables, ws.x, &ws.proof_rows[..=k], &ws.proof[..=k], ws.rho);
    ws.proof_len = if radius.is_some() { k + 1 } else { 0 };
    radius
}

/// The row at position `i` leaves; its multiplier goes with it.
pub(crate) fn drop_row<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>, i: usize) {
    let k = ws.factor.len();
    ws.pricing.show(tables, ws.factor.index()[i] as usize);
    ws.factor.remove(i);
    ws.lambda.copy_within(i + 1..k, i);
}

/// One iteration of the budget.
pub(crate) fn spend<T>(budget: &mut Budget<'_>, iterations: &mut u32) -> Result<(), Stop<T>> {
    if *iterations >= budget.iterations {
        return Err(Stop::Budget(Outcome::IterationLimit));
    }
    if budget.is_over() {
        return Err(Stop::Budget(Outcome::Deadline));
    }
    *iterations += 1;
    Ok(())
}

/// Loads a claimed working set. Rows that do not exist, repeat or depend on others are skipped.
pub(crate) fn warm_start<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &mut Workspace<'_, T>,
    rows: &mut dyn Iterator<Item = u32>,
) {
    ws.factor.clear();
    ws.pricing.forget();
    ws.lambda.fill(T::ZERO);
    for row in rows {
        push_row(tables, ws, row, T::ZERO);
    }
}

/// Moves working set and multipliers one stage earlier, where the shifted solution has them.
pub(crate) fn shift_working_set<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &mut Workspace<'_, T>,
    shift: &[u32],
) {
    let k = ws.factor.len();
    ws.proof_len = 0;
    ws.proof_rows[..k].copy_from_slice(ws.factor.index());
    ws.proof[..k].copy_from_slice(&ws.lambda[..k]);
    ws.factor.clear();
    ws.pricing.forget();
    for i in 0..k {
        let row = shift
            .get(ws.proof_rows[i] as usize)
            .copied()
            .unwrap_or(NO_ROW);
        let multiplier = ws.proof[i];
        push_row(tables, ws, row, multiplier);
    }
}

/// Adds a row without looking at the solution; skips what does not exist, repeats, or depends on the others.
fn push_row<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>, row: u32, multiplier: T) {
    let k = ws.factor.len();
    if row as usize >= tables.dims.rows
        || k == tables.dims.variables()
        || ws.factor.index().contains(&row)
    {
        return;
    }
    tables.root_transpose_mul(tables.g_row(row as usize), ws.m);
    let p = ws.factor.project(ws.m, ws.half, ws.a, ws.rho);
    if p.outside > T::DEPENDENT * p.length && ws.factor.append(row, ws.m, ws.half, p.outside) {
        ws.lambda[k] = multiplier;
    }
}
