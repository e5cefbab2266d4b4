//! The program on all variables.

use super::{Answer, ENOUGH, Query, Scene, Workspace};
use crate::terminal::bank::Key;
use crate::terminal::simplex::{Ending, Rows};

/// Rows over all variables.
pub(in crate::terminal) struct Block {
    pub(super) keys: Vec<Key>,
    coefficients: Vec<f64>,
    pub(super) upper: Vec<f64>,
    pub(super) lower: Vec<f64>,
    inverse_norms: Vec<f64>,
}

impl Scene<'_> {
    /// All rows that take part as one block.
    fn lay_out(&self) -> Block {
        let d = self.system.dimension();
        let valid = self.bank.valid.iter().all(|&v| v);
        let mut block = Block {
            keys: Vec::new(),
            coefficients: Vec::new(),
            upper: Vec::new(),
            lower: Vec::new(),
            inverse_norms: Vec::new(),
        };
        for key in 0..self.bank.rows(self.known) as Key {
            let (upper, lower) = self.bounds(key);
            // Rows that no point of the box can violate, or that are absent, would only cost time.
            if self.bank.total(key) <= upper.min(lower) && valid {
                continue;
            }
            let start = block.coefficients.len();
            block.coefficients.resize(start + d, 0.0);
            let row = &mut block.coefficients[start..];
            self.bank.entries(self.system, key, |j, v| row[j] = v);
            let norm = row.iter().map(|v| v * v).sum::<f64>().sqrt();
            block.keys.push(key);
            block.upper.push(upper);
            block.lower.push(lower);
            block.inverse_norms.push(norm.recip());
        }
        block
    }

    /// Solves the program on all variables, with the box of those that it does not hold wider by a factor.
    pub(in crate::terminal) fn solve_whole(
        &self,
        ws: &mut Workspace,
        query: &Query,
        widening: f64,
    ) -> Answer {
        let block = self.block.get_or_init(|| self.lay_out());
        let d = self.system.dimension();
        let valid = &self.bank.valid;
        let factor = |j: usize| if valid[j] { 1.0 } else { widening };
        let end = self.bank.rows(query.known) as Key;
        let count = block.keys.partition_point(|&k| k < end);
        ws.weights.clear();
        ws.weights.resize(d, 0.0);
        for &(j, v) in &ws.objective {
            ws.weights[j] = v * factor(j);
        }
        let mut widened = Vec::new();
        let coefficients = if widening == 1.0 {
            &block.coefficients[..count * d]
        } else {
            let entries = block.coefficients[..count * d].iter().enumerate();
            widened.extend(entries.map(|(i, v)| v * factor(i % d)));
            &widened[..]
        };
        let rows = Rows {
            width: d,
            coefficients,
            upper: &block.upper[..count],
            lower: &block.lower[..count],
            inverse_norms: &block.inverse_norms[..count],
        };
        let skip = query.skip.and_then(|(key, side)| {
            let k = block.keys[..count].binary_search(&key).ok()?;
            Some((k, side))
        });
        // A bound that rests on a box that proves nothing is none: go on until the multipliers have left it.
        let below = if valid.iter().all(|&v| v) {
            query.low_enough
        } else {
            f64::NEG_INFINITY
        };
        let simplex = &mut ws.simplex;
        let ending = simplex.maximise(&ws.weights, &rows, [below, ENOUGH], skip, self.clock);
        let value = if ending == Ending::Below {
            f64::NEG_INFINITY
        } else {
            let z = ws.simplex.point();
            let mut reach = z.iter().fold(1.0_f64, |a, v| a.max(v.abs()));
            for (k, row) in rows.coefficients.chunks_exact(d).enumerate() {
                let at: f64 = row.iter().zip(z).map(|(a, b)| a * b).sum();
                if skip != Some((k, true)) {
                    reach = reach.max(at / rows.upper[k]);
                }
                if skip != Some((k, false)) {
                    reach = reach.max(-at / rows.lower[k]);
                }
            }
            ws.witness.clear();
            ws.witness.extend(
                z.iter()
                    .enumerate()
                    .map(|(j, v)| (j, v * factor(j) / reach))
                    .filter(|e| e.1 != 0.0),
            );
            ws.weights.iter().zip(z).map(|(w, v)| w * v).sum::<f64>() / reach
        };
        ws.multipliers.clear();
        let simplex = &ws.simplex;
        ws.multipliers.extend(
            simplex
                .multipliers()
                .map(|(k, side, y)| (block.keys[k], side, y)),
        );
        self.bounded(ws, ending, value)
    }
}
