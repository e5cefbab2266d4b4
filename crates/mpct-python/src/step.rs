//! `mpct.Step`.

use crate::convert;
use crate::names;
use crate::search;
use mpct::{Step, StepStatus};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyString;

/// One step of a controller. Made by `Controller.step`.
#[pyclass(frozen, name = "Step", module = "mpct")]
#[derive(Clone)]
pub struct PyStep {
    pub inner: Step,
}

#[pymethods]
impl PyStep {
    /// The input to apply, shape (m,).
    #[getter]
    fn u<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.inner.input)
    }

    /// Artificial steady state, shape (n,).
    #[getter]
    fn artificial_state<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.inner.artificial_state)
    }

    /// Artificial steady input, shape (m,).
    #[getter]
    fn artificial_input<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.inner.artificial_input)
    }

    /// Cost of the prediction.
    #[getter]
    fn cost(&self) -> f64 {
        self.inner.cost
    }

    /// Part of the cost that penalises the distance from the set-point.
    #[getter]
    fn offset_cost(&self) -> f64 {
        self.inner.offset_cost
    }

    /// Whether the set-point is admissible.
    #[getter]
    fn admissible(&self) -> bool {
        self.inner.admissible
    }

    /// Predicted states x_0, …, x_N, shape (N + 1, n).
    #[getter]
    fn predicted_states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let cols = self.inner.artificial_state.len();
        convert::rows_to_array2(
            py,
            cols,
            self.inner.predicted_states.iter().map(Vec::as_slice),
        )
    }

    /// Predicted inputs u_0, …, u_{N−1}, shape (N, m).
    #[getter]
    fn predicted_inputs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let cols = self.inner.artificial_input.len();
        convert::rows_to_array2(
            py,
            cols,
            self.inner.predicted_inputs.iter().map(Vec::as_slice),
        )
    }

    /// "optimal", or "candidate" when the solver gave no answer and the shifted last solution is used.
    #[getter]
    fn status(&self) -> String {
        self.inner.status.to_string()
    }

    /// Why the step returned the candidate: "iteration_limit", "deadline" or "solver_failed"; None for an optimum.
    #[getter]
    fn reason(&self) -> Option<&'static str> {
        names::reason(self.inner.status)
    }

    /// Iterations of the solver.
    #[getter]
    fn iterations(&self) -> usize {
        self.inner.iterations
    }

    /// Largest violation of a row of the program, where right-hand sides are 1 at the operating point.
    #[getter]
    fn violation(&self) -> f64 {
        self.inner.violation
    }

    /// Seconds that the step took.
    #[getter]
    fn seconds(&self) -> f64 {
        self.inner.elapsed.as_secs_f64()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (StepParts,))> {
        let step = self.inner.clone();
        let numbers = (
            step.cost,
            step.offset_cost,
            step.admissible,
            self.reason().map(String::from),
            step.iterations,
            step.violation,
            step.elapsed.as_secs_f64(),
        );
        let parts = (
            numbers,
            [step.input, step.artificial_state, step.artificial_input],
            [step.predicted_states, step.predicted_inputs],
        );
        Ok((py.import("mpct._mpct")?.getattr("_step")?, (parts,)))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        // Python writes an exponent with its sign and two digits, Rust does not.
        let words =
            "Step(u={}, cost={:.6e}, admissible={}, status='{}', iterations={}, seconds={:.3e})";
        let step = &self.inner;
        let numbers = (
            &step.input,
            step.cost,
            step.admissible,
            step.status.to_string(),
            step.iterations,
            self.seconds(),
        );
        PyString::new(py, words)
            .call_method1("format", numbers)?
            .extract()
    }
}

/// What `Step.__reduce__` hands over: numbers, arrays, the prediction, words.
type StepParts = (
    (f64, f64, bool, Option<String>, usize, f64, f64),
    [Vec<f64>; 3],
    [Vec<Vec<f64>>; 2],
);

/// A step out of a pickle.
#[pyfunction]
pub fn _step(py: Python<'_>, parts: StepParts) -> PyResult<PyStep> {
    let (numbers, [input, artificial_state, artificial_input], [states, inputs]) = parts;
    let (cost, offset_cost, admissible, reason, iterations, violation, seconds) = numbers;
    let inner = Step {
        input,
        artificial_state,
        artificial_input,
        cost,
        offset_cost,
        admissible,
        predicted_states: states,
        predicted_inputs: inputs,
        status: match reason {
            Some(reason) => StepStatus::Candidate(names::value(py, &reason)?),
            None => StepStatus::Optimal,
        },
        violation,
        iterations,
        elapsed: search::seconds(py, "seconds", Some(seconds))?.unwrap_or_default(),
    };
    Ok(PyStep { inner })
}
