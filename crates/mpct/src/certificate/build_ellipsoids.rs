//! The parts of a certificate that ellipsoids bring with them, from a design.

use super::build::{Place, SMALLEST_MULTIPLIER};
use super::document::{
    BoxProof, ConeMultiplier, Ellipsoid, EllipsoidProof, Multiplier, Proof, SpentProof,
    SupportProof,
};
use crate::error::DesignError;
use crate::optimization::norm;
use crate::problem::{EllipsoidShape, Problem};
use crate::terminal::{ConicMultiplier, TerminalIngredients};

/// The ellipsoids of a problem as norms.
pub(super) fn claim(problem: &Problem) -> Vec<Ellipsoid> {
    let at = problem.plant().operating_point();
    let stated = problem.constraints().ellipsoids().iter();
    stated
        .zip(problem.norms())
        .map(|(ellipsoid, bound)| {
            let (mut center_state, mut center_input) = (at.state.clone(), at.input.clone());
            if let Some(center) = ellipsoid.center() {
                match ellipsoid.shape() {
                    EllipsoidShape::Input(_) => center_input = center.to_vec(),
                    _ => center_state = center.to_vec(),
                }
            }
            Ellipsoid {
                name: bound.source.to_string(),
                f: (&bound.f).into(),
                g: (&bound.g).into(),
                center_state,
                center_input,
            }
        })
        .collect()
}

/// The proof.
pub(super) fn proof(
    ingredients: &TerminalIngredients,
    place: &Place<'_>,
) -> Result<Proof, DesignError> {
    let scaling = ingredients.problem().scaling();
    let proofs = ingredients.conic_proofs()?;
    // Static constraints stand divided by λ in the search, and as they are in the file.
    let scale = |step: Option<usize>| if step.is_some() { 1.0 } else { scaling.recip() };
    let rows = |list: &ConicMultiplier| -> Result<Vec<Multiplier>, DesignError> {
        let kept = list.rows.iter().filter(|m| m.2 > SMALLEST_MULTIPLIER);
        kept.map(|&(row, step, y)| {
            let (constraint, upper) = place(row)?;
            Ok((constraint, upper, step, y * scale(step)))
        })
        .collect()
    };
    let cones = |list: &ConicMultiplier| -> Vec<ConeMultiplier> {
        let kept = list
            .norms
            .iter()
            .filter(|m| norm(&m.2) > SMALLEST_MULTIPLIER);
        kept.map(|(k, step, w)| (*k, *step, w.iter().map(|w| w * scale(*step)).collect()))
            .collect()
    };
    let boxes = proofs
        .boxes
        .iter()
        .map(|(half_width, [upper, lower])| {
            Ok(BoxProof {
                half_width: Some(*half_width),
                upper: rows(upper)?,
                lower: rows(lower)?,
                upper_cones: cones(upper),
                lower_cones: cones(lower),
            })
        })
        .collect::<Result<_, DesignError>>()?;
    let mut spent = Vec::with_capacity(proofs.rows.len());
    for (row, step, multipliers) in &proofs.rows {
        let (constraint, upper) = place(*row)?;
        spent.push(SpentProof {
            constraint,
            upper,
            step: *step,
            multipliers: rows(multipliers)?,
            cones: cones(multipliers),
        });
    }
    let mut ellipsoids = Vec::with_capacity(proofs.norms.len());
    for p in &proofs.norms {
        let mut supports = Vec::with_capacity(p.supports.len());
        for support in &p.supports {
            supports.push(SupportProof {
                direction: support.direction.clone(),
                multipliers: rows(&support.multipliers)?,
                cones: cones(&support.multipliers),
            });
        }
        ellipsoids.push(EllipsoidProof {
            ellipsoid: p.norm,
            step: p.step,
            split: p.split,
            supports,
        });
    }
    Ok(Proof {
        box_steps: 0,
        boxes,
        spent,
        ellipsoids,
        witness: None,
    })
}
