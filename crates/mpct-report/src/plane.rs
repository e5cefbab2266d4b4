//! A plot of outlines, paths and marks in a plane, with axes and a legend below that covers no data.

use std::fmt::Write;

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 420.0;
const LEFT: f64 = 62.0;
const BOTTOM: f64 = 46.0;
const EDGE: f64 = 14.0;

/// How a line is drawn; told apart by its dashes.
#[derive(Clone, Copy)]
pub enum Stroke {
    Solid,
    Dashed,
    Dotted,
}

/// The shape of a mark.
#[derive(Clone, Copy)]
pub enum Mark {
    Circle,
    Cross,
}

impl Stroke {
    fn attributes(self) -> &'static str {
        match self {
            Self::Solid => "stroke-width=\"1.6\"",
            Self::Dashed => "stroke-width=\"1.6\" stroke-dasharray=\"8 4\"",
            Self::Dotted => "stroke-width=\"1.8\" stroke-dasharray=\"2 4\"",
        }
    }
}

/// A plot being drawn.
pub struct Plane {
    x: (f64, f64),
    y: (f64, f64),
    body: String,
    legend: Vec<(String, String)>,
}

impl Plane {
    pub fn new(x_title: &str, y_title: &str, points: &[(f64, f64)]) -> Self {
        let range = |pick: fn(&(f64, f64)) -> f64| {
            let finite = || points.iter().map(pick).filter(|v| v.is_finite());
            let (low, high) = (
                finite().fold(f64::INFINITY, f64::min),
                finite().fold(f64::NEG_INFINITY, f64::max),
            );
            let room = if high > low { 0.06 * (high - low) } else { 1.0 };
            if low.is_finite() {
                (low - room, high + room)
            } else {
                (-1.0, 1.0)
            }
        };
        let mut plane = Self {
            x: range(|p| p.0),
            y: range(|p| p.1),
            body: String::new(),
            legend: Vec::new(),
        };
        plane.axes(x_title, y_title);
        plane
    }

    fn place(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let share = |v: f64, (low, high): (f64, f64)| (v - low) / (high - low);
        (
            LEFT + share(x, self.x) * (WIDTH - LEFT - EDGE),
            HEIGHT - BOTTOM - share(y, self.y) * (HEIGHT - BOTTOM - EDGE),
        )
    }

    fn axes(&mut self, x_title: &str, y_title: &str) {
        let (right, floor) = (WIDTH - EDGE, HEIGHT - BOTTOM);
        let mut out = format!(
            "<rect x=\"{LEFT}\" y=\"{EDGE}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#888\"/>",
            right - LEFT,
            floor - EDGE
        );
        for v in ticks(self.x) {
            let (x, _) = self.place((v, self.y.0));
            let _ = write!(
                out,
                "<path d=\"M{x:.1} {floor}v5\" stroke=\"#888\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                floor + 18.0,
                label(v)
            );
        }
        for v in ticks(self.y) {
            let (_, y) = self.place((self.x.0, v));
            let _ = write!(
                out,
                "<path d=\"M{LEFT} {y:.1}h-5\" stroke=\"#888\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                LEFT - 8.0,
                y + 4.0,
                label(v)
            );
        }
        let (mx, my) = (0.5 * (LEFT + right), 0.5 * (EDGE + floor));
        let _ = write!(
            out,
            "<text x=\"{mx}\" y=\"{}\" text-anchor=\"middle\">{x_title}</text><text transform=\"translate(16 {my}) rotate(-90)\" text-anchor=\"middle\">{y_title}</text>",
            HEIGHT - 8.0
        );
        self.body = out;
    }

    /// Shades what lies beyond −limit ≤ x, y ≤ limit.
    pub fn forbidden_beyond(&mut self, limit: f64) {
        let frame = [
            (self.x.0, self.y.0),
            (self.x.1, self.y.0),
            (self.x.1, self.y.1),
            (self.x.0, self.y.1),
        ];
        let inner = [
            (-limit, -limit),
            (-limit, limit),
            (limit, limit),
            (limit, -limit),
        ];
        let mut d = String::new();
        for ring in [frame, inner] {
            for (k, p) in ring.into_iter().enumerate() {
                let (x, y) = self.place(p);
                let _ = write!(d, "{}{x:.1} {y:.1}", if k == 0 { "M" } else { "L" });
            }
            d.push('Z');
        }
        let look = "fill=\"#000\" fill-opacity=\"0.12\" fill-rule=\"evenodd\"";
        let _ = write!(self.body, "<path d=\"{d}\" {look}/>");
        let sample = format!("<rect y=\"-6\" width=\"34\" height=\"12\" {look}/>");
        self.legend.push((sample, "beyond a constraint".into()));
    }

    fn line(
        &mut self,
        name: &str,
        points: &[(f64, f64)],
        stroke: Stroke,
        closed: bool,
        colour: &str,
    ) {
        let mut d = String::new();
        for (k, &p) in points.iter().enumerate() {
            let (x, y) = self.place(p);
            let _ = write!(d, "{}{x:.1} {y:.1}", if k == 0 { "M" } else { "L" });
        }
        let end = if closed { "Z" } else { "" };
        let look = format!("fill=\"none\" stroke=\"{colour}\" {}", stroke.attributes());
        let _ = write!(self.body, "<path d=\"{d}{end}\" {look}/>");
        self.legend
            .push((format!("<path d=\"M0 0h34\" {look}/>"), name.into()));
    }

    /// A closed outline.
    pub fn polygon(&mut self, name: &str, vertices: &[[f64; 2]], stroke: Stroke) {
        let points: Vec<(f64, f64)> = vertices.iter().map(|v| (v[0], v[1])).collect();
        self.line(name, &points, stroke, true, "#777");
    }

    /// An open path.
    pub fn path(&mut self, name: &str, points: &[(f64, f64)], stroke: Stroke) {
        self.line(name, points, stroke, false, "#06c");
    }

    /// Marks.
    pub fn marks(&mut self, name: &str, points: &[(f64, f64)], mark: Mark) {
        let shape = |x: f64, y: f64| match mark {
            Mark::Circle => format!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"none\" stroke=\"#111\" stroke-width=\"1.6\"/>"
            ),
            Mark::Cross => format!(
                "<path d=\"M{:.1} {:.1}l8 8m0 -8l-8 8\" stroke=\"#111\" stroke-width=\"1.6\"/>",
                x - 4.0,
                y - 4.0
            ),
        };
        for &p in points {
            let (x, y) = self.place(p);
            let drawn = shape(x, y);
            self.body.push_str(&drawn);
        }
        self.legend.push((shape(17.0, 0.0), name.into()));
    }

    /// The picture.
    pub fn svg(&self) -> String {
        let rows = self.legend.len().div_ceil(2);
        let total = HEIGHT + 8.0 + 20.0 * rows as f64;
        let mut legend = String::new();
        for (k, (drawing, name)) in self.legend.iter().enumerate() {
            let (x, y) = (
                LEFT + 290.0 * (k % 2) as f64,
                HEIGHT + 12.0 + 20.0 * (k / 2) as f64,
            );
            let _ = write!(
                legend,
                "<g transform=\"translate({x} {y})\">{drawing}<text x=\"42\" y=\"4\">{name}</text></g>"
            );
        }
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {total}\" role=\"img\">{}{legend}</svg>",
            self.body
        )
    }
}

/// About six round numbers in a range.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let raw = (high - low) / 6.0;
    let unit = 10.0_f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|s| s * unit)
        .find(|s| *s >= raw)
        .unwrap_or(raw);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

fn label(v: f64) -> String {
    let text = format!("{v:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}
