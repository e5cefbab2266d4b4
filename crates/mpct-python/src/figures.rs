//! Figures of designs and runs, certificates, case studies: functions that answer with plain data.

use crate::controller;
use crate::convert;
use crate::design::PyDesign;
use crate::errors;
use crate::fork;
use crate::interrupt;
use crate::problem::PyProblem;
use crate::search::Search;
use crate::simulation::run_from_python;
use mpct::analysis::reproduce::{Extent, reproduce as run_reproduction};
use mpct::analysis::{self, Performance};
use mpct::certificate::{self, VerifyOptions};
use mpct::{ProblemFile, SetPoint, cases};
use mpct_report::{REPRODUCTION_FILES, ReportData, choose, picture, render, reproduction_files};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::Path;
use std::sync::atomic::Ordering;

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

/// The page of a closed loop, and a picture of the states and inputs with the names `signals` when they are not None.
#[pyfunction]
pub fn _report(
    py: Python<'_>,
    run: &Bound<'_, PyAny>,
    design: PyRef<'_, PyDesign>,
    disturbed: bool,
    signals: Option<Vec<String>>,
) -> PyResult<String> {
    let run = run_from_python(run)?;
    let ingredients = &design.inner;
    let plant = ingredients.problem().plant();
    let (n, m) = (plant.states(), plant.inputs());
    if let Some(step) = run.steps.first() {
        if (step.x.len(), step.u.len()) != (n, m) {
            let words = |n: usize, m: usize| format!("one with {n} states and {m} inputs");
            let found = words(step.x.len(), step.u.len());
            return Err(errors::argument(py, "run", &words(n, m), &found));
        }
        let widths = [
            ("artificial_state", n, step.artificial_state.len()),
            ("artificial_input", m, step.artificial_input.len()),
            ("setpoint", n, step.setpoint.len()),
        ];
        if let Some((what, expected, found)) = widths.iter().find(|w| w.1 != w.2) {
            let words = |n: usize| format!("{n} columns");
            return Err(errors::argument(
                py,
                what,
                &words(*expected),
                &words(*found),
            ));
        }
    }
    let report = || ReportData::new(ingredients, &run).with_disturbance(disturbed);
    match signals {
        None => Ok(fork::detached(py, || render(&report()))),
        Some(names) => {
            let choice = choose(ingredients.problem(), &names)
                .map_err(|e| errors::argument(py, "signals", "names of states and inputs", &e))?;
            Ok(fork::detached(py, || picture(&report(), &choice)))
        }
    }
}

/// Names of files and their texts.
type Files = Vec<(&'static str, String)>;

/// Section 4 of the paper as plain data, and as texts of files with their names.
#[pyfunction]
pub fn _reproduce<'py>(py: Python<'py>, extent: &str) -> PyResult<(Bound<'py, PyAny>, Files)> {
    let extent = match extent {
        "short" => Extent::Short,
        "standard" => Extent::Standard,
        "full" => Extent::Full,
        _ => {
            let expected = "'short' or 'standard' or 'full'";
            return Err(errors::argument(
                py,
                "extent",
                expected,
                &format!("'{extent}'"),
            ));
        }
    };
    let found = interrupt::leave(py, move |left| {
        run_reproduction(extent, &|_| {
            if left.load(Ordering::Relaxed) {
                // Nobody waits for the rest. This ends the thread without a message.
                std::panic::resume_unwind(Box::new("left"));
            }
        })
    })?
    .map_err(|e| errors::reproduction(py, &e))?;
    let texts = fork::detached(py, || reproduction_files(&found))
        .map_err(pyo3::exceptions::PyRuntimeError::new_err)?;
    let files = REPRODUCTION_FILES
        .into_iter()
        .zip(texts)
        .map(|(name, (_, text))| (name, text))
        .collect();
    Ok((convert::plain(py, &found)?, files))
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
