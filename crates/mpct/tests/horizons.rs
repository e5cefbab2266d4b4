//! Terminal horizons against the published tables and against the reference.

mod support;

use mpct::{Condition, DesignOptions, Problem, Task, TerminalIngredients};
use support::cases::{self, ACADEMIC, DRONE, SCALINGS};
use support::random;
use support::reference::{Form, Reference, Terminal, Writing};

fn design(problem: &Problem, condition: Condition) -> TerminalIngredients {
    let options = DesignOptions {
        condition,
        ..DesignOptions::default()
    };
    TerminalIngredients::design(problem, &options)
        .unwrap_or_else(|e| panic!("{}: {e}", problem.name()))
}

fn horizons(problem: &Problem) -> (usize, usize) {
    (
        design(problem, Condition::Exact).terminal_horizon(),
        design(problem, Condition::Sufficient).terminal_horizon(),
    )
}

fn terminal(ingredients: &TerminalIngredients) -> Terminal {
    let reference = Reference::new(ingredients);
    match ingredients.problem().task() {
        Task::Tracking => reference.tracking(),
        Task::Regulation => reference.regulation(),
    }
}

#[test]
fn academic_horizons_are_the_published_ones() {
    let found = SCALINGS.map(|scaling| horizons(&cases::academic(scaling)));
    assert_eq!(found, ACADEMIC);
}

#[test]
fn drone_horizons_are_the_published_ones() {
    let found = SCALINGS.map(|scaling| horizons(&cases::drone(scaling)));
    assert_eq!(found, DRONE);
}

#[test]
fn carts_have_13_whatever_their_number() {
    for count in [3, 5, 10] {
        let ingredients = design(&cases::carts(count, 0.9), Condition::Exact);
        assert_eq!(ingredients.terminal_horizon(), 13, "{count} carts");
    }
}

#[test]
#[ignore = "slow: 15 and 25 carts"]
fn many_carts_have_13_too() {
    for count in [15, 25] {
        let ingredients = design(&cases::carts(count, 0.9), Condition::Exact);
        assert_eq!(ingredients.terminal_horizon(), 13, "{count} carts");
    }
}

/// Plants whose constraints of step 0 leave a direction free that later steps bound. The supports of the second form are
/// infinite there as long as a row has any part in that direction, which decays but never ends: where it counts as zero is
/// a matter of tolerance, and two tolerances give two numbers. Found among seeds 0 to 199.
const UNBOUNDED_AT_STEP_0: [&str; 1] = ["random 46"];

/// Both forms and each row's first spent step; every disagreement in words.
fn disagreements(problem: &Problem) -> Vec<String> {
    let name = format!("{} ({:?})", problem.name(), problem.task());
    let mut found = Vec::new();
    let mut try_design = |condition| {
        let options = DesignOptions {
            condition,
            ..DesignOptions::default()
        };
        TerminalIngredients::design(problem, &options)
            .map_err(|e| found.push(format!("{name}, {condition}: {e}")))
            .ok()
    };
    let exact = try_design(Condition::Exact);
    let sufficient = try_design(Condition::Sufficient);
    if let Some(exact) = &exact {
        let terminal = terminal(exact);
        let first = terminal.horizon(Form::First, Writing::Plain, 3000);
        if exact.terminal_horizon() != first {
            let ours = exact.terminal_horizon();
            found.push(format!("{name}, first form: {ours}, reference {first}"));
        }
        let (spent, margin) = terminal.spent_steps(3000);
        let ours: Vec<usize> = exact.spent_steps().iter().map(|s| s.1).collect();
        if ours != spent {
            found.push(format!(
                "{name}, first spent steps: {ours:?}, reference {spent:?}, nearest support {margin:.1e} from 1"
            ));
        }
        // M = max over rows of the first spent step, less one, and at least 1.
        let last = spent.iter().copied().max().unwrap_or(1);
        if first != (last - 1).max(1) {
            found.push(format!(
                "{name}: horizon {first} and last spent step {last}"
            ));
        }
    }
    if let Some(sufficient) = &sufficient {
        let second = terminal(sufficient).horizon(Form::Second, Writing::Plain, 3000);
        if sufficient.terminal_horizon() != second && !UNBOUNDED_AT_STEP_0.contains(&problem.name())
        {
            let ours = sufficient.terminal_horizon();
            found.push(format!("{name}, second form: {ours}, reference {second}"));
        }
    }
    found
}

fn assert_as_reference(problems: impl IntoIterator<Item = Problem>) {
    let found: Vec<String> = problems
        .into_iter()
        .flat_map(|problem| disagreements(&problem))
        .collect();
    assert!(
        found.is_empty(),
        "{} disagreements:\n{}",
        found.len(),
        found.join("\n")
    );
}

fn both_tasks(seeds: std::ops::Range<u64>) -> impl Iterator<Item = Problem> {
    seeds.map(random::problem).flat_map(|problem| {
        let regulation = problem.clone().with_task(Task::Regulation);
        [problem, regulation]
    })
}

#[test]
fn random_plants_agree_with_the_reference() {
    assert_as_reference(both_tasks(0..20));
}

#[test]
#[ignore = "slow: 200 random plants, two tasks, all rows by linear programs"]
fn two_hundred_random_plants_agree_with_the_reference() {
    assert_as_reference(both_tasks(0..200));
}

#[test]
fn academic_agrees_with_the_reference_for_every_scaling() {
    assert_as_reference(SCALINGS.map(cases::academic));
    assert_as_reference([cases::academic(0.9).with_task(Task::Regulation)]);
}

/// The linear programs as the paper prints them, with every x_j as a variable, against the plain ones.
#[test]
fn lifted_and_plain_programs_agree() {
    let mut problems: Vec<Problem> = (0..4).map(random::problem).collect();
    problems.push(cases::academic(0.9));
    problems.push(cases::carts(3, 0.9));
    for problem in problems {
        let ingredients = design(&problem, Condition::Exact);
        let terminal = terminal(&ingredients);
        let horizon = ingredients.terminal_horizon();
        let rows: Vec<usize> = (0..terminal.rows.len()).collect();
        for form in [Form::First, Form::Second] {
            let plain = terminal.condition(horizon, &rows, form, Writing::Plain);
            let lifted = terminal.condition(horizon, &rows, form, Writing::Lifted);
            for (i, (p, l)) in plain.iter().zip(&lifted).enumerate() {
                assert!(
                    p == l || (p - l).abs() <= 1e-7 * (1.0 + p.abs()),
                    "{}, {form:?}, row {i}: {p} and {l}",
                    problem.name()
                );
            }
        }
    }
}

#[test]
#[ignore = "slow: the reference counts the drone's horizons up, eight times in two forms"]
fn drone_reference_gives_the_published_horizons() {
    for (scaling, expected) in SCALINGS.into_iter().zip(DRONE) {
        let ingredients = design(&cases::drone(scaling), Condition::Exact);
        let terminal = terminal(&ingredients);
        let first = terminal.horizon(Form::First, Writing::Plain, 400);
        let second = terminal.horizon(Form::Second, Writing::Plain, 400);
        assert_eq!((first, second), expected, "λ = {scaling}");
    }
}

#[test]
#[ignore = "slow: every row of the drone and of 5 carts, step by step"]
fn spent_steps_of_the_cases_agree_with_the_reference() {
    assert_as_reference([cases::carts(5, 0.9), cases::drone(0.59)]);
}
