//! The command `mpct`.
mod report;
fn main() {}
