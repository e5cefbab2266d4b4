//! The page: words, tables and figures in the order in which an engineer asks for them.

use super::axis::{duration, number};
use super::closed_loop::{Figure, Kind, figures};
use super::data::{ReportData, quantile};
use super::guarantees::guarantees;
use super::numbers;
use super::panel::Style;
use super::svg::escape;
use super::tables::summary;
use std::fmt::Write;

/// The style sheet of pages and pictures.
pub const STYLE: &str = include_str!("style.css");
/// A rise of the cost below this part of it is rounding of the solver.
const ROUNDING: f64 = 1e-6;

/// One self-contained HTML page: no script, nothing loaded from elsewhere.
pub fn render(data: &ReportData) -> String {
    let name = if data.name.is_empty() {
        "closed loop"
    } else {
        &data.name
    };
    let mut body = format!("<h1>{}</h1>\n", escape(name));
    body.push_str(&paragraph(&problem_words(data)));
    section(&mut body, "Summary", &summary(data));
    section(&mut body, "Guarantees", &guarantees(data));
    section(&mut body, "Closed loop", &closed_loop(data));
    section(&mut body, "Cost", &cost(data));
    section(&mut body, "Solve times", &solve_times(data));
    section(&mut body, "Terminal horizon", &horizon(data));
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta name=\"color-scheme\" content=\"light dark\">\n<title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}<footer>mpct {}. Equation numbers: Luque, Chanfreut, Limón, Maestre, Model predictive control for tracking with implicit invariant sets, Automatica 179 (2025) 112436.</footer>\n</body>\n</html>\n",
        escape(name),
        env!("CARGO_PKG_VERSION")
    )
}

fn section(body: &mut String, title: &str, content: &str) {
    write!(body, "<section>\n<h2>{title}</h2>\n{content}</section>\n").unwrap_or(());
}

fn paragraph(words: &str) -> String {
    format!("<p>{words}</p>\n")
}

/// "1 state", "2 states".
pub fn count(n: usize, one: &str) -> String {
    format!("{n} {one}{}", if n == 1 { "" } else { "s" })
}

fn problem_words(data: &ReportData) -> String {
    let d = &data.design;
    let mut words = format!(
        "A plant with {} and {}",
        count(data.states.len(), "state"),
        count(data.inputs.len(), "input")
    );
    if data.time_unit() == "s" {
        let how = if data.continuous {
            "discretised with a zero-order hold of"
        } else {
            "sampled every"
        };
        write!(words, ", {how} {} s", number(data.step_length())).unwrap_or(());
    }
    write!(
        words,
        ", under {}{}. The {} controller for {} predicts N = {} steps; its set-points are kept in λΘ with λ = {}.",
        count(d.constraint_rows, "constraint row"),
        match d.ellipsoids {
            0 => String::new(),
            k => format!(" and {}", count(k, "ellipsoid")),
        },
        escape(&d.formulation),
        escape(&d.task),
        d.prediction_horizon,
        number(d.scaling)
    )
    .unwrap_or(());
    if !d.weights.is_empty() {
        write!(words, " Weights: {}.", escape(&d.weights)).unwrap_or(());
    }
    let segments = data.segments();
    let refused = segments.iter().filter(|s| !s.admissible).count();
    write!(
        words,
        " The run has {}{} and {}, {} admissible{}.",
        count(data.steps.len(), "step"),
        if data.time_unit() == "s" {
            format!(
                " ({} s)",
                number(data.steps.len() as f64 * data.step_length())
            )
        } else {
            String::new()
        },
        count(segments.len(), "set-point"),
        match (refused, segments.len()) {
            (0, 1) => "which is".into(),
            (0, _) => "all of them".into(),
            (r, n) if r == n => "none of them".into(),
            (r, n) => format!("{} of them", n - r),
        },
        if data.disturbed {
            ", under a bounded disturbance"
        } else {
            ""
        }
    )
    .unwrap_or(());
    words
}

fn legend(entries: &[(&str, &str)]) -> String {
    let mut out = String::from("<div class=\"legend\">");
    for (class, name) in entries {
        let mark = match *class {
            "forbidden" => r#"<rect class="forbidden" width="44" height="14"/><path class="limit" d="M0 14H44"/>"#.to_string(),
            "band" => r#"<path class="band" d="M0 2H44V12H0Z"/>"#.to_string(),
            c => format!(r#"<path class="{c}" d="M2 7H42"/>"#),
        };
        write!(
            out,
            r#"<span><svg viewBox="0 0 44 14" aria-hidden="true">{mark}</svg>{name}</span>"#
        )
        .unwrap_or(());
    }
    out.push_str("</div>\n");
    out
}

fn grid(figures: &[Figure]) -> String {
    let mut out = String::from("<div class=\"figures\">\n");
    for f in figures {
        out.push_str(&f.panel.svg(&f.description));
        out.push('\n');
    }
    out.push_str("</div>\n");
    out
}

fn closed_loop(data: &ReportData) -> String {
    if data.steps.is_empty() {
        return paragraph("The run has no step.");
    }
    let (states, state_words) = figures(data, Kind::State);
    let (inputs, input_words) = figures(data, Kind::Input);
    let mut entries = vec![
        (Style::Actual.class(), "plant"),
        (Style::Artificial.class(), "artificial set-point"),
        (Style::SetPoint.class(), "set-point"),
        ("forbidden", "beyond a limit"),
    ];
    if !state_words.is_empty() || !input_words.is_empty() {
        entries.insert(1, ("band", "range of a group"));
    }
    let mut out = legend(&entries);
    for (title, figures, words) in [
        ("States", states, state_words),
        ("Inputs", inputs, input_words),
    ] {
        writeln!(out, "<h3>{title}</h3>").unwrap_or(());
        if !words.is_empty() {
            out.push_str(&paragraph(&words));
        }
        out.push_str(&grid(&figures));
    }
    out
}

fn cost(data: &ReportData) -> String {
    let Some(figure) = numbers::cost(data) else {
        return paragraph("The cost is zero at every step.");
    };
    let rise = data
        .segments()
        .iter()
        .map(|s| s.largest_rise)
        .fold(0.0, f64::max);
    let words = if rise <= ROUNDING {
        let why = match data.design.extension {
            None => ": it is a Lyapunov function of the closed loop (Theorem 4)",
            Some(_) => "",
        };
        format!(
            "The optimal cost does not rise between set-point changes{why}. Vertical lines mark the changes."
        )
    } else if data.disturbed {
        format!(
            "Under the disturbance the optimal cost rises by up to {} of its value at the last set-point change. Vertical lines mark the changes.",
            number(rise)
        )
    } else {
        format!(
            "<span class=\"no\">The optimal cost rises by up to {} of its value at the last set-point change</span>, which the theory excludes{}: look at the status of the steps. Vertical lines mark the changes.",
            number(rise),
            if data.design.extension.is_some() {
                " inside of Υ"
            } else {
                ""
            }
        )
    };
    paragraph(&words)
        + &legend(&[
            ("actual", "optimal cost"),
            ("artificial", "offset cost"),
            (
                "setpoint",
                "optimal cost above the offset cost that remains",
            ),
        ])
        + &format!(
            "<div class=\"one\">{}</div>\n",
            figure.panel.svg(&figure.description)
        )
}

fn solve_times(data: &ReportData) -> String {
    let times = data.solve_times();
    let Some(figure) = numbers::solve_times(data) else {
        return paragraph("No solve time was recorded.");
    };
    let words = format!(
        "{}: median {}, 99 % below {}, longest {}.",
        count(times.len(), "step"),
        duration(quantile(&times, 0.5)),
        duration(quantile(&times, 0.99)),
        duration(quantile(&times, 1.0))
    );
    paragraph(&words)
        + &format!(
            "<div class=\"one\">{}</div>\n",
            figure.panel.svg(&figure.description)
        )
}

fn horizon(data: &ReportData) -> String {
    let Some(figure) = numbers::horizon(data) else {
        return paragraph("The steps at which the rows are spent are not recorded.");
    };
    let words = format!(
        "A constraint row is spent at the first step of the terminal law at which the earlier steps imply it. The horizon ends one step before the last row is spent. It is determined by: {}.",
        escape(&numbers::determining_rows(data))
    );
    // One bar a row needs the width; the histogram of many rows does not.
    let class = if figure.contains("class=\"wide\"") {
        "all"
    } else {
        "one"
    };
    paragraph(&words) + &format!("<div class=\"{class}\">{figure}</div>\n")
}
