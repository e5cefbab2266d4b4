//! Errors of the command: a message, what would help, and an exit code for each class.

use crate::interrupt::Search;
use mpct::{DesignError, FileError, SimulationError, StepError};
use std::io;
use std::path::Path;

/// Exit codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// The file or an argument is wrong.
    Input = 2,
    /// An assumption of the theory does not hold.
    Assumption = 3,
    /// The terminal horizon was not determined within its limits.
    Horizon = 4,
    /// No admissible input sequence exists.
    Infeasible = 5,
    /// A solver did not deliver a checked answer.
    Solver = 6,
    /// A file cannot be read or written.
    Io = 7,
    /// Ctrl-C.
    Interrupted = 130,
}

/// What ends the command.
#[derive(Debug)]
pub struct Failure {
    pub class: Class,
    pub message: String,
    pub help: Option<String>,
}

impl Failure {
    pub fn new(class: Class, message: impl Into<String>) -> Self {
        Self {
            class,
            message: message.into(),
            help: None,
        }
    }

    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Names the file in front of the message.
    pub fn in_file(mut self, path: &Path) -> Self {
        let name = path.display().to_string();
        if self.class != Class::Io && !self.message.starts_with(&name) {
            self.message = format!("{}: {}", path.display(), self.message);
        }
        self
    }

    pub fn io(what: &str, path: &Path, error: &io::Error) -> Self {
        Self::new(
            Class::Io,
            format!("cannot {what} {}: {error}", path.display()),
        )
    }
}

impl From<DesignError> for Failure {
    fn from(error: DesignError) -> Self {
        use DesignError as E;
        let (class, help) = match &error {
            E::NotSymmetric { .. } => (
                Class::Assumption,
                Some("replace the weight W by (W + W')/2"),
            ),
            E::NotPositiveDefinite { .. } => (
                Class::Assumption,
                Some("give every state and input a weight > 0, however small"),
            ),
            E::OriginNotInterior { .. } => (Class::Assumption, None),
            E::NotStabilizable { .. } => (
                Class::Assumption,
                Some("add an input that reaches this mode, or leave the mode out of the model"),
            ),
            E::NotSchur { .. } => (
                Class::Assumption,
                Some(
                    "leave `controller.gain` out for the LQR gain; the law is u = K x, with a plus",
                ),
            ),
            E::Unbounded { .. } => (Class::Assumption, None),
            E::Interrupted { .. } if Search::is_asked_to_end() => (Class::Interrupted, None),
            E::Interrupted { .. } => (
                Class::Horizon,
                Some("allow more time with --time-limit, or none without it"),
            ),
            E::HorizonNotDetermined { .. } => (Class::Horizon, None),
            E::Solver { .. } => (Class::Solver, None),
            _ => (Class::Input, None),
        };
        let failure = Self::new(class, error.to_string());
        match help {
            Some(help) => failure.help(help),
            None => failure,
        }
    }
}

impl From<FileError> for Failure {
    fn from(error: FileError) -> Self {
        match error {
            FileError::Problem(error) => error.into(),
            FileError::Unreadable { .. } => Self::new(Class::Io, error.to_string()),
            FileError::TooLarge { .. } => Self::new(Class::Input, error.to_string()).help(
                "write matrices with many zeros in sparse form, and large dense ones as CSV files",
            ),
            FileError::NotText { .. } => Self::new(Class::Input, error.to_string())
                .help("`mpct example academic` prints a problem file"),
            other => Self::new(Class::Input, other.to_string()),
        }
    }
}

impl From<StepError> for Failure {
    fn from(error: StepError) -> Self {
        let class = match error {
            StepError::Infeasible { .. } => Class::Infeasible,
            StepError::IterationLimit { .. } => Class::Solver,
            _ => Class::Input,
        };
        Self::new(class, error.to_string())
    }
}

impl From<SimulationError> for Failure {
    fn from(error: SimulationError) -> Self {
        let text = error.to_string();
        match error {
            SimulationError::Setting(error) => error.into(),
            SimulationError::InitialState { .. } => Self::new(Class::Infeasible, text)
                .help("start inside the constraints, or widen that bound"),
            SimulationError::Step { error, .. } => {
                let failure: Self = error.into();
                let failure = Self::new(failure.class, text);
                if failure.class == Class::Infeasible {
                    failure.help("start closer to an equilibrium, or lengthen `controller.prediction_horizon`")
                } else {
                    failure
                }
            }
            _ => Self::new(Class::Solver, text),
        }
    }
}
