//! `mpct.Design`.

use crate::analysis;
use crate::controller::{self, PyController};
use crate::convert;
use crate::errors;
use crate::fork;
use crate::names;
use crate::problem::PyProblem;
use crate::search::Search;
use mpct::certificate::Certificate;
use mpct::{
    ImplicitTerminalCost, MaximalAdmissibleSet, Problem, SteadyStates, TerminalIngredients,
};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::collections::BTreeMap;

/// The terminal ingredients of a controller. Made by `Problem.design`.
///
/// A pickle of it has the problem and the options; unpickling does the design again.
#[pyclass(frozen, name = "Design", module = "mpct")]
#[derive(Clone)]
pub struct PyDesign {
    pub inner: TerminalIngredients,
    max_horizon: usize,
}

/// The ingredients of one problem.
pub fn design(py: Python<'_>, problem: &Problem, search: Search<'_>) -> PyResult<PyDesign> {
    let inner = search
        .run(py, |options| TerminalIngredients::design(problem, options))?
        .map_err(|e| errors::design(py, &e))?;
    Ok(PyDesign {
        inner,
        max_horizon: search.max_horizon,
    })
}

/// The ingredients for several scalings; an exception stands where one failed.
pub fn design_all<'py>(
    py: Python<'py>,
    problem: &Problem,
    scalings: &[f64],
    search: Search<'py>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let designs = search
        .run(py, |options| {
            TerminalIngredients::design_all(problem, scalings, options)
        })?
        .map_err(|e| errors::design(py, &e))?;
    designs
        .into_iter()
        .map(|one| match one {
            Ok(inner) => {
                let max_horizon = search.max_horizon;
                Ok(Bound::new(py, PyDesign { inner, max_horizon })?.into_any())
            }
            Err(e) => Ok(errors::design(py, &e)
                .into_value(py)
                .into_bound(py)
                .into_any()),
        })
        .collect()
}

/// M_θ as one matrix.
pub fn steady_state_basis<'py>(
    py: Python<'py>,
    basis: &SteadyStates,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (x, u) = (
        basis.state_basis().to_dense(),
        basis.input_basis().to_dense(),
    );
    let rows = (0..x.rows())
        .map(|i| x.row(i))
        .chain((0..u.rows()).map(|i| u.row(i)));
    convert::rows_to_array2(py, u.cols(), rows)
}

impl PyDesign {
    fn explicit_set(&self, py: Python<'_>) -> PyResult<MaximalAdmissibleSet> {
        let inner = self.inner.clone();
        analysis::long_work(py, move || inner.maximal_admissible_set())
    }
}

#[pymethods]
impl PyDesign {
    /// The problem.
    #[getter]
    fn problem(&self) -> PyProblem {
        self.inner.problem().clone().into()
    }

    /// M̃, or M for regulation: the steps of the terminal law after which no constraint can be violated first.
    #[getter]
    fn terminal_horizon(&self) -> usize {
        self.inner.terminal_horizon()
    }

    /// "exact" or "sufficient".
    #[getter]
    fn condition(&self) -> String {
        self.inner.condition().to_string()
    }

    /// K of the terminal law u = K x + L θ, shape (m, n).
    #[getter]
    fn gain<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        convert::sparse_to_array2(py, self.inner.gain())
    }

    /// P, shape (n, n).
    #[getter]
    fn terminal_weight<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        convert::sparse_to_array2(py, self.inner.terminal_weight())
    }

    /// ρ, the spectral radius of A + B K.
    #[getter]
    fn spectral_radius(&self) -> f64 {
        self.inner.spectral_radius()
    }

    /// M_θ, shape (n + m, m): the steady states are (x_s, u_s) = M_θ θ around the operating point.
    #[getter]
    fn steady_state_basis<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        steady_state_basis(py, self.inner.steady_states())
    }

    /// The first step at which each constraint row is implied by the steps before it: a list of (row, step).
    #[getter]
    fn spent_steps(&self) -> Vec<(String, usize)> {
        self.inner
            .spent_steps()
            .into_iter()
            .map(|(row, step)| (row.to_string(), step))
            .collect()
    }

    /// Constraint rows of the terminal set at each step.
    #[getter]
    fn rows(&self) -> usize {
        self.inner.constraint_rows()
    }

    /// Linear programs solved.
    #[getter]
    fn linear_programs(&self) -> usize {
        self.inner.linear_programs()
    }

    /// Seconds that the design took.
    #[getter]
    fn seconds(&self) -> f64 {
        self.inner.elapsed().as_secs_f64()
    }

    /// Where those seconds went: "law" (K and P), "steady_states", "rows" and "programs".
    #[getter]
    fn phases(&self) -> BTreeMap<&'static str, f64> {
        let phases = self.inner.phases();
        BTreeMap::from([
            ("law", phases.law.as_secs_f64()),
            ("steady_states", phases.steady_states.as_secs_f64()),
            ("rows", phases.rows.as_secs_f64()),
            ("programs", phases.programs.as_secs_f64()),
        ])
    }

    /// The explicit terminal set without redundant rows.
    ///
    /// Returns
    /// -------
    /// G : ndarray, shape (rows, n + m) for tracking, (rows, n) for regulation
    ///     Its columns are (x, θ), with x measured from the operating point.
    /// g : ndarray, shape (rows,)
    ///     The set is {(x, θ) : G (x, θ) ≤ g}.
    #[allow(clippy::type_complexity)]
    fn terminal_set<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>)> {
        let set = self.explicit_set(py)?;
        Ok((
            convert::sparse_to_array2(py, set.rows())?,
            convert::to_array(py, vec![1.0; set.len()]),
        ))
    }

    /// The explicit terminal set, with where each of its rows comes from.
    ///
    /// Returns
    /// -------
    /// MaximalAdmissibleSet
    fn maximal_admissible_set<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let set = self.explicit_set(py)?;
        let sources = &self.inner.problem().rows().source;
        let origin: Vec<(String, Option<usize>)> = (0..set.len())
            .map(|k| set.origin(k))
            .map(|(row, step)| (sources[row].to_string(), step))
            .collect();
        let fields = PyDict::new(py);
        fields.set_item("G", convert::sparse_to_array2(py, set.rows())?)?;
        fields.set_item("g", convert::to_array(py, vec![1.0; set.len()]))?;
        fields.set_item("states", set.states())?;
        fields.set_item("origin", origin)?;
        convert::result(py, "MaximalAdmissibleSet", &fields)
    }

    /// A controller.
    ///
    /// Parameters
    /// ----------
    /// formulation : {"implicit", "explicit", "no_terminal_constraint"}, optional
    ///     That of the problem unless stated.
    ///
    /// Returns
    /// -------
    /// Controller
    #[pyo3(signature = (formulation=None))]
    fn controller(&self, py: Python<'_>, formulation: Option<&str>) -> PyResult<PyController> {
        let formulation = match formulation {
            Some(name) => names::value(py, name)?,
            None => self.inner.problem().formulation(),
        };
        let inner = PyController::of(py, self, formulation)?;
        Ok(PyController::new(inner, self.clone(), formulation))
    }

    /// The outline of the terminal set in two states: the pairs at which some artificial set-point and some values of
    /// the other states satisfy the terminal constraint.
    ///
    /// Parameters
    /// ----------
    /// coordinates : tuple of two int, default (0, 1)
    ///     The states.
    ///
    /// Returns
    /// -------
    /// Polygon
    #[pyo3(signature = (coordinates=(0, 1)), text_signature = "($self, coordinates=(0, 1))")]
    fn terminal_set_outline<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = convert::coordinates)] coordinates: (usize, usize),
    ) -> PyResult<Bound<'py, PyAny>> {
        let inner = self.inner.clone();
        let polygon = analysis::long_work(py, move || {
            mpct::analysis::terminal_set(&inner, coordinates)
        })?;
        analysis::polygon(py, polygon)
    }

    /// A proof of the design that `verify` checks with code that shares nothing with the search.
    ///
    /// Returns
    /// -------
    /// str
    ///     JSON, as ``mpct design --certificate`` writes it.
    fn certificate(&self, py: Python<'_>) -> PyResult<String> {
        let inner = self.inner.clone();
        analysis::long_work(py, move || Certificate::of(&inner).map(|c| c.to_json()))
    }

    /// The implicit terminal cost of remark 2 for this M̃.
    ///
    /// Returns
    /// -------
    /// ImplicitTerminalCost
    fn implicit_terminal_cost<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let inner = self.inner.clone();
        let cost = analysis::long_work(py, move || ImplicitTerminalCost::of(&inner))?;
        let fields = PyDict::new(py);
        fields.set_item("epsilon", cost.epsilon())?;
        fields.set_item("weight", convert::sparse_to_array2(py, &cost.weight())?)?;
        convert::result(py, "ImplicitTerminalCost", &fields)
    }

    /// The admissible steady state closest to a set-point in the offset cost.
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
            self.inner
                .steady_states()
                .closest_admissible(self.inner.problem(), &set_point)
        })
        .map_err(|e| errors::design(py, &e))?;
        controller::closest(py, inner)
    }

    fn __repr__(&self) -> String {
        format!(
            "Design(M̃={}, ρ={:.6}, rows={}, linear_programs={}, seconds={:.3})",
            self.terminal_horizon(),
            self.spectral_radius(),
            self.rows(),
            self.linear_programs(),
            self.seconds()
        )
    }

    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let rebuild = py.import("mpct._pickle")?.getattr("design")?;
        let options = PyDict::new(py);
        options.set_item("condition", self.condition())?;
        options.set_item("max_horizon", self.max_horizon)?;
        let problem = Bound::new(py, self.problem())?;
        Ok((
            rebuild,
            convert::tuple(py, vec![problem.into_any(), options.into_any()])?,
        ))
    }
}
