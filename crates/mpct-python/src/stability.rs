//! Section 3.5: the largest α, and the stability region of a controller without terminal constraint.

use crate::analysis::{self, long_work, polygon};
use crate::controller::{self, PyController};
use crate::convert;
use crate::design::PyDesign;
use crate::names;
use mpct::analysis::{AlphaBounds, AlphaScope, Attraction, StabilityRegion};
use mpct::{Controller, DesignError, SetPoint};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::Arc;

/// State and input of a set-point as arguments.
fn set_point_arguments<'py>(
    py: Python<'py>,
    set_point: &SetPoint,
) -> PyResult<[Bound<'py, PyAny>; 2]> {
    Ok([
        set_point.state.clone().into_bound_py_any(py)?,
        set_point.input.clone().into_bound_py_any(py)?,
    ])
}

/// The largest α of section 3.5 for each scope, and the row that limits it.
///
/// Parameters
/// ----------
/// design : Design
///     A design whose problem has the formulation "no_terminal_constraint".
/// set_point : array_like, shape (n,)
///     State of the set-point.
/// input : array_like, shape (m,), optional
///     Input of the set-point.
#[pyclass(frozen, name = "AlphaBounds", module = "mpct")]
pub struct PyAlphaBounds {
    inner: AlphaBounds,
    design: PyDesign,
    set_point: SetPoint,
}

#[pymethods]
impl PyAlphaBounds {
    #[new]
    #[pyo3(signature = (design, set_point, input=None))]
    fn new(
        py: Python<'_>,
        design: PyRef<'_, PyDesign>,
        set_point: &Bound<'_, PyAny>,
        input: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let set_point = controller::set_point(set_point, input)?;
        let design = design.clone();
        let (ingredients, at) = (design.inner.clone(), set_point.clone());
        let inner = long_work(py, move || AlphaBounds::of(&ingredients, &at))?;
        Ok(Self {
            inner,
            design,
            set_point,
        })
    }

    /// The largest α.
    ///
    /// Parameters
    /// ----------
    /// scope : {"every_equilibrium", "throughout_region", "around_set_point"}
    ///     For which artificial set-points the level set has to lie in the constraints.
    ///
    /// Returns
    /// -------
    /// float
    #[pyo3(signature = (scope="every_equilibrium"))]
    fn largest(&self, py: Python<'_>, scope: &str) -> PyResult<f64> {
        Ok(self.inner.largest(names::value(py, scope)?))
    }

    /// The row that limits it.
    ///
    /// Parameters
    /// ----------
    /// scope : {"every_equilibrium", "throughout_region", "around_set_point"}
    ///     As in `largest`.
    ///
    /// Returns
    /// -------
    /// str
    #[pyo3(signature = (scope="every_equilibrium"))]
    fn limiting(&self, py: Python<'_>, scope: &str) -> PyResult<String> {
        Ok(self.inner.limiting(names::value(py, scope)?).to_string())
    }

    /// κ = λ_min(P⁻¹Q), in (0, 1]: d = κ α.
    #[getter]
    fn stage_cost_ratio(&self) -> f64 {
        self.inner.stage_cost_ratio
    }

    fn __repr__(&self) -> String {
        format!(
            "AlphaBounds(every_equilibrium={:.6}, throughout_region={:.6}, around_set_point={:.6})",
            self.inner.largest(AlphaScope::EveryEquilibrium),
            self.inner.largest(AlphaScope::ThroughoutRegion),
            self.inner.largest(AlphaScope::AroundSetPoint)
        )
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, known) = (slf.py(), slf.get());
        let mut arguments = vec![Bound::new(py, known.design.clone())?.into_any()];
        arguments.extend(set_point_arguments(py, &known.set_point)?);
        Ok((slf.get_type().into_any(), convert::tuple(py, arguments)?))
    }
}

/// The stability region of a controller without terminal constraint, for one set-point (section 3.5).
///
/// Parameters
/// ----------
/// controller : Controller
///     A controller of the formulation "no_terminal_constraint".
/// set_point : array_like, shape (n,)
///     State of the set-point.
/// scope : {"every_equilibrium", "throughout_region", "around_set_point"}
///     For which artificial set-points α is checked.
/// input : array_like, shape (m,), optional
///     Input of the set-point.
///
/// Examples
/// --------
/// >>> import mpct
/// >>> plant = mpct.Plant([[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]])
/// >>> problem = mpct.Problem(plant, state=(-3, 3), input=(-2, 2), Q=10, R=100, O=1e4, horizon=3,
/// ...                        formulation="no_terminal_constraint", horizon_extension=2, gamma=20)
/// >>> region = mpct.StabilityRegion(problem.design().controller(), [0, 0])
/// >>> region.contains([0.1, 0]).inside
/// True
#[pyclass(frozen, name = "StabilityRegion", module = "mpct")]
pub struct PyStabilityRegion {
    /// Its own, so that steps of the one it was made from need not wait.
    controller: Arc<Controller>,
    made_from: Py<PyController>,
    set_point: SetPoint,
    scope: AlphaScope,
    alpha: f64,
    stage_cost_bound: f64,
    level: f64,
}

impl PyStabilityRegion {
    fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        question: impl FnOnce(&StabilityRegion<'_>) -> Result<T, DesignError> + Send + 'static,
    ) -> PyResult<T> {
        let controller = Arc::clone(&self.controller);
        let (set_point, scope) = (self.set_point.clone(), self.scope);
        long_work(py, move || {
            question(&StabilityRegion::of(&controller, &set_point, scope)?)
        })
    }
}

#[pymethods]
impl PyStabilityRegion {
    #[new]
    #[pyo3(signature = (controller, set_point, scope="every_equilibrium", input=None))]
    fn new(
        py: Python<'_>,
        controller: Py<PyController>,
        set_point: &Bound<'_, PyAny>,
        scope: &str,
        input: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let set_point = controller::set_point(set_point, input)?;
        let scope: AlphaScope = names::value(py, scope)?;
        let own = Arc::new(controller.get().again(py)?);
        let (asked, at) = (Arc::clone(&own), set_point.clone());
        let (alpha, stage_cost_bound, level) = long_work(py, move || {
            let region = StabilityRegion::of(&asked, &at, scope)?;
            Ok((region.alpha(), region.stage_cost_bound(), region.level()))
        })?;
        Ok(Self {
            controller: own,
            made_from: controller,
            set_point,
            scope,
            alpha,
            stage_cost_bound,
            level,
        })
    }

    /// Whether a state is in the region, and by how much.
    ///
    /// Parameters
    /// ----------
    /// state : array_like, shape (n,)
    ///     The state.
    ///
    /// Returns
    /// -------
    /// Attraction
    fn contains<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let state = convert::vector("state", state)?;
        let found: Attraction = self.ask(py, move |region| region.contains(&state))?;
        let fields = PyDict::new(py);
        fields.set_item("inside", found.is_inside())?;
        fields.set_item("cost", found.cost)?;
        fields.set_item("level", found.level)?;
        fields.set_item("as_printed", found.as_printed)?;
        convert::result(py, "Attraction", &fields)
    }

    /// How far the region reaches in a direction.
    ///
    /// Parameters
    /// ----------
    /// direction : array_like, shape (n,)
    ///     The direction.
    /// state : array_like, shape (n,), optional
    ///     Where the ray begins, a state inside the region; the closest admissible set-point unless stated.
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
        let found = self.ask(py, move |region| match &state {
            Some(state) => region.reach_from(state, &direction),
            None => region.reach(&direction),
        })?;
        analysis::reach(py, found)
    }

    /// Length, area or volume of the region, for plants of up to three states. Its boundary is curved, and the hull of
    /// points of it is what is measured.
    ///
    /// Returns
    /// -------
    /// Volume
    ///
    /// Raises
    /// ------
    /// DesignError
    ///     For more states.
    fn volume<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        analysis::volume(py, self.ask(py, |region| region.volume())?)
    }

    /// The projection on two states.
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
    fn projection<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = convert::coordinates)] coordinates: (usize, usize),
    ) -> PyResult<Bound<'py, PyAny>> {
        polygon(
            py,
            self.ask(py, move |region| region.projection(coordinates))?,
        )
    }

    /// The section through the closest admissible set-point.
    ///
    /// Parameters
    /// ----------
    /// coordinates : tuple of two int, default (0, 1)
    ///     The states that vary.
    ///
    /// Returns
    /// -------
    /// Polygon
    #[pyo3(signature = (coordinates=(0, 1)), text_signature = "($self, coordinates=(0, 1))")]
    fn section<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = convert::coordinates)] coordinates: (usize, usize),
    ) -> PyResult<Bound<'py, PyAny>> {
        polygon(py, self.ask(py, move |region| region.section(coordinates))?)
    }

    /// α.
    #[getter]
    fn alpha(&self) -> f64 {
        self.alpha
    }

    /// d = α λ_min(P⁻¹Q): outside of the level set the stage cost is at least this.
    #[getter]
    fn stage_cost_bound(&self) -> f64 {
        self.stage_cost_bound
    }

    /// (N + M̄) d + γ α.
    #[getter]
    fn level(&self) -> f64 {
        self.level
    }

    /// For which artificial set-points α was checked.
    #[getter]
    fn scope(&self) -> &'static str {
        names::word(self.scope)
    }

    fn __repr__(&self) -> String {
        format!(
            "StabilityRegion(alpha={:.6}, level={:.6}, scope='{}')",
            self.alpha,
            self.level,
            self.scope()
        )
    }
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, known) = (slf.py(), slf.get());
        let [state, input] = set_point_arguments(py, &known.set_point)?;
        let made_from = known.made_from.clone_ref(py).into_bound(py).into_any();
        let scope = known.scope().into_bound_py_any(py)?;
        let arguments = convert::tuple(py, vec![made_from, state, scope, input])?;
        Ok((slf.get_type().into_any(), arguments))
    }
}
