//! The active-set method among the products of rows: finds the working set without touching `z`.
//!
//! What is kept is the centred residual of every unit, `d = G z − W x`, at the minimiser for the present multipliers. Rows of the unit are
//! violated where `|d|` (a pair) or `d` (a single row) exceeds the right-hand side. Adding row `j` moves it by
//! `−t (M Mᵀ)_j`, and the working set's reply by `t Σ aᵢ (M Mᵀ)_i`: [`Gram`] has both. The steps are those of `active_set.rs`; at the end
//! `z` is computed once, and `settle` there judges it by the rows themselves. Whatever is delicate (rows nearly dependent, no row to drop,
//! numbers that are not finite) is left to the method that works with the rows.

use crate::active_set::{Stop, drop_row, spend};
use crate::dense::{axpy, dot, max_abs, upper_transpose_mul};
use crate::gram::{Gram, row_of, unit_of};
use crate::{Budget, Scalar, Tables, Workspace};

/// Every row is within its tolerance at the `z` left behind, rounding of the products included.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vouched<T> {
    /// The largest violation in units of right-hand sides, not below 0.
    pub violation: T,
    /// How far any residual may be off, in the same units.
    error: T,
}

/// Finds the working set of the problem loaded, from the one in the workspace.
pub(crate) fn walk<T: Scalar>(
    tables: &Tables<'_, T>,
    gram: &Gram<'_, T>,
    ws: &mut Workspace<'_, T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<Option<Vouched<T>>, Stop<T>> {
    transform(tables, ws);
    let ended = go(tables, gram, ws, budget, iterations);
    // Also of a walk cut short: a lower bound of the cost comes with it.
    minimise(tables, ws);
    if let Ok(Some(vouched)) = &ended {
        let working = ws.factor.index();
        ws.pricing
            .know(tables, gram.scale, vouched.error, ws.z, working);
    }
    ended
}

/// `z = −R⁻¹ (v + M_Wᵀ λ)`: the minimiser for the present multipliers.
fn minimise<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>) {
    for (m, &v) in ws.m.iter_mut().zip(ws.direction.iter()) {
        *m = -v;
    }
    ws.factor.subtract(ws.lambda, ws.m);
    ws.z.fill(T::ZERO);
    tables.root_mul_add(ws.m, ws.z);
    for z in ws.z.iter_mut() {
        if z.abs() < T::TINY {
            *z = T::ZERO;
        }
    }
}

/// The first entry of `v` that is not always zero. Around the gain of the cost the linear term speaks of `θ` only, and so does `v`.
fn first_of_v<T: Scalar>(tables: &Tables<'_, T>) -> usize {
    let theta = tables.dims.variables() - tables.dims.inputs;
    let [of_state, of_set_point] = tables.found.linear_from;
    if of_state >= theta && of_set_point >= theta {
        theta
    } else {
        0
    }
}

/// `v = R⁻ᵀ f` into `direction`.
fn transform<T: Scalar>(tables: &Tables<'_, T>, ws: &mut Workspace<'_, T>) {
    let from = first_of_v(tables);
    let of_theta = ws.linear.len() - from;
    let (before, v) = ws.direction.split_at_mut(from);
    before.fill(T::ZERO);
    // The end of R⁻¹, packed by rows, is the triangle of these entries.
    let skipped = tables.root_inverse.len() - of_theta * (of_theta + 1) / 2;
    upper_transpose_mul(&tables.root_inverse[skipped..], &ws.linear[from..], v);
}

/// The solution if the working set stays. `false`, with nothing changed, when a multiplier would become negative.
pub(crate) fn reply<T: Scalar>(
    tables: &Tables<'_, T>,
    gram: &Gram<'_, T>,
    ws: &mut Workspace<'_, T>,
) -> bool {
    let (nz, from) = (tables.dims.variables(), first_of_v(tables));
    transform(tables, ws);
    let k = ws.factor.len();
    for (a, &row) in ws.a.iter_mut().zip(ws.factor.index()) {
        let (unit, sign) = unit_of::<T>(row as usize, tables.found.pairs);
        let of_unit = &gram.rows[unit * nz..(unit + 1) * nz];
        let along = sign * dot(&of_unit[from..], &ws.direction[from..]);
        *a = -along - tables.bound(row as usize, ws.x);
    }
    ws.factor.solve(ws.a);
    if !ws.a[..k].iter().all(|&a| a >= T::ZERO) {
        return false;
    }
    ws.lambda[..k].copy_from_slice(&ws.a[..k]);
    minimise(tables, ws);
    true
}

fn go<T: Scalar>(
    tables: &Tables<'_, T>,
    gram: &Gram<'_, T>,
    ws: &mut Workspace<'_, T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<Option<Vouched<T>>, Stop<T>> {
    let pairs = tables.found.pairs;
    unconstrained(tables, gram, ws);
    // The multipliers that make the working set active; rows leave on the way there.
    while ws.factor.len() > 0 {
        let (mut t, mut blocking) = (T::ONE, None);
        let d = ws.pricing.residuals(gram.units);
        for (a, &row) in ws.a.iter_mut().zip(ws.factor.index()) {
            let (unit, sign) = unit_of::<T>(row as usize, pairs);
            *a = sign * d[unit] - gram.scale[unit];
        }
        ws.factor.solve(ws.a);
        let k = ws.factor.len();
        for (i, (&a, &old)) in ws.a[..k].iter().zip(ws.lambda.iter()).enumerate() {
            if a < T::ZERO && old < t * (old - a) {
                t = old / (old - a);
                blocking = Some(i);
            }
        }
        for (l, &a) in ws.lambda[..k].iter_mut().zip(ws.a.iter()) {
            // Towards the end the new multiplier itself, not the old one and a difference.
            let next = if t == T::ONE { a } else { *l + t * (a - *l) };
            *l = next.max(T::ZERO);
        }
        let Some(i) = blocking else { break };
        spend(budget, iterations)?;
        drop_row(tables, ws, i);
    }
    let mut travelled = Travelled {
        sum: T::ZERO,
        additions: tables.dims.states + tables.dims.variables() + ws.factor.len(),
    };
    let d = ws.pricing.residuals(gram.units);
    for (&row, &l) in ws.factor.index().iter().zip(ws.lambda.iter()) {
        let (unit, sign) = unit_of::<T>(row as usize, pairs);
        axpy(-(sign * l), gram.products_of(unit), d);
        travelled.sum += l;
    }
    let limit = *iterations + 4 * (tables.dims.variables() + gram.units) as u32;
    loop {
        let d = ws.pricing.residuals(gram.units);
        let worst = scan(d, gram.scale, pairs);
        if worst.broken || *iterations > limit {
            return Ok(None);
        }
        let Some(unit) = worst.unit else {
            let error = rounding(tables, ws, &travelled);
            let is_sure = error <= T::HALF * T::PRIMAL;
            return Ok(is_sure.then_some(Vouched {
                violation: worst.violation,
                error,
            }));
        };
        let is_second = unit < pairs && d[unit] < T::ZERO;
        let row = row_of(unit, pairs) + usize::from(is_second);
        if !enter(tables, gram, ws, row, &mut travelled, budget, iterations)? {
            return Ok(None);
        }
    }
}

/// What went into `d` on the way.
struct Travelled<T> {
    /// Movements of multipliers, and the multipliers that were rounded.
    sum: T,
    /// Additions to an entry.
    additions: usize,
}

/// By how much `d` may differ from the residuals of the rows at the `z` that the multipliers give, in units of right-hand sides.
///
/// Every addition to `d` rounds once. So do the additions that make `z` and the products: `k + 1` of rows, a block of `R⁻¹` twice,
/// a dot product of two rows in four sums, and some for the end of each.
fn rounding<T: Scalar>(
    tables: &Tables<'_, T>,
    ws: &Workspace<'_, T>,
    travelled: &Travelled<T>,
) -> T {
    let k = ws.factor.len();
    let of_z = k + 2 * tables.found.block + tables.dims.variables() / 4 + 16;
    let roundings = T::from_f64((travelled.additions + of_z) as f64) * (T::HALF * T::EPSILON);
    let sum = ws.lambda[..k].iter().fold(T::ZERO, |sum, &l| sum + l) + travelled.sum;
    let length = dot(ws.direction, ws.direction).sqrt_upper();
    roundings * tables.found.gram_error * (T::ONE + max_abs(ws.x) + length + (sum + sum))
}

/// `d` without any row active: `−M v − W x`.
fn unconstrained<T: Scalar>(tables: &Tables<'_, T>, gram: &Gram<'_, T>, ws: &mut Workspace<'_, T>) {
    let (units, nz, m) = (gram.units, tables.dims.variables(), tables.dims.inputs);
    let d = ws.pricing.residuals(units);
    d.fill(T::ZERO);
    let states = gram.state.chunks_exact(units).zip(ws.x.iter());
    states.for_each(|(column, &x)| axpy(-x, column, d));
    let from = first_of_v(tables);
    if from == nz - m {
        let thetas = gram.theta.chunks_exact(units).zip(&ws.direction[from..]);
        thetas.for_each(|(column, &v)| axpy(-v, column, d));
    } else {
        for (d, row) in d.iter_mut().zip(gram.rows.chunks_exact(nz)) {
            *d -= dot(row, ws.direction);
        }
    }
}

/// Brings `row` into the working set. `false`: this is for the method that works with the rows.
fn enter<T: Scalar>(
    tables: &Tables<'_, T>,
    gram: &Gram<'_, T>,
    ws: &mut Workspace<'_, T>,
    row: usize,
    travelled: &mut Travelled<T>,
    budget: &mut Budget<'_>,
    iterations: &mut u32,
) -> Result<bool, Stop<T>> {
    let pairs = tables.found.pairs;
    let (unit, sign) = unit_of::<T>(row, pairs);
    let of_row = gram.products_of(unit);
    let (mut lambda, nz) = (T::ZERO, tables.dims.variables());
    loop {
        spend(budget, iterations)?;
        let k = ws.factor.len();
        for (half, &other) in ws.half.iter_mut().zip(ws.factor.index()) {
            let (other, other_sign) = unit_of::<T>(other as usize, pairs);
            if other == unit {
                return Ok(false);
            }
            *half = sign * other_sign * of_row[other];
        }
        let outside = ws.factor.project_products(of_row[unit], ws.half, ws.a);
        if !(outside > T::REPROJECT * of_row[unit]) {
            return Ok(false);
        }
        let d = ws.pricing.residuals(gram.units);
        let mut t = (sign * d[unit] - gram.scale[unit]) / outside;
        let mut blocking = None;
        for (i, (&a, &l)) in ws.a[..k].iter().zip(ws.lambda.iter()).enumerate() {
            if a > T::ZERO && l < t * a {
                t = l / a;
                blocking = Some(i);
            }
        }
        lambda += t;
        axpy(-(t * sign), of_row, d);
        travelled.sum += lambda;
        travelled.additions += k + 1;
        for i in 0..k {
            let (other, other_sign) = unit_of::<T>(ws.factor.index()[i] as usize, pairs);
            let moved = t * ws.a[i];
            axpy(moved * other_sign, gram.products_of(other), d);
            ws.lambda[i] = (ws.lambda[i] - moved).max(T::ZERO);
            travelled.sum += moved.abs() + ws.lambda[i];
        }
        if let Some(i) = blocking {
            drop_row(tables, ws, i);
            continue;
        }
        for (m, &v) in ws.m.iter_mut().zip(&gram.rows[unit * nz..(unit + 1) * nz]) {
            *m = sign * v;
        }
        let is_in = ws.factor.append(row as u32, ws.m, ws.half, outside);
        if is_in {
            ws.lambda[k] = lambda;
            ws.pricing.hide(tables, row);
        }
        return Ok(is_in && lambda.is_finite());
    }
}

struct Worst<T> {
    /// The unit violated most, beyond half the tolerance.
    unit: Option<usize>,
    /// Largest violation, in units of right-hand sides.
    violation: T,
    broken: bool,
}

/// The most violated unit. Lanes without branches; `0 · v` is NaN for what is not finite.
fn scan<T: Scalar>(d: &[T], scale: &[T], pairs: usize) -> Worst<T> {
    const LANES: usize = 4;
    let tolerance = T::HALF * T::PRIMAL;
    let beyond = |d: T, s: T, is_pair: bool| (if is_pair { d.abs() } else { d }) - s;
    let (mut most, mut excess, mut zeros) = ([T::ZERO; LANES], [T::ZERO; LANES], [T::ZERO; LANES]);
    let larger = |a: T, b: T| if b > a { b } else { a };
    let (of_pairs, of_singles) = d.split_at(pairs);
    let (scale_pairs, scale_singles) = scale.split_at(pairs);
    let (chunks, rest) = of_pairs.as_chunks::<LANES>();
    let (scales, scale_rest) = scale_pairs.as_chunks::<LANES>();
    for (d, s) in chunks.iter().zip(scales) {
        for lane in 0..LANES {
            let e = beyond(d[lane], s[lane], true);
            most[lane] = larger(most[lane], e - tolerance * s[lane]);
            excess[lane] = larger(excess[lane], e);
            zeros[lane] += T::ZERO * e;
        }
    }
    let others = rest.iter().zip(scale_rest).map(|(&d, &s)| (d, s, true));
    let singles = of_singles.iter().zip(scale_singles);
    for (d, s, is_pair) in others.chain(singles.map(|(&d, &s)| (d, s, false))) {
        let e = beyond(d, s, is_pair);
        most[0] = larger(most[0], e - tolerance * s);
        excess[0] = larger(excess[0], e);
        zeros[0] += T::ZERO * e;
    }
    let over = |lanes: [T; LANES]| larger(larger(lanes[0], lanes[2]), larger(lanes[1], lanes[3]));
    let (most, excess) = (over(most), over(excess));
    let broken = !((zeros[0] + zeros[2]) + (zeros[1] + zeros[3]) == T::ZERO);
    let (mut unit, mut violation) = (None, T::ZERO);
    if !broken && most > T::ZERO {
        unit = (0..d.len())
            .find(|&i| beyond(d[i], scale[i], i < pairs) - tolerance * scale[i] == most);
    } else if excess > T::ZERO {
        for (i, (&d, &s)) in d.iter().zip(scale).enumerate() {
            violation = larger(violation, beyond(d, s, i < pairs) / s);
        }
    }
    Worst {
        unit,
        violation,
        broken,
    }
}
