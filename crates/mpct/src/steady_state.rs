//! The steady states (5)(6): (x_s, u_s) = M_θ θ, a basis of the null space of [A − I, B].
//!
//! The basis is chosen by elimination and not by singular vectors: where the plant is made of subsystems, each column
//! then touches a few of them, and everything computed from it stays local. A continuous-time plant is eliminated in
//! its own matrices [A_c, B_c], which have the same null space and the sparsity of the physics.

use crate::error::DesignError;
use crate::matrix::SparseMatrix;
use crate::problem::Problem;

/// A row of [A − I, B] whose entries all cancel to this, relative to what it was, is dependent on the others.
const RANK_TOLERANCE: f64 = 1e-11;
/// A pivot may be this much smaller than the largest entry of its row when its column is emptier.
const PIVOT_FREEDOM: f64 = 0.1;

/// The basis M_θ = [M_θx; M_θu], with θ of dimension m.
#[derive(Clone, Debug, PartialEq)]
pub struct SteadyStates {
    state: SparseMatrix,
    input: SparseMatrix,
}

impl SteadyStates {
    /// M_θx, n × m.
    pub fn state_basis(&self) -> &SparseMatrix {
        &self.state
    }

    /// M_θu, m × m.
    pub fn input_basis(&self) -> &SparseMatrix {
        &self.input
    }

    /// The basis of a problem's plant, its columns scaled so that |θ_j| = 1 alone reaches the nearest constraint.
    ///
    /// # Errors
    /// [`DesignError::NotStabilizable`] when [A − I, B] lacks full row rank: then z = 1 is a mode that no input moves.
    pub(crate) fn of(problem: &Problem) -> Result<Self, DesignError> {
        let plant = problem.plant();
        let (n, m) = (plant.states(), plant.inputs());
        let (a, b, shift) = match plant.continuous_matrices() {
            Some((a, b)) => (a, b, 0.0),
            None => (plant.a(), plant.b(), 1.0),
        };
        // Columns in units of Q and R, so that pivots compare like with like.
        let unit: Vec<f64> = (0..n)
            .map(|j| problem.state_weight().get(j, j).sqrt())
            .chain((0..m).map(|j| problem.input_weight().get(j, j).sqrt()))
            .collect();
        let rows = (0..n)
            .map(|i| {
                let mut row: Vec<(u32, f64)> = a.row(i).map(|(j, v)| (j as u32, v)).collect();
                if shift != 0.0 {
                    match row.binary_search_by_key(&(i as u32), |e| e.0) {
                        Ok(k) => row[k].1 -= shift,
                        Err(k) => row.insert(k, (i as u32, -shift)),
                    }
                }
                row.extend(b.row(i).map(|(j, v)| ((n + j) as u32, v)));
                for e in &mut row {
                    e.1 /= unit[e.0 as usize];
                }
                row.retain(|e| e.1 != 0.0);
                row
            })
            .collect();
        let basis = null_space(rows, n + m).ok_or(DesignError::NotStabilizable {
            re: 1.0,
            im: 0.0,
            modulus: 1.0,
        })?;
        // Back to the units of the plant; then each column to the scale of the constraints.
        let mut columns = basis;
        let rows = problem.rows();
        let (ct, dt) = (rows.c.transpose(), rows.d.transpose());
        for column in &mut columns {
            for e in column.iter_mut() {
                e.1 /= unit[e.0 as usize];
            }
            let mut value = std::collections::BTreeMap::<usize, f64>::new();
            for &(j, v) in column.iter() {
                let j = j as usize;
                let (t, j) = if j < n { (&ct, j) } else { (&dt, j - n) };
                for (i, c) in t.row(j) {
                    *value.entry(i).or_default() += c * v;
                }
            }
            let mut nearest = value.values().fold(0.0_f64, |a, &v| a.max(v.abs()));
            for bound in problem.norms() {
                let mut point = (vec![0.0; n], vec![0.0; m]);
                for &(j, v) in column.iter() {
                    let j = j as usize;
                    if j < n {
                        point.0[j] = v
                    } else {
                        point.1[j - n] = v
                    }
                }
                let linear = (0..bound.dimension())
                    .map(|k| bound.f.row_dot(k, &point.0) + bound.g.row_dot(k, &point.1));
                nearest = nearest.max(linear.fold(0.0, f64::hypot));
            }
            // A column that no constraint sees keeps its scale; the design refuses it by name.
            if nearest > 0.0 && nearest.is_finite() {
                for e in column.iter_mut() {
                    e.1 /= nearest;
                }
            }
        }
        let (mut state, mut input) = (vec![Vec::new(); n], vec![Vec::new(); m]);
        for (t, column) in columns.iter().enumerate() {
            for &(j, v) in column {
                let j = j as usize;
                if j < n {
                    state[j].push((t as u32, v));
                } else {
                    input[j - n].push((t as u32, v));
                }
            }
        }
        Ok(Self {
            state: SparseMatrix::from_row_lists(n, m, state),
            input: SparseMatrix::from_row_lists(m, m, input),
        })
    }
}

type Row = Vec<(u32, f64)>;

/// Columns of a basis of the null space of a matrix with full row rank, as sparse lists; `None` when a row vanishes.
///
/// Gauss–Jordan elimination by rows: each row gives one basic column, the others are the parameters.
fn null_space(rows: Vec<Row>, width: usize) -> Option<Vec<Row>> {
    let mut population = vec![0_usize; width];
    for row in &rows {
        for e in row {
            population[e.0 as usize] += 1;
        }
    }
    // basic[j] = the reduced row in which column j has its pivot 1.
    let mut basic: Vec<Option<usize>> = vec![None; width];
    let mut reduced: Vec<Row> = Vec::with_capacity(rows.len());
    // Emptier rows first: they fill the others least.
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by_key(|&i| rows[i].len());
    for i in order {
        let scale = rows[i].iter().fold(0.0_f64, |a, e| a.max(e.1.abs()));
        let row = substitute(&rows[i], &basic, &reduced);
        let largest = row.iter().fold(0.0_f64, |a, e| a.max(e.1.abs()));
        if !(largest > RANK_TOLERANCE * scale) {
            return None;
        }
        let pivot = row
            .iter()
            .filter(|e| e.1.abs() >= PIVOT_FREEDOM * largest)
            .min_by(|a, b| {
                let count = |e: &(u32, f64)| population[e.0 as usize];
                count(a)
                    .cmp(&count(b))
                    .then(b.1.abs().total_cmp(&a.1.abs()))
            })?
            .to_owned();
        let row: Row = row
            .into_iter()
            .filter(|e| e.0 == pivot.0 || e.1.abs() > 1e-16 * largest)
            .map(|(j, v)| (j, v / pivot.1))
            .collect();
        basic[pivot.0 as usize] = Some(reduced.len());
        reduced.push(row);
    }
    // Back substitution: later rows may still stand in earlier ones.
    let mut solved: Vec<Row> = vec![Vec::new(); reduced.len()];
    let owner: Vec<u32> = {
        let mut owner = vec![0; reduced.len()];
        for (j, k) in basic.iter().enumerate() {
            if let Some(k) = k {
                owner[*k] = j as u32;
            }
        }
        owner
    };
    for k in (0..reduced.len()).rev() {
        let rest: Row = reduced[k]
            .iter()
            .copied()
            .filter(|e| e.0 != owner[k])
            .collect();
        solved[k] = substitute_solved(&rest, &basic, &solved);
    }
    let mut columns = vec![Vec::new(); width];
    for (k, row) in solved.iter().enumerate() {
        for &(j, v) in row {
            columns[j as usize].push((owner[k], -v));
        }
    }
    Some(
        (0..width)
            .filter(|&j| basic[j].is_none())
            .map(|j| {
                let mut column = std::mem::take(&mut columns[j]);
                column.push((j as u32, 1.0));
                column.sort_by_key(|e| e.0);
                column
            })
            .collect(),
    )
}

/// The row minus multiples of the reduced rows, until no basic column is left in it.
fn substitute(row: &Row, basic: &[Option<usize>], reduced: &[Row]) -> Row {
    use std::collections::BTreeMap;
    let mut sum: BTreeMap<u32, f64> = row.iter().copied().collect();
    // A reduced row k has no pivot column of rows before k left in it, only of rows after k: go upwards.
    let mut open: std::collections::BTreeMap<usize, u32> = sum
        .keys()
        .filter_map(|&j| basic[j as usize].map(|k| (k, j)))
        .collect();
    while let Some((k, j)) = open.pop_first() {
        let Some(factor) = sum.remove(&j) else {
            continue;
        };
        for &(i, v) in &reduced[k] {
            if i != j {
                *sum.entry(i).or_insert(0.0) -= factor * v;
                if let Some(later) = basic[i as usize] {
                    open.insert(later, i);
                }
            }
        }
    }
    sum.into_iter().filter(|e| e.1 != 0.0).collect()
}

/// The same with rows that are already free of basic columns.
fn substitute_solved(row: &Row, basic: &[Option<usize>], solved: &[Row]) -> Row {
    let mut sum = std::collections::BTreeMap::<u32, f64>::new();
    for &(j, v) in row {
        match basic[j as usize] {
            None => *sum.entry(j).or_insert(0.0) += v,
            Some(k) => {
                for &(i, s) in &solved[k] {
                    *sum.entry(i).or_insert(0.0) -= v * s;
                }
            }
        }
    }
    sum.into_iter().filter(|e| e.1 != 0.0).collect()
}
