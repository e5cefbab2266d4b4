//! Ellipsoidal constraints, as users state them and as norms: ‖F x + G u + h‖ ≤ 1 in shifted coordinates.
//!
//! (x − c)ᵀE(x − c) ≤ 1 with E = FᵀF is ‖F x − F c‖ ≤ 1. E may be singular: an ellipsoid that is open in some directions
//! is a cylinder. Theory and proofs: `docs/ellipsoids.md`.

use super::constraints::{Constraints, RowSource};
use super::plant::{OperatingPoint, check_finite, check_vector};
use super::weights::{Definite, Weight};
use crate::error::DesignError;
use crate::linalg;
use crate::matrix::SparseMatrix;

/// What an ellipsoid bounds.
#[derive(Clone, Debug, PartialEq)]
pub enum EllipsoidShape {
    /// E of (x − c)ᵀE(x − c) ≤ 1, n × n, positive semidefinite, not zero.
    State(SparseMatrix),
    /// E of (u − c)ᵀE(u − c) ≤ 1, m × m, positive semidefinite, not zero.
    Input(SparseMatrix),
    /// C (q × n) and D (q × m) of ‖C (x − x_op) + D (u − u_op)‖ ≤ 1.
    Mixed {
        /// C, q × n.
        c: SparseMatrix,
        /// D, q × m.
        d: SparseMatrix,
    },
}

/// An ellipsoidal constraint in physical coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Ellipsoid {
    pub(super) shape: EllipsoidShape,
    pub(super) center: Option<Vec<f64>>,
}

impl Ellipsoid {
    /// What it bounds.
    pub fn shape(&self) -> &EllipsoidShape {
        &self.shape
    }

    /// Its center c, length n or m, where one is stated. The operating point otherwise.
    pub fn center(&self) -> Option<&[f64]> {
        self.center.as_deref()
    }
}

/// ‖F x + G u + h‖ ≤ 1 in shifted coordinates, ‖h‖ < 1.
#[derive(Clone, Debug, PartialEq)]
pub struct NormConstraint {
    /// F, q × n.
    pub f: SparseMatrix,
    /// G, q × m.
    pub g: SparseMatrix,
    /// h, length q.
    pub offset: Vec<f64>,
    /// Which ellipsoid of the constraints it is.
    pub source: RowSource,
}

/// Eigenvalues of E below this, relative to the largest, are zero: rounding of a singular E.
const RANK_TOLERANCE: f64 = 1e-12;

impl NormConstraint {
    /// q, the dimension of the vector whose norm is bounded.
    pub fn dimension(&self) -> usize {
        self.offset.len()
    }

    /// Whether the input takes part.
    pub fn has_input(&self) -> bool {
        self.g.nonzeros() > 0
    }

    /// ‖F x + G u + h‖: at most 1 where the constraint holds.
    pub fn value(&self, x: &[f64], u: &[f64]) -> f64 {
        (0..self.dimension())
            .map(|k| self.f.row_dot(k, x) + self.g.row_dot(k, u) + self.offset[k])
            .fold(0.0_f64, f64::hypot)
    }
}

/// F with FᵀF = E: rows along the principal axes of E that are bounded.
fn factor(what: &str, e: &SparseMatrix) -> Result<SparseMatrix, DesignError> {
    let n = e.rows();
    if e.entries().all(|(i, j, _)| i == j) {
        let rows: Vec<Vec<(u32, f64)>> = (0..n)
            .map(|i| (i, e.get(i, i)))
            .filter(|v| v.1 > 0.0)
            .map(|(i, v)| vec![(i as u32, v.sqrt())])
            .collect();
        return Ok(SparseMatrix::from_row_lists(rows.len(), n, rows));
    }
    let (values, vectors) = linalg::symmetric_eigen(what, &linalg::dense(e))?;
    let largest = values.last().copied().unwrap_or(0.0);
    let rows: Vec<Vec<(u32, f64)>> = (0..n)
        .filter(|&k| values[k] > RANK_TOLERANCE * largest)
        .map(|k| {
            (0..n)
                .map(|i| (i as u32, values[k].sqrt() * vectors[(i, k)]))
                .filter(|e| e.1 != 0.0)
                .collect()
        })
        .collect();
    Ok(SparseMatrix::from_row_lists(rows.len(), n, rows))
}

/// E, checked: of order n, finite, symmetric, positive semidefinite, not zero.
fn checked(what: &str, e: &Weight, n: usize) -> Result<SparseMatrix, DesignError> {
    let matrix = e.to_matrix(what, n, Definite::NonNegative)?;
    if matrix.entries().any(|e| e.2 != 0.0) {
        Ok(matrix)
    } else {
        Err(DesignError::OutOfRange {
            what: what.into(),
            expected: "a matrix that is not zero; without a bound, leave the ellipsoid out".into(),
            found: "zero".into(),
        })
    }
}

impl Constraints {
    /// Adds (x − x_op)ᵀE(x − x_op) ≤ 1, an ellipsoid around the operating point. E is a number (times the identity), a
    /// diagonal or an n × n matrix, positive semidefinite: directions that it leaves open must be bounded by others.
    ///
    /// ```
    /// use mpct::Constraints;
    /// // ‖x‖ ≤ 3 and ‖u‖ ≤ 2.
    /// let constraints = Constraints::new(2, 2).state_ellipsoid(1.0 / 9.0)?.input_ellipsoid(0.25)?;
    /// assert_eq!(constraints.ellipsoids().len(), 2);
    /// assert!(Constraints::new(2, 2).state_ellipsoid(vec![1.0, -1.0]).is_err());
    /// # Ok::<(), mpct::DesignError>(())
    /// ```
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`], [`DesignError::NotSymmetric`];
    /// [`DesignError::NotPositiveDefinite`] with an eigenvalue < 0; [`DesignError::OutOfRange`] for zero.
    pub fn state_ellipsoid(self, e: impl Into<Weight>) -> Result<Self, DesignError> {
        self.with_ellipsoid(e.into(), true, None)
    }

    /// Adds (x − c)ᵀE(x − c) ≤ 1 around a center c of length n, in physical coordinates. The operating point must lie
    /// strictly inside.
    ///
    /// # Errors
    /// Those of [`state_ellipsoid`](Self::state_ellipsoid), also for the center.
    pub fn state_ellipsoid_around(
        self,
        e: impl Into<Weight>,
        center: Vec<f64>,
    ) -> Result<Self, DesignError> {
        self.with_ellipsoid(e.into(), true, Some(center))
    }

    /// Adds (u − u_op)ᵀE(u − u_op) ≤ 1, as [`state_ellipsoid`](Self::state_ellipsoid) with an m × m matrix.
    ///
    /// # Errors
    /// Those of [`state_ellipsoid`](Self::state_ellipsoid).
    pub fn input_ellipsoid(self, e: impl Into<Weight>) -> Result<Self, DesignError> {
        self.with_ellipsoid(e.into(), false, None)
    }

    /// Adds (u − c)ᵀE(u − c) ≤ 1 around a center c of length m, in physical coordinates.
    ///
    /// # Errors
    /// Those of [`state_ellipsoid`](Self::state_ellipsoid), also for the center.
    pub fn input_ellipsoid_around(
        self,
        e: impl Into<Weight>,
        center: Vec<f64>,
    ) -> Result<Self, DesignError> {
        self.with_ellipsoid(e.into(), false, Some(center))
    }

    /// Adds ‖C (x − x_op) + D (u − u_op)‖ ≤ 1, with C q × n and D q × m.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`]; [`DesignError::OutOfRange`] when both are zero.
    pub fn norm_bound(
        mut self,
        c: impl Into<SparseMatrix>,
        d: impl Into<SparseMatrix>,
    ) -> Result<Self, DesignError> {
        let name = format!("constraints.ellipsoid[{}]", self.ellipsoids.len());
        let (c, d) = (c.into(), d.into());
        for (key, matrix, cols) in [("C", &c, self.states()), ("D", &d, self.inputs())] {
            if matrix.cols() != cols || matrix.rows() != c.rows() {
                return Err(DesignError::Shape {
                    what: format!("{name}.{key}"),
                    expected: format!("{} x {cols} (rows as in C)", c.rows()),
                    found: format!("{} x {}", matrix.rows(), matrix.cols()),
                });
            }
            check_finite(&format!("{name}.{key}"), matrix)?;
        }
        if c.entries().chain(d.entries()).all(|e| e.2 == 0.0) {
            return Err(DesignError::OutOfRange {
                what: format!("{name}.C and {name}.D"),
                expected: "an entry that is not zero".into(),
                found: "zero".into(),
            });
        }
        self.ellipsoids.push(Ellipsoid {
            shape: EllipsoidShape::Mixed { c, d },
            center: None,
        });
        Ok(self)
    }

    fn with_ellipsoid(
        mut self,
        e: Weight,
        of_state: bool,
        center: Option<Vec<f64>>,
    ) -> Result<Self, DesignError> {
        let name = format!("constraints.ellipsoid[{}]", self.ellipsoids.len());
        let (key, order) = if of_state {
            ("state", self.states())
        } else {
            ("input", self.inputs())
        };
        let matrix = checked(&format!("{name}.{key}"), &e, order)?;
        if let Some(center) = &center {
            check_vector(&format!("{name}.center"), center, order)?;
        }
        let shape = if of_state {
            EllipsoidShape::State(matrix)
        } else {
            EllipsoidShape::Input(matrix)
        };
        self.ellipsoids.push(Ellipsoid { shape, center });
        Ok(self)
    }

    /// Adds the ellipsoids of other constraints on as many states and inputs.
    ///
    /// # Errors
    /// [`DesignError::Shape`].
    pub fn with_ellipsoids_of(mut self, other: &Self) -> Result<Self, DesignError> {
        if (self.states(), self.inputs()) != (other.states(), other.inputs()) {
            return Err(DesignError::Shape {
                what: "the ellipsoids".into(),
                expected: format!("{} states and {} inputs", self.states(), self.inputs()),
                found: format!("{} and {}", other.states(), other.inputs()),
            });
        }
        self.ellipsoids.extend_from_slice(&other.ellipsoids);
        Ok(self)
    }

    /// The ellipsoids.
    pub fn ellipsoids(&self) -> &[Ellipsoid] {
        &self.ellipsoids
    }

    /// The ellipsoids in shifted coordinates, as norms.
    ///
    /// # Errors
    /// [`DesignError::OriginNotInterior`] when the operating point is on or outside of one.
    pub(crate) fn norms(&self, at: &OperatingPoint) -> Result<Vec<NormConstraint>, DesignError> {
        let (n, m) = (self.states(), self.inputs());
        self.ellipsoids
            .iter()
            .enumerate()
            .map(|(i, ellipsoid)| {
                let source = RowSource::Ellipsoid(i);
                let shifted = |f: &SparseMatrix, at: &[f64]| -> Vec<f64> {
                    match &ellipsoid.center {
                        Some(c) => {
                            let from: Vec<f64> = at.iter().zip(c).map(|(a, c)| a - c).collect();
                            f.mul_vec(&from)
                        }
                        None => vec![0.0; f.rows()],
                    }
                };
                let (f, g, offset) = match &ellipsoid.shape {
                    EllipsoidShape::State(e) => {
                        let f = factor(&source.to_string(), e)?;
                        let h = shifted(&f, &at.state);
                        let q = f.rows();
                        (f, SparseMatrix::zeros(q, m), h)
                    }
                    EllipsoidShape::Input(e) => {
                        let g = factor(&source.to_string(), e)?;
                        let h = shifted(&g, &at.input);
                        (SparseMatrix::zeros(g.rows(), n), g, h)
                    }
                    EllipsoidShape::Mixed { c, d } => (c.clone(), d.clone(), vec![0.0; c.rows()]),
                };
                let room = 1.0 - offset.iter().fold(0.0_f64, |a, v| a.hypot(*v));
                if !(room > 0.0) {
                    return Err(DesignError::OriginNotInterior {
                        row: source.to_string(),
                        offset: room,
                        hint: "; move its center to the operating point or make it larger".into(),
                    });
                }
                Ok(NormConstraint {
                    f,
                    g,
                    offset,
                    source,
                })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Matrix;

    fn at(state: &[f64], input: &[f64]) -> OperatingPoint {
        OperatingPoint {
            state: state.to_vec(),
            input: input.to_vec(),
        }
    }

    #[test]
    fn norms_are_the_quadratic_forms() {
        let e = Matrix::from_rows(&[[2.0, 0.6], [0.6, 0.5]]);
        let c = Constraints::new(2, 1)
            .state_ellipsoid_around(e, vec![0.1, -0.2])
            .unwrap()
            .input_ellipsoid(4.0)
            .unwrap();
        let norms = c.norms(&at(&[0.3, 0.1], &[1.0])).unwrap();
        // By the formula, in physical coordinates x = x_op + (0.2, -0.4), u = u_op − 0.3.
        let y = [0.3 + 0.2 - 0.1, 0.1 - 0.4 + 0.2];
        let form: f64 = 2.0 * y[0] * y[0] + 1.2 * y[0] * y[1] + 0.5 * y[1] * y[1];
        assert!((norms[0].value(&[0.2, -0.4], &[-0.3]) - form.sqrt()).abs() < 1e-14);
        assert!((norms[1].value(&[0.2, -0.4], &[-0.3]) - 0.6).abs() < 1e-14);
        assert!(!norms[0].has_input() && norms[1].has_input());
    }

    #[test]
    fn singular_matrices_are_cylinders() {
        let c = Constraints::new(2, 1)
            .state_ellipsoid(vec![0.0, 4.0])
            .unwrap();
        let norms = c.norms(&at(&[0.0; 2], &[0.0])).unwrap();
        assert_eq!(norms[0].dimension(), 1);
        let line = Matrix::from_rows(&[[1.0, 1.0], [1.0, 1.0]]);
        let c = Constraints::new(2, 1).state_ellipsoid(line).unwrap();
        let norms = c.norms(&at(&[0.0; 2], &[0.0])).unwrap();
        assert_eq!(norms[0].dimension(), 1);
        assert!((norms[0].value(&[1.0, 2.0], &[0.0]) - 3.0).abs() < 1e-14);
    }

    #[test]
    fn what_is_no_ellipsoid_is_refused() {
        let new = || Constraints::new(2, 1);
        let text = |r: Result<Constraints, DesignError>| r.unwrap_err().to_string();
        let indefinite = Matrix::from_rows(&[[1.0, 2.0], [2.0, 1.0]]);
        assert!(text(new().state_ellipsoid(indefinite)).contains("-1.0"));
        assert!(text(new().state_ellipsoid(0.0)).contains("not zero"));
        assert!(text(new().state_ellipsoid(f64::NAN)).contains("NaN"));
        assert!(text(new().state_ellipsoid(vec![1.0])).contains("ellipsoid[0].state"));
        assert!(text(new().input_ellipsoid(Matrix::from_rows(&[[1.0, 0.0]]))).contains("1 x 1"));
        assert!(text(new().state_ellipsoid_around(1.0, vec![0.0])).contains("center"));
        let off = new().state_ellipsoid_around(1.0, vec![0.6, 0.8]).unwrap();
        let error = off.norms(&at(&[0.0; 2], &[0.0])).unwrap_err();
        assert!(
            matches!(error, DesignError::OriginNotInterior { offset, .. } if offset.abs() < 1e-15)
        );
    }
}
