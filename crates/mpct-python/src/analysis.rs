//! Sets of states: outlines and the domain of attraction.

use crate::controller::PyController;
use crate::convert;
use crate::errors;
use crate::fork;
use crate::interrupt;
use mpct::DesignError;
use mpct::analysis::{DomainOfAttraction, Membership, Polygon, Reach, Volume};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// A polygon for Python.
pub fn polygon<'py>(py: Python<'py>, polygon: Polygon) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    fields.set_item("coordinates", polygon.coordinates)?;
    let vertices = polygon.vertices.iter().map(<[f64; 2]>::as_slice);
    fields.set_item("vertices", convert::rows_to_array2(py, 2, vertices)?)?;
    fields.set_item("gap", polygon.gap)?;
    fields.set_item("queries", polygon.queries)?;
    fields.set_item("area", polygon.area())?;
    convert::result(py, "Polygon", &fields)
}

/// A reach for Python.
pub fn reach(py: Python<'_>, reach: Reach) -> PyResult<Bound<'_, PyAny>> {
    let fields = PyDict::new(py);
    fields.set_item("distance", reach.distance)?;
    fields.set_item("at_most", reach.at_most)?;
    fields.set_item("state", convert::to_array(py, reach.state))?;
    convert::result(py, "Reach", &fields)
}

/// A volume for Python.
pub fn volume(py: Python<'_>, volume: Volume) -> PyResult<Bound<'_, PyAny>> {
    let fields = PyDict::new(py);
    fields.set_item("value", volume.value)?;
    fields.set_item("dimension", volume.dimension)?;
    fields.set_item("gap", volume.gap)?;
    fields.set_item("vertices", volume.vertices)?;
    fields.set_item("queries", volume.queries)?;
    convert::result(py, "Volume", &fields)
}

fn membership<'py>(py: Python<'py>, found: Membership) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    fields.set_item("inside", found.is_inside())?;
    match found {
        Membership::Inside { candidate, slack } => {
            fields.set_item("candidate", convert::to_array(py, candidate))?;
            fields.set_item("slack", slack)?;
        }
        Membership::Outside { gap, radius, rows } => {
            fields.set_item("gap", gap)?;
            fields.set_item("radius", radius)?;
            let rows: Vec<(String, f64)> =
                rows.into_iter().map(|(r, y)| (r.to_string(), y)).collect();
            fields.set_item("rows", rows)?;
        }
    }
    convert::result(py, "Membership", &fields)
}

/// The set of states for which a controller has an input: its domain of attraction.
///
/// For the formulation without terminal constraint it is the set of feasible states; what is attracted is
/// `StabilityRegion`.
///
/// Parameters
/// ----------
/// controller : Controller
///     The controller.
///
/// Examples
/// --------
/// >>> import mpct
/// >>> plant = mpct.Plant([[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]])
/// >>> problem = mpct.Problem(plant, state=(-3, 3), input=(-2, 2), Q=10, R=100, O=1e4)
/// >>> domain = mpct.DomainOfAttraction(problem.design().controller())
/// >>> domain.contains([-3, 3]).inside, domain.contains([3, 3]).inside
/// (True, False)
/// >>> round(domain.reach([1, 0]).distance, 6)
/// 3.0
#[pyclass(frozen, name = "DomainOfAttraction", module = "mpct")]
pub struct PyDomainOfAttraction {
    inner: Arc<DomainOfAttraction>,
    controller: Py<PyController>,
}

#[pymethods]
impl PyDomainOfAttraction {
    #[new]
    fn new(py: Python<'_>, controller: Py<PyController>) -> Self {
        let known = controller.get();
        let inner = fork::detached(py, || Arc::new(DomainOfAttraction::of(&known.lock())));
        Self { inner, controller }
    }

    /// Whether a state is in the domain, with a proof either way.
    ///
    /// Parameters
    /// ----------
    /// state : array_like, shape (n,)
    ///     The state.
    ///
    /// Returns
    /// -------
    /// Membership
    fn contains<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let state = convert::vector("state", state)?;
        membership(py, work(py, || self.inner.contains(&state))?)
    }

    /// How far the domain reaches in a direction.
    ///
    /// Parameters
    /// ----------
    /// direction : array_like, shape (n,)
    ///     The direction.
    /// state : array_like, shape (n,), optional
    ///     Where the ray begins; the operating point unless stated.
    ///
    /// Returns
    /// -------
    /// Reach
    #[pyo3(signature = (direction, state=None))]
    fn reach<'py>(
        &self,
        py: Python<'py>,
        direction: &Bound<'py, PyAny>,
        state: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let direction = convert::vector("direction", direction)?;
        let state = state.map(|x| convert::vector("state", x)).transpose()?;
        let found = work(py, || match &state {
            Some(state) => self.inner.reach_from(state, &direction),
            None => self.inner.reach(&direction),
        })?;
        self::reach(py, found)
    }

    /// The operating point's state, from which `reach` is measured, shape (n,).
    #[getter]
    fn origin<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.inner.origin())
    }

    /// Length, area or volume of the domain, for plants of up to three states.
    ///
    /// Returns
    /// -------
    /// Volume
    ///
    /// Raises
    /// ------
    /// DesignError
    ///     For more states, and when the domain is unbounded.
    fn volume<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let domain = Arc::clone(&self.inner);
        let found = long_work(py, move || domain.volume())?;
        self::volume(py, found)
    }

    /// The projection on two states: the pairs for which some values of the other states are in the domain.
    ///
    /// Parameters
    /// ----------
    /// coordinates : tuple of two int, default (0, 1)
    ///     The states.
    /// tolerance : float, optional
    ///     How far the set may reach beyond an edge, as a share of its half-widths; 1e-6 unless stated.
    ///
    /// Returns
    /// -------
    /// Polygon
    #[pyo3(signature = (coordinates=(0, 1), tolerance=None), text_signature = "($self, coordinates=(0, 1), tolerance=None)")]
    fn projection<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = convert::coordinates)] coordinates: (usize, usize),
        tolerance: Option<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let tolerance = tolerance.unwrap_or(mpct::analysis::OUTLINE);
        let domain = Arc::clone(&self.inner);
        let outline = long_work(py, move || domain.projection_within(coordinates, tolerance))?;
        polygon(py, outline)
    }

    /// The section through a state: the pairs that are in the domain while the other states stay as they are.
    ///
    /// Parameters
    /// ----------
    /// state : array_like, shape (n,)
    ///     The state.
    /// coordinates : tuple of two int, default (0, 1)
    ///     The states that vary.
    ///
    /// Returns
    /// -------
    /// Polygon
    #[pyo3(signature = (state, coordinates=(0, 1)), text_signature = "($self, state, coordinates=(0, 1))")]
    fn section<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = convert::coordinates)] coordinates: (usize, usize),
    ) -> PyResult<Bound<'py, PyAny>> {
        let state = convert::vector("state", state)?;
        let domain = Arc::clone(&self.inner);
        let outline = long_work(py, move || domain.section(&state, coordinates))?;
        polygon(py, outline)
    }

    fn __repr__(&self) -> &'static str {
        "DomainOfAttraction()"
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> (Bound<'py, PyAny>, (Py<PyController>,)) {
        let py = slf.py();
        let controller = slf.get().controller.clone_ref(py);
        (slf.get_type().into_any(), (controller,))
    }
}

/// Work on a design that may take long: Ctrl-C returns at once.
pub fn long_work<T: Send + 'static>(
    py: Python<'_>,
    of: impl FnOnce() -> Result<T, DesignError> + Send + 'static,
) -> PyResult<T> {
    long_answer(py, of)?.map_err(|e| errors::design(py, &e))
}

/// The same of work that cannot fail.
pub fn long_answer<T: Send + 'static>(
    py: Python<'_>,
    of: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    interrupt::leave(py, |_| of())
}

/// Work on a design without the GIL, too short for a thread of its own.
pub fn work<T: Send>(
    py: Python<'_>,
    of: impl FnOnce() -> Result<T, DesignError> + Send,
) -> PyResult<T> {
    fork::detached(py, of).map_err(|e| errors::design(py, &e))
}
