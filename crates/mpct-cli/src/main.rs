//! The command `mpct`.
fn main() {}
