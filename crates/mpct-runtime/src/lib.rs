//! The online solver of model predictive control for tracking: `no_std`, no heap, no `unsafe`, no panic on any data, in `f32` or `f64`.
#![no_std]
#![forbid(unsafe_code)]

mod active_set;
mod budget;
mod candidate;
mod dense;
mod dims;
mod factor;
mod prepare;
mod pricing;
mod proof;
mod scalar;
mod step;
mod tables;
mod verify;
mod workspace;

pub use budget::Budget;
pub use dims::Dims;
pub use prepare::{QpData, cast_tables, prepare};
pub use scalar::Scalar;
pub use step::{Controller, Step, StepError, StepStatus, WarmStart, Why};
pub use tables::{NO_ROW, TableError, Tables};
pub use verify::{Verification, verify};
pub use workspace::Workspace;
