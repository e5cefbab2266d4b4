//! What a verified certificate proves, in words.

use std::fmt;

/// A support may exceed its bound by this, relatively, to count as implied "to a tolerance": the tolerance of the
/// search, and the rounding of the check.
pub(super) const TOLERANCE: f64 = 2e-9;

/// What was proved.
///
/// As text ([`fmt::Display`]) it is a statement for a safety case: what holds for exactly the numbers of the file, what
/// was proved with every rounding error bounded, what holds to a tolerance, and what it does not speak of.
#[derive(Clone, Debug, PartialEq)]
pub struct Verified {
    /// Name of the problem.
    pub problem: String,
    /// SHA-256 of claim and proof, computed from what was checked.
    pub digest: String,
    /// Whether the file states this digest. False only with [`VerifyOptions::ignore_digest`](super::VerifyOptions).
    pub digest_fits: bool,
    /// λ.
    pub scaling: f64,
    /// The terminal horizon M̃ (M for regulation).
    pub terminal_horizon: usize,
    /// Smallest of 1 − (proved support)/(bound) over all rows. Negative when a row is implied to a tolerance only.
    pub smallest_margin: f64,
    /// The row with that margin.
    pub tightest_row: String,
    /// Rows and ellipsoids proved rigorously, and those proved to a tolerance of 2e-9 of their bound.
    pub rows_rigorous: usize,
    /// See `rows_rigorous`.
    pub rows_to_tolerance: usize,
    /// How many of all these are ellipsoids.
    pub ellipsoids: usize,
    /// Bound of the residual of (3), relative to the stage cost.
    pub lyapunov_residual: f64,
    /// Bound of the residual of the steady states, in units of the box; part of every proof.
    pub steady_state_residual: f64,
    /// By how much the witness breaks its bound after M̃ steps; `None` when the file has no witness, because M̃ = 1 or
    /// the condition is the sufficient one.
    pub witness: Option<f64>,
    pub(super) states: usize,
    pub(super) inputs: usize,
    pub(super) parameters: usize,
}

impl fmt::Display for Verified {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.problem.as_str() {
            "" => "without a name",
            name => name,
        };
        let horizon = self.terminal_horizon;
        writeln!(
            f,
            "Verified: problem {name}, {} states, {} inputs, terminal horizon {horizon}.",
            self.states, self.inputs
        )?;
        let remark = if self.digest_fits {
            ""
        } else {
            "; the file states another digest: it was changed after it was written"
        };
        writeln!(f, "Certificate: {}{remark}.", self.digest)?;
        if self.rows_to_tolerance == 0 {
            self.claim(f)?;
        } else {
            writeln!(
                f,
                "Not proved rigorously: {} rows are implied only up to {TOLERANCE:.0e} of their bounds, so that what follows \
                 for all later steps is proved for each of them with that tolerance and not exactly.",
                self.rows_to_tolerance
            )?;
        }
        writeln!(f, "Proved rigorously, with every rounding error bounded:")?;
        writeln!(
            f,
            "  - A + B K is Schur: P > 0, and x'Px falls in every step by at least 1 - {:.1e} of the stage cost;",
            self.lyapunov_residual
        )?;
        writeln!(
            f,
            "  - {} constraint rows{} are implied by the {} of the steps before them; smallest margin {:.3e} of the bound \
             ({}){}",
            self.rows_rigorous - self.ellipsoids.min(self.rows_rigorous),
            match self.ellipsoids {
                0 => String::new(),
                k => format!(" and {k} ellipsoids"),
            },
            if self.ellipsoids == 0 {
                "rows"
            } else {
                "constraints"
            },
            self.smallest_margin,
            self.tightest_row,
            if self.witness.is_some() { ";" } else { "." }
        )?;
        if let Some(beyond) = self.witness {
            writeln!(
                f,
                "  - {} steps are too few: a point that satisfies all constraints along them breaks one at the next step, by \
                 {beyond:.3e} of its bound.",
                horizon - 1
            )?;
        }
        writeln!(f, "To a tolerance only:")?;
        if self.rows_to_tolerance > 0 {
            writeln!(
                f,
                "  - {} rows, up to {TOLERANCE:.0e} of their bound;",
                self.rows_to_tolerance
            )?;
        }
        write!(
            f,
            "  - equation (3) holds up to {:.1e} of the stage cost",
            self.lyapunov_residual
        )?;
        if self.parameters > 0 {
            write!(
                f,
                "; the equilibria of the basis rest up to {:.1e} of the box (a residual that the proofs above account for)",
                self.steady_state_residual
            )?;
        }
        writeln!(f, ".")?;
        write!(
            f,
            "Not part of this: whether the matrices describe the plant, disturbances, how the terminal horizon was found, and \
             the solver that runs online."
        )
    }
}

impl Verified {
    /// The claim in one sentence.
    fn claim(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let horizon = self.terminal_horizon;
        if self.parameters == 0 {
            return writeln!(
                f,
                "For exactly the matrices and bounds written in this file, and in exact arithmetic, every state that satisfies \
                 the constraints along steps 0 to {horizon} of the terminal control law u = K x stays admissible for ever and \
                 converges to the operating point."
            );
        }
        writeln!(
            f,
            "For exactly the matrices and bounds written in this file, and in exact arithmetic, every state and artificial \
             set-point (scaled by lambda = {}) that satisfies the constraints along steps 0 to {horizon} of the terminal \
             control law u = K x + L theta stays admissible for ever.",
            self.scaling
        )
    }
}
