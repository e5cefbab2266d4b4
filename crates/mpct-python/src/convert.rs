//! Arrays in and out.

use crate::errors;
use mpct::{Matrix, SparseMatrix};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};

/// Numbers with their shape, in row-major order.
pub struct Numbers {
    pub shape: Vec<usize>,
    pub data: Vec<f64>,
}

/// What an argument is converted with: `mpct._convert.as_floats`, which refuses what is not an array of real numbers.
fn as_floats(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
    static FUNCTION: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    FUNCTION
        .get_or_try_init(py, || {
            Ok(py.import("mpct._convert")?.getattr("as_floats")?.unbind())
        })
        .map(|f| f.bind(py))
}

/// A list, an array or a number as numbers in row-major order.
pub fn numbers(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Numbers> {
    let py = value.py();
    let array = as_floats(py)?.call1((value, what))?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    let flat = array.call_method1("reshape", (-1,))?;
    let flat = flat.cast::<PyArray1<f64>>()?;
    Ok(Numbers {
        shape,
        data: flat.try_readonly()?.as_array().to_vec(),
    })
}

fn shape_error(py: Python<'_>, what: &str, expected: &str, shape: &[usize]) -> PyErr {
    let found = format!("an array of shape {}", shown(shape));
    errors::argument(py, what, expected, &found)
}

fn shown(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        _ => format!(
            "({})",
            shape
                .iter()
                .map(usize::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        ),
    }
}

/// A list of Python's own floats and integers as it is; `None` for anything else.
fn plain_list(value: &Bound<'_, PyAny>) -> Option<Vec<f64>> {
    let list = value.cast_exact::<PyList>().ok()?;
    list.iter()
        .map(|item| match item.cast_exact::<PyFloat>() {
            Ok(float) => Some(float.value()),
            // An integer beyond the range of a float is left to numpy, whose message names it.
            Err(_) if item.is_exact_instance_of::<PyInt>() => item.extract::<f64>().ok(),
            Err(_) => None,
        })
        .collect()
}

/// A vector. An array of float64 and a list of numbers take the short way.
pub fn vector(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    if let Ok(array) = value.cast_exact::<PyArray1<f64>>()
        && let Ok(view) = array.try_readonly()
    {
        return Ok(match view.as_slice() {
            Ok(slice) => slice.to_vec(),
            Err(_) => view.as_array().to_vec(),
        });
    }
    if let Some(plain) = plain_list(value) {
        return Ok(plain);
    }
    let found = numbers(what, value)?;
    match found.shape.as_slice() {
        [_] => Ok(found.data),
        shape => Err(shape_error(value.py(), what, "a vector", shape)),
    }
}

/// A vector of `len` entries, or a number for all of them.
pub fn vector_or_number(what: &str, value: &Bound<'_, PyAny>, len: usize) -> PyResult<Vec<f64>> {
    let found = numbers(what, value)?;
    match found.shape.as_slice() {
        [] => Ok(vec![found.data[0]; len]),
        [_] => Ok(found.data),
        shape => Err(shape_error(value.py(), what, "a vector or a number", shape)),
    }
}

/// A matrix.
pub fn matrix(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Matrix> {
    let found = numbers(what, value)?;
    match found.shape.as_slice() {
        &[rows, cols] => {
            Matrix::new(rows, cols, found.data).map_err(|e| errors::design(value.py(), &e))
        }
        shape => Err(shape_error(value.py(), what, "a matrix", shape)),
    }
}

/// A whole number ≥ 0; Python's own conversion would refuse a negative one without saying which it is.
pub fn whole(py: Python<'_>, what: &str, value: i64) -> PyResult<usize> {
    usize::try_from(value)
        .map_err(|_| errors::argument(py, what, "a whole number >= 0", &value.to_string()))
}

/// The same of anything that Python takes as an index.
pub fn whole_of(what: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let expected = "a whole number >= 0";
    let found = || value.repr().map_or_else(|_| "?".into(), |r| r.to_string());
    match value.extract::<i64>() {
        Ok(number) if !value.is_instance_of::<PyBool>() => whole(value.py(), what, number),
        Err(error) if error.is_instance_of::<PyOverflowError>(value.py()) => {
            Err(errors::argument(value.py(), what, expected, &found()))
        }
        _ => Err(errors::argument_type(value.py(), what, expected, &found())),
    }
}

/// Two coordinates.
pub fn coordinates(py: Python<'_>, pair: (i64, i64)) -> PyResult<(usize, usize)> {
    Ok((
        whole(py, "coordinates", pair.0)?,
        whole(py, "coordinates", pair.1)?,
    ))
}

/// A pair of limits; `None` in place of a limit, or of the pair, leaves the side open.
pub fn limits(
    what: &str,
    value: Option<&Bound<'_, PyAny>>,
    len: usize,
) -> PyResult<(Vec<f64>, Vec<f64>)> {
    let open = |sign: f64| vec![sign * f64::INFINITY; len];
    let Some(value) = value else {
        return Ok((open(-1.0), open(1.0)));
    };
    let wrong = || {
        let found = value.get_type().to_string();
        errors::argument_type(value.py(), what, "a pair (lower, upper)", &found)
    };
    if value.is_instance_of::<PyString>() {
        return Err(wrong());
    }
    let items: Vec<Bound<'_, PyAny>> = value
        .try_iter()
        .map_err(|_| wrong())?
        .collect::<PyResult<_>>()?;
    let [lower, upper] = items.as_slice() else {
        return Err(wrong());
    };
    let side = |name: &str, item: &Bound<'_, PyAny>, sign: f64| {
        if item.is_none() {
            Ok(open(sign))
        } else {
            vector_or_number(&format!("{what} {name}"), item, len)
        }
    };
    Ok((side("lower", lower, -1.0)?, side("upper", upper, 1.0)?))
}

/// A vector for Python, without a copy.
pub fn to_array(py: Python<'_>, v: Vec<f64>) -> Bound<'_, PyArray1<f64>> {
    PyArray1::from_vec(py, v)
}

/// A dense matrix for Python.
pub fn to_array2(py: Python<'_>, m: Matrix) -> PyResult<Bound<'_, PyArray2<f64>>> {
    PyArray1::from_slice(py, m.as_slice()).reshape([m.rows(), m.cols()])
}

/// A sparse matrix for Python, dense there.
pub fn sparse_to_array2<'py>(
    py: Python<'py>,
    m: &SparseMatrix,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    to_array2(py, m.to_dense())
}

/// Rows of equal length for Python.
pub fn rows_to_array2<'py, 'a>(
    py: Python<'py>,
    cols: usize,
    rows: impl Iterator<Item = &'a [f64]>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let mut data = Vec::new();
    let mut count = 0;
    for row in rows {
        data.extend_from_slice(row);
        count += 1;
    }
    let array = PyArray1::from_vec(py, data);
    debug_assert_eq!(array.len(), count * cols);
    array.reshape([count, cols])
}

/// A tuple whose items are of different types.
pub fn tuple<'py>(py: Python<'py>, items: Vec<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyTuple>> {
    PyTuple::new(py, items)
}

/// Anything that can be written as JSON, as Python's own lists, dictionaries, numbers and texts. Numbers keep every bit.
pub fn plain<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value)
        .map_err(|e| pyo3::exceptions::PyRuntimeError::new_err(e.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}

/// An instance of a class of `mpct._results`.
pub fn result<'py>(
    py: Python<'py>,
    class: &str,
    fields: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    py.import("mpct._results")?
        .getattr(class)?
        .call((), Some(fields))
}
