//! `mpct.Plant`.

use crate::convert;
use crate::errors;
use crate::fork;
use mpct::{DesignError, Labels, Plant};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyTuple};

/// A linear plant x⁺ = A x + B u.
///
/// Parameters
/// ----------
/// A : array_like, shape (n, n), or a state-space model
///     State matrix. A discrete-time model with attributes ``A``, ``B`` and ``dt``, such as ``control.StateSpace``,
///     may stand here alone; ``C`` and ``D`` of it have no part in the control problem.
/// B : array_like, shape (n, m), optional
///     Input matrix.
/// sampling_time : float, optional
///     Sampling time in seconds.
/// operating_point : tuple of two array_like, optional
///     State and input around which the plant is linear; the origin unless stated.
/// state_names, state_units, input_names, input_units : list of str, optional
///     Labels.
///
/// Raises
/// ------
/// DesignError
///     When shapes do not fit or an entry is not finite.
///
/// Examples
/// --------
/// >>> import mpct
/// >>> mpct.Plant([[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]])
/// Plant(states=2, inputs=2)
#[pyclass(frozen, name = "Plant", module = "mpct")]
#[derive(Clone)]
pub struct PyPlant {
    pub inner: Plant,
}

struct Extras {
    operating_point: Option<(Vec<f64>, Vec<f64>)>,
    labels: Labels,
}

fn finished(
    py: Python<'_>,
    plant: Result<Plant, DesignError>,
    extras: Extras,
) -> PyResult<PyPlant> {
    let wrong = |e: DesignError| errors::design(py, &e);
    let mut plant = plant.map_err(wrong)?;
    if let Some((x, u)) = extras.operating_point {
        plant = plant.with_operating_point(x, u).map_err(wrong)?;
    }
    let inner = plant.with_labels(extras.labels).map_err(wrong)?;
    Ok(PyPlant { inner })
}

/// A and B of a state-space model, and its sampling time: 0 in continuous time, `None` when not stated.
type Model<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Option<f64>);

fn model<'py>(system: &Bound<'py, PyAny>) -> PyResult<Model<'py>> {
    let (Ok(a), Ok(b)) = (system.getattr("A"), system.getattr("B")) else {
        return Err(errors::argument_type(
            system.py(),
            "A",
            "matrices A and B, or one state-space model with attributes A, B and dt",
            &format!("{} alone", system.get_type()),
        ));
    };
    let dt = match system.getattr("dt") {
        Ok(dt) if !dt.is_none() && !dt.is_instance_of::<PyBool>() => Some(dt.extract()?),
        _ => None,
    };
    Ok((a, b, dt))
}

#[pymethods]
impl PyPlant {
    #[new]
    #[pyo3(signature = (A, B=None, *, sampling_time=None, operating_point=None, state_names=None, state_units=None, input_names=None, input_units=None))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        A: Bound<'_, PyAny>,
        B: Option<Bound<'_, PyAny>>,
        sampling_time: Option<f64>,
        #[pyo3(from_py_with = convert::operating_point)] operating_point: Option<(
            Vec<f64>,
            Vec<f64>,
        )>,
        state_names: Option<Bound<'_, PyAny>>,
        state_units: Option<Bound<'_, PyAny>>,
        input_names: Option<Bound<'_, PyAny>>,
        input_units: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (a, b, dt) = match B {
            Some(b) => (A, b, None),
            None => model(&A)?,
        };
        if dt == Some(0.0) {
            return Err(errors::argument(
                py,
                "A",
                "a model in discrete time",
                "one in continuous time (dt = 0): use Plant.continuous(model, dt=...)",
            ));
        }
        let mut plant = Plant::discrete(convert::matrix("A", &a)?, convert::matrix("B", &b)?);
        if let Some(dt) = sampling_time.or(dt) {
            plant = plant.and_then(|p| p.with_sampling_time(dt));
        }
        let labels = Labels {
            state_names: convert::texts("state_names", state_names.as_ref())?,
            state_units: convert::texts("state_units", state_units.as_ref())?,
            input_names: convert::texts("input_names", input_names.as_ref())?,
            input_units: convert::texts("input_units", input_units.as_ref())?,
        };
        finished(
            py,
            plant,
            Extras {
                operating_point,
                labels,
            },
        )
    }

    /// A plant given in continuous time, discretised with a zero-order hold.
    ///
    /// Parameters
    /// ----------
    /// A : array_like, shape (n, n), or a state-space model
    ///     State matrix of ẋ = A x + B u, or a continuous-time model with attributes ``A``, ``B`` and ``dt``.
    /// B : array_like, shape (n, m), optional
    ///     Input matrix.
    /// dt : float
    ///     Sampling time in seconds.
    /// operating_point, state_names, state_units, input_names, input_units
    ///     As in `Plant`.
    ///
    /// Returns
    /// -------
    /// Plant
    #[staticmethod]
    #[pyo3(signature = (A, B=None, dt=None, *, operating_point=None, state_names=None, state_units=None, input_names=None, input_units=None))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn continuous(
        py: Python<'_>,
        A: Bound<'_, PyAny>,
        B: Option<Bound<'_, PyAny>>,
        dt: Option<f64>,
        #[pyo3(from_py_with = convert::operating_point)] operating_point: Option<(
            Vec<f64>,
            Vec<f64>,
        )>,
        state_names: Option<Bound<'_, PyAny>>,
        state_units: Option<Bound<'_, PyAny>>,
        input_names: Option<Bound<'_, PyAny>>,
        input_units: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (a, b) = match B {
            Some(b) => (A, b),
            None => match model(&A)? {
                (a, b, None | Some(0.0)) => (a, b),
                _ => {
                    return Err(errors::argument(
                        py,
                        "A",
                        "a model in continuous time",
                        "one in discrete time: use Plant(model)",
                    ));
                }
            },
        };
        let dt = dt.ok_or_else(|| {
            errors::argument_type(py, "dt", "the sampling time in seconds", "none")
        })?;
        let (a, b) = (convert::matrix("A", &a)?, convert::matrix("B", &b)?);
        let plant = fork::detached(py, || Plant::continuous(a, b, dt));
        let labels = Labels {
            state_names: convert::texts("state_names", state_names.as_ref())?,
            state_units: convert::texts("state_units", state_units.as_ref())?,
            input_names: convert::texts("input_names", input_names.as_ref())?,
            input_units: convert::texts("input_units", input_units.as_ref())?,
        };
        finished(
            py,
            plant,
            Extras {
                operating_point,
                labels,
            },
        )
    }

    /// A of the discrete-time plant, shape (n, n).
    #[getter(A)]
    fn a<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        convert::sparse_to_array2(py, self.inner.a())
    }

    /// B of the discrete-time plant, shape (n, m).
    #[getter(B)]
    fn b<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        convert::sparse_to_array2(py, self.inner.b())
    }

    /// A and B in continuous time, when the plant was given so, else None.
    #[getter]
    #[allow(clippy::type_complexity)]
    fn continuous_matrices<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)>> {
        self.inner
            .continuous_matrices()
            .map(|(a, b)| {
                Ok((
                    convert::sparse_to_array2(py, a)?,
                    convert::sparse_to_array2(py, b)?,
                ))
            })
            .transpose()
    }

    /// Number of states n.
    #[getter]
    fn states(&self) -> usize {
        self.inner.states()
    }

    /// Number of inputs m.
    #[getter]
    fn inputs(&self) -> usize {
        self.inner.inputs()
    }

    /// Sampling time in seconds, or None.
    #[getter]
    fn sampling_time(&self) -> Option<f64> {
        self.inner.sampling_time()
    }

    /// State and input around which the plant is linear.
    #[getter]
    #[allow(clippy::type_complexity)]
    fn operating_point<'py>(
        &self,
        py: Python<'py>,
    ) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>) {
        let at = self.inner.operating_point();
        (
            convert::to_array(py, at.state.clone()),
            convert::to_array(py, at.input.clone()),
        )
    }

    /// Names of the states; empty unless stated.
    #[getter]
    fn state_names(&self) -> Vec<String> {
        self.inner.labels().state_names.clone()
    }

    /// Units of the states; empty unless stated.
    #[getter]
    fn state_units(&self) -> Vec<String> {
        self.inner.labels().state_units.clone()
    }

    /// Names of the inputs; empty unless stated.
    #[getter]
    fn input_names(&self) -> Vec<String> {
        self.inner.labels().input_names.clone()
    }

    /// Units of the inputs; empty unless stated.
    #[getter]
    fn input_units(&self) -> Vec<String> {
        self.inner.labels().input_units.clone()
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other
            .cast::<Self>()
            .is_ok_and(|o| o.get().inner == self.inner)
    }

    fn __repr__(&self) -> String {
        let time = self
            .inner
            .sampling_time()
            .map_or(String::new(), |t| format!(", sampling_time={t}"));
        format!(
            "Plant(states={}, inputs={}{time})",
            self.inner.states(),
            self.inner.inputs()
        )
    }

    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let rebuild = py.import("mpct._pickle")?.getattr("plant")?;
        let plant = &self.inner;
        let continuous = plant.continuous_matrices().is_some();
        let (a, b) = plant
            .continuous_matrices()
            .unwrap_or((plant.a(), plant.b()));
        let options = PyDict::new(py);
        options.set_item(
            if continuous { "dt" } else { "sampling_time" },
            plant.sampling_time(),
        )?;
        options.set_item("operating_point", self.operating_point(py))?;
        let labels = plant.labels();
        options.set_item("state_names", &labels.state_names)?;
        options.set_item("state_units", &labels.state_units)?;
        options.set_item("input_names", &labels.input_names)?;
        options.set_item("input_units", &labels.input_units)?;
        let arguments = convert::tuple(
            py,
            vec![
                PyBool::new(py, continuous).to_owned().into_any(),
                convert::sparse_to_array2(py, a)?.into_any(),
                convert::sparse_to_array2(py, b)?.into_any(),
                options.into_any(),
            ],
        )?;
        Ok((rebuild, arguments))
    }
}
