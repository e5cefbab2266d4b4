//! Quadratic programs min ½ zᵀHz + fᵀz, G z ≤ b with constant H and G: solved by a library, checked by us.

mod qp;
pub(crate) mod verify;

pub(crate) use qp::{Failure, PreparedQp};
