//! The few parts of SVG that the report draws with.

use std::fmt::Write;

/// Text made safe for HTML and SVG, in content and in attributes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // XML allows no other control characters.
            c if c.is_control() && !matches!(c, '\n' | '\t') => out.push('\u{fffd}'),
            '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// Points per pixel above which only the first, lowest, highest and last point of a pixel column are kept.
const DENSITY: f64 = 4.0;

/// The `d` of a path through the points, in pixels. A NaN lifts the pen. Points that add nothing are left out.
pub fn path(points: &[(f64, f64)]) -> String {
    let mut out = String::new();
    for run in points.split(|p| !(p.0.is_finite() && p.1.is_finite())) {
        let kept = straighten(&thin(run));
        match kept.as_slice() {
            [] => {}
            // A pen with a round tip leaves a dot.
            [p] => write!(out, "M{} {}h0", tenth(p.0), tenth(p.1)).unwrap_or(()),
            many => {
                for (i, p) in many.iter().enumerate() {
                    let pen = if i == 0 { 'M' } else { 'L' };
                    write!(out, "{pen}{} {}", tenth(p.0), tenth(p.1)).unwrap_or(());
                }
            }
        }
    }
    out
}

/// The `d` of the band between two curves over the same x; points with a NaN are left out.
pub fn band(x: &[f64], low: &[f64], high: &[f64]) -> String {
    let good: Vec<usize> = (0..x.len())
        .filter(|&i| low[i].is_finite() && high[i].is_finite())
        .collect();
    if good.len() < 2 {
        return String::new();
    }
    let up: Vec<_> = good.iter().map(|&i| (x[i], high[i])).collect();
    let down: Vec<_> = good.iter().rev().map(|&i| (x[i], low[i])).collect();
    let down = path(&down).replacen('M', "L", 1);
    format!("{}{down}Z", path(&up))
}

/// The corners of a staircase that holds each value until the next x; `end` closes the last step.
pub fn stairs(x: &[f64], y: &[f64], end: f64) -> Vec<(f64, f64)> {
    let mut points = Vec::with_capacity(2 * x.len());
    for i in 0..x.len().min(y.len()) {
        points.push((x[i], y[i]));
        points.push((x.get(i + 1).copied().unwrap_or(end), y[i]));
    }
    points
}

/// A coordinate with one decimal at most.
pub fn tenth(v: f64) -> String {
    let r = (v * 10.0).round() / 10.0;
    // No "-0".
    format!("{}", r + 0.0)
}

fn thin(run: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let (Some(first), Some(last)) = (run.first(), run.last()) else {
        return Vec::new();
    };
    if run.len() as f64 <= DENSITY * (last.0 - first.0).abs().max(1.0) {
        return run.to_vec();
    }
    let mut out = Vec::new();
    for column in run.chunk_by(|a, b| a.0.floor() == b.0.floor()) {
        let extreme = |sign: f64| {
            (0..column.len()).max_by(|&i, &j| (sign * column[i].1).total_cmp(&(sign * column[j].1)))
        };
        let mut keep = vec![0, column.len() - 1];
        keep.extend(extreme(1.0));
        keep.extend(extreme(-1.0));
        keep.sort_unstable();
        keep.dedup();
        out.extend(keep.into_iter().map(|i| column[i]));
    }
    out
}

/// Leaves out the points inside horizontal and vertical runs, at the resolution that is written.
fn straighten(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let same = |a: f64, b: f64| (a * 10.0).round() == (b * 10.0).round();
    let mut out: Vec<(f64, f64)> = Vec::new();
    for &p in points {
        if let [.., a, b] = out.as_slice() {
            let level = same(a.1, b.1) && same(b.1, p.1);
            let upright = same(a.0, b.0) && same(b.0, p.0) && (b.1 - a.1) * (p.1 - b.1) >= 0.0;
            if level || upright {
                out.pop();
            }
        }
        if out
            .last()
            .is_none_or(|b| !(same(b.0, p.0) && same(b.1, p.1)))
        {
            out.push(p);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn level_runs_become_one_line() {
        let points: Vec<_> = (0..100).map(|k| (f64::from(k), 5.0)).collect();
        assert_eq!(path(&points), "M0 5L99 5");
    }

    #[test]
    fn a_nan_lifts_the_pen() {
        let points = [(0.0, 1.0), (1.0, 2.0), (2.0, f64::NAN), (3.0, 1.0)];
        assert_eq!(path(&points), "M0 1L1 2M3 1h0");
        assert_eq!(path(&[]), "");
    }

    #[test]
    fn dense_curves_keep_their_extremes() {
        let points: Vec<_> = (0..100_000)
            .map(|k| (f64::from(k) / 1000.0, if k == 50_500 { 80.0 } else { 10.0 }))
            .collect();
        let d = path(&points);
        assert!(d.contains(" 80") && d.len() < 2000, "{d}");
    }

    #[test]
    fn stairs_hold_their_value() {
        assert_eq!(
            stairs(&[0.0, 1.0], &[5.0, 6.0], 2.0),
            [(0.0, 5.0), (1.0, 5.0), (1.0, 6.0), (2.0, 6.0)]
        );
    }

    #[test]
    fn text_is_escaped() {
        assert_eq!(escape("<a & \"b'\u{0}"), "&lt;a &amp; &quot;b&#39;\u{fffd}");
    }
}
