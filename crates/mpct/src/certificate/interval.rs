//! Intervals with outward rounding: every operation returns an interval that holds the exact result.
//!
//! An operation on doubles is rounded to the nearest double, so its exact result lies strictly between the neighbours
//! of what was computed.

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
        Self {
            lo: (self.lo + other.lo).next_down(),
            hi: (self.hi + other.hi).next_up(),
        }
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

/// The product of two sparse matrices of intervals; `width` is the number of columns of the second.
pub(super) fn product(a: &IntervalRows, b: &IntervalRows, width: usize) -> IntervalRows {
    let mut sum = Accumulator::new(width);
    a.iter()
        .map(|row| {
            for &(k, v) in row {
                for &(j, w) in &b[k] {
                    sum.add(
                        j,
                        if v.lo == v.hi {
                            w.times(v.lo)
                        } else {
                            v.mul(w)
                        },
                    );
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
}
