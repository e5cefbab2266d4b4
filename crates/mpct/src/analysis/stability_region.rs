//! The stability region Υ of the controller without terminal constraint (section 3.5).
//!
//! Υ = {x : V*(x) − V° ≤ (N + M̄) d + γ α}, with V* the optimal cost of (35) and V° the offset cost of the closest
//! admissible equilibrium. The paper prints V_O*(x), the offset part of the optimum *at x*, in the place of V°. That set is
//! larger: V_O*(x) ≥ V°. But V* − V_O* need not fall along the closed loop, because the optimum may trade offset cost for
//! stage cost; V* − V° falls at every step as V* does, so that Υ as defined here is invariant. [`Attraction::as_printed`]
//! gives the other number. For a state in Υ the stage and terminal costs of the optimum add up to at most
//! (N + M̄) d + γ α, so the terminal state lies in Ψα: otherwise every stage would cost more than d and the end more than
//! γ α (had an earlier state been in Ψα, going on by the terminal law would be cheaper).
//!
//! V* is convex, so Υ is; membership is one quadratic program, an outline a sequence of second-order cone programs.

use super::alpha::{AlphaBounds, AlphaScope};
use super::domain::Reach;
use super::polygon::{Polygon, Touch, outline};
use super::program::{StateProgram, failure};
use super::volume::{Support, Volume, volume};
use crate::control::{Controller, no_terminal_constraint, weighted_square};
use crate::error::{DesignError, StepError};
use crate::linalg::{self, Dense};
use crate::optimization::{Ball, Body, PreparedQp, add_product, dot, norm};
use crate::problem::{Formulation, Task};
use crate::{AdmissibleSetPoint, SetPoint};
use serde::Serialize;

/// Tolerance of an outline of a region with curved boundary, as a share of the half-widths.
pub const CURVED_OUTLINE: f64 = 1e-4;
/// Tolerance of a hull in three states: queries grow with the reciprocal.
pub const CURVED_HULL: f64 = 5e-3;
/// Curvatures below this share of the largest are rounding.
const FLAT: f64 = 1e-13;

/// Whether a state is in the stability region, and by how much.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Attraction {
    /// V*(x) − V°; infinite where the program is infeasible.
    pub cost: f64,
    /// (N + M̄) d + γ α. The state is inside when the cost is at most this.
    pub level: f64,
    /// V*(x) − V_O*(x), the paper's left-hand side.
    pub as_printed: f64,
}

impl Attraction {
    /// Whether the state is inside.
    pub fn is_inside(&self) -> bool {
        self.cost <= self.level
    }
}

/// Υ of a controller without terminal constraint, for one set-point.
///
/// ```
/// use mpct::{Controller, DesignOptions, NoTerminalConstraint, SetPoint, TerminalIngredients};
/// use mpct::analysis::{AlphaScope, StabilityRegion};
/// let problem = mpct::cases::academic().problem
///     .with_no_terminal_constraint(NoTerminalConstraint::new(2, 20.0)?);
/// let controller = Controller::new(TerminalIngredients::design(&problem, &DesignOptions::default())?)?;
/// let set_point = SetPoint::state([0.0, 0.0]);
/// let region = StabilityRegion::of(&controller, &set_point, AlphaScope::EveryEquilibrium)?;
/// assert!(region.contains(&[0.1, 0.0])?.is_inside());
/// # Ok::<(), mpct::DesignError>(())
/// ```
pub struct StabilityRegion<'a> {
    controller: &'a Controller,
    qp: PreparedQp,
    set_point: SetPoint,
    closest: AdmissibleSetPoint,
    scope: AlphaScope,
    alpha: f64,
    d: f64,
    level: f64,
}

impl<'a> StabilityRegion<'a> {
    /// The region for the problem's α, or the largest of the scope where none is stated.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] for another formulation and for an α too large for the scope; those of
    /// [`AlphaBounds::of`].
    pub fn of(
        controller: &'a Controller,
        set_point: &SetPoint,
        scope: AlphaScope,
    ) -> Result<Self, DesignError> {
        if controller.formulation() != Formulation::NoTerminalConstraint {
            return Err(DesignError::OutOfRange {
                what: "the formulation".into(),
                expected: "\"no_terminal_constraint\"; the others attract their whole domain (DomainOfAttraction)".into(),
                found: format!("{:?}", controller.formulation()),
            });
        }
        let ingredients = controller.ingredients();
        let choices = no_terminal_constraint(ingredients)?;
        let bounds = AlphaBounds::of(ingredients, set_point)?;
        let alpha = match choices.alpha() {
            Some(alpha) => bounds.check(alpha, scope)?,
            None => bounds.check(bounds.largest(scope), scope)?,
        };
        let d = alpha * bounds.stage_cost_ratio;
        let steps = ingredients.problem().prediction_horizon() + choices.horizon_extension();
        let (h, ..) = controller.program_cost();
        let qp = PreparedQp::new(
            "membership in the stability region",
            h.clone(),
            controller.program_rows().1.clone(),
        )?;
        Ok(Self {
            controller,
            qp,
            set_point: set_point.clone(),
            closest: bounds.closest,
            scope,
            alpha,
            d,
            level: steps as f64 * d + choices.gamma() * alpha,
        })
    }

    /// α.
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// d = α λ_min(P⁻¹Q), the infimum of the stage cost outside Ψα.
    pub fn stage_cost_bound(&self) -> f64 {
        self.d
    }

    /// (N + M̄) d + γ α.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// For which artificial set-points α was checked.
    pub fn scope(&self) -> AlphaScope {
        self.scope
    }

    /// Whether a state (physical coordinates) is in the region.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`], [`DesignError::Solver`].
    pub fn contains(&self, state: &[f64]) -> Result<Attraction, DesignError> {
        let program = StateProgram::of(self.controller);
        let x = program.shifted("state", state)?;
        let outside = Attraction {
            cost: f64::INFINITY,
            level: self.level,
            as_printed: f64::INFINITY,
        };
        let rows = self.controller.ingredients().problem().rows();
        let breaks =
            |i: usize| rows.d.row(i).len() == 0 && rows.c.row_dot(i, &x) > 1.0 + super::MEMBERSHIP;
        if (0..rows.len()).any(breaks) {
            return Ok(outside);
        }
        match self.controller.evaluate(&self.qp, state, &self.set_point) {
            Ok(step) => Ok(Attraction {
                cost: step.cost - self.closest.offset_cost,
                as_printed: step.cost - step.offset_cost,
                level: self.level,
            }),
            Err(StepError::Infeasible { .. }) => Ok(outside),
            Err(error) => Err(DesignError::Solver {
                what: "membership in the stability region".into(),
                detail: error.to_string(),
            }),
        }
    }

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
            let deepest = body
                .deepest()
                .map_err(|e| failure("the reach of the stability region", "a variable", e))?;
            let mut best = (f64::INFINITY, Vec::new());
            for share in [0.5, 0.2, 0.05, 1e-2, 1e-3, 1e-4, 1e-6] {
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
        let largest = super::domain::size_of_direction(direction, at.len())?;
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
