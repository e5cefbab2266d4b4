//! Which row is violated most? Answered without looking at most rows.
//!
//! Row `i` of the scaled problem, `qᵢ(x, z) = Gᵢz − bᵢ(x)`, moves at most
//! `αᵢ‖Δc‖ + βᵢ‖Δθ‖ + δᵢ‖Δx‖` when its arguments move. So a slack measured once bounds it until the sum of all movements since then has used
//! the slack up. The sums of movements `(p_c, p_θ, p_x)` are three numbers shared by all rows; per row one number is kept,
//! `keyᵢ = (αᵢ p_c + βᵢ p_θ + δᵢ p_x at the time of the measurement) − qᵢ`,
//! and `qᵢ ≤ αᵢ p_c + βᵢ p_θ + δᵢ p_x − keyᵢ` holds at any later time. A row is evaluated only when this bound exceeds the
//! worst violation found so far. The answer is exact; in a quiet closed loop nearly every row is skipped.
//!
//! Three things make this cheap. Rows are bounded in groups of 16 first, by the same formula with the largest `α, β, δ` of the group. Opposite
//! rows share their product; when one of them is active, the other is far from its bound and both are left out. And after a pricing that found
//! violated rows, the worst of them are evaluated first: they are likely to be the worst still, and then their violation rules out most others.

use crate::dense::{all_finite, distance_upper, dot};
use crate::dims::ROW_BLOCK;
use crate::{Scalar, Tables};

/// Rows remembered from one pricing to the next.
const RECENT: usize = 4;

#[derive(Debug)]
pub(crate) struct Pricing<'a, T> {
    key: &'a mut [T],
    /// The same for groups of rows.
    block_key: &'a mut [T],
    /// `bᵢ(x)` of this step, from its second pricing on; NaN when not computed yet.
    bound: &'a mut [T],
    x: &'a mut [T],
    z: &'a mut [T],
    path: [T; 3],
    /// `−∞` keys were set and the paths are zero.
    forget: bool,
    /// Pricings of this step.
    pricings: u32,
    /// The worst rows of the last pricing of this step.
    recent: [usize; RECENT],
    recent_len: usize,
}

/// Result of one pricing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Priced<T> {
    /// The row to add and its `qᵢ > 0`.
    pub worst: Option<(usize, T)>,
    /// Largest `qᵢ`, in units of right-hand sides, over the rows outside the working set; not below 0.
    pub violation: T,
    /// `qᵢ` of that row, or 0: what the bound of another row must exceed to matter.
    best: T,
    /// A row gave NaN or ∞.
    pub broken: bool,
}

impl<'a, T: Scalar> Pricing<'a, T> {
    pub fn new(
        key: &'a mut [T],
        block_key: &'a mut [T],
        bound: &'a mut [T],
        x: &'a mut [T],
        z: &'a mut [T],
    ) -> Self {
        Self {
            key,
            block_key,
            bound,
            x,
            z,
            path: [T::ZERO; 3],
            forget: true,
            pricings: 0,
            recent: [0; RECENT],
            recent_len: 0,
        }
    }

    /// The sums of movements, and whether all bounds are to be forgotten.
    pub fn travelled(&self) -> ([T; 3], bool) {
        (self.path, self.forget)
    }

    pub fn set_travelled(&mut self, path: [T; 3], forget: bool) {
        (self.path, self.forget) = (path, forget);
    }

    /// Forgets every bound.
    pub fn forget(&mut self) {
        self.forget = true;
    }

    /// A new measured state.
    pub fn measure(&mut self, x: &[T]) {
        self.path[2] += distance_upper(x, self.x);
        self.x.copy_from_slice(x);
        (self.pricings, self.recent_len) = (0, 0);
    }

    /// `bᵢ(x)`. A quiet step needs few of them; from the second pricing on they are kept.
    #[inline(always)]
    pub fn bound(&mut self, tables: &Tables<'_, T>, row: usize) -> T {
        if self.pricings < 2 {
            return tables.bound(row, self.x);
        }
        let known = self.bound[row];
        if !known.is_nan() {
            return known;
        }
        let bound = tables.bound(row, self.x);
        self.bound[row] = bound;
        bound
    }

    /// `Gᵢz − bᵢ(x)`, scaled.
    #[inline(always)]
    pub fn residual(&mut self, tables: &Tables<'_, T>, row: usize, z: &[T]) -> T {
        dot(tables.g_row(row), z) - self.bound(tables, row)
    }

    /// The row that speaks for `row`: the first of a pair.
    #[inline(always)]
    fn speaker(tables: &Tables<'_, T>, row: usize) -> usize {
        if row < 2 * tables.found.pairs {
            row & !1
        } else {
            row
        }
    }

    /// Row `row` enters the working set: it is not priced until it leaves. Nor is its opposite, whose slack is the whole width.
    pub fn hide(&mut self, tables: &Tables<'_, T>, row: usize) {
        self.key[Self::speaker(tables, row)] = T::INFINITY;
    }

    /// Row `row` left the working set: nothing is known about it.
    pub fn show(&mut self, tables: &Tables<'_, T>, row: usize) {
        self.key[Self::speaker(tables, row)] = -T::INFINITY;
        self.block_key[row / ROW_BLOCK] = -T::INFINITY;
    }

    /// The most violated row at `(x, z)` outside `working`.
    pub fn price(&mut self, tables: &Tables<'_, T>, z: &[T], working: &[u32]) -> Priced<T> {
        self.travel(tables, z, working);
        self.pricings += 1;
        if self.pricings == 2 {
            self.bound.fill(T::NAN);
        }
        let mut found = Priced {
            worst: None,
            violation: T::ZERO,
            best: T::ZERO,
            broken: false,
        };
        let (recent, recent_len) = (self.recent, self.recent_len);
        self.recent_len = 0;
        for &row in &recent[..recent_len.min(RECENT)] {
            if self.key[row] < T::INFINITY {
                self.evaluate(tables, row, z, &mut found);
            }
        }
        let path = self.path;
        for block in 0..self.block_key.len() {
            let reached = reached(&tables.block_reach, block, path);
            if reached - self.block_key[block] > found.best {
                let bound = self.scan(tables, block, z, &mut found);
                self.block_key[block] = reached - bound;
            }
        }
        found
    }

    /// Prices a group of rows. Returns the largest of their bounds.
    fn scan(&mut self, tables: &Tables<'_, T>, block: usize, z: &[T], found: &mut Priced<T>) -> T {
        let end = ((block + 1) * ROW_BLOCK).min(tables.dims.rows);
        let (mut row, mut largest) = (block * ROW_BLOCK, -T::INFINITY);
        while row < end {
            let reached = reached(&tables.reach, row, self.path);
            let mut bound = reached - self.key[row];
            if bound > found.best {
                bound = self.evaluate(tables, row, z, found);
            }
            largest = largest.max(bound);
            row += if row < 2 * tables.found.pairs { 2 } else { 1 };
        }
        largest
    }

    /// Measures one row, or a pair, and renews its bound. Returns the larger residual.
    #[inline]
    fn evaluate(
        &mut self,
        tables: &Tables<'_, T>,
        row: usize,
        z: &[T],
        found: &mut Priced<T>,
    ) -> T {
        let scale = tables.scale[row];
        let (mut q, mut worst) = (self.residual(tables, row, z), row);
        if row < 2 * tables.found.pairs {
            // The opposite row: −G z − (2 s − b).
            let opposite = -q - (scale + scale);
            if opposite > q {
                (q, worst) = (opposite, row + 1);
            }
        }
        self.key[row] = reached(&tables.reach, row, self.path) - q;
        found.broken |= !q.is_finite();
        if q > T::ZERO {
            found.violation = found.violation.max(q / scale);
            if q > found.best && q > T::PRIMAL * scale {
                found.best = q;
                found.worst = Some((worst, q));
                self.recent[self.recent_len % RECENT] = row;
                self.recent_len += 1;
            }
        }
        q
    }

    /// Adds the movement to `z` to the paths; forgets the bounds when the paths are too long to be accurate.
    fn travel(&mut self, tables: &Tables<'_, T>, z: &[T], working: &[u32]) {
        let split = z.len() - tables.dims.inputs;
        self.path[0] += distance_upper(&z[..split], &self.z[..split]);
        self.path[1] += distance_upper(&z[split..], &self.z[split..]);
        self.z.copy_from_slice(z);
        let mut total = T::ZERO;
        for part in 0..3 {
            total += self.path[part] * tables.found.reach_max[part];
        }
        if self.forget || !(total < T::REACH) || !all_finite(&self.path) {
            self.path = [T::ZERO; 3];
            self.key.fill(-T::INFINITY);
            self.block_key.fill(-T::INFINITY);
            for &row in working {
                self.hide(tables, row as usize);
            }
            self.forget = false;
        }
    }
}

/// `α p_c + β p_θ + δ p_x`.
#[inline(always)]
fn reached<T: Scalar>(reach: &[&[T]; 3], at: usize, path: [T; 3]) -> T {
    reach[0][at] * path[0] + reach[1][at] * path[1] + reach[2][at] * path[2]
}
