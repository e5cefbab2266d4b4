//! One step of the method: which basic row leaves.

use super::basis::width;
use super::{Basic, DualSimplex, Rows};

/// Entries of α smaller than this, relative to the largest, are no pivots.
const PIVOT: f64 = 1e-9;
/// Pivots smaller than this, relative to the largest candidate, are taken only from a fresh inverse.
const DOUBTFUL: f64 = 1e-5;
/// The ratio test lets multipliers become this negative if that gives a larger pivot (Harris). The verdict counts
/// negative multipliers as left over.
const HARRIS: f64 = 1e-12;
/// What became of a pivot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pivot {
    Made,
    /// Only a small one was found, and the inverse is not fresh: nothing was changed.
    Doubtful,
    /// No row can leave, which exact arithmetic excludes: the origin is feasible.
    None,
}

/// Rows whose multipliers fall that are put in order at first.
const FIRST_FEW: usize = 12;

impl DualSimplex {
    /// Exchanges the entering row for one whose multiplier reaches zero first, up to rounding.
    ///
    /// A row whose multiplier would change its sign may also stay in the basis at its opposite bound (Maros, section
    /// 7.6): z then moves by the width of that row, and as long as the entering row stays violated the bound goes on
    /// falling. One pivot does the work of several.
    pub(super) fn pivot(
        &mut self,
        rows: &Rows<'_>,
        entering: Basic,
        violation: f64,
        skip: Option<(usize, bool)>,
        fresh: bool,
    ) -> Pivot {
        let d = rows.width;
        // α = B⁻ᵀ r: the entering row as a combination of the basic ones.
        match entering {
            Basic::Row(k, side) => {
                let kernels = self.kernels;
                kernels.products(&self.inverse, rows.row(k), &mut self.alpha);
                if side < 0.0 {
                    self.alpha.iter_mut().for_each(|a| *a = -*a);
                }
            }
            Basic::Box(j, side) => {
                self.alpha.clear();
                let columns = self.inverse.chunks_exact(d);
                self.alpha.extend(columns.map(|column| side * column[j]));
            }
        }
        let largest = self.alpha.iter().fold(0.0_f64, |l, a| l.max(a.abs()));
        let smallest = PIVOT * largest;
        let Self {
            alpha, y, falling, ..
        } = self;
        falling.clear();
        let entries = alpha.iter().zip(y.iter()).enumerate();
        falling.extend(
            entries
                .filter(|(_, (a, _))| **a > smallest)
                .map(|(c, (a, y))| (y.max(0.0) / a, c)),
        );
        // A step seldom passes more than a few rows: only these are put in order.
        let in_order = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0);
        if falling.len() > FIRST_FEW {
            falling.select_nth_unstable_by(FIRST_FEW, in_order);
            falling[..FIRST_FEW].sort_unstable_by(in_order);
        } else {
            falling.sort_unstable_by(in_order);
        }
        let mut sorted = FIRST_FEW;
        // Rows before `first` go to their opposite bounds.
        let (mut first, mut left) = (0, violation);
        let leaving = loop {
            let Some(rest) = falling.get(first..).filter(|r| !r.is_empty()) else {
                return Pivot::None;
            };
            // Multipliers may become a little negative if that gives a larger pivot (Harris).
            let step = rest
                .iter()
                .map(|&(ratio, c)| ratio + HARRIS / alpha[c])
                .fold(f64::INFINITY, f64::min);
            let count = rest.partition_point(|r| r.0 <= step).max(1);
            if first + count >= sorted && sorted < falling.len() {
                falling[sorted..].sort_unstable_by(in_order);
                sorted = falling.len();
                continue;
            }
            let width: f64 = rest[..count]
                .iter()
                .map(|&(_, c)| alpha[c] * width(rows, skip, self.basis[c]))
                .sum();
            if left > width {
                left -= width;
                first += count;
                continue;
            }
            let best = rest[..count]
                .iter()
                .max_by(|a, b| alpha[a.1].total_cmp(&alpha[b.1]));
            match best {
                Some(&(_, c)) => break c,
                None => return Pivot::None,
            }
        };
        if !fresh && self.alpha[leaving] < DOUBTFUL * largest {
            return Pivot::Doubtful;
        }
        for at in 0..first {
            let c = self.falling[at].1;
            let width = width(rows, skip, self.basis[c]);
            let column = &self.inverse[c * d..(c + 1) * d];
            for (z, v) in self.z.iter_mut().zip(column) {
                *z -= width * v;
            }
            self.alpha[c] = -self.alpha[c];
            self.flip(d, c);
        }
        self.exchange(d, leaving, entering, left);
        Pivot::Made
    }
}
