//! `mpct sweep`: Table 1 for any problem.

use crate::arguments::Sweep;
use crate::commands::{duration, headline, read, with_progress};
use crate::failure::Failure;
use crate::output::{Waiting, print, print_json};
use mpct::{Controller, TerminalIngredients};
use serde_json::json;
use std::fmt::Write;
use std::time::Instant;

pub fn run(arguments: &Sweep) -> Result<(), Failure> {
    let file = read(&arguments.file)?;
    // All scalings are checked before the first is worked on.
    for &scaling in &arguments.scaling {
        file.problem.clone().with_scaling(scaling)?;
    }
    // K, P and the rows along the terminal law are shared by all scalings.
    let designs = with_progress(&arguments.limits, |options| {
        TerminalIngredients::design_all(&file.problem, &arguments.scaling, options)
    });
    let designs = designs.map_err(|e| Failure::from(e).in_file(&arguments.file))?;
    let mut lines = Vec::new();
    for (scaling, design) in arguments.scaling.iter().zip(designs) {
        let ingredients = design.map_err(|e| {
            let failure = Failure::from(e);
            let message = format!("scaling {scaling}: {}", failure.message);
            Failure { message, ..failure }.in_file(&arguments.file)
        })?;
        let mut line = Line {
            scaling: *scaling,
            terminal_horizon: ingredients.terminal_horizon(),
            cost: None,
            design_seconds: ingredients.elapsed().as_secs_f64(),
            simulation_seconds: None,
        };
        if let Some(simulation) = &file.simulation {
            let started = Instant::now();
            let what = format!("scaling {scaling}");
            let waiting = Waiting::new(&what, Some(simulation.steps as u64));
            let mut controller = Controller::new(ingredients)
                .map_err(|e| Failure::from(e).in_file(&arguments.file))?;
            let progress = |done| waiting.at(done as u64, String::new());
            let run = mpct::simulate(&mut controller, simulation, Some(&progress))
                .map_err(|e| Failure::from(e).in_file(&arguments.file))?;
            line.cost = Some(run.summary.cumulative_cost);
            line.simulation_seconds = Some(started.elapsed().as_secs_f64());
        }
        lines.push(line);
    }
    if arguments.json {
        let list: Vec<_> = lines.iter().map(Line::as_json).collect();
        return print_json(&json!(list));
    }
    let mut text = headline(&file.problem) + "\n";
    let _ = writeln!(
        text,
        "  {:>8}  {:>16}  {:>16}  {:>10}  {:>10}",
        "scaling", "terminal horizon", "cumulative cost", "design", "simulation"
    );
    for line in lines {
        let cost = line.cost.map_or("-".into(), |c| format!("{c:.6e}"));
        let _ = writeln!(
            text,
            "  {:>8}  {:>16}  {cost:>16}  {:>10}  {:>10}",
            line.scaling,
            line.terminal_horizon,
            duration(line.design_seconds),
            line.simulation_seconds.map_or("-".into(), duration)
        );
    }
    print(&text)
}

/// One scaling.
struct Line {
    scaling: f64,
    terminal_horizon: usize,
    cost: Option<f64>,
    design_seconds: f64,
    simulation_seconds: Option<f64>,
}

impl Line {
    fn as_json(&self) -> serde_json::Value {
        json!({
            "scaling": self.scaling,
            "terminal_horizon": self.terminal_horizon,
            "cumulative_cost": self.cost,
            "design_seconds": self.design_seconds,
            "simulation_seconds": self.simulation_seconds,
        })
    }
}
