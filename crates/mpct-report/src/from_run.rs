//! Report data from a design and a run.

use super::axis::number;
use super::data::{DesignNumbers, ReportData, Signal, StepRecord};
use mpct::{
    Condition, Formulation, Problem, RowSource, Run, SparseMatrix, Task, TerminalIngredients,
};

/// Beyond this many states the residual of (3) is not computed: the products take longer than the plots.
const RESIDUAL: usize = 600;

impl ReportData {
    /// What the report shows of a closed loop and of the design behind it. States and inputs without a name
    /// are called x1, x2, …, u1, u2, …
    pub fn new(ingredients: &TerminalIngredients, run: &Run) -> Self {
        let problem = ingredients.problem();
        let plant = problem.plant();
        let (states, inputs) = problem_signals(problem);
        let spent = ingredients
            .spent_steps()
            .into_iter()
            .map(|(source, step)| (row_name(source, &states, &inputs), step))
            .collect();
        let tracking = problem.task() == Task::Tracking;
        let mut weights = format!(
            "Q = {}, R = {}",
            weight(problem.state_weight()),
            weight(problem.input_weight())
        );
        if tracking {
            weights += &format!(", O = {}", weight(problem.offset_weight()));
        }
        let design = DesignNumbers {
            spectral_radius: ingredients.spectral_radius(),
            equation_3_residual: equation_3_residual(ingredients),
            task: if tracking { "tracking" } else { "regulation" }.into(),
            formulation: match problem.formulation() {
                Formulation::Implicit => "implicit",
                Formulation::Explicit => "explicit",
                Formulation::NoTerminalConstraint => "no-terminal-constraint",
            }
            .into(),
            extension: problem
                .no_terminal_constraint()
                .filter(|_| problem.formulation() == Formulation::NoTerminalConstraint)
                .map(|e| (e.horizon_extension(), e.gamma())),
            prediction_horizon: problem.prediction_horizon(),
            terminal_horizon: ingredients.terminal_horizon(),
            minimal: ingredients.is_minimal(),
            condition: match ingredients.condition() {
                Condition::Exact => "exact",
                Condition::Sufficient => "sufficient",
            }
            .into(),
            scaling: problem.scaling(),
            linear_programs: ingredients.linear_programs(),
            seconds: ingredients.elapsed().as_secs_f64(),
            constraint_rows: problem.rows().len(),
            ellipsoids: problem.norms().len(),
            weights,
            spent,
            certificate: None,
            regions: Vec::new(),
        };
        Self {
            name: problem.name().into(),
            states,
            inputs,
            sampling_time: plant.sampling_time(),
            continuous: plant.continuous_matrices().is_some(),
            design,
            steps: run.steps.iter().map(record).collect(),
            final_state: run.summary.final_state.clone(),
            cumulative_cost: run.summary.cumulative_cost,
            worst_violation: run.summary.worst_violation,
            disturbed: false,
        }
    }

    /// Says that a disturbance acted: the cost need not decrease then.
    pub fn with_disturbance(mut self, disturbed: bool) -> Self {
        self.disturbed = disturbed;
        self
    }
}

/// The states and the inputs of a problem.
pub fn problem_signals(problem: &Problem) -> (Vec<Signal>, Vec<Signal>) {
    let (labels, limits) = (problem.plant().labels(), problem.constraints());
    (
        signals(
            "x",
            &labels.state_names,
            &labels.state_units,
            limits.state_limits(),
        ),
        signals(
            "u",
            &labels.input_names,
            &labels.input_units,
            limits.input_limits(),
        ),
    )
}

fn record(step: &mpct::RunStep) -> StepRecord {
    StepRecord {
        x: step.x.clone(),
        u: step.u.clone(),
        artificial_state: step.artificial_state.clone(),
        artificial_input: step.artificial_input.clone(),
        set_point: step.setpoint.clone(),
        cost: step.cost,
        offset_cost: step.offset_cost,
        admissible: step.admissible,
        // The name that the JSON output has.
        status: serde_json::to_value(step.status)
            .ok()
            .and_then(|v| v.as_str().map(String::from))
            .unwrap_or_default(),
        iterations: step.iterations,
        solve_seconds: step.solve_seconds,
    }
}

fn signals(
    letter: &str,
    names: &[String],
    units: &[String],
    (lower, upper): (&[f64], &[f64]),
) -> Vec<Signal> {
    (0..lower.len())
        .map(|i| Signal {
            name: names
                .get(i)
                .cloned()
                .unwrap_or_else(|| format!("{letter}{}", i + 1)),
            unit: units.get(i).filter(|u| !u.is_empty()).cloned(),
            lower: lower[i],
            upper: upper[i],
        })
        .collect()
}

/// "x3 ≤ 0.8 m": the row as an engineer reads it.
fn row_name(source: RowSource, states: &[Signal], inputs: &[Signal]) -> String {
    let bound = |s: &Signal, sign: &str, limit: f64| {
        let unit = s.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
        format!("{} {sign} {}{unit}", s.name, number(limit))
    };
    match source {
        RowSource::StateLower(i) => bound(&states[i], "≥", states[i].lower),
        RowSource::StateUpper(i) => bound(&states[i], "≤", states[i].upper),
        RowSource::InputLower(i) => bound(&inputs[i], "≥", inputs[i].lower),
        RowSource::InputUpper(i) => bound(&inputs[i], "≤", inputs[i].upper),
        RowSource::Mixed { .. } | RowSource::Ellipsoid(_) => source.to_string(),
    }
}

/// "10 I", "diag(1, 1.5, …)" or "a full matrix".
fn weight(w: &SparseMatrix) -> String {
    if w.entries().any(|(i, j, v)| i != j && v != 0.0) {
        return "a matrix".into();
    }
    let diagonal: Vec<f64> = (0..w.rows()).map(|i| w.get(i, i)).collect();
    if diagonal.iter().all(|v| *v == diagonal[0]) {
        return format!("{} I", number(diagonal[0]));
    }
    let mut entries: Vec<String> = diagonal.iter().take(4).map(|v| number(*v)).collect();
    if diagonal.len() > 4 {
        entries.push("…".into());
    }
    format!("diag({})", entries.join(", "))
}

/// Largest entry of (A+BK)ᵀP(A+BK) − P + Q + KᵀRK, relative to the largest of P.
fn equation_3_residual(ingredients: &TerminalIngredients) -> Option<f64> {
    let problem = ingredients.problem();
    let (plant, k, p) = (
        problem.plant(),
        ingredients.gain(),
        ingredients.terminal_weight(),
    );
    if plant.states() > RESIDUAL {
        return None;
    }
    let a_k = plant.a().combine(1.0, &plant.b().mul(k), 1.0);
    let residual = a_k
        .transpose()
        .mul(&p.mul(&a_k))
        .combine(1.0, p, -1.0)
        .combine(1.0, problem.state_weight(), 1.0)
        .combine(1.0, &k.transpose().mul(&problem.input_weight().mul(k)), 1.0);
    let largest = |m: &SparseMatrix| m.entries().fold(0.0_f64, |a, e| a.max(e.2.abs()));
    Some(largest(&residual) / largest(p))
}
