//! Section 4 of the paper, run again: Tables 1 and 2, Figures 1, 2 and 3, as data.

mod figures;
mod printed;
mod tables;

pub use figures::{Figure1, Figure2, Figure3, FigurePoint};
pub use tables::{Table1Line, Table2Line};

use crate::control::Controller;
use crate::error::{DesignError, StepError};
use crate::problem::file::ProblemFile;
use crate::simulation::SimulationError;
use serde::Serialize;
use std::time::{Duration, Instant};
use thiserror::Error;

/// How much is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Extent {
    /// Seconds: three carts, three scalings of the drone, short runs of it.
    Short,
    /// Up to 50 carts, closed loops of carts for a few seconds each.
    Standard,
    /// Everything, up to 200 carts.
    Full,
}

/// What stopped a reproduction.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReproductionError {
    /// A design or an analysis.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// A closed loop.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// A timed step.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// What the paper leaves unsaid about an item, and what was chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Choice {
    /// The table or figure.
    pub item: &'static str,
    /// What is unsaid, and the choice.
    pub text: &'static str,
}

/// Section 4.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reproduction {
    /// How much was run.
    pub extent: Extent,
    /// Table 1.
    pub table_1: Vec<Table1Line>,
    /// Table 2.
    pub table_2: Vec<Table2Line>,
    /// Figure 1.
    pub figure_1: Figure1,
    /// Figure 2.
    pub figure_2: Figure2,
    /// Figure 3.
    pub figure_3: Figure3,
    /// What is unsaid.
    pub choices: Vec<Choice>,
}

/// What the paper leaves unsaid, item by item.
pub const CHOICES: [Choice; 5] = [
    Choice {
        item: "Table 1",
        text: "The set-points and initial states behind the cumulative costs are not printed; ours are other ones, so the costs compare within a column, not across. The terminal horizons do not depend on them. The printed horizons are those of the first form of (26).",
    },
    Choice {
        item: "Table 2",
        text: "Springs (0.5 N/m), dampers (0.2 N s/m), masses (1 kg), N = 5, O = 1e4 I and the set-points are not printed; these are ours. The paper's times are of another machine and of MATLAB with YALMIP and GUROBI. Its explicit set is computed by set operations; ours by dropping redundant rows from those that are not spent. A closed loop is timed over its first steps, from the jump to the first set-point on: all 600, or as many as fit into the time given to one size and form (a minute in the full form, three seconds in the standard one, one second in the short one).",
    },
    Choice {
        item: "Figure 1",
        text: "The set-points and the initial state are not printed; ours are representative, and the last set-point is not admissible, as in the paper.",
    },
    Choice {
        item: "Figure 2",
        text: "The paper prints d = 5.6322 and not how it was found. Ours, 2.2253, is the exact infimum of the stage cost outside the level set with the input free, so our region is the smaller one for the same alpha. The paper's alpha = 25 does not keep the level set in the constraints at every admissible equilibrium (1.845 is the largest that does), but it does at every artificial set-point that the region allows (83.05). The region subtracts the least offset cost, not the offset cost of the optimum at the state, so that it is invariant.",
    },
    Choice {
        item: "Figure 3",
        text: "The set-points are not printed; ours are equilibria with positions and a yaw angle, as the paper says. The bounds of angles and rates and the inertia are not printed; they do not change the terminal horizon.",
    },
];

/// Runs section 4. `told` hears what is being done.
///
/// # Errors
/// [`ReproductionError`]: none is expected.
pub fn reproduce(extent: Extent, told: &dyn Fn(&str)) -> Result<Reproduction, ReproductionError> {
    told("Figure 1");
    let figure_1 = figures::figure_1()?;
    told("Figure 2");
    let figure_2 = figures::figure_2()?;
    told("Figure 3");
    let figure_3 = figures::figure_3(extent)?;
    Ok(Reproduction {
        extent,
        table_1: tables::table_1(extent, told)?,
        table_2: tables::table_2(extent, told)?,
        figure_1,
        figure_2,
        figure_3,
        choices: CHOICES.to_vec(),
    })
}

/// Mean time of a step of the file's closed loop, over as many steps as fit into the budget (at least two), and how many
/// those were.
fn step_times(
    controller: &mut Controller,
    file: &ProblemFile,
    budget: Duration,
) -> Result<(f64, usize), ReproductionError> {
    let Some(simulation) = &file.simulation else {
        return Ok((0.0, 0));
    };
    let plant = file.problem.plant();
    let at = plant.operating_point();
    let mut x = simulation.initial_state.clone();
    let started = Instant::now();
    let (mut total, mut steps) = (0.0, 0);
    controller.reset();
    while steps < simulation.steps && (steps < 2 || started.elapsed() < budget) {
        let Some(scheduled) = simulation
            .set_points
            .iter()
            .rev()
            .find(|s| s.from_step <= steps)
        else {
            break;
        };
        let step = controller.step(&x, &scheduled.set_point)?;
        total += step.elapsed.as_secs_f64();
        steps += 1;
        let dx: Vec<f64> = x.iter().zip(&at.state).map(|(a, b)| a - b).collect();
        let du: Vec<f64> = step
            .input
            .iter()
            .zip(&at.input)
            .map(|(a, b)| a - b)
            .collect();
        let (ax, bu) = (plant.a().mul_vec(&dx), plant.b().mul_vec(&du));
        for i in 0..x.len() {
            x[i] = at.state[i] + ax[i] + bu[i];
        }
    }
    Ok((total / steps.max(1) as f64, steps))
}
