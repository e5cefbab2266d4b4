//! Axes: ranges that survive any data, round tick values, numbers as people write them.

/// How values are spread over an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// Equal steps.
    Linear,
    /// Equal ratios.
    Log,
}

/// A range with its ticks.
#[derive(Clone, Debug)]
pub struct Axis {
    low: f64,
    high: f64,
    spread: Spread,
    /// Where ticks stand, and what is written there.
    pub ticks: Vec<(f64, String)>,
}

/// Values beyond this are drawn at the edge: differences of larger ones overflow.
const HUGE: f64 = 1e300;
/// A range narrower than this part of its values is widened: its ticks could not be told apart.
const NARROWEST: f64 = 1e-6;
/// Decades shown below the largest value of a logarithmic axis.
const DECADES: f64 = 14.0;

impl Axis {
    /// A linear axis over [low, high] with about `count` ticks. Any numbers will do.
    pub fn linear(low: f64, high: f64, count: usize) -> Self {
        let (mut low, mut high) = match (low.is_finite(), high.is_finite()) {
            (true, true) => (low.min(high), low.max(high)),
            (true, false) => (low, low),
            (false, true) => (high, high),
            (false, false) => (0.0, 0.0),
        };
        low = low.clamp(-HUGE, HUGE);
        high = high.clamp(-HUGE, HUGE);
        let size = low.abs().max(high.abs());
        if !(high - low > NARROWEST * size) {
            let pad = if size > 0.0 { 0.5 * size } else { 1.0 };
            low -= pad;
            high += pad;
        }
        let step = round_step((high - low) / count.max(1) as f64);
        let first = (low / step).ceil() as i64;
        let last = (high / step).floor() as i64;
        let ticks = (first..=last.min(first + 50))
            .map(|k| {
                let value = k as f64 * step;
                (value, tick_label(value, step, low.abs().max(high.abs())))
            })
            .collect();
        Self {
            low,
            high,
            spread: Spread::Linear,
            ticks,
        }
    }

    /// A linear axis whose ends are moved outwards to round values.
    pub fn linear_round(low: f64, high: f64, count: usize) -> Self {
        let plain = Self::linear(low, high, count);
        let step = round_step((plain.high - plain.low) / count.max(1) as f64);
        Self::linear(
            (plain.low / step).floor() * step,
            (plain.high / step).ceil() * step,
            count,
        )
    }

    /// A logarithmic axis over whole decades; `None` when no value is positive and finite.
    pub fn log(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for v in values.filter(|v| v.is_finite() && *v > 0.0) {
            low = low.min(v);
            high = high.max(v);
        }
        if !(high > 0.0) {
            return None;
        }
        let top = high.log10().ceil();
        let mut bottom = low.log10().floor().max(top - DECADES);
        if bottom >= top {
            bottom = top - 1.0;
        }
        let stride = ((top - bottom) / 6.0).ceil().max(1.0);
        let count = ((top - bottom) / stride).floor() as usize;
        let ticks = (0..=count)
            .map(|k| top - stride * k as f64)
            .map(|e| (10_f64.powf(e), power_label(e as i32)))
            .collect();
        Some(Self {
            low: bottom,
            high: top,
            spread: Spread::Log,
            ticks,
        })
    }

    /// Where a value lies: 0 at the low end, 1 at the high end, NaN for NaN; values outside go to the edge.
    pub fn place(&self, value: f64) -> f64 {
        let v = match self.spread {
            Spread::Linear => value,
            Spread::Log if value > 0.0 => value.log10(),
            Spread::Log if value <= 0.0 => self.low,
            Spread::Log => f64::NAN,
        };
        if v.is_nan() {
            return f64::NAN;
        }
        ((v.clamp(-HUGE, HUGE) - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }

    /// The low end (its exponent on a logarithmic axis).
    pub fn low(&self) -> f64 {
        self.low
    }

    /// The high end (its exponent on a logarithmic axis).
    pub fn high(&self) -> f64 {
        self.high
    }
}

/// The smallest of 1, 2, 5 × 10ᵏ that is at least `step`.
fn round_step(step: f64) -> f64 {
    let power = 10_f64.powf(step.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|s| *s >= step * (1.0 - 1e-9))
        .unwrap_or(10.0 * power)
}

fn tick_label(value: f64, step: f64, size: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    // Four digits tell the ticks apart unless the range is narrow.
    if step >= 1e5 || (step < 1e-4 && size < 1000.0 * step) {
        return number(value);
    }
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    minus(format!("{value:.decimals$}"))
}

fn power_label(exponent: i32) -> String {
    match exponent {
        0 => "1".into(),
        1 => "10".into(),
        _ => {
            let digits: String = exponent
                .to_string()
                .chars()
                .map(|c| match c {
                    '-' => '⁻',
                    '0' => '⁰',
                    '1' => '¹',
                    '2' => '²',
                    '3' => '³',
                    d => char::from_u32(0x2070 + d as u32 - '0' as u32).unwrap_or(d),
                })
                .collect();
            format!("10{digits}")
        }
    }
}

fn minus(text: String) -> String {
    text.replace('-', "−")
}

/// A number with four significant digits at most, as people write it.
pub fn number(value: f64) -> String {
    if value.is_nan() {
        return "not a number".into();
    }
    if value.is_infinite() {
        return minus(if value > 0.0 { "∞" } else { "-∞" }.into());
    }
    let size = value.abs();
    if size == 0.0 {
        return "0".into();
    }
    // Rounded first, so that 9999.9 is judged as the 10000 it will be written as.
    let rounded = format!("{value:.3e}");
    let (mantissa, exponent) = rounded.split_once('e').unwrap_or((&rounded, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trim = |s: &str| -> String {
        if s.contains('.') {
            s.trim_end_matches('0').trim_end_matches('.').to_string()
        } else {
            s.to_string()
        }
    };
    minus(if (-3..=5).contains(&exponent) {
        let decimals = (3 - exponent).max(0) as usize;
        trim(&format!("{value:.decimals$}"))
    } else {
        format!("{}e{exponent}", trim(mantissa))
    })
}

/// A duration with a unit that fits it.
pub fn duration(seconds: f64) -> String {
    let (factor, unit) = duration_unit(seconds);
    let value = seconds * factor;
    let digits = if value >= 100.0 {
        0
    } else if value >= 10.0 {
        1
    } else {
        2
    };
    if value.is_finite() {
        format!("{value:.digits$} {unit}")
    } else {
        "unknown".into()
    }
}

/// The factor and the name of the unit in which a duration is read best.
pub fn duration_unit(seconds: f64) -> (f64, &'static str) {
    match seconds {
        s if s >= 1.0 => (1.0, "s"),
        s if s >= 1e-3 => (1e3, "ms"),
        s if s >= 1e-6 => (1e6, "µs"),
        s if s > 0.0 => (1e9, "ns"),
        _ => (1.0, "s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_as_people_write_them() {
        for (value, text) in [
            (0.0, "0"),
            (3.0, "3"),
            (-0.25, "−0.25"),
            (0.784_398, "0.7844"),
            (9999.99, "10000"),
            (123_456.0, "123456"),
            (1e6, "1e6"),
            (-2.5e-7, "−2.5e−7"),
            (f64::INFINITY, "∞"),
        ] {
            assert_eq!(number(value), text);
        }
        assert_eq!(duration(0.001_64), "1.64 ms");
        assert_eq!(duration(f64::NAN), "unknown");
    }

    #[test]
    fn any_range_gives_an_axis() {
        for (low, high) in [
            (0.0, 0.0),
            (1e6, 1e6),
            (f64::NAN, f64::NAN),
            (f64::NEG_INFINITY, f64::INFINITY),
            (-1e308, 1e308),
            (1e-300, 2e-300),
            (3.0, -3.0),
            (1.0, 1.0 + 1e-15),
        ] {
            for axis in [Axis::linear(low, high, 5), Axis::linear_round(low, high, 5)] {
                assert!(axis.low() < axis.high(), "{low} {high}");
                assert!(axis.ticks.len() <= 51);
                for v in [low, high, 0.0, 1e308] {
                    assert!(v.is_nan() || (0.0..=1.0).contains(&axis.place(v)));
                }
            }
        }
    }

    #[test]
    fn ticks_are_round() {
        let labels = |a: Axis| a.ticks.into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(
            labels(Axis::linear(-3.0, 3.0, 6)),
            ["−3", "−2", "−1", "0", "1", "2", "3"]
        );
        assert_eq!(
            labels(Axis::linear(0.0, 0.9, 4)),
            ["0.0", "0.5"]
                .map(String::from)
                .map(|s| s.replace("0.0", "0"))
        );
        let log = Axis::log([1e-3, 5.0, 0.0, f64::NAN].into_iter()).unwrap();
        assert_eq!(labels(log), ["10", "1", "10⁻¹", "10⁻²", "10⁻³"]);
        assert!(Axis::log([0.0, -1.0, f64::NAN].into_iter()).is_none());
    }
}
