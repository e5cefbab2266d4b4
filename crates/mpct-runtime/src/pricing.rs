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
//! rows share their product; when one of them is active, the other is far from its bound and both are left out. And the violated rows that a
//! pass over all rows finds are worked off first, the worst of them at each iteration, before the next pass: the method is free to add any
//! violated row.

use crate::dense::{all_finite, distance_upper, dot};
use crate::dims::ROW_BLOCK;
use crate::{Scalar, Tables};

/// Violated rows remembered from one pass over all rows. Fewer, and more passes are needed; more, and the rows at its end
/// are likely to be mended by those before.
const LISTED: usize = 32;

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
    /// Violated rows of the last pass over all rows in this step.
    list: List<T>,
}

/// Result of one pricing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Priced<T> {
    /// The row to add and its `qᵢ > 0`.
    pub worst: Option<(usize, T)>,
    /// Largest `qᵢ`, in units of right-hand sides, over the rows outside the working set; not below 0.
    pub violation: T,
    /// `qᵢ` of that row, or 0.
    best: T,
    /// A row gave NaN or ∞.
    pub broken: bool,
    /// Nothing was looked at.
    pub is_spared: bool,
}

impl<T: Scalar> Priced<T> {
    const NOTHING: Self = Self {
        worst: None,
        violation: T::ZERO,
        best: T::ZERO,
        broken: false,
        is_spared: false,
    };

    /// Takes note of residual `q` of row `row`, and of its opposite `−q − 2 s` when it is the first of a pair. Returns the larger one.
    #[inline(always)]
    fn weigh(&mut self, row: usize, mut q: T, scale: T, is_pair: bool) -> T {
        let mut worst = row;
        if is_pair {
            let opposite = -q - (scale + scale);
            if opposite > q {
                (q, worst) = (opposite, row + 1);
            }
        }
        self.broken |= !q.is_finite();
        if q > T::ZERO {
            self.violation = self.violation.max(q / scale);
            if q > self.best && q > T::PRIMAL * scale {
                self.best = q;
                self.worst = Some((worst, q));
            }
        }
        q
    }
}

/// Rows and their violation when they were listed.
#[derive(Debug)]
struct List<T> {
    rows: [(u32, T); LISTED],
    len: usize,
}

impl<T: Scalar> List<T> {
    const EMPTY: Self = Self {
        rows: [(0, T::ZERO); LISTED],
        len: 0,
    };

    /// Lists a row; when the list is full, in place of the least violated one.
    fn note(&mut self, row: usize, q: T) {
        if let Some(place) = self.rows.get_mut(self.len) {
            *place = (row as u32, q);
            self.len += 1;
            return;
        }
        let mut least = 0;
        for (i, entry) in self.rows.iter().enumerate() {
            if entry.1 < self.rows[least].1 {
                least = i;
            }
        }
        if q > self.rows[least].1 {
            self.rows[least] = (row as u32, q);
        }
    }
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
            list: List::EMPTY,
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

    /// A new measured state. Returns an upper bound of its distance from the last one.
    pub fn measure(&mut self, x: &[T]) -> T {
        let distance = distance_upper(x, self.x);
        self.path[2] += distance;
        self.x.copy_from_slice(x);
        (self.pricings, self.list.len) = (0, 0);
        distance
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

    /// Memory for the residuals of all units. It is that of the `bᵢ(x)`, which a walk does not need.
    #[inline(always)]
    pub fn residuals(&mut self, units: usize) -> &mut [T] {
        &mut self.bound[..units]
    }

    /// Renews every bound from the residuals a walk has left for `z`, which are right within `error` in units of right-hand sides.
    pub fn know(
        &mut self,
        tables: &Tables<'_, T>,
        scale: &[T],
        error: T,
        z: &[T],
        working: &[u32],
    ) {
        let pairs = tables.found.pairs;
        self.z.copy_from_slice(z);
        (self.path, self.forget) = ([T::ZERO; 3], false);
        let (of_pairs, of_singles) = self.key.split_at_mut(2 * pairs);
        let centred = self.bound.iter().zip(scale);
        for (key, (d, &s)) in of_pairs.chunks_exact_mut(2).zip(centred.clone()) {
            // The second of a pair is never asked; it must not stand in the way of the smallest key of its group.
            key.copy_from_slice(&[s - d.abs() - error * s, T::INFINITY]);
        }
        for (key, (&d, &s)) in of_singles.iter_mut().zip(centred.skip(pairs)) {
            *key = s - d - error * s;
        }
        for &row in working {
            self.hide(tables, row as usize);
        }
        let blocks = self.block_key.iter_mut().zip(self.key.chunks(ROW_BLOCK));
        for (least, keys) in blocks {
            *least = keys
                .iter()
                .fold(T::INFINITY, |a, &k| if k < a { k } else { a });
        }
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

    /// Whether every row would have to be looked at.
    pub fn knows_nothing(&self) -> bool {
        self.forget
    }

    /// A violated row at `(x, z)` outside `working`: the worst of those listed, or of all. None only when there is none, or with
    /// `spares` when more than a quarter of the groups would have to be looked into.
    pub fn price(
        &mut self,
        tables: &Tables<'_, T>,
        z: &[T],
        working: &[u32],
        spares: bool,
    ) -> Priced<T> {
        self.travel(tables, z, working);
        if spares && self.is_long(tables) {
            return Priced {
                is_spared: true,
                ..Priced::NOTHING
            };
        }
        self.pricings += 1;
        if self.pricings == 2 {
            self.bound.fill(T::NAN);
        }
        let mut found = Priced::NOTHING;
        let listed = self.list.len;
        self.list.len = 0;
        for i in 0..listed {
            let row = self.list.rows[i].0 as usize;
            if self.key[row] < T::INFINITY {
                self.evaluate(tables, row, z, &mut found);
            }
        }
        if found.worst.is_some() || found.broken {
            return found;
        }
        let path = self.path;
        for block in 0..self.block_key.len() {
            let reached = reached(&tables.block_reach, block, path);
            if reached - self.block_key[block] > T::ZERO {
                let bound = self.scan(tables, block, z, &mut found);
                self.block_key[block] = reached - bound;
            }
        }
        found
    }

    /// Whether more than a quarter of the groups must be looked into.
    fn is_long(&self, tables: &Tables<'_, T>) -> bool {
        let mut open = 0;
        for (block, &key) in self.block_key.iter().enumerate() {
            open += usize::from(reached(&tables.block_reach, block, self.path) > key);
        }
        4 * open > self.block_key.len()
    }

    /// Prices a group of rows. Returns the largest of their bounds.
    fn scan(&mut self, tables: &Tables<'_, T>, block: usize, z: &[T], found: &mut Priced<T>) -> T {
        let first = block * ROW_BLOCK;
        let end = (first + ROW_BLOCK).min(tables.dims.rows);
        let middle = (2 * tables.found.pairs).clamp(first, end);
        let of_pairs = self.scan_rows::<2>(tables, first, middle, z, found);
        let of_others = self.scan_rows::<1>(tables, middle, end, z, found);
        of_pairs.max(of_others)
    }

    /// Rows `first..end`, `STEP` of them sharing one product.
    #[inline]
    fn scan_rows<const STEP: usize>(
        &mut self,
        tables: &Tables<'_, T>,
        first: usize,
        end: usize,
        z: &[T],
        found: &mut Priced<T>,
    ) -> T {
        let (nz, n, rows) = (z.len(), self.x.len(), first..end);
        let is_kept = self.pricings >= 2;
        let g = tables.g[first * nz..end * nz].chunks_exact(STEP * nz);
        let w = tables.w[first * n..end * n].chunks_exact(STEP * n);
        let scale = tables.scale[rows.clone()].chunks_exact(STEP);
        let [a, b, d] = tables
            .reach
            .map(|reach| reach[rows.clone()].chunks_exact(STEP));
        let key = self.key[rows.clone()].chunks_exact_mut(STEP);
        let bound = self.bound[rows].chunks_exact_mut(STEP);
        let mut largest = -T::INFINITY;
        let matrices = g.zip(w).zip(scale);
        let numbers = a.zip(b).zip(d).zip(key).zip(bound);
        for (i, (((g, w), scale), ((((a, b), d), key), bound))) in matrices.zip(numbers).enumerate()
        {
            let reached = a[0] * self.path[0] + b[0] * self.path[1] + d[0] * self.path[2];
            let mut at_most = reached - key[0];
            if at_most > T::ZERO {
                if !is_kept || bound[0].is_nan() {
                    bound[0] = scale[0] + dot(&w[..n], self.x);
                }
                let row = first + i * STEP;
                let q = dot(&g[..nz], z) - bound[0];
                at_most = found.weigh(row, q, scale[0], STEP == 2);
                key[0] = reached - at_most;
                if at_most > T::PRIMAL * scale[0] {
                    self.list.note(row, at_most);
                }
            }
            largest = largest.max(at_most);
        }
        largest
    }

    /// Measures one row, or a pair, and renews its bound.
    fn evaluate(&mut self, tables: &Tables<'_, T>, row: usize, z: &[T], found: &mut Priced<T>) {
        let (q, scale) = (self.residual(tables, row, z), tables.scale[row]);
        let q = found.weigh(row, q, scale, row < 2 * tables.found.pairs);
        self.key[row] = reached(&tables.reach, row, self.path) - q;
        if q > T::PRIMAL * scale {
            self.list.note(row, q);
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
