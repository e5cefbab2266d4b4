//! `mpct example`: the problem files of the case studies.

use crate::arguments::{Case, Example};
use crate::failure::Failure;
use crate::output::print;
use mpct::cases;

pub fn run(arguments: &Example) -> Result<(), Failure> {
    let file = match arguments.case {
        Case::Academic => cases::academic(),
        Case::Drone => cases::drone(),
        Case::Carts => cases::carts(arguments.count)?,
    };
    print(&cases::text(&file))
}
