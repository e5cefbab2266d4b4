//! Dense, row-major matrices.

use crate::error::DesignError;
use serde::{Deserialize, Serialize};

/// A dense real matrix, row-major.
///
/// Serialised as a list of rows.
///
/// ```
/// use mpct::Matrix;
/// let a = Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]);
/// assert_eq!(a.get(0, 1), 1.0);
/// ```
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Matrix {
    rows: usize,
    cols: usize,
    data: Vec<f64>,
}

impl Matrix {
    /// A matrix of shape `rows × cols` from its entries in row-major order.
    ///
    /// # Errors
    /// [`DesignError::Shape`] when `data.len() != rows * cols`.
    pub fn new(rows: usize, cols: usize, data: Vec<f64>) -> Result<Self, DesignError> {
        if rows.checked_mul(cols) == Some(data.len()) {
            Ok(Self { rows, cols, data })
        } else {
            Err(DesignError::Shape {
                what: "entries of a matrix".into(),
                expected: format!("{rows} x {cols}"),
                found: format!("{} numbers", data.len()),
            })
        }
    }

    /// A matrix from rows whose length the type fixes.
    pub fn from_rows<const C: usize>(rows: &[[f64; C]]) -> Self {
        Self {
            rows: rows.len(),
            cols: C,
            data: rows.iter().flatten().copied().collect(),
        }
    }

    /// A matrix from a list of rows, named `what` in errors.
    ///
    /// # Errors
    /// [`DesignError::Shape`] when two rows differ in length.
    pub fn from_vecs(what: &str, rows: &[Vec<f64>]) -> Result<Self, DesignError> {
        let cols = rows.first().map_or(0, Vec::len);
        if let Some((i, row)) = rows.iter().enumerate().find(|(_, r)| r.len() != cols) {
            return Err(DesignError::Shape {
                what: format!("row {i} of {what}"),
                expected: format!("{cols} numbers, as in row 0"),
                found: format!("{}", row.len()),
            });
        }
        Ok(Self {
            rows: rows.len(),
            cols,
            data: rows.iter().flatten().copied().collect(),
        })
    }

    /// The zero matrix.
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self {
            rows,
            cols,
            data: vec![0.0; rows * cols],
        }
    }

    /// The identity matrix of order `n`.
    pub fn identity(n: usize) -> Self {
        Self::from_diagonal(&vec![1.0; n])
    }

    /// The diagonal matrix with the given diagonal.
    pub fn from_diagonal(diagonal: &[f64]) -> Self {
        let n = diagonal.len();
        let mut m = Self::zeros(n, n);
        for (i, &v) in diagonal.iter().enumerate() {
            m.data[i * n + i] = v;
        }
        m
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// The entry in row `i`, column `j` (0-based).
    ///
    /// # Panics
    /// When the indices are outside the matrix, as for a slice.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        assert!(j < self.cols, "column {j} of {}", self.cols);
        self.data[i * self.cols + j]
    }

    /// Sets the entry in row `i`, column `j` (0-based).
    ///
    /// # Panics
    /// When the indices are outside the matrix, as for a slice.
    pub fn set(&mut self, i: usize, j: usize, value: f64) {
        assert!(j < self.cols, "column {j} of {}", self.cols);
        self.data[i * self.cols + j] = value;
    }

    /// Row `i` as a slice.
    ///
    /// # Panics
    /// When `i` is not a row.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data[i * self.cols..(i + 1) * self.cols]
    }

    /// All entries in row-major order.
    pub fn as_slice(&self) -> &[f64] {
        &self.data
    }

    /// The entries in row-major order, without a copy.
    pub fn into_vec(self) -> Vec<f64> {
        self.data
    }

    /// Rows as vectors, for output.
    pub fn to_vecs(&self) -> Vec<Vec<f64>> {
        (0..self.rows).map(|i| self.row(i).to_vec()).collect()
    }
}

impl Serialize for Matrix {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq((0..self.rows).map(|i| self.row(i)))
    }
}

impl<'de> Deserialize<'de> for Matrix {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let rows = Vec::<Vec<f64>>::deserialize(deserializer)?;
        Self::from_vecs("a matrix", &rows).map_err(serde::de::Error::custom)
    }
}
