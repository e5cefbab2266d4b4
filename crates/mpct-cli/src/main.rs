//! The command `mpct`: design, simulate and sweep tracking controllers from problem files.

mod arguments;
mod commands;
mod failure;
mod interrupt;
mod output;
mod report;

use arguments::{Arguments, Command};
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    // Wrong arguments end here with exit code 2, help and version with 0.
    let arguments = Arguments::parse();
    interrupt::install();
    let result = match arguments.command {
        Command::Check(a) => commands::check::run(&a),
        Command::Design(a) => commands::design::run(&a),
        Command::Verify(a) => commands::verify::run(&a),
        Command::Simulate(a) => commands::simulate::run(&a),
        Command::Sweep(a) => commands::sweep::run(&a),
        Command::Scaling(a) => commands::scaling::run(&a),
        Command::Compare(a) => commands::compare::run(&a),
        Command::Reproduce(a) => commands::reproduce::run(&a),
        Command::Example(a) => commands::example::run(&a),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            output::note(&format!("error: {}", failure.message));
            if let Some(help) = failure.help {
                output::note(&format!("help: {help}"));
            }
            ExitCode::from(failure.class as u8)
        }
    }
}
