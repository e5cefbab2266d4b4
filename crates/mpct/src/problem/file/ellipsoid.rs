//! `[[constraints.ellipsoid]]`: `state = E`, `input = E`, or `C` and `D` of ‖C x + D u‖ ≤ 1.

use super::error::FileError;
use super::reader::Section;
use crate::matrix::SparseMatrix;
use crate::problem::Constraints;

/// Adds the ellipsoids of a file.
pub(super) fn read(
    section: &Section<'_>,
    mut constraints: Constraints,
) -> Result<Constraints, FileError> {
    let (n, m) = (constraints.states(), constraints.inputs());
    for block in section.sections("ellipsoid")? {
        block.only(&["state", "input", "C", "D", "center"])?;
        let state = block.weight("state")?;
        let input = block.weight("input")?;
        let (c, d) = (block.matrix("C")?, block.matrix("D")?);
        let center = block.vector("center")?;
        let wrong = |key: &str, expected: &str, found: &str| FileError::WrongType {
            key: block.key(key),
            expected: expected.into(),
            found: found.into(),
            line: None,
        };
        let one = "one of state, input, or C and D in each block";
        constraints = match (state, input, c.is_some() || d.is_some()) {
            (Some(e), None, false) => match center {
                Some(at) => constraints.state_ellipsoid_around(e, at)?,
                None => constraints.state_ellipsoid(e)?,
            },
            (None, Some(e), false) => match center {
                Some(at) => constraints.input_ellipsoid_around(e, at)?,
                None => constraints.input_ellipsoid(e)?,
            },
            (None, None, true) => {
                if center.is_some() {
                    return Err(wrong(
                        "center",
                        "a center beside state or input only",
                        "one beside C and D",
                    ));
                }
                let q = c.as_ref().or(d.as_ref()).map_or(0, SparseMatrix::rows);
                constraints.norm_bound(
                    c.unwrap_or_else(|| SparseMatrix::zeros(q, n)),
                    d.unwrap_or_else(|| SparseMatrix::zeros(q, m)),
                )?
            }
            (None, None, false) => {
                block.need_weight("state", "the matrix E of x'E x <= 1 (or input, or C and D)")?;
                constraints
            }
            (Some(_), _, _) => return Err(wrong("state", one, "more than one")),
            (None, Some(_), true) => return Err(wrong("input", one, "more than one")),
        };
    }
    Ok(constraints)
}
