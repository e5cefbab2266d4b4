//! The weights of the stage cost (4) and of the offset cost (10).

use crate::error::DesignError;
use crate::linalg;
use crate::matrix::{Matrix, SparseMatrix};

/// A weight: a scalar times the identity, a diagonal, or a matrix.
///
/// ```
/// use mpct::Weight;
/// let q: Weight = 10.0.into();
/// let r: Weight = vec![1.0, 1.5].into();
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Weight {
    /// w I.
    Scalar(f64),
    /// diag(w).
    Diagonal(Vec<f64>),
    /// A symmetric matrix.
    Matrix(SparseMatrix),
}

impl From<f64> for Weight {
    fn from(w: f64) -> Self {
        Self::Scalar(w)
    }
}

impl From<Vec<f64>> for Weight {
    fn from(w: Vec<f64>) -> Self {
        Self::Diagonal(w)
    }
}

impl From<Matrix> for Weight {
    fn from(w: Matrix) -> Self {
        Self::Matrix((&w).into())
    }
}

impl From<SparseMatrix> for Weight {
    fn from(w: SparseMatrix) -> Self {
        Self::Matrix(w)
    }
}

/// Which values a weight may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Definite {
    Positive,
    /// Zero allowed: the input part of the offset cost.
    NonNegative,
}

/// Largest |w_ij − w_ji|, relative to the largest entry, that passes as rounding of a symmetric matrix. Above it a
/// weight is refused: an asymmetric one is nearly always a typing mistake.
const SYMMETRY_TOLERANCE: f64 = 1e-10;

impl Weight {
    /// The matrix of order `n`, checked: finite, symmetric, positive definite (or non-negative).
    pub(crate) fn to_matrix(
        &self,
        what: &str,
        n: usize,
        definite: Definite,
    ) -> Result<SparseMatrix, DesignError> {
        let m = match self {
            Self::Scalar(w) => SparseMatrix::from_diagonal(&vec![*w; n]),
            Self::Diagonal(w) => {
                if w.len() != n {
                    return Err(DesignError::Shape {
                        what: what.into(),
                        expected: format!(
                            "a scalar, {n} numbers (a diagonal), or a {n} x {n} matrix"
                        ),
                        found: format!("{} numbers", w.len()),
                    });
                }
                SparseMatrix::from_diagonal(w)
            }
            Self::Matrix(m) => {
                if (m.rows(), m.cols()) != (n, n) {
                    return Err(DesignError::Shape {
                        what: what.into(),
                        expected: format!("{n} x {n}"),
                        found: format!("{} x {}", m.rows(), m.cols()),
                    });
                }
                m.clone()
            }
        };
        super::plant::check_finite(what, &m)?;
        let largest = m.entries().fold(0.0_f64, |a, e| a.max(e.2.abs()));
        for (i, j, upper) in m.entries() {
            let lower = m.get(j, i);
            if !((upper - lower).abs() <= SYMMETRY_TOLERANCE * largest) {
                let (row, column, upper, lower) = if i < j {
                    (i, j, upper, lower)
                } else {
                    (j, i, lower, upper)
                };
                return Err(DesignError::NotSymmetric {
                    what: what.into(),
                    row,
                    column,
                    upper,
                    lower,
                });
            }
        }
        let diagonal = m.entries().all(|(i, j, _)| i == j);
        let smallest_eigenvalue = if diagonal {
            (0..n).map(|i| m.get(i, i)).fold(f64::INFINITY, f64::min)
        } else {
            linalg::smallest_symmetric_eigenvalue(what, &m)?
        };
        let fine = match definite {
            // An eigenvalue at rounding level of the largest entry is not a positive weight.
            Definite::Positive => {
                smallest_eigenvalue > if diagonal { 0.0 } else { 1e-14 * largest }
            }
            Definite::NonNegative => smallest_eigenvalue >= -1e-12 * largest,
        };
        if fine {
            // Symmetrised, so that later products are symmetric to the last bit.
            Ok(if diagonal {
                m
            } else {
                m.combine(0.5, &m.transpose(), 0.5)
            })
        } else {
            Err(DesignError::NotPositiveDefinite {
                what: what.into(),
                smallest_eigenvalue,
            })
        }
    }
}

/// The weights Q (n × n), R (m × m), O (n × n) and the optional weight of the input part of the offset cost (m × m).
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Q: states in the stage cost.
    pub state: Weight,
    /// R: inputs in the stage cost.
    pub input: Weight,
    /// O: states in the offset cost.
    pub offset: Weight,
    /// O_input: inputs in the offset cost, zero by default.
    pub offset_input: Option<Weight>,
}

impl Weights {
    /// Q, R and O, without a weight on the input part of the offset cost.
    pub fn new(
        state: impl Into<Weight>,
        input: impl Into<Weight>,
        offset: impl Into<Weight>,
    ) -> Self {
        Self {
            state: state.into(),
            input: input.into(),
            offset: offset.into(),
            offset_input: None,
        }
    }

    /// Adds the weight of the input part of the offset cost.
    pub fn with_offset_input(mut self, weight: impl Into<Weight>) -> Self {
        self.offset_input = Some(weight.into());
        self
    }
}
