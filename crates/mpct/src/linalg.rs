//! The one door to the dense linear algebra of another crate (`faer`).
//!
//! Its interface changes between versions; nothing outside this module names it except through [`Dense`].

use crate::error::DesignError;
use crate::matrix::{Matrix, SparseMatrix};
use faer::linalg::solvers::Solve;
use faer::{MatRef, Side};

/// A dense, column-major matrix for computation.
pub(crate) type Dense = faer::Mat<f64>;

/// Largest modulus accepted in a computed matrix. Above it products of matrices overflow.
const HUGE: f64 = 1e150;

pub(crate) fn dense(m: &SparseMatrix) -> Dense {
    let mut out = Dense::zeros(m.rows(), m.cols());
    for (i, j, v) in m.entries() {
        out[(i, j)] = v;
    }
    out
}

pub(crate) fn sparse(m: &Dense) -> SparseMatrix {
    SparseMatrix::from_row_lists(
        m.nrows(),
        m.ncols(),
        (0..m.nrows()).map(|i| (0..m.ncols()).map(|j| (j as u32, m[(i, j)])).collect()),
    )
}

pub(crate) fn to_matrix(m: &Dense) -> Matrix {
    let mut out = Matrix::zeros(m.nrows(), m.ncols());
    for i in 0..m.nrows() {
        for j in 0..m.ncols() {
            out.set(i, j, m[(i, j)]);
        }
    }
    out
}

/// Whether every entry is finite and small enough to go on computing.
pub(crate) fn is_finite(m: &Dense) -> bool {
    m.col_iter().all(|c| c.iter().all(|v| v.abs() < HUGE))
}

fn solver(what: &str, detail: impl Into<String>) -> DesignError {
    DesignError::Solver {
        what: what.into(),
        detail: detail.into(),
    }
}

/// Largest absolute entry.
pub(crate) fn max_abs(m: MatRef<'_, f64>) -> f64 {
    m.col_iter()
        .flat_map(|c| c.iter().copied().map(f64::abs).collect::<Vec<_>>())
        .fold(0.0, f64::max)
}

/// Smallest eigenvalue of a symmetric matrix.
pub(crate) fn smallest_symmetric_eigenvalue(
    what: &str,
    m: &SparseMatrix,
) -> Result<f64, DesignError> {
    let values = dense(m)
        .self_adjoint_eigenvalues(Side::Lower)
        .map_err(|e| solver(what, format!("eigenvalues: {e:?}")))?;
    Ok(values.into_iter().fold(f64::INFINITY, f64::min))
}

/// Symmetric eigendecomposition: eigenvalues ascending, eigenvectors in columns.
pub(crate) fn symmetric_eigen(what: &str, m: &Dense) -> Result<(Vec<f64>, Dense), DesignError> {
    let eigen = m
        .self_adjoint_eigen(Side::Lower)
        .map_err(|e| solver(what, format!("eigenvalues: {e:?}")))?;
    let values = eigen.S().column_vector().iter().copied().collect();
    Ok((values, eigen.U().to_owned()))
}

/// Eigenvalues of a square matrix, as (re, im).
pub(crate) fn eigenvalues(what: &str, m: &Dense) -> Result<Vec<(f64, f64)>, DesignError> {
    let values = m
        .eigenvalues()
        .map_err(|e| solver(what, format!("eigenvalues: {e:?}")))?;
    Ok(values.into_iter().map(|z| (z.re, z.im)).collect())
}

/// Spectral radius of a square matrix.
pub(crate) fn spectral_radius(what: &str, m: &Dense) -> Result<f64, DesignError> {
    Ok(eigenvalues(what, m)?
        .into_iter()
        .map(|(re, im)| re.hypot(im))
        .fold(0.0, f64::max))
}

/// Singular values, descending, with left and right singular vectors in columns.
pub(crate) fn svd(what: &str, m: &Dense) -> Result<(Dense, Vec<f64>, Dense), DesignError> {
    let svd = m
        .svd()
        .map_err(|e| solver(what, format!("singular values: {e:?}")))?;
    let s = svd.S().column_vector().iter().copied().collect();
    Ok((svd.U().to_owned(), s, svd.V().to_owned()))
}

/// X with M X = B, by LU with partial pivoting.
pub(crate) fn solve(m: &Dense, b: &Dense) -> Dense {
    m.partial_piv_lu().solve(b)
}

/// M⁻¹, by LU with partial pivoting; `None` when M is singular to the last bit.
pub(crate) fn inverse(m: &Dense) -> Option<Dense> {
    use faer::linalg::solvers::DenseSolveCore;
    let inverse = m.partial_piv_lu().inverse();
    is_finite(&inverse).then_some(inverse)
}

/// X with M X = B for symmetric positive definite M.
pub(crate) fn solve_positive(what: &str, m: &Dense, b: &Dense) -> Result<Dense, DesignError> {
    Ok(m.llt(Side::Lower)
        .map_err(|e| solver(what, format!("Cholesky factorisation: {e:?}")))?
        .solve(b))
}

/// Lower triangular L with M = L Lᵀ, for symmetric positive definite M.
pub(crate) fn cholesky(what: &str, m: &Dense) -> Result<Dense, DesignError> {
    Ok(m.llt(Side::Lower)
        .map_err(|e| solver(what, format!("Cholesky factorisation: {e:?}")))?
        .L()
        .to_owned())
}

/// (M + Mᵀ)/2.
pub(crate) fn symmetrised(m: &Dense) -> Dense {
    Dense::from_fn(m.nrows(), m.ncols(), |i, j| 0.5 * (m[(i, j)] + m[(j, i)]))
}
