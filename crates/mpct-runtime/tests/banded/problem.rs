//! Random banded problems, kept dense: the tables of the regime are made from them, and so are the oracles.

use crate::common::Lcg;
use mpct_runtime::banded::{BandedData, BandedTables, Windows};
use mpct_runtime::{NO_ROW, Scalar, TableError};

/// A problem in the order of the tables, dense and as given (rows not scaled).
#[derive(Clone, Debug)]
pub struct Case {
    pub nz: usize,
    pub n: usize,
    pub nr: usize,
    pub m: usize,
    pub h: Vec<f64>,
    pub fx: Vec<f64>,
    pub fr: Vec<f64>,
    pub g: Vec<Vec<f64>>,
    pub v: Vec<Vec<f64>>,
    pub upper: Vec<f64>,
    pub lower: Vec<f64>,
    pub gain: Vec<f64>,
    pub first_input: Vec<f64>,
    pub input_rows: Vec<f64>,
    pub state_order: Vec<u32>,
    pub set_point_order: Vec<u32>,
    pub next_stage: Vec<u32>,
    /// Pairs in a group.
    pub group: usize,
}

/// What a random problem is made of.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    pub blocks: usize,
    pub size: usize,
    /// Blocks side by side in a grid; 1 for a chain.
    pub width: usize,
    /// Decades between the units of the variables (the square root of those of H).
    pub decades: f64,
    /// Decades down to the smallest eigenvalue of H, about.
    pub conditioning: f64,
    /// Repeated, nearly parallel, opposite and empty rows.
    pub nasty: bool,
}

impl Kind {
    pub fn random(random: &mut Lcg, largest: usize) -> Self {
        let size = 1 + random.below(6);
        let blocks = (20 + random.below(largest - 19)).div_ceil(size);
        let is_grid = random.below(3) == 0;
        Self {
            blocks,
            size,
            width: if is_grid { 1 + random.below(6) } else { 1 },
            decades: [0.0, 1.0, 3.0][random.below(3)],
            conditioning: [2.0, 4.0][random.below(2)],
            nasty: random.below(2) == 0,
        }
    }
}

fn shuffled(random: &mut Lcg, count: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    for k in (1..count).rev() {
        order.swap(k, random.below(k + 1));
    }
    order
}

impl Case {
    /// Two states for each block: the first moves f and the rows, the second closes the gap between opposite rows when it is 1.
    pub fn random(random: &mut Lcg, kind: Kind) -> Self {
        let Kind { blocks, size, .. } = kind;
        let (nz, n) = (blocks * size, 2 * blocks);
        let unit: Vec<f64> = (0..nz)
            .map(|_| 10.0_f64.powf(kind.decades * random.uniform()))
            .collect();
        let near = |random: &mut Lcg, b: usize| -> Vec<usize> {
            let mut of = vec![b];
            for other in [b + 1, b + kind.width] {
                if other < blocks && random.below(2) == 0 && !of.contains(&other) {
                    of.push(other);
                }
            }
            of
        };
        let row = |random: &mut Lcg, b: usize, length: f64| -> Vec<f64> {
            let mut out = vec![0.0; nz];
            for block in near(random, b) {
                for v in block * size..(block + 1) * size {
                    if random.below(4) > 0 {
                        out[v] = length * unit[v] * random.signed();
                    }
                }
            }
            out
        };
        let mut h = vec![0.0; nz * nz];
        let floor = 10.0_f64.powf(-kind.conditioning * random.uniform());
        for v in 0..nz {
            h[v * nz + v] = floor * unit[v] * unit[v];
        }
        for b in 0..blocks {
            for _ in 0..1 + size {
                let a = row(random, b, 0.7);
                for i in (0..nz).filter(|&i| a[i] != 0.0) {
                    for j in (0..nz).filter(|&j| a[j] != 0.0) {
                        h[i * nz + j] += a[i] * a[j];
                    }
                }
            }
        }
        let mut rows = Vec::new();
        for b in 0..blocks {
            for _ in 0..1 + random.below(2 * size + 1) {
                let length = 10.0_f64.powf(random.signed());
                let g = row(random, b, length);
                let mut v = vec![0.0; n];
                for block in near(random, b) {
                    v[2 * block] = 0.1 * random.signed();
                }
                let both = random.below(3);
                let side = |random: &mut Lcg| 0.2 + random.uniform();
                let (upper, lower) = (side(random), side(random));
                rows.push((
                    g,
                    v,
                    if both == 1 { f64::INFINITY } else { upper },
                    if both == 2 { f64::INFINITY } else { lower },
                ));
                if kind.nasty && random.below(4) == 0 {
                    let twin = Self::twin(random, rows.last().unwrap(), b);
                    rows.push(twin);
                }
            }
        }
        let first = |g: &[f64]| g.iter().position(|&a| a != 0.0).unwrap_or(0);
        rows.sort_by_key(|r| first(&r.0));
        let mut fx = vec![0.0; nz * n];
        let mut fr = vec![0.0; nz * nz];
        for v in 0..nz {
            fx[v * n + 2 * (v / size)] = unit[v] * random.signed();
            fr[v * nz + v] = unit[v];
        }
        let m = blocks.min(5);
        let mut gain = vec![0.0; m * n];
        let mut first_input = vec![0.0; m * nz];
        let mut input_rows = vec![0.0; 2 * m * m];
        for i in 0..m {
            gain[i * n + 2 * i] = 10.0 * random.signed();
            first_input[i * nz + i * size] = 1.0;
            input_rows[2 * i * m + i] = 2.0;
            input_rows[(2 * i + 1) * m + i] = -2.0;
        }
        let next_stage = (0..nz)
            .map(|v| match v % size {
                _ if v % 7 == 6 => v as u32,
                k if k + 1 < size => v as u32 + 1,
                _ => NO_ROW,
            })
            .collect();
        let (g, v) = rows.iter().map(|r| (r.0.clone(), r.1.clone())).unzip();
        let (upper, lower) = rows.iter().map(|r| (r.2, r.3)).unzip();
        Self {
            nz,
            n,
            nr: nz,
            m,
            h,
            fx,
            fr,
            g,
            v,
            upper,
            lower,
            gain,
            first_input,
            input_rows,
            state_order: shuffled(random, n),
            set_point_order: shuffled(random, nz),
            next_stage,
            group: 1 + random.below(30),
        }
    }

    /// A row that is hard to bear beside another one.
    #[allow(clippy::type_complexity)]
    fn twin(
        random: &mut Lcg,
        of: &(Vec<f64>, Vec<f64>, f64, f64),
        block: usize,
    ) -> (Vec<f64>, Vec<f64>, f64, f64) {
        let (g, v, upper, lower) = of.clone();
        let scale = |a: &[f64], s: f64| -> Vec<f64> { a.iter().map(|w| w * s).collect() };
        match random.below(5) {
            0 => (g, v, upper, lower),
            1 => (scale(&g, 3.0), scale(&v, 3.0), 3.0 * upper, 3.0 * lower),
            2 => {
                // Nearly parallel.
                let size = [1e-3, 1e-6, 1e-9][random.below(3)];
                let g = g
                    .iter()
                    .map(|w| w * (1.0 + size * random.signed()))
                    .collect();
                (g, v, upper, lower)
            }
            3 => {
                // Opposite; the gap is thin when the second state of the block is 1.
                let gap = [1e-1, 1e-3, 1e-6, 1e-8, 1e-9, 0.0][random.below(6)];
                let other = 0.5;
                let mut shift = scale(&v, -1.0);
                let bound = if upper < f64::INFINITY { upper } else { 2.0 };
                shift[2 * block + 1] = other + bound - gap;
                (scale(&g, -1.0), shift, other, f64::INFINITY)
            }
            _ => (scale(&g, 0.0), v, 0.4, 0.4),
        }
    }

    pub fn in_order(order: &[u32], x: &[f64]) -> Vec<f64> {
        order.iter().map(|&at| x[at as usize]).collect()
    }

    pub fn linear(&self, x: &[f64], r: &[f64]) -> Vec<f64> {
        let (x, r) = (
            Self::in_order(&self.state_order, x),
            Self::in_order(&self.set_point_order, r),
        );
        let product = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(p, q)| p * q).sum() };
        (0..self.nz)
            .map(|k| {
                product(&self.fx[k * self.n..(k + 1) * self.n], &x)
                    + product(&self.fr[k * self.nr..(k + 1) * self.nr], &r)
            })
            .collect()
    }

    /// All sides one below the other, `G z ≤ b`, and which pair and side each is.
    pub fn one_sided(&self, x: &[f64]) -> (Vec<f64>, Vec<f64>, Vec<(usize, bool)>) {
        let x = Self::in_order(&self.state_order, x);
        let (mut g, mut b, mut which) = (Vec::new(), Vec::new(), Vec::new());
        for pair in 0..self.g.len() {
            let state: f64 = self.v[pair].iter().zip(&x).map(|(p, q)| p * q).sum();
            for (sign, bound) in [(1.0, self.upper[pair]), (-1.0, self.lower[pair])] {
                if bound < f64::INFINITY {
                    g.extend(self.g[pair].iter().map(|w| sign * w));
                    b.push(bound - sign * state);
                    which.push((pair, sign > 0.0));
                }
            }
        }
        (g, b, which)
    }

    /// Signed multipliers of pairs as multipliers of those rows.
    pub fn spread(which: &[(usize, bool)], y: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
        let mut out = vec![0.0; which.len()];
        for (pair, value) in y {
            let at = which.iter().position(|&w| w == (pair, value > 0.0));
            out[at.expect("a multiplier on a side without a bound")] = value.abs();
        }
        out
    }
}

/// Rows by windows, owned.
#[derive(Clone, Debug)]
pub struct OwnedWindows<T> {
    pub columns: usize,
    pub first: Vec<u32>,
    pub start: Vec<u32>,
    pub values: Vec<T>,
}

impl<T: Scalar> OwnedWindows<T> {
    /// From dense rows; `scale` multiplies each. `ordered`: an empty row stands where the one before it does.
    fn new(columns: usize, rows: &[Vec<f64>], scale: Option<&[f64]>, ordered: bool) -> Self {
        let mut out = Self {
            columns,
            first: Vec::new(),
            start: vec![0],
            values: Vec::new(),
        };
        for (i, row) in rows.iter().enumerate() {
            let s = scale.map_or(1.0, |s| s[i]);
            let from = row.iter().position(|&v| v != 0.0);
            let end = row.iter().rposition(|&v| v != 0.0).map_or(0, |e| e + 1);
            let before = if ordered {
                out.first.last().copied().unwrap_or(0)
            } else {
                0
            };
            out.first.push(from.map_or(before, |f| f as u32));
            out.values
                .extend((from.unwrap_or(0)..end).map(|j| T::from_f64(s * row[j])));
            out.start.push(out.values.len() as u32);
        }
        out
    }

    fn dense(columns: usize, data: &[f64]) -> Self {
        let rows: Vec<Vec<f64>> = data.chunks(columns).map(<[f64]>::to_vec).collect();
        Self::new(columns, &rows, None, false)
    }

    pub fn view(&self) -> Result<Windows<'_, T>, TableError> {
        Windows::new(self.columns, &self.first, &self.start, &self.values)
    }
}

/// The arrays of [`BandedData`], owned.
#[derive(Clone, Debug)]
pub struct Owned<T> {
    /// H, F_x, F_r, G, V, K, C, E.
    pub windows: [OwnedWindows<T>; 8],
    pub upper: Vec<T>,
    pub lower: Vec<T>,
    pub scale: Vec<T>,
    pub groups: Vec<u32>,
    pub state_order: Vec<u32>,
    pub set_point_order: Vec<u32>,
    pub next_stage: Vec<u32>,
}

impl<T: Scalar> Owned<T> {
    pub fn new(case: &Case) -> Self {
        let nz = case.nz;
        let scale: Vec<f64> = case
            .g
            .iter()
            .map(|row| {
                let square: f64 = (0..nz).map(|v| row[v] * row[v] / case.h[v * nz + v]).sum();
                square.sqrt().inverse_power_of_two()
            })
            .collect();
        let triangle: Vec<Vec<f64>> = (0..nz)
            .map(|i| {
                (0..nz)
                    .map(|j| if j < i { 0.0 } else { case.h[i * nz + j] })
                    .collect()
            })
            .collect();
        let bounds = |bounds: &[f64]| -> Vec<T> {
            bounds
                .iter()
                .zip(&scale)
                .map(|(b, s)| T::from_f64(b * s))
                .collect()
        };
        let pairs = case.g.len();
        Self {
            windows: [
                OwnedWindows::new(nz, &triangle, None, false),
                OwnedWindows::dense(case.n, &case.fx),
                OwnedWindows::dense(case.nr, &case.fr),
                OwnedWindows::new(nz, &case.g, Some(&scale), true),
                OwnedWindows::new(case.n, &case.v, Some(&scale), false),
                OwnedWindows::dense(case.n, &case.gain),
                OwnedWindows::dense(nz, &case.first_input),
                OwnedWindows::dense(case.m, &case.input_rows),
            ],
            upper: bounds(&case.upper),
            lower: bounds(&case.lower),
            scale: scale.iter().map(|&s| T::from_f64(s)).collect(),
            groups: (0..pairs)
                .step_by(case.group)
                .chain([pairs])
                .map(|g| g as u32)
                .collect(),
            state_order: case.state_order.clone(),
            set_point_order: case.set_point_order.clone(),
            next_stage: case.next_stage.clone(),
        }
    }

    pub fn data(&self) -> Result<BandedData<'_, T>, TableError> {
        let [h, fx, fr, g, v, k, c, e] = &self.windows;
        Ok(BandedData {
            hessian: h.view()?,
            linear_state: fx.view()?,
            linear_set_point: fr.view()?,
            rows: g.view()?,
            rows_state: v.view()?,
            upper: &self.upper,
            lower: &self.lower,
            scale: &self.scale,
            groups: &self.groups,
            gain: k.view()?,
            first_input: c.view()?,
            input_rows: e.view()?,
            state_order: &self.state_order,
            set_point_order: &self.set_point_order,
            next_stage: &self.next_stage,
        })
    }

    pub fn tables(&self) -> Result<BandedTables<'_, T>, TableError> {
        BandedTables::new(self.data()?)
    }
}
