//! Some plots of the closed loop as one SVG file, for documents.

use super::closed_loop::{Kind, single};
use super::data::ReportData;
use super::page::STYLE;
use super::panel::{HEIGHT, Style, WIDTH};
use super::svg::escape;
use std::fmt::Write;

/// Space for the legend.
const LEGEND: f64 = 34.0;

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
