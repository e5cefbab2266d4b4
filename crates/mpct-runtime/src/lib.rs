//! The online solver of model predictive control for tracking: `no_std`, no heap, no `unsafe`, no panic on any data, in `f32` or `f64`.
//!
//! # The problem
//!
//! ```text
//! min ½ zᵀHz + f(x, r)ᵀz   s.t.  G z ≤ b(x)        z = (c_0, …, c_{N−1}, θ),  nz = (N + 1) m numbers
//! f = F_x x + F_r r,   b = 1 + W x                  first input  u = K x + L θ + c_0
//! ```
//!
//! `H` is symmetric positive definite; `H, G, F_x, F_r, W, K, L` are constant. `x` is the measured state (`n` numbers), `r` the set-point.
//!
//! # The way
//!
//! 1. [`prepare`] factors `H` and scales the rows: once, into one slice of numbers. Export it, or convert it with [`cast_tables`].
//!    Small problems may add [`prepare_gram`]: in `f64`, jumps of the set-point then take half the time or less.
//! 2. [`Workspace::new`] divides caller-provided memory; [`Controller::new`] joins the two.
//! 3. [`Controller::step`] solves at every sampling instant, within a [`Budget`], and never leaves without a feasible input when one is
//!    known: see [`StepStatus`] and [`StepError`].
//! 4. [`verify`] checks a solution without using any of the code that found it.
//!
//! The method is the dual active-set method of Goldfarb and Idnani (Mathematical Programming 27, 1983) with factors of the Gram matrix of the
//! working set, as in Arnström, Bemporad and Axehill (IEEE Transactions on Automatic Control 67, 2022).
//! The Lipschitz bounds that spare most rows their evaluation are explained in `pricing.rs`, the products of rows with which small problems
//! find their working set in `gram.rs` and `walk.rs`.
//!
//! # Memory, in numbers of the chosen type
//!
//! | | numbers | access |
//! |---|---|---|
//! | tables | `nz² + nz(nz+1)/2 + nz(n+nr) + rows(nz+n+4) + 3 blocks + m(n+m+input_rows)`, `blocks = ⌈rows/16⌉` | read only, may lie in flash |
//! | products of rows, may follow the tables | `units (1 + n + nz + m + units)`, `units` as below | read only, may lie in flash |
//! | workspace | `nz² + nz(nz−1)/2 + 16 nz + 2 rows + blocks + 2 n + nr + m + 1`, and `2 nz + 1` indices of 4 bytes | read and write |
//!
//! # Work, in multiply-adds, with `k ≤ nz` active rows
//!
//! `h` is the work of a product with `H`: `nz²`, or `nz m` when `H` is block diagonal (as for the LQR gain); a product with `R⁻¹` is
//! half of it. `units` are the rows of which opposite ones count once: `rows/2` for symmetric bounds.
//!
//! | part of a step | at most | how often |
//! |---|---|---|
//! | linear term | `nz (n + nr)` (`nz n` while the set-point stays; only rows of `F` that are not zero) | once |
//! | settling: stationarity and activity | `h + 2 k nz + k n` | twice, plus once per correction |
//! | settling: one correction | `1.5 h + k² + 2 k nz` | once, and once per row that leaves |
//! | one iteration: projection and step | `h + 3 k² + 6 k nz` (with two reprojections; `h/2` more when a row enters) | per iteration |
//! | pricing: bounds of groups of rows | `3 blocks` | per pass |
//! | pricing: rows of groups that are not ruled out | `units (nz + n + 3)`; a few rows in a quiet loop | per pass; passes ≤ iterations + 4 |
//! | pricing: rows that the last pass found violated | `32 nz` | per iteration |
//! | with products of rows, after a jump: residuals of all rows | `units (n + m + k)`, or `units (n + nz + k)` when the linear term speaks of `c` too | once |
//! | with products of rows: one iteration | `units (k + 3) + 2 k²` in place of the above, and no pass over the rows where rounding is within bounds | per iteration |
//! | checking the candidate | `rows (3 nz + 2 n)` | only when cut short |
//!
//! Bytes touched: the numbers of tables and workspace that these products read, each once per product; at most all tables and all of the
//! workspace per pass, and `(h + k nz + 32 nz)` numbers per iteration between passes.
//!
//! A step touches the tables once per item of this list, row-major and in order. Only `+ − × ÷` and comparisons are used, in an order the source
//! fixes: host and target give the same bits for the same inputs.
#![no_std]
#![forbid(unsafe_code)]
// `!(a > b)` is how this crate says "not greater, or NaN": the usual spelling would let NaN pass.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod active_set;
pub mod banded;
mod budget;
mod candidate;
mod dense;
mod dims;
mod factor;
mod gram;
mod memory;
mod prepare;
mod pricing;
mod products;
mod proof;
mod scalar;
mod step;
mod table_error;
mod tables;
mod verify;
mod walk;
mod workspace;

pub use budget::Budget;
pub use dims::Dims;
pub use gram::prepare_gram;
pub use memory::Memory;
pub use prepare::{QpData, cast_tables, prepare};
pub use scalar::Scalar;
pub use step::{Controller, Step, StepError, StepStatus, WarmStart, Why};
pub use table_error::TableError;
pub use tables::{NO_ROW, Tables, TablesStamp};
pub use verify::{Verification, verify};
pub use workspace::Workspace;
