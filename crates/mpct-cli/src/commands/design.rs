//! `mpct design`: the terminal ingredients.

use crate::arguments::Design;
use crate::commands::{design_with_progress, duration, headline, read, rows};
use crate::failure::Failure;
use crate::output::{OutputFile, print, print_json};
use mpct::TerminalIngredients;
use mpct::certificate::Certificate;
use serde_json::json;
use std::fmt::Write;

pub fn run(arguments: &Design) -> Result<(), Failure> {
    let file = read(&arguments.file)?;
    let certificate = match &arguments.certificate {
        Some(path) => Some(OutputFile::open(path)?),
        None => None,
    };
    let ingredients = design_with_progress(&file.problem, &arguments.limits)
        .map_err(|f| f.in_file(&arguments.file))?;
    if let Some(file) = certificate {
        file.write(Certificate::of(&ingredients)?.to_json().as_bytes())?;
    }
    let terminal_rows = if arguments.explicit_set {
        let set = ingredients
            .maximal_admissible_set()
            .map_err(|e| Failure::from(e).in_file(&arguments.file))?;
        Some(set.len())
    } else {
        None
    };
    if arguments.json {
        return print_json(&as_json(&ingredients, terminal_rows));
    }
    print(&as_text(&ingredients, terminal_rows))
}

fn as_json(ingredients: &TerminalIngredients, terminal_rows: Option<usize>) -> serde_json::Value {
    let problem = ingredients.problem();
    let steady = ingredients.steady_states();
    let mut value = json!({
        "name": problem.name(),
        "n": problem.plant().states(),
        "m": problem.plant().inputs(),
        "scaling": problem.scaling(),
        "task": problem.task(),
        "spectral_radius": ingredients.spectral_radius(),
        "gain": rows(ingredients.gain()),
        "terminal_weight": rows(ingredients.terminal_weight()),
        "steady_state_basis": {
            "state": rows(steady.state_basis()),
            "input": rows(steady.input_basis()),
        },
        "terminal_horizon": ingredients.terminal_horizon(),
        "condition": ingredients.condition(),
        "minimal": ingredients.is_minimal(),
        "constraint_rows": ingredients.constraint_rows(),
        "ellipsoids": problem.norms().len(),
        "spent_steps": ingredients
            .spent_steps()
            .iter()
            .map(|(row, step)| json!({"row": row.to_string(), "step": step}))
            .collect::<Vec<_>>(),
        "linear_programs": ingredients.linear_programs(),
        "seconds": ingredients.elapsed().as_secs_f64(),
    });
    if let (Some(n), Some(object)) = (terminal_rows, value.as_object_mut()) {
        object.insert("terminal_rows".into(), n.into());
    }
    value
}

fn as_text(ingredients: &TerminalIngredients, terminal_rows: Option<usize>) -> String {
    let problem = ingredients.problem();
    let mut text = headline(problem) + "\n";
    let mut line = |what: &str, value: String| {
        let _ = writeln!(text, "  {what:<28} {value}");
    };
    line(
        "terminal horizon",
        format!(
            "{} ({} condition{})",
            ingredients.terminal_horizon(),
            ingredients.condition(),
            if problem.norms().is_empty() || ingredients.is_minimal() {
                ""
            } else {
                "; sufficient, not shown to be the smallest"
            }
        ),
    );
    line("scaling", problem.scaling().to_string());
    line(
        "prediction horizon",
        problem.prediction_horizon().to_string(),
    );
    line(
        "spectral radius of A + B K",
        format!("{:.6}", ingredients.spectral_radius()),
    );
    line(
        "rows of the terminal law",
        ingredients.constraint_rows().to_string(),
    );
    let last = ingredients
        .spent_steps()
        .iter()
        .map(|s| s.1)
        .max()
        .unwrap_or(0);
    let mut latest: Vec<String> = ingredients
        .spent_steps()
        .iter()
        .filter(|s| s.1 == last)
        .map(|s| s.0.to_string())
        .collect();
    let more = latest.len().saturating_sub(4);
    latest.truncate(4);
    if more > 0 {
        latest.push(format!("and {more} more"));
    }
    line("determined by", latest.join(", "));
    if let Some(n) = terminal_rows {
        line("rows of the explicit set", n.to_string());
    }
    line("linear programs", ingredients.linear_programs().to_string());
    line("time", duration(ingredients.elapsed().as_secs_f64()));
    text
}
