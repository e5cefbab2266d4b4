//! The program on some of the variables.

use super::{ABSENT, Answer, ENOUGH, Expected, Query, Scene, Workspace};
use crate::terminal::bank::Key;
use crate::terminal::simplex::{Ending, Rows};

impl Scene<'_> {
    /// Solves the program on the variables `chosen`.
    pub(in crate::terminal) fn solve_on(
        &self,
        ws: &mut Workspace,
        chosen: &[usize],
        query: &Query,
        expected: Expected,
    ) -> Answer {
        self.gather(ws, chosen, query, expected);
        let v = chosen.len();
        ws.weights.clear();
        ws.weights.resize(v, 0.0);
        let mut outside = 0.0;
        for &(j, value) in &ws.objective {
            match ws.place[j] {
                ABSENT => outside += value.abs(),
                i => ws.weights[i as usize] = value,
            }
        }
        let rows = Rows {
            width: v,
            coefficients: &ws.coefficients,
            upper: &ws.upper,
            lower: &ws.lower,
            inverse_norms: &ws.inverse_norms,
        };
        let skip = query
            .skip
            .and_then(|(key, side)| Some((ws.keys.iter().position(|&k| k == key)?, side)));
        let thresholds = match expected {
            Expected::Spent => [query.low_enough - outside, f64::INFINITY],
            Expected::NotSpent => [query.low_enough, ENOUGH],
        };
        let ending = ws
            .simplex
            .maximise(&ws.weights, &rows, thresholds, skip, self.clock);
        let value = if ending == Ending::Below {
            f64::NEG_INFINITY
        } else {
            self.scaled_back(ws, chosen, query)
        };
        for &j in chosen {
            ws.place[j] = ABSENT;
        }
        ws.multipliers.clear();
        let (simplex, keys) = (&ws.simplex, &ws.keys);
        ws.multipliers
            .extend(simplex.multipliers().map(|(k, side, y)| (keys[k], side, y)));
        self.bounded(ws, ending, value)
    }

    /// Lays out the rows that touch `chosen`, cut to it and relaxed.
    fn gather(&self, ws: &mut Workspace, chosen: &[usize], query: &Query, expected: Expected) {
        let v = chosen.len();
        for (i, &j) in chosen.iter().enumerate() {
            ws.place[j] = i as u32;
        }
        ws.stamp = ws.stamp.wrapping_add(1);
        if ws.stamp == 0 {
            ws.seen.fill(0);
            ws.stamp = 1;
        }
        ws.keys.clear();
        ws.only_checked.clear();
        ws.coefficients.clear();
        ws.upper.clear();
        ws.lower.clear();
        ws.inverse_norms.clear();
        for layer in 0..=query.known {
            let first = self.bank.rows(layer) - self.system.pairs.len();
            for &variable in chosen {
                for &pair in self.bank.touching(layer, variable) {
                    let key = (first + pair as usize) as Key;
                    if ws.seen[key as usize] == ws.stamp {
                        continue;
                    }
                    ws.seen[key as usize] = ws.stamp;
                    let (upper, lower) = self.bounds(key);
                    let start = ws.coefficients.len();
                    ws.coefficients.resize(start + v, 0.0);
                    let row = &mut ws.coefficients[start..];
                    let (mut inside, mut square) = (0.0, 0.0);
                    let place = &ws.place;
                    self.bank.entries(self.system, key, |j, value| {
                        let i = place[j];
                        if i != ABSENT {
                            row[i as usize] = value;
                            inside += value.abs();
                            square += value * value;
                        }
                    });
                    let slack = match expected {
                        Expected::Spent => {
                            (self.bank.total(key) - inside).max(0.0)
                                + self.bank.slack(self.system, key)
                        }
                        Expected::NotSpent => 0.0,
                    };
                    let nearest = upper.min(lower);
                    if inside > nearest + slack {
                        ws.keys.push(key);
                        ws.upper.push(upper + slack);
                        ws.lower.push(lower + slack);
                        ws.inverse_norms.push(square.sqrt().recip());
                    } else {
                        ws.coefficients.truncate(start);
                        if inside > nearest {
                            ws.only_checked.push(key);
                        }
                    }
                }
            }
        }
    }

    /// Scales the point back until every row holds, without its relaxation; the value of the objective there.
    fn scaled_back(&self, ws: &mut Workspace, chosen: &[usize], query: &Query) -> f64 {
        let z = ws.simplex.point();
        let mut reach = z.iter().fold(1.0_f64, |a, v| a.max(v.abs()));
        let broken = &mut ws.broken;
        broken.clear();
        let mut check = |key: Key, at: f64| {
            let (upper, lower) = self.bounds(key);
            let mut beyond = 1.0_f64;
            if query.skip != Some((key, true)) {
                beyond = beyond.max(at / upper);
            }
            if query.skip != Some((key, false)) {
                beyond = beyond.max(-at / lower);
            }
            if beyond > 1.0 {
                broken.push((key, beyond - 1.0));
                reach = reach.max(beyond);
            }
        };
        for (&key, row) in ws.keys.iter().zip(ws.coefficients.chunks_exact(z.len())) {
            check(key, row.iter().zip(z).map(|(a, b)| a * b).sum());
        }
        let place = &ws.place;
        for &key in &ws.only_checked {
            let mut at = 0.0;
            self.bank.entries(self.system, key, |j, v| {
                if place[j] != ABSENT {
                    at += v * z[place[j] as usize];
                }
            });
            check(key, at);
        }
        let value: f64 = ws.weights.iter().zip(z).map(|(a, b)| a * b).sum();
        ws.witness.clear();
        ws.witness
            .extend(chosen.iter().copied().zip(z.iter().map(|v| v / reach)));
        value / reach
    }
}
