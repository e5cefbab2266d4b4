//! The regime for hundreds of inputs: nothing dense, and work where something happens.
//!
//! Plants with hundreds of inputs are made of subsystems, and what happens in one hardly reaches the far ones. With variables in the
//! order of the subsystems, H, G, V and the factors of H + ρ GᵀG are banded ([`Windows`]); a row that comes or goes changes the solution near
//! itself. The method ([`solve`](self)) is therefore a sequence of local changes, whose cost does not depend on the number of subsystems.
//!
//! # Memory, in numbers of the chosen type
//!
//! `g`, `v`, `h` are the mean windows of rows of G, V and the upper triangle of H, `b` the mean band of the factors.
//!
//! | | numbers | access |
//! |---|---|---|
//! | tables | `pairs (g + v + 3) + nz (h + …)`, with F_x, F_r, K, C, E | read only, may lie in flash |
//! | workspace | `nz (b + 10) + nz/4 + n + nr + m + 9 pairs + 6 groups + weights`, and `2 nz + 1 + 3 pairs + 6 groups` indices of 4 bytes | read and write |
//!
//! # Work, in multiply-adds, with `k` active rows
//!
//! | part of a step | at most | how often |
//! |---|---|---|
//! | linear term | entries of F_x (and F_r after a new set-point) | once |
//! | what the last step knew of the active rows, at the new state | `k v` | once, after an optimum |
//! | residuals | `2 h nz + 3 k g` | twice in a quiet step, once more per batch of leaving rows and after rows have come |
//! | right-hand side and solution on all active rows | `2 b nz + k g` | as often |
//! | a row that comes or goes | `5 b · reach`, `reach` the columns at which its influence has faded; at most nz | per iteration |
//! | noting a movement | weights of the groups it touches | per iteration; for all groups per solution and per state |
//! | asking a group | `3 ·` pairs in it | groups whose rows the movements since can have brought beyond a bound |
//! | measuring a row | `g + v` | rows that they can have brought there |
//! | factors from nothing | `nz b²/2 + k g²/2` | at the start, after 2 000 changes, and when a twelfth of nz leaves at once |
//! | checking the candidate | `pairs (3 g + 2 v) + 6 h nz` | only when cut short |
//!
//! Only `+ − × ÷` and comparisons are used, in an order that the source fixes: host and target give the same bits.

mod factor;
mod movement;
mod pricing;
mod residuals;
mod rows;
mod solve;
mod step;
mod stuck;
mod tables;
#[cfg(test)]
mod test_problem;
mod windows;
mod workspace;

pub use step::{BandedController, BandedStep};
pub use tables::{BandedData, BandedTables};
pub use windows::Windows;
