//! The inner loops of the simplex method, in the widest vectors that the machine has.
//!
//! The compiler may assume the oldest processor of an architecture only; `pulp` chooses when the program runs. A sum is
//! taken in several parts, so that its rounding depends on the machine. Nothing may rest on the last bits of a kernel.

use pulp::{Arch, Simd, WithSimd};

/// Chooses the vectors once.
#[derive(Clone, Copy)]
pub(crate) struct Kernels(Arch);

impl Default for Kernels {
    fn default() -> Self {
        Self(Arch::new())
    }
}

impl std::fmt::Debug for Kernels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Kernels")
    }
}

impl Kernels {
    /// out_k = (row k) · v for all rows of a row-major matrix.
    pub(crate) fn products(self, matrix: &[f64], v: &[f64], out: &mut Vec<f64>) {
        out.clear();
        out.resize(matrix.len() / v.len().max(1), 0.0);
        self.0.dispatch(Products { matrix, v, out });
    }

    /// out_i = (row `rows[i]`) · v.
    pub(crate) fn products_of(self, matrix: &[f64], rows: &[usize], v: &[f64], out: &mut Vec<f64>) {
        out.clear();
        out.resize(rows.len(), 0.0);
        self.0.dispatch(ProductsOf {
            matrix,
            rows,
            v,
            out,
        });
    }

    /// Every row k of a row-major matrix, less factor_k · v.
    pub(crate) fn subtract_outer(self, matrix: &mut [f64], factors: &[f64], v: &[f64]) {
        self.0.dispatch(Outer { matrix, factors, v });
    }
}

struct Products<'a> {
    matrix: &'a [f64],
    v: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let rows = self.matrix.chunks_exact(self.v.len().max(1));
        for (row, out) in rows.zip(self.out) {
            *out = dot(simd, row, self.v);
        }
    }
}

struct ProductsOf<'a> {
    matrix: &'a [f64],
    rows: &'a [usize],
    v: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for ProductsOf<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.v.len();
        for (&k, out) in self.rows.iter().zip(self.out) {
            *out = dot(simd, &self.matrix[k * width..(k + 1) * width], self.v);
        }
    }
}

/// Four sums side by side, so that no addition waits for the one before.
#[inline(always)]
fn dot<S: Simd>(simd: S, a: &[f64], b: &[f64]) -> f64 {
    let (a, a_tail) = S::as_simd_f64s(a);
    let (b, b_tail) = S::as_simd_f64s(b);
    let mut sums = [simd.splat_f64s(0.0); 4];
    let (a_fours, a_rest) = a.as_chunks::<4>();
    let (b_fours, b_rest) = b.as_chunks::<4>();
    for (a, b) in a_fours.iter().zip(b_fours) {
        for i in 0..4 {
            sums[i] = simd.mul_add_e_f64s(a[i], b[i], sums[i]);
        }
    }
    for (a, b) in a_rest.iter().zip(b_rest) {
        sums[0] = simd.mul_add_e_f64s(*a, *b, sums[0]);
    }
    let [s, t, u, v] = sums;
    let sum = simd.add_f64s(simd.add_f64s(s, t), simd.add_f64s(u, v));
    let tail: f64 = a_tail.iter().zip(b_tail).map(|(a, b)| a * b).sum();
    simd.reduce_sum_f64s(sum) + tail
}

struct Outer<'a> {
    matrix: &'a mut [f64],
    factors: &'a [f64],
    v: &'a [f64],
}

impl WithSimd for Outer<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (v, v_tail) = S::as_simd_f64s(self.v);
        let rows = self.matrix.chunks_exact_mut(self.v.len().max(1));
        for (row, &factor) in rows.zip(self.factors) {
            if factor == 0.0 {
                continue;
            }
            let (row, row_tail) = S::as_mut_simd_f64s(row);
            let minus = simd.splat_f64s(-factor);
            for (a, b) in row.iter_mut().zip(v) {
                *a = simd.mul_add_e_f64s(minus, *b, *a);
            }
            for (a, b) in row_tail.iter_mut().zip(v_tail) {
                *a -= factor * b;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_are_the_plain_loops() {
        for width in [1, 3, 4, 8, 17, 40] {
            let rows = 5;
            let matrix: Vec<f64> = (0..rows * width).map(|i| (i as f64 * 0.7).sin()).collect();
            let v: Vec<f64> = (0..width).map(|i| (i as f64 * 1.3).cos()).collect();
            let mut out = vec![9.0; 99];
            Kernels::default().products(&matrix, &v, &mut out);
            assert_eq!(out.len(), rows);
            for (row, found) in matrix.chunks(width).zip(&out) {
                let expected: f64 = row.iter().zip(&v).map(|(a, b)| a * b).sum();
                assert!((expected - found).abs() < 1e-14, "{width}");
            }
            Kernels::default().products_of(&matrix, &[4, 1], &v, &mut out);
            for (k, found) in [4, 1].into_iter().zip(&out) {
                let row = &matrix[k * width..(k + 1) * width];
                let expected: f64 = row.iter().zip(&v).map(|(a, b)| a * b).sum();
                assert!((expected - found).abs() < 1e-14, "{width}");
            }
            let factors = [1.0, 0.0, -2.0, 0.5, 3.0];
            let mut changed = matrix.clone();
            Kernels::default().subtract_outer(&mut changed, &factors, &v);
            for (i, found) in changed.iter().enumerate() {
                let expected = matrix[i] - factors[i / width] * v[i % width];
                assert!((expected - found).abs() < 1e-14, "{width}");
            }
        }
    }
}
