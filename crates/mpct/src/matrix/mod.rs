//! Matrices as users hand them over and as designs keep them.
//!
//! [`Matrix`] is dense and row-major: what a person types. [`SparseMatrix`] keeps only the entries that are not
//! zero (compressed rows): what a plant of a thousand subsystems needs. Neither is a linear algebra library; the
//! factorisations of this crate are done elsewhere and no type of another crate appears in a public signature.

mod dense;
mod sparse;

pub use dense::Matrix;
pub use sparse::SparseMatrix;
