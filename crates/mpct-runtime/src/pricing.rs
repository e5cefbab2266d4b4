//! Which row is violated most? Answered without looking at most rows.
//!
//! Row `i` of the scaled problem, `qᵢ(x, z) = Gᵢz − bᵢ(x)`, moves at most
//! `αᵢ‖Δc‖ + βᵢ‖Δθ‖ + δᵢ‖Δx‖` when its arguments move. So a slack measured once bounds it until the sum of all movements since then has used
//! the slack up. The sums of movements `(p_c, p_θ, p_x)` are three numbers shared by all rows; per row one number is kept,
//! `keyᵢ = (αᵢ p_c + βᵢ p_θ + δᵢ p_x at the time of the measurement) − qᵢ`,
//! and `qᵢ ≤ αᵢ p_c + βᵢ p_θ + δᵢ p_x − keyᵢ` holds at any later time. A row is evaluated only when this bound exceeds the
//! worst violation found so far. The answer is exact; in a quiet closed loop nearly every row is skipped.

use crate::dense::{all_finite, distance_upper};
use crate::{Scalar, Tables};

/// Rows whose bounds are tested together.
const BLOCK: usize = 8;

#[derive(Debug)]
pub(crate) struct Pricing<'a, T> {
    key: &'a mut [T],
    /// `bᵢ(x)` of this step; NaN when not computed yet.
    bound: &'a mut [T],
    x: &'a mut [T],
    z: &'a mut [T],
    path: [T; 3],
    /// `−∞` keys were set and the paths are zero.
    forget: bool,
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
    pub fn new(key: &'a mut [T], bound: &'a mut [T], x: &'a mut [T], z: &'a mut [T]) -> Self {
        Self {
            key,
            bound,
            x,
            z,
            path: [T::ZERO; 3],
            forget: true,
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
        self.bound.fill(T::NAN);
    }

    /// `bᵢ(x)`.
    #[inline(always)]
    pub fn bound(&mut self, tables: &Tables<'_, T>, row: usize) -> T {
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
        crate::dense::dot(tables.g_row(row), z) - self.bound(tables, row)
    }

    /// Row `row` enters the working set: it is not priced until it leaves.
    pub fn hide(&mut self, row: usize) {
        self.key[row] = T::INFINITY;
    }

    /// Row `row` left the working set: nothing is known about it.
    pub fn show(&mut self, row: usize) {
        self.key[row] = -T::INFINITY;
    }

    /// The most violated row at `(x, z)` outside `working`.
    pub fn price(&mut self, tables: &Tables<'_, T>, z: &[T], working: &[u32]) -> Priced<T> {
        self.travel(tables, z, working);
        let path = self.path;
        let mut found = Priced {
            worst: None,
            violation: T::ZERO,
            best: T::ZERO,
            broken: false,
        };
        let (a, a_rest) = tables.reach[0].as_chunks::<BLOCK>();
        let (b, b_rest) = tables.reach[1].as_chunks::<BLOCK>();
        let (d, d_rest) = tables.reach[2].as_chunks::<BLOCK>();
        for (block, ((a, b), d)) in a.iter().zip(b).zip(d).enumerate() {
            let first = block * BLOCK;
            let Some(key) = self.key.get(first..).and_then(|k| k.first_chunk::<BLOCK>()) else {
                break;
            };
            // `excess = bound − best`, for the block at once: this loop becomes vector instructions.
            let mut excess = [T::ZERO; BLOCK];
            for lane in 0..BLOCK {
                excess[lane] =
                    (a[lane] * path[0] + b[lane] * path[1] + d[lane] * path[2]) - key[lane];
            }
            let mut largest = excess;
            for half in [BLOCK / 2, BLOCK / 4, BLOCK / 8] {
                for lane in 0..half {
                    let other = largest[lane + half];
                    largest[lane] = if other > largest[lane] {
                        other
                    } else {
                        largest[lane]
                    };
                }
            }
            if largest[0] > found.best {
                for (lane, &bound) in excess.iter().enumerate() {
                    if bound > found.best {
                        self.evaluate(tables, first + lane, z, &mut found);
                    }
                }
            }
        }
        let first = tables.dims.rows - a_rest.len();
        for (lane, ((&a, &b), &d)) in a_rest.iter().zip(b_rest).zip(d_rest).enumerate() {
            if a * path[0] + b * path[1] + d * path[2] - self.key[first + lane] > found.best {
                self.evaluate(tables, first + lane, z, &mut found);
            }
        }
        found
    }

    /// Measures one row and renews its bound.
    #[inline]
    fn evaluate(&mut self, tables: &Tables<'_, T>, row: usize, z: &[T], found: &mut Priced<T>) {
        let q = self.residual(tables, row, z);
        let mut reached = T::ZERO;
        for part in 0..3 {
            reached += tables.reach[part][row] * self.path[part];
        }
        self.key[row] = reached - q;
        found.broken |= !q.is_finite();
        if q > T::ZERO {
            let scale = tables.scale[row];
            found.violation = found.violation.max(q / scale);
            if q > found.best && q > T::PRIMAL * scale {
                found.best = q;
                found.worst = Some((row, q));
            }
        }
    }

    /// Adds the movement to `z` to the paths; forgets the bounds when the paths are too long to be accurate.
    fn travel(&mut self, tables: &Tables<'_, T>, z: &[T], working: &[u32]) {
        let split = z.len() - tables.dims.inputs;
        self.path[0] += distance_upper(&z[..split], &self.z[..split]);
        self.path[1] += distance_upper(&z[split..], &self.z[split..]);
        self.z.copy_from_slice(z);
        let mut total = T::ZERO;
        for part in 0..3 {
            total += self.path[part] * tables.reach_max[part];
        }
        if self.forget || !(total < T::REACH) || !all_finite(&self.path) {
            self.path = [T::ZERO; 3];
            self.key.fill(-T::INFINITY);
            for &row in working {
                self.hide(row as usize);
            }
            self.forget = false;
        }
    }
}
