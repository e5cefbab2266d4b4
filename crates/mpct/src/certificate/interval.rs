//! Intervals with outward rounding: every operation returns an interval that holds the exact result.
//!
//! An operation on doubles is rounded to the nearest double, so its exact result lies strictly between the neighbours
//! of what was computed. Sums of two numbers that are exact stay so, as do products with 0 and 1: that equilibria
//! of an integrator rest exactly, and that its rows do not change along the law, must survive.

/// A closed interval [lo, hi].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Interval {
    pub(super) lo: f64,
    pub(super) hi: f64,
}

impl Interval {
    pub(super) const ZERO: Self = Self { lo: 0.0, hi: 0.0 };

    /// The number itself.
    pub(super) fn exact(v: f64) -> Self {
        Self { lo: v, hi: v }
    }

    pub(super) fn add(self, other: Self) -> Self {
        if self.is_number() && other.is_number() {
            let (a, b) = (self.lo, other.lo);
            let sum = a + b;
            // Knuth: the rounding error of a sum of two doubles, exactly.
            let part = sum - a;
            if (a - (sum - part)) + (b - part) == 0.0 {
                return Self::exact(sum);
            }
        }
        Self {
            lo: (self.lo + other.lo).next_down(),
            hi: (self.hi + other.hi).next_up(),
        }
    }

    /// v ± error.
    pub(super) fn around(v: f64, error: f64) -> Self {
        if error == 0.0 {
            return Self::exact(v);
        }
        Self {
            lo: (v - error).next_down(),
            hi: (v + error).next_up(),
        }
    }

    fn is_number(self) -> bool {
        self.lo == self.hi
    }

    pub(super) fn neg(self) -> Self {
        Self {
            lo: -self.hi,
            hi: -self.lo,
        }
    }

    pub(super) fn sub(self, other: Self) -> Self {
        self.add(other.neg())
    }

    /// The product with a number.
    pub(super) fn times(self, v: f64) -> Self {
        if v == 1.0 {
            return self;
        }
        if v == 0.0 {
            return Self::ZERO;
        }
        let (a, b) = (self.lo * v, self.hi * v);
        Self {
            lo: a.min(b).next_down(),
            hi: a.max(b).next_up(),
        }
    }

    pub(super) fn mul(self, other: Self) -> Self {
        let products = [
            self.lo * other.lo,
            self.lo * other.hi,
            self.hi * other.lo,
            self.hi * other.hi,
        ];
        Self {
            lo: products
                .iter()
                .fold(f64::INFINITY, |a, &b| a.min(b))
                .next_down(),
            hi: products
                .iter()
                .fold(f64::NEG_INFINITY, |a, &b| a.max(b))
                .next_up(),
        }
    }

    /// Largest absolute value.
    pub(super) fn magnitude(self) -> f64 {
        self.lo.abs().max(self.hi.abs())
    }

    /// A double inside.
    pub(super) fn middle(self) -> f64 {
        (0.5 * (self.lo + self.hi)).clamp(self.lo, self.hi)
    }
}

/// a + b, rounded up.
pub(super) fn add_up(a: f64, b: f64) -> f64 {
    (a + b).next_up()
}

/// a · b, rounded up; for a, b ≥ 0.
pub(super) fn mul_up(a: f64, b: f64) -> f64 {
    (a * b).next_up()
}

/// A sparse matrix of intervals, by rows; columns ascend.
pub(super) type IntervalRows = Vec<Vec<(usize, Interval)>>;

/// Σ of scaled sparse rows, in a scratch vector.
pub(super) struct Accumulator {
    sum: Vec<Interval>,
    touched: Vec<usize>,
    seen: Vec<bool>,
}

impl Accumulator {
    pub(super) fn new(width: usize) -> Self {
        Self {
            sum: vec![Interval::ZERO; width],
            touched: Vec::new(),
            seen: vec![false; width],
        }
    }

    pub(super) fn add(&mut self, j: usize, v: Interval) {
        if self.seen[j] {
            self.sum[j] = self.sum[j].add(v);
        } else {
            self.seen[j] = true;
            self.touched.push(j);
            self.sum[j] = v;
        }
    }

    /// The entries, columns ascending; the accumulator is empty afterwards.
    pub(super) fn take(&mut self) -> Vec<(usize, Interval)> {
        self.touched.sort_unstable();
        let entries = self.touched.iter().map(|&j| (j, self.sum[j])).collect();
        for &j in &self.touched {
            self.seen[j] = false;
        }
        self.touched.clear();
        entries
    }
}

/// a · b; fast when one is a number.
pub(super) fn scaled(a: Interval, b: Interval) -> Interval {
    match (a.is_number(), b.is_number()) {
        (_, true) if a.is_number() && a.lo == 1.0 => b,
        (_, true) => a.times(b.lo),
        (true, false) => b.times(a.lo),
        (false, false) => b.mul(a),
    }
}

/// The product of two sparse matrices of intervals; `width` is the number of columns of the second.
pub(super) fn product(a: &IntervalRows, b: &IntervalRows, width: usize) -> IntervalRows {
    let mut sum = Accumulator::new(width);
    a.iter()
        .map(|row| {
            for &(k, v) in row {
                for &(j, w) in &b[k] {
                    sum.add(j, scaled(w, v));
                }
            }
            sum.take()
        })
        .collect()
}

/// a + sign · b.
pub(super) fn combined(
    a: &IntervalRows,
    b: &IntervalRows,
    sign: f64,
    width: usize,
) -> IntervalRows {
    let mut sum = Accumulator::new(width);
    a.iter()
        .zip(b)
        .map(|(x, y)| {
            x.iter().for_each(|&(j, v)| sum.add(j, v));
            for &(j, v) in y {
                sum.add(j, if sign < 0.0 { v.neg() } else { v });
            }
            sum.take()
        })
        .collect()
}

/// The transpose; `width` is the number of columns of the matrix.
pub(super) fn transposed(a: &IntervalRows, width: usize) -> IntervalRows {
    let mut out = vec![Vec::new(); width];
    for (i, row) in a.iter().enumerate() {
        for &(j, v) in row {
            out[j].push((i, v));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_ten_times_holds_one() {
        let mut sum = Interval::ZERO;
        for _ in 0..10 {
            sum = sum.add(Interval::exact(0.1));
        }
        assert!(sum.lo < 1.0 && 1.0 < sum.hi && sum.hi - sum.lo < 1e-14);
        let square = Interval { lo: -1.0, hi: 2.0 }.mul(Interval { lo: -3.0, hi: 1.0 });
        assert!(square.lo <= -6.0 && square.hi >= 3.0 && square.hi < 3.0 + 1e-14);
        assert!(Interval::exact(-2.0).times(3.0).hi >= -6.0);
    }

    #[test]
    fn exact_sums_stay_exact() {
        let sum = |a: f64, b: f64| Interval::exact(a).add(Interval::exact(b));
        assert_eq!(sum(0.1, -0.1), Interval::ZERO);
        assert_eq!(sum(1.5, 0.25), Interval::exact(1.75));
        let inexact = sum(1.0, 1e-17);
        assert!(inexact.lo < 1.0 && 1.0 < inexact.hi);
        let inexact = sum(0.1, 0.2);
        assert!(inexact.lo < inexact.hi);
        assert_eq!(
            scaled(Interval::exact(1.0), Interval::exact(0.1)),
            Interval::exact(0.1)
        );
    }
}
