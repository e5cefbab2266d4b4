//! Every design has a certificate, and the checker agrees with the search on what it proves.

mod support;

use mpct::certificate::{Certificate, VerifyOptions, verify};
use mpct::{Condition, DesignOptions, Problem, Task, TerminalIngredients};
use support::random;

/// One line for what is not as it should be.
fn faults(problem: &Problem, condition: Condition) -> Vec<String> {
    let name = format!("{} ({:?}, {condition})", problem.name(), problem.task());
    let options = DesignOptions {
        condition,
        ..DesignOptions::default()
    };
    let checked = || -> Result<Vec<String>, String> {
        let design = TerminalIngredients::design(problem, &options).map_err(|e| e.to_string())?;
        let text = Certificate::of(&design)
            .map_err(|e| e.to_string())?
            .to_json();
        let verified = verify(&text, VerifyOptions::default()).map_err(|e| e.to_string())?;
        let mut found = Vec::new();
        let mut expect = |what: &str, holds: bool| {
            if !holds {
                found.push(format!("{name}: {what}: {verified:?}"));
            }
        };
        let horizon = design.terminal_horizon();
        expect("horizon", verified.terminal_horizon == horizon);
        expect("rows", verified.rows_rigorous == problem.rows().len());
        expect("rigour", verified.rows_to_tolerance == 0);
        let minimal = horizon > 1 && condition == Condition::Exact;
        expect("witness", verified.witness.is_some() == minimal);
        Ok(found)
    };
    checked().unwrap_or_else(|e| vec![format!("{name}: {e}")])
}

/// Stable, unstable, integrating, with more inputs than states; of one state in ten one bound is missing.
#[test]
fn random_plants_are_certified() {
    let mut one_sided = 0;
    let mut horizons = Vec::new();
    let mut found = Vec::new();
    for seed in 0..200 {
        let problem = random::problem(seed);
        let (lower, upper) = problem.constraints().state_limits();
        one_sided += usize::from(lower.iter().chain(upper).any(|b| b.is_infinite()));
        let design = TerminalIngredients::design(&problem, &DesignOptions::default());
        horizons.extend(design.map(|d| d.terminal_horizon()));
        for problem in [problem.clone(), problem.with_task(Task::Regulation)] {
            found.extend(faults(&problem, Condition::Exact));
        }
    }
    assert!(one_sided > 40, "{one_sided} plants with a missing bound");
    assert!(found.is_empty(), "{}:\n{}", found.len(), found.join("\n"));
    // The plants are no trivial ones: many horizons, of many lengths.
    let above_one = horizons.iter().filter(|&&h| h > 1).count();
    horizons.sort_unstable();
    horizons.dedup();
    assert!(above_one > 100, "{above_one} of 200 horizons above 1");
    assert!(horizons.len() > 8, "{horizons:?}");
}

#[test]
fn the_sufficient_form_of_random_plants_is_certified() {
    let found: Vec<String> = (0..40)
        .flat_map(|seed| faults(&random::problem(seed), Condition::Sufficient))
        .collect();
    assert!(found.is_empty(), "{}:\n{}", found.len(), found.join("\n"));
}
