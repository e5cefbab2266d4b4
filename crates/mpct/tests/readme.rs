//! What the README says of problem files is true.

use mpct::{Controller, DesignOptions, ProblemFile, TerminalIngredients, simulate};
use std::path::Path;

const README: &str = include_str!("../../../README.md");

/// The problem file of the README.
fn example() -> String {
    let (_, rest) = README.split_once("```toml\n").expect("a TOML block");
    rest.split_once("```").expect("its end").0.to_string()
}

#[test]
fn the_example_runs_and_its_second_set_point_is_not_admissible() {
    let file = ProblemFile::parse(&example(), Path::new(".")).expect("it parses");
    let ingredients = TerminalIngredients::design(&file.problem, &DesignOptions::default())
        .expect("it has a design");
    let mut controller = Controller::new(ingredients).expect("it has a controller");
    let simulation = file.simulation.expect("it has a simulation");
    let run = simulate(&mut controller, &simulation, None).expect("it runs");
    assert!(run.steps[0].admissible);
    assert!(!run.steps[simulation.steps - 1].admissible);
    assert!(run.summary.worst_violation < 1e-8);
}

#[test]
fn every_key_of_the_table_is_known() {
    // A key that the reader does not know is named in its error; one of the table must not be.
    let (_, table) = README.split_once("### Every key").expect("the table");
    let (table, _) = table.split_once("A *matrix* is").expect("its end");
    let mut section = String::new();
    let mut seen = 0;
    for line in table.lines().filter(|l| l.starts_with("| ")) {
        let cell = line.split('|').nth(1).expect("a first cell").trim();
        let names: Vec<&str> = cell.split('`').skip(1).step_by(2).collect();
        for name in names {
            if name.starts_with('[') {
                section = name.trim_matches(['[', ']']).to_string();
                continue;
            }
            seen += 1;
            let text = match section.as_str() {
                "" => format!("{name} = 1979-05-27\n"),
                "constraints.mixed" | "simulation.setpoint" => {
                    format!("{}[[{section}]]\n{name} = 1979-05-27\n", without(&section))
                }
                _ => format!("{}[{section}]\n{name} = 1979-05-27\n", without(&section)),
            };
            let error = ProblemFile::parse(&text, Path::new("."))
                .expect_err("a date is never right")
                .to_string();
            assert!(!error.contains("unknown key"), "{name}: {error}");
        }
    }
    assert!(seen > 25, "only {seen} keys were found");
}

/// The sections that are read before `section`, complete.
fn without(section: &str) -> String {
    let all = [
        ("plant", "[plant]\nA = [[0.5]]\nB = [[1.0]]\n"),
        (
            "constraints",
            "[constraints]\nstate_lower = [-1.0]\nstate_upper = [1.0]\n",
        ),
        ("weights", "[weights]\nQ = 1.0\nR = 1.0\nO = 1.0\n"),
        ("simulation", "[simulation]\nsteps = 3\n"),
    ];
    all.iter()
        .filter(|(name, _)| *name != section)
        .map(|(_, text)| *text)
        .collect()
}
