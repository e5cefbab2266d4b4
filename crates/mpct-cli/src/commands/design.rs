//! `mpct design`: the terminal ingredients.

use crate::arguments::Design;
use crate::commands::{design_with_progress, duration, first_set_point, headline, read, rows};
use crate::failure::Failure;
use crate::output::{OutputFile, print, print_json};
use mpct::analysis::{AlphaBounds, AlphaScope};
use mpct::certificate::Certificate;
use mpct::{Formulation, TerminalIngredients};
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
    // Section 3.5: too long an extension is refused here, and not only when a controller is made.
    let levels = match file.problem.formulation() {
        Formulation::NoTerminalConstraint => Some(
            AlphaBounds::of(&ingredients, &first_set_point(&file))
                .map_err(|e| Failure::from(e).in_file(&arguments.file))?,
        ),
        _ => None,
    };
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
        let mut value = as_json(&ingredients, terminal_rows);
        if let (Some(levels), Some(object)) = (&levels, value.as_object_mut()) {
            object.insert("levels".into(), levels_as_json(levels));
        }
        return print_json(&value);
    }
    let mut text = as_text(&ingredients, terminal_rows);
    if let Some(levels) = &levels {
        text += &levels_as_text(levels, &ingredients);
    }
    print(&text)
}

const SCOPES: [AlphaScope; 3] = [
    AlphaScope::EveryEquilibrium,
    AlphaScope::ThroughoutRegion,
    AlphaScope::AroundSetPoint,
];

/// The largest levels alpha of section 3.5, and d for each.
fn levels_as_json(levels: &AlphaBounds) -> serde_json::Value {
    let each: Vec<_> = SCOPES
        .iter()
        .map(|&scope| {
            let alpha = levels.largest(scope);
            json!({
                "scope": scope,
                "largest_alpha": alpha,
                "limiting": levels.limiting(scope).to_string(),
                "d": alpha * levels.stage_cost_ratio,
            })
        })
        .collect();
    json!({ "set_point": levels.closest.state, "stage_cost_ratio": levels.stage_cost_ratio, "alpha": each })
}

fn levels_as_text(levels: &AlphaBounds, ingredients: &TerminalIngredients) -> String {
    let mut text = format!(
        "  section 3.5, set-point {}: d = {:.6} alpha\n",
        crate::commands::vector(&levels.closest.state),
        levels.stage_cost_ratio
    );
    let stated = ingredients
        .problem()
        .no_terminal_constraint()
        .and_then(|c| c.alpha());
    for scope in SCOPES {
        let largest = levels.largest(scope);
        let verdict = match stated {
            Some(alpha) if alpha > largest => format!("; {alpha} is too large"),
            Some(alpha) => format!("; {alpha} is admissible"),
            None => String::new(),
        };
        let _ = writeln!(
            text,
            "    alpha <= {largest:.6} for {scope} ({}){verdict}",
            levels.limiting(scope)
        );
    }
    text
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
        "phases": phases(ingredients),
    });
    if let (Some(n), Some(object)) = (terminal_rows, value.as_object_mut()) {
        object.insert("terminal_rows".into(), n.into());
    }
    value
}

/// Seconds of each part of the design.
fn phases(ingredients: &TerminalIngredients) -> serde_json::Value {
    let phases = ingredients.phases();
    json!({
        "law": phases.law.as_secs_f64(),
        "steady_states": phases.steady_states.as_secs_f64(),
        "rows": phases.rows.as_secs_f64(),
        "programs": phases.programs.as_secs_f64(),
    })
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
