//! The slow, plain, independent reference that the library is tested against.
//!
//! Nothing here shares code with the library but its public types: matrices are nested vectors, products are loops,
//! every linear or quadratic program goes to Clarabel through [`program`], which checks each answer itself.

// Each test binary uses its own part of the support.
#![allow(dead_code)]

pub mod cases;
pub mod linear;
pub mod program;
pub mod random;
pub mod reference;
