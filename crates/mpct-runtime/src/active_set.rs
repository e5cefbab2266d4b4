//! The dual active-set method of Goldfarb and Idnani (1983) for the least-distance problem
//! `min ½|w|²  s.t.  M w ≤ d`, started from any working set.
//!
//! At every moment `w = −M_Wᵀ λ` with `λ ≥ 0`: the optimum of a problem with fewer or looser rows, so its cost is a lower bound that only
//! grows. Two moves:
//!
//! - *settle*: move `λ` to the solution of `M_W M_Wᵀ λ = −d_W`. When a multiplier would become negative, stop there, drop its row, go
//!   on. This starts from a working set of the past, and at the end it is the iterative refinement.
//! - *add* the most violated row `j`: raise its multiplier and keep the working set active until either row `j` is satisfied
//!   with equality (it enters), or another multiplier reaches zero (it leaves), or nothing stops the growth (infeasible).
//!
//! As in Arnström, Bemporad and Axehill (2022) the factors are of the Gram matrix of the working set, `L D Lᵀ`. They depend on the
//! working set only, hence survive from one sampling instant to the next and a warm start costs no factorisation.

use crate::dense::{all_finite, axpy, dot, gemv_add, upper_mul_add, upper_transpose_mul};
use crate::proof::proof_radius;
use crate::tables::NO_ROW;
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
const CORRECTIONS: u32 = 6;

/// Why the inner moves end the solve.
enum Stop<T> {
    Budget(Outcome<T>),
    Trouble,
}

/// Computes `f`, `−H⁻¹f` for the new data. What depends on the set-point only is kept while it stays.
pub(crate) fn load<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>, x: &[T], r: &[T], fresh: bool) {
    if fresh || ws.set_point != r {
        ws.set_point.copy_from_slice(r);
        ws.free_set_point.fill(T::ZERO);
        gemv_add(tables.free_set_point, r, ws.free_set_point);
        ws.linear_set_point.fill(T::ZERO);
        gemv_add(tables.linear_set_point, r, ws.linear_set_point);
    }
    ws.x.copy_from_slice(x);
    ws.free.copy_from_slice(ws.free_set_point);
    gemv_add(tables.free_state, x, ws.free);
    ws.linear.copy_from_slice(ws.linear_set_point);
    gemv_add(tables.linear_state, x, ws.linear);
    ws.pricing.measure(x);
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
            } else {
                let Workspace { factor, half, a, rho, m, .. } = ws;
                factor.rebuild(half, a, rho, m);
                // Rebuilding keeps the order unless a row proved dependent; then no multiplier is known.
                ws.lambda.fill(T::ZERO);
            }
            ws.pricing.forget();
        }
        match run(tables, ws, budget, iterations) {
            Ok(outcome) | Err(Stop::Budget(outcome)) => return outcome,
            Err(Stop::Trouble) => {}
        }
    }
    ws.factor.clear();
    ws.pricing.forget();
    Outcome::Failed
}

fn run<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &mut Workspace<'_, T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<Outcome<T>, Stop<T>> {
    let (mut lower_bound, mut stalled, mut settled) = (T::ZERO, 0, 0);
    if budget.is_over() {
        return Err(Stop::Budget(Outcome::Deadline));
    }
    settle(tables, ws, budget, iterations)?;
    loop {
        let priced = ws.pricing.price(tables, ws.z, ws.factor.index());
        if priced.broken {
            return Err(Stop::Trouble);
        }
        let Some((row, q)) = priced.worst else {
            // Refine; a multiplier that turns negative sends us back to pricing.
            let moved = settle(tables, ws, budget, iterations)?;
            // Where the arithmetic cannot meet REFINE every settling moves a little: twice is enough.
            if moved && settled < 2 {
                settled += 1;
                continue;
            }
            let mut violation = priced.violation;
            for i in 0..ws.factor.len() {
                let row = ws.factor.index()[i] as usize;
                violation = violation.max(ws.half[i] / tables.scale[row]);
            }
            return Ok(Outcome::Optimal { violation });
        };
        settled = 0;
        match add(tables, ws, row, q, budget, iterations)? {
            Added::Entered => {}
            Added::Infeasible(radius) => return Ok(Outcome::Infeasible { radius }),
            // Dependent, nothing to drop, and no proof: rounding hides whether the problem is feasible.
            Added::Undecided => return Err(Stop::Trouble),
        }
        let now = dot(ws.w, ws.w);
        if !all_finite(&[now]) {
            return Err(Stop::Trouble);
        }
        if now > lower_bound {
            (lower_bound, stalled) = (now, 0);
        } else {
            stalled += 1;
            if stalled > STALLED {
                return Err(Stop::Trouble);
            }
        }
    }
}

/// `w = −M_Wᵀλ`, `z = z_free + R⁻¹w`.
fn primal<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>) {
    ws.w.fill(T::ZERO);
    ws.factor.subtract(ws.lambda, ws.w);
    ws.z.copy_from_slice(ws.free);
    if ws.factor.len() > 0 {
        upper_mul_add(tables.root_inverse, ws.w, ws.z);
    }
}

/// Makes the working set active: `G_W z = b_W` within [`Scalar::REFINE`]. Returns whether anything moved.
/// Leaves the residuals of the working set in `half`.
fn settle<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &mut Workspace<'_, T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<bool, Stop<T>> {
    let (mut moved, mut corrections, mut previous) = (false, 0, T::INFINITY);
    loop {
        primal(tables, ws);
        if !all_finite(ws.z) {
            return Err(Stop::Trouble);
        }
        let k = ws.factor.len();
        let (mut error, mut noise) = (T::ZERO, T::ONE);
        for i in 0..k {
            let row = ws.factor.index()[i] as usize;
            let q = ws.pricing.residual(tables, row, ws.z);
            ws.half[i] = q;
            ws.a[i] = q;
            error = error.max(q.abs() / tables.scale[row]);
            noise = noise.max(tables.bound(row, ws.x).abs() / tables.scale[row]);
        }
        if error <= T::REFINE * noise {
            return Ok(moved);
        }
        // No progress any more: this is as accurate as the numbers allow.
        if corrections > 1 && error <= T::PRIMAL * noise && !(error < T::HALF * previous) {
            return Ok(moved);
        }
        if corrections > CORRECTIONS {
            return Err(Stop::Trouble);
        }
        previous = error;
        moved = true;
        ws.factor.solve(ws.a);
        // λ + t a ≥ 0.
        let (mut t, mut blocking) = (T::ONE, None);
        for i in 0..k {
            if ws.lambda[i] + t * ws.a[i] < T::ZERO {
                t = ws.lambda[i] / -ws.a[i];
                blocking = Some(i);
            }
        }
        for i in 0..k {
            ws.lambda[i] = (ws.lambda[i] + t * ws.a[i]).max(T::ZERO);
        }
        if let Some(i) = blocking {
            spend(budget, iterations)?;
            drop_row(ws, i);
            (corrections, previous) = (0, T::INFINITY);
        } else {
            corrections += 1;
        }
    }
}

enum Added<T> {
    Entered,
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
    upper_transpose_mul(tables.root_inverse, tables.g_row(j), ws.m);
    let mut lambda_j = T::ZERO;
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
            axpy(-t, ws.rho, ws.w);
            q -= t * p.outside;
        }
        if !all_finite(&[t, q, lambda_j]) {
            return Err(Stop::Trouble);
        }
        if let Some(i) = blocking {
            drop_row(ws, i);
            continue;
        }
        let k = ws.factor.len();
        if !ws.factor.append(j as u32, ws.m, ws.half, p.outside) {
            return Err(Stop::Trouble);
        }
        ws.lambda[k] = lambda_j;
        ws.pricing.hide(j);
        ws.z.copy_from_slice(ws.free);
        upper_mul_add(tables.root_inverse, ws.w, ws.z);
        return Ok(Added::Entered);
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
fn drop_row<T: Scalar>(ws: &mut Workspace<'_, T>, i: usize) {
    let k = ws.factor.len();
    ws.pricing.show(ws.factor.index()[i] as usize);
    ws.factor.remove(i);
    ws.lambda.copy_within(i + 1..k, i);
}

/// One iteration of the budget.
fn spend<T>(budget: &mut Budget<'_>, iterations: &mut u32) -> Result<(), Stop<T>> {
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
pub(crate) fn warm_start<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>, rows: &mut dyn Iterator<Item = u32>) {
    ws.factor.clear();
    ws.pricing.forget();
    ws.lambda.fill(T::ZERO);
    for row in rows {
        push_row(tables, ws, row, T::ZERO);
    }
}

/// Moves working set and multipliers one stage earlier, where the shifted solution has them.
pub(crate) fn shift_working_set<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>, shift: &[u32]) {
    let k = ws.factor.len();
    ws.proof_len = 0;
    ws.proof_rows[..k].copy_from_slice(ws.factor.index());
    ws.proof[..k].copy_from_slice(&ws.lambda[..k]);
    ws.factor.clear();
    ws.pricing.forget();
    for i in 0..k {
        let row = shift.get(ws.proof_rows[i] as usize).copied().unwrap_or(NO_ROW);
        let multiplier = ws.proof[i];
        push_row(tables, ws, row, multiplier);
    }
}

/// Adds a row without looking at the solution; skips what does not exist, repeats, or depends on the others.
fn push_row<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>, row: u32, multiplier: T) {
    let k = ws.factor.len();
    if row as usize >= tables.dims.rows || k == tables.dims.variables() || ws.factor.index().contains(&row) {
        return;
    }
    upper_transpose_mul(tables.root_inverse, tables.g_row(row as usize), ws.m);
    let p = ws.factor.project(ws.m, ws.half, ws.a, ws.rho);
    if p.outside > T::DEPENDENT * p.length && ws.factor.append(row, ws.m, ws.half, p.outside) {
        ws.lambda[k] = multiplier;
    }
}
