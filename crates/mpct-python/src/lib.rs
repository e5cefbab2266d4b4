//! The compiled half of the Python package `mpct`. What Python users see is documented in the docstrings.

mod analysis;
mod controller;
mod convert;
mod design;
mod errors;
mod figures;
mod interrupt;
mod names;
mod parts;
mod plant;
mod problem;
mod search;
mod simulation;
mod stability;
mod step;

use pyo3::prelude::*;

#[pymodule]
mod _mpct {
    #[pymodule_export]
    use crate::analysis::PyDomainOfAttraction;
    #[pymodule_export]
    use crate::controller::{_step_seconds, PyController};
    #[pymodule_export]
    use crate::design::PyDesign;
    #[pymodule_export]
    use crate::figures::{
        _compare, _example, _performance, _read_file, _report, _reproduce, _scaling_advice,
        _scaling_need, _verify, _write_file,
    };
    #[pymodule_export]
    use crate::plant::PyPlant;
    #[pymodule_export]
    use crate::problem::PyProblem;
    #[pymodule_export]
    use crate::simulation::_simulate;
    #[pymodule_export]
    use crate::stability::{PyAlphaBounds, PyStabilityRegion};
    #[pymodule_export]
    use crate::step::{_step, PyStep};
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
