//! The program of `prediction.rs` for plants made of many subsystems: sparse, opposite rows in pairs.
//!
//! The variables and formulas are the same. A pair reads −l ≤ G z + V x ≤ 1 where a side that is not a constraint has no
//! bound. Entries of a row that are rounding beside its largest, in units of the cost, are left out: with them nothing would be
//! banded.

use super::local_offset::LocalOffsetCost;
use super::prediction::RowOrigin;
use crate::error::DesignError;
use crate::matrix::SparseMatrix;
use crate::problem::{Formulation, Task, TerminalCost};
use crate::terminal::{LawRows, TerminalIngredients};

/// Entries of G below this, relative to the largest of their row in units of D^(1/2), D the diagonal of H, are left out. The row then
/// differs by 1e-12 of its reach, far below the 1e-9 to which it is kept.
const DROP: f64 = 1e-12;
/// Entries of H below this, relative to the square root of the product of the diagonal entries.
const DROP_COST: f64 = 1e-14;
/// Entries of V below this, relative to the largest of their row, in units of Q.
const DROP_STATE: f64 = 1e-14;
/// Relative size of R K + BᵀP(A + B K) below which it is rounding of the LQR gain, as in `prediction.rs`.
const LQR_RESIDUAL: f64 = 1e-9;

/// A side of a pair: the row of the program.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    pub(super) origin: RowOrigin,
    /// The bound of the pair on this side.
    pub(super) bound: f64,
}

/// H, F_x, F_r, and the pairs −l ≤ G z + V x ≤ u.
pub(super) struct LocalProgram {
    pub(super) hessian: SparseMatrix,
    pub(super) from_state: SparseMatrix,
    pub(super) from_set_point: SparseMatrix,
    pub(super) rows: SparseMatrix,
    pub(super) state_rows: SparseMatrix,
    /// Upper and lower side of each pair.
    pub(super) sides: Vec<[Option<Side>; 2]>,
}

/// A pair of the program: which pair of constraint rows, where, and which of its sides.
#[derive(Clone, Copy)]
struct Place {
    pair: usize,
    origin: fn(usize, usize) -> RowOrigin,
    step: usize,
    kind: Kind,
    sides: [bool; 2],
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Stage,
    Terminal,
    Equilibrium,
}

/// The program; `None` for formulations whose cost couples everything.
pub(super) fn condense_locally(
    ingredients: &TerminalIngredients,
    formulation: Formulation,
) -> Result<Option<LocalProgram>, DesignError> {
    let problem = ingredients.problem();
    if formulation == Formulation::NoTerminalConstraint
        || problem.terminal_cost() != TerminalCost::Exact
    {
        return Ok(None);
    }
    let plant = problem.plant();
    let (m, horizon) = (plant.inputs(), problem.prediction_horizon());
    let p = problem.rows().len();
    // For each constraint row, the steps of the terminal law at which it is asked for.
    let mut wanted: Vec<Vec<bool>> = (0..p)
        .map(|i| vec![true; ingredients.spent_step(i)])
        .collect();
    let mut static_rows = vec![problem.task() == Task::Tracking; p];
    if formulation == Formulation::Explicit {
        let set = ingredients.maximal_admissible_set()?;
        for steps in &mut wanted {
            steps.fill(false);
        }
        static_rows.fill(false);
        for k in 0..set.len() {
            match set.origin(k) {
                (row, Some(step)) => {
                    if wanted[row].len() <= step {
                        wanted[row].resize(step + 1, false);
                    }
                    wanted[row][step] = true;
                }
                (row, None) => static_rows[row] = true,
            }
        }
    }
    let steps = wanted.iter().map(Vec::len).max().unwrap_or(0);
    let law = ingredients.law_rows(horizon + steps.saturating_sub(1))?;

    let mut places = Vec::new();
    for (pair, &(upper, lower)) in law.pairs.iter().enumerate() {
        let both =
            |asked: &dyn Fn(usize) -> bool| [asked(upper), lower.is_some_and(|l| asked(l.0))];
        let mut push = |kind, step, sides: [bool; 2], origin| {
            if sides[0] || sides[1] {
                places.push(Place {
                    pair,
                    origin,
                    step,
                    kind,
                    sides,
                });
            }
        };
        for step in 0..horizon {
            // A state row at step 0 speaks of the measured state alone.
            if step > 0 || problem.rows().d.row(upper).len() > 0 {
                push(Kind::Stage, step, both(&|_| true), |row, step| {
                    RowOrigin::Stage { row, step }
                });
            }
        }
        for step in 0..steps {
            let asked = |row: usize| wanted[row].get(step).copied().unwrap_or(false);
            push(Kind::Terminal, step, both(&asked), |row, step| {
                RowOrigin::Terminal { row, step }
            });
        }
        if law.equilibrium.cols() > 0 && law.equilibrium.row(pair).len() > 0 {
            push(
                Kind::Equilibrium,
                0,
                both(&|row| static_rows[row]),
                |row, _| RowOrigin::Equilibrium { row },
            );
        }
    }

    let Some((hessian, from_state, from_set_point)) = cost(ingredients)? else {
        return Ok(None);
    };
    let (rows, state_rows) = assemble(ingredients, &law, &places, horizon, m);
    let unit: Vec<f64> = (0..hessian.rows())
        .map(|v| hessian.get(v, v).sqrt())
        .collect();
    let rows = without_rounding(&rows, &unit, DROP);
    let state_unit: Vec<f64> = (0..plant.states())
        .map(|j| problem.state_weight().get(j, j).sqrt())
        .collect();
    let state_rows = without_rounding(&state_rows, &state_unit, DROP_STATE);
    let sides = places
        .iter()
        .map(|place| {
            let (upper, lower) = law.pairs[place.pair];
            let side = |row, bound| Side {
                origin: (place.origin)(row, place.step),
                bound,
            };
            [
                place.sides[0].then(|| side(upper, 1.0)),
                lower
                    .filter(|_| place.sides[1])
                    .map(|(row, bound)| side(row, bound)),
            ]
        })
        .collect();
    Ok(Some(LocalProgram {
        hessian,
        from_state,
        from_set_point,
        rows,
        state_rows,
        sides,
    }))
}

/// G and V of the places.
fn assemble(
    ingredients: &TerminalIngredients,
    law: &LawRows,
    places: &[Place],
    horizon: usize,
    m: usize,
) -> (SparseMatrix, SparseMatrix) {
    let problem = ingredients.problem();
    let plant = problem.plant();
    let product = |a: &SparseMatrix, b: &SparseMatrix| a.mul_with(b, |_, _| 0.0).0;
    let times_b: Vec<SparseMatrix> = law.powers.iter().map(|p| product(p, plant.b())).collect();
    let parameters = law.equilibrium.cols();
    let times_mx: Vec<SparseMatrix> = if parameters > 0 {
        let basis = ingredients.steady_states().state_basis();
        law.powers.iter().map(|p| product(p, basis)).collect()
    } else {
        Vec::new()
    };
    let theta = horizon * m;
    let scaling = problem.scaling();
    let empty = SparseMatrix::zeros(law.pairs.len(), plant.states());
    let mut g = Vec::with_capacity(places.len());
    let mut v = Vec::with_capacity(places.len());
    for place in places {
        let pair = place.pair;
        // The row speaks of e after `stage` predicted steps and `power` steps of the law.
        let (stage, power) = match place.kind {
            Kind::Stage => (place.step, 0),
            Kind::Terminal => (horizon, place.step),
            Kind::Equilibrium => {
                g.push(
                    law.equilibrium
                        .row(pair)
                        .map(|(t, w)| ((theta + t) as u32, w / scaling))
                        .collect(),
                );
                v.push(empty.row(pair).map(|(j, x)| (j as u32, x)).collect());
                continue;
            }
        };
        let mut row: Vec<(u32, f64)> = Vec::new();
        for i in 0..stage {
            row.extend(
                times_b[power + stage - 1 - i]
                    .row(pair)
                    .map(|(j, b)| ((i * m + j) as u32, b)),
            );
        }
        if place.kind == Kind::Stage {
            row.extend(
                problem
                    .rows()
                    .d
                    .row(law.pairs[pair].0)
                    .map(|(j, d)| ((stage * m + j) as u32, d)),
            );
        }
        if parameters > 0 {
            let mut of_theta: Vec<(u32, f64)> = law
                .equilibrium
                .row(pair)
                .chain(times_mx[power + stage].row(pair).map(|(t, x)| (t, -x)))
                .map(|(t, x)| ((theta + t) as u32, x))
                .collect();
            of_theta.sort_by_key(|e| e.0);
            of_theta.dedup_by(|from, into| {
                let same = from.0 == into.0;
                if same {
                    into.1 += from.1;
                }
                same
            });
            row.extend(of_theta);
        }
        g.push(row);
        v.push(
            law.powers[power + stage]
                .row(pair)
                .map(|(j, x)| (j as u32, x))
                .collect(),
        );
    }
    let count = places.len();
    (
        SparseMatrix::from_row_lists(count, theta + parameters, g),
        SparseMatrix::from_row_lists(count, plant.states(), v),
    )
}

/// Rows without the entries that are rounding beside the largest, columns in units of `unit`.
fn without_rounding(m: &SparseMatrix, unit: &[f64], relative: f64) -> SparseMatrix {
    let largest: Vec<f64> = (0..m.rows())
        .map(|i| m.row(i).fold(0.0_f64, |a, (j, v)| a.max(v.abs() / unit[j])))
        .collect();
    m.filtered(|i, j, v| v.abs() / unit[j] > relative * largest[i])
}

/// H, F_x and F_r; `None` when a gain other than the regulator's couples the stages.
fn cost(
    ingredients: &TerminalIngredients,
) -> Result<Option<(SparseMatrix, SparseMatrix, SparseMatrix)>, DesignError> {
    let problem = ingredients.problem();
    let plant = problem.plant();
    let (n, m, horizon) = (plant.states(), plant.inputs(), problem.prediction_horizon());
    let parameters = if problem.task() == Task::Tracking {
        m
    } else {
        0
    };
    let law = ingredients.sparse_law();
    let product = |a: &SparseMatrix, b: &SparseMatrix| a.mul_with(b, |_, _| 0.0).0;
    let bt = plant.b().transpose();
    let btp = product(&bt, &law.weight);
    let btpa = product(&btp, &law.closed_loop);
    let e = product(problem.input_weight(), &law.gain).combine(1.0, &btpa, 1.0);
    let largest = |m: &SparseMatrix| m.entries().fold(0.0_f64, |a, e| a.max(e.2.abs()));
    if !(largest(&e) <= LQR_RESIDUAL * largest(&btpa)) {
        return Ok(None);
    }
    let s = problem
        .input_weight()
        .combine(2.0, &product(&btp, plant.b()), 2.0);
    let s = s.combine(0.5, &s.transpose(), 0.5);
    let theta = horizon * m;
    let mut h: Vec<Vec<(u32, f64)>> = Vec::with_capacity(theta + parameters);
    for stage in 0..horizon {
        for i in 0..m {
            h.push(s.row(i).map(|(j, v)| ((stage * m + j) as u32, v)).collect());
        }
    }
    let mut from_state = vec![Vec::new(); theta];
    let mut from_set_point = vec![Vec::new(); theta];
    if parameters > 0 {
        let steady = ingredients.steady_states();
        let mt = steady.state_basis().transpose();
        let mp = product(&mt, &law.weight);
        let mpm = product(&mp, steady.state_basis());
        let Some(offset) = LocalOffsetCost::of(problem, steady)? else {
            return Ok(None);
        };
        let block = mpm.combine(2.0, &offset.hessian, 1.0);
        let block = block.combine(0.5, &block.transpose(), 0.5);
        for t in 0..m {
            h.push(block.row(t).map(|(j, v)| ((theta + j) as u32, v)).collect());
            from_state.push(mp.row(t).map(|(j, v)| (j as u32, -2.0 * v)).collect());
            let of_state = offset.from_state.row(t).map(|(j, v)| (j as u32, -v));
            let of_input = offset.from_input.row(t).map(|(j, v)| ((n + j) as u32, -v));
            from_set_point.push(of_state.chain(of_input).collect());
        }
    }
    let size = theta + parameters;
    let hessian = SparseMatrix::from_row_lists(size, size, h);
    let unit: Vec<f64> = (0..size).map(|v| hessian.get(v, v).sqrt()).collect();
    if !unit.iter().all(|&u| u > 0.0) {
        return Ok(None);
    }
    Ok(Some((
        hessian.filtered(|i, j, v| i == j || v.abs() > DROP_COST * unit[i] * unit[j]),
        SparseMatrix::from_row_lists(size, n, from_state),
        SparseMatrix::from_row_lists(size, n + m, from_set_point),
    )))
}
