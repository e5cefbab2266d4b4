//! Tables 1 and 2.

use super::printed::{PrintedTimes, TABLE_1, TABLE_2};
use super::{Extent, ReproductionError, step_times};
use crate::cases;
use crate::control::Controller;
use crate::problem::Formulation;
use crate::simulation::simulate;
use crate::terminal::{DesignOptions, TerminalIngredients};
use serde::Serialize;
use std::time::{Duration, Instant};

/// A line of Table 1 for one plant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table1Line {
    /// "academic" or "drone".
    pub plant: &'static str,
    /// λ.
    pub scaling: f64,
    /// Our M̃.
    pub terminal_horizon: usize,
    /// The paper's.
    pub printed_horizon: usize,
    /// Our Vcc, for our set-points.
    pub cumulative_cost: f64,
    /// The paper's, for its own.
    pub printed_cost: f64,
    /// Steps simulated.
    pub steps: usize,
}

/// A column of Table 2; times in seconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table2Line {
    /// Number of carts.
    pub carts: usize,
    /// Our M̃.
    pub terminal_horizon: usize,
    /// Variables of the program.
    pub variables: usize,
    /// Rows of the implicit program.
    pub implicit_rows: usize,
    /// Rows of the explicit program; `None` where the set was not computed.
    pub explicit_rows: Option<usize>,
    /// Time to find M̃, K and P.
    pub implicit_offline: f64,
    /// That, and the irredundant rows of the terminal set.
    pub explicit_offline: Option<f64>,
    /// Mean time of a step.
    pub implicit_online: f64,
    /// Mean time of a step.
    pub explicit_online: Option<f64>,
    /// Steps timed.
    pub steps: usize,
    /// The paper's times, in the order above: implicit offline, explicit offline, implicit online, explicit online.
    pub printed: [Option<f64>; 4],
}

/// Steps of the drone in the short form.
const SHORT_STEPS: usize = 60;

pub(super) fn table_1(
    extent: Extent,
    told: &dyn Fn(&str),
) -> Result<Vec<Table1Line>, ReproductionError> {
    let mut lines = Vec::new();
    for (plant, file) in [("academic", cases::academic()), ("drone", cases::drone())] {
        for (k, &(scaling, academic, academic_cost, drone, drone_cost)) in
            TABLE_1.iter().enumerate()
        {
            if extent == Extent::Short && plant == "drone" && k % 3 != 1 {
                continue;
            }
            told(&format!("Table 1: {plant} at scaling {scaling}"));
            let (printed_horizon, printed_cost) = if plant == "academic" {
                (academic, academic_cost)
            } else {
                (drone, drone_cost)
            };
            let problem = file.problem.clone().with_scaling(scaling)?;
            let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
            let terminal_horizon = ingredients.terminal_horizon();
            let Some(mut simulation) = file.simulation.clone() else {
                continue;
            };
            if extent == Extent::Short && plant == "drone" {
                simulation.steps = SHORT_STEPS;
            }
            let run = simulate(&mut Controller::new(ingredients)?, &simulation, None)?;
            lines.push(Table1Line {
                plant,
                scaling,
                terminal_horizon,
                printed_horizon,
                cumulative_cost: run.summary.cumulative_cost,
                printed_cost: 1e6 * printed_cost,
                steps: simulation.steps,
            });
        }
    }
    Ok(lines)
}

pub(super) fn table_2(
    extent: Extent,
    told: &dyn Fn(&str),
) -> Result<Vec<Table2Line>, ReproductionError> {
    // Largest size, largest size with an explicit set, time given to the closed loop of one size and formulation.
    let (largest, explicit_up_to, budget) = match extent {
        Extent::Short => (3, 3, 1.0),
        Extent::Standard => (50, 50, 3.0),
        Extent::Full => (200, 200, 60.0),
    };
    TABLE_2
        .iter()
        .filter(|p| p.carts <= largest)
        .map(|p| {
            told(&format!("Table 2: {} carts", p.carts));
            line(
                p,
                p.carts <= explicit_up_to,
                Duration::from_secs_f64(budget),
            )
        })
        .collect()
}

fn line(
    printed: &PrintedTimes,
    explicit: bool,
    budget: Duration,
) -> Result<Table2Line, ReproductionError> {
    let file = cases::carts(printed.carts)?;
    let started = Instant::now();
    let ingredients = TerminalIngredients::design(&file.problem, &DesignOptions::default())?;
    let implicit_offline = started.elapsed().as_secs_f64();
    let terminal_horizon = ingredients.terminal_horizon();
    let (mut explicit_rows, mut explicit_offline, mut explicit_online) = (None, None, None);
    if explicit {
        let started = Instant::now();
        let mut controller =
            Controller::with_formulation(ingredients.clone(), Formulation::Explicit)?;
        explicit_offline = Some(implicit_offline + started.elapsed().as_secs_f64());
        explicit_rows = Some(controller.rows());
        explicit_online = Some(step_times(&mut controller, &file, budget)?.0);
    }
    let mut controller = Controller::with_formulation(ingredients, Formulation::Implicit)?;
    let (implicit_online, steps) = step_times(&mut controller, &file, budget)?;
    Ok(Table2Line {
        carts: printed.carts,
        terminal_horizon,
        variables: controller.variables(),
        implicit_rows: controller.rows(),
        explicit_rows,
        implicit_offline,
        explicit_offline,
        implicit_online,
        explicit_online,
        steps,
        printed: [
            Some(printed.implicit_offline),
            printed.explicit_offline,
            Some(printed.implicit_online),
            printed.explicit_online,
        ],
    })
}
