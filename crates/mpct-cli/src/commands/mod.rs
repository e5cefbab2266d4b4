//! One file a subcommand.

pub mod check;
pub mod compare;
pub mod design;
pub mod domain;
pub mod example;
pub mod reproduce;
pub mod scaling;
pub mod simulate;
pub mod sweep;
pub mod verify;

use crate::arguments::Limits;
use crate::failure::Failure;
use crate::interrupt::Search;
use crate::output::Waiting;
use mpct::{
    DesignOptions, Problem, ProblemFile, Progress, SetPoint, SparseMatrix, TerminalIngredients,
};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

/// Reads a problem file; messages name it.
pub fn read(path: &Path) -> Result<ProblemFile, Failure> {
    ProblemFile::read(path).map_err(|e| Failure::from(e).in_file(path))
}

/// Designs with a progress bar. Ctrl-C ends it with what is known.
pub fn design_with_progress(
    problem: &Problem,
    limits: &Limits,
) -> Result<TerminalIngredients, Failure> {
    with_progress(limits, |options| {
        Ok(TerminalIngredients::design(problem, options)?)
    })
}

/// Runs a search with a progress bar.
pub fn with_progress<T>(limits: &Limits, work: impl FnOnce(&DesignOptions<'_>) -> T) -> T {
    let _search = Search::begin();
    let waiting = Waiting::new("terminal horizon, rows", Some(0));
    let progress = |p: &Progress| {
        if p.rows_total > 0 {
            waiting.total(p.rows_total as u64);
        }
        let row = p
            .row
            .map_or("K and P, ".into(), |r| format!("{r} at step {}, ", p.step));
        let message = format!("{row}horizon at least {}", p.terminal_horizon_at_least);
        waiting.at(p.rows_done as u64, message);
        if Search::is_asked_to_end() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    work(&DesignOptions {
        condition: limits.condition.into(),
        max_horizon: limits.max_horizon,
        time_limit: limits.time_limit.map(Duration::from_secs_f64),
        progress: Some(&progress),
    })
}

/// The first set-point of a file, or its operating point.
pub fn first_set_point(file: &ProblemFile) -> SetPoint {
    let stated = file
        .simulation
        .as_ref()
        .and_then(|s| s.set_points.first())
        .map(|s| s.set_point.clone());
    let home = || SetPoint::state(file.problem.plant().operating_point().state.clone());
    stated.unwrap_or_else(home)
}

/// With more entries than this, zeros included, a matrix is written sparse: a full one of 20 000 x 20 000 takes 24 GB.
const FULL_UP_TO: usize = 1_000_000;

/// A matrix as a list of rows, for JSON; a large one as sparse matrices stand in problem files.
pub fn rows(m: &SparseMatrix) -> serde_json::Value {
    if m.rows().saturating_mul(m.cols()) <= FULL_UP_TO {
        return serde_json::json!(m.to_dense());
    }
    serde_json::json!({
        "shape": [m.rows(), m.cols()],
        "entries": m.entries().collect::<Vec<_>>(),
    })
}

/// What a problem is, in one line.
pub fn headline(problem: &Problem) -> String {
    let name = if problem.name().is_empty() {
        "problem"
    } else {
        problem.name()
    };
    let plant = problem.plant();
    let time = plant
        .sampling_time()
        .map_or(String::new(), |t| format!(", sampled every {t} s"));
    format!(
        "{name}: {} states, {} inputs, {} constraint rows{}{time}",
        plant.states(),
        plant.inputs(),
        problem.rows().len(),
        ellipsoids(problem.norms().len())
    )
}

/// ", 2 ellipsoids"; nothing without one.
fn ellipsoids(count: usize) -> String {
    match count {
        0 => String::new(),
        1 => ", 1 ellipsoid".into(),
        _ => format!(", {count} ellipsoids"),
    }
}

/// A duration for people.
pub fn duration(seconds: f64) -> String {
    if seconds < 1e-3 {
        format!("{:.1} us", 1e6 * seconds)
    } else if seconds < 1.0 {
        format!("{:.2} ms", 1e3 * seconds)
    } else {
        format!("{seconds:.2} s")
    }
}

/// A short vector for people; long ones are cut.
pub fn vector(v: &[f64]) -> String {
    // Adding zero turns -0 into 0.
    let items: Vec<String> = v
        .iter()
        .take(12)
        .map(|x| format!("{:.6}", x + 0.0))
        .collect();
    let items: Vec<&str> = items
        .iter()
        .map(|s| s.trim_end_matches('0').trim_end_matches('.'))
        .map(|s| if s == "-0" { "0" } else { s })
        .collect();
    let more = if v.len() > 12 {
        format!(", … ({} in all)", v.len())
    } else {
        String::new()
    };
    format!("[{}{more}]", items.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_matrices_are_written_sparse() {
        let full = rows(&SparseMatrix::identity(2));
        assert_eq!(full, serde_json::json!([[1.0, 0.0], [0.0, 1.0]]));
        let sparse = rows(&SparseMatrix::identity(1001));
        assert_eq!(sparse["shape"], serde_json::json!([1001, 1001]));
        assert_eq!(sparse["entries"].as_array().map(Vec::len), Some(1001));
        assert_eq!(sparse["entries"][7], serde_json::json!([7, 7, 1.0]));
    }
}
