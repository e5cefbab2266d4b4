//! Figures of designs and runs, certificates, case studies: functions that answer with plain data.

use crate::controller;
use crate::convert;
use crate::errors;
use crate::fork;
use crate::problem::PyProblem;
use crate::search::Search;
use crate::simulation::run_from_python;
use mpct::analysis::{self, Performance};
use mpct::certificate::{self, VerifyOptions};
use mpct::{ProblemFile, SetPoint, cases};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::Path;

/// `mpct.scaling_need`, without its class.
#[pyfunction]
pub fn _scaling_need<'py>(
    py: Python<'py>,
    problem: PyRef<'_, PyProblem>,
    set_point: &Bound<'py, PyAny>,
    input: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let set_point = controller::set_point(set_point, input)?;
    let problem = &problem.inner;
    let need = fork::detached(py, || analysis::scaling_need(problem, &set_point))
        .map_err(|e| errors::design(py, &e))?;
    convert::plain(py, &need)
}

/// `mpct.scaling_advice`, without its class.
#[pyfunction]
pub fn _scaling_advice<'py>(
    py: Python<'py>,
    problem: PyRef<'_, PyProblem>,
    set_points: Vec<(Bound<'py, PyAny>, Option<Bound<'py, PyAny>>)>,
    condition: &str,
    #[pyo3(from_py_with = convert::whole::max_horizon)] max_horizon: usize,
    time_limit: Option<f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let set_points = set_points
        .iter()
        .enumerate()
        .map(|(i, (state, input))| {
            let vector = |what: &str, v| convert::vector(&format!("{what}[{i}]"), v);
            Ok(SetPoint {
                state: vector("set_points", state)?,
                input: input.as_ref().map(|u| vector("inputs", u)).transpose()?,
            })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let problem = &problem.inner;
    let advice = Search::of(py, condition, max_horizon, time_limit, None)?
        .run(py, |options| {
            analysis::scaling_advice(problem, &set_points, options)
        })?
        .map_err(|e| errors::design(py, &e))?;
    convert::plain(py, &advice)
}

/// `mpct.performance`, without its class.
#[pyfunction]
pub fn _performance<'py>(
    py: Python<'py>,
    run: &Bound<'py, PyAny>,
    problem: PyRef<'_, PyProblem>,
) -> PyResult<Bound<'py, PyAny>> {
    let run = run_from_python(run)?;
    let found = Performance::of(&run, &problem.inner).map_err(|e| errors::design(py, &e))?;
    convert::plain(py, &found)
}

/// `mpct.compare`, without its class.
#[pyfunction]
pub fn _compare<'py>(
    py: Python<'py>,
    first: &Bound<'py, PyAny>,
    first_problem: PyRef<'_, PyProblem>,
    second: &Bound<'py, PyAny>,
    second_problem: PyRef<'_, PyProblem>,
) -> PyResult<Bound<'py, PyAny>> {
    let of = |run: &Bound<'py, PyAny>, problem: &PyProblem| {
        Performance::of(&run_from_python(run)?, &problem.inner).map_err(|e| errors::design(py, &e))
    };
    let (first, second) = (of(first, &first_problem)?, of(second, &second_problem)?);
    convert::plain(py, &analysis::compare(&first, &second))
}

/// `mpct.verify`, of a text.
#[pyfunction]
pub fn _verify<'py>(
    py: Python<'py>,
    text: &str,
    ignore_digest: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let found = fork::detached(py, || {
        certificate::verify(text, VerifyOptions { ignore_digest })
    })
    .map_err(|e| errors::verify(py, &e))?;
    let fields = PyDict::new(py);
    fields.set_item("problem", &found.problem)?;
    fields.set_item("terminal_horizon", found.terminal_horizon)?;
    fields.set_item("smallest_margin", found.smallest_margin)?;
    fields.set_item("tightest_row", &found.tightest_row)?;
    fields.set_item("rows_rigorous", found.rows_rigorous)?;
    fields.set_item("rows_to_tolerance", found.rows_to_tolerance)?;
    fields.set_item("lyapunov_residual", found.lyapunov_residual)?;
    fields.set_item("steady_state_residual", found.steady_state_residual)?;
    fields.set_item("witness", found.witness)?;
    fields.set_item("statement", found.to_string())?;
    convert::result(py, "Verified", &fields)
}

/// The text of a case study.
#[pyfunction]
pub fn _example(
    py: Python<'_>,
    case: &str,
    #[pyo3(from_py_with = convert::whole::count)] count: usize,
) -> PyResult<String> {
    let file: ProblemFile = match case {
        "academic" => cases::academic(),
        "drone" => cases::drone(),
        "carts" => cases::carts(count).map_err(|e| errors::design(py, &e))?,
        _ => {
            let expected = "'academic' or 'carts' or 'drone'";
            return Err(errors::argument(py, "case", expected, &format!("'{case}'")));
        }
    };
    Ok(cases::text(&file))
}

/// Problem and simulation of a problem file: `path`, or the text in the folder "." when it is None.
#[pyfunction]
pub fn _read_file<'py>(
    py: Python<'py>,
    path: Option<std::path::PathBuf>,
    text: Option<String>,
) -> PyResult<(PyProblem, Option<Bound<'py, PyAny>>)> {
    let file = fork::detached(py, || match (&path, &text) {
        (Some(path), _) => ProblemFile::read(path),
        (None, text) => ProblemFile::parse(text.as_deref().unwrap_or_default(), Path::new(".")),
    })
    .map_err(|e| errors::file(py, &e))?;
    let simulation = file
        .simulation
        .map(|s| crate::simulation::setting_to_python(py, &s))
        .transpose()?;
    Ok((file.problem.into(), simulation))
}

/// The text of a problem file.
#[pyfunction]
pub fn _write_file(
    problem: PyRef<'_, PyProblem>,
    simulation: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let simulation = simulation
        .map(crate::simulation::setting_from_python)
        .transpose()?;
    let file = ProblemFile {
        problem: problem.inner.clone(),
        simulation,
    };
    Ok(file.to_toml())
}
