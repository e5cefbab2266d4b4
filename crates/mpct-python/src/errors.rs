//! Errors as Python exceptions: one class for each enum of the library, one for arguments.

use crate::controller::PyController;
use mpct::analysis::reproduce::ReproductionError;
use mpct::certificate::VerifyError;
use mpct::{DesignError, FileError, SimulationError, StepError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// An exception of the package, with what the variant says as attributes.
fn exception(
    py: Python<'_>,
    class: &str,
    message: String,
    kind: &str,
    fields: &Bound<'_, PyDict>,
) -> PyErr {
    let made = py
        .import("mpct._errors")
        .and_then(|module| module.getattr(class))
        .and_then(|class| class.call1((message, kind, fields)));
    match made {
        Ok(value) => PyErr::from_value(value),
        Err(error) => error,
    }
}

macro_rules! fields {
    ($py:expr $(, $name:ident = $value:expr)* $(,)?) => {{
        let fields = PyDict::new($py);
        // Setting a text key in a new dictionary fails for lack of memory alone.
        $( let _ = fields.set_item(stringify!($name), $value); )*
        fields
    }};
}

fn design_fields<'py>(py: Python<'py>, error: &DesignError) -> (&'static str, Bound<'py, PyDict>) {
    use DesignError as E;
    match error {
        E::Shape {
            what,
            expected,
            found,
        } => (
            "shape",
            fields!(py, what = what, expected = expected, found = found),
        ),
        E::NotFinite {
            what,
            row,
            column,
            value,
        } => (
            "not_finite",
            fields!(py, what = what, row = row, column = column, value = value),
        ),
        E::OutOfRange {
            what,
            expected,
            found,
        } => (
            "out_of_range",
            fields!(py, what = what, expected = expected, found = found),
        ),
        E::NotSymmetric {
            what,
            row,
            column,
            upper,
            lower,
        } => (
            "not_symmetric",
            fields!(
                py,
                what = what,
                row = row,
                column = column,
                upper = upper,
                lower = lower
            ),
        ),
        E::NotPositiveDefinite {
            what,
            smallest_eigenvalue,
        } => (
            "not_positive_definite",
            fields!(py, what = what, smallest_eigenvalue = smallest_eigenvalue),
        ),
        E::OriginNotInterior { row, offset, hint } => (
            "origin_not_interior",
            fields!(py, row = row, offset = offset, hint = hint),
        ),
        E::NotStabilizable { re, im, modulus } => (
            "not_stabilizable",
            fields!(py, re = re, im = im, modulus = modulus),
        ),
        E::NotSchur { spectral_radius } => {
            ("not_schur", fields!(py, spectral_radius = spectral_radius))
        }
        E::Unbounded { direction } => ("unbounded", fields!(py, direction = direction)),
        E::HorizonNotDetermined {
            reached,
            row,
            support,
            known,
            hint,
        } => (
            "horizon_not_determined",
            fields!(
                py,
                reached = reached,
                row = row,
                support = support,
                known = known,
                hint = hint
            ),
        ),
        E::Interrupted {
            at_least,
            rows_left,
        } => (
            "interrupted",
            fields!(py, at_least = at_least, rows_left = rows_left),
        ),
        E::Solver { what, detail } => ("solver", fields!(py, what = what, detail = detail)),
        _ => ("other", fields!(py)),
    }
}

/// What would help, as the command says it, in the words of Python's arguments.
fn design_help(error: &DesignError) -> Option<&'static str> {
    use DesignError as E;
    match error {
        E::NotSymmetric { .. } => Some("replace the weight W by (W + W.T) / 2"),
        E::NotPositiveDefinite { .. } => {
            Some("give every state and input a weight > 0, however small")
        }
        E::NotStabilizable { .. } => {
            Some("add an input that reaches this mode, or leave the mode out of the model")
        }
        E::NotSchur { .. } => Some(
            "leave gain out for that of the linear quadratic regulator; the law is u = K x, with a plus",
        ),
        E::Interrupted { .. } => Some("allow more time with time_limit, or none without it"),
        _ => None,
    }
}

/// What would help after a step failed.
fn step_help(error: &StepError) -> Option<&'static str> {
    match error {
        StepError::Infeasible { .. } => {
            Some("start closer to an equilibrium, or design with a longer horizon")
        }
        _ => None,
    }
}

/// The fields, and what would help as one of them.
fn helped<'py>(fields: Bound<'py, PyDict>, help: Option<&str>) -> Bound<'py, PyDict> {
    if let Some(help) = help {
        let _ = fields.set_item("help", help);
    }
    fields
}

/// `mpct.DesignError`.
pub fn design(py: Python<'_>, error: &DesignError) -> PyErr {
    let (kind, fields) = design_fields(py, error);
    let fields = helped(fields, design_help(error));
    exception(py, "DesignError", error.to_string(), kind, &fields)
}

fn step_fields<'py>(py: Python<'py>, error: &StepError) -> (&'static str, Bound<'py, PyDict>) {
    use StepError as E;
    match *error {
        E::StateNotFinite { index, value } => (
            "state_not_finite",
            fields!(py, index = index, value = value),
        ),
        E::SetPointNotFinite { index, value } => (
            "set_point_not_finite",
            fields!(py, index = index, value = value),
        ),
        E::WrongLength {
            what,
            expected,
            found,
        } => (
            "wrong_length",
            fields!(py, what = what, expected = expected, found = found),
        ),
        E::Infeasible { gap, radius } => ("infeasible", fields!(py, gap = gap, radius = radius)),
        E::IterationLimit {
            iterations,
            residual,
        } => (
            "iteration_limit",
            fields!(py, iterations = iterations, residual = residual),
        ),
        _ => ("other", fields!(py)),
    }
}

/// `mpct.StepError`.
pub fn step(py: Python<'_>, error: &StepError) -> PyErr {
    let (kind, fields) = step_fields(py, error);
    let fields = helped(fields, step_help(error));
    exception(py, "StepError", error.to_string(), kind, &fields)
}

/// `mpct.FileError`.
pub fn file(py: Python<'_>, error: &FileError) -> PyErr {
    use FileError as E;
    let (kind, fields) = match error {
        E::Unreadable { path, reason } => ("unreadable", fields!(py, path = path, reason = reason)),
        E::TooLarge { path, bytes, limit } => (
            "too_large",
            fields!(py, path = path, bytes = bytes, limit = limit),
        ),
        E::NotText { path, offset } => ("not_text", fields!(py, path = path, offset = offset)),
        E::Syntax { line, column, .. } => ("syntax", fields!(py, line = line, column = column)),
        E::UnknownKey {
            key,
            suggestion,
            known,
            line,
        } => (
            "unknown_key",
            fields!(
                py,
                key = key,
                suggestion = suggestion,
                known = known,
                line = line
            ),
        ),
        E::MissingKey { key, meaning } => {
            ("missing_key", fields!(py, key = key, meaning = meaning))
        }
        E::WrongType {
            key,
            expected,
            found,
            line,
        } => (
            "wrong_type",
            fields!(
                py,
                key = key,
                expected = expected,
                found = found,
                line = line
            ),
        ),
        E::Ragged {
            key,
            row,
            expected,
            found,
            line,
        } => (
            "ragged",
            fields!(
                py,
                key = key,
                row = row,
                expected = expected,
                found = found,
                line = line
            ),
        ),
        E::Csv { path, line, .. } => ("csv", fields!(py, path = path, line = line)),
        E::Problem(error) => return design(py, error),
        _ => ("other", fields!(py)),
    };
    let help = match error {
        E::TooLarge { .. } => {
            Some("write matrices with many zeros in sparse form, and large dense ones as CSV files")
        }
        E::NotText { .. } => {
            Some("mpct.example('academic').to_toml() is the text of a problem file")
        }
        _ => None,
    };
    let fields = helped(fields, help);
    exception(py, "FileError", error.to_string(), kind, &fields)
}

/// `mpct.SimulationError` or `mpct.DesignError`; a failed step brings its number and the run before it.
pub fn simulation<'py>(
    py: Python<'py>,
    error: &SimulationError,
    controller: Option<&Bound<'py, PyController>>,
) -> PyErr {
    match error {
        SimulationError::Setting(error) => design(py, error),
        SimulationError::InitialState { row, violation } => exception(
            py,
            "SimulationError",
            error.to_string(),
            "initial_state",
            &fields!(
                py,
                row = row.to_string(),
                violation = violation,
                help = "start inside the constraints, or widen that bound"
            ),
        ),
        SimulationError::Interrupted { run } => {
            match crate::simulation::run_to_python(py, run, controller) {
                Ok(run) => exception(
                    py,
                    "SimulationError",
                    error.to_string(),
                    "interrupted",
                    &fields!(py, run = run),
                ),
                Err(failure) => failure,
            }
        }
        SimulationError::Step {
            step,
            error: cause,
            run,
        } => {
            let (kind, fields) = step_fields(py, cause);
            let fields = helped(fields, step_help(cause));
            let known = crate::simulation::run_to_python(py, run, controller)
                .and_then(|run| fields.set_item("run", run))
                .and_then(|()| fields.set_item("step", step));
            match known {
                Ok(()) => exception(py, "SimulationError", error.to_string(), kind, &fields),
                Err(failure) => failure,
            }
        }
        _ => exception(
            py,
            "SimulationError",
            error.to_string(),
            "other",
            &fields!(py),
        ),
    }
}

/// Whatever stopped a reproduction of the paper's section 4.
pub fn reproduction(py: Python<'_>, error: &ReproductionError) -> PyErr {
    match error {
        ReproductionError::Design(e) => design(py, e),
        ReproductionError::Simulation(e) => simulation(py, e, None),
        ReproductionError::Step(e) => step(py, e),
        other => exception(py, "Error", other.to_string(), "other", &fields!(py)),
    }
}

/// `mpct.VerifyError`.
pub fn verify(py: Python<'_>, error: &VerifyError) -> PyErr {
    let kind = match error {
        VerifyError::Unreadable(_) => "unreadable",
        VerifyError::Digest => "digest",
        VerifyError::Refused(_) => "refused",
        _ => "other",
    };
    exception(py, "VerifyError", error.to_string(), kind, &fields!(py))
}

/// `mpct.ArgumentError`: a value of the right type that is none of those expected.
pub fn argument(py: Python<'_>, what: &str, expected: &str, found: &str) -> PyErr {
    stated(py, "ArgumentError", what, expected, found)
}

/// `mpct.ArgumentTypeError`: a value of another type.
pub fn argument_type(py: Python<'_>, what: &str, expected: &str, found: &str) -> PyErr {
    stated(py, "ArgumentTypeError", what, expected, found)
}

fn stated(py: Python<'_>, class: &str, what: &str, expected: &str, found: &str) -> PyErr {
    let message = format!("{what}: expected {expected}, found {found}");
    let fields = fields!(py, what = what, expected = expected, found = found);
    exception(py, class, message, "argument", &fields)
}
