//! Model predictive control for tracking whose terminal ingredients scale.
//!
//! A linear plant x⁺ = A x + B u under polytopic and ellipsoidal constraints follows set-points that jump. The terminal set of the
//! controller is implicit: the terminal control law runs for M̃ more steps, and M̃ is found offline by linear
//! programs (Luque, Chanfreut, Limón, Maestre, Automatica 179, 2025; equation numbers refer to it).
//!
//! Data flow one way, and a later stage can only be built from an earlier one:
//! [`Problem`] → `TerminalIngredients` → `Controller` → closed loop.

pub mod analysis;
pub mod cases;
pub mod certificate;
mod clock;
mod control;
mod error;
mod kernels;
mod linalg;
mod lqr;
mod matrix;
mod optimization;
pub mod problem;
pub mod simulation;
mod steady_state;
pub mod terminal;

pub use control::{
    AdmissibleSetPoint, CandidateReason, CondensedCone, CondensedQp, Controller,
    ImplicitTerminalCost, SetPoint, Step, StepStatus,
};
pub use error::{DesignError, StepError};
pub use matrix::{Matrix, SparseMatrix};
pub use mpct_runtime as runtime;
pub use problem::file::{FileError, ProblemFile};
pub use problem::{
    Constraints, Ellipsoid, EllipsoidShape, Formulation, Labels, NoTerminalConstraint,
    NormConstraint, OperatingPoint, Plant, Problem, RowSource, Task, TerminalCost, Weight, Weights,
};
pub use simulation::{
    Disturbance, Run, RunStep, ScheduledSetPoint, Simulation, SimulationError, Summary, simulate,
};
pub use steady_state::SteadyStates;
pub use terminal::{
    Condition, DesignOptions, MaximalAdmissibleSet, Phases, Progress, TerminalIngredients,
};

/// The examples of the README are tested with the documentation.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
