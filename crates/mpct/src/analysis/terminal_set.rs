//! The terminal set seen in two states: Ψ_f for regulation (16), the projection of Ψ^tr_{f,λ} (27) for tracking.

use super::domain::OUTLINE;
use super::polygon::{Polygon, Touch, outline};
use super::program::failure;
use crate::error::DesignError;
use crate::linalg;
use crate::optimization::Body;
use crate::terminal::TerminalIngredients;

/// The projection of the terminal set on two states, in physical coordinates: the pairs at which *some* artificial
/// set-point and *some* values of the other states satisfy the terminal constraint.
///
/// ```
/// use mpct::{DesignOptions, Task, TerminalIngredients, analysis::terminal_set};
/// let problem = mpct::cases::academic().problem;
/// let design = |p| TerminalIngredients::design(p, &DesignOptions::default());
/// let tracking = terminal_set(&design(&problem)?, (0, 1))?;
/// let regulation = terminal_set(&design(&problem.clone().with_task(Task::Regulation))?, (0, 1))?;
/// // Figure 1 of the paper: the set for regulation lies inside.
/// assert!(regulation.vertices.iter().all(|v| tracking.contains(v.map(|c| 0.999 * c))));
/// # Ok::<(), mpct::DesignError>(())
/// ```
///
/// # Errors
/// [`DesignError::OutOfRange`] for equal coordinates or ones out of range; [`DesignError::Solver`].
pub fn terminal_set(
    ingredients: &TerminalIngredients,
    coordinates: (usize, usize),
) -> Result<Polygon, DesignError> {
    let plant = ingredients.problem().plant();
    let (i, j) = coordinates;
    if !(i < plant.states() && j < plant.states() && i != j) {
        return Err(DesignError::OutOfRange {
            what: "the two coordinates".into(),
            expected: format!("different, each from 0 to {}", plant.states() - 1),
            found: format!("{i} and {j}"),
        });
    }
    let set = ingredients.maximal_admissible_set()?;
    let body = Body {
        rows: linalg::dense(set.rows()),
        bounds: vec![1.0; set.len()],
        balls: Vec::new(),
    };
    let inside = vec![0.0; body.variables()];
    let mut polygon = outline(coordinates, OUTLINE, |d| {
        let mut c = vec![0.0; body.variables()];
        (c[i], c[j]) = (d[0], d[1]);
        let value = body.support(&c, &inside).map_err(|e| {
            failure(
                "an outline of the terminal set",
                format!("x[{i}], x[{j}]"),
                e,
            )
        })?;
        Ok(Touch {
            point: [value.point[i], value.point[j]],
            upper: value.upper,
        })
    })?;
    let at = &plant.operating_point().state;
    for v in &mut polygon.vertices {
        *v = [v[0] + at[i], v[1] + at[j]];
    }
    Ok(polygon)
}
