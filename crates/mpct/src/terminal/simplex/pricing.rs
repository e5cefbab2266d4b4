//! Pricing: which row enters the basis.

use super::{Basic, DualSimplex, Rows};

/// A row violated by less than this, relative to its norm, counts as satisfied. The answers are checked against
/// their own bound afterwards, so this only has to stop the method from chasing rounding.
const FEASIBILITY: f64 = 1e-11;
/// Rows kept from a pass over all of them.
const CANDIDATES: usize = 60;
/// A candidate is stale when it is violated by less than this share of the worst at the last pass. Choosing always the
/// worst of all rows costs twice the pivots: on dense plants of 120 variables 620 against 330.
const STALE: f64 = 0.05;
impl DualSimplex {
    /// The row, or side of the box, to enter the basis, with its violation.
    pub(super) fn entering(
        &mut self,
        rows: &Rows<'_>,
        skip: Option<(usize, bool)>,
    ) -> Option<(Basic, f64)> {
        if let Some((scaled, basic, violation)) = self.worst_candidate(rows)
            && scaled > STALE * self.worst
        {
            return Some((basic, violation));
        }
        self.look_at_all(rows, skip);
        let (scaled, basic, violation) = self.worst_candidate(rows)?;
        self.worst = scaled;
        Some((basic, violation))
    }

    /// The candidate violated most: relative to its norm, and absolutely.
    fn worst_candidate(&mut self, rows: &Rows<'_>) -> Option<(f64, Basic, f64)> {
        self.places.clear();
        self.places
            .extend(self.candidates.iter().filter_map(|c| match c.1 {
                Basic::Row(k, _) => Some(k),
                Basic::Box(..) => None,
            }));
        let values = &mut self.candidate_values;
        self.kernels
            .products_of(rows.coefficients, &self.places, &self.z, values);
        let mut worst = FEASIBILITY;
        let mut found = None;
        let mut values = self.candidate_values.iter();
        for &(_, basic) in &self.candidates {
            let (violation, inverse_norm) = match basic {
                Basic::Box(j, side) => (side * self.z[j] - 1.0, 1.0),
                Basic::Row(k, side) => {
                    let bound = if side > 0.0 {
                        rows.upper[k]
                    } else {
                        rows.lower[k]
                    };
                    let value = values.next().copied().unwrap_or(0.0);
                    (side * value - bound, rows.inverse_norms[k])
                }
            };
            let scaled = violation * inverse_norm;
            if scaled > worst {
                worst = scaled;
                found = Some((scaled, basic, violation));
            }
        }
        found
    }

    /// Keeps the rows and sides of the box that z violates most.
    fn look_at_all(&mut self, rows: &Rows<'_>, skip: Option<(usize, bool)>) {
        self.kernels
            .products(rows.coefficients, &self.z, &mut self.values);
        let Self {
            candidates,
            z,
            values,
            ..
        } = self;
        let mut reach = 1.0_f64;
        candidates.clear();
        for (k, &value) in values.iter().enumerate() {
            let above = (value - rows.upper[k]) * rows.inverse_norms[k];
            let below = (-value - rows.lower[k]) * rows.inverse_norms[k];
            if above > FEASIBILITY && skip != Some((k, true)) {
                reach = reach.max(value / rows.upper[k]);
                candidates.push((above, Basic::Row(k, 1.0)));
            }
            if below > FEASIBILITY && skip != Some((k, false)) {
                reach = reach.max(-value / rows.lower[k]);
                candidates.push((below, Basic::Row(k, -1.0)));
            }
        }
        for (j, &zj) in z.iter().enumerate() {
            if zj.abs() - 1.0 > FEASIBILITY {
                reach = reach.max(zj.abs());
                candidates.push((zj.abs() - 1.0, Basic::Box(j, zj.signum())));
            }
        }
        if candidates.len() > CANDIDATES {
            candidates.select_nth_unstable_by(CANDIDATES, |a, b| b.0.total_cmp(&a.0));
            candidates.truncate(CANDIDATES);
        }
        self.reach = reach;
    }
}
