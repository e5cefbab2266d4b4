//! The page of `mpct reproduce`: tables beside the printed numbers, figures as SVG that also read in grey print.

use super::plane::{Mark, Plane, Stroke};
use mpct::analysis::Polygon;
use mpct::analysis::reproduce::{FigurePoint, Reproduction};
use std::fmt::Write;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#111;background:#fff}\
.wide{overflow-x:auto}table{border-collapse:collapse;margin:1rem 0}th,td{padding:.2rem .45rem;text-align:right;white-space:nowrap;border-bottom:1px solid #ccc}\
th{border-bottom:2px solid #333}figure{margin:1.5rem 0}figcaption,.note{color:#333;max-width:48rem}.printed{color:#666}\
svg{width:100%;max-width:44rem;height:auto}svg text{font:13px system-ui,sans-serif;fill:#111}";

/// The page, self-contained.
pub fn reproduction_page(r: &Reproduction, machine: &str) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Section 4, run again</title><style>{STYLE}</style>\
<h1>Section 4, run again</h1><p>Luque, Chanfreut, Lim&oacute;n, Maestre, <i>Model predictive control for tracking with \
implicit invariant sets</i>, Automatica 179 (2025). Printed numbers are in grey. Times on: {}.</p>",
        super::svg::escape(machine)
    );
    table_1(&mut out, r);
    table_2(&mut out, r);
    let one = &r.figure_1;
    let mut plane = Plane::new(
        "x1",
        "x2",
        &all(&[&one.domain, &one.tracking_set], &one.run),
    );
    plane.forbidden_beyond(3.0);
    plane.polygon("domain of attraction", &one.domain.vertices, Stroke::Dotted);
    plane.polygon(
        "terminal set for tracking, projected",
        &one.tracking_set.vertices,
        Stroke::Solid,
    );
    plane.polygon(
        "terminal set for regulation",
        &one.regulation_set.vertices,
        Stroke::Dashed,
    );
    plane.path("state", &trace(&one.run, |p| &p.state), Stroke::Solid);
    plane.marks(
        "artificial set-point",
        &changes(&one.run, true),
        Mark::Cross,
    );
    plane.marks("set-point", &changes(&one.run, false), Mark::Circle);
    figure(
        &mut out,
        r,
        "Figure 1",
        "The plane of the academic plant. The last set-point is not admissible; its artificial set-point is the closest that is.",
        &plane.svg(),
    );
    let two = &r.figure_2;
    let mut plane = Plane::new("x1", "x2", &all(&[&two.region, &two.tracking_set], &[]));
    plane.forbidden_beyond(3.0);
    plane.polygon("stability region", &two.region.vertices, Stroke::Solid);
    plane.polygon(
        "terminal set for tracking, projected",
        &two.tracking_set.vertices,
        Stroke::Dashed,
    );
    plane.polygon("feasible states", &two.feasible.vertices, Stroke::Dotted);
    plane.marks(
        "set-point",
        &[(two.set_point[0], two.set_point[1])],
        Mark::Circle,
    );
    let caption = format!(
        "Horizon extension {}, gamma {}, alpha {}, d = {:.4} (printed: {}). Area of the stability region {:.3}, of the projected terminal set {:.3}. Largest alpha: {:.3} for every admissible equilibrium, {:.2} throughout the region, {:.2} around the set-point.",
        two.horizon_extension,
        two.gamma,
        two.alpha,
        two.d,
        two.printed_d,
        two.region.area(),
        two.tracking_set.area(),
        two.largest_alpha[0],
        two.largest_alpha[1],
        two.largest_alpha[2]
    );
    figure(&mut out, r, "Figure 2", &caption, &plane.svg());
    let run = &r.figure_3.run;
    let mut pictures = String::new();
    for (i, axis) in ["px [m]", "py [m]", "pz [m]"].iter().enumerate() {
        let of = |pick: fn(&FigurePoint) -> &Vec<f64>| -> Vec<(f64, f64)> {
            run.iter().map(|p| (p.time, pick(p)[i])).collect()
        };
        let (state, artificial, set_point) = (
            of(|p| &p.state),
            of(|p| &p.artificial),
            of(|p| &p.set_point),
        );
        let points: Vec<(f64, f64)> = [&state, &artificial, &set_point]
            .into_iter()
            .flatten()
            .copied()
            .collect();
        let mut plane = Plane::new("time [s]", axis, &points);
        plane.path("position", &state, Stroke::Solid);
        plane.path("artificial set-point", &artificial, Stroke::Dashed);
        plane.path("set-point", &set_point, Stroke::Dotted);
        pictures.push_str(&plane.svg());
    }
    // A cabinet projection shows the path in space.
    let space = |p: &[f64]| (p[0] + 0.35 * p[1], p[2] + 0.35 * p[1]);
    let path: Vec<(f64, f64)> = run.iter().map(|p| space(&p.state)).collect();
    let goals: Vec<(f64, f64)> = starts(run).map(|p| space(&p.set_point)).collect();
    let points: Vec<(f64, f64)> = path.iter().chain(&goals).copied().collect();
    let mut plane = Plane::new("px + 0.35 py [m]", "pz + 0.35 py [m]", &points);
    plane.path("path in space, seen at an angle", &path, Stroke::Solid);
    plane.marks("set-point", &goals, Mark::Circle);
    pictures.push_str(&plane.svg());
    figure(
        &mut out,
        r,
        "Figure 3",
        "The drone's position over time, and its path in space.",
        &pictures,
    );
    out.push_str("</html>\n");
    out
}

fn starts(run: &[FigurePoint]) -> impl Iterator<Item = &FigurePoint> {
    run.iter()
        .enumerate()
        .filter(|(k, p)| *k == 0 || run[k - 1].set_point != p.set_point)
        .map(|(_, p)| p)
}

fn trace(run: &[FigurePoint], pick: fn(&FigurePoint) -> &Vec<f64>) -> Vec<(f64, f64)> {
    run.iter().map(|p| (pick(p)[0], pick(p)[1])).collect()
}

/// The set-points, or where the artificial set-point stands when the next one comes.
fn changes(run: &[FigurePoint], artificial: bool) -> Vec<(f64, f64)> {
    (0..run.len())
        .filter(|&k| k + 1 == run.len() || run[k + 1].set_point != run[k].set_point)
        .map(|k| {
            let v = if artificial {
                &run[k].artificial
            } else {
                &run[k].set_point
            };
            (v[0], v[1])
        })
        .collect()
}

fn all(polygons: &[&Polygon], run: &[FigurePoint]) -> Vec<(f64, f64)> {
    let vertices = polygons
        .iter()
        .flat_map(|p| p.vertices.iter().map(|v| (v[0], v[1])));
    vertices.chain(changes(run, false)).collect()
}

fn choice(r: &Reproduction, item: &str) -> String {
    r.choices
        .iter()
        .find(|c| c.item == item)
        .map_or(String::new(), |c| {
            format!("<p class=\"note\">{}</p>", super::svg::escape(c.text))
        })
}

fn figure(out: &mut String, r: &Reproduction, item: &str, caption: &str, picture: &str) {
    let note = choice(r, item);
    let caption = super::svg::escape(caption);
    let _ = write!(
        out,
        "<h2>{item}</h2><figure>{picture}<figcaption>{caption}</figcaption></figure>{note}"
    );
}

fn table_1(out: &mut String, r: &Reproduction) {
    out.push_str("<h2>Table 1</h2><table><tr><th>plant<th>scaling<th>terminal horizon<th class=printed>printed<th>cumulative cost<th class=printed>printed<th>steps");
    for l in &r.table_1 {
        let _ = write!(
            out,
            "<tr><td>{}<td>{}<td>{}<td class=printed>{}<td>{:.4e}<td class=printed>{:.4e}<td>{}",
            l.plant,
            l.scaling,
            l.terminal_horizon,
            l.printed_horizon,
            l.cumulative_cost,
            l.printed_cost,
            l.steps
        );
    }
    out.push_str("</table>");
    out.push_str(&choice(r, "Table 1"));
}

fn table_2(out: &mut String, r: &Reproduction) {
    out.push_str("<h2>Table 2</h2><p>Seconds.</p><div class=wide><table><tr><th>carts<th>terminal horizon<th>variables<th>rows implicit<th>explicit<th>offline implicit<th class=printed>printed<th>offline explicit<th class=printed>printed<th>online implicit<th class=printed>printed<th>online explicit<th class=printed>printed<th>steps timed");
    let cell = |v: Option<f64>| v.map_or("&ndash;".into(), |v| format!("{v:.3e}"));
    for l in &r.table_2 {
        let _ = write!(
            out,
            "<tr><td>{}<td>{}<td>{}<td>{}<td>{}<td>{:.3e}<td class=printed>{}<td>{}<td class=printed>{}<td>{:.3e}<td class=printed>{}<td>{}<td class=printed>{}<td>{}",
            l.carts,
            l.terminal_horizon,
            l.variables,
            l.implicit_rows,
            l.explicit_rows.map_or("&ndash;".into(), |v| v.to_string()),
            l.implicit_offline,
            cell(l.printed[0]),
            cell(l.explicit_offline),
            cell(l.printed[1]),
            l.implicit_online,
            cell(l.printed[2]),
            cell(l.explicit_online),
            cell(l.printed[3]),
            l.steps
        );
    }
    out.push_str("</table></div>");
    out.push_str(&choice(r, "Table 2"));
}
