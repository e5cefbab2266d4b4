//! `mpct sweep`: Table 1 for any problem.

use crate::arguments::Sweep;
use crate::commands::{design_with_progress, duration, headline, read};
use crate::failure::Failure;
use crate::output::{Waiting, print, print_json};
use mpct::Controller;
use serde_json::json;
use std::fmt::Write;
use std::time::Instant;

pub fn run(arguments: &Sweep) -> Result<(), Failure> {
    let file = read(&arguments.file)?;
    // All scalings are checked before the first is worked on.
    let problems = arguments
        .scaling
        .iter()
        .map(|&scaling| {
            file.problem
                .clone()
                .with_scaling(scaling)
                .map_err(Failure::from)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut lines = Vec::new();
    for problem in problems {
        let started = Instant::now();
        let ingredients = design_with_progress(&problem, &arguments.limits)
            .map_err(|f| f.in_file(&arguments.file))?;
        let terminal_horizon = ingredients.terminal_horizon();
        let cost = match &file.simulation {
            None => None,
            Some(simulation) => {
                let what = format!("scaling {}", problem.scaling());
                let waiting = Waiting::new(&what, Some(simulation.steps as u64));
                let mut controller = Controller::new(ingredients)
                    .map_err(|e| Failure::from(e).in_file(&arguments.file))?;
                let progress = |done| waiting.at(done as u64, String::new());
                let run = mpct::simulate(&mut controller, simulation, Some(&progress))
                    .map_err(|e| Failure::from(e).in_file(&arguments.file))?;
                Some(run.summary.cumulative_cost)
            }
        };
        lines.push((
            problem.scaling(),
            terminal_horizon,
            cost,
            started.elapsed().as_secs_f64(),
        ));
    }
    if arguments.json {
        let list: Vec<_> = lines
            .iter()
            .map(|(scaling, horizon, cost, seconds)| {
                json!({"scaling": scaling, "terminal_horizon": horizon, "cumulative_cost": cost, "seconds": seconds})
            })
            .collect();
        return print_json(&json!(list));
    }
    let mut text = headline(&file.problem) + "\n";
    let _ = writeln!(
        text,
        "  {:>8}  {:>16}  {:>16}  {:>10}",
        "scaling", "terminal horizon", "cumulative cost", "time"
    );
    for (scaling, horizon, cost, seconds) in lines {
        let cost = cost.map_or("-".into(), |c| format!("{c:.6e}"));
        let _ = writeln!(
            text,
            "  {scaling:>8}  {horizon:>16}  {cost:>16}  {:>10}",
            duration(seconds)
        );
    }
    print(&text)
}
