//! Closed loops.

use crate::controller::PyController;
use crate::convert;
use crate::errors;
use crate::interrupt;
use mpct::{Disturbance, Run, RunStep, ScheduledSetPoint, SetPoint, Simulation};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::atomic::Ordering;

/// A set-point: first step, state, input.
type Scheduled<'py> = (usize, Bound<'py, PyAny>, Option<Bound<'py, PyAny>>);

/// Runs a closed loop; `mpct.simulate` makes a `Run` of the dictionary of arrays that it returns.
#[pyfunction]
#[pyo3(signature = (controller, x0, set_points, steps, disturbance=None, seed=0))]
pub fn simulate<'py>(
    py: Python<'py>,
    controller: &Bound<'py, PyController>,
    x0: &Bound<'py, PyAny>,
    set_points: Vec<Scheduled<'py>>,
    steps: usize,
    disturbance: Option<&Bound<'py, PyAny>>,
    seed: u64,
) -> PyResult<Bound<'py, PyAny>> {
    let scheduled = set_points
        .iter()
        .enumerate()
        .map(|(i, (from_step, state, input))| {
            Ok(ScheduledSetPoint {
                from_step: *from_step,
                set_point: SetPoint {
                    state: convert::vector(&format!("set_points[{i}]"), state)?,
                    input: input
                        .as_ref()
                        .map(|u| convert::vector(&format!("input of set_points[{i}]"), u))
                        .transpose()?,
                },
            })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let simulation = Simulation {
        initial_state: convert::vector("x0", x0)?,
        steps,
        set_points: scheduled,
        disturbance: disturbance
            .map(|bound| {
                Ok::<_, PyErr>(Disturbance {
                    bound: convert::vector("disturbance", bound)?,
                    seed,
                })
            })
            .transpose()?,
    };
    let inner = controller.get();
    let result = interrupt::run(
        py,
        |stop| {
            let mut controller = inner.lock();
            let progress = |_: usize| {
                if stop.load(Ordering::Relaxed) {
                    std::ops::ControlFlow::Break(())
                } else {
                    std::ops::ControlFlow::Continue(())
                }
            };
            mpct::simulation::simulate_until(&mut controller, &simulation, &progress)
        },
        |_| Ok(()),
    )?;
    let run = result.map_err(|e| errors::simulation(py, &e))?;
    run_to_python(py, &run, Some(controller))
}

/// A run as the arguments of `mpct.Run`.
pub fn run_to_python<'py>(
    py: Python<'py>,
    run: &Run,
    controller: Option<&Bound<'py, PyController>>,
) -> PyResult<Bound<'py, PyAny>> {
    let steps = &run.steps;
    let arrays = PyDict::new(py);
    let table = |of: fn(&RunStep) -> &[f64]| {
        let cols = steps.first().map_or(0, |s| of(s).len());
        convert::rows_to_array2(py, cols, steps.iter().map(of))
    };
    let column = |of: fn(&RunStep) -> f64| convert::to_array(py, steps.iter().map(of).collect());
    arrays.set_item("x", table(|s| &s.x)?)?;
    arrays.set_item("u", table(|s| &s.u)?)?;
    arrays.set_item("artificial_state", table(|s| &s.artificial_state)?)?;
    arrays.set_item("artificial_input", table(|s| &s.artificial_input)?)?;
    arrays.set_item("setpoint", table(|s| &s.setpoint)?)?;
    arrays.set_item("cost", column(|s| s.cost))?;
    arrays.set_item("offset_cost", column(|s| s.offset_cost))?;
    arrays.set_item("solve_seconds", column(|s| s.solve_seconds))?;
    arrays.set_item(
        "admissible",
        numpy::PyArray1::from_iter(py, steps.iter().map(|s| s.admissible)),
    )?;
    arrays.set_item(
        "iterations",
        numpy::PyArray1::from_iter(py, steps.iter().map(|s| s.iterations as i64)),
    )?;
    arrays.set_item(
        "status",
        steps
            .iter()
            .map(|s| s.status.to_string())
            .collect::<Vec<_>>(),
    )?;
    let summary = &run.summary;
    arrays.set_item(
        "final_state",
        convert::to_array(py, summary.final_state.clone()),
    )?;
    arrays.set_item("cumulative_cost", summary.cumulative_cost)?;
    arrays.set_item("worst_violation", summary.worst_violation)?;
    let problem = match controller {
        Some(controller) => Some(controller.getattr("design")?.getattr("problem")?),
        None => None,
    };
    arrays.set_item("problem", problem)?;
    py.import("mpct._run")?
        .call_method("from_arrays", (arrays,), None)
}
