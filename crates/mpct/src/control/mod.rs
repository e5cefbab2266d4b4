//! The controller: one quadratic program a step.

mod controller;
mod online;
mod prediction;
mod set_point;

pub use controller::{CondensedQp, Controller, Step, StepStatus};
pub use set_point::{AdmissibleSetPoint, SetPoint};

pub(crate) use set_point::weighted_square;

#[cfg(test)]
mod prediction_tests;
