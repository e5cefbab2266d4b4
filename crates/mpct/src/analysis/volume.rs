//! Volumes of convex sets of up to three states, by support queries.
//!
//! One state: an interval. Two: the polygon of [`outline`]. Three: the same refinement on the triangles of a hull. Each
//! triangle is asked for the support along its outward normal: either nothing lies beyond it, and it is proved, or the
//! answer is a new vertex, and the triangles that see it are replaced by those that join it to their rim. The hull's
//! volume is a sum of determinants. In more dimensions the number of facets explodes, and nothing is offered.

use super::polygon::{Touch, outline};
use crate::error::DesignError;
use serde::Serialize;

/// Support queries before a hull is given up; a polytope needs about three a vertex.
const MAX_QUERIES: usize = 6000;
/// A triangle sees a point that is beyond it by more than this share of the tolerance: rounding of the answers must not
/// fold the hull.
const SEES: f64 = 0.01;
/// A first tetrahedron flatter than this, in units of the half-widths, has no inside.
const FLAT: f64 = 1e-9;
/// Dimensions for which volumes are offered.
pub const LARGEST_DIMENSION: usize = 3;

/// The volume of a convex set of states.
///
/// ```
/// use mpct::{Controller, DesignOptions, TerminalIngredients, analysis::DomainOfAttraction};
/// let problem = mpct::cases::academic().problem;
/// let controller = Controller::new(TerminalIngredients::design(&problem, &DesignOptions::default())?)?;
/// let domain = DomainOfAttraction::of(&controller);
/// let volume = domain.volume()?;
/// assert!((volume.value - domain.projection((0, 1))?.area()).abs() < 1e-9);
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Volume {
    /// Length, area or volume of the hull of points of the set, in the product of the states' units.
    pub value: f64,
    /// Number of states, 1 to 3.
    pub dimension: usize,
    /// How far the set may reach beyond a side of that hull, at most, as a share of the half-widths.
    pub gap: f64,
    /// Points that span the hull: its vertices, and in space some points of its edges and faces.
    pub vertices: usize,
    /// Support queries made.
    pub queries: usize,
}

/// What a support query in n dimensions answers: a point of the set, and an upper bound of the support.
pub(super) struct Support {
    pub(super) point: Vec<f64>,
    pub(super) upper: f64,
}

/// The volume by support queries in `dimension` coordinates.
pub(super) fn volume(
    what: &str,
    dimension: usize,
    tolerance: f64,
    mut support: impl FnMut(&[f64]) -> Result<Support, DesignError>,
) -> Result<Volume, DesignError> {
    match dimension {
        1 => {
            let (high, low) = (support(&[1.0])?, support(&[-1.0])?);
            let value = high.point[0] - low.point[0];
            Ok(Volume {
                value,
                dimension,
                gap: (high.upper + low.upper - value).max(0.0)
                    / (0.5 * value).max(f64::MIN_POSITIVE),
                vertices: 2,
                queries: 2,
            })
        }
        2 => {
            let polygon = outline((0, 1), tolerance, |d| {
                let s = support(&d)?;
                Ok(Touch {
                    point: [s.point[0], s.point[1]],
                    upper: s.upper,
                })
            })?;
            Ok(Volume {
                value: polygon.area(),
                dimension,
                gap: polygon.gap,
                vertices: polygon.vertices.len(),
                queries: polygon.queries,
            })
        }
        3 => hull(what, tolerance, support),
        _ => Err(DesignError::OutOfRange {
            what: format!("the number of states for the volume of {what}"),
            expected: format!(
                "1 to {LARGEST_DIMENSION}; with more states ask for the areas of projections and sections on two of them"
            ),
            found: dimension.to_string(),
        }),
    }
}

type Point = [f64; 3];

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A triangle, counter-clockwise seen from outside; `gap` once it is proved.
#[derive(Clone, Copy)]
struct Triangle {
    corners: [usize; 3],
    normal: Point,
    offset: f64,
    gap: Option<f64>,
}

/// The hull being refined, in units of the half-widths.
struct Hull {
    points: Vec<Point>,
    triangles: Vec<Triangle>,
    inside: Point,
}

impl Hull {
    /// A triangle through three points, turned so that the inside is behind it. A degenerate one, which has no normal
    /// and no volume, counts as proved.
    fn triangle(&self, mut corners: [usize; 3]) -> Triangle {
        let [a, b, c] = corners.map(|k| self.points[k]);
        let mut normal = cross(minus(b, a), minus(c, a));
        if dot(normal, minus(self.inside, a)) > 0.0 {
            corners.swap(1, 2);
            normal = normal.map(|v| -v);
        }
        let size = dot(normal, normal).sqrt();
        let unit = if size > 0.0 {
            normal.map(|v| v / size)
        } else {
            [0.0; 3]
        };
        Triangle {
            corners,
            normal: unit,
            offset: dot(unit, a),
            gap: (!(size > 0.0)).then_some(0.0),
        }
    }

    /// Adds a point: the triangles that see it go, their rim is joined to it.
    fn add(&mut self, point: Point, slack: f64) {
        let at = self.points.len();
        self.points.push(point);
        let (seeing, kept): (Vec<Triangle>, Vec<Triangle>) = self
            .triangles
            .drain(..)
            .partition(|t| dot(t.normal, point) - t.offset > slack);
        let edges: Vec<(usize, usize)> = seeing
            .iter()
            .flat_map(|t| {
                let [a, b, c] = t.corners;
                [(a, b), (b, c), (c, a)]
            })
            .collect();
        self.triangles = kept;
        for &(a, b) in &edges {
            if !edges.contains(&(b, a)) {
                let new = self.triangle([a, b, at]);
                self.triangles.push(new);
            }
        }
    }

    fn volume(&self) -> f64 {
        self.triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.corners.map(|k| minus(self.points[k], self.inside));
                dot(a, cross(b, c)) / 6.0
            })
            .sum()
    }
}

fn hull(
    what: &str,
    tolerance: f64,
    mut support: impl FnMut(&[f64]) -> Result<Support, DesignError>,
) -> Result<Volume, DesignError> {
    let mut queries = 6;
    let mut extreme = Vec::with_capacity(6);
    let mut unit = [1.0; 3];
    for i in 0..3 {
        let mut width = 0.0;
        for sign in [1.0, -1.0] {
            let mut d = [0.0; 3];
            d[i] = sign;
            let s = support(&d)?;
            width += s.upper;
            extreme.push([s.point[0], s.point[1], s.point[2]]);
        }
        if width > 0.0 {
            unit[i] = 0.5 * width;
        }
    }
    let scaled = |p: Point| [p[0] / unit[0], p[1] / unit[1], p[2] / unit[2]];
    let extreme: Vec<Point> = extreme.into_iter().map(scaled).collect();
    // The first tetrahedron: the flattest choice is the worst one.
    let mut best = (0.0, [0; 4]);
    for a in 0..6 {
        for b in a + 1..6 {
            for c in b + 1..6 {
                for d in c + 1..6 {
                    let [p, q, r, s] = [a, b, c, d].map(|k| extreme[k]);
                    let six = dot(minus(q, p), cross(minus(r, p), minus(s, p))).abs();
                    if six > best.0 {
                        best = (six, [a, b, c, d]);
                    }
                }
            }
        }
    }
    if !(best.0 > FLAT) {
        return Err(DesignError::OutOfRange {
            what: format!("the volume of {what}"),
            expected: "a set with an interior".into(),
            found: format!("one whose extreme points span {:.3e}", best.0),
        });
    }
    let first = best.1.map(|k| extreme[k]);
    let mut inside = [0.0; 3];
    for p in first {
        for i in 0..3 {
            inside[i] += 0.25 * p[i];
        }
    }
    let mut body = Hull {
        points: first.to_vec(),
        triangles: Vec::new(),
        inside,
    };
    for corners in [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]] {
        let t = body.triangle(corners);
        body.triangles.push(t);
    }
    let slack = SEES * tolerance;
    for (k, &p) in extreme.iter().enumerate() {
        if !best.1.contains(&k)
            && body
                .triangles
                .iter()
                .any(|t| dot(t.normal, p) - t.offset > slack)
        {
            body.add(p, slack);
        }
    }
    while let Some(k) = body.triangles.iter().position(|t| t.gap.is_none()) {
        if queries >= MAX_QUERIES {
            return Err(DesignError::Solver {
                what: format!("the volume of {what}"),
                detail: format!(
                    "sides were left unproved at {tolerance:e} of the half-widths after {queries} support queries"
                ),
            });
        }
        queries += 1;
        let t = body.triangles[k];
        let d = [0, 1, 2].map(|i| t.normal[i] / unit[i]);
        let touch = support(&d)?;
        let point = scaled([touch.point[0], touch.point[1], touch.point[2]]);
        let beyond = touch.upper - t.offset;
        let gained = dot(t.normal, point) - t.offset;
        if beyond <= tolerance || gained <= 0.5 * tolerance {
            // Either proved, or as far as the accuracy of the answers goes; the gap says which.
            body.triangles[k].gap = Some(beyond.max(0.0));
        } else {
            body.add(point, slack);
        }
    }
    let mut corners: Vec<usize> = body.triangles.iter().flat_map(|t| t.corners).collect();
    corners.sort_unstable();
    corners.dedup();
    Ok(Volume {
        value: body.volume() * unit[0] * unit[1] * unit[2],
        dimension: 3,
        gap: body
            .triangles
            .iter()
            .filter_map(|t| t.gap)
            .fold(0.0, f64::max),
        vertices: corners.len(),
        queries,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_points(points: &[Point]) -> Volume {
        hull("points", 1e-9, |d| {
            let d = [d[0], d[1], d[2]];
            let p = points
                .iter()
                .max_by(|a, b| dot(**a, d).total_cmp(&dot(**b, d)))
                .expect("points");
            Ok(Support {
                point: p.to_vec(),
                upper: dot(*p, d),
            })
        })
        .expect("volume")
    }

    /// Volumes from geometry: a box, an octahedron, a pyramid on a pentagon, each stretched and moved.
    #[test]
    fn polytopes_are_exact() {
        let mut cube = Vec::new();
        for k in 0..8 {
            let sign = |bit: usize| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
            cube.push([5.0 * sign(0) + 1.0, 0.1 * sign(1), 20.0 * sign(2) - 7.0]);
        }
        let v = of_points(&cube);
        assert!(
            (v.value - 10.0 * 0.2 * 40.0).abs() < 1e-9 * 80.0 && v.vertices == 8,
            "{v:?}"
        );
        let mut diamond = Vec::new();
        for i in 0..3 {
            for s in [2.0, -2.0] {
                let mut p = [0.3, 0.0, -0.1];
                p[i] += s;
                diamond.push(p);
            }
        }
        let v = of_points(&diamond);
        assert!(
            (v.value - 4.0 / 3.0 * 8.0).abs() < 1e-9 && v.vertices == 6,
            "{v:?}"
        );
        let mut pyramid: Vec<Point> = (0..5)
            .map(|k| {
                let a = f64::from(k) * std::f64::consts::TAU / 5.0;
                [a.cos(), a.sin(), 0.0]
            })
            .collect();
        pyramid.push([0.2, 0.1, 3.0]);
        let base = 2.5 * (std::f64::consts::TAU / 5.0).sin();
        let v = of_points(&pyramid);
        assert!((v.value - base * 3.0 / 3.0).abs() < 1e-8, "{v:?} {base}");
    }

    #[test]
    fn a_ball_is_enclosed_within_the_tolerance() {
        let v = hull("a ball", 5e-3, |d| {
            let size = dot([d[0], d[1], d[2]], [d[0], d[1], d[2]]).sqrt();
            Ok(Support {
                point: d.iter().map(|v| v / size).collect(),
                upper: size,
            })
        })
        .expect("volume");
        let exact = 4.0 / 3.0 * std::f64::consts::PI;
        assert!(
            v.value < exact && v.value > 0.97 * exact && v.gap <= 5e-3,
            "{v:?}"
        );
    }

    #[test]
    fn flat_sets_and_large_dimensions_are_refused() {
        let flat = hull("a disc", 1e-6, |d| {
            let size = d[0].hypot(d[1]).max(f64::MIN_POSITIVE);
            Ok(Support {
                point: vec![d[0] / size, d[1] / size, 0.0],
                upper: d[0].hypot(d[1]),
            })
        });
        assert!(flat.is_err());
        let e = volume("a set", 4, 1e-6, |_| unreachable!()).expect_err("four dimensions");
        assert!(
            e.to_string().contains("4") && e.to_string().contains("projections"),
            "{e}"
        );
    }
}
