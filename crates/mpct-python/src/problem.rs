//! `mpct.Problem`.

use crate::convert;
use crate::design::{self, PyDesign};
use crate::errors;
use crate::plant::PyPlant;
use mpct::{Constraints, DesignError, Formulation, Problem, ProblemFile, Task, Weight, Weights};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::path::{Path, PathBuf};

/// A control problem: a plant, constraints, weights and a horizon.
///
/// Parameters
/// ----------
/// plant : Plant
///     The plant.
/// state, input : tuple of two array_like, optional
///     Lower and upper limits: vectors, or a number for all entries. ``None`` or infinities leave a side open.
/// mixed : tuple of three array_like, optional
///     (C, D, d): rows C x + D u ≤ d.
/// Q, R : float or array_like
///     Weights of states and inputs in the stage cost: w I, diag(w) or a symmetric positive definite matrix.
/// O : float or array_like
///     Weight of the distance between the artificial steady state and the set-point.
/// O_input : float or array_like, optional
///     Weight of the same distance of inputs; none unless stated.
/// horizon : int, default 10
///     Prediction horizon N.
/// scaling : float, default 0.9
///     λ in (0, 1), by which the constraints shrink for the artificial steady state.
/// task : {"tracking", "regulation"}
///     Whether set-points jump, or the operating point is the only one.
/// formulation : {"implicit", "explicit"}
///     Whether the controller predicts M̃ more steps or uses the rows of the explicit terminal set.
/// gain : array_like, shape (m, n), optional
///     K of the terminal law u = K x + L θ; that of the linear quadratic regulator unless stated.
/// name : str, optional
///     A name.
///
/// Raises
/// ------
/// DesignError
///     When the problem is not one; its attributes say which number is wrong.
///
/// Examples
/// --------
/// >>> import mpct
/// >>> plant = mpct.Plant([[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]])
/// >>> mpct.Problem(plant, state=(-3, 3), input=(-2, 2), Q=10, R=100, O=1e4)
/// Problem(states=2, inputs=2, rows=8, task='tracking', formulation='implicit', horizon=10, scaling=0.9)
#[pyclass(frozen, name = "Problem", module = "mpct", skip_from_py_object)]
#[derive(Clone)]
pub struct PyProblem {
    pub inner: Problem,
}

fn weight(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Weight> {
    let found = convert::numbers(what, value)?;
    match found.shape.len() {
        0 => Ok(found.data[0].into()),
        1 => Ok(found.data.into()),
        _ => Ok(convert::matrix(what, value)?.into()),
    }
}

fn task(name: &str) -> PyResult<Task> {
    match name {
        "tracking" => Ok(Task::Tracking),
        "regulation" => Ok(Task::Regulation),
        _ => Err(PyValueError::new_err(format!(
            "task: expected 'tracking' or 'regulation', found '{name}'"
        ))),
    }
}

pub fn formulation(name: &str) -> PyResult<Formulation> {
    match name {
        "implicit" => Ok(Formulation::Implicit),
        "explicit" => Ok(Formulation::Explicit),
        _ => Err(PyValueError::new_err(format!(
            "formulation: expected 'implicit' or 'explicit', found '{name}'"
        ))),
    }
}

pub fn formulation_name(formulation: Formulation) -> &'static str {
    match formulation {
        Formulation::Implicit => "implicit",
        Formulation::Explicit => "explicit",
    }
}

type Limits<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl PyProblem {
    #[new]
    #[pyo3(signature = (plant, state=None, input=None, mixed=None, *, Q, R, O, O_input=None, horizon=10, scaling=0.9, task="tracking", formulation="implicit", gain=None, name=""))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        plant: PyRef<'_, PyPlant>,
        state: Option<Bound<'_, PyAny>>,
        input: Option<Bound<'_, PyAny>>,
        mixed: Option<(Bound<'_, PyAny>, Bound<'_, PyAny>, Bound<'_, PyAny>)>,
        Q: Bound<'_, PyAny>,
        R: Bound<'_, PyAny>,
        O: Bound<'_, PyAny>,
        O_input: Option<Bound<'_, PyAny>>,
        horizon: usize,
        scaling: f64,
        task: &str,
        formulation: &str,
        gain: Option<Bound<'_, PyAny>>,
        name: &str,
    ) -> PyResult<Self> {
        let wrong = |e: DesignError| errors::design(py, &e);
        let plant = plant.inner.clone();
        let (n, m) = (plant.states(), plant.inputs());
        let (lower, upper) = convert::limits("state", state.as_ref(), n)?;
        let mut constraints = Constraints::new(n, m)
            .state_bounds(&lower, &upper)
            .map_err(wrong)?;
        let (lower, upper) = convert::limits("input", input.as_ref(), m)?;
        constraints = constraints.input_bounds(&lower, &upper).map_err(wrong)?;
        if let Some((c, d, bound)) = &mixed {
            constraints = constraints
                .mixed(
                    convert::matrix("mixed C", c)?,
                    convert::matrix("mixed D", d)?,
                    convert::vector("mixed d", bound)?,
                )
                .map_err(wrong)?;
        }
        let mut weights = Weights::new(weight("Q", &Q)?, weight("R", &R)?, weight("O", &O)?);
        if let Some(o) = &O_input {
            weights = weights.with_offset_input(weight("O_input", o)?);
        }
        let mut inner = Problem::new(plant, constraints, weights)
            .and_then(|p| p.with_prediction_horizon(horizon))
            .and_then(|p| p.with_scaling(scaling))
            .map_err(wrong)?
            .with_task(self::task(task)?)
            .with_formulation(self::formulation(formulation)?)
            .with_name(name);
        if let Some(gain) = &gain {
            inner = inner
                .with_gain(convert::matrix("gain", gain)?)
                .map_err(wrong)?;
        }
        Ok(Self { inner })
    }

    /// Reads a problem file.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     A TOML file, as the command line reads it. Its simulation, if any, is left out.
    ///
    /// Returns
    /// -------
    /// Problem
    ///
    /// Raises
    /// ------
    /// FileError
    ///     When the file cannot be read or has a key or value of the wrong kind.
    /// DesignError
    ///     When the file is well formed, but what it states is not a problem.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let read = py.detach(|| ProblemFile::read(&path));
        let inner = read.map_err(|e| errors::file(py, &e))?.problem;
        Ok(Self { inner })
    }

    /// Reads the text of a problem file.
    ///
    /// Parameters
    /// ----------
    /// text : str
    ///     TOML text, as `to_toml` writes it.
    ///
    /// Returns
    /// -------
    /// Problem
    #[staticmethod]
    fn from_toml(py: Python<'_>, text: &str) -> PyResult<Self> {
        let inner = ProblemFile::parse(text, Path::new("."))
            .map_err(|e| errors::file(py, &e))?
            .problem;
        Ok(Self { inner })
    }

    /// The text of a problem file that states this problem.
    ///
    /// Returns
    /// -------
    /// str
    pub fn to_toml(&self) -> String {
        let file = ProblemFile {
            problem: self.inner.clone(),
            simulation: None,
        };
        file.to_toml()
    }

    /// A copy of the problem with other parameters.
    ///
    /// Parameters
    /// ----------
    /// horizon, scaling, task, formulation, name : optional
    ///     As in `Problem`; what is not stated stays.
    ///
    /// Returns
    /// -------
    /// Problem
    #[pyo3(signature = (*, horizon=None, scaling=None, task=None, formulation=None, name=None))]
    fn replace(
        &self,
        py: Python<'_>,
        horizon: Option<usize>,
        scaling: Option<f64>,
        task: Option<&str>,
        formulation: Option<&str>,
        name: Option<&str>,
    ) -> PyResult<Self> {
        let wrong = |e: DesignError| errors::design(py, &e);
        let mut inner = self.inner.clone();
        if let Some(horizon) = horizon {
            inner = inner.with_prediction_horizon(horizon).map_err(wrong)?;
        }
        if let Some(scaling) = scaling {
            inner = inner.with_scaling(scaling).map_err(wrong)?;
        }
        if let Some(task) = task {
            inner = inner.with_task(self::task(task)?);
        }
        if let Some(formulation) = formulation {
            inner = inner.with_formulation(self::formulation(formulation)?);
        }
        if let Some(name) = name {
            inner = inner.with_name(name);
        }
        Ok(Self { inner })
    }

    /// Designs the terminal ingredients.
    ///
    /// Other Python threads run meanwhile, and Ctrl-C ends the search.
    ///
    /// Parameters
    /// ----------
    /// condition : {"exact", "sufficient"}
    ///     Form of the condition that M̃ satisfies; the exact one gives the shortest horizon.
    /// max_horizon : int, default 5000
    ///     The search gives up beyond this horizon.
    /// time_limit : float, optional
    ///     The search gives up after this many seconds.
    /// progress : callable or bool, optional
    ///     Called now and then with (rows done, rows in all, lower bound of M̃). True shows a progress bar, False none;
    ///     unless stated, a terminal and a notebook show one when the search takes long.
    ///
    /// Returns
    /// -------
    /// Design
    ///
    /// Raises
    /// ------
    /// DesignError
    ///     When an assumption does not hold, or M̃ is not found within the limits.
    #[pyo3(signature = (condition="exact", max_horizon=5000, time_limit=None, progress=None))]
    fn design(
        &self,
        py: Python<'_>,
        condition: &str,
        max_horizon: usize,
        time_limit: Option<f64>,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<PyDesign> {
        design::design(
            py,
            &self.inner,
            condition,
            max_horizon,
            time_limit,
            progress,
        )
    }

    /// The plant.
    #[getter]
    fn plant(&self) -> PyPlant {
        PyPlant {
            inner: self.inner.plant().clone(),
        }
    }

    /// Lower and upper limits of the states.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> Limits<'py> {
        let (lower, upper) = self.inner.constraints().state_limits();
        (
            convert::to_array(py, lower.to_vec()),
            convert::to_array(py, upper.to_vec()),
        )
    }

    /// Lower and upper limits of the inputs.
    #[getter]
    fn input<'py>(&self, py: Python<'py>) -> Limits<'py> {
        let (lower, upper) = self.inner.constraints().input_limits();
        (
            convert::to_array(py, lower.to_vec()),
            convert::to_array(py, upper.to_vec()),
        )
    }

    /// Q, shape (n, n).
    #[getter(Q)]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        convert::sparse_to_array2(py, self.inner.state_weight())
    }

    /// R, shape (m, m).
    #[getter(R)]
    fn r<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        convert::sparse_to_array2(py, self.inner.input_weight())
    }

    /// O, shape (n, n).
    #[getter(O)]
    fn o<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        convert::sparse_to_array2(py, self.inner.offset_weight())
    }

    /// O_input, shape (m, m); zero unless stated.
    #[getter(O_input)]
    fn o_input<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        convert::sparse_to_array2(py, self.inner.offset_input_weight())
    }

    /// Prediction horizon N.
    #[getter]
    fn horizon(&self) -> usize {
        self.inner.prediction_horizon()
    }

    /// λ.
    #[getter]
    fn scaling(&self) -> f64 {
        self.inner.scaling()
    }

    /// "tracking" or "regulation".
    #[getter]
    fn task(&self) -> &'static str {
        match self.inner.task() {
            Task::Tracking => "tracking",
            Task::Regulation => "regulation",
        }
    }

    /// "implicit" or "explicit".
    #[getter]
    fn formulation(&self) -> &'static str {
        formulation_name(self.inner.formulation())
    }

    /// K when stated, shape (m, n), else None.
    #[getter]
    fn gain<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.inner
            .gain()
            .map(|k| convert::sparse_to_array2(py, k))
            .transpose()
    }

    /// The name.
    #[getter]
    fn name(&self) -> &str {
        self.inner.name()
    }

    /// Number of constraint rows.
    #[getter]
    fn rows(&self) -> usize {
        self.inner.rows().len()
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other
            .cast::<Self>()
            .is_ok_and(|o| o.get().inner == self.inner)
    }

    fn __repr__(&self) -> String {
        let p = &self.inner;
        let name = match p.name() {
            "" => String::new(),
            name => format!("name={name:?}, "),
        };
        format!(
            "Problem({name}states={}, inputs={}, rows={}, task='{}', formulation='{}', horizon={}, scaling={})",
            p.plant().states(),
            p.plant().inputs(),
            p.rows().len(),
            self.task(),
            self.formulation(),
            p.prediction_horizon(),
            p.scaling()
        )
    }

    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let rebuild = py.import("mpct._pickle")?.getattr("problem")?;
        Ok((rebuild, PyTuple::new(py, [self.to_toml()])?))
    }
}
