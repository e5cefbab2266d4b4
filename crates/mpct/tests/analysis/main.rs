//! Every answer of `mpct::analysis` against an independent oracle.

mod cases;
mod domain;
mod oracle;
