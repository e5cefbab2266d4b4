//! The shape of the stability region Υ: reach, outlines and volume by second-order cone programs.
//!
//! V*(x) − V° ≤ level is, with the program's variables z, a ball ‖F (s, z) + f‖ ≤ ρ in the coordinates s of a line, a plane
//! or all states, beside the rows of (35).

use super::StabilityRegion;
use super::domain::{Reach, size_of_direction};
use super::polygon::{Polygon, Touch, outline};
use super::program::{StateProgram, failure};
use super::volume::{Support, Volume, volume};
use crate::control::weighted_square;
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::optimization::{Ball, Body, add_product, dot, norm};
use crate::problem::Task;

/// Tolerance of an outline of a region with curved boundary, as a share of the half-widths.
pub const CURVED_OUTLINE: f64 = 1e-4;
/// Tolerance of a hull in three states: queries grow with the reciprocal.
pub const CURVED_HULL: f64 = 5e-3;
/// Curvatures below this share of the largest are rounding.
const FLAT: f64 = 1e-13;
/// Shares of the deepest point in the interior point that a reach starts from: the one that leaves most room is taken.
const TOWARDS_DEEPEST: [f64; 7] = [0.5, 0.2, 0.05, 1e-2, 1e-3, 1e-4, 1e-6];

impl StabilityRegion<'_> {
    /// How far the region reaches from its set-point (the closest admissible equilibrium) in a direction (length n, not
    /// zero).
    ///
    /// # Errors
    /// As [`StabilityRegion::reach_from`].
    pub fn reach(&self, direction: &[f64]) -> Result<Reach, DesignError> {
        let at = StateProgram::of(self.controller).shifted("set-point", &self.closest.state)?;
        self.along(&at, direction, |body| self.interior(body))
    }

    /// How far the region reaches from a state of it in a direction.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`]; [`DesignError::OutOfRange`] for the zero direction and for a
    /// state outside or on the boundary; [`DesignError::Unbounded`], [`DesignError::Solver`].
    pub fn reach_from(&self, state: &[f64], direction: &[f64]) -> Result<Reach, DesignError> {
        let at = StateProgram::of(self.controller).shifted("state", state)?;
        let refused = |found: String| DesignError::OutOfRange {
            what: "the state from which the reach is asked".into(),
            expected: "a state inside the stability region".into(),
            found,
        };
        let attraction = self.contains(state)?;
        if !attraction.is_inside() {
            return Err(refused(format!(
                "{state:?}, where V* - V_O is {:.6e} and the level {:.6e}",
                attraction.cost, attraction.level
            )));
        }
        let optimum = self.optimum(state)?;
        self.along(&at, direction, |body| {
            // Between the optimum, which is deep in the level set, and the point that is deepest in the rows.
            let rows_alone = Body {
                balls: Vec::new(),
                ..body.clone()
            };
            let deepest = rows_alone
                .deepest()
                .map_err(|e| failure("the reach of the stability region", "a variable", e))?;
            let mut best = (f64::INFINITY, Vec::new());
            for share in TOWARDS_DEEPEST {
                let mut v = vec![0.0; body.variables()];
                for (i, z) in optimum.iter().enumerate() {
                    v[1 + i] = (1.0 - share) * z + share * deepest.point[1 + i];
                }
                v[0] = share * deepest.point[0];
                let violation = body.violation(&v);
                if violation < best.0 {
                    best = (violation, v);
                }
            }
            if best.0 < 0.0 {
                Ok(best.1)
            } else {
                Err(refused(format!(
                    "{state:?}, on the boundary: no point near it is inside by more than {:.3e}",
                    -best.0
                )))
            }
        })
    }

    /// The largest t with at + t direction in the region.
    fn along(
        &self,
        at: &[f64],
        direction: &[f64],
        inside: impl FnOnce(&Body) -> Result<Vec<f64>, DesignError>,
    ) -> Result<Reach, DesignError> {
        let largest = size_of_direction(direction, at.len())?;
        let unit = Dense::from_fn(at.len(), 1, |i, _| direction[i] / largest);
        let body = self.body(at, &unit)?;
        let inside = inside(&body)?;
        let mut c = vec![0.0; body.variables()];
        c[0] = 1.0;
        let value = body.support(&c, &inside).map_err(|e| {
            let named = format!("the direction {direction:?}");
            failure("the reach of the stability region", named, e)
        })?;
        let t = value.lower / largest;
        let reached: Vec<f64> = at.iter().zip(direction).map(|(x, v)| x + t * v).collect();
        Ok(Reach {
            distance: t,
            at_most: value.upper / largest,
            state: StateProgram::of(self.controller).physical(&reached),
        })
    }

    /// z of the optimum at a state.
    fn optimum(&self, state: &[f64]) -> Result<Vec<f64>, DesignError> {
        self.controller
            .optimum(&self.qp, state, &self.set_point)
            .map_err(|error| DesignError::Solver {
                what: "the optimum at a state of the stability region".into(),
                detail: error.to_string(),
            })
    }

    /// The volume of the region, for plants of up to three states. Its boundary is curved: the hull of points of it is
    /// accurate to [`CURVED_OUTLINE`] in the plane and to [`CURVED_HULL`] in space.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] for more states; [`DesignError::Solver`].
    pub fn volume(&self) -> Result<Volume, DesignError> {
        let n = self.closest.state.len();
        let at = StateProgram::of(self.controller).shifted("set-point", &self.closest.state)?;
        let body = self.body(&at, &Dense::identity(n, n))?;
        let inside = self.interior(&body)?;
        let tolerance = if n > 2 { CURVED_HULL } else { CURVED_OUTLINE };
        volume("the stability region", n, tolerance, |d| {
            let mut c = vec![0.0; body.variables()];
            c[..n].copy_from_slice(d);
            let value = body
                .support(&c, &inside)
                .map_err(|e| failure("the volume of the stability region", "a state", e))?;
            Ok(Support {
                point: value.point[..n].to_vec(),
                upper: value.upper,
            })
        })
    }

    /// The body of (s, z) with x = at + E s, the level of the cost included.
    fn body(&self, at: &[f64], directions: &Dense) -> Result<Body, DesignError> {
        let mut body = StateProgram::of(self.controller).body(at, directions);
        body.balls.push(self.cost_ball(at, directions)?);
        Ok(body)
    }

    /// The projection of the region on two coordinates.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] for equal coordinates or ones out of range; [`DesignError::Solver`].
    pub fn projection(&self, coordinates: (usize, usize)) -> Result<Polygon, DesignError> {
        let n = self.closest.state.len();
        self.outline(coordinates, &Dense::identity(n, n), coordinates)
    }

    /// The section of the region through the closest admissible equilibrium: two coordinates vary, the others stay.
    ///
    /// # Errors
    /// As [`StabilityRegion::projection`].
    pub fn section(&self, coordinates: (usize, usize)) -> Result<Polygon, DesignError> {
        let program = StateProgram::of(self.controller);
        program.check_coordinates(coordinates)?;
        self.outline(coordinates, &program.plane(coordinates), (0, 1))
    }

    fn outline(
        &self,
        coordinates: (usize, usize),
        directions: &Dense,
        (i, j): (usize, usize),
    ) -> Result<Polygon, DesignError> {
        let program = StateProgram::of(self.controller);
        program.check_coordinates(coordinates)?;
        let at = program.shifted("set-point", &self.closest.state)?;
        let body = self.body(&at, directions)?;
        let inside = self.interior(&body)?;
        let mut polygon = outline(coordinates, CURVED_OUTLINE, |direction| {
            let mut c = vec![0.0; body.variables()];
            (c[i], c[j]) = (direction[0], direction[1]);
            let value = body.support(&c, &inside).map_err(|e| {
                let named = format!("x[{}], x[{}]", coordinates.0, coordinates.1);
                failure("an outline of the stability region", named, e)
            })?;
            Ok(Touch {
                point: [value.point[i], value.point[j]],
                upper: value.upper,
            })
        })?;
        let centre = [
            self.closest.state[coordinates.0],
            self.closest.state[coordinates.1],
        ];
        for v in &mut polygon.vertices {
            *v = [v[0] + centre[0], v[1] + centre[1]];
        }
        Ok(polygon)
    }

    /// The set-point's equilibrium, a little towards the operating point where λΘ is active there.
    fn interior(&self, body: &Body) -> Result<Vec<f64>, DesignError> {
        let mut best: Option<(f64, Vec<f64>)> = None;
        for share in [0.0, 1e-4, 1e-3, 1e-2, 0.1] {
            let mut v = vec![0.0; body.variables()];
            let theta = body.variables() - self.parameters();
            for (k, t) in self.parameter().iter().enumerate() {
                v[theta + k] = (1.0 - share) * t;
            }
            let violation = body.violation(&v);
            if best.as_ref().is_none_or(|b| violation < b.0) {
                best = Some((violation, v));
            }
        }
        match best {
            Some((violation, v)) if violation < 0.0 => Ok(v),
            other => Err(DesignError::Solver {
                what: "an outline of the stability region".into(),
                detail: format!(
                    "no interior point near the set-point (violation {:.3e}); the level {:.3e} is too small beside the offset cost",
                    other.map_or(f64::NAN, |b| b.0),
                    self.level
                ),
            }),
        }
    }

    fn parameters(&self) -> usize {
        self.parameter().len()
    }

    fn parameter(&self) -> &[f64] {
        match self.controller.ingredients().problem().task() {
            Task::Tracking => &self.closest.parameter,
            Task::Regulation => &[],
        }
    }

    /// V(at + E s, z) − V° ≤ level as ‖F v + f‖ ≤ ρ in v = (s, z).
    fn cost_ball(&self, at: &[f64], directions: &Dense) -> Result<Ball, DesignError> {
        let problem = self.controller.ingredients().problem();
        let (h, fx, fr, hx) = self.controller.program_cost();
        let (k, nz) = (directions.ncols(), h.nrows());
        let along = fx * directions;
        let corner = directions.transpose() * hx * directions;
        let hessian = Dense::from_fn(k + nz, k + nz, |i, j| match (i < k, j < k) {
            (true, true) => corner[(i, j)],
            (true, false) => along[(j - k, i)],
            (false, true) => along[(i - k, j)],
            (false, false) => h[(i - k, j - k)],
        });
        // The set-point, shifted: state, then input.
        let home = problem.plant().operating_point();
        let minus =
            |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
        let xr = minus(&self.set_point.state, &home.state);
        let ur = match &self.set_point.input {
            Some(u) => minus(u, &home.input),
            None => vec![0.0; problem.plant().inputs()],
        };
        let r: Vec<f64> = xr.iter().chain(&ur).copied().collect();
        let mut linear = vec![0.0; k + nz];
        let mut hx_at = vec![0.0; at.len()];
        add_product(&mut hx_at, hx, at, 1.0);
        add_product(
            &mut linear[..k],
            &directions.transpose().to_owned(),
            &hx_at,
            1.0,
        );
        add_product(&mut linear[k..], fx, at, 1.0);
        let mut constant = 0.5 * dot(at, &hx_at);
        if problem.task() == Task::Tracking {
            add_product(&mut linear[k..], fr, &r, 1.0);
            constant += weighted_square(problem.offset_weight(), &xr)
                + weighted_square(problem.offset_input_weight(), &ur);
        }
        let (values, vectors) =
            linalg::symmetric_eigen("the cost", &linalg::symmetrised(&hessian))?;
        let largest = values.last().copied().unwrap_or(0.0);
        let kept: Vec<usize> = (0..values.len())
            .filter(|&q| values[q] > FLAT * largest)
            .collect();
        // ½ vᵀHv + gᵀv = ‖F v + f‖² − ‖f‖² with rows √(λ/2) uᵀ and f = uᵀg / √(2λ).
        let map = Dense::from_fn(kept.len(), k + nz, |q, j| {
            (0.5 * values[kept[q]]).sqrt() * vectors[(j, kept[q])]
        });
        let offset: Vec<f64> = kept
            .iter()
            .map(|&q| {
                let along: f64 = (0..k + nz).map(|j| vectors[(j, q)] * linear[j]).sum();
                along / (2.0 * values[q]).sqrt()
            })
            .collect();
        let square = self.level + self.closest.offset_cost - constant + norm(&offset).powi(2);
        Ok(Ball {
            map,
            offset,
            radius: square.max(0.0).sqrt(),
        })
    }
}
