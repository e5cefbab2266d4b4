//! Closed loops.

use crate::controller::PyController;
use crate::convert;
use crate::errors;
use crate::interrupt;
use crate::names;
use mpct::{Disturbance, Run, RunStep, ScheduledSetPoint, SetPoint, Simulation, Summary};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::atomic::Ordering;

/// A set-point: first step, state, input.
type Scheduled<'py> = (usize, Bound<'py, PyAny>, Option<Bound<'py, PyAny>>);

/// What an instance of `mpct.Simulation` states.
pub fn setting_from_python(setting: &Bound<'_, PyAny>) -> PyResult<Simulation> {
    let schedule: Vec<Scheduled<'_>> = setting.call_method0("_schedule")?.extract()?;
    let set_points = schedule
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
    let bound = setting.getattr("disturbance")?;
    let disturbance = if bound.is_none() {
        None
    } else {
        Some(Disturbance {
            bound: convert::vector("disturbance", &bound)?,
            seed: convert::whole_of("seed", &setting.getattr("seed")?)? as u64,
        })
    };
    Ok(Simulation {
        initial_state: convert::vector("x0", &setting.getattr("x0")?)?,
        steps: convert::whole_of("steps", &setting.getattr("steps")?)?,
        set_points,
        disturbance,
    })
}

/// An instance of `mpct.Simulation`.
pub fn setting_to_python<'py>(
    py: Python<'py>,
    setting: &Simulation,
) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    let array = |v: &[f64]| PyArray1::from_slice(py, v);
    fields.set_item("x0", array(&setting.initial_state))?;
    fields.set_item("steps", setting.steps)?;
    let set_points = setting
        .set_points
        .iter()
        .map(|s| {
            let state = array(&s.set_point.state).into_any();
            let mut items = vec![s.from_step.into_pyobject(py)?.into_any(), state];
            items.extend(s.set_point.input.as_ref().map(|u| array(u).into_any()));
            convert::tuple(py, items)
        })
        .collect::<PyResult<Vec<_>>>()?;
    fields.set_item("set_points", set_points)?;
    if let Some(d) = &setting.disturbance {
        fields.set_item("disturbance", array(&d.bound))?;
        fields.set_item("seed", d.seed)?;
    }
    py.import("mpct._run")?
        .getattr("Simulation")?
        .call((), Some(&fields))
}

/// Runs a closed loop; without the GIL, and until Ctrl-C.
#[pyfunction]
pub fn _simulate<'py>(
    py: Python<'py>,
    controller: &Bound<'py, PyController>,
    setting: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let simulation = setting_from_python(setting)?;
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
    let run = result.map_err(|e| errors::simulation(py, &e, Some(controller)))?;
    run_to_python(py, &run, Some(controller))
}

/// The run that an instance of `mpct.Run` holds.
pub fn run_from_python(run: &Bound<'_, PyAny>) -> PyResult<Run> {
    let table = |name: &str| convert::matrix(name, &run.getattr(name)?);
    let column = |name: &str| convert::vector(name, &run.getattr(name)?);
    let (x, u) = (table("x")?, table("u")?);
    let (artificial_x, artificial_u) = (table("artificial_state")?, table("artificial_input")?);
    let (setpoint, cost) = (table("setpoint")?, column("cost")?);
    let (offset_cost, seconds) = (column("offset_cost")?, column("solve_seconds")?);
    // A run may be put together by hand, of lists in place of arrays.
    let listed = |name: &str| {
        let numpy = run.py().import("numpy")?;
        numpy
            .call_method1("asarray", (run.getattr(name)?,))?
            .call_method0("tolist")
    };
    let wrong = |name: &str, expected: &str| {
        errors::argument_type(run.py(), name, expected, "something else")
    };
    let admissible: Vec<bool> = listed("admissible")?
        .extract()
        .map_err(|_| wrong("admissible", "an array of booleans"))?;
    let iterations: Vec<usize> = listed("iterations")?
        .extract()
        .map_err(|_| wrong("iterations", "an array of whole numbers >= 0"))?;
    let status: Vec<String> = convert::texts("status", Some(&run.getattr("status")?))?;
    let reasons: Vec<Option<String>> = match run.getattr("reason")? {
        none if none.is_none() => vec![None; status.len()],
        list => list
            .extract()
            .map_err(|_| wrong("reason", "a list of texts and None"))?,
    };
    let steps = x.rows();
    let rows = [
        ("u", u.rows()),
        ("artificial_state", artificial_x.rows()),
        ("artificial_input", artificial_u.rows()),
        ("setpoint", setpoint.rows()),
        ("cost", cost.len()),
        ("offset_cost", offset_cost.len()),
        ("solve_seconds", seconds.len()),
        ("admissible", admissible.len()),
        ("iterations", iterations.len()),
        ("status", status.len()),
        ("reason", reasons.len()),
    ];
    if let Some((what, found)) = rows.iter().find(|r| r.1 != steps) {
        return Err(errors::argument(
            run.py(),
            what,
            &format!("{steps} steps, as in x"),
            &found.to_string(),
        ));
    }
    let list = (0..steps)
        .map(|k| {
            Ok(RunStep {
                k,
                x: x.row(k).to_vec(),
                u: u.row(k).to_vec(),
                artificial_state: artificial_x.row(k).to_vec(),
                artificial_input: artificial_u.row(k).to_vec(),
                setpoint: setpoint.row(k).to_vec(),
                cost: cost[k],
                offset_cost: offset_cost[k],
                admissible: admissible[k],
                status: names::status(run.py(), &status[k], reasons[k].as_deref())?,
                iterations: iterations[k],
                solve_seconds: seconds[k],
            })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let mean = seconds.iter().sum::<f64>() / steps.max(1) as f64;
    Ok(Run {
        summary: Summary {
            cumulative_cost: run.getattr("cumulative_cost")?.extract()?,
            mean_solve_seconds: mean,
            max_solve_seconds: seconds.iter().fold(0.0, |a: f64, b| a.max(*b)),
            final_state: column("final_state")?,
            final_artificial_state: list
                .last()
                .map_or_else(Vec::new, |s| s.artificial_state.clone()),
            worst_violation: run.getattr("worst_violation")?.extract()?,
        },
        steps: list,
    })
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
    arrays.set_item(
        "reason",
        steps
            .iter()
            .map(|s| names::reason(s.status))
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
    arrays.set_item("controller", controller)?;
    py.import("mpct._run")?
        .call_method("from_arrays", (arrays,), None)
}
