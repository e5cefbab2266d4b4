//! What is needed to believe a design without running it, and a checker that shares nothing with the search.
//!
//! A certificate states the problem, K, P, M_θ, λ and M̃, and for every constraint row the few multipliers that show
//! that it follows from the rows of the steps before; for every ellipsoid such multipliers for a few supports of its
//! vector (`docs/ellipsoids.md`). [`verify`] recomputes everything else from the plant as written
//! in the file, with a bound on every rounding error.
//!
//! ```
//! use mpct::certificate::{Certificate, VerifyOptions, verify};
//! use mpct::{Constraints, DesignOptions, Matrix, Plant, Problem, TerminalIngredients, Weights};
//! let plant = Plant::discrete(
//!     Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
//!     Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
//! )?;
//! let constraints = Constraints::new(2, 2)
//!     .state_bounds(&[-3.0; 2], &[3.0; 2])?
//!     .input_bounds(&[-2.0; 2], &[2.0; 2])?;
//! let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))?;
//! let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
//! let text = Certificate::of(&ingredients)?.to_json();
//! let verified = verify(&text, VerifyOptions::default())?;
//! assert_eq!(verified.terminal_horizon, 5);
//! assert!(verified.smallest_margin > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod build;
mod build_ellipsoids;
mod document;
mod ellipsoids;
#[cfg(test)]
mod field_walk_tests;
mod implied;
mod interval;
mod lyapunov;
mod rows;
mod statement;
#[cfg(test)]
mod tests;
mod verify;
mod widths;
mod witness;

pub use statement::Verified;
pub use verify::{VerifyError, VerifyOptions, verify};

use crate::error::DesignError;
use crate::terminal::TerminalIngredients;
use document::{Claim, Document, FORMAT, Proof};
use sha2::{Digest, Sha256};
use std::fmt::Write;

/// A claim with its proof.
#[derive(Clone, Debug)]
pub struct Certificate {
    document: Document,
}

impl Certificate {
    /// Proves a design: one linear program a row.
    ///
    /// # Errors
    /// [`DesignError::Solver`] when a proof cannot be written down: a coordinate that the constraints do not bound, however
    /// many steps of the terminal law are counted. What rounding leaves over has then no bound either.
    pub fn of(ingredients: &TerminalIngredients) -> Result<Self, DesignError> {
        let (claim, proof) = build::build(ingredients)?;
        Ok(Self {
            document: Document {
                format: FORMAT.into(),
                digest: digest(&claim, &proof),
                claim,
                proof,
            },
        })
    }

    /// The file.
    pub fn to_json(&self) -> String {
        // Numbers, strings and lists: nothing that could fail to be written.
        serde_json::to_string(&self.document).unwrap_or_default()
    }
}

/// SHA-256 of claim and proof as compact JSON.
fn digest(claim: &Claim, proof: &Proof) -> String {
    let mut hash = Sha256::new();
    hash.update(serde_json::to_vec(claim).unwrap_or_default());
    hash.update(serde_json::to_vec(proof).unwrap_or_default());
    let mut text = String::from("sha256:");
    for byte in hash.finalize() {
        let _ = write!(text, "{byte:02x}");
    }
    text
}
