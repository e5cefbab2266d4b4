//! Matrices as nested vectors, products as loops.

use mpct::SparseMatrix;

pub type Mat = Vec<Vec<f64>>;

pub fn dense(m: &SparseMatrix) -> Mat {
    let mut out = zeros(m.rows(), m.cols());
    for (i, j, v) in m.entries() {
        out[i][j] = v;
    }
    out
}

pub fn zeros(rows: usize, cols: usize) -> Mat {
    vec![vec![0.0; cols]; rows]
}

pub fn identity(n: usize) -> Mat {
    let mut m = zeros(n, n);
    for (i, row) in m.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    m
}

pub fn mul(a: &Mat, b: &Mat) -> Mat {
    let cols = b.first().map_or(0, Vec::len);
    a.iter()
        .map(|row| {
            assert_eq!(row.len(), b.len(), "inner dimensions");
            let mut out = vec![0.0; cols];
            for (v, other) in row.iter().zip(b) {
                if *v != 0.0 {
                    for (o, w) in out.iter_mut().zip(other) {
                        *o += v * w;
                    }
                }
            }
            out
        })
        .collect()
}

pub fn apply(a: &Mat, x: &[f64]) -> Vec<f64> {
    a.iter().map(|row| dot(row, x)).collect()
}

/// aᵀ x.
pub fn apply_transposed(a: &Mat, x: &[f64]) -> Vec<f64> {
    assert_eq!(a.len(), x.len());
    let mut out = vec![0.0; a.first().map_or(0, Vec::len)];
    for (row, xi) in a.iter().zip(x) {
        for (o, v) in out.iter_mut().zip(row) {
            *o += v * xi;
        }
    }
    out
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub fn transpose(a: &Mat) -> Mat {
    let cols = a.first().map_or(0, Vec::len);
    (0..cols)
        .map(|j| a.iter().map(|row| row[j]).collect())
        .collect()
}

/// alpha a + beta b.
pub fn combine(alpha: f64, a: &Mat, beta: f64, b: &Mat) -> Mat {
    a.iter()
        .zip(b)
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| alpha * a + beta * b).collect())
        .collect()
}

pub fn max_abs(a: &Mat) -> f64 {
    a.iter()
        .flatten()
        .fold(0.0, |largest, v| largest.max(v.abs()))
}

pub fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |largest, v| largest.max(v.abs()))
}

pub fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

pub fn plus(a: &[f64], b: &[f64]) -> Vec<f64> {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// The largest difference of two vectors.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    largest(&minus(a, b))
}

/// vᵀ W v.
pub fn quadratic(w: &Mat, v: &[f64]) -> f64 {
    dot(v, &apply(w, v))
}

/// a⁻¹ b by Gaussian elimination with partial pivoting; `None` when a pivot vanishes.
pub fn solve(a: &Mat, b: &Mat) -> Option<Mat> {
    let n = a.len();
    let mut work: Mat = a
        .iter()
        .zip(b)
        .map(|(a, b)| a.iter().chain(b).copied().collect())
        .collect();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| work[i][k].abs().total_cmp(&work[j][k].abs()))?;
        work.swap(k, pivot);
        if !(work[k][k].abs() > 1e-300) {
            return None;
        }
        let (done, rest) = work.split_at_mut(k + 1);
        let row = &done[k];
        for other in rest {
            let factor = other[k] / row[k];
            if factor != 0.0 {
                for (o, v) in other[k..].iter_mut().zip(&row[k..]) {
                    *o -= factor * v;
                }
            }
        }
    }
    for k in (0..n).rev() {
        let (before, rest) = work.split_at_mut(k);
        let row = &mut rest[0];
        let pivot = row[k];
        for v in &mut row[n..] {
            *v /= pivot;
        }
        for other in before {
            let factor = other[k];
            if factor != 0.0 {
                for (o, v) in other[n..].iter_mut().zip(&row[n..]) {
                    *o -= factor * v;
                }
            }
        }
    }
    Some(work.into_iter().map(|row| row[n..].to_vec()).collect())
}

/// Rank by Gaussian elimination with full pivoting, relative to the largest entry.
pub fn rank(a: &Mat, tolerance: f64) -> usize {
    let mut work = a.clone();
    let scale = max_abs(a);
    let cols = a.first().map_or(0, Vec::len);
    let mut rank = 0;
    while rank < work.len().min(cols) {
        let mut best = (rank, rank, 0.0);
        for (i, row) in work.iter().enumerate().skip(rank) {
            for (j, v) in row.iter().enumerate().skip(rank) {
                if v.abs() > best.2 {
                    best = (i, j, v.abs());
                }
            }
        }
        if !(best.2 > tolerance * scale) {
            break;
        }
        work.swap(rank, best.0);
        for row in &mut work {
            row.swap(rank, best.1);
        }
        let (done, rest) = work.split_at_mut(rank + 1);
        let row = &done[rank];
        for other in rest {
            let factor = other[rank] / row[rank];
            for (o, v) in other.iter_mut().zip(row) {
                *o -= factor * v;
            }
        }
        rank += 1;
    }
    rank
}

/// A bound of the spectral radius from above: ‖a^(2^k)‖^(1/2^k) in the Frobenius norm, which tends to it.
pub fn spectral_radius_bound(a: &Mat, doublings: u32) -> f64 {
    let norm = |m: &Mat| m.iter().flatten().map(|v| v * v).sum::<f64>().sqrt();
    let (mut power, mut log_scale, mut count) = (a.clone(), 0.0, 1.0);
    for _ in 0..doublings {
        let size = norm(&power);
        if size == 0.0 {
            return 0.0;
        }
        for v in power.iter_mut().flatten() {
            *v /= size;
        }
        log_scale = 2.0 * (log_scale + size.ln());
        power = mul(&power, &power);
        count *= 2.0;
    }
    ((log_scale + norm(&power).ln()) / count).exp()
}
