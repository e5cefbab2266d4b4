//! What the command writes for people: pages and pictures of the crate `mpct-report`.

pub use mpct_report::*;
