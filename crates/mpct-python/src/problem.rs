//! `mpct.Problem`.

use crate::controller::{self, Program, PyController};
use crate::convert;
use crate::design::{self, PyDesign};
use crate::errors;
use crate::fork;
use crate::names;
use crate::parts::{self, Choices};
use crate::plant::PyPlant;
use crate::search::Search;
use mpct::{Controller, Matrix, Problem, ProblemFile, Weights};
use numpy::{PyArray1, PyArray2};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};
use std::path::{Path, PathBuf};

/// A control problem: a plant, constraints, weights and a horizon.
///
/// Parameters
/// ----------
/// plant : Plant
///     The plant.
/// state, input : tuple of two array_like, optional
///     Lower and upper limits: vectors, or a number for all entries. ``None`` or infinities leave a side open.
/// mixed : tuple of three array_like, or list of such tuples, optional
///     (C, D, d): rows C x + D u ≤ d. ``None`` in place of C or D stands for zeros.
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
/// formulation : {"implicit", "explicit", "no_terminal_constraint"}
///     Whether the controller predicts M̃ more steps, uses the rows of the explicit terminal set, or does without
///     terminal constraint (section 3.5 of the paper).
/// terminal_cost : {"exact", "implicit"}
///     ‖x_N − x_s^a‖²_P, or the sum of remark 2.
/// horizon_extension : int, optional
///     M̄ of section 3.5; needed by "no_terminal_constraint", and only there.
/// gamma : float, optional
///     γ ≥ 1 of section 3.5, the factor of the terminal cost; 1 unless stated.
/// alpha : float, optional
///     α > 0 of section 3.5; the largest admissible one unless stated.
/// gain : array_like, shape (m, n), optional
///     K of the terminal law u = K x + L θ; that of the linear quadratic regulator unless stated.
/// name : str, optional
///     A name.
/// state_ellipsoid, input_ellipsoid : float or array_like, optional
///     E of (x − x_op)ᵀE(x − x_op) ≤ 1, or of the same of u: E = e I, diag(e) or a symmetric positive semidefinite matrix.
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
#[pyclass(frozen, name = "Problem", module = "mpct")]
pub struct PyProblem {
    pub inner: Problem,
    /// What `qp` asks, made at the first call.
    controller: PyOnceLock<Controller>,
}

impl From<Problem> for PyProblem {
    fn from(inner: Problem) -> Self {
        Self {
            inner,
            controller: PyOnceLock::new(),
        }
    }
}

/// K, when stated.
fn gain_of(gain: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Matrix>> {
    gain.map(|k| convert::matrix("gain", k)).transpose()
}

type Limits<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);
type Block<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

#[pymethods]
impl PyProblem {
    #[new]
    #[pyo3(signature = (plant, state=None, input=None, mixed=None, *, Q, R, O, O_input=None, horizon=10, scaling=0.9, task="tracking", formulation="implicit", terminal_cost="exact", horizon_extension=None, gamma=None, alpha=None, gain=None, name="", state_ellipsoid=None, input_ellipsoid=None))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        plant: PyRef<'_, PyPlant>,
        state: Option<Bound<'_, PyAny>>,
        input: Option<Bound<'_, PyAny>>,
        mixed: Option<Bound<'_, PyAny>>,
        Q: Bound<'_, PyAny>,
        R: Bound<'_, PyAny>,
        O: Bound<'_, PyAny>,
        O_input: Option<Bound<'_, PyAny>>,
        #[pyo3(from_py_with = convert::whole::horizon)] horizon: usize,
        scaling: f64,
        task: &str,
        formulation: &str,
        terminal_cost: &str,
        #[pyo3(from_py_with = convert::whole::horizon_extension)] horizon_extension: Option<usize>,
        gamma: Option<f64>,
        alpha: Option<f64>,
        gain: Option<Bound<'_, PyAny>>,
        name: &str,
        state_ellipsoid: Option<Bound<'_, PyAny>>,
        input_ellipsoid: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let plant = plant.inner.clone();
        let mut constraints =
            parts::constraints(py, &plant, state.as_ref(), input.as_ref(), mixed.as_ref())?;
        if let Some(e) = &state_ellipsoid {
            let e = parts::weight("state_ellipsoid", e)?;
            constraints = constraints
                .state_ellipsoid(e)
                .map_err(|e| errors::design(py, &e))?;
        }
        if let Some(e) = &input_ellipsoid {
            let e = parts::weight("input_ellipsoid", e)?;
            constraints = constraints
                .input_ellipsoid(e)
                .map_err(|e| errors::design(py, &e))?;
        }
        let mut weights = Weights::new(
            parts::weight("Q", &Q)?,
            parts::weight("R", &R)?,
            parts::weight("O", &O)?,
        );
        if let Some(o) = &O_input {
            weights = weights.with_offset_input(parts::weight("O_input", o)?);
        }
        let choices = Choices {
            name: name.into(),
            horizon,
            scaling,
            task: names::value(py, task)?,
            formulation: names::value(py, formulation)?,
            terminal_cost: names::value(py, terminal_cost)?,
            horizon_extension,
            gamma,
            alpha,
            gain: gain_of(gain.as_ref())?,
        };
        parts::assemble(py, plant, constraints, weights, choices).map(Self::from)
    }

    /// Reads the problem of a problem file; `ProblemFile.read` reads its simulation, too.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     A TOML file, as the command line reads it.
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
        let file = fork::detached(py, || ProblemFile::read(&path));
        Ok(file.map_err(|e| errors::file(py, &e))?.problem.into())
    }

    /// Reads the problem in the text of a problem file.
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
        let file = fork::detached(py, || ProblemFile::parse(text, Path::new(".")));
        Ok(file.map_err(|e| errors::file(py, &e))?.problem.into())
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
    /// state, input, mixed : optional
    ///     Constraints as in `Problem`; what is not stated stays, and so do ellipsoids.
    /// Q, R, O, O_input : float or array_like, optional
    ///     Weights.
    /// horizon, scaling, task, formulation, terminal_cost, horizon_extension, gamma, alpha, gain, name : optional
    ///     As in `Problem`. Another formulation than "no_terminal_constraint" drops the three that belong to it.
    ///
    /// Returns
    /// -------
    /// Problem
    #[pyo3(signature = (*, state=None, input=None, mixed=None, Q=None, R=None, O=None, O_input=None, horizon=None, scaling=None, task=None, formulation=None, terminal_cost=None, horizon_extension=None, gamma=None, alpha=None, gain=None, name=None))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn replace(
        &self,
        py: Python<'_>,
        state: Option<Bound<'_, PyAny>>,
        input: Option<Bound<'_, PyAny>>,
        mixed: Option<Bound<'_, PyAny>>,
        Q: Option<Bound<'_, PyAny>>,
        R: Option<Bound<'_, PyAny>>,
        O: Option<Bound<'_, PyAny>>,
        O_input: Option<Bound<'_, PyAny>>,
        #[pyo3(from_py_with = convert::whole::optional_horizon)] horizon: Option<usize>,
        scaling: Option<f64>,
        task: Option<&str>,
        formulation: Option<&str>,
        terminal_cost: Option<&str>,
        #[pyo3(from_py_with = convert::whole::horizon_extension)] horizon_extension: Option<usize>,
        gamma: Option<f64>,
        alpha: Option<f64>,
        gain: Option<Bound<'_, PyAny>>,
        name: Option<String>,
    ) -> PyResult<Self> {
        let old = &self.inner;
        let plant = old.plant().clone();
        let weight = |what: &str, new: Option<&Bound<'_, PyAny>>, old: &mpct::SparseMatrix| {
            new.map_or_else(|| Ok(old.clone().into()), |w| parts::weight(what, w))
        };
        let weights = Weights::new(
            weight("Q", Q.as_ref(), old.state_weight())?,
            weight("R", R.as_ref(), old.input_weight())?,
            weight("O", O.as_ref(), old.offset_weight())?,
        )
        .with_offset_input(weight(
            "O_input",
            O_input.as_ref(),
            old.offset_input_weight(),
        )?);
        let constraints = if state.is_none() && input.is_none() && mixed.is_none() {
            old.constraints().clone()
        } else {
            let state = state.map_or_else(|| self.state(py).into_bound_py_any(py), Ok)?;
            let input = input.map_or_else(|| self.input(py).into_bound_py_any(py), Ok)?;
            let mixed = match mixed {
                Some(mixed) => mixed,
                None => self.mixed(py)?.into_pyobject(py)?.into_any(),
            };
            parts::constraints(py, &plant, Some(&state), Some(&input), Some(&mixed))?
                .with_ellipsoids_of(old.constraints())
                .map_err(|e| errors::design(py, &e))?
        };
        let mut choices = Choices::of(old);
        if let Some(horizon) = horizon {
            choices.horizon = horizon;
        }
        choices.scaling = scaling.unwrap_or(choices.scaling);
        choices.name = name.unwrap_or(choices.name);
        if let Some(task) = task {
            choices.task = names::value(py, task)?;
        }
        if let Some(formulation) = formulation {
            choices.change_formulation(names::value(py, formulation)?);
        }
        if let Some(cost) = terminal_cost {
            choices.terminal_cost = names::value(py, cost)?;
        }
        choices.horizon_extension = horizon_extension.or(choices.horizon_extension);
        choices.gamma = gamma.or(choices.gamma);
        choices.alpha = alpha.or(choices.alpha);
        choices.gain = gain_of(gain.as_ref())?.or(choices.gain);
        parts::assemble(py, plant, constraints, weights, choices).map(Self::from)
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
        #[pyo3(from_py_with = convert::whole::max_horizon)] max_horizon: usize,
        time_limit: Option<f64>,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<PyDesign> {
        let search = Search::of(py, condition, max_horizon, time_limit, progress)?;
        design::design(py, &self.inner, search)
    }

    /// Designs the terminal ingredients for several scalings λ; what does not depend on λ is computed once.
    ///
    /// Parameters
    /// ----------
    /// scalings : sequence of float
    ///     Values of λ.
    /// condition, max_horizon, time_limit, progress : optional
    ///     As in `design`; the time limit holds for each scaling.
    ///
    /// Returns
    /// -------
    /// list of Design or DesignError
    ///     In the order of ``scalings``; what fails for one λ stands in its place.
    #[pyo3(signature = (scalings, condition="exact", max_horizon=5000, time_limit=None, progress=None))]
    fn design_all<'py>(
        &self,
        py: Python<'py>,
        scalings: &Bound<'py, PyAny>,
        condition: &str,
        #[pyo3(from_py_with = convert::whole::max_horizon)] max_horizon: usize,
        time_limit: Option<f64>,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let scalings = convert::vector("scalings", scalings)?;
        let search = Search::of(py, condition, max_horizon, time_limit, progress)?;
        design::design_all(py, &self.inner, &scalings, search)
    }

    /// The quadratic program of a controller's step, for other solvers: min ½ zᵀ H z + fᵀ z subject to G z ≤ b.
    ///
    /// The first call designs the controller. `Controller.qp` says more.
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
    /// Examples
    /// --------
    /// >>> import mpct
    /// >>> plant = mpct.Plant([[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]])
    /// >>> problem = mpct.Problem(plant, state=(-3, 3), input=(-2, 2), Q=10, R=100, O=1e4)
    /// >>> H, f, G, b = problem.qp([0, 0], [2, 0.5])
    /// >>> H.shape, G.shape[0] == b.shape[0]
    /// ((22, 22), True)
    #[pyo3(signature = (x, set_point, input=None))]
    fn qp<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        set_point: &Bound<'py, PyAny>,
        input: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Program<'py>> {
        let x = convert::vector("x", x)?;
        let set_point = controller::set_point(set_point, input)?;
        let controller = self.controller.get_or_try_init(py, || {
            let search = Search::of(py, "exact", 5000, None, None)?;
            let design = design::design(py, &self.inner, search)?;
            PyController::of(py, &design, self.inner.formulation())
        })?;
        let qp = fork::detached(py, || controller.qp(&x, &set_point))
            .map_err(|e| errors::step(py, &e))?;
        controller::program(py, qp)
    }

    /// Checks the assumptions of the method without searching the terminal horizon.
    ///
    /// Returns
    /// -------
    /// Assumption
    ///     Its spectral radius and basis of the steady states.
    ///
    /// Raises
    /// ------
    /// DesignError
    ///     When (A, B) is not stabilizable, A + B K not Schur, or a direction is free of constraints.
    fn check<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let found = fork::detached(py, || mpct::terminal::check_assumption(&self.inner))
            .map_err(|e| errors::design(py, &e))?;
        let fields = PyDict::new(py);
        fields.set_item("spectral_radius", found.spectral_radius)?;
        let basis = design::steady_state_basis(py, &found.steady_states)?;
        fields.set_item("steady_state_basis", basis)?;
        convert::result(py, "Assumption", &fields)
    }

    /// The admissible steady state closest to a set-point in the offset cost; no design is needed.
    ///
    /// Parameters
    /// ----------
    /// set_point : array_like, shape (n,)
    ///     State of the set-point.
    /// input : array_like, shape (m,), optional
    ///     Input of the set-point.
    ///
    /// Returns
    /// -------
    /// AdmissibleSetPoint
    #[pyo3(signature = (set_point, input=None))]
    fn closest_admissible<'py>(
        &self,
        py: Python<'py>,
        set_point: &Bound<'py, PyAny>,
        input: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let set_point = controller::set_point(set_point, input)?;
        let inner = fork::detached(py, || {
            mpct::terminal::check_assumption(&self.inner)?
                .steady_states
                .closest_admissible(&self.inner, &set_point)
        })
        .map_err(|e| errors::design(py, &e))?;
        controller::closest(py, inner)
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

    /// Blocks (C, D, d) of rows C x + D u ≤ d.
    #[getter]
    fn mixed<'py>(&self, py: Python<'py>) -> PyResult<Vec<Block<'py>>> {
        let blocks = self.inner.constraints().mixed_rows();
        blocks
            .iter()
            .map(|rows| {
                Ok((
                    convert::sparse_to_array2(py, &rows.c)?,
                    convert::sparse_to_array2(py, &rows.d)?,
                    convert::to_array(py, rows.bound.clone()),
                ))
            })
            .collect()
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
        names::word(self.inner.task())
    }

    /// "implicit", "explicit" or "no_terminal_constraint".
    #[getter]
    fn formulation(&self) -> &'static str {
        names::word(self.inner.formulation())
    }

    /// "exact" or "implicit".
    #[getter]
    fn terminal_cost(&self) -> &'static str {
        names::word(self.inner.terminal_cost())
    }

    /// M̄ of section 3.5, or None.
    #[getter]
    fn horizon_extension(&self) -> Option<usize> {
        Choices::of(&self.inner).horizon_extension
    }

    /// γ of section 3.5, or None.
    #[getter]
    fn gamma(&self) -> Option<f64> {
        Choices::of(&self.inner).gamma
    }

    /// α of section 3.5 when stated, or None.
    #[getter]
    fn alpha(&self) -> Option<f64> {
        Choices::of(&self.inner).alpha
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

    /// The constraints around the operating point, each row divided by its room there.
    ///
    /// Returns
    /// -------
    /// ConstraintRows
    fn constraint_rows<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rows = self.inner.rows();
        let source: Vec<String> = rows.source.iter().map(ToString::to_string).collect();
        let fields = PyDict::new(py);
        fields.set_item("C", convert::sparse_to_array2(py, &rows.c)?)?;
        fields.set_item("D", convert::sparse_to_array2(py, &rows.d)?)?;
        fields.set_item("scale", convert::to_array(py, rows.scale.clone()))?;
        fields.set_item("source", source)?;
        convert::result(py, "ConstraintRows", &fields)
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
