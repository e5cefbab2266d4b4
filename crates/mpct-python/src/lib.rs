//! The compiled half of the Python package `mpct`. What Python users see is documented in the docstrings.

mod analysis;
mod controller;
mod convert;
mod design;
mod errors;
mod figures;
mod fork;
mod interrupt;
mod names;
mod parts;
mod plant;
mod problem;
mod report;
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
        _compare, _example, _performance, _read_file, _scaling_advice, _scaling_need, _verify,
        _write_file,
    };
    #[pymodule_export]
    use crate::fork::_after_fork;
    #[pymodule_export]
    use crate::plant::PyPlant;
    #[pymodule_export]
    use crate::problem::PyProblem;
    #[pymodule_export]
    use crate::report::{_picture, _report, _reproduce};
    #[pymodule_export]
    use crate::simulation::_simulate;
    #[pymodule_export]
    use crate::stability::{PyAlphaBounds, PyStabilityRegion};
    #[pymodule_export]
    use crate::step::{_step, PyStep};
    use pyo3::prelude::*;
    use pyo3::types::PyDict;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // Windows has no fork.
        if let Some(register) = module.py().import("os")?.getattr_opt("register_at_fork")? {
            let options = PyDict::new(module.py());
            options.set_item("after_in_child", module.getattr("_after_fork")?)?;
            register.call((), Some(&options))?;
        }
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
