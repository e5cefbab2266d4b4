//! The two number types the solver runs in, and every tolerance it uses.
//!
//! Only `+ − × ÷`, comparisons and bit patterns are used, never a function of the platform.
//! These are exact in IEEE 754, so a computer and a microcontroller give the same bits.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// `f32` or `f64`.
///
/// Sealed: the tolerances below were chosen for these two formats.
///
/// ```
/// use mpct_runtime::Scalar;
/// assert_eq!(f64::from_f64(4.0).sqrt_core(), 2.0);
/// assert_eq!(f32::from_f64(0.1).to_f64(), f64::from(0.1_f32));
/// ```
pub trait Scalar:
    sealed::Sealed
    + Copy
    + Debug
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + Send
    + Sync
    + 'static
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// ½.
    const HALF: Self;
    /// +∞.
    const INFINITY: Self;
    /// Not a number; marks "not computed yet" in the workspace, never returned.
    const NAN: Self;
    /// Distance from 1 to the next number.
    const EPSILON: Self;

    /// Largest `Gᵢz − bᵢ(x)` that counts as satisfied. Scale: the rows are written with right-hand side 1.
    /// Smaller, and rounding noise would be taken for violation and rows would enter and leave for ever.
    const PRIMAL: Self;
    /// Largest `|Gᵢz − bᵢ(x)|` left on an active row before the multipliers are corrected. Same scale.
    /// Larger, and the errors of many rank-one updates would show in the input.
    const REFINE: Self;
    /// Largest `‖Hz + f + G_Wᵀλ‖_∞`, relative to the size of its terms, before `z` is corrected. Larger, and the bound on the
    /// cost would not be one.
    const STATIONARY: Self;
    /// A row whose part outside the span of the active rows, squared and relative to its length squared, is smaller
    /// than this counts as dependent. Smaller, and a division by noise would follow.
    const DEPENDENT: Self;
    /// Below this (same quantity) the projection is computed a second time from its own remainder.
    /// Smaller, and cancellation would decide what is dependent.
    const REPROJECT: Self;
    /// `−bᵀy` of a proof of infeasibility must exceed this, relative to `Σ |yᵢ|·(|bᵢ| terms)`.
    /// Smaller, and rounding could "prove" a feasible problem infeasible.
    const PROOF_MARGIN: Self;
    /// A proof of infeasibility must hold for every `z` with `‖z‖₁` below this. Smaller, and the proof would leave
    /// room for a solution a controller could really use.
    const PROOF_RADIUS: Self;
    /// Total movement (in units of a row's right-hand side) after which all bounds on slacks are forgotten.
    /// Larger, and the rounding of the bounds would come near [`Scalar::PRIMAL`].
    const REACH: Self;
    /// Row scales stay within this factor of 1. A row that would need more is numerically a zero row; scaling it up
    /// would turn its noise into a constraint.
    const MAX_ROW_SCALE: Self;

    /// Entries of `z` below this are set to zero. Products of smaller numbers are subnormal, and many processors need a hundred
    /// times longer for these.
    const TINY: Self;

    /// Nearest value to `value`.
    fn from_f64(value: f64) -> Self;
    /// The value as `f64`, exact.
    fn to_f64(self) -> f64;
    /// Neither infinite nor NaN.
    fn is_finite(self) -> bool;
    /// NaN.
    fn is_nan(self) -> bool;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The larger one; the other one when one is NaN.
    fn max(self, other: Self) -> Self;
    /// Square root within one unit in the last place, by Newton's method; 0 for what is not positive.
    fn sqrt_core(self) -> Self;
    /// An upper bound of the square root, at most 0.001 % too large.
    fn sqrt_upper(self) -> Self;
    /// `2^(−e)` for `self = f · 2^e` with `1 ≤ f < 2`; 1 unless positive and normal.
    fn inverse_power_of_two(self) -> Self;
}

macro_rules! scalar {
    ($t:ty, $bits:ty, $mantissa:expr, $bias:expr, $lift:expr, $drop:expr) => {
        fn from_f64(value: f64) -> Self {
            value as $t
        }
        #[allow(clippy::unnecessary_cast)]
        fn to_f64(self) -> f64 {
            self as f64
        }
        #[inline(always)]
        fn is_finite(self) -> bool {
            <$t>::is_finite(self)
        }
        #[inline(always)]
        fn is_nan(self) -> bool {
            <$t>::is_nan(self)
        }
        #[inline(always)]
        fn abs(self) -> Self {
            <$t>::abs(self)
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            <$t>::max(self, other)
        }
        fn sqrt_core(self) -> Self {
            if !(self > 0.0) {
                return 0.0;
            }
            if self < <$t>::MIN_POSITIVE {
                return (self * $lift).sqrt_core() * $drop;
            }
            let mut root = self.sqrt_upper();
            for _ in 0..3 {
                root = 0.5 * (root + self / root);
            }
            root
        }
        #[inline]
        fn sqrt_upper(self) -> Self {
            if !(self > 0.0) || self == <$t>::INFINITY {
                return self.max(0.0);
            }
            if self < <$t>::MIN_POSITIVE {
                return <$t>::MIN_POSITIVE.sqrt_upper();
            }
            // Halving the exponent is right within 7 %; a Newton iterate is never below the root.
            let guess = <$t>::from_bits((self.to_bits() >> 1) + ($bias << ($mantissa - 1)));
            let root = 0.5 * (guess + self / guess);
            0.5 * (root + self / root) * (1.0 + 4.0 * <$t>::EPSILON)
        }
        fn inverse_power_of_two(self) -> Self {
            let exponent = self.to_bits() >> $mantissa;
            if self >= <$t>::MIN_POSITIVE && exponent < 2 * $bias {
                <$t>::from_bits((2 * $bias - exponent) << $mantissa)
            } else {
                1.0
            }
        }
    };
}

impl Scalar for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const HALF: Self = 0.5;
    const INFINITY: Self = f64::INFINITY;
    const NAN: Self = f64::NAN;
    const EPSILON: Self = f64::EPSILON;
    const PRIMAL: Self = 1e-10;
    const REFINE: Self = 1e-11;
    const STATIONARY: Self = 1e-12;
    const DEPENDENT: Self = 1e-14;
    const REPROJECT: Self = 1e-6;
    const PROOF_MARGIN: Self = 1e-10;
    const PROOF_RADIUS: Self = 1e6;
    const REACH: Self = 1e4;
    const TINY: Self = 1e-150;
    const MAX_ROW_SCALE: Self = 1_099_511_627_776.0; // 2^40
    scalar!(
        f64,
        u64,
        52,
        1023_u64,
        324_518_553_658_426_726_783_156_020_576_256.0,
        1.0 / 18_014_398_509_481_984.0
    );
}

impl Scalar for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const HALF: Self = 0.5;
    const INFINITY: Self = f32::INFINITY;
    const NAN: Self = f32::NAN;
    const EPSILON: Self = f32::EPSILON;
    // Eight units in the last place. With 1e-5 a velocity on its bound was let go by 2e-6, and body rates of a drone differed from f64 by
    // 2e-3 rad/s on 11 of 12 random runs; with 1e-6 by 8e-5 to 1.2e-3, and no solve failed. Chosen on that problem.
    const PRIMAL: Self = 1e-6;
    const REFINE: Self = 4e-7;
    const STATIONARY: Self = 5e-7;
    const DEPENDENT: Self = 1e-7;
    const REPROJECT: Self = 1e-1;
    const PROOF_MARGIN: Self = 2e-6;
    const PROOF_RADIUS: Self = 1e3;
    const REACH: Self = 4.0;
    const TINY: Self = 1e-18;
    const MAX_ROW_SCALE: Self = 1_048_576.0; // 2^20
    scalar!(
        f32,
        u32,
        23,
        127_u32,
        18_014_398_509_481_984.0,
        1.0 / 134_217_728.0
    );
}

#[cfg(test)]
mod tests {
    use super::Scalar;

    #[test]
    fn square_roots_of_all_magnitudes() {
        let mut x = 1e-320_f64;
        while x < 1e300 {
            let root = x.sqrt_core();
            assert!(
                (root * root / x - 1.0).abs() < if x < 1e-300 { 1e-3 } else { 1e-15 },
                "{x:e} {root:e}"
            );
            assert!(
                x.sqrt_upper() >= root && (x < 1e-307 || x.sqrt_upper() <= root * 1.00001),
                "{x:e}"
            );
            x *= 3.7;
        }
        assert_eq!(0.0_f64.sqrt_core(), 0.0);
        assert_eq!((-1.0_f64).sqrt_core(), 0.0);
        assert_eq!(2.25_f32.sqrt_core(), 1.5);
        assert!((1e-40_f32.sqrt_core() / 1e-20 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn powers_of_two() {
        assert_eq!(5.0_f64.inverse_power_of_two(), 0.25);
        assert_eq!(0.3_f32.inverse_power_of_two(), 4.0);
        assert_eq!(0.0_f32.inverse_power_of_two(), 1.0);
        assert_eq!(f64::NAN.inverse_power_of_two(), 1.0);
    }
}
