//! How well a closed loop did: Vcc of section 4.1, settling, margins to the constraints, energy; and two runs side by side.

use crate::error::DesignError;
use crate::problem::{Problem, RowSource, Task};
use crate::simulation::Run;
use serde::Serialize;

/// A loop has settled when the state stays this near to where it goes, as a share of the largest distance since the
/// set-point changed: the usual two per cent.
pub const SETTLED: f64 = 0.02;
/// Distances below this, in the unit of the state, count as none: a loop that is where it should be has settled.
const AT_REST: f64 = 1e-9;

/// Settling after one set-point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settling {
    /// First step of the set-point.
    pub from_step: usize,
    /// Its state.
    pub set_point: Vec<f64>,
    /// Steps until the state stays within [`SETTLED`] of the last artificial set-point of this stretch; `None` when it
    /// does not before the next set-point or the end.
    pub steps: Option<usize>,
}

/// The room left to a constraint.
#[derive(Clone, Debug, PartialEq)]
pub struct ConstraintMargin {
    /// The constraint.
    pub row: RowSource,
    /// The smallest room over the run, in the unit of the row, 1 − ‖F x + G u + h‖ for an ellipsoid; negative when it was
    /// violated.
    pub margin: f64,
    /// The same as a share of the room at the operating point.
    pub share: f64,
    /// The step at which it was smallest.
    pub step: usize,
}

/// Figures of a closed loop.
///
/// ```
/// use mpct::{Controller, DesignOptions, TerminalIngredients, analysis::Performance, simulate};
/// let file = mpct::cases::academic();
/// let ingredients = TerminalIngredients::design(&file.problem, &DesignOptions::default())?;
/// let mut controller = Controller::new(ingredients)?;
/// let mut simulation = file.simulation.expect("the case has one");
/// simulation.steps = 40;
/// let run = simulate(&mut controller, &simulation, None)?;
/// let performance = Performance::of(&run, &file.problem)?;
/// assert_eq!(performance.cumulative_cost, run.summary.cumulative_cost);
/// assert!(performance.margins.iter().all(|m| m.margin > -1e-9));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Performance {
    /// Steps of the run.
    pub steps: usize,
    /// Vcc (section 4.1).
    pub cumulative_cost: f64,
    /// Its offset part, Σ ‖x_s^a − x_s^r‖²_O.
    pub cumulative_offset_cost: f64,
    /// Stretch by stretch.
    pub settling: Vec<Settling>,
    /// Row by row, smallest share first.
    pub margins: Vec<ConstraintMargin>,
    /// Σ_k (u_k − u_op)², input by input.
    pub input_energy: Vec<f64>,
    /// Σ_k (u_k − u_{k−1})², input by input: the wear of actuators.
    pub input_movement: Vec<f64>,
    /// Mean time of a step, seconds.
    pub mean_solve_seconds: f64,
    /// Median time of a step, seconds.
    pub median_solve_seconds: f64,
    /// Largest time of a step, seconds.
    pub max_solve_seconds: f64,
}

impl Performance {
    /// The figures of a run of this problem.
    ///
    /// # Errors
    /// [`DesignError::Shape`] when the run has no step, or belongs to a plant of another size.
    pub fn of(run: &Run, problem: &Problem) -> Result<Self, DesignError> {
        let plant = problem.plant();
        let (n, m) = (plant.states(), plant.inputs());
        let fits = run
            .steps
            .first()
            .is_some_and(|s| s.x.len() == n && s.u.len() == m);
        if !fits {
            return Err(DesignError::Shape {
                what: "the run".into(),
                expected: format!("at least one step, with {n} states and {m} inputs"),
                found: run.steps.first().map_or("no step".into(), |s| {
                    format!("{} states and {} inputs", s.x.len(), s.u.len())
                }),
            });
        }
        let at = plant.operating_point();
        let mut input_energy = vec![0.0; m];
        let mut input_movement = vec![0.0; m];
        for (k, step) in run.steps.iter().enumerate() {
            for j in 0..m {
                input_energy[j] += (step.u[j] - at.input[j]).powi(2);
                if k > 0 {
                    input_movement[j] += (step.u[j] - run.steps[k - 1].u[j]).powi(2);
                }
            }
        }
        let mut seconds: Vec<f64> = run.steps.iter().map(|s| s.solve_seconds).collect();
        seconds.sort_by(f64::total_cmp);
        let offset = match problem.task() {
            Task::Tracking => run.steps.iter().map(|s| s.offset_cost).sum(),
            Task::Regulation => 0.0,
        };
        Ok(Self {
            steps: run.steps.len(),
            cumulative_cost: run.summary.cumulative_cost,
            cumulative_offset_cost: offset,
            settling: settling(run),
            margins: margins(run, problem),
            input_energy,
            input_movement,
            mean_solve_seconds: run.summary.mean_solve_seconds,
            median_solve_seconds: seconds[seconds.len() / 2],
            max_solve_seconds: run.summary.max_solve_seconds,
        })
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

fn settling(run: &Run) -> Vec<Settling> {
    let steps = &run.steps;
    let mut starts: Vec<usize> = (0..steps.len())
        .filter(|&k| k == 0 || steps[k].setpoint != steps[k - 1].setpoint)
        .collect();
    starts.push(steps.len());
    starts
        .windows(2)
        .map(|w| {
            let (from, to) = (w[0], w[1]);
            let home = &steps[to - 1].artificial_state;
            let distances: Vec<f64> = steps[from..to]
                .iter()
                .map(|s| distance(&s.x, home))
                .collect();
            let largest = distances.iter().fold(0.0_f64, |a, d| a.max(*d));
            let near = (SETTLED * largest).max(AT_REST);
            let last_far = distances.iter().rposition(|d| *d > near);
            let settled = last_far.map_or(0, |k| k + 1);
            Settling {
                from_step: steps[from].k,
                set_point: steps[from].setpoint.clone(),
                steps: (settled < distances.len()).then_some(settled),
            }
        })
        .collect()
}

fn margins(run: &Run, problem: &Problem) -> Vec<ConstraintMargin> {
    let rows = problem.rows();
    let at = problem.plant().operating_point();
    let mut margins: Vec<ConstraintMargin> = rows
        .source
        .iter()
        .copied()
        .chain(problem.norms().iter().map(|b| b.source))
        .map(|row| ConstraintMargin {
            row,
            margin: f64::INFINITY,
            share: f64::INFINITY,
            step: 0,
        })
        .collect();
    for step in &run.steps {
        let x: Vec<f64> = step.x.iter().zip(&at.state).map(|(a, b)| a - b).collect();
        let u: Vec<f64> = step.u.iter().zip(&at.input).map(|(a, b)| a - b).collect();
        for (i, margin) in margins.iter_mut().enumerate() {
            let (room, scale) = match i.checked_sub(rows.len()) {
                None => (
                    1.0 - rows.c.row_dot(i, &x) - rows.d.row_dot(i, &u),
                    rows.scale[i],
                ),
                Some(k) => {
                    let bound = &problem.norms()[k];
                    let at_origin = 1.0 - bound.value(&vec![0.0; x.len()], &vec![0.0; u.len()]);
                    ((1.0 - bound.value(&x, &u)) / at_origin, at_origin)
                }
            };
            if room < margin.share {
                margin.share = room;
                margin.margin = room * scale;
                margin.step = step.k;
            }
        }
    }
    margins.sort_by(|a, b| a.share.total_cmp(&b.share));
    margins
}

impl Serialize for ConstraintMargin {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut s = serializer.serialize_struct("ConstraintMargin", 4)?;
        s.serialize_field("row", &self.row.to_string())?;
        s.serialize_field("margin", &self.margin)?;
        s.serialize_field("share", &self.share)?;
        s.serialize_field("step", &self.step)?;
        s.end()
    }
}

/// One figure of two runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparedFigure {
    /// What it is, with its unit.
    pub what: String,
    /// Of the first run; `None` where it has none.
    pub first: Option<f64>,
    /// Of the second run.
    pub second: Option<f64>,
}

impl ComparedFigure {
    /// second / first, where both are numbers and the first is not 0.
    pub fn ratio(&self) -> Option<f64> {
        match (self.first, self.second) {
            (Some(a), Some(b)) if a != 0.0 => Some(b / a),
            _ => None,
        }
    }
}

/// Two performances, figure by figure. Vectors are summed up, settling is told stretch by stretch.
pub fn compare(first: &Performance, second: &Performance) -> Vec<ComparedFigure> {
    let mut figures = Vec::new();
    let mut put = |what: &str, of: &dyn Fn(&Performance) -> Option<f64>| {
        figures.push(ComparedFigure {
            what: what.into(),
            first: of(first),
            second: of(second),
        });
    };
    put("steps", &|p| Some(p.steps as f64));
    put("cumulative cost", &|p| Some(p.cumulative_cost));
    put("cumulative offset cost", &|p| {
        Some(p.cumulative_offset_cost)
    });
    put("input energy", &|p| Some(p.input_energy.iter().sum()));
    put("input movement", &|p| Some(p.input_movement.iter().sum()));
    put("smallest margin, share of the room", &|p| {
        p.margins.first().map(|m| m.share)
    });
    for k in 0..first.settling.len().max(second.settling.len()) {
        put(&format!("steps to settle, set-point {k}"), &|p| {
            p.settling.get(k).and_then(|s| s.steps).map(|s| s as f64)
        });
    }
    put("mean time of a step, s", &|p| Some(p.mean_solve_seconds));
    put("median time of a step, s", &|p| {
        Some(p.median_solve_seconds)
    });
    put("largest time of a step, s", &|p| Some(p.max_solve_seconds));
    figures
}
