//! Writes problem files that read back to the same problem, number by number.

use super::ProblemFile;
use crate::matrix::SparseMatrix;
use crate::problem::{EllipsoidShape, Formulation, Task, TerminalCost};
use std::fmt::Write;

/// Below this share of entries the sparse form of a matrix is shorter.
const SPARSE_SHARE: f64 = 0.2;

/// A number as TOML reads it back: shortest digits, with a point.
fn number(v: f64) -> String {
    if v == f64::INFINITY {
        "inf".into()
    } else if v == f64::NEG_INFINITY {
        "-inf".into()
    } else {
        let plain = format!("{v:?}");
        // TOML wants digits on both sides of the point, also before an exponent.
        match plain.split_once('e') {
            Some((mantissa, exponent)) if !mantissa.contains('.') => {
                format!("{mantissa}.0e{exponent}")
            }
            _ => plain,
        }
    }
}

/// TOML integers end at 2^63 - 1; larger seeds stand in quotes.
fn seed(seed: u64) -> String {
    if i64::try_from(seed).is_ok() {
        seed.to_string()
    } else {
        format!("\"{seed}\"")
    }
}

fn list(values: &[f64]) -> String {
    let items: Vec<String> = values.iter().map(|&v| number(v)).collect();
    format!("[{}]", items.join(", "))
}

fn matrix(m: &SparseMatrix) -> String {
    let cells = m.rows() * m.cols();
    if cells > 64 && (m.nonzeros() as f64) < SPARSE_SHARE * cells as f64 {
        let mut text = format!("{{ shape = [{}, {}], entries = [", m.rows(), m.cols());
        for (k, (i, j, v)) in m.entries().enumerate() {
            text.push_str(if k == 0 {
                ""
            } else if k % 6 == 0 {
                ",\n  "
            } else {
                ", "
            });
            let _ = write!(text, "[{i}, {j}, {}]", number(v));
        }
        text.push_str("] }");
        text
    } else {
        let dense = m.to_dense();
        let rows: Vec<String> = (0..m.rows()).map(|i| list(dense.row(i))).collect();
        if rows.len() > 2 {
            format!("[\n  {},\n]", rows.join(",\n  "))
        } else {
            format!("[{}]", rows.join(", "))
        }
    }
}

/// A scalar where the matrix is a multiple of the identity, a list where it is diagonal.
fn weight(m: &SparseMatrix) -> String {
    let diagonal: Vec<f64> = (0..m.rows()).map(|i| m.get(i, i)).collect();
    if m.entries().any(|(i, j, _)| i != j) {
        matrix(m)
    } else if diagonal.iter().all(|&v| v == diagonal[0]) {
        number(diagonal[0])
    } else {
        list(&diagonal)
    }
}

pub(super) fn write(file: &ProblemFile) -> String {
    let problem = &file.problem;
    let mut out = String::new();
    let mut line = |key: &str, value: String| {
        let _ = writeln!(out, "{key} = {value}");
    };
    if !problem.name().is_empty() {
        line(
            "name",
            toml::Value::String(problem.name().into()).to_string(),
        );
    }
    line("\n[plant]\nA", {
        let plant = problem.plant();
        matrix(plant.continuous_matrices().map_or(plant.a(), |c| c.0))
    });
    let plant = problem.plant();
    line(
        "B",
        matrix(plant.continuous_matrices().map_or(plant.b(), |c| c.1)),
    );
    line(
        "continuous",
        plant.continuous_matrices().is_some().to_string(),
    );
    if let Some(time) = plant.sampling_time() {
        line("sampling_time", number(time));
    }
    let at = plant.operating_point();
    if at.state.iter().chain(&at.input).any(|&v| v != 0.0) {
        line(
            "operating_point",
            format!(
                "{{ state = {}, input = {} }}",
                list(&at.state),
                list(&at.input)
            ),
        );
    }
    let labels = plant.labels();
    for (key, texts) in [
        ("state_names", &labels.state_names),
        ("state_units", &labels.state_units),
        ("input_names", &labels.input_names),
        ("input_units", &labels.input_units),
    ] {
        if !texts.is_empty() {
            let items = texts.iter().cloned().map(toml::Value::String).collect();
            line(key, toml::Value::Array(items).to_string());
        }
    }
    let constraints = problem.constraints();
    let (sl, su) = constraints.state_limits();
    let (il, iu) = constraints.input_limits();
    line("\n[constraints]\nstate_lower", list(sl));
    line("state_upper", list(su));
    line("input_lower", list(il));
    line("input_upper", list(iu));
    for rows in constraints.mixed_rows() {
        line("[[constraints.mixed]]\nC", matrix(&rows.c));
        line("D", matrix(&rows.d));
        line("d", list(&rows.bound));
    }
    for ellipsoid in constraints.ellipsoids() {
        let head = "[[constraints.ellipsoid]]";
        match ellipsoid.shape() {
            EllipsoidShape::State(e) => line(&format!("{head}\nstate"), weight(e)),
            EllipsoidShape::Input(e) => line(&format!("{head}\ninput"), weight(e)),
            EllipsoidShape::Mixed { c, d } => {
                line(&format!("{head}\nC"), matrix(c));
                line("D", matrix(d));
            }
        }
        if let Some(center) = ellipsoid.center() {
            line("center", list(center));
        }
    }
    line("\n[weights]\nQ", weight(problem.state_weight()));
    line("R", weight(problem.input_weight()));
    line("O", weight(problem.offset_weight()));
    if problem.offset_input_weight().nonzeros() > 0 {
        line("O_input", weight(problem.offset_input_weight()));
    }
    let task = match problem.task() {
        Task::Tracking => "\"tracking\"",
        Task::Regulation => "\"regulation\"",
    };
    line("\n[controller]\ntask", task.into());
    let formulation = match problem.formulation() {
        Formulation::Implicit => "\"implicit\"",
        Formulation::Explicit => "\"explicit\"",
        Formulation::NoTerminalConstraint => "\"no_terminal_constraint\"",
    };
    line("formulation", formulation.into());
    // Beside another formulation these keys are refused.
    let section_3_5 = problem.formulation() == Formulation::NoTerminalConstraint;
    if let Some(choices) = problem.no_terminal_constraint().filter(|_| section_3_5) {
        line("horizon_extension", choices.horizon_extension().to_string());
        line("gamma", number(choices.gamma()));
        if let Some(alpha) = choices.alpha() {
            line("alpha", number(alpha));
        }
    }
    if problem.terminal_cost() == TerminalCost::Implicit {
        line("terminal_cost", "\"implicit\"".into());
    }
    line(
        "prediction_horizon",
        problem.prediction_horizon().to_string(),
    );
    line("scaling", number(problem.scaling()));
    if let Some(gain) = problem.gain() {
        line("gain", matrix(gain));
    }
    if let Some(s) = &file.simulation {
        line("\n[simulation]\ninitial_state", list(&s.initial_state));
        line("steps", s.steps.to_string());
        if let Some(d) = &s.disturbance {
            line(
                "disturbance",
                format!("{{ bound = {}, seed = {} }}", list(&d.bound), seed(d.seed)),
            );
        }
        for p in &s.set_points {
            line(
                "[[simulation.setpoint]]\nfrom_step",
                p.from_step.to_string(),
            );
            line("state", list(&p.set_point.state));
            if let Some(input) = &p.set_point.input {
                line("input", list(input));
            }
        }
    }
    out.trim_start().to_string()
}
