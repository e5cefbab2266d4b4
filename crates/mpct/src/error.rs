//! What can be wrong, with the numbers that say how to mend it.
//!
//! Two phases, two enums: [`DesignError`] while a problem is stated and designed (offline), [`StepError`] while
//! the controller runs (online). A third, [`FileError`](crate::FileError), belongs to reading problem files.

use thiserror::Error;

/// Why a problem was refused or a design could not be made.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DesignError {
    /// Something has the wrong shape or length.
    #[error("{what}: expected {expected}, found {found}")]
    Shape {
        /// What was looked at.
        what: String,
        /// The shape it should have.
        expected: String,
        /// The shape it has.
        found: String,
    },
    /// A NaN or an infinity where a number is needed.
    #[error("{what}: entry [{row}, {column}] is {value}; every entry must be a finite number")]
    NotFinite {
        /// What was looked at.
        what: String,
        /// Row, 0-based.
        row: usize,
        /// Column, 0-based.
        column: usize,
        /// The value found.
        value: f64,
    },
    /// A number outside its range.
    #[error("{what}: expected {expected}, found {found}")]
    OutOfRange {
        /// What was looked at.
        what: String,
        /// The range.
        expected: String,
        /// The value found.
        found: String,
    },
    /// A weight is not symmetric.
    #[error(
        "{what} is not symmetric: entry [{row}, {column}] is {upper}, entry [{column}, {row}] is {lower}"
    )]
    NotSymmetric {
        /// The weight.
        what: String,
        /// Row of the entry above the diagonal.
        row: usize,
        /// Column of the entry above the diagonal.
        column: usize,
        /// The entry above the diagonal.
        upper: f64,
        /// The entry below the diagonal.
        lower: f64,
    },
    /// A weight is not positive definite.
    #[error(
        "{what} is not positive definite: its smallest eigenvalue is {smallest_eigenvalue:.6e}, and must be > 0"
    )]
    NotPositiveDefinite {
        /// The weight.
        what: String,
        /// Its smallest eigenvalue.
        smallest_eigenvalue: f64,
    },
    /// The origin (the operating point) is not strictly inside a constraint.
    #[error(
        "the origin is not strictly inside the constraints: {row} leaves it {offset:.6e} of room, and needs > 0{hint}"
    )]
    OriginNotInterior {
        /// The row.
        row: String,
        /// d − (C x_op + D u_op) for that row.
        offset: f64,
        /// What to change.
        hint: String,
    },
    /// A mode of (A, B) is neither stable nor reachable.
    #[error(
        "(A, B) is not stabilizable: the eigenvalue {re:.6} {im:+.6}i (modulus {modulus:.6}) cannot be moved by any input"
    )]
    NotStabilizable {
        /// Real part.
        re: f64,
        /// Imaginary part.
        im: f64,
        /// Modulus.
        modulus: f64,
    },
    /// A + B K is not Schur.
    #[error(
        "the gain does not stabilize the plant: the spectral radius of A + B K is {spectral_radius:.9}, and must be < 1"
    )]
    NotSchur {
        /// Spectral radius of A + B K.
        spectral_radius: f64,
    },
    /// A direction of the terminal dynamics that no constraint bounds or observes.
    #[error(
        "no constraint bounds or observes {direction}; the terminal set would be unbounded there: bound one of the variables that take part"
    )]
    Unbounded {
        /// The direction, as a combination of named variables.
        direction: String,
    },
    /// The terminal horizon was not found within its limit.
    #[error(
        "the terminal horizon is not determined: {known} after {reached} steps; {row} has support {support:.9} there (needs <= 1). {hint}"
    )]
    HorizonNotDetermined {
        /// Steps searched.
        reached: usize,
        /// A row that is not spent.
        row: String,
        /// Its support at the last step searched.
        support: f64,
        /// What is known, in words.
        known: String,
        /// What would help.
        hint: String,
    },
    /// The search was stopped by its caller or its time limit.
    #[error(
        "the design was interrupted: the terminal horizon is at least {at_least}, {rows_left} rows were still open"
    )]
    Interrupted {
        /// Lower bound known.
        at_least: usize,
        /// Rows left.
        rows_left: usize,
    },
    /// A solver did not deliver an answer that passes the independent check.
    #[error("solver failure in {what}: {detail}")]
    Solver {
        /// The computation.
        what: String,
        /// What was seen.
        detail: String,
    },
}

/// Why a step of the controller has no input.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum StepError {
    /// The state has a NaN or an infinity.
    #[error("the state is not finite: entry {index} is {value}")]
    StateNotFinite {
        /// Index of the entry, 0-based.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The set-point has a NaN or an infinity.
    #[error("the set-point is not finite: entry {index} is {value}")]
    SetPointNotFinite {
        /// Index of the entry, 0-based.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The state or set-point has the wrong length.
    #[error("{what} has {found} entries, and needs {expected}")]
    WrongLength {
        /// Which vector.
        what: &'static str,
        /// Entries needed.
        expected: usize,
        /// Entries found.
        found: usize,
    },
    /// No admissible input sequence exists: the state is outside the domain of attraction. A Farkas ray was checked.
    #[error(
        "the state is outside the domain of attraction: the constraints contradict each other by {gap:.3e} (proved for all variables below {radius:.1e})"
    )]
    Infeasible {
        /// −bᵀy of the ray, scaled to Σy = 1.
        gap: f64,
        /// The proof holds for every z with ‖z‖₁ < radius.
        radius: f64,
    },
    /// The solver stopped without an answer that passes the check and no feasible candidate was at hand.
    #[error(
        "the solver stopped after {iterations} iterations without a checked answer (largest residual {residual:.3e})"
    )]
    IterationLimit {
        /// Iterations made.
        iterations: usize,
        /// Largest residual of its last point.
        residual: f64,
    },
}
