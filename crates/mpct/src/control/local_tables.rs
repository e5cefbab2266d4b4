//! The tables of the runtime's banded regime, from a sparse program.

use super::local_order::{Order, inverse};
use super::local_program::LocalProgram;
use crate::matrix::SparseMatrix;
use crate::terminal::TerminalIngredients;
use mpct_runtime::banded::{BandedData, BandedTables, Windows};
use mpct_runtime::{NO_ROW, TableError};

/// Pairs that are measured together. Fewer, and more groups must be looked at in every iteration; more, and a change nearby makes
/// more rows be measured again.
const GROUP: usize = 24;

/// Rows by windows, owned.
#[derive(Clone, Debug, Default)]
struct OwnedWindows {
    columns: usize,
    first: Vec<u32>,
    start: Vec<u32>,
    values: Vec<f64>,
}

impl OwnedWindows {
    /// Rows as entries (column, value) in any order; `scale` multiplies each.
    fn new(columns: usize, rows: impl Iterator<Item = Vec<(u32, f64)>>) -> Self {
        let mut out = Self {
            columns,
            start: vec![0],
            ..Self::default()
        };
        for row in rows {
            let first = row.iter().map(|e| e.0).min().unwrap_or(0);
            let end = row.iter().map(|e| e.0 + 1).max().unwrap_or(first);
            let at = out.values.len();
            out.values.resize(at + (end - first) as usize, 0.0);
            for (j, v) in row {
                out.values[at + (j - first) as usize] += v;
            }
            out.first.push(first);
            out.start.push(out.values.len() as u32);
        }
        out
    }

    fn view(&self) -> Result<Windows<'_, f64>, TableError> {
        Windows::new(self.columns, &self.first, &self.start, &self.values)
    }

    /// Row `i` times `x`.
    fn dot(&self, i: usize, x: &[f64]) -> f64 {
        let row = &self.values[self.start[i] as usize..self.start[i + 1] as usize];
        row.iter()
            .zip(&x[self.first[i] as usize..])
            .map(|(a, b)| a * b)
            .sum()
    }

    /// Mean length of a row.
    fn mean(&self) -> f64 {
        self.values.len() as f64 / self.first.len().max(1) as f64
    }
}

/// The arrays of [`BandedData`], owned.
#[derive(Clone, Debug)]
pub(super) struct OwnedTables {
    hessian: OwnedWindows,
    linear_state: OwnedWindows,
    linear_set_point: OwnedWindows,
    rows: OwnedWindows,
    rows_state: OwnedWindows,
    upper: Vec<f64>,
    lower: Vec<f64>,
    scale: Vec<f64>,
    groups: Vec<u32>,
    gain: OwnedWindows,
    first_input: OwnedWindows,
    input_rows: OwnedWindows,
    state_order: Vec<u32>,
    set_point_order: Vec<u32>,
    next_stage: Vec<u32>,
}

/// The power of two that brings `length` into [1, 2).
fn power_of_two(length: f64) -> f64 {
    if length > 0.0 && length.is_finite() {
        2.0_f64.powi(-(length.log2().floor() as i32))
    } else {
        1.0
    }
}

impl OwnedTables {
    pub(super) fn new(
        program: &LocalProgram,
        order: &Order,
        ingredients: &TerminalIngredients,
        stages: usize,
    ) -> Self {
        let variable_place = inverse(&order.variables);
        let state_place = inverse(&order.states);
        let set_point_place = inverse(&order.set_point);
        let size = order.variables.len();
        let m = ingredients.problem().plant().inputs();
        let theta = stages * m;
        let moved = |m: &SparseMatrix, i: usize, place: &[u32], factor: f64| -> Vec<(u32, f64)> {
            m.row(i).map(|(j, v)| (place[j], factor * v)).collect()
        };

        let unit: Vec<f64> = (0..size)
            .map(|v| program.hessian.get(v, v).sqrt())
            .collect();
        let scale: Vec<f64> = order
            .pairs
            .iter()
            .map(|&i| {
                let square: f64 = program
                    .rows
                    .row(i as usize)
                    .map(|(v, g)| (g / unit[v]) * (g / unit[v]))
                    .sum();
                power_of_two(square.sqrt())
            })
            .collect();
        let scaled = |m: &SparseMatrix, place: &[u32]| {
            OwnedWindows::new(
                m.cols(),
                order
                    .pairs
                    .iter()
                    .zip(&scale)
                    .map(|(&i, &s)| moved(m, i as usize, place, s)),
            )
        };
        let side = |k: usize| -> Vec<f64> {
            order
                .pairs
                .iter()
                .zip(&scale)
                .map(|(&i, &s)| {
                    program.sides[i as usize][k].map_or(f64::INFINITY, |side| s * side.bound)
                })
                .collect()
        };
        // The first input is K (x − M_θx θ) + M_θu θ + c_0.
        let steady = ingredients.steady_states();
        let gain = ingredients.gain();
        let feedforward = if size > theta {
            steady
                .input_basis()
                .combine(1.0, &gain.mul(steady.state_basis()), -1.0)
        } else {
            SparseMatrix::zeros(m, 0)
        };
        let negligible =
            |m: &SparseMatrix, i: usize| 1e-16 * m.row(i).fold(0.0_f64, |a, (_, v)| a.max(v.abs()));
        let first_input = (0..m).map(|i| {
            let least = negligible(&feedforward, i);
            let of_theta = feedforward
                .row(i)
                .filter(|e| e.1.abs() > least)
                .map(|(t, v)| (variable_place[theta + t], v));
            let of_c = (stages > 0).then(|| (variable_place[i], 1.0));
            of_theta.chain(of_c).collect()
        });
        let constraints = ingredients.problem().rows();
        let input_rows = (0..constraints.len())
            .filter(|&i| constraints.c.row(i).len() == 0)
            .map(|i| {
                constraints
                    .d
                    .row(i)
                    .map(|(j, v)| (j as u32, v))
                    .collect::<Vec<_>>()
            });
        let pairs = order.pairs.len();
        Self {
            hessian: OwnedWindows::new(
                size,
                order.variables.iter().enumerate().map(|(k, &v)| {
                    program
                        .hessian
                        .row(v as usize)
                        .map(|(j, h)| (variable_place[j], h))
                        .filter(|e| e.0 as usize >= k)
                        .collect()
                }),
            ),
            linear_state: OwnedWindows::new(
                order.states.len(),
                order
                    .variables
                    .iter()
                    .map(|&v| moved(&program.from_state, v as usize, &state_place, 1.0)),
            ),
            linear_set_point: OwnedWindows::new(
                order.set_point.len(),
                order
                    .variables
                    .iter()
                    .map(|&v| moved(&program.from_set_point, v as usize, &set_point_place, 1.0)),
            ),
            rows: scaled(&program.rows, &variable_place),
            rows_state: scaled(&program.state_rows, &state_place),
            upper: side(0),
            lower: side(1),
            groups: (0..pairs)
                .step_by(GROUP)
                .map(|g| g as u32)
                .chain([pairs as u32])
                .collect(),
            gain: OwnedWindows::new(
                order.states.len(),
                (0..m).map(|i| {
                    let least = negligible(gain, i);
                    gain.row(i)
                        .filter(|e| e.1.abs() > least)
                        .map(|(j, v)| (state_place[j], v))
                        .collect()
                }),
            ),
            first_input: OwnedWindows::new(size, first_input),
            input_rows: OwnedWindows::new(m, input_rows),
            state_order: order.states.clone(),
            set_point_order: order.set_point.clone(),
            next_stage: order
                .variables
                .iter()
                .map(|&v| {
                    let v = v as usize;
                    if v >= theta {
                        variable_place[v]
                    } else if v + m < theta {
                        variable_place[v + m]
                    } else {
                        NO_ROW
                    }
                })
                .collect(),
            scale,
        }
    }

    /// The tables, checked: what it costs is small beside a step.
    pub(super) fn view(&self) -> Result<BandedTables<'_, f64>, TableError> {
        BandedTables::new(BandedData {
            hessian: self.hessian.view()?,
            linear_state: self.linear_state.view()?,
            linear_set_point: self.linear_set_point.view()?,
            rows: self.rows.view()?,
            rows_state: self.rows_state.view()?,
            upper: &self.upper,
            lower: &self.lower,
            scale: &self.scale,
            groups: &self.groups,
            gain: self.gain.view()?,
            first_input: self.first_input.view()?,
            input_rows: self.input_rows.view()?,
            state_order: &self.state_order,
            set_point_order: &self.set_point_order,
            next_stage: &self.next_stage,
        })
    }

    /// K x + L θ + c_0 for a state and a solution in the order of the problem; as the runtime forms it.
    pub(super) fn first_input(&self, order: &Order, x: &[f64], z: &[f64]) -> Vec<f64> {
        let gather = |order: &[u32], v: &[f64]| -> Vec<f64> {
            order.iter().map(|&k| v[k as usize]).collect()
        };
        let (x, z) = (gather(&order.states, x), gather(&order.variables, z));
        let m = self.gain.first.len();
        let mut u: Vec<f64> = (0..m)
            .map(|i| self.gain.dot(i, &x) + self.first_input.dot(i, &z))
            .collect();
        let outside = (0..self.input_rows.first.len())
            .fold(1.0_f64, |a, i| a.max(self.input_rows.dot(i, &u)));
        for v in &mut u {
            *v /= outside;
        }
        u
    }

    /// Mean window of a row of G.
    pub(super) fn mean_window(&self) -> f64 {
        self.rows.mean()
    }
}
