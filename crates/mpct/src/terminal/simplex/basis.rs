//! The basis: B⁻¹, the multipliers y with Bᵀ y = w, and the vertex z with B z = b.

use super::{Basic, DualSimplex, Rows};
use crate::linalg::{self, Dense};

/// Distance between the two sides of a basic row; infinite when the other side is no constraint.
pub(super) fn width(rows: &Rows<'_>, skip: Option<(usize, bool)>, basic: Basic) -> f64 {
    match basic {
        Basic::Box(..) => 2.0,
        Basic::Row(k, side) if skip == Some((k, side < 0.0)) => f64::INFINITY,
        Basic::Row(k, _) => rows.upper[k] + rows.lower[k],
    }
}

impl DualSimplex {
    /// The vertex of the box in the direction of w: its multipliers are |w|.
    pub(super) fn start_at_box(&mut self, w: &[f64]) {
        let d = w.len();
        self.inverse.clear();
        self.inverse.resize(d * d, 0.0);
        self.basis.clear();
        self.y.clear();
        self.z.clear();
        self.alpha.clear();
        self.alpha.resize(d, 0.0);
        self.candidates.clear();
        self.worst = f64::INFINITY;
        self.reach = f64::INFINITY;
        self.pivots = 0;
        self.since_fresh = 0;
        for (j, &wj) in w.iter().enumerate() {
            let side = if wj < 0.0 { -1.0 } else { 1.0 };
            self.inverse[j * d + j] = side;
            self.basis.push(Basic::Box(j, side));
            self.y.push(wj.abs());
            self.z.push(side);
        }
    }

    /// The basic row l to its opposite bound.
    pub(super) fn flip(&mut self, d: usize, l: usize) {
        for v in &mut self.inverse[l * d..(l + 1) * d] {
            *v = -*v;
        }
        self.y[l] = -self.y[l];
        self.basis[l] = match self.basis[l] {
            Basic::Box(j, side) => Basic::Box(j, -side),
            Basic::Row(k, side) => Basic::Row(k, -side),
        };
    }

    /// Puts `entering` in the place of the basic row `l`; `violation` is what is left of its violation.
    pub(super) fn exchange(&mut self, d: usize, l: usize, entering: Basic, violation: f64) {
        let pivot = self.alpha[l];
        // Of a multiplier that was flipped the sign has changed, and with it what may be clipped.
        let step = self.y[l].max(0.0) / pivot;
        for (c, y) in self.y.iter_mut().enumerate() {
            *y -= step * self.alpha[c];
        }
        self.y[l] = step;
        self.basis[l] = entering;
        self.reach = f64::INFINITY;
        self.update_inverse(d, l);
        for (z, v) in self.z.iter_mut().zip(&self.column) {
            *z -= violation * v;
        }
    }

    /// The rank-one change of B⁻¹ when a row with products `alpha` takes the place of the basic row l; `column` is then
    /// the new column of that place.
    fn update_inverse(&mut self, d: usize, l: usize) {
        let pivot = std::mem::replace(&mut self.alpha[l], 0.0);
        self.column.clear();
        self.column
            .extend(self.inverse[l * d..(l + 1) * d].iter().map(|v| v / pivot));
        let (inverse, alpha, column) = (&mut self.inverse, &self.alpha, &self.column);
        self.kernels.subtract_outer(inverse, alpha, column);
        self.inverse[l * d..(l + 1) * d].copy_from_slice(&self.column);
    }

    /// B⁻¹, y and z from the basis itself. False when the basis is singular.
    pub(super) fn refresh(&mut self, rows: &Rows<'_>, w: &[f64]) -> bool {
        let d = rows.width;
        let b = Dense::from_fn(d, d, |c, j| match self.basis[c] {
            Basic::Box(k, side) if k == j => side,
            Basic::Box(..) => 0.0,
            Basic::Row(k, side) => side * rows.row(k)[j],
        });
        let Some(inverse) = linalg::inverse(&b) else {
            return false;
        };
        for (c, column) in self.inverse.chunks_exact_mut(d).enumerate() {
            for (i, v) in column.iter_mut().enumerate() {
                *v = inverse[(i, c)];
            }
        }
        self.since_fresh = 0;
        for (column, y) in self.inverse.chunks_exact(d).zip(&mut self.y) {
            *y = column.iter().zip(w).map(|(a, b)| a * b).sum();
        }
        self.vertex(rows);
        true
    }

    /// z from B z = b.
    fn vertex(&mut self, rows: &Rows<'_>) {
        let d = rows.width;
        self.z.clear();
        self.z.resize(d, 0.0);
        for (c, column) in self.inverse.chunks_exact(d).enumerate() {
            let bound = match self.basis[c] {
                Basic::Box(..) => 1.0,
                Basic::Row(k, side) if side > 0.0 => rows.upper[k],
                Basic::Row(k, _) => rows.lower[k],
            };
            for (z, v) in self.z.iter_mut().zip(column) {
                *z += bound * v;
            }
        }
    }
}
