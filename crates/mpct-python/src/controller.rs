//! `mpct.Controller`.

use crate::analysis;
use crate::convert;
use crate::design::PyDesign;
use crate::errors;
use crate::fork;
use crate::names;
use crate::search;
use crate::step::PyStep;
use mpct::{
    AdmissibleSetPoint, CondensedQp, Controller, Formulation, SetPoint, TerminalIngredients,
};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyNotImplementedError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A set-point from its state and, when stated, its input.
pub fn set_point(state: &Bound<'_, PyAny>, input: Option<&Bound<'_, PyAny>>) -> PyResult<SetPoint> {
    Ok(SetPoint {
        state: convert::vector("set_point", state)?,
        input: input.map(|u| convert::vector("input", u)).transpose()?,
    })
}

/// A controller that threads share.
#[derive(Clone)]
pub struct Shared(Arc<Mutex<Controller>>);

impl Shared {
    /// The controller, for one thread. To be called without the GIL, which the thread that holds it may wait for.
    pub fn lock(&self) -> MutexGuard<'_, Controller> {
        // A step that panicked leaves nothing behind that the next one would trust: the solver starts anew.
        self.0.lock().unwrap_or_else(|poisoned: PoisonError<_>| {
            let mut guard = poisoned.into_inner();
            guard.reset();
            guard
        })
    }
}

/// A controller. Made by `Design.controller`; threads may share it, their steps then follow one another.
///
/// A pickle of it has the problem; unpickling does the design again and forgets the last step.
#[pyclass(frozen, name = "Controller", module = "mpct")]
pub struct PyController {
    inner: Shared,
    design: PyDesign,
    formulation: Formulation,
}

impl PyController {
    pub fn new(inner: Controller, design: PyDesign, formulation: Formulation) -> Self {
        Self {
            inner: Shared(Arc::new(Mutex::new(inner))),
            design,
            formulation,
        }
    }

    /// The controller of a design, made without the GIL.
    pub fn of(py: Python<'_>, design: &PyDesign, formulation: Formulation) -> PyResult<Controller> {
        let ingredients = design.inner.clone();
        analysis::long_work(py, move || {
            Controller::with_formulation(ingredients, formulation)
        })
    }

    /// Another controller of the same design.
    pub fn again(&self, py: Python<'_>) -> PyResult<Controller> {
        Self::of(py, &self.design, self.formulation)
    }

    /// The controller, for one thread. To be called without the GIL, which the thread that holds it may wait for.
    pub fn lock(&self) -> MutexGuard<'_, Controller> {
        self.inner.lock()
    }

    /// The controller for a thread that outlives the call.
    pub fn shared(&self) -> Shared {
        self.inner.clone()
    }

    /// What it was made from; no lock is needed.
    pub fn ingredients(&self) -> &TerminalIngredients {
        &self.design.inner
    }
}

/// H, f, G and b.
pub type Program<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// A quadratic program for Python; one with ellipsoids is more than H, f, G and b.
pub fn program(py: Python<'_>, qp: CondensedQp) -> PyResult<Program<'_>> {
    if !qp.cones.is_empty() {
        return Err(PyNotImplementedError::new_err(format!(
            "the program of this step has {} second-order cones besides its rows; qp gives programs with rows alone",
            qp.cones.len()
        )));
    }
    Ok((
        convert::to_array2(py, qp.hessian)?,
        convert::to_array(py, qp.linear),
        convert::to_array2(py, qp.rows)?,
        convert::to_array(py, qp.bounds),
    ))
}

#[pymethods]
impl PyController {
    /// The input for a measured state and a set-point.
    ///
    /// Parameters
    /// ----------
    /// x : array_like, shape (n,)
    ///     Measured state.
    /// set_point : array_like, shape (n,)
    ///     State of the set-point; anything finite. When it is not admissible the controller goes to the closest
    ///     steady state that is.
    /// input : array_like, shape (m,), optional
    ///     Input of the set-point; that of the operating point unless stated.
    ///
    /// Returns
    /// -------
    /// Step
    ///
    /// Raises
    /// ------
    /// StepError
    ///     When the state is outside the domain of attraction, or an entry is not finite.
    #[pyo3(signature = (x, set_point, input=None))]
    fn step(
        &self,
        py: Python<'_>,
        x: &Bound<'_, PyAny>,
        set_point: &Bound<'_, PyAny>,
        input: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyStep> {
        let x = convert::vector("x", x)?;
        let set_point = self::set_point(set_point, input)?;
        let inner = fork::detached(py, || self.lock().step(&x, &set_point))
            .map_err(|e| errors::step(py, &e))?;
        Ok(PyStep { inner })
    }

    /// The quadratic program of a step, for other solvers: min ½ zᵀ H z + fᵀ z subject to G z ≤ b.
    ///
    /// Parameters
    /// ----------
    /// x : array_like, shape (n,)
    ///     Measured state.
    /// set_point : array_like, shape (n,)
    ///     State of the set-point.
    /// input : array_like, shape (m,), optional
    ///     Input of the set-point.
    ///
    /// Returns
    /// -------
    /// H : ndarray, shape (variables, variables)
    /// f : ndarray, shape (variables,)
    /// G : ndarray, shape (rows, variables)
    /// b : ndarray, shape (rows,)
    ///
    /// Notes
    /// -----
    /// z = (c_0, …, c_{N−1}, θ), and the first input is u = K x + L θ + c_0, measured from the operating point.
    #[pyo3(signature = (x, set_point, input=None))]
    fn qp<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        set_point: &Bound<'py, PyAny>,
        input: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Program<'py>> {
        let x = convert::vector("x", x)?;
        let set_point = self::set_point(set_point, input)?;
        let qp = fork::detached(py, || self.lock().qp(&x, &set_point))
            .map_err(|e| errors::step(py, &e))?;
        program(py, qp)
    }

    /// The rows of the quadratic program that proved the last step infeasible, with their multipliers y.
    ///
    /// Returns
    /// -------
    /// list of tuple
    ///     For each row its index in `qp`, where it comes from, and its multiplier. Empty unless the last step was
    ///     refused as "infeasible".
    ///
    /// Notes
    /// -----
    /// The multipliers are y ≥ 0 with Gᵀy ≈ 0 and bᵀy < 0, so that no z has G z ≤ b. They were checked.
    fn infeasibility_proof(&self, py: Python<'_>) -> Vec<(usize, String, f64)> {
        fork::detached(py, || self.lock().infeasibility_proof())
            .into_iter()
            .map(|(row, name, multiplier)| (row, name.to_string(), multiplier))
            .collect()
    }

    /// The tables of the online program for the runtime, which runs on a target without this package.
    ///
    /// Returns
    /// -------
    /// RuntimeTables or None
    ///     None for plants of many subsystems, whose program has no dense tables.
    fn runtime_tables<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let tables = fork::detached(py, || {
            let controller = self.lock();
            controller
                .runtime_tables()
                .map(|(dims, numbers)| (dims, numbers.to_vec()))
        });
        let Some((dims, numbers)) = tables else {
            return Ok(None);
        };
        let fields = PyDict::new(py);
        fields.set_item("states", dims.states)?;
        fields.set_item("inputs", dims.inputs)?;
        fields.set_item("horizon", dims.horizon)?;
        fields.set_item("set_point", dims.set_point)?;
        fields.set_item("rows", dims.rows)?;
        fields.set_item("input_rows", dims.input_rows)?;
        fields.set_item("workspace_len", dims.workspace_len())?;
        fields.set_item("index_len", dims.index_len())?;
        fields.set_item("numbers", convert::to_array(py, numbers))?;
        convert::result(py, "RuntimeTables", &fields).map(Some)
    }

    /// Forgets the last step; the next one has no candidate to fall back on.
    fn reset(&self, py: Python<'_>) {
        fork::detached(py, || self.lock().reset());
    }

    /// Bounds the work of a step.
    ///
    /// Parameters
    /// ----------
    /// iterations : int, optional
    ///     Most iterations of the solver.
    /// seconds : float, optional
    ///     Longest time of the solver.
    #[pyo3(signature = (iterations=None, seconds=None))]
    fn set_limits(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = convert::whole::iterations)] iterations: Option<usize>,
        seconds: Option<f64>,
    ) -> PyResult<()> {
        let time = search::seconds(py, "seconds", seconds)?;
        let iterations = iterations.map(|i| u32::try_from(i).unwrap_or(u32::MAX));
        fork::detached(py, || self.lock().set_limits(iterations, time));
        Ok(())
    }

    /// The design it was made from.
    #[getter]
    fn design(&self) -> PyDesign {
        self.design.clone()
    }

    /// "implicit", "explicit" or "no_terminal_constraint".
    #[getter]
    fn formulation(&self) -> &'static str {
        names::word(self.formulation)
    }

    /// Variables of the quadratic program.
    #[getter]
    fn variables(&self, py: Python<'_>) -> usize {
        fork::detached(py, || self.lock().variables())
    }

    /// Rows of the quadratic program.
    #[getter]
    fn rows(&self, py: Python<'_>) -> usize {
        fork::detached(py, || self.lock().rows())
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        format!(
            "Controller(formulation='{}', variables={}, rows={})",
            self.formulation(),
            self.variables(py),
            self.rows(py)
        )
    }

    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let rebuild = py.import("mpct._pickle")?.getattr("controller")?;
        let design = Bound::new(py, self.design())?.into_any();
        let formulation = self.formulation().into_pyobject(py)?.into_any();
        Ok((rebuild, convert::tuple(py, vec![design, formulation])?))
    }
}

/// Seconds a step takes in a loop without Python: what `Controller.step` is compared with.
#[pyfunction]
pub fn _step_seconds(
    py: Python<'_>,
    controller: &Bound<'_, PyController>,
    x: &Bound<'_, PyAny>,
    set_point: &Bound<'_, PyAny>,
    count: u32,
) -> PyResult<f64> {
    let x = convert::vector("x", x)?;
    let set_point = self::set_point(set_point, None)?;
    let known = controller.get();
    fork::detached(py, || {
        let mut controller = known.lock();
        let start = Instant::now();
        for _ in 0..count {
            controller.step(&x, &set_point)?;
        }
        Ok(start.elapsed().as_secs_f64() / f64::from(count.max(1)))
    })
    .map_err(|e| errors::step(py, &e))
}

/// An admissible set-point for Python.
pub fn closest<'py>(py: Python<'py>, found: AdmissibleSetPoint) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    let limiting: Vec<String> = found.limiting.iter().map(ToString::to_string).collect();
    fields.set_item("state", convert::to_array(py, found.state))?;
    fields.set_item("input", convert::to_array(py, found.input))?;
    fields.set_item("parameter", convert::to_array(py, found.parameter))?;
    fields.set_item("offset_cost", found.offset_cost)?;
    fields.set_item("admissible", found.admissible)?;
    fields.set_item("limiting", limiting)?;
    convert::result(py, "AdmissibleSetPoint", &fields)
}
