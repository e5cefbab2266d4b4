//! The constraints (2), as users state them and as normalised rows (18): C x + D u ≤ 1.

use super::ellipsoid::Ellipsoid;
use super::plant::{OperatingPoint, check_finite};
use crate::error::DesignError;
use crate::matrix::SparseMatrix;
use std::fmt;

/// Constraints in physical coordinates: bounds on states and inputs, any rows C x + D u ≤ d, and ellipsoids.
///
/// A bound of ±∞ is no bound.
///
/// ```
/// use mpct::Constraints;
/// let constraints = Constraints::new(2, 1)
///     .state_bounds(&[-3.0, f64::NEG_INFINITY], &[3.0, f64::INFINITY])?
///     .input_bounds(&[-2.0], &[2.0])?;
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Constraints {
    states: usize,
    inputs: usize,
    state_lower: Vec<f64>,
    state_upper: Vec<f64>,
    input_lower: Vec<f64>,
    input_upper: Vec<f64>,
    mixed: Vec<MixedRows>,
    pub(super) ellipsoids: Vec<Ellipsoid>,
}

/// A block of rows C x + D u ≤ d.
#[derive(Clone, Debug, PartialEq)]
pub struct MixedRows {
    /// C, p × n.
    pub c: SparseMatrix,
    /// D, p × m.
    pub d: SparseMatrix,
    /// d, length p.
    pub bound: Vec<f64>,
}

/// Where a constraint row comes from; its `Display` is the name used in messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RowSource {
    /// Lower bound of a state.
    StateLower(usize),
    /// Upper bound of a state.
    StateUpper(usize),
    /// Lower bound of an input.
    InputLower(usize),
    /// Upper bound of an input.
    InputUpper(usize),
    /// Row of a block of mixed constraints.
    Mixed {
        /// The block.
        block: usize,
        /// The row in the block.
        row: usize,
    },
    /// An ellipsoid.
    Ellipsoid(usize),
}

impl fmt::Display for RowSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StateLower(i) => write!(f, "state_lower[{i}]"),
            Self::StateUpper(i) => write!(f, "state_upper[{i}]"),
            Self::InputLower(i) => write!(f, "input_lower[{i}]"),
            Self::InputUpper(i) => write!(f, "input_upper[{i}]"),
            Self::Mixed { block, row } => write!(f, "mixed[{block}] row {row}"),
            Self::Ellipsoid(i) => write!(f, "ellipsoid[{i}]"),
        }
    }
}

/// The constraints in shifted coordinates, each row divided by its room at the origin: C x + D u ≤ 1 (18).
#[derive(Clone, Debug, PartialEq)]
pub struct ConstraintRows {
    /// C, p × n.
    pub c: SparseMatrix,
    /// D, p × m.
    pub d: SparseMatrix,
    /// The room of each row at the operating point, in the units of the user's row: row · scale is the user's.
    pub scale: Vec<f64>,
    /// Where each row comes from.
    pub source: Vec<RowSource>,
}

impl ConstraintRows {
    /// Number of rows p.
    pub fn len(&self) -> usize {
        self.source.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.source.is_empty()
    }

    /// The largest violation of C x + D u ≤ 1 in user units, and its row; `None` when every row is satisfied.
    pub fn worst_violation(&self, x: &[f64], u: &[f64]) -> Option<(usize, f64)> {
        (0..self.len())
            .map(|i| {
                let value = self.c.row_dot(i, x) + self.d.row_dot(i, u) - 1.0;
                (i, value * self.scale[i])
            })
            .filter(|r| r.1 > 0.0)
            .max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

impl Constraints {
    /// No constraints yet, for n states and m inputs.
    pub fn new(states: usize, inputs: usize) -> Self {
        Self {
            states,
            inputs,
            state_lower: vec![f64::NEG_INFINITY; states],
            state_upper: vec![f64::INFINITY; states],
            input_lower: vec![f64::NEG_INFINITY; inputs],
            input_upper: vec![f64::INFINITY; inputs],
            mixed: Vec::new(),
            ellipsoids: Vec::new(),
        }
    }

    /// lower ≤ x ≤ upper, each of length n.
    ///
    /// # Errors
    /// [`DesignError::Shape`]; [`DesignError::OutOfRange`] for NaN or lower ≥ upper.
    pub fn state_bounds(mut self, lower: &[f64], upper: &[f64]) -> Result<Self, DesignError> {
        check_bounds("state", lower, upper, self.states)?;
        self.state_lower = lower.to_vec();
        self.state_upper = upper.to_vec();
        Ok(self)
    }

    /// lower ≤ u ≤ upper, each of length m.
    ///
    /// # Errors
    /// [`DesignError::Shape`]; [`DesignError::OutOfRange`] for NaN or lower ≥ upper.
    pub fn input_bounds(mut self, lower: &[f64], upper: &[f64]) -> Result<Self, DesignError> {
        check_bounds("input", lower, upper, self.inputs)?;
        self.input_lower = lower.to_vec();
        self.input_upper = upper.to_vec();
        Ok(self)
    }

    /// Adds a block of rows C x + D u ≤ d. A row with d = +∞ is no constraint.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`]; [`DesignError::OutOfRange`] for d = NaN or −∞.
    pub fn mixed(
        mut self,
        c: impl Into<SparseMatrix>,
        d: impl Into<SparseMatrix>,
        bound: Vec<f64>,
    ) -> Result<Self, DesignError> {
        let rows = MixedRows {
            c: c.into(),
            d: d.into(),
            bound,
        };
        let name = format!("constraints.mixed[{}]", self.mixed.len());
        let p = rows.bound.len();
        for (key, m, cols) in [("C", &rows.c, self.states), ("D", &rows.d, self.inputs)] {
            if m.rows() != p || m.cols() != cols {
                return Err(DesignError::Shape {
                    what: format!("{name}.{key}"),
                    expected: format!("{p} x {cols} (rows as in d)"),
                    found: format!("{} x {}", m.rows(), m.cols()),
                });
            }
            check_finite(&format!("{name}.{key}"), m)?;
        }
        if let Some(i) = rows.bound.iter().position(|&v| !(v > f64::NEG_INFINITY)) {
            return Err(DesignError::OutOfRange {
                what: format!("{name}.d[{i}]"),
                expected: "a number, or inf for no constraint".into(),
                found: format!("{}", rows.bound[i]),
            });
        }
        self.mixed.push(rows);
        Ok(self)
    }

    /// Number of states n.
    pub fn states(&self) -> usize {
        self.states
    }

    /// Number of inputs m.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Lower and upper bounds of the states, each of length n.
    pub fn state_limits(&self) -> (&[f64], &[f64]) {
        (&self.state_lower, &self.state_upper)
    }

    /// Lower and upper bounds of the inputs, each of length m.
    pub fn input_limits(&self) -> (&[f64], &[f64]) {
        (&self.input_lower, &self.input_upper)
    }

    /// The blocks of mixed rows.
    pub fn mixed_rows(&self) -> &[MixedRows] {
        &self.mixed
    }

    /// The rows in shifted coordinates, normalised to C x + D u ≤ 1.
    ///
    /// # Errors
    /// [`DesignError::OriginNotInterior`] when the operating point is on or outside a row.
    pub(crate) fn normalised(&self, at: &OperatingPoint) -> Result<ConstraintRows, DesignError> {
        let mut c = Vec::new();
        let mut d = Vec::new();
        let mut scale = Vec::new();
        let mut source = Vec::new();
        let at_origin = at.state.iter().chain(&at.input).all(|&v| v == 0.0);
        let mut push = |cx: Vec<(u32, f64)>, du: Vec<(u32, f64)>, bound: f64, from: RowSource| {
            if bound == f64::INFINITY {
                return Ok(());
            }
            let value = |row: &[(u32, f64)], at: &[f64]| -> f64 {
                row.iter().map(|&(j, v)| v * at[j as usize]).sum()
            };
            let room = bound - value(&cx, &at.state) - value(&du, &at.input);
            if !(room > 0.0) {
                return Err(DesignError::OriginNotInterior {
                    row: from.to_string(),
                    offset: room,
                    hint: if at_origin {
                        "; shift the problem with plant.operating_point or widen the row".into()
                    } else {
                        "; the origin is the operating point here".into()
                    },
                });
            }
            // A row without coefficients says 0 <= room: nothing.
            if cx.iter().chain(&du).all(|e| e.1 == 0.0) {
                return Ok(());
            }
            let divide = |row: Vec<(u32, f64)>| -> Vec<(u32, f64)> {
                row.into_iter().map(|(j, v)| (j, v / room)).collect()
            };
            c.push(divide(cx));
            d.push(divide(du));
            scale.push(room);
            source.push(from);
            Ok(())
        };
        for i in 0..self.states {
            let j = i as u32;
            push(
                vec![(j, 1.0)],
                vec![],
                self.state_upper[i],
                RowSource::StateUpper(i),
            )?;
            push(
                vec![(j, -1.0)],
                vec![],
                -self.state_lower[i],
                RowSource::StateLower(i),
            )?;
        }
        for i in 0..self.inputs {
            let j = i as u32;
            push(
                vec![],
                vec![(j, 1.0)],
                self.input_upper[i],
                RowSource::InputUpper(i),
            )?;
            push(
                vec![],
                vec![(j, -1.0)],
                -self.input_lower[i],
                RowSource::InputLower(i),
            )?;
        }
        for (block, rows) in self.mixed.iter().enumerate() {
            for row in 0..rows.bound.len() {
                let list = |m: &SparseMatrix| -> Vec<(u32, f64)> {
                    m.row(row).map(|(j, v)| (j as u32, v)).collect()
                };
                push(
                    list(&rows.c),
                    list(&rows.d),
                    rows.bound[row],
                    RowSource::Mixed { block, row },
                )?;
            }
        }
        let p = source.len();
        let rows = ConstraintRows {
            c: SparseMatrix::from_row_lists(p, self.states, c),
            d: SparseMatrix::from_row_lists(p, self.inputs, d),
            scale,
            source,
        };
        // Dividing by a tiny room can overflow.
        check_finite(
            "constraints, divided by their room at the operating point",
            &rows.c,
        )?;
        check_finite(
            "constraints, divided by their room at the operating point",
            &rows.d,
        )?;
        Ok(rows)
    }
}

fn check_bounds(what: &str, lower: &[f64], upper: &[f64], n: usize) -> Result<(), DesignError> {
    for (side, v) in [("lower", lower), ("upper", upper)] {
        if v.len() != n {
            return Err(DesignError::Shape {
                what: format!("constraints.{what}_{side}"),
                expected: format!("{n} numbers, one for each {what}"),
                found: format!("{}", v.len()),
            });
        }
    }
    for i in 0..n {
        // Written so that NaN fails.
        let ordered = lower[i] < upper[i];
        if !(ordered && lower[i] < f64::INFINITY && upper[i] > f64::NEG_INFINITY) {
            return Err(DesignError::OutOfRange {
                what: format!("constraints.{what}_lower[{i}], constraints.{what}_upper[{i}]"),
                expected: "lower < upper".into(),
                found: format!("lower {} and upper {}", lower[i], upper[i]),
            });
        }
    }
    Ok(())
}
