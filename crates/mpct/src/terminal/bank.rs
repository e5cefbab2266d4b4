//! The rows of all steps, laid out for programs on a few variables.
//!
//! Rows stand in layers: layer 0 holds the rows of θ ∈ λΘ, layer s + 1 those of step s, one row for each pair. For
//! every variable a layer lists the rows in which it stands, less those that no point of the box can violate.

use super::augmented::Augmented;
use super::boxes::Boxes;

/// A row: layer · pairs + pair.
pub(super) type Key = u32;

/// Rows by layer, in the scaled coordinates ẑ_l = z_l / β_l.
pub(super) struct Bank {
    /// β: half widths of a box.
    pub(super) beta: Vec<f64>,
    /// Whether the box of a coordinate holds O_0; others are larger than O at later steps only.
    pub(super) valid: Vec<bool>,
    layers: Vec<Layer>,
    pairs: usize,
}

struct Layer {
    /// Σ_l |r_l| β_l.
    totals: Vec<f64>,
    /// The rows in which each variable stands.
    starts: Vec<u32>,
    touching: Vec<u32>,
}

impl Bank {
    pub(super) fn new(system: &Augmented, boxes: &Boxes) -> Self {
        let mut bank = Self {
            beta: boxes.beta.clone(),
            valid: boxes.valid.clone(),
            layers: Vec::new(),
            pairs: system.pairs.len(),
        };
        bank.extend_to(system, 0);
        bank
    }

    /// Lays out the rows of steps 0, …, `step`, which the system must have.
    pub(super) fn extend_to(&mut self, system: &Augmented, step: usize) {
        while self.layers.len() < step + 2 {
            let layer = self.lay_out(system, self.layers.len());
            self.layers.push(layer);
        }
    }

    fn lay_out(&self, system: &Augmented, layer: usize) -> Layer {
        let key = |pair: usize| (layer * self.pairs + pair) as Key;
        let mut totals = Vec::with_capacity(self.pairs);
        let mut counts = vec![0_u32; system.dimension() + 1];
        for pair in 0..self.pairs {
            let mut total = 0.0;
            self.entries(system, key(pair), |_, v| total += v.abs());
            totals.push(total);
            if binds(system, pair, total) {
                self.entries(system, key(pair), |j, _| counts[j + 1] += 1);
            }
        }
        for j in 0..system.dimension() {
            counts[j + 1] += counts[j];
        }
        let starts = counts.clone();
        let mut touching = vec![0; counts[system.dimension()] as usize];
        for pair in 0..self.pairs {
            if binds(system, pair, totals[pair]) {
                self.entries(system, key(pair), |j, _| {
                    touching[counts[j] as usize] = pair as u32;
                    counts[j] += 1;
                });
            }
        }
        Layer {
            totals,
            starts,
            touching,
        }
    }

    /// Calls `f` with each entry of a row, scaled.
    #[inline]
    pub(super) fn entries(&self, system: &Augmented, key: Key, mut f: impl FnMut(usize, f64)) {
        let (layer, pair) = self.place(key);
        let (columns, values) = system.w(pair);
        if layer == 0 {
            for (&j, &v) in columns.iter().zip(values) {
                f(j as usize, v / system.scaling * self.beta[j as usize]);
            }
            return;
        }
        let (e_columns, e_values) = system.e_part(pair, layer - 1);
        for (&j, &v) in e_columns.iter().zip(e_values) {
            f(j as usize, v * self.beta[j as usize]);
        }
        for (&j, &v) in columns.iter().zip(values) {
            f(j as usize, v * self.beta[j as usize]);
        }
    }

    /// Layer and pair of a row.
    pub(super) fn place(&self, key: Key) -> (usize, usize) {
        (key as usize / self.pairs, key as usize % self.pairs)
    }

    /// The row of a pair after `step` steps.
    pub(super) fn moving(&self, pair: usize, step: usize) -> Key {
        ((step + 1) * self.pairs + pair) as Key
    }

    /// Σ_l |r_l| β_l: the value of a row over the box.
    pub(super) fn total(&self, key: Key) -> f64 {
        let (layer, pair) = self.place(key);
        self.layers[layer].totals[pair]
    }

    /// What the entries dropped from a row could amount to.
    pub(super) fn slack(&self, system: &Augmented, key: Key) -> f64 {
        match self.place(key) {
            (0, _) => 0.0,
            (layer, pair) => system.slack(pair, layer - 1),
        }
    }

    /// Number of rows in the layers of θ ∈ λΘ and steps 0, …, `known` − 1.
    pub(super) fn rows(&self, known: usize) -> usize {
        (known + 1) * self.pairs
    }

    /// The rows of a layer in which a variable stands and that a point of the box can violate.
    pub(super) fn touching(&self, layer: usize, variable: usize) -> &[u32] {
        let layer = &self.layers[layer];
        &layer.touching[layer.starts[variable] as usize..layer.starts[variable + 1] as usize]
    }
}

fn binds(system: &Augmented, pair: usize, total: f64) -> bool {
    total > system.pairs[pair].lower_bound().min(1.0)
}
