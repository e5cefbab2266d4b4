//! A random banded problem on arrays of fixed size, for the unit tests: this crate has no heap.

use super::{BandedData, BandedTables, Windows};
use crate::NO_ROW;

pub(crate) const NZ: usize = 120;
pub(crate) const PAIRS: usize = 200;
pub(crate) const STATES: usize = 40;
const BAND: usize = 9;

/// A 64-bit linear congruential generator.
pub(crate) struct Lcg(pub u64);

impl Lcg {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64) / (1_u64 << 53) as f64
    }
    pub fn signed(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }
    pub fn below(&mut self, n: usize) -> usize {
        (self.uniform() * n as f64) as usize
    }
}

/// The arrays; every window has the same length.
pub(crate) struct Arrays {
    h_first: [u32; NZ],
    h_start: [u32; NZ + 1],
    h: [f64; NZ * BAND],
    row_first: [u32; PAIRS],
    row_start: [u32; PAIRS + 1],
    row: [f64; PAIRS * BAND],
    state_first: [u32; PAIRS],
    state_start: [u32; PAIRS + 1],
    state: [f64; PAIRS * 3],
    bound: [f64; PAIRS],
    scale: [f64; PAIRS],
    groups: [u32; 21],
    none: [u32; NZ + 1],
    order: [u32; STATES],
    next: [u32; NZ],
}

impl Arrays {
    /// `decades` between the units of the variables; `dominance` of the diagonal: the larger, the faster what happens fades.
    pub fn random(random: &mut Lcg, decades: i32, dominance: f64) -> Self {
        let mut out = Self {
            h_first: core::array::from_fn(|v| v as u32),
            h_start: [0; NZ + 1],
            h: [0.0; NZ * BAND],
            row_first: core::array::from_fn(|i| (i * (NZ - BAND) / PAIRS) as u32),
            row_start: core::array::from_fn(|i| (i * BAND) as u32),
            row: [0.0; PAIRS * BAND],
            state_first: core::array::from_fn(|i| (i * (STATES - 3) / PAIRS) as u32),
            state_start: core::array::from_fn(|i| (3 * i) as u32),
            state: core::array::from_fn(|_| random.signed()),
            bound: core::array::from_fn(|_| 0.2 + random.uniform()),
            scale: [1.0; PAIRS],
            groups: core::array::from_fn(|g| (10 * g) as u32),
            none: [0; NZ + 1],
            order: core::array::from_fn(|i| i as u32),
            next: [NO_ROW; NZ],
        };
        let mut unit = [1.0; NZ];
        for u in &mut unit {
            for _ in 0..random.below(decades as usize + 1) {
                *u *= 10.0;
            }
        }
        let mut at = 0;
        for v in 0..NZ {
            let end = NZ.min(v + BAND);
            for w in v..end {
                let entry = if w == v { dominance } else { random.signed() };
                out.h[at + w - v] = entry * unit[v] * unit[w];
            }
            at += end - v;
            out.h_start[v + 1] = at as u32;
        }
        for i in 0..PAIRS {
            let mut square = 0.0;
            for k in 0..BAND {
                let entry = if random.below(3) == 0 {
                    0.0
                } else {
                    random.signed()
                };
                out.row[i * BAND + k] = entry * unit[out.row_first[i] as usize + k];
                square += entry * entry / dominance;
            }
            if square > 0.0 {
                for k in 0..BAND {
                    out.row[i * BAND + k] *= 1.0 / crate::Scalar::sqrt_core(square);
                }
            }
        }
        out
    }

    pub fn tables(&self) -> BandedTables<'_, f64> {
        let entries = self.h_start[NZ] as usize;
        let empty = |columns, rows: usize| {
            Windows::new(columns, &self.none[..rows], &self.none[..=rows], &[]).unwrap()
        };
        BandedTables::new(BandedData {
            hessian: Windows::new(NZ, &self.h_first, &self.h_start, &self.h[..entries]).unwrap(),
            linear_state: empty(STATES, NZ),
            linear_set_point: empty(0, NZ),
            rows: Windows::new(NZ, &self.row_first, &self.row_start, &self.row).unwrap(),
            rows_state: Windows::new(STATES, &self.state_first, &self.state_start, &self.state)
                .unwrap(),
            upper: &self.bound,
            lower: &self.bound,
            scale: &self.scale,
            groups: &self.groups,
            gain: empty(STATES, 1),
            first_input: empty(NZ, 1),
            input_rows: empty(1, 0),
            state_order: &self.order,
            set_point_order: &[],
            next_stage: &self.next,
        })
        .unwrap()
    }
}

/// Memory for [`super::workspace::divide`]: (numbers, indices).
pub(crate) const NUMBERS: usize = NZ * (2 * BAND + 20) + 8 * PAIRS;
pub(crate) const INDICES: usize = 2 * NZ + 3 * PAIRS + 200;
