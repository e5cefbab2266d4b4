//! A controller that is put away between steps.
//!
//! Tables and workspace are borrowed, so an owner of both cannot keep the controller that borrows them. It keeps the buffers and a
//! [`Memory`] instead: suspending and resuming costs a few moves, and the next step goes on as if nothing had happened.

use crate::{Controller, Scalar, TableError, Tables, WarmStart, Workspace};

/// What a suspended [`Controller`] remembers beside its buffers.
#[derive(Clone, Copy, Debug)]
pub struct Memory<T> {
    pub(crate) warm_start: WarmStart,
    pub(crate) has_plan: bool,
    pub(crate) is_optimum: bool,
    pub(crate) is_fresh: bool,
    pub(crate) is_claimed: bool,
    pub(crate) proof_len: usize,
    pub(crate) stationarity: T,
    pub(crate) factor: [usize; 2],
    pub(crate) path: [T; 3],
    pub(crate) forget: bool,
}

impl<'a, T: Scalar> Controller<'a, T> {
    /// Lets go of the buffers.
    ///
    /// ```
    /// # use mpct_runtime::{prepare, Budget, Controller, Dims, QpData, Tables, Workspace};
    /// # const DIMS: Dims = Dims { states: 1, inputs: 1, horizon: 0, set_point: 0, rows: 1, input_rows: 0 };
    /// # let data = QpData { dims: DIMS, hessian: &[2.0], linear_state: &[1.0], linear_set_point: &[], rows: &[0.1],
    /// #     rows_state: &[0.3], gain: &[-0.3], feedforward: &[0.5], input_rows: &[] };
    /// # let (mut buffer, mut scratch) = ([0.0_f64; DIMS.tables_len()], [0.0; DIMS.prepare_len()]);
    /// let tables = prepare(&data, &mut buffer, &mut scratch).unwrap();
    /// let stamp = tables.stamp();
    /// let (mut numbers, mut indices) = ([0.0; DIMS.workspace_len()], [0; DIMS.index_len()]);
    /// let workspace = Workspace::new(DIMS, &mut numbers, &mut indices).unwrap();
    /// let memory = Controller::new(tables, workspace).unwrap().suspend();
    /// // Later, from the same buffers:
    /// let tables = Tables::reopen(stamp, &buffer).unwrap();
    /// let mut controller = Controller::resume(tables, &mut numbers, &mut indices, memory).unwrap();
    /// assert!(controller.step(&[0.2], &[], Budget::unlimited()).is_ok());
    /// ```
    pub fn suspend(self) -> Memory<T> {
        let (factor, (path, forget)) = (self.ws.factor.counters(), self.ws.pricing.travelled());
        Memory {
            warm_start: self.warm_start,
            has_plan: self.has_plan,
            is_optimum: self.is_optimum,
            is_fresh: self.is_fresh,
            is_claimed: self.is_claimed,
            proof_len: self.ws.proof_len,
            stationarity: self.ws.stationarity,
            factor,
            path,
            forget,
        }
    }

    /// Goes on from the buffers of a suspended controller. Buffers of another controller start it afresh where they do not fit.
    ///
    /// Errors: a length is wrong.
    pub fn resume(
        tables: Tables<'a, T>,
        numbers: &'a mut [T],
        indices: &'a mut [u32],
        memory: Memory<T>,
    ) -> Result<Self, TableError> {
        let dims = tables.dims;
        for (what, expected, found) in [
            ("workspace numbers", dims.workspace_len(), numbers.len()),
            ("workspace indices", dims.index_len(), indices.len()),
        ] {
            if expected != found {
                return Err(TableError::Length {
                    what,
                    expected,
                    found,
                });
            }
        }
        let fits = memory.factor[0] <= dims.variables()
            && memory.proof_len <= dims.variables() + 1
            && indices.iter().all(|&i| (i as usize) < dims.rows.max(1));
        let mut ws = Workspace::lay_out(dims, numbers, indices);
        ws.proof_len = memory.proof_len;
        ws.stationarity = memory.stationarity;
        ws.factor.set_counters(memory.factor);
        ws.pricing.set_travelled(memory.path, memory.forget);
        let mut controller = Self {
            tables,
            ws,
            warm_start: memory.warm_start,
            has_plan: memory.has_plan,
            is_optimum: memory.is_optimum,
            is_fresh: memory.is_fresh,
            is_claimed: memory.is_claimed,
        };
        if !fits {
            controller.reset();
        }
        Ok(controller)
    }
}
