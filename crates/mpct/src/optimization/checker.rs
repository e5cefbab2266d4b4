//! The check of one answer after another of min ½ zᵀHz + (F_x x + F_r r)ᵀz subject to G z ≤ 1 − W x.
//!
//! Nothing here calls, or is called by, a solver. The rows (W G) lie side by side, so that one pass over them says what an
//! answer violates; opposite rows share their product. Everything else needs the rows with multipliers alone.

use super::verify::{Farkas, Residuals};
use crate::linalg::Dense;

/// A matrix by rows, each from its first to its last entry that is not zero.
#[derive(Clone, Debug)]
struct Bands {
    /// First column, and where the row begins and ends in `values`.
    rows: Vec<(usize, usize, usize)>,
    values: Vec<f64>,
}

impl Bands {
    fn of(m: &Dense) -> Self {
        let (mut rows, mut values) = (Vec::with_capacity(m.nrows()), Vec::new());
        for i in 0..m.nrows() {
            let is_there = |j: &usize| m[(i, *j)] != 0.0;
            let first = (0..m.ncols()).find(is_there).unwrap_or(0);
            let end = (0..m.ncols()).rev().find(is_there).map_or(first, |j| j + 1);
            let begin = values.len();
            values.extend((first..end).map(|j| m[(i, j)]));
            rows.push((first, begin, values.len()));
        }
        Self { rows, values }
    }

    /// (M v)_i.
    fn row_dot(&self, i: usize, v: &[f64]) -> f64 {
        let (first, begin, end) = self.rows[i];
        dot(&self.values[begin..end], &v[first..first + end - begin])
    }
}

/// aᵀb in four sums.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + rest
}

/// The data of a family of programs, laid out for checking.
#[derive(Clone, Debug)]
pub(crate) struct Checker {
    states: usize,
    variables: usize,
    rows: usize,
    /// Rows 2k and 2k + 1 are opposite for every k below this.
    pairs: usize,
    /// (W G) of the first row of every pair and of every other row.
    table: Vec<f64>,
    hessian: Bands,
    from_state: Bands,
    from_set_point: Bands,
    /// Scratch: (x, z), and Gᵀy.
    point: Vec<f64>,
    image: Vec<f64>,
    /// Σ |y_k G_k|.
    terms: Vec<f64>,
}

impl Checker {
    pub(crate) fn new(
        hessian: &Dense,
        from_state: &Dense,
        from_set_point: &Dense,
        rows: &Dense,
        state_rows: &Dense,
    ) -> Self {
        let (count, states, variables) = (rows.nrows(), from_state.ncols(), hessian.nrows());
        let is_opposite = |k: usize| {
            (0..variables).all(|j| rows[(2 * k, j)] == -rows[(2 * k + 1, j)])
                && (0..states).all(|j| state_rows[(2 * k, j)] == -state_rows[(2 * k + 1, j)])
        };
        let pairs = (0..count / 2)
            .position(|k| !is_opposite(k))
            .unwrap_or(count / 2);
        let mut table = Vec::with_capacity((count - pairs) * (states + variables));
        for i in (0..pairs).map(|k| 2 * k).chain(2 * pairs..count) {
            table.extend((0..states).map(|j| state_rows[(i, j)]));
            table.extend((0..variables).map(|j| rows[(i, j)]));
        }
        Self {
            states,
            variables,
            rows: count,
            pairs,
            table,
            hessian: Bands::of(hessian),
            from_state: Bands::of(from_state),
            from_set_point: Bands::of(from_set_point),
            point: Vec::with_capacity(states + variables),
            image: vec![0.0; variables],
            terms: vec![0.0; variables],
        }
    }

    /// Row i of (W G) and its sign in the table.
    fn row(&self, i: usize) -> (&[f64], f64) {
        let width = self.states + self.variables;
        let (unit, sign) = if i < 2 * self.pairs {
            (i / 2, if i.is_multiple_of(2) { 1.0 } else { -1.0 })
        } else {
            (i - self.pairs, 1.0)
        };
        (&self.table[unit * width..(unit + 1) * width], sign)
    }

    fn load(&mut self, x: &[f64], z: &[f64]) {
        self.point.clear();
        self.point.extend_from_slice(x);
        self.point.extend_from_slice(z);
    }

    /// image = Gᵀy and terms = Σ |y_k G_k| for the rows with multipliers; whether all of them exist.
    fn combine(&mut self, active: &[(usize, f64)]) -> bool {
        let (mut image, mut terms) = (
            std::mem::take(&mut self.image),
            std::mem::take(&mut self.terms),
        );
        image.fill(0.0);
        terms.fill(0.0);
        for &(i, y) in active {
            if i < self.rows {
                let (row, sign) = self.row(i);
                let y = sign * y;
                let entries = image.iter_mut().zip(&mut terms);
                for ((v, t), g) in entries.zip(&row[self.states..]) {
                    *v += y * g;
                    *t += (y * g).abs();
                }
            }
        }
        (self.image, self.terms) = (image, terms);
        active.iter().all(|&(i, _)| i < self.rows)
    }

    /// Largest of max(0, G z − (1 − W x)); NaN when a row is not finite.
    pub(crate) fn violation(&mut self, x: &[f64], z: &[f64]) -> f64 {
        self.load(x, z);
        self.worst_row()
    }

    fn worst_row(&self) -> f64 {
        let width = self.point.len();
        let (mut worst, mut zeros) = (1.0_f64, 0.0);
        if width > 0 {
            let (pairs, others) = self.table.split_at(self.pairs * width);
            for row in pairs.chunks_exact(width) {
                let at = dot(row, &self.point);
                zeros += 0.0 * at;
                worst = worst.max(at.abs());
            }
            for row in others.chunks_exact(width) {
                let at = dot(row, &self.point);
                zeros += 0.0 * at;
                worst = worst.max(at);
            }
        }
        worst - 1.0 + zeros
    }

    /// Residuals of z with the multipliers `active` (row, y); all other multipliers are zero.
    pub(crate) fn residuals(
        &mut self,
        x: &[f64],
        r: &[f64],
        z: &[f64],
        active: &[(usize, f64)],
    ) -> Residuals {
        self.load(x, z);
        let exist = self.combine(active);
        let primal = self.worst_row();
        let (mut stationarity, mut objective) = (0.0_f64, 0.0);
        for i in 0..self.variables {
            let hz = self.hessian.row_dot(i, z);
            let f = self.from_state.row_dot(i, x) + self.from_set_point.row_dot(i, r);
            let gty = self.image[i];
            objective += z[i] * (0.5 * hz + f);
            let scale = 1.0 + hz.abs().max(f.abs()).max(self.terms[i]);
            let residual = (hz + f + gty).abs() / scale;
            // NaN stays.
            if !(residual <= stationarity) {
                stationarity = residual;
                if residual.is_nan() {
                    break;
                }
            }
        }
        let (mut dual, mut gap) = (0.0_f64, 0.0);
        for &(i, y) in active {
            if !(-y <= dual) {
                dual = if y.is_nan() { f64::INFINITY } else { -y };
            }
            if i < self.rows {
                let (row, sign) = self.row(i);
                gap += (y * (1.0 - sign * dot(row, &self.point))).abs();
            }
        }
        Residuals {
            primal: if exist { primal } else { f64::NAN },
            dual,
            stationarity,
            gap: gap / (1.0 + objective.abs()),
        }
    }

    /// Whether the multipliers `active` prove that no z satisfies the rows at x: any would satisfy
    /// 0 ≤ yᵀ(b − G z) ≤ bᵀy + ‖Gᵀy‖∞ ‖z‖₁. `None` when they prove nothing.
    pub(crate) fn farkas(&mut self, x: &[f64], active: &[(usize, f64)]) -> Option<Farkas> {
        let total: f64 = active.iter().map(|a| a.1).sum();
        let is_usable = total > 0.0 && total.is_finite() && active.iter().all(|a| a.1 >= 0.0);
        if !is_usable || !self.combine(active) {
            return None;
        }
        let bound: f64 = active
            .iter()
            .map(|&(i, y)| {
                let (row, sign) = self.row(i);
                y * (1.0 - sign * dot(&row[..self.states], x))
            })
            .sum();
        let gap = -bound / total;
        let leak = self.image.iter().fold(0.0_f64, |a, v| a.max(v.abs())) / total;
        let radius = if leak > 0.0 {
            gap / leak
        } else {
            f64::INFINITY
        };
        (gap > 0.0 && !radius.is_nan()).then_some(Farkas { gap, radius })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimization::verify;

    fn random(state: &mut u64) -> f64 {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// The formulas written out over full matrices and vectors, in `verify`, say the same; for any point and multipliers.
    #[test]
    fn agrees_with_the_formulas_written_out() {
        let mut seed = 3;
        for round in 0..40 {
            let (n, nz, pairs, single) = (3, 7, round % 5, round % 4);
            let rows = 2 * pairs + single;
            let mut draw = |m: usize, n: usize| Dense::from_fn(m, n, |_, _| random(&mut seed));
            let (h, fx, fr) = (draw(nz, nz), draw(nz, n), draw(nz, 2));
            let (mut g, mut w) = (draw(rows, nz), draw(rows, n));
            for k in 0..pairs {
                for j in 0..nz {
                    g[(2 * k + 1, j)] = -g[(2 * k, j)];
                }
                for j in 0..n {
                    w[(2 * k + 1, j)] = -w[(2 * k, j)];
                }
            }
            let column = |m: Dense| -> Vec<f64> { m.col(0).iter().copied().collect() };
            let (x, r, z) = (column(draw(n, 1)), column(draw(2, 1)), column(draw(nz, 1)));
            let y: Vec<f64> = column(draw(rows.max(1), 1))[..rows].to_vec();
            let mut checker = Checker::new(&h, &fx, &fr, &g, &w);
            assert!(checker.pairs >= pairs, "{} {pairs}", checker.pairs);
            let product = |m: &Dense, v: &[f64], i: usize| -> f64 {
                (0..v.len()).map(|j| m[(i, j)] * v[j]).sum()
            };
            let f: Vec<f64> = (0..nz)
                .map(|i| product(&fx, &x, i) + product(&fr, &r, i))
                .collect();
            let b: Vec<f64> = (0..rows).map(|i| 1.0 - product(&w, &x, i)).collect();
            let active: Vec<(usize, f64)> = y.iter().copied().enumerate().collect();
            let found = checker.residuals(&x, &r, &z, &active);
            let expected = verify::residuals(&h, &f, &g, &b, &z, &y);
            for (a, b) in [
                (found.primal, expected.primal),
                (found.dual, expected.dual),
                (found.stationarity, expected.stationarity),
                (found.gap, expected.gap),
            ] {
                assert!((a - b).abs() < 1e-12, "{found:?} {expected:?}");
            }
            assert!((checker.violation(&x, &z) - expected.primal).abs() < 1e-12);
            let positive: Vec<f64> = y.iter().map(|v| v.abs()).collect();
            let active: Vec<(usize, f64)> = positive.iter().copied().enumerate().collect();
            match (
                checker.farkas(&x, &active),
                verify::farkas(&g, &b, &positive),
            ) {
                (None, None) => {}
                (Some(a), Some(b)) => {
                    assert!((a.gap - b.gap).abs() < 1e-12);
                    assert!((a.radius - b.radius).abs() < 1e-9 * b.radius);
                }
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn what_is_not_finite_is_not_accepted() {
        let one = Dense::from_fn(1, 1, |_, _| 1.0);
        let rows = Dense::from_fn(2, 1, |i, _| if i == 0 { 1.0 } else { -1.0 });
        let mut checker = Checker::new(&one, &one, &one, &rows, &rows);
        let answer = |x: f64, z: f64, y: f64| ([x], [1.0], [z], [(0, y)]);
        for (x, r, z, y) in [
            answer(f64::NAN, 0.0, 0.0),
            answer(0.0, f64::NAN, 0.0),
            answer(0.0, f64::INFINITY, 0.0),
            answer(0.0, -1.0, f64::NAN),
        ] {
            assert!(!checker.residuals(&x, &r, &z, &y).within(1e300));
        }
        // x + ½ z² + z is least at −1, and both rows allow it; a row that does not exist proves nothing.
        assert!(
            checker
                .residuals(&[0.0], &[1.0], &[-1.0], &[])
                .within(1e-15)
        );
        assert!(
            !checker
                .residuals(&[0.0], &[1.0], &[-1.0], &[(2, 0.0)])
                .within(1e300)
        );
        assert!(checker.farkas(&[0.0], &[(2, 1.0)]).is_none());
    }
}
