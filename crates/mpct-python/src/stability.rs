//! Section 3.5: the largest α, and the stability region of a controller without terminal constraint.

use crate::analysis::{polygon, work};
use crate::controller::{self, PyController};
use crate::convert;
use crate::design::PyDesign;
use crate::names;
use mpct::analysis::{AlphaBounds, AlphaScope, Attraction, StabilityRegion};
use mpct::{Controller, DesignError, SetPoint};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

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
        let inner = work(py, || AlphaBounds::of(&design.inner, &set_point))?;
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
    controller: Controller,
    made_from: Py<PyController>,
    set_point: SetPoint,
    scope: AlphaScope,
    alpha: f64,
    level: f64,
}

impl PyStabilityRegion {
    fn ask<T: Send>(
        &self,
        py: Python<'_>,
        question: impl FnOnce(&StabilityRegion<'_>) -> Result<T, DesignError> + Send,
    ) -> PyResult<T> {
        work(py, || {
            question(&StabilityRegion::of(
                &self.controller,
                &self.set_point,
                self.scope,
            )?)
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
        let own = controller.get().again(py)?;
        let (alpha, level) = work(py, || {
            let region = StabilityRegion::of(&own, &set_point, scope)?;
            Ok((region.alpha(), region.level()))
        })?;
        Ok(Self {
            controller: own,
            made_from: controller,
            set_point,
            scope,
            alpha,
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
        let found: Attraction = self.ask(py, |region| region.contains(&state))?;
        let fields = PyDict::new(py);
        fields.set_item("inside", found.is_inside())?;
        fields.set_item("cost", found.cost)?;
        fields.set_item("level", found.level)?;
        fields.set_item("as_printed", found.as_printed)?;
        convert::result(py, "Attraction", &fields)
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
        coordinates: (i64, i64),
    ) -> PyResult<Bound<'py, PyAny>> {
        let coordinates = convert::coordinates(py, coordinates)?;
        polygon(py, self.ask(py, |region| region.projection(coordinates))?)
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
        coordinates: (i64, i64),
    ) -> PyResult<Bound<'py, PyAny>> {
        let coordinates = convert::coordinates(py, coordinates)?;
        polygon(py, self.ask(py, |region| region.section(coordinates))?)
    }

    /// α.
    #[getter]
    fn alpha(&self) -> f64 {
        self.alpha
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
