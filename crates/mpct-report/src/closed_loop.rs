//! States and inputs over time, each with its artificial set-point, its set-point and its limits.

use super::axis::{Axis, number};
use super::data::{ReportData, Signal, StepRecord};
use super::panel::{Panel, Style};
use super::svg::stairs;

/// Up to this many states (or inputs) each has a plot of its own; beyond it, groups have envelopes.
pub const EACH: usize = 12;
/// Signals of a group that have a plot of their own beside the envelope.
const SAMPLES: usize = 3;
/// Groups with an envelope; further ones are left out, and the page says so.
const GROUPS: usize = 6;
/// A limit farther away than this many spans of the data is named instead of drawn: the data would look flat.
const IN_SIGHT: f64 = 1.5;
/// Data whose span is below this part of the limits is drawn between the limits: it did not move.
const STILL: f64 = 1e-4;

/// A plot, and the words that describe it.
pub struct Figure {
    pub panel: Panel,
    pub description: String,
}

/// Which of the two vectors of a step is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    State,
    Input,
}

impl Kind {
    fn signals(self, data: &ReportData) -> &[Signal] {
        match self {
            Self::State => &data.states,
            Self::Input => &data.inputs,
        }
    }

    fn actual(self, step: &StepRecord) -> &[f64] {
        match self {
            Self::State => &step.x,
            Self::Input => &step.u,
        }
    }

    fn artificial(self, step: &StepRecord) -> &[f64] {
        match self {
            Self::State => &step.artificial_state,
            Self::Input => &step.artificial_input,
        }
    }

    fn set_point(self, step: &StepRecord) -> &[f64] {
        match self {
            Self::State => &step.set_point,
            Self::Input => &[],
        }
    }
}

/// Entry i of a vector of every step; NaN where there is none.
fn column(data: &ReportData, of: impl Fn(&StepRecord) -> &[f64], i: usize) -> Vec<f64> {
    data.steps
        .iter()
        .map(|s| of(s).get(i).copied().unwrap_or(f64::NAN))
        .collect()
}

/// The instants of the steps.
fn instants(data: &ReportData) -> Vec<f64> {
    let step = data.step_length();
    (0..data.steps.len()).map(|k| k as f64 * step).collect()
}

fn time_axis(data: &ReportData) -> Axis {
    Axis::linear(0.0, data.steps.len().max(1) as f64 * data.step_length(), 6)
}

fn smallest_and_largest(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v), b.max(v))
        })
}

/// The value axis for data in [low, high], with each limit in sight when it is near; and the limits out of sight.
fn value_axis(low: f64, high: f64, signal: &Signal) -> (Axis, String) {
    let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
    let room = signal.upper - signal.lower;
    let mut span = high - low;
    let still = room.is_finite() && span < STILL * room;
    if still {
        span = room;
    } else if !(span > 0.0) {
        span = low.abs().max(1.0);
    }
    let (mut bottom, mut top) = (low, high);
    let mut hidden = Vec::new();
    for (limit, sign) in [(signal.lower, "≥"), (signal.upper, "≤")] {
        if !limit.is_finite() {
            continue;
        }
        let beyond = (low - limit).max(limit - high);
        if beyond <= IN_SIGHT * span {
            bottom = bottom.min(limit);
            top = top.max(limit);
        } else {
            hidden.push(format!("{sign} {}", number(limit)));
        }
    }
    let pad = 0.06 * if top > bottom { top - bottom } else { span };
    let remark = if hidden.is_empty() {
        String::new()
    } else {
        format!("out of sight: {}", hidden.join(", "))
    };
    (Axis::linear(bottom - pad, top + pad, 7), remark)
}

/// The plot of one state or input.
pub fn single(data: &ReportData, kind: Kind, i: usize) -> Figure {
    let signal = &kind.signals(data)[i];
    let t = instants(data);
    let end = data.steps.len() as f64 * data.step_length();
    let artificial = column(data, |s| kind.artificial(s), i);
    let set_point = column(data, |s| kind.set_point(s), i);
    let mut actual = column(data, |s| kind.actual(s), i);
    let (low, high) = smallest_and_largest(
        actual
            .iter()
            .chain(&artificial)
            .chain(&set_point)
            .chain(data.final_state.get(i).filter(|_| kind == Kind::State))
            .copied(),
    );
    let (y, remark) = value_axis(low, high, signal);
    let mut panel = Panel::new(time_axis(data), data.time_title(), y, &signal.title());
    panel.remark(&remark);
    panel.limits(signal.lower, signal.upper);
    match kind {
        Kind::State => {
            let mut times = t.clone();
            if let Some(&last) = data.final_state.get(i) {
                times.push(end);
                actual.push(last);
            }
            let points: Vec<_> = times.into_iter().zip(actual).collect();
            panel.curve(Style::Actual, &points);
        }
        Kind::Input => panel.curve(Style::Actual, &stairs(&t, &actual, end)),
    }
    panel.curve(Style::Artificial, &stairs(&t, &artificial, end));
    panel.curve(Style::SetPoint, &stairs(&t, &set_point, end));
    Figure {
        panel,
        description: format!(
            "{} over time, between {} and {}",
            signal.title(),
            number(low),
            number(high)
        ),
    }
}

/// The range of a group of signals with equal limits, from the lowest to the highest at each step.
fn envelope(data: &ReportData, kind: Kind, members: &[usize]) -> Figure {
    let signals = kind.signals(data);
    let first = &signals[members[0]];
    let t = instants(data);
    let end = data.steps.len() as f64 * data.step_length();
    let range = |of: &dyn Fn(&StepRecord) -> &[f64]| -> (Vec<f64>, Vec<f64>) {
        data.steps
            .iter()
            .map(|s| {
                let v = of(s);
                let (a, b) =
                    smallest_and_largest(members.iter().filter_map(|&i| v.get(i)).copied());
                if a <= b { (a, b) } else { (f64::NAN, f64::NAN) }
            })
            .unzip()
    };
    let (low, high) = range(&|s| kind.actual(s));
    let (art_low, art_high) = range(&|s| kind.artificial(s));
    let (set_low, set_high) = range(&|s| kind.set_point(s));
    let all = [&low, &high, &art_low, &art_high, &set_low, &set_high];
    let (bottom, top) = smallest_and_largest(all.into_iter().flatten().copied());
    let (y, remark) = value_axis(bottom, top, first);
    let unit = first
        .unit
        .as_ref()
        .map_or(String::new(), |u| format!(" ({u})"));
    let title = format!(
        "{} … {}, lowest to highest of {}{unit}",
        first.name,
        signals[members[members.len() - 1]].name,
        members.len()
    );
    let mut panel = Panel::new(time_axis(data), data.time_title(), y, &title);
    panel.remark(&remark);
    panel.limits(first.lower, first.upper);
    // Held until the next step, as inputs are; at the scale of a whole run states look the same.
    let double = |v: &[f64]| stairs(&t, v, end);
    let corners: Vec<f64> = double(&low).iter().map(|p| p.0).collect();
    let ys = |v: &[f64]| double(v).iter().map(|p| p.1).collect::<Vec<_>>();
    panel.band(&corners, &ys(&low), &ys(&high));
    for v in [&art_low, &art_high] {
        panel.curve(Style::Artificial, &double(v));
    }
    for v in [&set_low, &set_high] {
        panel.curve(Style::SetPoint, &double(v));
    }
    Figure {
        panel,
        description: format!(
            "range of {title} over time, between {} and {}",
            number(bottom),
            number(top)
        ),
    }
}

/// Signals with equal limits and unit, in order of appearance.
fn groups(signals: &[Signal]) -> Vec<Vec<usize>> {
    let same = |a: &Signal, b: &Signal| {
        a.lower.to_bits() == b.lower.to_bits()
            && a.upper.to_bits() == b.upper.to_bits()
            && a.unit == b.unit
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, signal) in signals.iter().enumerate() {
        match groups.iter_mut().find(|g| same(&signals[g[0]], signal)) {
            Some(group) => group.push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// The plots of all states or all inputs, and a sentence when some are left out.
pub fn figures(data: &ReportData, kind: Kind) -> (Vec<Figure>, String) {
    let signals = kind.signals(data);
    if signals.len() <= EACH {
        let each = (0..signals.len()).map(|i| single(data, kind, i)).collect();
        return (each, String::new());
    }
    let groups = groups(signals);
    let mut out = Vec::new();
    for group in groups.iter().take(GROUPS) {
        if group.len() > 1 {
            out.push(envelope(data, kind, group));
        }
        for &i in group.iter().take(SAMPLES) {
            out.push(single(data, kind, i));
        }
    }
    let name = match kind {
        Kind::State => "states",
        Kind::Input => "inputs",
    };
    let shown = out.len();
    let words = format!(
        "{} {name} in {} of equal limits: the range of each group and its first members ({shown} plots{}). All values are in the CSV file.",
        signals.len(),
        if groups.len() == 1 {
            "one group".into()
        } else {
            format!("{} groups", groups.len())
        },
        if groups.len() > GROUPS {
            format!(", of the first {GROUPS} groups")
        } else {
            String::new()
        }
    );
    (out, words)
}
