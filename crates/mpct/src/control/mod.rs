//! The controller: one quadratic program a step.

mod controller;
mod online;
mod prediction;
mod set_point;
mod terminal_cost;

pub use controller::{CandidateReason, CondensedQp, Controller, Step, StepStatus};
pub use set_point::{AdmissibleSetPoint, SetPoint};
pub use terminal_cost::ImplicitTerminalCost;

pub(crate) use set_point::{OffsetCost, weighted_square};
pub(crate) use terminal_cost::no_terminal_constraint;

#[cfg(test)]
mod prediction_tests;
