//! The compiled half of the Python package `mpct`. What Python users see is documented in the docstrings.

mod controller;
mod convert;
mod design;
mod errors;
mod interrupt;
mod plant;
mod problem;
mod simulation;

use pyo3::prelude::*;

#[pymodule]
mod _mpct {
    #[pymodule_export]
    use crate::controller::{PyAdmissibleSetPoint, PyController, PyStep};
    #[pymodule_export]
    use crate::design::PyDesign;
    #[pymodule_export]
    use crate::plant::PyPlant;
    #[pymodule_export]
    use crate::problem::PyProblem;
    #[pymodule_export]
    use crate::simulation::simulate;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
