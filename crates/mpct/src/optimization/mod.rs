//! Quadratic programs min ½ zᵀHz + fᵀz, G z ≤ b with constant H and G, and support functions of convex bodies: solved by
//! a library, checked by us.

mod body;
mod checker;
mod conic_qp;
pub(crate) mod conic_verify;
mod qp;
pub(crate) mod verify;
pub(crate) mod verify_pairs;

pub(crate) use body::{Ball, Body, BodyFailure, Multipliers, SupportValue, add_product, dot, norm};
pub(crate) use checker::Checker;
pub(crate) use conic_qp::{ConicLimits, ConicQp};
pub(crate) use qp::{Failure, PreparedQp};
