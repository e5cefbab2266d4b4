//! Problem files: TOML in, TOML out.
//!
//! ```
//! let text = r#"
//! [plant]
//! A = [[1.0, 1.0], [0.0, 1.0]]
//! B = [[0.0, 0.5], [1.0, 0.5]]
//! [constraints]
//! state_lower = [-3.0, -3.0]
//! state_upper = [3.0, 3.0]
//! input_lower = [-2.0, -2.0]
//! input_upper = [2.0, 2.0]
//! [weights]
//! Q = 10.0
//! R = 100.0
//! O = 1e4
//! "#;
//! let file = mpct::ProblemFile::parse(text, std::path::Path::new("."))?;
//! assert_eq!(file.problem.plant().states(), 2);
//! assert_eq!(mpct::ProblemFile::parse(&file.to_toml(), std::path::Path::new("."))?, file);
//! # Ok::<(), mpct::FileError>(())
//! ```

mod csv;
mod ellipsoid;
mod error;
mod locate;
mod reader;
mod text;
mod writer;

pub use error::FileError;
pub use text::{CSV_SIZE_LIMIT, SIZE_LIMIT};

use super::{
    Constraints, Formulation, Labels, NoTerminalConstraint, Plant, Problem, Task, TerminalCost,
    Weights,
};
use crate::control::SetPoint;
use crate::matrix::SparseMatrix;
use crate::simulation::{Disturbance, ScheduledSetPoint, Simulation};
use reader::Section;
use std::path::Path;

/// A problem and, when the file has a `[simulation]`, what to simulate.
#[derive(Clone, Debug, PartialEq)]
pub struct ProblemFile {
    /// The problem.
    pub problem: Problem,
    /// The simulation.
    pub simulation: Option<Simulation>,
}

impl ProblemFile {
    /// Reads a problem file. Files that it names are looked up relative to it.
    ///
    /// # Errors
    /// Every variant of [`FileError`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text = text::read(path, SIZE_LIMIT)?;
        Self::parse(&text, path.parent().unwrap_or(Path::new(".")))
    }

    /// Parses the text of a problem file; `folder` is where files that it names are looked up.
    ///
    /// # Errors
    /// Every variant of [`FileError`].
    pub fn parse(text: &str, folder: &Path) -> Result<Self, FileError> {
        let table: toml::Table = text.parse().map_err(|e: toml::de::Error| {
            let (line, column) = locate::position(text, e.span().map_or(0, |s| s.start));
            FileError::Syntax {
                line,
                column,
                message: e.message().trim().replace('\n', ", "),
            }
        })?;
        Self::from_table(&table, folder).map_err(|e| e.with_line(|key| locate::line_of(text, key)))
    }

    fn from_table(table: &toml::Table, folder: &Path) -> Result<Self, FileError> {
        let root = Section::root(table, folder);
        root.only(&[
            "name",
            "plant",
            "constraints",
            "weights",
            "controller",
            "simulation",
        ])?;
        let problem = problem(&root)?;
        let simulation = match root.section("simulation")? {
            Some(section) => Some(simulation(&section, &problem)?),
            None => None,
        };
        Ok(Self {
            problem,
            simulation,
        })
    }

    /// The text of a self-contained problem file that parses to the same.
    pub fn to_toml(&self) -> String {
        writer::write(self)
    }
}

fn problem(root: &Section<'_>) -> Result<Problem, FileError> {
    let plant = plant(&root.need_section("plant", "the plant, with A and B")?)?;
    let (n, m) = (plant.states(), plant.inputs());
    let constraints = constraints(
        &root.need_section("constraints", "bounds on states and inputs")?,
        n,
        m,
    )?;
    let section = root.need_section("weights", "the weights Q, R and O")?;
    section.only(&["Q", "R", "O", "O_input"])?;
    let mut weights = Weights::new(
        section.need_weight("Q", "weight of the states in the stage cost")?,
        section.need_weight("R", "weight of the inputs in the stage cost")?,
        section.need_weight("O", "weight of the offset cost")?,
    );
    weights.offset_input = section.weight("O_input")?;
    let mut problem = Problem::new(plant, constraints, weights)?;
    if let Some(name) = root.text("name")? {
        problem = problem.with_name(name);
    }
    let Some(section) = root.section("controller")? else {
        return Ok(problem);
    };
    section.only(&[
        "task",
        "formulation",
        "horizon_extension",
        "gamma",
        "alpha",
        "terminal_cost",
        "prediction_horizon",
        "scaling",
        "gain",
    ])?;
    let tasks = [
        ("tracking", Task::Tracking),
        ("regulation", Task::Regulation),
    ];
    if let Some(task) = section.choice("task", &tasks)? {
        problem = problem.with_task(task);
    }
    let formulations = [
        ("implicit", Formulation::Implicit),
        ("explicit", Formulation::Explicit),
        ("no_terminal_constraint", Formulation::NoTerminalConstraint),
    ];
    if let Some(formulation) = section.choice("formulation", &formulations)? {
        problem = problem.with_formulation(formulation);
    }
    let section_3_5 = [
        section.whole("horizon_extension")?.map(|v| v as f64),
        section.number("gamma")?,
        section.number("alpha")?,
    ];
    if problem.formulation() == Formulation::NoTerminalConstraint {
        let steps = section.need_whole(
            "horizon_extension",
            "the steps of the terminal law after the prediction horizon, fewer than the terminal horizon",
        )?;
        let mut choices = NoTerminalConstraint::new(steps, section_3_5[1].unwrap_or(1.0))?;
        if let Some(alpha) = section_3_5[2] {
            choices = choices.with_alpha(alpha)?;
        }
        problem = problem.with_no_terminal_constraint(choices);
    } else if let Some(k) = section_3_5.iter().position(Option::is_some) {
        return Err(FileError::WrongType {
            key: section.key(["horizon_extension", "gamma", "alpha"][k]),
            expected: "formulation = \"no_terminal_constraint\" beside it".into(),
            found: "another formulation".into(),
            line: None,
        });
    }
    let costs = [
        ("exact", TerminalCost::Exact),
        ("implicit", TerminalCost::Implicit),
    ];
    if let Some(cost) = section.choice("terminal_cost", &costs)? {
        problem = problem.with_terminal_cost(cost);
    }
    if let Some(steps) = section.whole("prediction_horizon")? {
        problem = problem.with_prediction_horizon(steps)?;
    }
    if let Some(scaling) = section.number("scaling")? {
        problem = problem.with_scaling(scaling)?;
    }
    if let Some(gain) = section.matrix("gain")? {
        problem = problem.with_gain(gain.to_dense())?;
    }
    Ok(problem)
}

fn plant(section: &Section<'_>) -> Result<Plant, FileError> {
    section.only(&[
        "A",
        "B",
        "continuous",
        "sampling_time",
        "operating_point",
        "state_names",
        "state_units",
        "input_names",
        "input_units",
    ])?;
    let a = section.need_matrix("A", "the matrix A of x+ = A x + B u, n x n")?;
    let b = section.need_matrix("B", "the matrix B of x+ = A x + B u, n x m")?;
    let sampling_time = section.number("sampling_time")?;
    let mut plant = if section.flag("continuous")?.unwrap_or(false) {
        let time = sampling_time.ok_or_else(|| FileError::MissingKey {
            key: section.key("sampling_time"),
            meaning: "the sampling time in seconds, needed because the plant is continuous".into(),
        })?;
        Plant::continuous(a, b, time)?
    } else {
        let plant = Plant::discrete(a, b)?;
        match sampling_time {
            Some(time) => plant.with_sampling_time(time)?,
            None => plant,
        }
    };
    if let Some(at) = section.section("operating_point")? {
        at.only(&["state", "input"])?;
        let (n, m) = (plant.states(), plant.inputs());
        let state = at.vector("state")?.unwrap_or_else(|| vec![0.0; n]);
        let input = at.vector("input")?.unwrap_or_else(|| vec![0.0; m]);
        plant = plant.with_operating_point(state, input)?;
    }
    let texts = |name: &str| Ok::<_, FileError>(section.texts(name)?.unwrap_or_default());
    Ok(plant.with_labels(Labels {
        state_names: texts("state_names")?,
        state_units: texts("state_units")?,
        input_names: texts("input_names")?,
        input_units: texts("input_units")?,
    })?)
}

fn constraints(section: &Section<'_>, n: usize, m: usize) -> Result<Constraints, FileError> {
    section.only(&[
        "state_lower",
        "state_upper",
        "input_lower",
        "input_upper",
        "mixed",
        "ellipsoid",
    ])?;
    let side = |name: &str, len: usize, free: f64| -> Result<Vec<f64>, FileError> {
        Ok(section.vector(name)?.unwrap_or_else(|| vec![free; len]))
    };
    let (inf, neg) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut constraints = Constraints::new(n, m)
        .state_bounds(&side("state_lower", n, neg)?, &side("state_upper", n, inf)?)?
        .input_bounds(&side("input_lower", m, neg)?, &side("input_upper", m, inf)?)?;
    for mixed in section.sections("mixed")? {
        mixed.only(&["C", "D", "d"])?;
        let d = mixed.need_vector("d", "the right-hand sides of C x + D u <= d")?;
        let c_matrix = mixed.matrix("C")?;
        let d_matrix = mixed.matrix("D")?;
        if c_matrix.is_none() && d_matrix.is_none() {
            mixed.need_matrix("C", "the coefficients of the states in C x + D u <= d")?;
        }
        constraints = constraints.mixed(
            c_matrix.unwrap_or_else(|| SparseMatrix::zeros(d.len(), n)),
            d_matrix.unwrap_or_else(|| SparseMatrix::zeros(d.len(), m)),
            d,
        )?;
    }
    ellipsoid::read(section, constraints)
}

fn simulation(section: &Section<'_>, problem: &Problem) -> Result<Simulation, FileError> {
    section.only(&["initial_state", "steps", "setpoint", "disturbance"])?;
    let initial_state = match section.vector("initial_state")? {
        Some(x) => x,
        None => problem.plant().operating_point().state.clone(),
    };
    let steps = section.need_whole("steps", "the number of steps to simulate")?;
    let mut set_points = Vec::new();
    for s in section.sections("setpoint")? {
        s.only(&["from_step", "state", "input"])?;
        set_points.push(ScheduledSetPoint {
            from_step: s.whole("from_step")?.unwrap_or(0),
            set_point: SetPoint {
                state: s.need_vector("state", "the state part of the set-point")?,
                input: s.vector("input")?,
            },
        });
    }
    let disturbance = match section.section("disturbance")? {
        None => None,
        Some(d) => {
            d.only(&["bound", "seed"])?;
            Some(Disturbance {
                bound: d.need_vector("bound", "the largest disturbance of each state, >= 0")?,
                seed: d.seed("seed")?.unwrap_or(0),
            })
        }
    };
    let simulation = Simulation {
        initial_state,
        steps,
        set_points,
        disturbance,
    };
    simulation.check(problem.plant().states(), problem.plant().inputs())?;
    Ok(simulation)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROBLEM: &str = r#"
        [plant]
        A = [[0.5]]
        B = [[1.0]]
        state_names = ["level \"1\""]
        state_units = ["m"]
        input_names = ["pump"]
        [constraints]
        state_lower = [-1.0]
        state_upper = [1.0]
        [weights]
        Q = 1.0
        R = 1.0
        O = 1.0
    "#;

    #[test]
    fn labels_are_read_and_written() {
        let file = ProblemFile::parse(PROBLEM, Path::new(".")).unwrap();
        let labels = file.problem.plant().labels();
        assert_eq!(labels.state_names, ["level \"1\""]);
        assert!(labels.input_units.is_empty());
        assert_eq!(
            ProblemFile::parse(&file.to_toml(), Path::new(".")).unwrap(),
            file
        );
    }

    #[test]
    fn labels_of_wrong_length_or_kind_are_refused() {
        for (from, to, part) in [
            (r#"["m"]"#, r#"["m", "s"]"#, "plant.state_units: expected 1"),
            (r#"["m"]"#, "[1]", "plant.state_units[0]"),
            (r#"["m"]"#, r#""m""#, "a list of texts"),
        ] {
            let text = PROBLEM.replace(from, to);
            let error = ProblemFile::parse(&text, Path::new(".")).unwrap_err();
            assert!(error.to_string().contains(part), "{error}");
        }
    }
}
