//! Reports and pictures: those of the command, as texts and bytes. Python writes the files.

use crate::analysis::long_answer;
use crate::controller::PyController;
use crate::errors;
use crate::fork;
use crate::interrupt;
use crate::simulation::run_from_python;
use mpct::analysis::reproduce::{Extent, reproduce as run_reproduction};
use mpct::{Problem, Run};
use mpct_report::{
    Choice, Format, REPRODUCTION_FILES, Report, reproduction_figures, reproduction_files,
};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// A run whose rows have the lengths that the plant asks for.
fn fitting_run(run: &Bound<'_, PyAny>, problem: &Problem) -> PyResult<Run> {
    let py = run.py();
    let run = run_from_python(run)?;
    let (n, m) = (problem.plant().states(), problem.plant().inputs());
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
    Ok(run)
}

/// The page of a closed loop, with the margins of what was proved.
#[pyfunction]
pub fn _report(
    py: Python<'_>,
    run: &Bound<'_, PyAny>,
    controller: &Bound<'_, PyController>,
    disturbed: bool,
) -> PyResult<String> {
    let ingredients = controller.get().ingredients().clone();
    let run = fitting_run(run, ingredients.problem())?;
    let shared = controller.get().shared();
    long_answer(py, move || {
        Report::new(&ingredients, &run, disturbed)
            .with_proofs(&shared.lock(), &run)
            .page()
    })
}

/// A picture of the states and inputs with the names `signals` as SVG, and the bytes of the file when it has a name.
#[pyfunction]
pub fn _picture(
    py: Python<'_>,
    run: &Bound<'_, PyAny>,
    controller: &Bound<'_, PyController>,
    signals: Vec<String>,
    path: Option<PathBuf>,
) -> PyResult<(String, Option<Vec<u8>>)> {
    let format = path
        .map(|path| {
            Format::of(&path).map_err(|_| {
                let expected = "a file that ends in .svg or .png";
                errors::argument(py, "path", expected, &path.display().to_string())
            })
        })
        .transpose()?;
    let ingredients = controller.get().ingredients().clone();
    let run = fitting_run(run, ingredients.problem())?;
    let choice = Choice::of(ingredients.problem(), &signals)
        .map_err(|e| errors::argument(py, "signals", "names of states and inputs", &e))?;
    fork::detached(py, || {
        // Whether a disturbance acted is told by the page alone.
        let svg = Report::new(&ingredients, &run, false).picture(&choice);
        let bytes = format.map(|f| f.encode(&svg)).transpose()?;
        Ok((svg, bytes))
    })
    .map_err(|e: String| PyRuntimeError::new_err(format!("cannot draw the picture: {e}")))
}

/// Names of files and what they have.
type Files = Vec<(String, Vec<u8>)>;

/// Section 4 of the paper as files; its figures too when `png` says so.
#[pyfunction]
pub fn _reproduce(py: Python<'_>, extent: &str, png: bool) -> PyResult<Files> {
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
    fork::detached(py, || {
        let mut files: Files = REPRODUCTION_FILES
            .into_iter()
            .zip(reproduction_files(&found)?)
            .map(|(name, (_, text))| (name.into(), text.into_bytes()))
            .collect();
        if png {
            for drawn in reproduction_figures(&found) {
                let bytes = Format::Png.encode(&drawn.svg)?;
                files.push((format!("{}.png", drawn.name), bytes));
            }
        }
        Ok(files)
    })
    .map_err(|e: String| PyRuntimeError::new_err(e))
}
