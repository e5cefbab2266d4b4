//! The few dense kernels everything else is made of.
//!
//! Four running sums per product: the order of additions is fixed by the source, so results have the same bits
//! everywhere, and the compiler is free to use vector registers.

use crate::Scalar;

const LANES: usize = 4;

/// `aᵀb` over the shorter length.
#[inline(always)]
pub(crate) fn dot<T: Scalar>(a: &[T], b: &[T]) -> T {
    dot_in::<T, LANES>(a, b)
}

/// The same with eight running sums: for long vectors, where four would wait for each other.
#[inline(always)]
pub(crate) fn long_dot<T: Scalar>(a: &[T], b: &[T]) -> T {
    dot_in::<T, 8>(a, b)
}

/// `aᵀb` in `L` running sums, a power of two, of which halves are added until one is left.
#[inline(always)]
fn dot_in<T: Scalar, const L: usize>(a: &[T], b: &[T]) -> T {
    if a.len() != b.len() {
        let shorter = if a.len() < b.len() { a.len() } else { b.len() };
        return dot_in::<T, L>(&a[..shorter], &b[..shorter]);
    }
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<L>(), b.as_chunks::<L>());
    let (mut sums, mut rest) = ([T::ZERO; L], T::ZERO);
    for (&p, &q) in a_rest.iter().zip(b_rest) {
        rest += p * q;
    }
    for (p, q) in a.iter().zip(b) {
        for lane in 0..L {
            sums[lane] += p[lane] * q[lane];
        }
    }
    let mut half = L / 2;
    while half > 0 {
        for lane in 0..half {
            sums[lane] += sums[lane + half];
        }
        half /= 2;
    }
    sums[0] + rest
}

/// `y += s·x`.
#[inline(always)]
pub(crate) fn axpy<T: Scalar>(s: T, x: &[T], y: &mut [T]) {
    for (yi, &xi) in y.iter_mut().zip(x) {
        *yi += s * xi;
    }
}

/// `y += A x`, `A` row-major with `x.len()` columns.
#[inline]
pub(crate) fn gemv_add<T: Scalar>(a: &[T], x: &[T], y: &mut [T]) {
    if x.is_empty() {
        return;
    }
    for (yi, row) in y.iter_mut().zip(a.chunks_exact(x.len())) {
        *yi += dot(row, x);
    }
}

/// `y = Uᵀ x`, `U` upper triangular, rows packed one after the other (row `k` has `n − k` entries).
#[inline]
pub(crate) fn upper_transpose_mul<T: Scalar>(u: &[T], x: &[T], y: &mut [T]) {
    y.fill(T::ZERO);
    let mut rest = u;
    for k in 0..x.len().min(y.len()) {
        let (row, tail) = rest.split_at(x.len() - k);
        // Rows of early stages have many exact zeros.
        if x[k] != T::ZERO {
            axpy(x[k], row, &mut y[k..]);
        }
        rest = tail;
    }
}

/// Largest absolute value; +∞ when any entry is not finite.
#[inline]
pub(crate) fn max_abs<T: Scalar>(x: &[T]) -> T {
    // Lanes without branches; `0 · v` is NaN for what is not finite.
    let (mut largest, mut zeros) = ([T::ZERO; LANES], [T::ZERO; LANES]);
    let (chunks, rest) = x.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            let v = chunk[lane].abs();
            largest[lane] = if v > largest[lane] { v } else { largest[lane] };
            zeros[lane] += T::ZERO * v;
        }
    }
    for (lane, &v) in rest.iter().enumerate() {
        largest[lane] = largest[lane].max(v.abs());
        zeros[lane] += T::ZERO * v;
    }
    if (zeros[0] + zeros[2]) + (zeros[1] + zeros[3]) == T::ZERO {
        largest[0].max(largest[2]).max(largest[1].max(largest[3]))
    } else {
        T::INFINITY
    }
}

/// Whether every entry is finite: `0 · v` is 0 for finite `v` and NaN otherwise.
#[inline]
pub(crate) fn all_finite<T: Scalar>(x: &[T]) -> bool {
    let mut sum = T::ZERO;
    for &v in x {
        sum += T::ZERO * v;
    }
    sum == T::ZERO
}

/// Upper bound of `‖a − b‖₂`.
#[inline]
pub(crate) fn distance_upper<T: Scalar>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::ZERO; LANES];
    let (a4, b4) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    for (&p, &q) in a4.remainder().iter().zip(b4.remainder()) {
        sums[0] += (p - q) * (p - q);
    }
    for (p, q) in a4.zip(b4) {
        for lane in 0..LANES {
            sums[lane] += (p[lane] - q[lane]) * (p[lane] - q[lane]);
        }
    }
    ((sums[0] + sums[2]) + (sums[1] + sums[3])).sqrt_upper()
}
