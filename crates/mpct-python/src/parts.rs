//! The parts of a problem from Python's arguments.

use crate::convert;
use crate::errors;
use crate::fork;
use crate::names;
use mpct::{
    Constraints, Formulation, Matrix, NoTerminalConstraint, Plant, Problem, Task, TerminalCost,
    Weight, Weights,
};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// An argument that was stated.
pub type Stated<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// A number, a diagonal or a matrix.
pub fn weight(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Weight> {
    let found = convert::numbers(what, value)?;
    match found.shape.len() {
        0 => Ok(found.data[0].into()),
        1 => Ok(found.data.into()),
        _ => Ok(convert::matrix(what, value)?.into()),
    }
}

/// One block (C, D, d), or a list of blocks.
fn mixed<'py>(value: &Bound<'py, PyAny>) -> PyResult<Vec<Bound<'py, PyTuple>>> {
    let py = value.py();
    let wrong = |found: String| {
        let expected = "a tuple (C, D, d) or a list of such tuples";
        errors::argument_type(py, "mixed", expected, &found)
    };
    let blocks = match value.cast::<PyTuple>() {
        Ok(one)
            if one
                .get_item(0)
                .is_ok_and(|c| !c.is_instance_of::<PyTuple>()) =>
        {
            vec![one.clone()]
        }
        _ => value
            .try_iter()
            .map_err(|_| wrong(value.get_type().to_string()))?
            .map(|item| {
                let item = item?;
                item.cast_into::<PyTuple>()
                    .map_err(|e| wrong(format!("a list with {}", e.into_inner().get_type())))
            })
            .collect::<PyResult<_>>()?,
    };
    match blocks.iter().find(|b| b.len() != 3) {
        Some(block) => Err(wrong(format!("a tuple of {}", block.len()))),
        None => Ok(blocks),
    }
}

/// The constraints of a plant.
pub fn constraints(
    py: Python<'_>,
    plant: &Plant,
    state: Stated<'_, '_>,
    input: Stated<'_, '_>,
    mixed_rows: Stated<'_, '_>,
) -> PyResult<Constraints> {
    let wrong = |e| errors::design(py, &e);
    let (n, m) = (plant.states(), plant.inputs());
    let mut constraints = Constraints::new(n, m);
    let (lower, upper) = convert::limits("state", state, n)?;
    constraints = constraints.state_bounds(&lower, &upper).map_err(wrong)?;
    let (lower, upper) = convert::limits("input", input, m)?;
    constraints = constraints.input_bounds(&lower, &upper).map_err(wrong)?;
    let Some(value) = mixed_rows else {
        return Ok(constraints);
    };
    for (i, block) in mixed(value)?.iter().enumerate() {
        let d = convert::vector(&format!("mixed[{i}] d"), &block.get_item(2)?)?;
        let side = |k: usize, name: &str, cols: usize| -> PyResult<Matrix> {
            let item = block.get_item(k)?;
            if item.is_none() {
                return Ok(Matrix::zeros(d.len(), cols));
            }
            convert::matrix(&format!("mixed[{i}] {name}"), &item)
        };
        let (c, by_input) = (side(0, "C", n)?, side(1, "D", m)?);
        constraints = constraints.mixed(c, by_input, d).map_err(wrong)?;
    }
    Ok(constraints)
}

/// What a problem has besides plant, constraints and weights.
pub struct Choices {
    pub name: String,
    pub horizon: usize,
    pub scaling: f64,
    pub task: Task,
    pub formulation: Formulation,
    pub terminal_cost: TerminalCost,
    pub horizon_extension: Option<usize>,
    pub gamma: Option<f64>,
    pub alpha: Option<f64>,
    pub gain: Option<Matrix>,
}

impl Choices {
    /// Those of a problem.
    pub fn of(problem: &Problem) -> Self {
        let stated = problem.no_terminal_constraint();
        Self {
            name: problem.name().into(),
            horizon: problem.prediction_horizon(),
            scaling: problem.scaling(),
            task: problem.task(),
            formulation: problem.formulation(),
            terminal_cost: problem.terminal_cost(),
            horizon_extension: stated.map(|c| c.horizon_extension()),
            gamma: stated.map(|c| c.gamma()),
            alpha: stated.and_then(|c| c.alpha()),
            gain: problem.gain().map(mpct::SparseMatrix::to_dense),
        }
    }

    /// Another formulation; the choices of section 3.5 go with it.
    pub fn change_formulation(&mut self, formulation: Formulation) {
        self.formulation = formulation;
        if formulation != Formulation::NoTerminalConstraint {
            (self.horizon_extension, self.gamma, self.alpha) = (None, None, None);
        }
    }

    fn no_terminal_constraint(&self, py: Python<'_>) -> PyResult<Option<NoTerminalConstraint>> {
        let wrong = |e| errors::design(py, &e);
        let stated = [
            ("horizon_extension", self.horizon_extension.is_some()),
            ("gamma", self.gamma.is_some()),
            ("alpha", self.alpha.is_some()),
        ];
        if self.formulation != Formulation::NoTerminalConstraint {
            return match stated.iter().find(|s| s.1) {
                Some((what, _)) => Err(errors::argument(
                    py,
                    what,
                    "formulation='no_terminal_constraint' beside it",
                    &format!("'{}'", names::word(self.formulation)),
                )),
                None => Ok(None),
            };
        }
        let Some(steps) = self.horizon_extension else {
            return Err(errors::argument(
                py,
                "horizon_extension",
                "the steps of the terminal law after the prediction horizon, fewer than the terminal horizon",
                "none",
            ));
        };
        let choices = NoTerminalConstraint::new(steps, self.gamma.unwrap_or(1.0)).map_err(wrong)?;
        match self.alpha {
            Some(alpha) => choices.with_alpha(alpha).map(Some).map_err(wrong),
            None => Ok(Some(choices)),
        }
    }
}

/// The problem; the factorisations of its checks run without the GIL.
pub fn assemble(
    py: Python<'_>,
    plant: Plant,
    constraints: Constraints,
    weights: Weights,
    choices: Choices,
) -> PyResult<Problem> {
    let section_3_5 = choices.no_terminal_constraint(py)?;
    fork::detached(py, || {
        let mut problem = Problem::new(plant, constraints, weights)?
            .with_prediction_horizon(choices.horizon)?
            .with_scaling(choices.scaling)?
            .with_task(choices.task)
            .with_formulation(choices.formulation)
            .with_terminal_cost(choices.terminal_cost)
            .with_name(choices.name);
        if let Some(section_3_5) = section_3_5 {
            problem = problem.with_no_terminal_constraint(section_3_5);
        }
        match choices.gain {
            Some(gain) => problem.with_gain(gain),
            None => Ok(problem),
        }
    })
    .map_err(|e| errors::design(py, &e))
}
