//! Products with the Hessian and with its inverse root, by blocks where they are block diagonal.

use crate::dense::{axpy, dot, gemv_add};
use crate::{Scalar, Tables};

impl<T: Scalar> Tables<'_, T> {
    /// `y += H x`.
    #[inline]
    pub(crate) fn hessian_mul_add(&self, x: &[T], y: &mut [T]) {
        match self.found.block {
            1 => self.hessian_blocks::<1>(x, y),
            2 => self.hessian_blocks::<2>(x, y),
            3 => self.hessian_blocks::<3>(x, y),
            4 => self.hessian_blocks::<4>(x, y),
            block if block == x.len() => gemv_add(self.hessian, x, y),
            block => {
                let rows = self.hessian.chunks_exact(x.len().max(1));
                for (k, (yi, row)) in y.iter_mut().zip(rows).enumerate() {
                    let own = k / block * block..(k / block + 1) * block;
                    *yi += dot(&row[own.clone()], &x[own]);
                }
            }
        }
    }

    /// The same for blocks of a size that the compiler knows.
    #[inline]
    fn hessian_blocks<const B: usize>(&self, x: &[T], y: &mut [T]) {
        let rows = self.hessian.chunks_exact(x.len() * B);
        let parts = y
            .as_chunks_mut::<B>()
            .0
            .iter_mut()
            .zip(x.as_chunks::<B>().0);
        for (k, ((y, x), rows)) in parts.zip(rows).enumerate() {
            for (yi, row) in y.iter_mut().zip(rows.chunks_exact(rows.len() / B)) {
                if let Some(row) = row.get(k * B..).and_then(|r| r.first_chunk::<B>()) {
                    for lane in 0..B {
                        *yi += row[lane] * x[lane];
                    }
                }
            }
        }
    }

    /// `y += R⁻¹ x`.
    #[inline]
    pub(crate) fn root_mul_add(&self, x: &[T], y: &mut [T]) {
        match self.found.block {
            1 => self.root_blocks::<1>(x, y),
            2 => self.root_blocks::<2>(x, y),
            3 => self.root_blocks::<3>(x, y),
            4 => self.root_blocks::<4>(x, y),
            block => {
                let (mut rest, mut left) = (self.root_inverse, x.len());
                for (y, part) in y.chunks_exact_mut(block).zip(x.chunks_exact(block)) {
                    for (k, yi) in y.iter_mut().enumerate() {
                        let (row, tail) = rest.split_at(left);
                        *yi += dot(&row[..block - k], &part[k..]);
                        (rest, left) = (tail, left - 1);
                    }
                }
            }
        }
    }

    /// The same for blocks of a size that the compiler knows.
    #[inline]
    fn root_blocks<const B: usize>(&self, x: &[T], y: &mut [T]) {
        let (mut rest, mut left) = (self.root_inverse, x.len());
        for (y, x) in y
            .as_chunks_mut::<B>()
            .0
            .iter_mut()
            .zip(x.as_chunks::<B>().0)
        {
            for k in 0..B {
                let (row, tail) = rest.split_at(left);
                for (&r, &v) in row.iter().zip(&x[k..]) {
                    y[k] += r * v;
                }
                (rest, left) = (tail, left - 1);
            }
        }
    }

    /// `y = R⁻ᵀ x`.
    #[inline]
    pub(crate) fn root_transpose_mul(&self, x: &[T], y: &mut [T]) {
        let block = self.found.block;
        y.fill(T::ZERO);
        let (mut rest, mut left) = (self.root_inverse, x.len());
        for (y, part) in y.chunks_exact_mut(block).zip(x.chunks_exact(block)) {
            for (k, &xk) in part.iter().enumerate() {
                let (row, tail) = rest.split_at(left);
                // Rows of early stages have many exact zeros.
                if xk != T::ZERO {
                    axpy(xk, &row[..block - k], &mut y[k..]);
                }
                (rest, left) = (tail, left - 1);
            }
        }
    }
}
