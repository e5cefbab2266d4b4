//! A plot of outlines, paths and marks in a plane, with axes and a legend below that covers no data. Lines are told apart
//! by dashes and marks by their shapes, so that grey print shows them all.

use super::svg::escape;
use std::fmt::Write;

const WIDTH: f64 = 640.0;
const LEFT: f64 = 62.0;
const BOTTOM: f64 = 46.0;
const EDGE: f64 = 14.0;
const TALL: f64 = 430.0;
const LOW: f64 = 230.0;
/// Pitch of the legend's lines.
const LINE: f64 = 20.0;

/// How a line is drawn.
#[derive(Clone, Copy)]
pub enum Stroke {
    /// Dashes.
    Dashed,
    /// Round dots.
    Dotted,
    /// Dashes and dots in turn.
    DashDotted,
    /// A solid line that is broader than the others: what a plot is about.
    Broad,
    /// Broad and pale, to lie under other lines.
    Pale,
}

/// The shape of a mark.
#[derive(Clone, Copy)]
pub enum Mark {
    /// An open circle.
    Circle,
    /// A cross.
    Cross,
    /// A filled dot.
    Dot,
}

impl Stroke {
    pub(crate) fn attributes(self) -> &'static str {
        match self {
            Self::Dashed => "stroke=\"#a33b06\" stroke-width=\"1.7\" stroke-dasharray=\"8 4\"",
            Self::Dotted => {
                "stroke=\"#111\" stroke-width=\"2.2\" stroke-dasharray=\".1 4.6\" stroke-linecap=\"round\""
            }
            Self::DashDotted => {
                "stroke=\"#333\" stroke-width=\"1.7\" stroke-dasharray=\"9 3.5 1.5 3.5\""
            }
            Self::Pale => "stroke=\"#bbb\" stroke-width=\"6\" stroke-linejoin=\"round\"",
            Self::Broad => "stroke=\"#3f86d0\" stroke-width=\"2.6\" stroke-linejoin=\"round\"",
        }
    }
}

impl Mark {
    /// The mark at a place.
    pub fn svg(self, x: f64, y: f64) -> String {
        match self {
            Self::Circle => format!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"6\" fill=\"none\" stroke=\"#111\" stroke-width=\"1.6\"/>"
            ),
            Self::Cross => format!(
                "<path d=\"M{:.1} {:.1}l8 8m0 -8l-8 8\" fill=\"none\" stroke=\"#a33b06\" stroke-width=\"2\"/>",
                x - 4.0,
                y - 4.0
            ),
            Self::Dot => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"#111\"/>"),
        }
    }
}

/// Names of what is drawn, each beside a sample; two in a line below the plot.
#[derive(Default)]
pub struct Legend(Vec<(String, String)>);

impl Legend {
    pub fn add(&mut self, sample: String, name: &str) {
        self.0.push((sample, name.into()));
    }

    pub fn line(&mut self, stroke: Stroke, name: &str) {
        let look = stroke.attributes();
        self.add(format!("<path d=\"M0 0h34\" fill=\"none\" {look}/>"), name);
    }

    pub fn mark(&mut self, mark: Mark, name: &str) {
        self.add(mark.svg(17.0, 0.0), name);
    }

    /// The whole picture: `body`, then the legend.
    pub fn below(&self, body: &str, height: f64, description: &str) -> String {
        let total = height + 10.0 + LINE * self.0.len().div_ceil(2) as f64;
        let mut legend = String::new();
        for (k, (sample, name)) in self.0.iter().enumerate() {
            let (x, y) = (
                LEFT + 290.0 * (k % 2) as f64,
                height + 12.0 + LINE * (k / 2) as f64,
            );
            let _ = write!(
                legend,
                "<g transform=\"translate({x} {y})\">{sample}<text x=\"42\" y=\"4\">{}</text></g>",
                escape(name)
            );
        }
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {total}\" role=\"img\" aria-label=\"{}\"><style>svg text {{ font: 13px system-ui, sans-serif; fill: #111; }}</style>{body}{legend}</svg>",
            escape(description)
        )
    }
}

/// A plot being drawn.
pub struct Plane {
    x: (f64, f64),
    y: (f64, f64),
    height: f64,
    body: String,
    /// Axes are drawn last, over the shading.
    axes: String,
    legend: Legend,
}

impl Plane {
    /// A plot that has room for the points.
    pub fn new(x_title: &str, y_title: &str, points: &[(f64, f64)]) -> Self {
        Self::sized(x_title, y_title, points, TALL)
    }

    /// A low plot, for something over time.
    pub fn low(x_title: &str, y_title: &str, points: &[(f64, f64)]) -> Self {
        Self::sized(x_title, y_title, points, LOW)
    }

    fn sized(x_title: &str, y_title: &str, points: &[(f64, f64)], height: f64) -> Self {
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
            height,
            body: String::new(),
            axes: String::new(),
            legend: Legend::default(),
        };
        plane.draw_axes(x_title, y_title);
        plane
    }

    fn place(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let share = |v: f64, (low, high): (f64, f64)| ((v - low) / (high - low)).clamp(0.0, 1.0);
        let floor = self.height - BOTTOM;
        (
            LEFT + share(x, self.x) * (WIDTH - LEFT - EDGE),
            floor - share(y, self.y) * (floor - EDGE),
        )
    }

    fn draw_axes(&mut self, x_title: &str, y_title: &str) {
        let (right, floor) = (WIDTH - EDGE, self.height - BOTTOM);
        let mut out = format!(
            "<rect x=\"{LEFT}\" y=\"{EDGE}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#888\"/>",
            right - LEFT,
            floor - EDGE
        );
        for v in ticks(self.x, 6.0) {
            let (x, _) = self.place((v, self.y.0));
            let _ = write!(
                out,
                "<path d=\"M{x:.1} {floor}v5\" stroke=\"#888\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                floor + 18.0,
                label(v)
            );
        }
        for v in ticks(self.y, if self.height > LOW { 6.0 } else { 4.0 }) {
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
            "<text x=\"{mx}\" y=\"{}\" text-anchor=\"middle\">{}</text><text transform=\"translate(16 {my}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            self.height - 8.0,
            escape(x_title),
            escape(y_title)
        );
        self.axes = out;
    }

    /// Shades what lies beyond the bounds of the two coordinates; infinite ones bound nothing.
    pub fn forbidden_beyond(&mut self, x: (f64, f64), y: (f64, f64)) {
        let frame = [
            (self.x.0, self.y.0),
            (self.x.1, self.y.0),
            (self.x.1, self.y.1),
            (self.x.0, self.y.1),
        ];
        let inner = [(x.0, y.0), (x.0, y.1), (x.1, y.1), (x.1, y.0)];
        let mut d = String::new();
        for ring in [frame, inner] {
            for (k, p) in ring.into_iter().enumerate() {
                let (x, y) = self.place(p);
                let _ = write!(d, "{}{x:.1} {y:.1}", if k == 0 { "M" } else { "L" });
            }
            d.push('Z');
        }
        let look = "fill=\"#000\" fill-opacity=\"0.13\" fill-rule=\"evenodd\"";
        let _ = write!(self.body, "<path d=\"{d}\" {look}/>");
        self.legend.add(
            format!("<rect y=\"-6\" width=\"34\" height=\"12\" {look}/>"),
            "beyond a constraint",
        );
    }

    fn line(&mut self, name: &str, points: &[(f64, f64)], stroke: Stroke, closed: bool) {
        let mut d = String::new();
        for (k, &p) in points.iter().enumerate() {
            let (x, y) = self.place(p);
            let _ = write!(d, "{}{x:.1} {y:.1}", if k == 0 { "M" } else { "L" });
        }
        let end = if closed { "Z" } else { "" };
        let _ = write!(
            self.body,
            "<path d=\"{d}{end}\" fill=\"none\" {}/>",
            stroke.attributes()
        );
        self.legend.line(stroke, name);
    }

    /// A closed outline.
    pub fn polygon(&mut self, name: &str, vertices: &[[f64; 2]], stroke: Stroke) {
        let points: Vec<(f64, f64)> = vertices.iter().map(|v| (v[0], v[1])).collect();
        self.line(name, &points, stroke, true);
    }

    /// An open path.
    pub fn path(&mut self, name: &str, points: &[(f64, f64)], stroke: Stroke) {
        self.line(name, points, stroke, false);
    }

    /// Marks.
    pub fn marks(&mut self, name: &str, points: &[(f64, f64)], mark: Mark) {
        for &p in points {
            let (x, y) = self.place(p);
            self.body.push_str(&mark.svg(x, y));
        }
        self.legend.mark(mark, name);
    }

    /// The picture.
    pub fn svg(&self, description: &str) -> String {
        let body = format!("{}{}", self.body, self.axes);
        self.legend.below(&body, self.height, description)
    }
}

/// About `count` round numbers in a range.
pub fn ticks((low, high): (f64, f64), count: f64) -> Vec<f64> {
    let raw = (high - low) / count;
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

/// A tick's number.
pub fn label(v: f64) -> String {
    if v != 0.0 && !(1e-3..1e6).contains(&v.abs()) {
        return super::axis::number(v);
    }
    let text = format!("{v:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.replace('-', "\u{2212}")
    }
}
