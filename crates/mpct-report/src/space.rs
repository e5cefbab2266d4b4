//! A path in space, seen at an angle within the box of its limits.

use super::plane::{Legend, Mark, Stroke, label, ticks};
use super::svg::escape;
use std::fmt::Write;

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 525.0;
/// Half a side of the box, in units of the picture.
const HALF: f64 = 150.0;
/// Where the eye stands: 60° to the left of the first axis, 25° above the floor.
const AZIMUTH: f64 = -60.0;
const ELEVATION: f64 = 25.0;
const WALL: &str = "fill=\"none\" stroke=\"#ccc\"";
const SHADOW: &str = "fill=\"none\" stroke=\"#999\" stroke-width=\"1\"";

type Point = [f64; 3];

/// A picture being drawn. Places are in the units of the data.
pub struct Space {
    limits: [(f64, f64); 3],
    body: String,
    legend: Legend,
}

impl Space {
    /// The box of the limits, with ticks and the names of its axes.
    pub fn new(titles: [&str; 3], limits: [(f64, f64); 3]) -> Self {
        let mut space = Self {
            limits,
            body: String::new(),
            legend: Legend::default(),
        };
        space.walls();
        space.axes(titles);
        space
    }

    fn place(&self, p: Point) -> (f64, f64) {
        let [x, y, z] = [0, 1, 2].map(|i| {
            let (low, high) = self.limits[i];
            2.0 * (p[i] - low) / (high - low) - 1.0
        });
        let (a, e) = (AZIMUTH.to_radians(), ELEVATION.to_radians());
        let right = -a.sin() * x + a.cos() * y;
        let depth = a.cos() * x + a.sin() * y;
        // `depth` points to the eye: what is nearer stands lower.
        let up = e.cos() * z - e.sin() * depth;
        (0.5 * WIDTH + HALF * right, 250.0 - HALF * up)
    }

    fn d(&self, points: &[Point], close: bool) -> String {
        let mut d = String::new();
        for (k, &p) in points.iter().enumerate() {
            let (x, y) = self.place(p);
            let _ = write!(d, "{}{x:.1} {y:.1}", if k == 0 { "M" } else { "L" });
        }
        if close {
            d.push('Z');
        }
        d
    }

    /// The floor and the two walls behind, with the lines of the ticks.
    fn walls(&mut self) {
        let [(x0, x1), (y0, y1), (z0, z1)] = self.limits;
        let mut d = String::new();
        for v in ticks((x0, x1), 6.0) {
            d += &self.d(&[[v, y0, z0], [v, y1, z0], [v, y1, z1]], false);
        }
        for v in ticks((y0, y1), 6.0) {
            d += &self.d(&[[x1, v, z0], [x0, v, z0], [x0, v, z1]], false);
        }
        for v in ticks((z0, z1), 6.0) {
            d += &self.d(&[[x0, y0, v], [x0, y1, v], [x1, y1, v]], false);
        }
        let _ = write!(self.body, "<path d=\"{d}\" {WALL}/>");
        let edges = [
            self.d(&[[x0, y0, z0], [x1, y0, z0], [x1, y1, z0]], false),
            self.d(&[[x0, y0, z0], [x0, y0, z1]], false),
        ];
        let _ = write!(
            self.body,
            "<path d=\"{}\" fill=\"none\" stroke=\"#666\"/>",
            edges.concat()
        );
    }

    fn axes(&mut self, titles: [&str; 3]) {
        let [(x0, x1), (y0, y1), (z0, z1)] = self.limits;
        let mut out = String::new();
        let mut text = |(x, y): (f64, f64), (dx, dy): (f64, f64), anchor: &str, words: &str| {
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
                x + dx,
                y + dy,
                escape(words)
            );
        };
        for v in ticks((x0, x1), 6.0) {
            text(self.place([v, y0, z0]), (-4.0, 16.0), "end", &label(v));
        }
        for v in ticks((y0, y1), 6.0) {
            text(self.place([x1, v, z0]), (6.0, 15.0), "start", &label(v));
        }
        for v in ticks((z0, z1), 6.0) {
            text(self.place([x0, y0, v]), (-7.0, 4.0), "end", &label(v));
        }
        let middle = |a: f64, b: f64| 0.5 * (a + b);
        text(
            self.place([middle(x0, x1), y0, z0]),
            (-38.0, 38.0),
            "end",
            titles[0],
        );
        text(
            self.place([x1, middle(y0, y1), z0]),
            (40.0, 34.0),
            "start",
            titles[1],
        );
        text(self.place([x0, y0, z1]), (-4.0, -14.0), "middle", titles[2]);
        self.body.push_str(&out);
    }

    /// A path, and its shadow on the floor.
    pub fn path(&mut self, name: &str, points: &[Point]) {
        let floor: Vec<Point> = points
            .iter()
            .map(|p| [p[0], p[1], self.limits[2].0])
            .collect();
        let (shadow, d) = (self.d(&floor, false), self.d(points, false));
        let _ = write!(
            self.body,
            "<path d=\"{shadow}\" {SHADOW}/><path d=\"{d}\" fill=\"none\" {}/>",
            Stroke::Broad.attributes()
        );
        self.legend.line(Stroke::Broad, name);
        self.legend.add(
            format!("<path d=\"M0 0h34\" {SHADOW}/>"),
            "its shadow on the floor",
        );
    }

    /// Marks, each with a line down to the floor, and numbered in their order when asked.
    pub fn marks(&mut self, name: &str, points: &[Point], mark: Mark, numbered: bool) {
        for (k, &p) in points.iter().enumerate() {
            let drop = self.d(&[p, [p[0], p[1], self.limits[2].0]], false);
            let (x, y) = self.place(p);
            let _ = write!(
                self.body,
                "<path d=\"{drop}\" fill=\"none\" stroke=\"#999\" stroke-dasharray=\"2 3\"/>{}",
                mark.svg(x, y)
            );
            if numbered {
                let _ = write!(
                    self.body,
                    "<text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                    x + 9.0,
                    y - 7.0,
                    k + 1
                );
            }
        }
        self.legend.mark(mark, name);
    }

    /// The picture.
    pub fn svg(&self, description: &str) -> String {
        self.legend.below(&self.body, HEIGHT, description)
    }
}
