//! What the tests share: random numbers, small matrices, and controllers built from scratch.
#![allow(dead_code)]

use mpct_runtime::{Dims, NO_ROW, QpData, Tables, prepare, prepare_gram};

/// A 64-bit linear congruential generator with fixed seeds: the tests are the same everywhere.
pub struct Lcg(pub u64);

impl Lcg {
    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64) / (1_u64 << 53) as f64
    }
    /// Uniform in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }
    pub fn below(&mut self, n: usize) -> usize {
        (self.uniform() * n as f64) as usize
    }
}

/// Row-major matrix.
#[derive(Clone, Debug)]
pub struct Mat {
    pub rows: usize,
    pub cols: usize,
    pub data: Vec<f64>,
}

impl Mat {
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self {
            rows,
            cols,
            data: vec![0.0; rows * cols],
        }
    }
    pub fn identity(n: usize) -> Self {
        let mut eye = Self::zeros(n, n);
        for i in 0..n {
            eye.data[i * n + i] = 1.0;
        }
        eye
    }
    pub fn from(rows: usize, cols: usize, data: &[f64]) -> Self {
        assert_eq!(data.len(), rows * cols);
        Self {
            rows,
            cols,
            data: data.to_vec(),
        }
    }
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.data[i * self.cols + j]
    }
    pub fn set(&mut self, i: usize, j: usize, v: f64) {
        self.data[i * self.cols + j] = v;
    }
    pub fn mul(&self, other: &Self) -> Self {
        assert_eq!(self.cols, other.rows);
        let mut out = Self::zeros(self.rows, other.cols);
        for i in 0..self.rows {
            for k in 0..self.cols {
                for j in 0..other.cols {
                    out.data[i * other.cols + j] += self.at(i, k) * other.at(k, j);
                }
            }
        }
        out
    }
    pub fn t(&self) -> Self {
        let mut out = Self::zeros(self.cols, self.rows);
        for i in 0..self.rows {
            for j in 0..self.cols {
                out.set(j, i, self.at(i, j));
            }
        }
        out
    }
    pub fn add(&self, other: &Self, s: f64) -> Self {
        let data = self
            .data
            .iter()
            .zip(&other.data)
            .map(|(a, b)| a + s * b)
            .collect();
        Self {
            rows: self.rows,
            cols: self.cols,
            data,
        }
    }
    pub fn scaled(&self, s: f64) -> Self {
        Self {
            rows: self.rows,
            cols: self.cols,
            data: self.data.iter().map(|a| a * s).collect(),
        }
    }
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        self.data
            .chunks(self.cols)
            .map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum())
            .collect()
    }
    /// Gauss–Jordan with partial pivoting: the solution of `self · X = right`.
    pub fn solve(&self, right: &Self) -> Self {
        let n = self.rows;
        let (mut a, mut x) = (self.clone(), right.clone());
        for k in 0..n {
            let p = (k..n)
                .max_by(|&i, &j| a.at(i, k).abs().total_cmp(&a.at(j, k).abs()))
                .unwrap();
            for j in 0..n {
                a.data.swap(k * n + j, p * n + j);
            }
            for j in 0..x.cols {
                x.data.swap(k * x.cols + j, p * x.cols + j);
            }
            let d = a.at(k, k);
            for i in (0..n).filter(|&i| i != k) {
                let f = a.at(i, k) / d;
                for j in 0..n {
                    let v = a.at(i, j) - f * a.at(k, j);
                    a.set(i, j, v);
                }
                for j in 0..x.cols {
                    let v = x.at(i, j) - f * x.at(k, j);
                    x.set(i, j, v);
                }
            }
            for j in 0..n {
                let v = a.at(k, j) / d;
                a.set(k, j, v);
            }
            for j in 0..x.cols {
                let v = x.at(k, j) / d;
                x.set(k, j, v);
            }
        }
        x
    }
}

/// A plant, its constraints `|x| ≤ x_max`, `|u| ≤ u_max`, and its equilibria.
pub struct Plant {
    pub a: Mat,
    pub b: Mat,
    pub x_max: Vec<f64>,
    pub u_max: Vec<f64>,
    pub m_x: Mat,
    pub m_u: Mat,
    pub q: f64,
    pub r: f64,
    pub o: f64,
}

/// A condensed problem in `z = (c, θ)` and what is needed to simulate it.
pub struct Problem {
    pub plant: Plant,
    pub dims: Dims,
    pub hessian: Vec<f64>,
    pub linear_state: Vec<f64>,
    pub linear_set_point: Vec<f64>,
    pub rows: Vec<f64>,
    pub rows_state: Vec<f64>,
    pub gain: Vec<f64>,
    pub feedforward: Vec<f64>,
    pub input_rows: Vec<f64>,
    pub shift: Vec<u32>,
}

impl Problem {
    pub fn data(&self) -> QpData<'_, f64> {
        QpData {
            dims: self.dims,
            hessian: &self.hessian,
            linear_state: &self.linear_state,
            linear_set_point: &self.linear_set_point,
            rows: &self.rows,
            rows_state: &self.rows_state,
            gain: &self.gain,
            feedforward: &self.feedforward,
            input_rows: &self.input_rows,
        }
    }
    pub fn linear(&self, x: &[f64], r: &[f64]) -> Vec<f64> {
        let nz = self.dims.variables();
        let fx = Mat::from(nz, self.dims.states, &self.linear_state).apply(x);
        let fr = Mat::from(nz, self.dims.set_point, &self.linear_set_point).apply(r);
        fx.iter().zip(fr).map(|(a, b)| a + b).collect()
    }
    pub fn bound(&self, x: &[f64]) -> Vec<f64> {
        Mat::from(self.dims.rows, self.dims.states, &self.rows_state)
            .apply(x)
            .iter()
            .map(|v| 1.0 + v)
            .collect()
    }
    pub fn next(&self, x: &[f64], u: &[f64]) -> Vec<f64> {
        self.plant
            .a
            .apply(x)
            .iter()
            .zip(self.plant.b.apply(u))
            .map(|(p, q)| p + q)
            .collect()
    }
    /// Residual of the conditions of optimality, by the independent checker.
    pub fn residual(&self, x: &[f64], r: &[f64], z: &[f64], y: &[f64]) -> f64 {
        let (f, b) = (self.linear(x, r), self.bound(x));
        mpct_runtime::verify(&self.hessian, &f, &self.rows, &b, z, y)
            .unwrap()
            .worst()
    }
    /// `(‖Gᵀy‖_∞, bᵀy, min y)`.
    pub fn farkas(&self, x: &[f64], y: &[f64]) -> (f64, f64, f64) {
        let g = Mat::from(self.dims.rows, self.dims.variables(), &self.rows);
        let image = g.t().apply(y).iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let bound = self.bound(x).iter().zip(y).map(|(b, y)| b * y).sum();
        (image, bound, y.iter().copied().fold(0.0, f64::min))
    }
}

pub fn full(rows: usize, sparse: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
    let mut y = vec![0.0; rows];
    for (row, value) in sparse {
        y[row] = value;
    }
    y
}

/// The tables of a problem, with or without the products of their rows.
pub fn tables_of(problem: &Problem, with_gram: bool) -> Vec<f64> {
    let dims = problem.dims;
    let mut numbers = vec![0.0; dims.tables_len()];
    let mut scratch = vec![0.0; dims.prepare_len()];
    let tables = prepare(&problem.data(), &mut numbers, &mut scratch).unwrap();
    if with_gram {
        let mut products = vec![0.0; tables.gram_len()];
        prepare_gram(&tables, &mut products).unwrap();
        numbers.extend(products);
    }
    assert_eq!(
        Tables::from_slice(dims, &numbers).unwrap().has_gram(),
        with_gram
    );
    numbers
}

fn riccati(p: &Plant) -> (Mat, Mat) {
    let (n, m) = (p.a.rows, p.b.cols);
    let (q, r) = (Mat::identity(n).scaled(p.q), Mat::identity(m).scaled(p.r));
    let mut cost = q.clone();
    let mut gain = Mat::zeros(m, n);
    for _ in 0..20_000 {
        let btp = p.b.t().mul(&cost);
        gain = r
            .add(&btp.mul(&p.b), 1.0)
            .solve(&btp.mul(&p.a))
            .scaled(-1.0);
        let closed = p.a.add(&p.b.mul(&gain), 1.0);
        let next = q
            .add(&gain.t().mul(&r).mul(&gain), 1.0)
            .add(&closed.t().mul(&cost).mul(&closed), 1.0);
        let change = next
            .add(&cost, -1.0)
            .data
            .iter()
            .fold(0.0_f64, |m, v| m.max(v.abs()));
        cost = next;
        if change < 1e-12 * cost.data.iter().fold(0.0_f64, |m, v| m.max(v.abs())) {
            break;
        }
    }
    (gain, cost)
}

/// Condenses (30): `N` free stages, `terminal` more under the terminal law, `θ` in `lambda` times the equilibria.
pub fn condense(plant: Plant, horizon: usize, terminal: usize, lambda: f64) -> Problem {
    let (n, m) = (plant.a.rows, plant.b.cols);
    let nz = (horizon + 1) * m;
    let (gain, cost) = riccati(&plant);
    let feedforward = plant.m_u.add(&gain.mul(&plant.m_x), -1.0);
    // x_j = xs · x + zs · z, u_j = K x_j + L θ + c_j.
    let (mut xs, mut zs) = (Mat::identity(n), Mat::zeros(n, nz));
    let (mut h, mut fx) = (Mat::zeros(nz, nz), Mat::zeros(nz, n));
    let (mut rows, mut rows_state, mut shift) = (Vec::new(), Vec::new(), Vec::new());
    let theta = |mat: &Mat| {
        let mut out = Mat::zeros(mat.rows, nz);
        for i in 0..mat.rows {
            for j in 0..m {
                out.set(i, nz - m + j, mat.at(i, j));
            }
        }
        out
    };
    let per_stage = 2 * (n + m);
    let mut stage_rows = |x_of_x: &Mat, x_of_z: &Mat, u_of_x: &Mat, u_of_z: &Mat, stage: usize| {
        let parts = [
            (x_of_x, x_of_z, &plant.x_max),
            (u_of_x, u_of_z, &plant.u_max),
        ];
        for (of_x, of_z, limit) in parts {
            for i in 0..of_x.rows {
                for sign in [1.0, -1.0] {
                    shift.push(if stage == 0 {
                        NO_ROW
                    } else {
                        (rows.len() / nz - per_stage) as u32
                    });
                    rows.extend((0..nz).map(|j| sign * of_z.at(i, j) / limit[i]));
                    rows_state.extend((0..n).map(|j| -sign * of_x.at(i, j) / limit[i]));
                }
            }
        }
    };
    for stage in 0..=horizon + terminal {
        let u_x = gain.mul(&xs);
        let mut u_z = gain.mul(&zs).add(&theta(&feedforward), 1.0);
        if stage < horizon {
            for i in 0..m {
                let v = u_z.at(i, stage * m + i) + 1.0;
                u_z.set(i, stage * m + i, v);
            }
        }
        stage_rows(&xs, &zs, &u_x, &u_z, stage);
        let (dx, du) = (
            zs.add(&theta(&plant.m_x), -1.0),
            u_z.add(&theta(&plant.m_u), -1.0),
        );
        if stage < horizon {
            h = h
                .add(&dx.t().mul(&dx), 2.0 * plant.q)
                .add(&du.t().mul(&du), 2.0 * plant.r);
            fx = fx
                .add(&dx.t().mul(&xs), 2.0 * plant.q)
                .add(&du.t().mul(&u_x), 2.0 * plant.r);
        } else if stage == horizon {
            h = h.add(&dx.t().mul(&cost).mul(&dx), 2.0);
            fx = fx.add(&dx.t().mul(&cost).mul(&xs), 2.0);
        }
        let next_x = plant.a.mul(&xs).add(&plant.b.mul(&u_x), 1.0);
        zs = plant.a.mul(&zs).add(&plant.b.mul(&u_z), 1.0);
        xs = next_x;
    }
    let offset = theta(&plant.m_x);
    h = h.add(&offset.t().mul(&offset), 2.0 * plant.o);
    let mut fr = Mat::zeros(nz, n + m);
    for i in 0..nz {
        for j in 0..n {
            fr.set(i, j, -2.0 * plant.o * offset.at(j, i));
        }
    }
    // θ ∈ λΘ.
    for (map, limit) in [(&plant.m_x, &plant.x_max), (&plant.m_u, &plant.u_max)] {
        for i in 0..map.rows {
            if (0..m).all(|j| map.at(i, j) == 0.0) {
                continue;
            }
            for sign in [1.0, -1.0] {
                shift.push((rows.len() / nz) as u32);
                rows.extend((0..nz).map(|j| {
                    if j < nz - m {
                        0.0
                    } else {
                        sign * map.at(i, j + m - nz) / (lambda * limit[i])
                    }
                }));
                rows_state.extend((0..n).map(|_| 0.0));
            }
        }
    }
    let mut input_rows = Vec::new();
    for i in 0..m {
        for sign in [1.0, -1.0] {
            input_rows.extend((0..m).map(|j| if i == j { sign / plant.u_max[i] } else { 0.0 }));
        }
    }
    let dims = Dims {
        states: n,
        inputs: m,
        horizon,
        set_point: n + m,
        rows: rows.len() / nz,
        input_rows: 2 * m,
    };
    Problem {
        plant,
        dims,
        hessian: h.data,
        linear_state: fx.data,
        linear_set_point: fr.data,
        rows,
        rows_state,
        gain: gain.data,
        feedforward: feedforward.data,
        input_rows,
        shift,
    }
}

/// The academic plant (4.1), `N = 10`, enough terminal stages for `λ = 0.9`.
pub fn academic() -> Problem {
    let plant = Plant {
        a: Mat::from(2, 2, &[1.0, 1.0, 0.0, 1.0]),
        b: Mat::from(2, 2, &[0.0, 0.5, 1.0, 0.5]),
        x_max: vec![3.0; 2],
        u_max: vec![2.0; 2],
        m_x: Mat::from(2, 2, &[1.0, 0.0, 0.0, -0.5]),
        m_u: Mat::from(2, 2, &[0.0, -0.5, 0.0, 1.0]),
        q: 10.0,
        r: 100.0,
        o: 1e4,
    };
    condense(plant, 10, 5, 0.9)
}

/// The drone (4.3) with `N = 5` and a chosen number of terminal stages.
pub fn drone(terminal: usize) -> Problem {
    let (mass, g, jx, jz, h) = (0.6, 9.81, 0.009_169_13, 0.010_080_64, 0.04);
    let mut a = Mat::zeros(16, 16);
    for i in 0..3 {
        a.set(i, 3 + i, 1.0);
        a.set(6 + i, 9 + i, 1.0);
    }
    a.set(3, 7, -g);
    a.set(4, 6, g);
    a.set(5, 12, -1.0 / mass);
    a.set(9, 13, 1.0 / jx);
    a.set(10, 14, 1.0 / jx);
    a.set(11, 15, 1.0 / jz);
    // (A, B; 0, 0) is nilpotent: the exponential series ends.
    let (mut power, mut sum) = (Mat::identity(16), Mat::identity(16));
    for k in 1..8 {
        power = power.mul(&a).scaled(h / f64::from(k));
        sum = sum.add(&power, 1.0);
    }
    let (mut ad, mut bd) = (Mat::zeros(12, 12), Mat::zeros(12, 4));
    for i in 0..12 {
        for j in 0..12 {
            ad.set(i, j, sum.at(i, j));
        }
        for j in 0..4 {
            bd.set(i, j, sum.at(i, 12 + j));
        }
    }
    let mut m_x = Mat::zeros(12, 4);
    for (j, i) in [0, 1, 2, 8].into_iter().enumerate() {
        m_x.set(i, j, 1.0);
    }
    let q = std::f64::consts::FRAC_PI_4;
    let plant = Plant {
        a: ad,
        b: bd,
        x_max: vec![3.0, 3.0, 3.0, 3.0, 3.0, 3.0, q, q, q, 3.0, 3.0, 3.0],
        u_max: vec![1.5, 0.043, 0.043, 0.043],
        m_x,
        m_u: Mat::zeros(4, 4),
        q: 10.0,
        r: 100.0,
        o: 1e6,
    };
    condense(plant, 5, terminal, 0.9)
}
