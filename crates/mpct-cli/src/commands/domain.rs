//! `mpct domain`: which states a controller attracts. Membership with its proof, reach, outlines, volumes, a picture.

use crate::arguments::{Domain, Set};
use crate::commands::{design_with_progress, headline, read, vector};
use crate::failure::{Class, Failure};
use crate::output::{OutputFile, print, print_json};
use mpct_report::{Format, Mark, Plane, Signal, Stroke, problem_signals};
use mpct::analysis::{
    Attraction, DomainOfAttraction, LARGEST_DIMENSION, Membership, Polygon, Reach, StabilityRegion,
    Volume,
};
use mpct::{Controller, DesignError, Formulation, Problem, ProblemFile, SetPoint, Task};
use serde_json::{Value, json};
use std::fmt::Write;

/// Up to this many states the reach along every axis is told when nothing else is asked.
const AXES: usize = 12;
/// Rows of a proof that are told.
const ROWS: usize = 4;

/// A set of states, ready for questions.
enum Asked<'a> {
    Domain(DomainOfAttraction),
    /// With the set of feasible states, which proves infeasibility.
    Region(StabilityRegion<'a>, DomainOfAttraction),
}

/// Whether a state is inside, with what proves it.
enum Answer {
    Domain(Membership),
    Region(Attraction),
    /// (35) has no feasible point at the state.
    Infeasible(Membership),
}

/// A plane of two states, and whether it is projected on or cut along.
#[derive(Clone, Copy)]
enum View {
    Projection(usize, usize),
    Section(usize, usize),
}

/// What is asked of every set.
struct Questions {
    states: Vec<Vec<f64>>,
    directions: Vec<Vec<f64>>,
    from: Option<Vec<f64>>,
    view: Option<View>,
    volume: bool,
}

/// The answers about one set.
struct Told {
    set: &'static str,
    what: String,
    states: Vec<(Vec<f64>, Answer)>,
    reach: Vec<(Vec<f64>, Reach)>,
    outline: Option<Polygon>,
    volume: Option<Volume>,
}

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
    let set_point = set_point(arguments, &file);
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
        let asked = match set {
            Set::StabilityRegion => Asked::Region(
                StabilityRegion::of(&controller, &set_point, arguments.scope.into())
                    .map_err(in_file)?,
                DomainOfAttraction::of(&controller),
            ),
            _ => Asked::Domain(DomainOfAttraction::of(&controller)),
        };
        told.push(answer(set, &asked, &questions).map_err(in_file)?);
    }
    if let Some((output, format)) = picture {
        let svg = draw(
            &told,
            &questions,
            arguments,
            &file.problem,
            &signals,
            &set_point,
        );
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
            as_text(&mut text, set);
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

fn set_point(arguments: &Domain, file: &ProblemFile) -> SetPoint {
    let first = file
        .simulation
        .as_ref()
        .and_then(|s| s.set_points.first())
        .map(|s| s.set_point.clone());
    match (&arguments.set_point, first) {
        (Some(stated), _) => SetPoint::state(stated.0.clone()),
        (None, Some(first)) => first,
        (None, None) => SetPoint::state(file.problem.plant().operating_point().state.clone()),
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

impl Answer {
    fn is_inside(&self) -> bool {
        match self {
            Self::Domain(m) => m.is_inside(),
            Self::Region(a) => a.is_inside(),
            Self::Infeasible(_) => false,
        }
    }
}

impl Asked<'_> {
    fn contains(&self, state: &[f64]) -> Result<Answer, DesignError> {
        match self {
            Self::Domain(d) => d.contains(state).map(Answer::Domain),
            Self::Region(r, feasible) => {
                let found = r.contains(state)?;
                if found.cost.is_finite() {
                    return Ok(Answer::Region(found));
                }
                feasible.contains(state).map(Answer::Infeasible)
            }
        }
    }

    fn reach(&self, from: Option<&[f64]>, direction: &[f64]) -> Result<Reach, DesignError> {
        match (self, from) {
            (Self::Domain(d), None) => d.reach(direction),
            (Self::Domain(d), Some(x)) => d.reach_from(x, direction),
            (Self::Region(r, _), None) => r.reach(direction),
            (Self::Region(r, _), Some(x)) => r.reach_from(x, direction),
        }
    }

    fn view(&self, view: View, from: Option<&[f64]>) -> Result<Polygon, DesignError> {
        match (self, view) {
            (Self::Domain(d), View::Projection(i, j)) => d.projection((i, j)),
            (Self::Domain(d), View::Section(i, j)) => match from {
                Some(x) => d.section(x, (i, j)),
                None => d.section(d.origin(), (i, j)),
            },
            (Self::Region(r, _), View::Projection(i, j)) => r.projection((i, j)),
            (Self::Region(r, _), View::Section(i, j)) => r.section((i, j)),
        }
    }

    fn volume(&self) -> Result<Volume, DesignError> {
        match self {
            Self::Domain(d) => d.volume(),
            Self::Region(r, _) => r.volume(),
        }
    }
}

fn answer(set: Set, asked: &Asked<'_>, questions: &Questions) -> Result<Told, DesignError> {
    let (name, what) = match set {
        Set::Implicit => ("implicit", "domain of attraction, implicit (30)"),
        Set::Explicit => ("explicit", "domain of attraction, explicit (9)"),
        Set::Regulation => ("regulation", "domain of attraction of regulation (3.1)"),
        Set::NoTerminalConstraint => (
            "no_terminal_constraint",
            "states at which (35) is feasible; what is attracted is the stability region",
        ),
        Set::StabilityRegion => ("stability_region", "stability region (section 3.5)"),
    };
    let what = match asked {
        Asked::Region(r, _) => format!(
            "{what}: alpha = {:.6} for {}, d = {:.6}, level {:.6e}",
            r.alpha(),
            r.scope(),
            r.stage_cost_bound(),
            r.level()
        ),
        Asked::Domain(_) => what.into(),
    };
    let from = questions.from.as_deref();
    let mut told = Told {
        set: name,
        what,
        states: Vec::new(),
        reach: Vec::new(),
        outline: None,
        volume: None,
    };
    for state in &questions.states {
        told.states.push((state.clone(), asked.contains(state)?));
    }
    for direction in &questions.directions {
        told.reach
            .push((direction.clone(), asked.reach(from, direction)?));
    }
    if let Some(view) = questions.view {
        told.outline = Some(asked.view(view, from)?);
    }
    if questions.volume {
        told.volume = Some(asked.volume()?);
    }
    Ok(told)
}

fn as_json(told: &Told) -> Value {
    let states: Vec<Value> = told
        .states
        .iter()
        .map(|(state, answer)| {
            let proof = match answer {
                Answer::Domain(m) | Answer::Infeasible(m) => json!(m),
                Answer::Region(a) => json!(a),
            };
            json!({ "state": state, "inside": answer.is_inside(), "proof": proof })
        })
        .collect();
    let reach: Vec<Value> = told
        .reach
        .iter()
        .map(|(direction, r)| json!({ "direction": direction, "distance": r.distance, "at_most": r.at_most, "state": r.state }))
        .collect();
    json!({
        "set": told.set,
        "states": states,
        "reach": reach,
        "outline": told.outline.as_ref().map(|p| json!({
            "coordinates": p.coordinates, "vertices": p.vertices, "area": p.area(), "gap": p.gap, "queries": p.queries,
        })),
        "volume": told.volume,
    })
}

fn as_text(text: &mut String, told: &Told) {
    let _ = writeln!(text, "{}", told.what);
    for (state, answer) in &told.states {
        let _ = writeln!(text, "  state {}: {}", vector(state), proof(answer));
    }
    for (direction, reach) in &told.reach {
        let _ = writeln!(
            text,
            "  along {}: {:.6} times (proved: at most {:.6}), up to {}",
            vector(direction),
            reach.distance,
            reach.at_most,
            vector(&reach.state)
        );
    }
    if let Some(p) = &told.outline {
        let _ = writeln!(
            text,
            "  outline in states {} and {}: {} vertices, area {:.6}; the set reaches at most {:.1e} of its half-widths beyond it",
            p.coordinates.0,
            p.coordinates.1,
            p.vertices.len(),
            p.area(),
            p.gap
        );
        for v in &p.vertices {
            let _ = writeln!(text, "    {:>12.6} {:>12.6}", v[0] + 0.0, v[1] + 0.0);
        }
    }
    if let Some(v) = &told.volume {
        let name = ["length", "area", "volume"][v.dimension.clamp(1, 3) - 1];
        let _ = writeln!(
            text,
            "  {name} {:.6}; the set reaches at most {:.1e} of its half-widths beyond that hull",
            v.value, v.gap
        );
    }
}

fn proof(answer: &Answer) -> String {
    match answer {
        Answer::Domain(Membership::Inside { slack, .. })
        | Answer::Infeasible(Membership::Inside { slack, .. }) => format!(
            "inside; a candidate leaves every row {:.3e} of its room or more",
            slack.max(0.0)
        ),
        Answer::Domain(Membership::Outside { gap, rows, .. })
        | Answer::Infeasible(Membership::Outside { gap, rows, .. }) => {
            let told: Vec<String> = rows
                .iter()
                .take(ROWS)
                .map(|(row, y)| format!("{row} ({y:.3})"))
                .collect();
            let more = match rows.len().saturating_sub(ROWS) {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            let what = match answer {
                Answer::Infeasible(_) => "outside, (35) is infeasible",
                _ => "outside",
            };
            format!(
                "{what}; rows contradict each other by {gap:.3e} with the multipliers {}{more}",
                told.join(", ")
            )
        }
        Answer::Region(a) if a.is_inside() => format!(
            "inside; the optimal cost exceeds the least offset cost by {:.6e}, at most {:.6e}",
            a.cost, a.level
        ),
        Answer::Region(a) => format!(
            "outside; the optimal cost exceeds the least offset cost by {:.6e}, more than {:.6e}",
            a.cost, a.level
        ),
    }
}

fn draw(
    told: &[Told],
    questions: &Questions,
    arguments: &Domain,
    problem: &Problem,
    signals: &[Signal],
    set_point: &SetPoint,
) -> String {
    // From broad to narrow, so that lines that coincide are all seen.
    const STROKES: [Stroke; 5] = [
        Stroke::Pale,
        Stroke::Broad,
        Stroke::Dashed,
        Stroke::DashDotted,
        Stroke::Dotted,
    ];
    let (i, j) = match questions.view {
        Some(View::Projection(i, j) | View::Section(i, j)) => (i, j),
        None => (0, 1),
    };
    let states: Vec<(f64, f64)> = questions.states.iter().map(|x| (x[i], x[j])).collect();
    let mut room = states.clone();
    for t in told {
        let vertices = t.outline.iter().flat_map(|p| &p.vertices);
        room.extend(vertices.map(|v| (v[0], v[1])));
    }
    let title = |k: usize| match &signals[k].unit {
        Some(_) => signals[k].title(),
        None => format!("{} (no unit)", signals[k].name),
    };
    let mut plane = Plane::new(&title(i), &title(j), &room);
    let (lower, upper) = problem.constraints().state_limits();
    plane.forbidden_beyond((lower[i], upper[i]), (lower[j], upper[j]));
    for (t, stroke) in told.iter().zip(STROKES.into_iter().cycle()) {
        if let Some(p) = &t.outline {
            let name = t.set.replace('_', " ");
            plane.polygon(&name, &p.vertices, stroke);
        }
    }
    if !states.is_empty() {
        plane.marks("state asked for", &states, Mark::Dot);
    }
    if arguments.set.contains(&Set::StabilityRegion)
        || problem.formulation() == Formulation::NoTerminalConstraint
    {
        let at = &set_point.state;
        plane.marks("set-point", &[(at[i], at[j])], Mark::Circle);
    }
    plane.svg("outlines of sets of states")
}
