//! The tracking problem (9)(30) as a quadratic program in few variables.
//!
//! With u_j = u_s + K (x_j − x_s) + c_j the predictions are e_{j+1} = (A + B K) e_j + B c_j, e_j = x_j − M_θx θ, and
//! the variables are z = (c_0, …, c_{N−1}, θ). Because P solves (3), the cost (10) is
//!   ‖x_0 − M_θx θ‖²_P + Σ_j (‖c_j‖²_S + 2 c_jᵀ E e_j) + offset cost,   S = R + BᵀPB,   E = R K + BᵀP(A + B K),
//! and E = 0 for the LQR gain: then every c_j is a deviation from the optimal unconstrained law, and the Hessian is
//! block diagonal. A row g of the terminal constraints after t steps of the law reads g (A + B K)ᵗ e_N + w θ ≤ 1; all
//! rows are built from the products g (A + B K)ᵗ B.
//!
//! The shifted candidate (32) is, in these variables, (c_1, …, c_{N−1}, 0, θ).

use super::set_point::OffsetCost;
use super::terminal_cost::{ExtraCost, no_terminal_constraint, power};
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::matrix::SparseMatrix;
use crate::problem::{ConstraintRows, Formulation, Task};
use crate::terminal::TerminalIngredients;
use faer::Scale;
use std::collections::HashMap;

/// Where a row of the program comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum RowOrigin {
    /// Constraint row i at prediction step j < N.
    Stage { row: usize, step: usize },
    /// Constraint row i after `step` steps of the terminal law.
    Terminal { row: usize, step: usize },
    /// Row i of θ ∈ λΘ.
    Equilibrium { row: usize },
}

/// H, G, W, F_x, F_r of min ½ zᵀHz + (F_x x + F_r r)ᵀz subject to G z ≤ 1 − W x.
pub(crate) struct Condensed {
    pub(crate) hessian: Dense,
    pub(crate) rows: Dense,
    /// Coefficients of the state in each row, rows × n.
    pub(crate) state_rows: Dense,
    /// F_x, variables × n.
    pub(crate) from_state: Dense,
    /// F_r, variables × (n + m): set-point state and input.
    pub(crate) from_set_point: Dense,
    /// Opposite rows stand together, before all others.
    pub(crate) origin: Vec<RowOrigin>,
    /// The Hessian of the cost in the state, n × n: the cost is ½ zᵀHz + (F_x x + F_r r)ᵀz + ½ xᵀ(this)x + ‖r‖².
    pub(crate) state_hessian: Dense,
    /// What the cost has besides (10).
    pub(crate) extra: Option<ExtraCost>,
}

/// Relative size of E below which it is rounding of the LQR gain.
const LQR_RESIDUAL: f64 = 1e-9;

/// A terminal row: constraint row i after `step` steps, or a row of λΘ.
type TerminalRow = (usize, Option<usize>);

pub(crate) fn condense(
    ingredients: &TerminalIngredients,
    formulation: Formulation,
) -> Result<Condensed, DesignError> {
    let problem = ingredients.problem();
    let plant = problem.plant();
    let (n, m, horizon) = (plant.states(), plant.inputs(), problem.prediction_horizon());
    let parameters = if problem.task() == Task::Tracking {
        m
    } else {
        0
    };
    let variables = horizon * m + parameters;
    let terminal = terminal_rows(ingredients, formulation)?;
    let steps = terminal.iter().filter_map(|t| t.1).max().unwrap_or(0);

    let law = ingredients.law();
    let (a_k, b) = (&law.closed_loop, linalg::dense(plant.b()));
    let rows = problem.rows();
    let (c, d) = (linalg::dense(&rows.c), linalg::dense(&rows.d));
    let mx = linalg::dense(ingredients.steady_states().state_basis());
    let w = linalg::dense(&ingredients.equilibrium_rows());
    // g (A+BK)ᵗ for t = 0, …, N + M̃, and the same times B and times M_θx.
    let mut powers = vec![&c + &d * &law.gain];
    for t in 0..horizon + steps {
        let next = &powers[t] * a_k;
        powers.push(next);
    }
    let times_b: Vec<Dense> = powers.iter().map(|p| p * &b).collect();
    let times_mx: Vec<Dense> = if parameters > 0 {
        powers.iter().map(|p| p * &mx).collect()
    } else {
        Vec::new()
    };

    let mut origin: Vec<RowOrigin> = Vec::new();
    for step in 0..horizon {
        for row in 0..rows.len() {
            // A state row at step 0 speaks of the measured state alone.
            if step > 0 || rows.d.row(row).len() > 0 {
                origin.push(RowOrigin::Stage { row, step });
            }
        }
    }
    origin.extend(terminal.iter().map(|&(row, step)| match step {
        Some(step) => RowOrigin::Terminal { row, step },
        None => RowOrigin::Equilibrium { row },
    }));

    let pairs = pair(&mut origin, &opposites(rows));

    let mut g = Dense::zeros(origin.len(), variables);
    let mut state_rows = Dense::zeros(origin.len(), n);
    for (k, &from) in origin.iter().enumerate() {
        // The opposite of the row before, to the last bit.
        if k < 2 * pairs && k % 2 == 1 {
            for j in 0..variables {
                g[(k, j)] = -g[(k - 1, j)];
            }
            for j in 0..n {
                state_rows[(k, j)] = -state_rows[(k - 1, j)];
            }
            continue;
        }
        // The row speaks of e after `stage` predicted steps and `power` steps of the law.
        let (row, stage, power) = match from {
            RowOrigin::Stage { row, step } => (row, step, 0),
            RowOrigin::Terminal { row, step } => (row, horizon, step),
            RowOrigin::Equilibrium { row } => {
                for t in 0..parameters {
                    g[(k, horizon * m + t)] = w[(row, t)] / problem.scaling();
                }
                continue;
            }
        };
        for i in 0..stage {
            for j in 0..m {
                g[(k, i * m + j)] = times_b[power + stage - 1 - i][(row, j)];
            }
        }
        if let RowOrigin::Stage { row, step } = from {
            for j in 0..m {
                g[(k, step * m + j)] += d[(row, j)];
            }
        }
        for j in 0..n {
            state_rows[(k, j)] = powers[power + stage][(row, j)];
        }
        for t in 0..parameters {
            g[(k, horizon * m + t)] = w[(row, t)] - times_mx[power + stage][(row, t)];
        }
    }

    let (mut hessian, mut from_state, from_set_point) = cost(ingredients, &b, &mx, parameters)?;
    let mut state_hessian = &law.weight * Scale(2.0);
    let extra = ExtraCost::of(ingredients, formulation)?;
    if let Some(extra) = &extra {
        // (A+BK)^steps e_N = S x + T z.
        let mut f = power(a_k, extra.steps);
        let mut t = Dense::zeros(n, variables);
        for j in (0..horizon).rev() {
            put(&mut t, 0, j * m, &(&f * &b));
            f = &f * a_k;
        }
        if parameters > 0 {
            put(&mut t, 0, horizon * m, &(&f * &mx * Scale(-1.0)));
        }
        let tw = t.transpose() * &extra.weight * Scale(2.0);
        hessian = linalg::symmetrised(&(hessian + &tw * &t));
        from_state += &tw * &f;
        state_hessian += f.transpose() * &extra.weight * &f * Scale(2.0);
    }
    Ok(Condensed {
        hessian,
        rows: g,
        state_rows,
        from_state,
        from_set_point,
        origin,
        state_hessian,
        extra,
    })
}

/// For each constraint row the row that is its opposite, as of symmetric bounds.
fn opposites(rows: &ConstraintRows) -> Vec<Option<usize>> {
    let key = |i: usize, sign: f64| -> Vec<(usize, usize, u64)> {
        let part = |block: usize, m: &SparseMatrix| -> Vec<(usize, usize, u64)> {
            // 0 and −0 are stored nowhere: a sparse matrix has no zeros.
            m.row(i)
                .map(|(j, v)| (block, j, (sign * v).to_bits()))
                .collect()
        };
        let mut key = part(0, &rows.c);
        key.extend(part(1, &rows.d));
        key
    };
    let known: HashMap<_, usize> = (0..rows.len()).map(|i| (key(i, 1.0), i)).collect();
    (0..rows.len())
        .map(|i| known.get(&key(i, -1.0)).copied())
        .collect()
}

/// Brings opposite rows together, before all others. Returns the number of pairs.
fn pair(origin: &mut Vec<RowOrigin>, opposite: &[Option<usize>]) -> usize {
    let place: HashMap<RowOrigin, usize> =
        origin.iter().enumerate().map(|(k, &o)| (o, k)).collect();
    let partner = |from: RowOrigin| {
        let other = |row: usize| opposite.get(row).copied().flatten();
        let sought = match from {
            RowOrigin::Stage { row, step } => RowOrigin::Stage {
                row: other(row)?,
                step,
            },
            RowOrigin::Terminal { row, step } => RowOrigin::Terminal {
                row: other(row)?,
                step,
            },
            RowOrigin::Equilibrium { row } => RowOrigin::Equilibrium { row: other(row)? },
        };
        place.get(&sought).copied()
    };
    let (mut together, mut alone) = (Vec::with_capacity(origin.len()), Vec::new());
    for (k, &from) in origin.iter().enumerate() {
        match partner(from) {
            // Of equal rows only the last is anyone's partner; both must name each other.
            Some(p) if partner(origin[p]) == Some(k) => {
                if p > k {
                    together.extend([from, origin[p]]);
                }
            }
            _ => alone.push(from),
        }
    }
    let pairs = together.len() / 2;
    together.extend(alone);
    *origin = together;
    pairs
}

/// The rows on (x_N, θ): all that are not spent, or the irredundant ones of the explicit set.
fn terminal_rows(
    ingredients: &TerminalIngredients,
    formulation: Formulation,
) -> Result<Vec<TerminalRow>, DesignError> {
    let problem = ingredients.problem();
    match formulation {
        Formulation::Explicit => {
            let set = ingredients.maximal_admissible_set()?;
            Ok((0..set.len()).map(|k| set.origin(k)).collect())
        }
        Formulation::NoTerminalConstraint => {
            let steps = no_terminal_constraint(ingredients)?.horizon_extension();
            let constraints = problem.rows();
            let p = constraints.len();
            let mut rows = Vec::new();
            for i in 0..p {
                // (35c) reaches step N + M̄, (35d) one step less. A row that is spent needs only rows of steps before it.
                let last = steps + usize::from(constraints.d.row(i).len() == 0);
                let last = last.min(ingredients.spent_step(i));
                rows.extend((0..last).map(|step| (i, Some(step))));
            }
            if problem.task() == Task::Tracking {
                let w = ingredients.equilibrium_rows();
                rows.extend((0..p).filter(|&i| w.row(i).len() > 0).map(|i| (i, None)));
            }
            Ok(rows)
        }
        Formulation::Implicit => {
            let p = problem.rows().len();
            let mut rows = Vec::new();
            for i in 0..p {
                rows.extend((0..ingredients.spent_step(i)).map(|step| (i, Some(step))));
            }
            if problem.task() == Task::Tracking {
                let w = ingredients.equilibrium_rows();
                rows.extend((0..p).filter(|&i| w.row(i).len() > 0).map(|i| (i, None)));
            }
            Ok(rows)
        }
    }
}

/// H, F_x and F_r.
fn cost(
    ingredients: &TerminalIngredients,
    b: &Dense,
    mx: &Dense,
    parameters: usize,
) -> Result<(Dense, Dense, Dense), DesignError> {
    let problem = ingredients.problem();
    let (n, m, horizon) = (
        problem.plant().states(),
        problem.plant().inputs(),
        problem.prediction_horizon(),
    );
    let variables = horizon * m + parameters;
    let law = ingredients.law();
    let (k, p, a_k) = (&law.gain, &law.weight, &law.closed_loop);
    let r = linalg::dense(problem.input_weight());
    let two = Scale(2.0);
    let s = linalg::symmetrised(&(&r + b.transpose() * p * b)) * two;
    let e = (&r * k + b.transpose() * p * a_k) * two;
    let lqr = linalg::max_abs(e.as_ref())
        <= LQR_RESIDUAL * linalg::max_abs((b.transpose() * p * a_k).as_ref());

    let mut h = Dense::zeros(variables, variables);
    let mut from_state = Dense::zeros(variables, n);
    let mut from_set_point = Dense::zeros(variables, n + m);
    for j in 0..horizon {
        put(&mut h, j * m, j * m, &s);
    }
    let theta = horizon * m;
    if parameters > 0 {
        let offset = OffsetCost::of(problem, ingredients.steady_states())?;
        let mp = mx.transpose() * p * two;
        put(&mut h, theta, theta, &(&mp * mx + &offset.hessian));
        put(&mut from_state, theta, 0, &(-&mp));
        put(&mut from_set_point, theta, 0, &(-&offset.from_state));
        put(&mut from_set_point, theta, n, &(-&offset.from_input));
    }
    if !lqr {
        // 2 c_jᵀ E e_j with e_j = (A+BK)^j (x − M_θx θ) + Σ_{i<j} (A+BK)^{j−1−i} B c_i.
        let mut e_power = e;
        for lag in 0..horizon {
            let eb = &e_power * b;
            let em = if parameters > 0 {
                Some(&e_power * mx)
            } else {
                None
            };
            put(&mut from_state, lag * m, 0, &e_power);
            if let Some(em) = em {
                put(&mut h, lag * m, theta, &(-&em));
                put(&mut h, theta, lag * m, &(-em.transpose().to_owned()));
            }
            for j in lag + 1..horizon {
                let i = j - 1 - lag;
                put(&mut h, j * m, i * m, &eb);
                put(&mut h, i * m, j * m, &eb.transpose().to_owned());
            }
            e_power = &e_power * a_k;
        }
    }
    Ok((linalg::symmetrised(&h), from_state, from_set_point))
}

fn put(into: &mut Dense, row: usize, column: usize, block: &Dense) {
    for j in 0..block.ncols() {
        for i in 0..block.nrows() {
            into[(row + i, column + j)] = block[(i, j)];
        }
    }
}
