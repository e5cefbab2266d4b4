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

/// Anything that Python takes as an index, ≥ 0; Python's own conversion would not say which argument it refuses.
pub fn whole_of(what: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let py = value.py();
    let expected = "a whole number >= 0";
    let known = value.extract::<i64>();
    let too_large = |e: &PyErr| e.is_instance_of::<PyOverflowError>(py);
    match &known {
        Ok(number) if *number >= 0 && !value.is_instance_of::<PyBool>() => Ok(*number as usize),
        Ok(_) if value.is_instance_of::<PyBool>() => Err(errors::argument_type(
            py,
            what,
            expected,
            &shown_value(value),
        )),
        Err(error) if !too_large(error) => Err(errors::argument_type(
            py,
            what,
            expected,
            &shown_value(value),
        )),
        _ => Err(errors::argument(py, what, expected, &shown_value(value))),
    }
}

/// A value as Python shows it.
fn shown_value(value: &Bound<'_, PyAny>) -> String {
    value.repr().map_or_else(|_| "?".into(), |r| r.to_string())
}

/// Whole numbers by the name of their argument, for `from_py_with`.
pub mod whole {
    use super::whole_of;
    use pyo3::prelude::*;

    macro_rules! arguments {
        ($($name:ident),*) => { $(
            pub fn $name(value: &Bound<'_, PyAny>) -> PyResult<usize> {
                whole_of(stringify!($name), value)
            }
        )* };
    }
    arguments!(horizon, max_horizon, count);

    macro_rules! optional_arguments {
        ($($function:ident = $name:literal),*) => { $(
            pub fn $function(value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
                if value.is_none() { Ok(None) } else { whole_of($name, value).map(Some) }
            }
        )* };
    }
    optional_arguments!(
        optional_horizon = "horizon",
        horizon_extension = "horizon_extension",
        iterations = "iterations"
    );
}

/// The items of a pair, for which `expected` stands in messages.
fn pair<'py>(
    what: &str,
    value: &Bound<'py, PyAny>,
    expected: &str,
) -> PyResult<[Bound<'py, PyAny>; 2]> {
    let wrong = |found: String| errors::argument_type(value.py(), what, expected, &found);
    if value.is_instance_of::<PyString>() {
        return Err(wrong(shown_value(value)));
    }
    let items: Vec<Bound<'py, PyAny>> = value
        .try_iter()
        .map_err(|_| wrong(value.get_type().to_string()))?
        .collect::<PyResult<_>>()?;
    items
        .try_into()
        .map_err(|items: Vec<_>| wrong(format!("{} items", items.len())))
}

/// Two coordinates.
pub fn coordinates(value: &Bound<'_, PyAny>) -> PyResult<(usize, usize)> {
    let what = "coordinates";
    let [first, second] = pair(what, value, "two states, such as (0, 1)")?;
    Ok((whole_of(what, &first)?, whole_of(what, &second)?))
}

/// An operating point, when stated.
pub fn operating_point(value: &Bound<'_, PyAny>) -> PyResult<Option<(Vec<f64>, Vec<f64>)>> {
    if value.is_none() {
        return Ok(None);
    }
    let [x, u] = pair("operating_point", value, "a pair (state, input)")?;
    Ok(Some((
        vector("operating_point state", &x)?,
        vector("operating_point input", &u)?,
    )))
}

/// A list of texts, empty when not stated.
pub fn texts(what: &str, value: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<String>> {
    let Some(value) = value else {
        return Ok(Vec::new());
    };
    let wrong = || errors::argument_type(value.py(), what, "a list of texts", &shown_value(value));
    if value.is_instance_of::<PyString>() {
        return Err(wrong());
    }
    value
        .try_iter()
        .map_err(|_| wrong())?
        .map(|item| item?.extract().map_err(|_| wrong()))
        .collect()
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
    let [lower, upper] = pair(what, value, "a pair (lower, upper)")?;
    let side = |name: &str, item: &Bound<'_, PyAny>, sign: f64| {
        if item.is_none() {
            Ok(open(sign))
        } else {
            vector_or_number(&format!("{what} {name}"), item, len)
        }
    };
    Ok((side("lower", &lower, -1.0)?, side("upper", &upper, 1.0)?))
}

/// A vector for Python, without a copy.
pub fn to_array(py: Python<'_>, v: Vec<f64>) -> Bound<'_, PyArray1<f64>> {
    PyArray1::from_vec(py, v)
}

/// A dense matrix for Python, without a copy.
pub fn to_array2(py: Python<'_>, m: Matrix) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let shape = [m.rows(), m.cols()];
    to_array(py, m.into_vec()).reshape(shape)
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
