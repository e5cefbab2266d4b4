//! Tables of the page: the run and its set-points.

use super::axis::{duration, number};
use super::data::{ReportData, Segment, quantile};
use super::page::count;
use super::svg::escape;
use std::fmt::Write;

/// Entries of a set-point written out in the table.
const ENTRIES: usize = 6;
/// A violation up to this counts as satisfied.
const SATISFIED: f64 = 1e-8;

pub(super) fn rows(pairs: &[(&str, String)]) -> String {
    let mut out = String::from("<table>\n");
    for (name, value) in pairs {
        writeln!(out, "<tr><th>{name}</th><td>{value}</td></tr>").unwrap_or(());
    }
    out.push_str("</table>\n");
    out
}

/// The run in a few lines, and one line for each set-point.
pub fn summary(data: &ReportData) -> String {
    let times = data.solve_times();
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    let iterations: Vec<usize> = data.steps.iter().map(|s| s.iterations).collect();
    let fine = data.steps.iter().filter(|s| s.status == "optimal").count();
    let budget = match data.sampling_time {
        Some(t) if t.is_finite() && t > 0.0 && !times.is_empty() => format!(
            "; the longest takes {} % of the sampling time",
            number(100.0 * quantile(&times, 1.0) / t)
        ),
        _ => String::new(),
    };
    let mut pairs = vec![
        (
            "Cumulative cost",
            format!(
                "{} (stage and offset cost added over the run, section 4.1)",
                number(data.cumulative_cost)
            ),
        ),
        (
            "Constraints",
            match data.worst_violation {
                v if !(v > 0.0) => "satisfied at every step".into(),
                v if v <= SATISFIED => format!(
                    "satisfied at every step (to {}, rounding included)",
                    number(v)
                ),
                v => format!(
                    "<span class=\"no\">violated by {} at most</span>",
                    number(v)
                ),
            },
        ),
        (
            "Solved",
            if fine == data.steps.len() {
                format!("all {} to optimality", count(data.steps.len(), "step"))
            } else {
                format!(
                    "<span class=\"no\">{fine} of {} to optimality</span>: {}",
                    count(data.steps.len(), "step"),
                    other_statuses(data)
                )
            },
        ),
    ];
    if !times.is_empty() {
        pairs.push((
            "Solve time",
            format!(
                "mean {}, longest {}{budget}",
                duration(mean),
                duration(quantile(&times, 1.0))
            ),
        ));
    }
    if let Some(most) = iterations.iter().max() {
        pairs.push((
            "Iterations",
            format!(
                "mean {}, most {most}",
                number(iterations.iter().sum::<usize>() as f64 / iterations.len() as f64)
            ),
        ));
    }
    rows(&pairs) + &set_points(data)
}

fn other_statuses(data: &ReportData) -> String {
    let mut names: Vec<&str> = data
        .steps
        .iter()
        .map(|s| s.status.as_str())
        .filter(|s| *s != "optimal")
        .collect();
    names.sort_unstable();
    names
        .chunk_by(|a, b| a == b)
        .map(|c| format!("{} {}", c.len(), escape(c[0])))
        .collect::<Vec<_>>()
        .join(", ")
}

fn set_points(data: &ReportData) -> String {
    let segments = data.segments();
    if segments.is_empty() {
        return String::new();
    }
    let step = data.step_length();
    let unit = data.time_unit();
    let mut out = format!(
        "<div class=\"scroll\"><table>\n<thead><tr><th class=\"n\">from ({unit})</th><th>set-point, entries other than 0</th><th>admissible</th><th class=\"n\">offset cost at the end</th><th class=\"n\">largest |x − x<sub>s</sub><sup>a</sup>| at the end</th><th class=\"n\">settled after ({unit})</th></tr></thead>\n<tbody>\n"
    );
    for s in &segments {
        writeln!(
            out,
            "<tr><td class=\"n\">{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            number(s.from as f64 * step),
            set_point_words(data, s),
            if s.admissible { "yes" } else { "<span class=\"no\">no</span>" },
            number(s.offset_cost),
            number(s.distance),
            s.settled_after
                .map_or("not settled".into(), |k| number(k as f64 * step)),
        )
        .unwrap_or(());
    }
    out.push_str("</tbody></table></div>\n");
    out.push_str(
        "<p class=\"soft\">Settled: the state stays within 2 % of its largest distance, over these steps, from the artificial set-point at the end. A set-point that is not admissible is replaced by the admissible equilibrium of least offset cost.</p>\n",
    );
    out
}

fn set_point_words(data: &ReportData, segment: &Segment) -> String {
    let set_point = &data.steps[segment.from].set_point;
    let entries: Vec<String> = set_point
        .iter()
        .enumerate()
        .filter(|(_, v)| **v != 0.0)
        .map(|(i, v)| match data.states.get(i) {
            Some(s) => format!("{} = {}", escape(&s.name), number(*v)),
            None => number(*v),
        })
        .collect();
    match entries.len() {
        0 => "all 0".into(),
        n if n > ENTRIES => format!("{} and {} more", entries[..ENTRIES].join(", "), n - ENTRIES),
        _ => entries.join(", "),
    }
}
