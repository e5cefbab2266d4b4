//! `mpct check`: the problem file and Assumption 1.

use crate::arguments::Check;
use crate::commands::{headline, read, vector};
use crate::failure::Failure;
use crate::output::{print, print_json};
use mpct::{Problem, SteadyStates, Task};
use serde_json::json;
use std::fmt::Write;

pub fn run(arguments: &Check) -> Result<(), Failure> {
    let file = read(&arguments.file)?;
    let problem = &file.problem;
    let assumption = mpct::terminal::check_assumption(problem)
        .map_err(|e| Failure::from(e).in_file(&arguments.file))?;
    let set_points = set_points(problem, &assumption.steady_states, &file)?;
    if arguments.json {
        return print_json(&json!({
            "n": problem.plant().states(),
            "m": problem.plant().inputs(),
            "constraint_rows": problem.rows().len(),
            "ellipsoids": problem.norms().len(),
            "spectral_radius": assumption.spectral_radius,
            "setpoints": set_points.iter().map(|s| json!({
                "from_step": s.from_step,
                "admissible": s.admissible,
                "closest_state": s.closest,
                "limiting": s.limiting,
            })).collect::<Vec<_>>(),
        }));
    }
    let mut text = headline(problem) + "\n";
    let _ = writeln!(
        text,
        "  (A, B) is stabilizable; Q, R, O are positive definite; the origin is inside the constraints"
    );
    let _ = writeln!(
        text,
        "  A + B K is Schur: spectral radius {:.6}",
        assumption.spectral_radius
    );
    for s in set_points {
        let verdict = if s.admissible {
            "admissible".to_string()
        } else {
            format!(
                "not admissible; the closest equilibrium is {}, limited by {}",
                vector(&s.closest),
                s.limiting.join(", ")
            )
        };
        let _ = writeln!(text, "  set-point from step {}: {verdict}", s.from_step);
    }
    print(&text)
}

struct Checked {
    from_step: usize,
    admissible: bool,
    closest: Vec<f64>,
    limiting: Vec<String>,
}

fn set_points(
    problem: &Problem,
    steady: &SteadyStates,
    file: &mpct::ProblemFile,
) -> Result<Vec<Checked>, Failure> {
    let Some(simulation) = file
        .simulation
        .as_ref()
        .filter(|_| problem.task() == Task::Tracking)
    else {
        return Ok(Vec::new());
    };
    simulation
        .set_points
        .iter()
        .map(|s| {
            let closest = steady.closest_admissible(problem, &s.set_point)?;
            let mut limiting: Vec<String> =
                closest.limiting.iter().map(ToString::to_string).collect();
            if limiting.is_empty() && !closest.admissible {
                limiting.push("the equilibria of the plant".into());
            }
            Ok(Checked {
                from_step: s.from_step,
                admissible: closest.admissible,
                closest: closest.state,
                limiting,
            })
        })
        .collect()
}
