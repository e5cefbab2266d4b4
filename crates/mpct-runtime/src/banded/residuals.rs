//! How far the active rows and the gradient are from an optimum.
//!
//! A step passes over the active rows a few times, and most of its time in a quiet loop goes there. So a pass does everything that needs a row while the row
//! is at hand, and what is known already is not computed again: a step begins with what the last one ended with, moved by the state
//! alone; after the first solution of a step the residuals follow from the movement; the last look is at `z` itself.

use super::solve::Solver;
use super::windows::add_symmetric_product;
use crate::Scalar;
use crate::dense::{axpy, dot, long_dot};

/// What a look at the active rows found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Residuals<T> {
    /// `‖H z + f + Gᵀy‖_∞` over the size of its terms, the larger of the c part and the θ part.
    pub stationarity: T,
    /// Largest residual of an active row, in units of right-hand sides.
    pub error: T,
    /// Rows whose multiplier has the wrong sign.
    pub leaving: usize,
    /// Whether the residuals come from `z` itself and not from its movements.
    pub is_fresh: bool,
}

/// Where the residuals of the active rows come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Look {
    /// From `z`. The multipliers stay.
    At,
    /// From `z`, after it moved by `direction`: the multipliers follow.
    After,
    /// From those before and `direction`: enough to go on with. The multipliers follow.
    Along,
}

impl<T: Scalar> Solver<'_, '_, '_, T> {
    /// `gradient = H z + f + Gᵀy` and `slope` = residual of each active row, in one pass over these; with [`Look::Along`] also `pull`.
    ///
    /// The new multiplier is `ȳ + ρ (slope before + G direction)`, not `ȳ + ρ (G z + V x − u)`: that would multiply the rounding of `z` by ρ.
    pub(super) fn residuals(&mut self, look: Look) -> Residuals<T> {
        let (p, d) = (&mut *self.parts, &self.tables.data);
        p.gradient.copy_from_slice(p.linear);
        add_symmetric_product(&d.hessian, p.z, p.gradient);
        self.state.has_pull = look == Look::Along;
        if look == Look::Along {
            p.pull.fill(T::ZERO);
        }
        let mut leaving = 0;
        for k in 0..self.state.active {
            let pair = p.active[k] as usize;
            let (row, window) = (d.rows.row(pair), d.rows.window(pair));
            if look != Look::At {
                p.slope[k] += long_dot(row, &p.direction[window.clone()]);
                p.y[pair] = p.centre[pair] + p.stiff[pair] * p.slope[k];
                leaving += usize::from(p.is_wrong(pair));
            }
            axpy(p.y[pair], row, &mut p.gradient[window.clone()]);
            if look == Look::Along {
                axpy(p.stiff[pair] * p.slope[k], row, &mut p.pull[window]);
                continue;
            }
            let value = long_dot(row, &p.z[window]) + p.of_state(self.tables, pair);
            p.slope[k] = value - p.bound(self.tables, pair);
        }
        Residuals {
            leaving,
            ..self.summary(look != Look::Along || self.state.active == 0)
        }
    }

    /// The sizes of what `gradient` and `slope` hold.
    pub(super) fn summary(&self, is_fresh: bool) -> Residuals<T> {
        let (p, d) = (&*self.parts, &self.tables.data);
        let mut error = T::ZERO;
        for (&pair, &residual) in p.active[..self.state.active].iter().zip(p.slope.iter()) {
            error = larger(error, residual.abs() / d.scale[pair as usize]);
        }
        let (mut left, mut size) = ([T::ZERO; 2], [T::ONE; 2]);
        for v in 0..p.z.len() {
            let part = self.tables.part(v);
            left[part] = larger(left[part], p.gradient[v].abs());
            let terms = p.linear[v]
                .abs()
                .max((p.unit[v] * p.unit[v] * p.z[v]).abs());
            size[part] = size[part].max(terms);
        }
        Residuals {
            stationarity: larger(left[0] / size[0], left[1] / size[1]),
            error,
            leaving: 0,
            is_fresh,
        }
    }

    /// `½ zᵀHz + fᵀz` at an optimum, without a product with H: `Hz + f` is `gradient` less `Gᵀy`, and `G z` is known.
    pub fn cost(&self) -> T {
        let p = &*self.parts;
        let mut sum = dot(p.z, p.gradient) + dot(p.z, p.linear);
        for (&pair, &residual) in p.active[..self.state.active].iter().zip(p.slope.iter()) {
            let pair = pair as usize;
            sum -= p.y[pair] * (residual + p.bound(self.tables, pair) - p.of_state[pair]);
        }
        T::HALF * sum
    }

    /// `pull = ρ Gᵀ slope`, unless it is known.
    pub(super) fn pull(&mut self) {
        if self.state.has_pull {
            return;
        }
        let (p, d) = (&mut *self.parts, &self.tables.data);
        p.pull.fill(T::ZERO);
        for (&pair, &residual) in p.active[..self.state.active].iter().zip(p.slope.iter()) {
            let pair = pair as usize;
            d.rows.add_row(pair, p.stiff[pair] * residual, p.pull);
        }
        self.state.has_pull = true;
    }
}

/// The larger one; NaN wins.
fn larger<T: Scalar>(a: T, b: T) -> T {
    if b <= a { a } else { b }
}
