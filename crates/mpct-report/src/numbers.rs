//! Cost, solve times and the terminal horizon, drawn.

use super::axis::{Axis, duration_unit};
use super::closed_loop::Figure;
use super::data::{ReportData, StepRecord, quantile};
use super::panel::{Panel, Style};
use super::svg::{escape, stairs, tenth};
use std::collections::BTreeMap;

/// Bars of the histogram of solve times.
const BINS: usize = 32;
/// Above this ratio of longest to median solve time the bins have equal ratios instead of equal widths.
const LONG_TAIL: f64 = 8.0;
/// Up to this many constraint rows each has a bar of its own.
const ROWS: usize = 48;
/// Names of rows listed when there are too many for a bar each.
const NAMES: usize = 8;

/// The optimal cost, its offset part, and what it is above the offset cost that its set-point ends with, over time on
/// a logarithmic axis; `None` when no cost is positive. Where a set-point is not admissible only the last one shows
/// the decrease.
pub fn cost(data: &ReportData) -> Option<Figure> {
    let mut above: Vec<f64> = data.steps.iter().map(|s| s.cost).collect();
    for s in data.segments() {
        for v in &mut above[s.from..s.to] {
            *v -= s.offset_cost;
        }
    }
    let y = Axis::log(data.steps.iter().flat_map(|s| [s.cost, s.offset_cost]))?;
    let step = data.step_length();
    let end = data.steps.len().max(1) as f64 * step;
    let t: Vec<f64> = (0..data.steps.len()).map(|k| k as f64 * step).collect();
    let mut panel = Panel::new(
        Axis::linear(0.0, end, 6),
        data.time_title(),
        y,
        "optimal cost (no unit)",
    );
    for k in data.changes().into_iter().filter(|&k| k > 0) {
        panel.mark(k as f64 * step);
    }
    let mut draw = |style: Style, values: &[f64]| {
        let positive: Vec<f64> = values
            .iter()
            .map(|&v| if v > 0.0 { v } else { f64::NAN })
            .collect();
        panel.curve(style, &stairs(&t, &positive, end));
    };
    let of = |get: fn(&StepRecord) -> f64| data.steps.iter().map(get).collect::<Vec<_>>();
    draw(Style::Actual, &of(|s| s.cost));
    draw(Style::Artificial, &of(|s| s.offset_cost));
    draw(Style::SetPoint, &above);
    Some(Figure {
        panel,
        description: "optimal cost and offset cost over time, logarithmic".into(),
    })
}

/// How often each solve time occurred; `None` without a time.
pub fn solve_times(data: &ReportData) -> Option<Figure> {
    let times = data.solve_times();
    let (longest, median) = (*times.last()?, quantile(&times, 0.5));
    let (factor, unit) = duration_unit(median);
    let values: Vec<f64> = times.iter().map(|t| t * factor).collect();
    let logarithmic = longest > LONG_TAIL * median && median > 0.0;
    let (name, x) = if logarithmic {
        (
            format!("solve time ({unit}), logarithmic"),
            Axis::log(values.iter().copied())?,
        )
    } else {
        (
            format!("solve time ({unit})"),
            Axis::linear_round(0.0, longest * factor, 6),
        )
    };
    let mut counts = [0usize; BINS];
    for v in &values {
        counts[((x.place(*v) * BINS as f64) as usize).min(BINS - 1)] += 1;
    }
    let most = counts.iter().max().copied().unwrap_or(0);
    let y = Axis::linear_round(0.0, most as f64, 4);
    let edge = |i: usize| {
        let v = x.low() + (x.high() - x.low()) * i as f64 / BINS as f64;
        if logarithmic { 10_f64.powf(v) } else { v }
    };
    let edges: Vec<f64> = (0..=BINS).map(edge).collect();
    let mut panel = Panel::new(x, &name, y, "number of steps");
    for (i, &count) in counts.iter().enumerate() {
        panel.bar(edges[i], edges[i + 1], count as f64);
    }
    panel.mark(quantile(&values, 0.5));
    panel.remark("dotted: median");
    Some(Figure {
        panel,
        description: format!("histogram of {} solve times", values.len()),
    })
}

/// For each constraint row, the first step at which it is spent; the rows that determine the horizon stand out.
/// With many rows: how many are spent at each step.
pub fn horizon(data: &ReportData) -> Option<String> {
    let spent = &data.design.spent;
    let last = spent.iter().map(|s| s.1).max()?;
    if spent.len() > ROWS {
        return Some(rows_per_step(spent, last));
    }
    let mut rows: Vec<&(String, usize)> = spent.iter().collect();
    rows.sort_by_key(|r| std::cmp::Reverse(r.1));
    let name_width = 7.0 * rows.iter().map(|r| r.0.chars().count()).max()? as f64;
    let left = name_width.clamp(60.0, 300.0) + 14.0;
    let (width, pitch, top) = (900.0, 17.0, 22.0);
    let right = width - 40.0;
    let axis = Axis::linear(0.0, last.max(1) as f64, 8);
    let at = |step: f64| left + axis.place(step) * (right - left);
    let bottom = top + pitch * rows.len() as f64;
    let mut body = String::new();
    for (value, label) in &axis.ticks {
        let x = tenth(at(*value));
        body.push_str(&format!(
            r#"<path class="grid" d="M{x} {top}V{bottom}"/><text class="tick" x="{x}" y="{}" text-anchor="middle">{label}</text>"#,
            bottom + 15.0
        ));
    }
    for (i, (name, step)) in rows.iter().enumerate() {
        let y = top + pitch * i as f64;
        let class = if *step == last { "bar" } else { "bar weak" };
        let end = at(*step as f64);
        body.push_str(&format!(
            r#"<text class="tick" x="{}" y="{}" text-anchor="end">{}</text><rect class="{class}" x="{left}" y="{}" width="{}" height="{}"/><text class="tick" x="{}" y="{}">{step}</text>"#,
            left - 6.0,
            y + 12.5,
            escape(name),
            y + 3.0,
            tenth((end - left).max(1.0)),
            pitch - 5.0,
            tenth(end + 5.0),
            y + 12.5,
        ));
    }
    body.push_str(&format!(
        r#"<path class="frame" d="M{left} {top}V{bottom}H{right}"/><text class="axis" x="{}" y="{}" text-anchor="middle">step at which the row is spent</text>"#,
        tenth(0.5 * (left + right)),
        bottom + 33.0
    ));
    Some(format!(
        r#"<svg class="wide" viewBox="0 0 {width} {}" role="img" aria-label="step at which each constraint row is spent">{body}</svg>"#,
        bottom + 40.0
    ))
}

fn rows_per_step(spent: &[(String, usize)], last: usize) -> String {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for (_, step) in spent {
        *counts.entry(*step).or_default() += 1;
    }
    let most = counts.values().max().copied().unwrap_or(0);
    let mut panel = Panel::new(
        Axis::linear(-0.5, last as f64 + 0.5, 8),
        "step at which a row is spent",
        Axis::linear_round(0.0, most as f64, 4),
        "number of constraint rows",
    );
    for (&step, &count) in &counts {
        panel.bar(step as f64 - 0.5, step as f64 + 0.5, count as f64);
    }
    panel.svg("number of constraint rows spent at each step")
}

/// The rows that are spent last, in words.
pub fn determining_rows(data: &ReportData) -> String {
    let spent = &data.design.spent;
    let last = spent.iter().map(|s| s.1).max().unwrap_or(0);
    let rows: Vec<&str> = spent
        .iter()
        .filter(|s| s.1 == last)
        .map(|s| s.0.as_str())
        .collect();
    let mut words = rows
        .iter()
        .take(NAMES)
        .copied()
        .collect::<Vec<_>>()
        .join(", ");
    if rows.len() > NAMES {
        words.push_str(&format!(" and {} more", rows.len() - NAMES));
    }
    words
}
