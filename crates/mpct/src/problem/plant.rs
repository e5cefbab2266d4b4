//! The plant (1): x⁺ = A x + B u, given in discrete time or discretised with a zero-order hold.

use super::discretise::zero_order_hold;
use crate::error::DesignError;
use crate::matrix::SparseMatrix;

/// An operating point (x_op, u_op) in physical coordinates.
///
/// The plant is x⁺ − x_op = A (x − x_op) + B (u − u_op); a design works in the shifted coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct OperatingPoint {
    /// x_op, length n.
    pub state: Vec<f64>,
    /// u_op, length m.
    pub input: Vec<f64>,
}

/// Names and units of states and inputs, for reports. Each list is empty or has one text per state (or input).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Labels {
    /// Names of the states.
    pub state_names: Vec<String>,
    /// Units of the states; an empty text for none.
    pub state_units: Vec<String>,
    /// Names of the inputs.
    pub input_names: Vec<String>,
    /// Units of the inputs; an empty text for none.
    pub input_units: Vec<String>,
}

/// A linear plant with n states and m inputs.
///
/// ```
/// use mpct::{Matrix, Plant};
/// let plant = Plant::discrete(
///     Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
///     Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
/// )?;
/// assert_eq!((plant.states(), plant.inputs()), (2, 2));
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Plant {
    a: SparseMatrix,
    b: SparseMatrix,
    /// The matrices before discretisation, where the sparsity of the physics is still visible.
    continuous: Option<(SparseMatrix, SparseMatrix)>,
    sampling_time: Option<f64>,
    operating_point: OperatingPoint,
    labels: Labels,
}

impl Plant {
    /// A discrete-time plant: A is n × n, B is n × m.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`].
    pub fn discrete(
        a: impl Into<SparseMatrix>,
        b: impl Into<SparseMatrix>,
    ) -> Result<Self, DesignError> {
        let (a, b) = (a.into(), b.into());
        check_shapes(&a, &b)?;
        Ok(Self {
            operating_point: OperatingPoint {
                state: vec![0.0; a.rows()],
                input: vec![0.0; b.cols()],
            },
            a,
            b,
            continuous: None,
            sampling_time: None,
            labels: Labels::default(),
        })
    }

    /// A continuous-time plant ẋ = A x + B u, discretised with a zero-order hold of `sampling_time` seconds:
    /// A_d = e^{A T}, B_d = ∫₀ᵀ e^{A τ} dτ B.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`]; [`DesignError::OutOfRange`] when the sampling time is
    /// not a positive finite number.
    pub fn continuous(
        a: impl Into<SparseMatrix>,
        b: impl Into<SparseMatrix>,
        sampling_time: f64,
    ) -> Result<Self, DesignError> {
        let (ac, bc) = (a.into(), b.into());
        check_shapes(&ac, &bc)?;
        check_sampling_time(sampling_time)?;
        let (a, b) = zero_order_hold(&ac, &bc, sampling_time)?;
        let mut plant = Self::discrete(a, b)?;
        plant.continuous = Some((ac, bc));
        plant.sampling_time = Some(sampling_time);
        Ok(plant)
    }

    /// States the sampling time of a discrete plant in seconds, used in reports only.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] when it is not a positive finite number.
    pub fn with_sampling_time(mut self, sampling_time: f64) -> Result<Self, DesignError> {
        check_sampling_time(sampling_time)?;
        self.sampling_time = Some(sampling_time);
        Ok(self)
    }

    /// States the operating point around which the plant is linear. Constraints, set-points and states are then
    /// given in physical coordinates.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`].
    pub fn with_operating_point(
        mut self,
        state: Vec<f64>,
        input: Vec<f64>,
    ) -> Result<Self, DesignError> {
        check_vector("operating_point.state", &state, self.states())?;
        check_vector("operating_point.input", &input, self.inputs())?;
        self.operating_point = OperatingPoint { state, input };
        Ok(self)
    }

    /// Names states and inputs, and their units, for reports.
    ///
    /// # Errors
    /// [`DesignError::Shape`] when a list is neither empty nor as long as there are states (or inputs).
    pub fn with_labels(mut self, labels: Labels) -> Result<Self, DesignError> {
        let (n, m) = (self.states(), self.inputs());
        for (what, list, len) in [
            ("plant.state_names", &labels.state_names, n),
            ("plant.state_units", &labels.state_units, n),
            ("plant.input_names", &labels.input_names, m),
            ("plant.input_units", &labels.input_units, m),
        ] {
            if !list.is_empty() && list.len() != len {
                return Err(DesignError::Shape {
                    what: what.into(),
                    expected: format!("{len} texts"),
                    found: format!("{}", list.len()),
                });
            }
        }
        self.labels = labels;
        Ok(self)
    }

    /// Number of states n.
    pub fn states(&self) -> usize {
        self.a.rows()
    }

    /// Number of inputs m.
    pub fn inputs(&self) -> usize {
        self.b.cols()
    }

    /// A of the discrete-time plant, n × n.
    pub fn a(&self) -> &SparseMatrix {
        &self.a
    }

    /// B of the discrete-time plant, n × m.
    pub fn b(&self) -> &SparseMatrix {
        &self.b
    }

    /// The continuous-time matrices, when the plant was given by them.
    pub fn continuous_matrices(&self) -> Option<(&SparseMatrix, &SparseMatrix)> {
        self.continuous.as_ref().map(|(a, b)| (a, b))
    }

    /// The sampling time in seconds, when known.
    pub fn sampling_time(&self) -> Option<f64> {
        self.sampling_time
    }

    /// Names and units; empty unless stated.
    pub fn labels(&self) -> &Labels {
        &self.labels
    }

    /// The operating point; the origin unless stated.
    pub fn operating_point(&self) -> &OperatingPoint {
        &self.operating_point
    }
}

fn check_sampling_time(sampling_time: f64) -> Result<(), DesignError> {
    if sampling_time > 0.0 && sampling_time.is_finite() {
        Ok(())
    } else {
        Err(DesignError::OutOfRange {
            what: "plant.sampling_time".into(),
            expected: "a finite number of seconds > 0".into(),
            found: format!("{sampling_time}"),
        })
    }
}

fn check_shapes(a: &SparseMatrix, b: &SparseMatrix) -> Result<(), DesignError> {
    let shape = |what: &str, expected: String, found: String| DesignError::Shape {
        what: what.into(),
        expected,
        found,
    };
    if a.rows() == 0 || a.cols() != a.rows() {
        return Err(shape(
            "plant.A",
            "a square matrix with at least one row".into(),
            format!("{} x {}", a.rows(), a.cols()),
        ));
    }
    if b.rows() != a.rows() || b.cols() == 0 {
        return Err(shape(
            "plant.B",
            format!("{} rows, as A has, and at least one column", a.rows()),
            format!("{} x {}", b.rows(), b.cols()),
        ));
    }
    check_finite("plant.A", a)?;
    check_finite("plant.B", b)
}

/// Refuses a matrix with an entry that is not finite.
pub(crate) fn check_finite(what: &str, m: &SparseMatrix) -> Result<(), DesignError> {
    match m.first_not_finite() {
        None => Ok(()),
        Some((row, column, value)) => Err(DesignError::NotFinite {
            what: what.into(),
            row,
            column,
            value,
        }),
    }
}

/// Refuses a vector of another length than `n`, or with an entry that is not finite.
pub(crate) fn check_vector(what: &str, v: &[f64], n: usize) -> Result<(), DesignError> {
    if v.len() != n {
        return Err(DesignError::Shape {
            what: what.into(),
            expected: format!("{n} numbers"),
            found: format!("{}", v.len()),
        });
    }
    match v.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(row) => Err(DesignError::NotFinite {
            what: what.into(),
            row,
            column: 0,
            value: v[row],
        }),
    }
}
