//! The page of `mpct reproduce`: tables beside the printed numbers, figures as SVG that also read in grey print.

use super::axis::{duration, number};
use super::plane::{Mark, Plane, Stroke};
use super::space::Space;
use super::svg::escape;
use mpct::analysis::Polygon;
use mpct::analysis::reproduce::{FigurePoint, Reproduction};
use std::fmt::Write;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:66rem;margin:2rem auto;padding:0 1rem;color:#111;background:#fff}\
.wide{overflow-x:auto}table{border-collapse:collapse;margin:1rem 0}th,td{padding:.2rem .5rem;text-align:right;white-space:nowrap;border-bottom:1px solid #ccc}\
thead tr:last-child th{border-bottom:2px solid #333}th[colspan]{text-align:center;border-bottom:1px solid #999}.small{font-size:13.5px}\
figure{margin:1.2rem 0}figcaption,.note{color:#333;max-width:50rem}.printed{color:#666}\
figure svg{width:100%;max-width:42rem;height:auto}.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(26rem,100%),1fr));gap:.6rem 1.2rem}\
@media print{body{margin:0;max-width:none;font-size:10pt}figure,table{break-inside:avoid}h2{break-after:avoid}}";

/// A picture of the page: the item, the name of its file without an ending, the SVG.
pub struct Drawn {
    pub item: &'static str,
    pub name: &'static str,
    pub svg: String,
}

/// The page, self-contained.
pub fn reproduction_page(r: &Reproduction, machine: &str) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Section 4, run again</title><style>{STYLE}</style>\
<h1>Section 4, run again</h1><p>Luque, Chanfreut, Lim\u{f3}n, Maestre, <i>Model predictive control for tracking with \
implicit invariant sets</i>, Automatica 179 (2025). Numbers of the paper are in grey, ours in black. Times on: {}; \
mpct {}.</p>",
        escape(machine),
        env!("CARGO_PKG_VERSION")
    );
    table_1(&mut out, r);
    table_2(&mut out, r, machine);
    let drawn = figures(r);
    for (item, caption) in [
        (
            "Figure 1",
            "The plane of the academic plant: sets, set-points and the trajectory. The last set-point is not admissible; its artificial set-point is the closest that is. In this plane the domain of attraction and the projected terminal set for tracking are the same to the eye."
                .to_string(),
        ),
        ("Figure 2", caption_2(r)),
        (
            "Figure 3",
            "The drone's position over time with its artificial set-points and set-points, and its path in space within the box of the position limits. Set-points are numbered in their order; dashed lines lead down to the floor."
                .to_string(),
        ),
    ] {
        let mut pictures = String::new();
        for d in drawn.iter().filter(|d| d.item == item) {
            pictures.push_str(&d.svg);
        }
        let class = if item == "Figure 3" { " class=\"pair\"" } else { "" };
        let _ = write!(
            out,
            "<h2>{item}</h2><figure><div{class}>{pictures}</div><figcaption>{}</figcaption></figure>{}",
            escape(&caption),
            choice(r, item)
        );
    }
    out.push_str("</html>\n");
    out
}

fn caption_2(r: &Reproduction) -> String {
    let two = &r.figure_2;
    format!(
        "Horizon extension {}, gamma {}, alpha {}, d = {:.4} (printed: {}). Area of the stability region {:.3}, of the projected terminal set {:.3}, of the feasible states {:.3}. Largest alpha: {:.3} for every admissible equilibrium, {:.2} throughout the region, {:.2} around the set-point.",
        two.horizon_extension,
        two.gamma,
        two.alpha,
        two.d,
        two.printed_d,
        two.region.area(),
        two.tracking_set.area(),
        two.feasible.area(),
        two.largest_alpha[0],
        two.largest_alpha[1],
        two.largest_alpha[2]
    )
}

/// The pictures, in the order of the page.
pub fn figures(r: &Reproduction) -> Vec<Drawn> {
    let mut all = vec![figure_1(r), figure_2(r)];
    all.extend(figure_3(r));
    all
}

fn figure_1(r: &Reproduction) -> Drawn {
    let one = &r.figure_1;
    let ((low, high), (below, above)) = limits(&mpct::cases::academic().problem, 0, 1);
    let mut plane = Plane::new(
        "x1 (no unit)",
        "x2 (no unit)",
        &all(&[&one.domain, &one.tracking_set], &one.run),
    );
    plane.forbidden_beyond((low, high), (below, above));
    plane.polygon(
        "terminal set for tracking, projected",
        &one.tracking_set.vertices,
        Stroke::Pale,
    );
    plane.polygon("domain of attraction", &one.domain.vertices, Stroke::Dotted);
    plane.polygon(
        "terminal set for regulation",
        &one.regulation_set.vertices,
        Stroke::DashDotted,
    );
    plane.path("state", &trace(&one.run), Stroke::Broad);
    plane.marks("set-point", &changes(&one.run, false), Mark::Circle);
    plane.marks(
        "artificial set-point, last of each",
        &changes(&one.run, true),
        Mark::Cross,
    );
    Drawn {
        item: "Figure 1",
        name: "figure-1",
        svg: plane.svg("sets, set-points and trajectory of the academic plant"),
    }
}

fn figure_2(r: &Reproduction) -> Drawn {
    let two = &r.figure_2;
    let (x, y) = limits(&mpct::cases::academic().problem, 0, 1);
    let mut plane = Plane::new(
        "x1 (no unit)",
        "x2 (no unit)",
        &all(&[&two.region, &two.tracking_set, &two.feasible], &[]),
    );
    plane.forbidden_beyond(x, y);
    plane.polygon(
        "terminal set for tracking, projected",
        &two.tracking_set.vertices,
        Stroke::Pale,
    );
    plane.polygon("stability region", &two.region.vertices, Stroke::Broad);
    plane.polygon(
        "states at which (35) is feasible",
        &two.feasible.vertices,
        Stroke::Dotted,
    );
    plane.marks(
        "set-point",
        &[(two.set_point[0], two.set_point[1])],
        Mark::Circle,
    );
    Drawn {
        item: "Figure 2",
        name: "figure-2",
        svg: plane.svg("the stability region and the projected terminal set"),
    }
}

fn figure_3(r: &Reproduction) -> Vec<Drawn> {
    let run = &r.figure_3.run;
    let problem = mpct::cases::drone().problem;
    let (lower, upper) = problem.constraints().state_limits();
    let end = run.last().map_or(1.0, |p| p.time);
    let mut drawn = Vec::new();
    for (i, (name, title)) in [
        ("figure-3-px", "px (m)"),
        ("figure-3-py", "py (m)"),
        ("figure-3-pz", "pz (m)"),
    ]
    .into_iter()
    .enumerate()
    {
        let of = |pick: fn(&FigurePoint) -> &Vec<f64>| -> Vec<(f64, f64)> {
            run.iter().map(|p| (p.time, pick(p)[i])).collect()
        };
        let mut plane = Plane::low("time (s)", title, &[(0.0, lower[i]), (end, upper[i])]);
        plane.forbidden_beyond((f64::NEG_INFINITY, f64::INFINITY), (lower[i], upper[i]));
        plane.path("position", &of(|p| &p.state), Stroke::Broad);
        plane.path(
            "artificial set-point",
            &held(&of(|p| &p.artificial)),
            Stroke::Dashed,
        );
        plane.path("set-point", &held(&of(|p| &p.set_point)), Stroke::Dotted);
        drawn.push(Drawn {
            item: "Figure 3",
            name,
            svg: plane.svg(&format!("{title} over time")),
        });
    }
    let point = |p: &[f64]| [p[0], p[1], p[2]];
    let path: Vec<[f64; 3]> = run.iter().map(|p| point(&p.state)).collect();
    let ends: Vec<&FigurePoint> = last_of_each(run).collect();
    let mut space = Space::new(
        ["px (m)", "py (m)", "pz (m)"],
        [0, 1, 2].map(|i| (lower[i], upper[i])),
    );
    space.path("position", &path);
    let set_points: Vec<_> = ends.iter().map(|p| point(&p.set_point)).collect();
    let artificial: Vec<_> = ends.iter().map(|p| point(&p.artificial)).collect();
    space.marks("set-point", &set_points, Mark::Circle, true);
    space.marks(
        "artificial set-point, last of each",
        &artificial,
        Mark::Cross,
        false,
    );
    let start: Vec<_> = path.first().copied().into_iter().collect();
    space.marks("start", &start, Mark::Dot, false);
    drawn.push(Drawn {
        item: "Figure 3",
        name: "figure-3-path",
        svg: space.svg("the drone's path in space"),
    });
    drawn
}

/// The limits of two states.
fn limits(problem: &mpct::Problem, i: usize, j: usize) -> ((f64, f64), (f64, f64)) {
    let (lower, upper) = problem.constraints().state_limits();
    ((lower[i], upper[i]), (lower[j], upper[j]))
}

/// A staircase: each value holds until the next instant.
fn held(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut out: Vec<(f64, f64)> = Vec::with_capacity(points.len());
    for &(t, v) in points {
        if let Some(&(_, before)) = out.last()
            && before != v
        {
            out.push((t, before));
        }
        out.push((t, v));
    }
    out
}

fn trace(run: &[FigurePoint]) -> Vec<(f64, f64)> {
    run.iter().map(|p| (p.state[0], p.state[1])).collect()
}

/// The last step of each set-point.
fn last_of_each(run: &[FigurePoint]) -> impl Iterator<Item = &FigurePoint> {
    (0..run.len())
        .filter(|&k| k + 1 == run.len() || run[k + 1].set_point != run[k].set_point)
        .map(|k| &run[k])
}

/// The set-points, or where the artificial set-point stands when the next one comes.
fn changes(run: &[FigurePoint], artificial: bool) -> Vec<(f64, f64)> {
    last_of_each(run)
        .map(|p| {
            let v = if artificial {
                &p.artificial
            } else {
                &p.set_point
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
            format!(
                "<p class=\"note\"><b>Unsaid, and chosen here.</b> {}</p>",
                escape(c.text)
            )
        })
}

fn table_1(out: &mut String, r: &Reproduction) {
    out.push_str("<h2>Table 1</h2><table><thead><tr><th rowspan=2>plant<th rowspan=2>\u{3bb}<th colspan=2>terminal horizon M\u{303}<th colspan=2>cumulative cost<th rowspan=2>steps<tr><th>ours<th class=printed>paper<th>ours<th class=printed>paper</thead>");
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

fn table_2(out: &mut String, r: &Reproduction, machine: &str) {
    let pair = "<th>ours<th class=printed>paper";
    let _ = write!(
        out,
        "<h2>Table 2</h2><p>Times of ours on: {}. Offline: K, P and the terminal horizon; for the explicit form also the irredundant rows of the terminal set. Online: mean of a step; the last column counts the steps of the implicit form.</p><div class=wide><table class=small><thead><tr><th rowspan=2>carts<th rowspan=2>M\u{303}<th rowspan=2>variables<th colspan=2>rows<th colspan=2>offline implicit<th colspan=2>offline explicit<th colspan=2>online implicit<th colspan=2>online explicit<th rowspan=2>steps<br>timed<tr><th>implicit<th>explicit{pair}{pair}{pair}{pair}</thead>",
        escape(machine)
    );
    let cell = |v: Option<f64>| v.map_or("\u{2013}".into(), duration);
    let printed = |v: Option<f64>| match v {
        Some(v) if v >= 1e3 => format!("{} s", number(v)),
        v => cell(v),
    };
    for l in &r.table_2 {
        let _ = write!(
            out,
            "<tr><td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td class=printed>{}<td>{}<td class=printed>{}<td>{}<td class=printed>{}<td>{}<td class=printed>{}<td>{}",
            l.carts,
            l.terminal_horizon,
            l.variables,
            l.implicit_rows,
            l.explicit_rows.map_or("\u{2013}".into(), |v| v.to_string()),
            duration(l.implicit_offline),
            printed(l.printed[0]),
            cell(l.explicit_offline),
            printed(l.printed[1]),
            duration(l.implicit_online),
            printed(l.printed[2]),
            cell(l.explicit_online),
            printed(l.printed[3]),
            l.steps
        );
    }
    out.push_str("</table></div>");
    out.push_str(&choice(r, "Table 2"));
}
