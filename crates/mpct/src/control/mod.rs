//! The controller: one quadratic program a step.

mod cones;
mod conic;
mod controller;
mod local_offset;
mod local_order;
mod local_program;
mod local_solver;
mod local_tables;
mod online;
mod prediction;
mod regime;
mod set_point;
mod step;
mod terminal_cost;

pub use controller::Controller;
pub use set_point::{AdmissibleSetPoint, SetPoint};
pub use step::{CandidateReason, CondensedCone, CondensedQp, Step, StepStatus};
pub use terminal_cost::ImplicitTerminalCost;

pub(crate) use conic::ProgramCone;
pub(crate) use set_point::{OffsetCost, weighted_square};
pub(crate) use terminal_cost::no_terminal_constraint;

#[cfg(test)]
mod prediction_tests;
#[cfg(test)]
mod regime_tests;
