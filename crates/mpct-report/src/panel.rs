//! One plot: a frame with axes, shaded limits and curves.

use super::axis::Axis;
use super::svg::{band, escape, path, tenth};
use std::fmt::Write;

/// Width of a plot in its own units.
pub const WIDTH: f64 = 540.0;
/// Height of a plot in its own units.
pub const HEIGHT: f64 = 200.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 520.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 158.0;

/// The kinds of curves. Each has its own width and dashes, so that grey print tells them apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// The plant's own state or input: a broad solid line.
    Actual,
    /// The artificial set-point: a dashed line.
    Artificial,
    /// The set-point: a dotted line.
    SetPoint,
}

impl Style {
    /// The class that the style sheet draws.
    pub fn class(self) -> &'static str {
        match self {
            Self::Actual => "actual",
            Self::Artificial => "artificial",
            Self::SetPoint => "setpoint",
        }
    }
}

/// A plot under construction.
pub struct Panel {
    x: Axis,
    y: Axis,
    body: String,
    head: String,
    titles: (String, String),
}

impl Panel {
    /// An empty plot with the names of its axes; the one of y stands above the frame.
    pub fn new(x: Axis, x_title: &str, y: Axis, y_title: &str) -> Self {
        Self {
            x,
            y,
            body: String::new(),
            head: String::new(),
            titles: (x_title.into(), y_title.into()),
        }
    }

    /// A remark at the upper right, outside of the frame.
    pub fn remark(&mut self, text: &str) {
        if !text.is_empty() {
            self.head.push_str(&format!(
                r#"<text class="remark" x="{RIGHT}" y="18" text-anchor="end">{}</text>"#,
                escape(text)
            ));
        }
    }

    fn px(&self, x: f64) -> f64 {
        LEFT + self.x.place(x) * (RIGHT - LEFT)
    }

    fn py(&self, y: f64) -> f64 {
        BOTTOM - self.y.place(y) * (BOTTOM - TOP)
    }

    /// Shades what lies outside of [lower, upper], and draws the limits that are in sight.
    pub fn limits(&mut self, lower: f64, upper: f64) {
        let width = tenth(RIGHT - LEFT);
        if upper > self.y.low() && upper < self.y.high() {
            let y = self.py(upper);
            self.body.push_str(&format!(
                r#"<rect class="forbidden" x="{LEFT}" y="{TOP}" width="{width}" height="{}"/><path class="limit" d="M{LEFT} {y:.1}H{RIGHT}"/>"#,
                tenth(y - TOP),
            ));
        }
        if lower > self.y.low() && lower < self.y.high() {
            let y = self.py(lower);
            self.body.push_str(&format!(
                r#"<rect class="forbidden" x="{LEFT}" y="{y:.1}" width="{width}" height="{}"/><path class="limit" d="M{LEFT} {y:.1}H{RIGHT}"/>"#,
                tenth(BOTTOM - y),
            ));
        }
    }

    /// A curve through the points.
    pub fn curve(&mut self, style: Style, points: &[(f64, f64)]) {
        let pixels: Vec<_> = points
            .iter()
            .map(|&(x, y)| (self.px(x), self.py(y)))
            .collect();
        let d = path(&pixels);
        if !d.is_empty() {
            let class = style.class();
            self.body
                .push_str(&format!(r#"<path class="{class}" d="{d}"/>"#));
        }
    }

    /// A filled band between two curves over the same x.
    pub fn band(&mut self, x: &[f64], low: &[f64], high: &[f64]) {
        let x: Vec<_> = x.iter().map(|&v| self.px(v)).collect();
        let low: Vec<_> = low.iter().map(|&v| self.py(v)).collect();
        let high: Vec<_> = high.iter().map(|&v| self.py(v)).collect();
        let d = band(&x, &low, &high);
        if !d.is_empty() {
            self.body
                .push_str(&format!(r#"<path class="band" d="{d}"/>"#));
        }
    }

    /// A bar from the lower edge up to `y` over [from, to].
    pub fn bar(&mut self, from: f64, to: f64, y: f64) {
        let (a, b, top) = (self.px(from), self.px(to), self.py(y));
        if y > 0.0 {
            // A bar of one among thousands is still seen.
            let top = top.min(BOTTOM - 1.5);
            self.body.push_str(&format!(
                r#"<rect class="bar" x="{}" y="{}" width="{}" height="{}"/>"#,
                tenth(a + 0.5),
                tenth(top),
                tenth((b - a - 1.0).max(0.5)),
                tenth(BOTTOM - top)
            ));
        }
    }

    /// A thin dotted line across the height.
    pub fn mark(&mut self, x: f64) {
        let at = self.px(x);
        if !at.is_nan() {
            self.body.push_str(&format!(
                r#"<path class="mark" d="M{at:.1} {TOP}V{BOTTOM}"/>"#
            ));
        }
    }

    /// The plot without an `svg` element around it.
    pub fn inner(&self) -> String {
        let mut out = String::new();
        let mut grid = String::new();
        for (value, label) in &self.y.ticks {
            let y = self.py(*value);
            write!(grid, "M{LEFT} {y:.1}H{RIGHT}").unwrap_or(());
            write!(
                out,
                r#"<text class="tick" x="{}" y="{:.1}" text-anchor="end">{label}</text>"#,
                LEFT - 6.0,
                y + 3.5
            )
            .unwrap_or(());
        }
        let mut ticks = String::new();
        for (value, label) in &self.x.ticks {
            let x = self.px(*value);
            write!(ticks, "M{x:.1} {BOTTOM}v4").unwrap_or(());
            write!(
                out,
                r#"<text class="tick" x="{x:.1}" y="{}" text-anchor="middle">{label}</text>"#,
                BOTTOM + 16.0
            )
            .unwrap_or(());
        }
        format!(
            r#"<path class="grid" d="{grid}"/>{}<path class="frame" d="M{LEFT} {TOP}V{BOTTOM}H{RIGHT}{ticks}"/>{out}<text class="title" x="{LEFT}" y="18">{}</text><text class="axis" x="{}" y="{}" text-anchor="middle">{}</text>{}"#,
            self.body,
            escape(&self.titles.1),
            tenth(0.5 * (LEFT + RIGHT)),
            BOTTOM + 34.0,
            escape(&self.titles.0),
            self.head
        )
    }

    /// The plot as an `svg` element with a description for those who cannot see it.
    pub fn svg(&self, description: &str) -> String {
        format!(
            r#"<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{}">{}</svg>"#,
            escape(description),
            self.inner()
        )
    }
}
