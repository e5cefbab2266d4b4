//! The factors L D Lᵀ of H + ρ G_WᵀG_W, W the active rows, stored by columns within their band.
//!
//! A row that comes or goes changes the factors where its window is and fades from there on, since the inverse of a banded,
//! well-conditioned matrix decays with the distance from the diagonal. Updates and solutions stop where what is left does not
//! matter: their cost does not depend on the number of subsystems.
//!
//! Updates: Gill, Golub, Murray, Saunders, "Methods for modifying matrix factorizations", Mathematics of Computation 28, 1974.

use super::tables::BandedTables;
use super::windows::Windows;
use crate::Scalar;
use crate::dense::{axpy, long_dot};
use core::ops::Range;

/// Columns between two looks at whether anything is left.
const STRIDE: usize = 16;
/// A pivot may shrink to this part of what it was before the factors are computed afresh. Smaller, and its remaining digits are
/// rounding: three digits stay in f32.
fn shrunk<T: Scalar>() -> T {
    if T::EPSILON.to_f64() < 1e-10 {
        T::from_f64(1e-9)
    } else {
        T::from_f64(1e-4)
    }
}

/// What is left of the solution for one row is too little when it is below this part of its largest entry. The next solution on all active rows,
/// which every round begins with, makes good what is left out; smaller, and a row costs more columns for nothing.
fn faded_solution<T: Scalar>() -> T {
    if T::EPSILON.to_f64() < 1e-10 {
        T::from_f64(2e-10)
    } else {
        T::EPSILON
    }
}

/// The same for what an update adds to the factors, which stays there: the next rounds converge by its product with ρ, 1e-8, in place of
/// by rounding.
fn faded_update<T: Scalar>() -> T {
    if T::EPSILON.to_f64() < 1e-10 {
        T::from_f64(2e-13)
    } else {
        T::EPSILON
    }
}

#[derive(Debug)]
pub(crate) struct Factor<'w, T> {
    /// Row after the last of each column.
    pub end: &'w mut [u32],
    /// Where the entries of each column begin.
    pub start: &'w mut [u32],
    pub lower: &'w mut [T],
    pub diagonal: &'w mut [T],
}

impl<T: Scalar> Factor<'_, T> {
    /// The shape, from the tables.
    pub fn shape(&mut self, tables: &BandedTables<'_, T>) {
        let mut at = 0;
        tables.for_each_reach(|v, end| {
            self.end[v] = end as u32;
            self.start[v] = at as u32;
            at += end - v - 1;
        });
        self.start[tables.variables()] = at as u32;
    }

    #[inline(always)]
    fn column(&self, v: usize) -> &[T] {
        &self.lower[self.start[v] as usize..self.start[v + 1] as usize]
    }

    /// Largest magnitude of `x` from `from` to the end of the band there.
    fn left(&self, x: &[T], from: usize) -> T {
        let to = self.end[from] as usize;
        let mut largest = T::ZERO;
        for &v in &x[from..to] {
            largest = largest.max(v.abs());
        }
        largest
    }

    /// Computes the factors of H + Σ ρᵢ gᵢgᵢᵀ over `active`. False when a pivot is not positive.
    pub fn compute(
        &mut self,
        hessian: &Windows<'_, T>,
        rows: &Windows<'_, T>,
        active: &[u32],
        stiff: &[T],
    ) -> bool {
        let size = self.diagonal.len();
        self.lower.fill(T::ZERO);
        for v in 0..size {
            let row = hessian.row(v);
            self.diagonal[v] = row[0];
            // Ends where the shape ends: no panic on tables that the shape was not made for.
            let at = self.start[v] as usize;
            for (to, &h) in self.lower[at..].iter_mut().zip(&row[1..]) {
                *to = h;
            }
        }
        for &pair in active {
            let (row, first) = (rows.row(pair as usize), rows.window(pair as usize).start);
            let stiffness = stiff[pair as usize];
            for (k, &g) in row.iter().enumerate() {
                if g == T::ZERO {
                    continue;
                }
                let v = first + k;
                self.diagonal[v] += stiffness * g * g;
                let at = self.start[v] as usize;
                axpy(stiffness * g, &row[k + 1..], &mut self.lower[at..]);
            }
        }
        for v in 0..size {
            let pivot = self.diagonal[v];
            if !(pivot > T::ZERO) || !pivot.is_finite() {
                return false;
            }
            let inverse = T::ONE / pivot;
            let (done, rest) = self.lower.split_at_mut(self.start[v + 1] as usize);
            let column = &mut done[self.start[v] as usize..];
            let offset = self.start[v + 1] as usize;
            for k in 0..column.len() {
                let entry = column[k];
                if entry == T::ZERO {
                    continue;
                }
                let (ratio, row) = (entry * inverse, v + 1 + k);
                self.diagonal[row] -= ratio * entry;
                let at = self.start[row] as usize - offset;
                axpy(-ratio, &column[k + 1..], &mut rest[at..]);
            }
            for entry in column {
                *entry = *entry * inverse;
            }
        }
        true
    }

    /// Adds `weight` · row rowᵀ. `scratch` is zero outside of this call. False when the factors are spoilt.
    pub fn update(
        &mut self,
        rows: &Windows<'_, T>,
        pair: usize,
        weight: T,
        scratch: &mut [T],
    ) -> bool {
        let (row, window) = (rows.row(pair), rows.window(pair));
        let Some(mut largest) = row.first().map(|_| T::ZERO) else {
            return true;
        };
        for &g in row {
            largest = largest.max(g.abs());
        }
        let faded = largest * faded_update();
        scratch[window.clone()].copy_from_slice(row);
        let (mut weight, mut sound) = (weight, true);
        let size = self.diagonal.len();
        let mut v = window.start;
        while v < size {
            if v >= window.end
                && (v - window.end).is_multiple_of(STRIDE)
                && !(self.left(scratch, v) > faded)
            {
                break;
            }
            let p = scratch[v];
            scratch[v] = T::ZERO;
            if p != T::ZERO {
                let old = self.diagonal[v];
                let new = old + weight * p * p;
                if !(new > shrunk::<T>() * old) || !new.is_finite() {
                    sound = false;
                    break;
                }
                let beta = weight * p / new;
                weight = weight * (old / new);
                self.diagonal[v] = new;
                let (from, to) = (self.start[v] as usize, self.start[v + 1] as usize);
                let column = &mut self.lower[from..to];
                let below = &mut scratch[v + 1..];
                for (entry, x) in column.iter_mut().zip(below) {
                    *x -= p * *entry;
                    *entry += beta * *x;
                }
            }
            v += 1;
        }
        let end = self.end[v.min(size - 1)] as usize;
        scratch[window.start.min(v)..end].fill(T::ZERO);
        sound
    }

    /// `x` becomes the solution.
    pub fn solve(&self, x: &mut [T]) {
        let size = x.len();
        for v in 0..size {
            let p = x[v];
            if p != T::ZERO {
                axpy(-p, self.column(v), &mut x[v + 1..]);
            }
        }
        for v in (0..size).rev() {
            let column = self.column(v);
            x[v] = x[v] / self.diagonal[v] - long_dot(column, &x[v + 1..v + 1 + column.len()]);
        }
    }

    /// The solution for a row of `rows` on the right, where it has not faded: `x` is written in the returned range only.
    pub fn solve_row(&self, rows: &Windows<'_, T>, pair: usize, x: &mut [T]) -> Range<usize> {
        let window = rows.window(pair);
        if window.is_empty() {
            return window;
        }
        let size = self.diagonal.len();
        let clear = self.end[window.end - 1] as usize;
        x[window.start..clear].fill(T::ZERO);
        x[window.clone()].copy_from_slice(rows.row(pair));
        // Forward, as far as anything is left. `known` is where x is valid.
        let (mut v, mut known, mut largest) = (window.start, clear, T::ZERO);
        while v < size {
            let reach = self.end[v] as usize;
            if reach > known {
                x[known..reach].fill(T::ZERO);
                known = reach;
            }
            if v >= window.end
                && (v - window.end).is_multiple_of(STRIDE)
                && !(self.left(x, v) > largest * faded_solution())
            {
                break;
            }
            let p = x[v];
            largest = largest.max(p.abs());
            if p != T::ZERO {
                axpy(-p, self.column(v), &mut x[v + 1..]);
            }
            v += 1;
        }
        let end = v;
        x[end..known].fill(T::ZERO);
        // Backward, from there to where nothing is left above the window.
        let (mut largest, mut v) = (T::ZERO, end);
        while v > 0 {
            v -= 1;
            let column = self.column(v);
            let right = if v >= window.start {
                x[v] / self.diagonal[v]
            } else {
                T::ZERO
            };
            x[v] = right - long_dot(column, &x[v + 1..v + 1 + column.len()]);
            largest = largest.max(x[v].abs());
            if v < window.start
                && (window.start - v).is_multiple_of(STRIDE)
                && !(self.left(x, v) > largest * faded_solution())
            {
                break;
            }
        }
        v..end
    }
}

#[cfg(test)]
#[path = "factor_tests.rs"]
mod tests;
