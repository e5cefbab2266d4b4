//! How much work one step may do.

/// A limit on the iterations of one step, and a question asked between iterations: is time up?
///
/// One iteration is one change of the working set. A step whose working set of last time is still right needs none,
/// so even a budget of 0 can end with the optimum. Whatever the budget, a step ends with a feasible plan when one exists.
///
/// ```
/// use mpct_runtime::Budget;
/// let mut ticks = 0;
/// let mut clock = || { ticks += 1; ticks > 100 };
/// let budget = Budget::iterations(50).until(&mut clock);
/// # let _ = budget;
/// let _everything = Budget::unlimited();
/// ```
pub struct Budget<'c> {
    pub(crate) iterations: u32,
    stop: Option<&'c mut dyn FnMut() -> bool>,
}

impl<'c> Budget<'c> {
    /// As many iterations as the optimum takes (with a hard limit of `20 (rows + nz) + 1000` in case it never comes).
    pub fn unlimited() -> Self {
        Self::iterations(u32::MAX)
    }

    /// At most `iterations` changes of the working set.
    pub fn iterations(iterations: u32) -> Self {
        Self {
            iterations,
            stop: None,
        }
    }

    /// Also stops as soon as `stop` returns true. It is asked before every iteration. After that, a step still costs
    /// at most two passes over the rows, to check the plan it falls back to.
    pub fn until(mut self, stop: &'c mut dyn FnMut() -> bool) -> Self {
        self.stop = Some(stop);
        self
    }

    pub(crate) fn is_over(&mut self) -> bool {
        self.stop.as_mut().is_some_and(|stop| stop())
    }
}
