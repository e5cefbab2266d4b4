//! Every answer of `mpct::analysis` against an independent oracle.

mod cases;
mod domain;
mod no_terminal_constraint;
mod oracle;
mod reproduction;
mod service;
mod terminal_cost;
mod terminal_set;
