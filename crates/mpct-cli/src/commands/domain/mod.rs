//! `mpct domain`: which states a controller attracts. Membership with its proof, reach, outlines, volumes, a picture.

mod sets;
mod tell;

use crate::arguments::{Domain, Set};
use crate::commands::{design_with_progress, first_set_point, headline, read};
use crate::failure::{Class, Failure};
use crate::output::{OutputFile, print, print_json};
use mpct::analysis::{DomainOfAttraction, LARGEST_DIMENSION, StabilityRegion};
use mpct::{Controller, DesignError, Formulation, Problem, SetPoint, Task};
use mpct_report::{Format, Signal, problem_signals};
use serde_json::{Value, json};
use sets::{Asked, Questions, Told, View, answer};
use tell::{as_json, as_text, draw};

/// Up to this many states the reach along every axis is told when nothing else is asked.
const AXES: usize = 12;

pub fn run(arguments: &Domain) -> Result<(), Failure> {
    let file = read(&arguments.file)?;
    let in_file = |e: DesignError| Failure::from(e).in_file(&arguments.file);
    let (signals, _) = problem_signals(&file.problem);
    let questions = questions(arguments, &file.problem, &signals)?;
    let picture = match &arguments.picture {
        Some(path) => {
            let format = Format::of(path).map_err(|m| Failure::new(Class::Input, m))?;
            let output = OutputFile::open(path)?;
            OutputFile::all_apart(&arguments.file, [&output])?;
            Some((output, format))
        }
        None => None,
    };
    let set_point = match &arguments.set_point {
        Some(stated) => SetPoint::state(stated.0.clone()),
        None => first_set_point(&file),
    };
    let sets = if arguments.set.is_empty() {
        vec![match file.problem.formulation() {
            Formulation::Implicit => Set::Implicit,
            Formulation::Explicit => Set::Explicit,
            Formulation::NoTerminalConstraint => Set::StabilityRegion,
        }]
    } else {
        arguments.set.clone()
    };
    let mut told = Vec::new();
    for set in sets {
        let controller = controller(set, &file.problem, arguments)?;
        let region = if set == Set::StabilityRegion {
            let scope = arguments.scope.into();
            Some(StabilityRegion::of(&controller, &set_point, scope).map_err(in_file)?)
        } else {
            None
        };
        let asked = Asked {
            feasible: DomainOfAttraction::of(&controller),
            region,
        };
        told.push(answer(set, &asked, &questions).map_err(in_file)?);
    }
    if let Some((output, format)) = picture {
        let svg = draw(&told, &questions, &file.problem, &signals, &set_point);
        let bytes = format
            .encode(&svg)
            .map_err(|m| Failure::new(Class::Io, format!("cannot draw the picture: {m}")))?;
        output.write(&bytes)?;
    }
    if arguments.json {
        let sets: Vec<Value> = told.iter().map(as_json).collect();
        print_json(&json!({ "name": file.problem.name(), "sets": sets }))?;
    } else {
        let mut text = headline(&file.problem) + "\n";
        for set in &told {
            as_text(&mut text, set, &signals);
        }
        print(&text)?;
    }
    outside(&told)
}

/// Exit code 5 when a state is outside.
fn outside(told: &[Told]) -> Result<(), Failure> {
    let asked: usize = told.iter().map(|t| t.states.len()).sum();
    let out: Vec<&str> = told
        .iter()
        .flat_map(|t| t.states.iter().map(move |s| (t, &s.1)))
        .filter(|(_, a)| !a.is_inside())
        .map(|(t, _)| t.set)
        .collect();
    match out.first() {
        None => Ok(()),
        Some(first) => Err(Failure::new(
            Class::Infeasible,
            format!(
                "outside, with proof, in {} of {asked} answers (the first for the set \"{first}\")",
                out.len()
            ),
        )),
    }
}

fn questions(
    arguments: &Domain,
    problem: &Problem,
    signals: &[Signal],
) -> Result<Questions, Failure> {
    let n = problem.plant().states();
    let numbers = |list: &[crate::arguments::Numbers]| list.iter().map(|s| s.0.clone()).collect();
    let mut view = match (&arguments.outline, &arguments.section) {
        (Some(text), _) => {
            let (i, j) = coordinates("--outline", text, signals)?;
            Some(View::Projection(i, j))
        }
        (_, Some(text)) => {
            let (i, j) = coordinates("--section", text, signals)?;
            Some(View::Section(i, j))
        }
        _ => None,
    };
    if arguments.picture.is_some() && view.is_none() {
        if n != 2 {
            return Err(Failure::new(
                Class::Input,
                format!("--picture shows two states, and the plant has {n}"),
            )
            .help(format!(
                "choose them with --outline or --section, e.g. --outline {},{}",
                signals[0].name,
                signals.get(1).map_or("0", |s| s.name.as_str())
            )));
        }
        view = Some(View::Projection(0, 1));
    }
    let mut asked = Questions {
        states: numbers(&arguments.state),
        directions: numbers(&arguments.direction),
        from: arguments.from.as_ref().map(|f| f.0.clone()),
        view,
        volume: arguments.volume,
    };
    let nothing = asked.states.is_empty()
        && asked.directions.is_empty()
        && asked.view.is_none()
        && !asked.volume;
    if nothing {
        if n > AXES {
            return Err(Failure::new(
                Class::Input,
                format!(
                    "nothing is asked, and {n} states are too many for the reach along every axis"
                ),
            )
            .help("ask with --state, --direction, --outline or --section"));
        }
        asked.volume = n <= LARGEST_DIMENSION;
        for i in 0..n {
            for sign in [1.0, -1.0] {
                let mut v = vec![0.0; n];
                v[i] = sign;
                asked.directions.push(v);
            }
        }
    }
    Ok(asked)
}

/// Two states by name or number.
fn coordinates(option: &str, text: &str, signals: &[Signal]) -> Result<(usize, usize), Failure> {
    let find = |word: &str| {
        let word = word.trim();
        signals
            .iter()
            .position(|s| s.name == word)
            .or_else(|| word.parse().ok())
    };
    let found: Option<Vec<usize>> = text.split(',').map(find).collect();
    match found.as_deref() {
        Some(&[i, j]) => Ok((i, j)),
        _ => {
            let known: Vec<&str> = signals.iter().take(20).map(|s| s.name.as_str()).collect();
            Err(Failure::new(
                Class::Input,
                format!("{option} {text}: expected two states, by name or counted from 0"),
            )
            .help(format!("the states are {}", known.join(", "))))
        }
    }
}

fn controller(set: Set, problem: &Problem, arguments: &Domain) -> Result<Controller, Failure> {
    let (problem, formulation) = match set {
        Set::Implicit => (problem.clone(), Formulation::Implicit),
        Set::Explicit => (problem.clone(), Formulation::Explicit),
        Set::Regulation => (
            problem.clone().with_task(Task::Regulation),
            Formulation::Implicit,
        ),
        Set::StabilityRegion | Set::NoTerminalConstraint => {
            (problem.clone(), Formulation::NoTerminalConstraint)
        }
    };
    let problem = problem.with_formulation(formulation);
    let ingredients = design_with_progress(&problem, &arguments.limits)
        .map_err(|f| f.in_file(&arguments.file))?;
    Controller::with_formulation(ingredients, formulation)
        .map_err(|e| Failure::from(e).in_file(&arguments.file))
}
