//! The domain of attraction X_{N+M̃}: the states at which the controller's program is feasible (Theorem 4).
//!
//! It is the projection of the polytope {(x, z) : W x + G z ≤ 1} on x, with ellipsoids of its intersection with cones. It is never
//! projected: every question asked here is a linear program over (x, z), or one with second-order cones, and every answer
//! comes with what proves it.

use super::polygon::{Polygon, Touch, outline};
use super::program::{ProgramRow, StateProgram, failure};
use super::region_shape::{CURVED_HULL, CURVED_OUTLINE};
use super::volume::{Support, Volume, volume};
use crate::control::Controller;
use crate::error::DesignError;
use crate::linalg::Dense;
use crate::optimization::conic_verify::{self, Cone};
use crate::optimization::{Body, norm};
use serde::Serialize;

/// A state is inside when a z violates no row by more than this (right-hand sides are 1 at the operating point):
/// rounding of the plant's step that led there.
pub const MEMBERSHIP: f64 = 1e-9;
/// Tolerance of an outline unless stated otherwise, as a share of the half-widths. The support queries are accurate to
/// about a hundredth of it. With ellipsoids the outline is curved, and [`CURVED_OUTLINE`](super::CURVED_OUTLINE) holds.
pub const OUTLINE: f64 = 1e-6;
/// A proof of infeasibility must hold for every z with ‖z‖₁ below this.
const FARKAS_RADIUS: f64 = 1e6;
/// Multipliers below this share of the largest are left out of a proof's list of rows.
const CONTRADICTING: f64 = 1e-6;

/// Whether a state is in the domain of attraction, and the proof.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Membership {
    /// The program is feasible.
    Inside {
        /// z = (c_0, …, c_{N−1}, θ), a point of the program.
        candidate: Vec<f64>,
        /// The smallest slack of a row at it (right-hand sides are 1 at the operating point), at most 1.
        slack: f64,
    },
    /// The program is infeasible: its rows contradict each other.
    Outside {
        /// −bᵀy for multipliers y ≥ 0 with Σy = 1 and Gᵀy = 0.
        gap: f64,
        /// The proof holds for every z with ‖z‖₁ below this.
        radius: f64,
        /// The rows that take part, by descending multiplier.
        rows: Vec<(ProgramRow, f64)>,
    },
}

impl Membership {
    /// Whether the state is inside.
    pub fn is_inside(&self) -> bool {
        matches!(self, Self::Inside { .. })
    }
}

/// How far the domain reaches along a ray x(t) = x_0 + t v.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reach {
    /// The largest t known to be inside, in multiples of the direction.
    pub distance: f64,
    /// Proved: no larger t is inside.
    pub at_most: f64,
    /// x(distance), in physical coordinates.
    pub state: Vec<f64>,
}

/// The largest entry of a direction of n finite entries that is not zero.
pub(super) fn size_of_direction(direction: &[f64], n: usize) -> Result<f64, DesignError> {
    crate::problem::plant::check_vector("direction", direction, n)?;
    let largest = direction.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    if largest > 0.0 {
        Ok(largest)
    } else {
        Err(DesignError::OutOfRange {
            what: "direction".into(),
            expected: "a vector with an entry that is not 0".into(),
            found: format!("{direction:?}"),
        })
    }
}

/// The domain of attraction of a controller: implicit, explicit, for tracking or regulation.
///
/// For the formulation without terminal constraint it is the set of feasible states; what is attracted is
/// [`StabilityRegion`](super::StabilityRegion).
///
/// ```
/// use mpct::{Constraints, Controller, DesignOptions, Matrix, Plant, Problem, TerminalIngredients, Weights};
/// use mpct::analysis::DomainOfAttraction;
/// let plant = Plant::discrete(
///     Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
///     Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
/// )?;
/// let constraints = Constraints::new(2, 2)
///     .state_bounds(&[-3.0; 2], &[3.0; 2])?
///     .input_bounds(&[-2.0; 2], &[2.0; 2])?;
/// let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))?;
/// let controller = Controller::new(TerminalIngredients::design(&problem, &DesignOptions::default())?)?;
/// let domain = DomainOfAttraction::of(&controller);
/// assert!(domain.contains(&[-3.0, 3.0])?.is_inside());
/// assert!(!domain.contains(&[3.0, 3.0])?.is_inside());
/// let reach = domain.reach(&[1.0, 0.0])?;
/// assert!((reach.distance - 3.0).abs() < 1e-6 && reach.at_most >= reach.distance);
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug)]
pub struct DomainOfAttraction {
    program: StateProgram,
}

impl DomainOfAttraction {
    /// The domain of attraction of a controller.
    pub fn of(controller: &Controller) -> Self {
        Self {
            program: StateProgram::of(controller),
        }
    }

    /// The operating point's state, from which [`reach`](Self::reach) is measured.
    pub fn origin(&self) -> &[f64] {
        &self.program.origin
    }

    /// Whether a state (physical coordinates, length n) is in the domain, with a proof either way.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`]; [`DesignError::Solver`] when neither proof passes its check.
    pub fn contains(&self, state: &[f64]) -> Result<Membership, DesignError> {
        let x = self.program.shifted("state", state)?;
        let body = self.program.body(&x, &Dense::zeros(x.len(), 0));
        let what = "membership in the domain of attraction";
        let deepest = body.deepest().map_err(|e| failure(what, "a variable", e))?;
        if deepest.depth >= -MEMBERSHIP {
            return Ok(Membership::Inside {
                candidate: deepest.point,
                slack: deepest.depth,
            });
        }
        let cones: Vec<Cone<'_>> = body
            .balls
            .iter()
            .map(|b| Cone {
                map: &b.map,
                offset: &b.offset,
                radius: b.radius,
            })
            .collect();
        let proof = conic_verify::farkas(
            &body.rows,
            &body.bounds,
            &cones,
            &deepest.multipliers,
            &deepest.balls,
        )
        .filter(|p| p.radius >= FARKAS_RADIUS);
        let Some(proof) = proof else {
            return Err(DesignError::Solver {
                what: what.into(),
                detail: format!(
                    "the best candidate violates a row by {:.3e}, and no proof of infeasibility passes its check",
                    -deepest.depth
                ),
            });
        };
        let sizes = deepest.balls.iter().map(|w| norm(w));
        let sizes: Vec<f64> = deepest.multipliers.iter().copied().chain(sizes).collect();
        let total: f64 = sizes.iter().sum();
        let names = self.program.names.iter().chain(&self.program.cone_names);
        let mut rows: Vec<(ProgramRow, f64)> = names
            .copied()
            .zip(sizes.iter().map(|y| y / total))
            .collect();
        rows.sort_by(|a, b| b.1.total_cmp(&a.1));
        let largest = rows[0].1;
        rows.retain(|r| r.1 > CONTRADICTING * largest);
        Ok(Membership::Outside {
            gap: proof.gap,
            radius: proof.radius,
            rows,
        })
    }

    /// How far the domain reaches from the operating point in a direction (length n, not zero).
    ///
    /// # Errors
    /// As [`DomainOfAttraction::reach_from`].
    pub fn reach(&self, direction: &[f64]) -> Result<Reach, DesignError> {
        let origin = self.program.origin.clone();
        self.reach_from(&origin, direction)
    }

    /// How far the domain reaches from a state of it in a direction.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`]; [`DesignError::OutOfRange`] for the zero direction and for a
    /// state outside the domain; [`DesignError::Unbounded`] when it reaches to infinity.
    pub fn reach_from(&self, state: &[f64], direction: &[f64]) -> Result<Reach, DesignError> {
        let x = self.program.shifted("state", state)?;
        let largest = size_of_direction(direction, x.len())?;
        if let Membership::Outside { gap, .. } = self.contains(state)? {
            return Err(DesignError::OutOfRange {
                what: "the state from which the reach is asked".into(),
                expected: "a state in the domain of attraction".into(),
                found: format!("{state:?}, outside by {gap:.3e} (rows have right-hand sides of 1)"),
            });
        }
        // The step is measured in multiples of the direction; the program sees a direction of size one.
        let unit = Dense::from_fn(x.len(), 1, |i, _| direction[i] / largest);
        let body = self.program.body(&x, &unit);
        let what = "the reach of the domain of attraction";
        let named = || format!("the direction {direction:?}");
        let inside = self.interior(&body, what, &x)?;
        let mut c = vec![0.0; body.variables()];
        c[0] = 1.0;
        let value = body
            .support(&c, &inside)
            .map_err(|e| failure(what, named(), e))?;
        let t = value.lower / largest;
        let reached: Vec<f64> = x.iter().zip(direction).map(|(x, v)| x + t * v).collect();
        Ok(Reach {
            distance: t,
            at_most: value.upper / largest,
            state: self.program.physical(&reached),
        })
    }

    /// The projection of the domain on two coordinates: the pairs for which *some* values of the other states are in it.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] for equal coordinates or ones out of range; [`DesignError::Unbounded`],
    /// [`DesignError::Solver`].
    pub fn projection(&self, coordinates: (usize, usize)) -> Result<Polygon, DesignError> {
        self.projection_within(coordinates, self.tolerance())
    }

    /// The projection with another tolerance, a share of the half-widths.
    ///
    /// # Errors
    /// As [`DomainOfAttraction::projection`]; [`DesignError::OutOfRange`] for the tolerance.
    pub fn projection_within(
        &self,
        coordinates: (usize, usize),
        tolerance: f64,
    ) -> Result<Polygon, DesignError> {
        self.program.check_coordinates(coordinates)?;
        let n = self.program.states();
        let body = self.program.body(&vec![0.0; n], &Dense::identity(n, n));
        let inside = vec![0.0; body.variables()];
        let (i, j) = coordinates;
        self.outline(&body, &inside, coordinates, (i, j), tolerance)
    }

    /// The section of the domain through a state: the values of two coordinates that are in it while the other states
    /// stay as they are in `state`.
    ///
    /// # Errors
    /// As [`DomainOfAttraction::projection`]; [`DesignError::OutOfRange`] when the section has no interior.
    pub fn section(
        &self,
        state: &[f64],
        coordinates: (usize, usize),
    ) -> Result<Polygon, DesignError> {
        self.program.check_coordinates(coordinates)?;
        let mut x = self.program.shifted("state", state)?;
        (x[coordinates.0], x[coordinates.1]) = (0.0, 0.0);
        let body = self.program.body(&x, &self.program.plane(coordinates));
        let inside = self.interior(&body, "a section of the domain of attraction", &x)?;
        self.outline(&body, &inside, coordinates, (0, 1), self.tolerance())
    }

    /// That of a polygon, or of a curve.
    fn tolerance(&self) -> f64 {
        if self.program.cone_names.is_empty() {
            OUTLINE
        } else {
            CURVED_OUTLINE
        }
    }

    /// The volume of the domain, for plants of up to three states.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] for more states; [`DesignError::Unbounded`], [`DesignError::Solver`].
    pub fn volume(&self) -> Result<Volume, DesignError> {
        let n = self.program.states();
        let body = self.program.body(&vec![0.0; n], &Dense::identity(n, n));
        let inside = vec![0.0; body.variables()];
        let tolerance = if n > 2 && !self.program.cone_names.is_empty() {
            CURVED_HULL
        } else {
            self.tolerance()
        };
        volume("the domain of attraction", n, tolerance, |d| {
            let mut c = vec![0.0; body.variables()];
            c[..n].copy_from_slice(d);
            let value = body
                .support(&c, &inside)
                .map_err(|e| failure("the volume of the domain of attraction", "a state", e))?;
            Ok(Support {
                point: value.point[..n].to_vec(),
                upper: value.upper,
            })
        })
    }

    /// A point strictly inside: the origin where it is one.
    fn interior(&self, body: &Body, what: &str, x: &[f64]) -> Result<Vec<f64>, DesignError> {
        let zero = vec![0.0; body.variables()];
        if body.violation(&zero) < -0.5 {
            return Ok(zero);
        }
        let deepest = body.deepest().map_err(|e| failure(what, "a variable", e))?;
        if deepest.depth > MEMBERSHIP {
            Ok(deepest.point)
        } else {
            Err(DesignError::OutOfRange {
                what: what.into(),
                expected: "a line or plane that passes through the interior of the domain".into(),
                found: format!(
                    "one through {:?}, whose deepest point violates a row by {:.3e}",
                    self.program.physical(x),
                    -deepest.depth
                ),
            })
        }
    }

    fn outline(
        &self,
        body: &Body,
        inside: &[f64],
        coordinates: (usize, usize),
        (i, j): (usize, usize),
        tolerance: f64,
    ) -> Result<Polygon, DesignError> {
        let at = [
            self.program.origin[coordinates.0],
            self.program.origin[coordinates.1],
        ];
        let mut polygon = outline(coordinates, tolerance, |d| {
            let mut c = vec![0.0; body.variables()];
            (c[i], c[j]) = (d[0], d[1]);
            let value = body.support(&c, inside).map_err(|e| {
                let named = format!("x[{}], x[{}]", coordinates.0, coordinates.1);
                failure("an outline of the domain of attraction", named, e)
            })?;
            Ok(Touch {
                point: [value.point[i], value.point[j]],
                upper: value.upper,
            })
        })?;
        for v in &mut polygon.vertices {
            *v = [v[0] + at[0], v[1] + at[1]];
        }
        Ok(polygon)
    }
}
