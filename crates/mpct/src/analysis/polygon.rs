//! Outlines of convex sets in two coordinates, by support queries.
//!
//! Four queries give the extreme points along the axes. Every edge between neighbouring points is then asked for the
//! support in its normal's direction: either nothing lies beyond it, and the edge is proved, or the answer is a new
//! point and the edge is replaced by two. No grid is involved; for a polytope the method ends after about two queries
//! a vertex, with every vertex a point of the set and every edge a proof that the set ends there.

use crate::error::DesignError;
use serde::Serialize;

/// Support queries before an outline is given up. A polytope needs about two a vertex, a smooth set about
/// 6/√tolerance.
const MAX_QUERIES: usize = 4000;
/// Neighbouring points nearer than this share of the tolerance are one point.
const SAME_POINT: f64 = 0.1;

/// The outline of a convex set in two coordinates.
///
/// ```
/// use mpct::{Constraints, Controller, DesignOptions, Matrix, Plant, Problem, TerminalIngredients, Weights};
/// use mpct::analysis::DomainOfAttraction;
/// # let plant = Plant::discrete(
/// #     Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
/// #     Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
/// # )?;
/// # let constraints = Constraints::new(2, 2)
/// #     .state_bounds(&[-3.0; 2], &[3.0; 2])?
/// #     .input_bounds(&[-2.0; 2], &[2.0; 2])?;
/// # let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))?;
/// let controller = Controller::new(TerminalIngredients::design(&problem, &DesignOptions::default())?)?;
/// let outline = DomainOfAttraction::of(&controller).projection((0, 1))?;
/// assert!(outline.contains([0.0, 0.0]) && !outline.contains([3.1, 0.0]));
/// assert!(outline.area() < 36.0);
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Polygon {
    /// The two coordinates, 0-based.
    pub coordinates: (usize, usize),
    /// Vertices, counter-clockwise. Each is a point of the set.
    pub vertices: Vec<[f64; 2]>,
    /// How far the set may reach beyond an edge, at most, as a share of the half-widths of the set in the two
    /// coordinates.
    pub gap: f64,
    /// Support queries made.
    pub queries: usize,
}

impl Polygon {
    /// The area inside the vertices, in the product of the coordinates' units.
    pub fn area(&self) -> f64 {
        let v = &self.vertices;
        let twice: f64 = (0..v.len())
            .map(|k| {
                let (p, q) = (v[k], v[(k + 1) % v.len()]);
                p[0] * q[1] - p[1] * q[0]
            })
            .sum();
        0.5 * twice
    }

    /// Whether a point lies inside or on the polygon.
    pub fn contains(&self, point: [f64; 2]) -> bool {
        let v = &self.vertices;
        v.len() >= 3
            && (0..v.len()).all(|k| {
                let (p, q) = (v[k], v[(k + 1) % v.len()]);
                (q[0] - p[0]) * (point[1] - p[1]) - (q[1] - p[1]) * (point[0] - p[0]) >= 0.0
            })
    }
}

/// What a support query answers: a point of the set, and an upper bound of the support.
pub(super) struct Touch {
    pub(super) point: [f64; 2],
    pub(super) upper: f64,
}

/// An edge that is proved: the set goes beyond it by at most `gap`.
struct Edge {
    from: [f64; 2],
    gap: f64,
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn length(a: [f64; 2]) -> f64 {
    a[0].hypot(a[1])
}

/// Runs the refinement until no edge leaves more than `tolerance` (a share of the half-widths).
pub(super) fn outline(
    coordinates: (usize, usize),
    tolerance: f64,
    mut support: impl FnMut([f64; 2]) -> Result<Touch, DesignError>,
) -> Result<Polygon, DesignError> {
    if !(tolerance > 0.0 && tolerance < 1.0) {
        return Err(DesignError::OutOfRange {
            what: "tolerance of an outline".into(),
            expected: "a number strictly between 0 and 1".into(),
            found: tolerance.to_string(),
        });
    }
    let mut queries = 4;
    // Right, top, left, bottom: counter-clockwise.
    let extreme = [
        support([1.0, 0.0])?,
        support([0.0, 1.0])?,
        support([-1.0, 0.0])?,
        support([0.0, -1.0])?,
    ];
    let half = |positive: &Touch, negative: &Touch| {
        let h = 0.5 * (positive.upper + negative.upper);
        if h > 0.0 { h } else { 1.0 }
    };
    let unit = [
        half(&extreme[0], &extreme[2]),
        half(&extreme[1], &extreme[3]),
    ];
    let scaled = |p: [f64; 2]| [p[0] / unit[0], p[1] / unit[1]];
    let start: Vec<[f64; 2]> = extreme.iter().map(|t| scaled(t.point)).collect();
    // A stack of edges still to be proved, the first one on top.
    let mut open: Vec<([f64; 2], [f64; 2])> = (0..4)
        .rev()
        .map(|k| (start[k], start[(k + 1) % 4]))
        .collect();
    let mut proved: Vec<Edge> = Vec::new();
    while let Some((p, q)) = open.pop() {
        let along = minus(q, p);
        let size = length(along);
        if size <= SAME_POINT * tolerance {
            continue;
        }
        let normal = [along[1] / size, -along[0] / size];
        if queries >= MAX_QUERIES {
            return Err(DesignError::Solver {
                what: "the outline of a set in two coordinates".into(),
                detail: format!(
                    "{} edges were not proved to {tolerance:e} of the half-widths after {queries} support queries; ask for a larger tolerance",
                    open.len() + 1
                ),
            });
        }
        queries += 1;
        let touch = support([normal[0] / unit[0], normal[1] / unit[1]])?;
        let beyond = touch.upper - dot(normal, p).max(dot(normal, q));
        let point = scaled(touch.point);
        let gained = dot(normal, point) - dot(normal, p).max(dot(normal, q));
        if beyond <= tolerance || gained <= 0.5 * tolerance {
            // Either proved, or as far as the accuracy of the answers goes; the gap says which.
            proved.push(Edge {
                from: p,
                gap: beyond.max(0.0),
            });
        } else {
            open.push((point, q));
            open.push((p, point));
        }
    }
    let gap = proved.iter().fold(0.0_f64, |a, e| a.max(e.gap));
    let vertices: Vec<[f64; 2]> = proved.iter().map(|e| e.from).collect();
    let (vertices, dropped) = without_collinear(vertices, tolerance);
    Ok(Polygon {
        coordinates,
        vertices: vertices
            .into_iter()
            .map(|p| [p[0] * unit[0], p[1] * unit[1]])
            .collect(),
        gap: gap + dropped,
        queries,
    })
}

/// Drops vertices that lie within `tolerance` of the line between their neighbours: support queries in the direction of
/// an edge touch it anywhere. Returns the largest distance of a dropped one.
fn without_collinear(mut v: Vec<[f64; 2]>, tolerance: f64) -> (Vec<[f64; 2]>, f64) {
    let mut dropped = 0.0_f64;
    let mut k = 0;
    let mut kept_in_a_row = 0;
    while v.len() > 3 && kept_in_a_row < v.len() {
        let n = v.len();
        let (a, b, c) = (v[(k + n - 1) % n], v[k % n], v[(k + 1) % n]);
        let along = minus(c, a);
        let size = length(along);
        let to = minus(b, a);
        let distance = if size > 0.0 {
            (along[0] * to[1] - along[1] * to[0]).abs() / size
        } else {
            0.0
        };
        if distance <= tolerance {
            dropped = dropped.max(distance);
            v.remove(k % n);
            k = k.saturating_sub(1);
            kept_in_a_row = 0;
        } else {
            k = (k + 1) % n;
            kept_in_a_row += 1;
        }
    }
    (v, dropped)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hull_support(points: &[[f64; 2]], d: [f64; 2]) -> Touch {
        let point = points
            .iter()
            .copied()
            .max_by(|a, b| dot(*a, d).total_cmp(&dot(*b, d)))
            .expect("points");
        Touch {
            point,
            upper: dot(point, d),
        }
    }

    #[test]
    fn a_polygon_is_found_exactly() {
        let points = [
            [2.0, 0.0],
            [1.0, 30.0],
            [-2.0, 10.0],
            [-1.0, -20.0],
            [1.5, -15.0],
        ];
        let p = outline((0, 1), 1e-9, |d| Ok(hull_support(&points, d))).expect("outline");
        assert_eq!(p.vertices.len(), 5);
        assert!(p.gap <= 1e-9);
        for v in points {
            let near = |w: &&[f64; 2]| (w[0] - v[0]).abs() + (w[1] - v[1]).abs() < 1e-12;
            assert!(p.vertices.iter().any(|w| near(&w)), "{v:?}");
        }
        assert!(p.area() > 0.0 && p.contains([0.0, 0.0]) && !p.contains([2.1, 0.0]));
    }

    #[test]
    fn a_disc_is_enclosed_within_the_tolerance() {
        let p = outline((0, 1), 1e-4, |d| {
            let l = length(d);
            Ok(Touch {
                point: [d[0] / l, d[1] / l],
                upper: l,
            })
        })
        .expect("outline");
        assert!(p.gap <= 1e-4 && p.area() < std::f64::consts::PI);
        assert!(std::f64::consts::PI - p.area() < 1e-3, "{}", p.area());
    }
}
