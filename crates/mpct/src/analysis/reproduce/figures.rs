//! Figures 1, 2 and 3.

use super::printed::{FIGURE_2, FIGURE_2_SET_POINT};
use super::{Extent, ReproductionError};
use crate::analysis::{
    AlphaBounds, AlphaScope, DomainOfAttraction, Polygon, StabilityRegion, terminal_set,
};
use crate::cases;
use crate::control::{Controller, SetPoint};
use crate::problem::{NoTerminalConstraint, Task};
use crate::simulation::{Run, simulate};
use crate::terminal::{DesignOptions, TerminalIngredients};
use serde::Serialize;

/// One step of a run, in the coordinates of a figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FigurePoint {
    /// Time in seconds, or the step where the plant has no sampling time.
    pub time: f64,
    /// The state.
    pub state: Vec<f64>,
    /// The artificial set-point.
    pub artificial: Vec<f64>,
    /// The set-point.
    pub set_point: Vec<f64>,
}

/// Figure 1: the plane (x1, x2) with sets, set-points and the trajectory.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure1 {
    /// The projection of Ψ^tr_{f,λ}.
    pub tracking_set: Polygon,
    /// Ψ_f.
    pub regulation_set: Polygon,
    /// The domain of attraction.
    pub domain: Polygon,
    /// The trajectory.
    pub run: Vec<FigurePoint>,
}

/// Figure 2: Υ against the projection of the invariant set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure2 {
    /// x_s^r.
    pub set_point: [f64; 2],
    /// M̄.
    pub horizon_extension: usize,
    /// γ.
    pub gamma: f64,
    /// α.
    pub alpha: f64,
    /// Our d.
    pub d: f64,
    /// The paper's d.
    pub printed_d: f64,
    /// The largest α for every admissible equilibrium, throughout Υ, around the set-point.
    pub largest_alpha: [f64; 3],
    /// Υ.
    pub region: Polygon,
    /// The projection of Ψ^tr_{f,λ}.
    pub tracking_set: Polygon,
    /// The states at which (35) is feasible.
    pub feasible: Polygon,
}

/// Figure 3: the drone's position, its artificial set-point and its set-point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure3 {
    /// px, py, pz.
    pub run: Vec<FigurePoint>,
}

fn points(run: &Run, coordinates: &[usize], step_time: f64) -> Vec<FigurePoint> {
    let pick = |v: &[f64]| -> Vec<f64> { coordinates.iter().map(|&i| v[i]).collect() };
    run.steps
        .iter()
        .map(|s| FigurePoint {
            time: s.k as f64 * step_time,
            state: pick(&s.x),
            artificial: pick(&s.artificial_state),
            set_point: pick(&s.setpoint),
        })
        .collect()
}

pub(super) fn figure_1() -> Result<Figure1, ReproductionError> {
    let file = cases::academic();
    let options = DesignOptions::default();
    let tracking = TerminalIngredients::design(&file.problem, &options)?;
    let regulation =
        TerminalIngredients::design(&file.problem.clone().with_task(Task::Regulation), &options)?;
    let mut controller = Controller::new(tracking.clone())?;
    let run = match &file.simulation {
        Some(simulation) => points(&simulate(&mut controller, simulation, None)?, &[0, 1], 1.0),
        None => Vec::new(),
    };
    Ok(Figure1 {
        tracking_set: terminal_set(&tracking, (0, 1))?,
        regulation_set: terminal_set(&regulation, (0, 1))?,
        domain: DomainOfAttraction::of(&controller).projection((0, 1))?,
        run,
    })
}

pub(super) fn figure_2() -> Result<Figure2, ReproductionError> {
    let (steps, gamma, alpha, printed_d) = FIGURE_2;
    let choices = NoTerminalConstraint::new(steps, gamma)?.with_alpha(alpha)?;
    let problem = cases::academic()
        .problem
        .with_no_terminal_constraint(choices);
    let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
    let set_point = SetPoint::state(FIGURE_2_SET_POINT);
    let bounds = AlphaBounds::of(&ingredients, &set_point)?;
    let tracking_set = terminal_set(&ingredients, (0, 1))?;
    let controller = Controller::new(ingredients)?;
    let region = StabilityRegion::of(&controller, &set_point, AlphaScope::ThroughoutRegion)?;
    Ok(Figure2 {
        set_point: FIGURE_2_SET_POINT,
        horizon_extension: steps,
        gamma,
        alpha,
        d: region.stage_cost_bound(),
        printed_d,
        largest_alpha: [
            bounds.largest(AlphaScope::EveryEquilibrium),
            bounds.largest(AlphaScope::ThroughoutRegion),
            bounds.largest(AlphaScope::AroundSetPoint),
        ],
        region: region.projection((0, 1))?,
        tracking_set,
        feasible: DomainOfAttraction::of(&controller).projection((0, 1))?,
    })
}

pub(super) fn figure_3(extent: Extent) -> Result<Figure3, ReproductionError> {
    let file = cases::drone();
    let ingredients = TerminalIngredients::design(&file.problem, &DesignOptions::default())?;
    let step_time = file.problem.plant().sampling_time().unwrap_or(1.0);
    let Some(mut simulation) = file.simulation else {
        return Ok(Figure3 { run: Vec::new() });
    };
    if extent == Extent::Short {
        simulation.steps = 120;
    }
    let run = simulate(&mut Controller::new(ingredients)?, &simulation, None)?;
    Ok(Figure3 {
        run: points(&run, &[0, 1, 2], step_time),
    })
}
