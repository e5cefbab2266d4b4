//! `mpct compare`: the closed loops of two problem files side by side.

use crate::arguments::Compare;
use crate::commands::{design_with_progress, read};
use crate::failure::{Class, Failure};
use crate::output::{Waiting, print, print_json};
use mpct::Controller;
use mpct::analysis::{ComparedFigure, Performance, compare};
use serde_json::json;
use std::fmt::Write;
use std::path::Path;

pub fn run(arguments: &Compare) -> Result<(), Failure> {
    let first = performance(&arguments.first, arguments)?;
    let second = performance(&arguments.second, arguments)?;
    let mut figures = vec![ComparedFigure {
        what: "terminal horizon".into(),
        first: Some(first.0 as f64),
        second: Some(second.0 as f64),
    }];
    figures.extend(compare(&first.1, &second.1));
    if arguments.json {
        return print_json(&json!({
            "first": first.1, "second": second.1, "figures": figures,
        }));
    }
    let mut text = format!(
        "first:  {}\nsecond: {}\n  {:<36} {:>14} {:>14} {:>14}\n",
        arguments.first.display(),
        arguments.second.display(),
        "",
        "first",
        "second",
        "second / first"
    );
    let number = |v: Option<f64>| v.map_or("-".into(), |v| format!("{v:.6}"));
    for figure in &figures {
        let cell = |v: Option<f64>| match v {
            Some(x) if x != 0.0 && !(1e-3..1e7).contains(&x.abs()) => format!("{x:.4e}"),
            Some(x) if x.fract() == 0.0 => format!("{x}"),
            other => number(other),
        };
        let _ = writeln!(
            text,
            "  {:<36} {:>14} {:>14} {:>14}",
            figure.what,
            cell(figure.first),
            cell(figure.second),
            figure.ratio().map_or("-".into(), |r| format!("{r:.4}"))
        );
    }
    print(&text)
}

/// Terminal horizon and figures of one file.
fn performance(path: &Path, arguments: &Compare) -> Result<(usize, Performance), Failure> {
    let file = read(path)?;
    let mut simulation = file.simulation.ok_or_else(|| {
        Failure::new(
            Class::Input,
            "missing key `simulation`: what to simulate (initial_state, steps, setpoint)",
        )
        .in_file(path)
    })?;
    if let Some(steps) = arguments.steps {
        simulation.steps = steps;
    }
    let ingredients =
        design_with_progress(&file.problem, &arguments.limits).map_err(|f| f.in_file(path))?;
    let horizon = ingredients.terminal_horizon();
    let mut controller =
        Controller::new(ingredients).map_err(|e| Failure::from(e).in_file(path))?;
    let waiting = Waiting::new("closed loop", Some(simulation.steps as u64));
    let progress = |done| waiting.at(done as u64, String::new());
    let run = mpct::simulate(&mut controller, &simulation, Some(&progress))
        .map_err(|e| Failure::from(e).in_file(path))?;
    Ok((horizon, Performance::of(&run, &file.problem)?))
}
