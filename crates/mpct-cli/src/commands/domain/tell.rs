//! Answers as JSON, as text and as a picture.

use super::sets::{Answer, Questions, Told, View};
use crate::commands::vector;
use mpct::analysis::Membership;
use mpct::{Problem, SetPoint};
use mpct_report::{Mark, Plane, Signal, Stroke};
use serde_json::{Value, json};
use std::fmt::Write;

/// Rows of a proof that are told.
const ROWS: usize = 4;

/// One set as JSON.
pub fn as_json(told: &Told) -> Value {
    let states: Vec<Value> = told
        .states
        .iter()
        .map(|(state, answer)| {
            let proof = match answer {
                Answer::Domain(m) | Answer::Infeasible(m) => json!(m),
                Answer::Region(a) => json!(a),
            };
            json!({ "state": state, "inside": answer.is_inside(), "proof": proof })
        })
        .collect();
    let reach: Vec<Value> = told
        .reach
        .iter()
        .map(|(direction, r)| json!({ "direction": direction, "distance": r.distance, "at_most": r.at_most, "state": r.state }))
        .collect();
    json!({
        "set": told.set,
        "states": states,
        "reach": reach,
        "outline": told.outline.as_ref().map(|p| json!({
            "coordinates": p.coordinates, "vertices": p.vertices, "area": p.area(), "gap": p.gap, "queries": p.queries,
        })),
        "volume": told.volume,
    })
}

/// One set as text.
pub fn as_text(text: &mut String, told: &Told, signals: &[Signal]) {
    let _ = writeln!(text, "{}", told.what);
    for (state, answer) in &told.states {
        let _ = writeln!(text, "  state {}: {}", vector(state), proof(answer));
    }
    for (direction, reach) in &told.reach {
        let _ = writeln!(
            text,
            "  along {}: {:.6} times (proved: at most {:.6}), up to {}",
            vector(direction),
            reach.distance,
            reach.at_most,
            vector(&reach.state)
        );
    }
    if let Some(p) = &told.outline {
        let _ = writeln!(
            text,
            "  outline in {} and {}: {} vertices, area {:.6}; the set reaches at most {:.1e} of its half-widths beyond it",
            signals[p.coordinates.0].name,
            signals[p.coordinates.1].name,
            p.vertices.len(),
            p.area(),
            p.gap
        );
        for v in &p.vertices {
            let _ = writeln!(text, "    {:>12.6} {:>12.6}", v[0] + 0.0, v[1] + 0.0);
        }
    }
    if let Some(v) = &told.volume {
        let name = ["length", "area", "volume"][v.dimension.clamp(1, 3) - 1];
        let _ = writeln!(
            text,
            "  {name} {:.6}; the set reaches at most {:.1e} of its half-widths beyond that hull",
            v.value, v.gap
        );
    }
}

fn proof(answer: &Answer) -> String {
    match answer {
        Answer::Domain(Membership::Inside { slack, .. })
        | Answer::Infeasible(Membership::Inside { slack, .. }) => format!(
            "inside; a candidate leaves every row {:.3e} of its room or more",
            slack.max(0.0)
        ),
        Answer::Domain(Membership::Outside { gap, rows, .. })
        | Answer::Infeasible(Membership::Outside { gap, rows, .. }) => {
            let told: Vec<String> = rows
                .iter()
                .take(ROWS)
                .map(|(row, y)| format!("{row} ({y:.3})"))
                .collect();
            let more = match rows.len().saturating_sub(ROWS) {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            let what = match answer {
                Answer::Infeasible(_) => "outside, (35) is infeasible",
                _ => "outside",
            };
            format!(
                "{what}; rows contradict each other by {gap:.3e} with the multipliers {}{more}",
                told.join(", ")
            )
        }
        Answer::Region(a) if a.is_inside() => format!(
            "inside; the optimal cost exceeds the least offset cost by {:.6e}, at most {:.6e}",
            a.cost, a.level
        ),
        Answer::Region(a) => format!(
            "outside; the optimal cost exceeds the least offset cost by {:.6e}, more than {:.6e}",
            a.cost, a.level
        ),
    }
}

/// The outlines, the states asked for, and the set-point of a stability region.
pub fn draw(
    told: &[Told],
    questions: &Questions,
    problem: &Problem,
    signals: &[Signal],
    set_point: &SetPoint,
) -> String {
    // From broad to narrow, so that lines that coincide are all seen.
    const STROKES: [Stroke; 5] = [
        Stroke::Pale,
        Stroke::Broad,
        Stroke::Dashed,
        Stroke::DashDotted,
        Stroke::Dotted,
    ];
    let (i, j) = match questions.view {
        Some(View::Projection(i, j) | View::Section(i, j)) => (i, j),
        None => (0, 1),
    };
    let states: Vec<(f64, f64)> = questions.states.iter().map(|x| (x[i], x[j])).collect();
    let mut room = states.clone();
    for t in told {
        let vertices = t.outline.iter().flat_map(|p| &p.vertices);
        room.extend(vertices.map(|v| (v[0], v[1])));
    }
    let title = |k: usize| match &signals[k].unit {
        Some(_) => signals[k].title(),
        None => format!("{} (no unit)", signals[k].name),
    };
    let mut plane = Plane::new(&title(i), &title(j), &room);
    let (lower, upper) = problem.constraints().state_limits();
    plane.forbidden_beyond((lower[i], upper[i]), (lower[j], upper[j]));
    let alone = usize::from(told.len() == 1);
    for (t, stroke) in told.iter().zip(STROKES.into_iter().cycle().skip(alone)) {
        if let Some(p) = &t.outline {
            let name = t.set.replace('_', " ");
            plane.polygon(&name, &p.vertices, stroke);
        }
    }
    if !states.is_empty() {
        plane.marks("state asked for", &states, Mark::Dot);
    }
    if told.iter().any(|t| t.set == "stability_region") {
        let at = &set_point.state;
        plane.marks("set-point", &[(at[i], at[j])], Mark::Circle);
    }
    plane.svg("outlines of sets of states")
}
