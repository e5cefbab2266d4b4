//! The working set and the factors of its Gram matrix, `M_W M_Wᵀ = L D Lᵀ`.
//!
//! A row enters by one forward substitution and leaves by the rank-one update of Gill, Golub, Murray and Saunders (1974,
//! method C1), which only ever adds to `D` and is therefore stable.

use crate::Scalar;
use crate::dense::{axpy, dot};

/// Rows in the working set, always linearly independent, and their factors.
#[derive(Debug)]
pub(crate) struct Factor<'a, T> {
    nz: usize,
    len: usize,
    /// Row numbers, in the order of the factors.
    index: &'a mut [u32],
    /// `M_W`, one row of length `nz` after the other.
    rows: &'a mut [T],
    /// `L` below its unit diagonal, by rows.
    lower: &'a mut [T],
    diagonal: &'a mut [T],
    column: &'a mut [T],
    /// Rows removed since the factors were last computed afresh.
    removals: u32,
}

/// What the working set knows about one more row `m`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projection<T> {
    /// `|m|²`.
    pub length: T,
    /// `|m − M_Wᵀ a|²`, the part the working set does not span.
    pub outside: T,
}

/// Start of row `i` of the packed strict lower triangle.
#[inline(always)]
fn start(i: usize) -> usize {
    i * i.saturating_sub(1) / 2
}

impl<'a, T: Scalar> Factor<'a, T> {
    /// Buffers: `index: nz`, `rows: nz²`, `lower: nz(nz−1)/2`, `diagonal`, `column: nz`.
    pub fn new(
        nz: usize,
        index: &'a mut [u32],
        rows: &'a mut [T],
        lower: &'a mut [T],
        diagonal: &'a mut [T],
        column: &'a mut [T],
    ) -> Self {
        Self {
            nz,
            len: 0,
            index,
            rows,
            lower,
            diagonal,
            column,
            removals: 0,
        }
    }

    pub fn len(&self) -> usize {
        self.len
    }

    pub fn index(&self) -> &[u32] {
        &self.index[..self.len]
    }

    /// Rows in the working set and rows removed.
    pub fn counters(&self) -> [usize; 2] {
        [self.len, self.removals as usize]
    }

    pub fn set_counters(&mut self, [len, removals]: [usize; 2]) {
        self.len = if len <= self.nz { len } else { 0 };
        self.removals = removals as u32;
    }

    pub fn clear(&mut self) {
        self.len = 0;
        self.removals = 0;
    }

    #[inline(always)]
    fn row(&self, i: usize) -> &[T] {
        &self.rows[i * self.nz..(i + 1) * self.nz]
    }

    /// `w −= M_Wᵀ a`.
    pub fn subtract(&self, a: &[T], w: &mut [T]) {
        // Two rows at a time, so that `w` is read and written half as often.
        let (pairs, last) = a[..self.len].as_chunks::<2>();
        let mut rows = self.rows.chunks_exact(self.nz);
        for &[a, b] in pairs {
            let (Some(p), Some(q)) = (rows.next(), rows.next()) else {
                return;
            };
            for ((wi, &pi), &qi) in w.iter_mut().zip(p).zip(q) {
                *wi -= a * pi + b * qi;
            }
        }
        if let ([a], Some(row)) = (last, rows.next()) {
            axpy(-*a, row, w);
        }
    }

    /// `L y = y`, in place.
    fn forward(&self, y: &mut [T]) {
        for i in 1..self.len {
            let row = &self.lower[start(i)..start(i) + i];
            let (head, tail) = y.split_at_mut(i);
            tail[0] -= dot(row, head);
        }
    }

    /// `Lᵀ y = y`, in place.
    fn backward(&self, y: &mut [T]) {
        for i in (1..self.len).rev() {
            let row = &self.lower[start(i)..start(i) + i];
            let (head, tail) = y.split_at_mut(i);
            axpy(-tail[0], row, head);
        }
    }

    /// `(M_W M_Wᵀ) y = y`, in place.
    pub fn solve(&self, y: &mut [T]) {
        let y = &mut y[..self.len];
        self.forward(y);
        for (yi, &d) in y.iter_mut().zip(self.diagonal.iter()) {
            *yi = *yi / d;
        }
        self.backward(y);
    }

    /// Splits `m = M_Wᵀ a + ρ` with `M_W ρ = 0`. Writes `a`, `ρ` and `half = L⁻¹ M_W m`.
    pub fn project(&self, m: &[T], half: &mut [T], a: &mut [T], rho: &mut [T]) -> Projection<T> {
        let k = self.len;
        for (h, row) in half[..k].iter_mut().zip(self.rows.chunks_exact(self.nz)) {
            *h = dot(row, m);
        }
        self.forward(&mut half[..k]);
        for i in 0..k {
            a[i] = half[i] / self.diagonal[i];
        }
        self.backward(&mut a[..k]);
        rho.copy_from_slice(m);
        self.subtract(a, rho);
        let (length, mut outside) = (dot(m, m), dot(rho, rho));
        // Nearly dependent: what is left is mostly the error of `a`. Project the remainder once more.
        for _ in 0..2 {
            if k == 0 || outside >= T::REPROJECT * length {
                break;
            }
            let mut left = T::ZERO;
            for i in 0..k {
                self_dot(self.row(i), rho, &mut half[self.nz + i], &mut left);
            }
            if left == T::ZERO {
                break;
            }
            let (_, again) = half.split_at_mut(self.nz);
            self.solve(again);
            for i in 0..k {
                a[i] += again[i];
            }
            self.subtract(&again[..k], rho);
            outside = dot(rho, rho);
        }
        Projection { length, outside }
    }

    /// The same from products: `half` holds `M_W m` and becomes `L⁻¹ M_W m`; `length` is `|m|²`. Writes `a` and returns
    /// the part outside, which cancellation spoils when it is small beside `length`.
    pub fn project_products(&self, length: T, half: &mut [T], a: &mut [T]) -> T {
        let k = self.len;
        self.forward(&mut half[..k]);
        let mut outside = length;
        for i in 0..k {
            a[i] = half[i] / self.diagonal[i];
            outside -= half[i] * a[i];
        }
        self.backward(&mut a[..k]);
        outside
    }

    /// Adds row number `index` with image `m`; `half` and `outside` come from [`Factor::project`].
    /// Without effect when the working set is full, which independent rows cannot exceed.
    pub fn append(&mut self, index: u32, m: &[T], half: &[T], outside: T) -> bool {
        let k = self.len;
        if k >= self.nz || !(outside > T::ZERO) {
            return false;
        }
        self.index[k] = index;
        self.rows[k * self.nz..(k + 1) * self.nz].copy_from_slice(m);
        for i in 0..k {
            self.lower[start(k) + i] = half[i] / self.diagonal[i];
        }
        self.diagonal[k] = outside;
        self.len = k + 1;
        true
    }

    /// Removes the row at position `at`.
    pub fn remove(&mut self, at: usize) {
        let k = self.len;
        if at >= k {
            return;
        }
        let (nz, tail) = (self.nz, k - at - 1);
        // Rows below move up by one and lose column `at`, which is kept aside.
        for i in at + 1..k {
            let (from, to) = (start(i), start(i - 1));
            self.column[i - at - 1] = self.lower[from + at];
            self.lower.copy_within(from..from + at, to);
            self.lower.copy_within(from + at + 1..from + i, to + at);
        }
        let mut weight = self.diagonal[at];
        self.diagonal.copy_within(at + 1..k, at);
        self.index.copy_within(at + 1..k, at);
        self.rows.copy_within((at + 1) * nz..k * nz, at * nz);
        self.len = k - 1;
        self.removals += 1;
        // L̃ D̃ L̃ᵀ = L₃ D₃ L₃ᵀ + weight · column columnᵀ.
        for j in 0..tail {
            let p = self.column[j];
            let old = self.diagonal[at + j];
            let new = old + weight * p * p;
            let beta = weight * p / new;
            weight = weight * old / new;
            self.diagonal[at + j] = new;
            for i in j + 1..tail {
                let entry = &mut self.lower[start(at + i) + at + j];
                self.column[i] -= p * *entry;
                *entry += beta * self.column[i];
            }
        }
    }

    /// Whether so many rows left that the factors should be computed afresh.
    pub fn is_worn(&self) -> bool {
        self.removals > 200
    }

    /// Computes the factors afresh from the rows. A row that proves dependent is dropped.
    pub fn rebuild(&mut self, half: &mut [T], a: &mut [T], rho: &mut [T], m: &mut [T]) {
        let count = self.len;
        self.clear();
        for i in 0..count {
            let index = self.index[i];
            m.copy_from_slice(&self.rows[i * self.nz..(i + 1) * self.nz]);
            let p = self.project(m, half, a, rho);
            if p.outside > T::DEPENDENT * p.length {
                self.append(index, m, half, p.outside);
            }
        }
    }
}

#[inline(always)]
fn self_dot<T: Scalar>(row: &[T], rho: &[T], out: &mut T, left: &mut T) {
    *out = dot(row, rho);
    *left = left.max(out.abs());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_and_go_and_solves_stay_right() {
        const NZ: usize = 6;
        let mut state = 7_u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let (mut index, mut rows, mut lower) =
            ([0_u32; NZ], [0.0; NZ * NZ], [0.0; NZ * (NZ - 1) / 2]);
        let (mut diagonal, mut column) = ([0.0; NZ], [0.0; NZ]);
        let mut factor = Factor::new(
            NZ,
            &mut index,
            &mut rows,
            &mut lower,
            &mut diagonal,
            &mut column,
        );
        let (mut half, mut a, mut rho) = ([0.0; 2 * NZ], [0.0; NZ], [0.0; NZ]);
        for round in 0..500_u32 {
            if factor.len() == NZ || (factor.len() > 0 && random() > 0.2) {
                factor.remove(((random() + 0.5) * factor.len() as f64) as usize);
            } else {
                let m: [f64; NZ] = core::array::from_fn(|_| random());
                let p = factor.project(&m, &mut half, &mut a, &mut rho);
                assert!(factor.append(round, &m, &half, p.outside));
            }
            let k = factor.len();
            let right: [f64; NZ] = core::array::from_fn(|_| random());
            let mut y = right;
            factor.solve(&mut y);
            let mut image = [0.0; NZ];
            factor.subtract(&y[..k], &mut image);
            for i in 0..k {
                assert!(
                    (dot(factor.row(i), &image) + right[i]).abs() < 1e-7,
                    "{round}"
                );
            }
        }
    }
}
