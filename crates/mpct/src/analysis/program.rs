//! The rows and cones of a controller's program with the state as a variable: {(x, z) : W x + G z ≤ 1, ‖S x + T z + t‖ ≤ 1}, those of
//! step 0 included.

use crate::control::{Controller, ProgramCone};
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::optimization::{Ball, Body, BodyFailure, add_product};
use crate::problem::RowSource;
use crate::problem::plant::check_vector;
use serde::Serialize;
use std::fmt;

/// A row of a controller's program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProgramRow {
    /// The constraint it comes from.
    pub source: RowSource,
    /// The predicted step it speaks of; `None` for a row of θ ∈ λΘ.
    pub step: Option<usize>,
}

impl fmt::Display for ProgramRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.step {
            Some(step) => write!(f, "{} at step {step}", self.source),
            None => write!(f, "{} of the scaled equilibria", self.source),
        }
    }
}

impl Serialize for ProgramRow {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// W x + G z ≤ 1 in shifted coordinates.
#[derive(Clone, Debug)]
pub(super) struct StateProgram {
    pub(super) state_rows: Dense,
    pub(super) rows: Dense,
    pub(super) names: Vec<ProgramRow>,
    /// ‖S x + T z + t‖ ≤ 1, rows of step 0 included.
    cones: Vec<ProgramCone>,
    pub(super) cone_names: Vec<ProgramRow>,
    /// The operating point's state.
    pub(super) origin: Vec<f64>,
}

impl StateProgram {
    pub(super) fn of(controller: &Controller) -> Self {
        let problem = controller.ingredients().problem();
        let constraints = problem.rows();
        let (state_rows, rows) = controller.program_rows();
        let mut names = controller.program_row_names();
        // Rows of the state alone at step 0, which the program leaves out: no input can mend them.
        let first: Vec<usize> = (0..constraints.len())
            .filter(|&i| constraints.d.row(i).len() == 0)
            .collect();
        let c = linalg::dense(&constraints.c.select_rows(&first));
        let p = rows.nrows();
        names.extend(first.iter().map(|&i| ProgramRow {
            source: constraints.source[i],
            step: Some(0),
        }));
        let mut cones = controller.program_cones().to_vec();
        let mut cone_names = controller.program_cone_names();
        for bound in problem.norms().iter().filter(|b| !b.has_input()) {
            cones.push(ProgramCone {
                map: Dense::zeros(bound.dimension(), rows.ncols()),
                from_state: linalg::dense(&bound.f),
                offset: bound.offset.clone(),
            });
            cone_names.push(ProgramRow {
                source: bound.source,
                step: Some(0),
            });
        }
        Self {
            cones,
            cone_names,
            state_rows: Dense::from_fn(names.len(), state_rows.ncols(), |i, j| {
                if i < p {
                    state_rows[(i, j)]
                } else {
                    c[(i - p, j)]
                }
            }),
            rows: Dense::from_fn(names.len(), rows.ncols(), |i, j| {
                if i < p { rows[(i, j)] } else { 0.0 }
            }),
            names,
            origin: problem.plant().operating_point().state.clone(),
        }
    }

    pub(super) fn states(&self) -> usize {
        self.state_rows.ncols()
    }

    /// x − x_op, checked.
    pub(super) fn shifted(&self, what: &str, state: &[f64]) -> Result<Vec<f64>, DesignError> {
        check_vector(what, state, self.states())?;
        Ok(state.iter().zip(&self.origin).map(|(x, o)| x - o).collect())
    }

    pub(super) fn physical(&self, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.origin).map(|(x, o)| x + o).collect()
    }

    /// The body of (s, z) with x = at + E s.
    pub(super) fn body(&self, at: &[f64], directions: &Dense) -> Body {
        let k = directions.ncols();
        let along = &self.state_rows * directions;
        let mut bounds = vec![1.0; self.names.len()];
        add_product(&mut bounds, &self.state_rows, at, -1.0);
        Body {
            rows: Dense::from_fn(self.names.len(), k + self.rows.ncols(), |i, j| {
                if j < k {
                    along[(i, j)]
                } else {
                    self.rows[(i, j - k)]
                }
            }),
            bounds,
            balls: self
                .cones
                .iter()
                .map(|cone| {
                    let along = &cone.from_state * directions;
                    Ball {
                        map: Dense::from_fn(along.nrows(), k + self.rows.ncols(), |i, j| {
                            if j < k {
                                along[(i, j)]
                            } else {
                                cone.map[(i, j - k)]
                            }
                        }),
                        offset: cone.offset_at(at),
                        radius: 1.0,
                    }
                })
                .collect(),
        }
    }

    /// Two different coordinates in range.
    pub(super) fn check_coordinates(&self, (i, j): (usize, usize)) -> Result<(), DesignError> {
        let n = self.states();
        if i < n && j < n && i != j {
            Ok(())
        } else {
            Err(DesignError::OutOfRange {
                what: "the two coordinates".into(),
                expected: format!("different, each from 0 to {}", n - 1),
                found: format!("{i} and {j}"),
            })
        }
    }

    /// E = [e_i, e_j].
    pub(super) fn plane(&self, (i, j): (usize, usize)) -> Dense {
        Dense::from_fn(self.states(), 2, |r, c| {
            f64::from(u8::from(r == if c == 0 { i } else { j }))
        })
    }
}

pub(super) fn failure(
    what: &str,
    direction: impl Into<String>,
    failure: BodyFailure,
) -> DesignError {
    match failure {
        BodyFailure::Unbounded => DesignError::Unbounded {
            direction: direction.into(),
        },
        BodyFailure::Unsolved(detail) => DesignError::Solver {
            what: what.into(),
            detail,
        },
    }
}
