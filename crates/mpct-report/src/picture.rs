//! Some plots of the closed loop as one SVG file, for documents.

use super::closed_loop::{Kind, single};
use super::data::{ReportData, Signal};
use super::from_run::problem_signals;
use super::page::STYLE;
use super::panel::{HEIGHT, Style, WIDTH};
use super::svg::escape;
use mpct::Problem;
use std::fmt::Write;

/// Space for the legend.
const LEGEND: f64 = 34.0;

/// The states and inputs with the given names; the first four states and two inputs when no name is given. A message
/// when a name is not known.
pub fn choose(problem: &Problem, names: &[String]) -> Result<Vec<(Kind, usize)>, String> {
    let (states, inputs) = problem_signals(problem);
    if names.is_empty() {
        let first = |kind: Kind, n: usize| (0..n).map(move |i| (kind, i));
        return Ok(first(Kind::State, states.len().min(4))
            .chain(first(Kind::Input, inputs.len().min(2)))
            .collect());
    }
    let find = |signals: &[Signal], name: &str| signals.iter().position(|s| s.name == name);
    names
        .iter()
        .map(|name| {
            find(&states, name)
                .map(|i| (Kind::State, i))
                .or_else(|| find(&inputs, name).map(|i| (Kind::Input, i)))
                .ok_or_else(|| {
                    let known: Vec<&str> = states
                        .iter()
                        .chain(&inputs)
                        .take(40)
                        .map(|s| s.name.as_str())
                        .collect();
                    format!(
                        "no state or input is called \"{name}\"; known names: {}",
                        known.join(", ")
                    )
                })
        })
        .collect()
}

/// The chosen states and inputs (those that exist), two in a row, under a legend; drawn as in the report.
pub fn picture(data: &ReportData, choice: &[(Kind, usize)]) -> String {
    let chosen: Vec<_> = choice
        .iter()
        .filter(|(kind, i)| {
            let n = match kind {
                Kind::State => data.states.len(),
                Kind::Input => data.inputs.len(),
            };
            *i < n
        })
        .collect();
    let width = 2.0 * WIDTH;
    let height = LEGEND + HEIGHT * chosen.len().div_ceil(2) as f64;
    let mut body = String::new();
    for (i, (style, name)) in [
        (Style::Actual, "plant"),
        (Style::Artificial, "artificial set-point"),
        (Style::SetPoint, "set-point"),
    ]
    .into_iter()
    .enumerate()
    {
        let x = 62.0 + 190.0 * i as f64;
        write!(
            body,
            r#"<path class="{}" d="M{x} 18h42"/><text x="{}" y="22">{name}</text>"#,
            style.class(),
            x + 50.0
        )
        .unwrap_or(());
    }
    let x = 62.0 + 190.0 * 3.0;
    write!(
        body,
        r#"<rect class="forbidden" x="{x}" y="11" width="42" height="14"/><text x="{}" y="22">beyond a limit</text>"#,
        x + 50.0
    )
    .unwrap_or(());
    for (i, (kind, signal)) in chosen.into_iter().enumerate() {
        write!(
            body,
            r#"<g transform="translate({} {})">{}</g>"#,
            WIDTH * (i % 2) as f64,
            LEGEND + HEIGHT * (i / 2) as f64,
            single(data, *kind, *signal).panel.inner()
        )
        .unwrap_or(());
    }
    format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" aria-label="closed loop of {}"><style>{}</style><rect class="page" width="{width}" height="{height}"/>{body}</svg>
"#,
        escape(&data.name),
        minified(STYLE)
    )
}

/// The style sheet on one line; it has no `<` or `&`, which XML would read.
fn minified(style: &str) -> String {
    style.split_whitespace().collect::<Vec<_>>().join(" ")
}
