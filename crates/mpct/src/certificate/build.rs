//! A certificate from a design.

use super::document::{
    BoxProof, Claim, Constraint, Multiplier, Proof, Sparse, SpentProof, Witness,
};
use crate::error::DesignError;
use crate::matrix::SparseMatrix;
use crate::problem::{Problem, RowSource, Task};
use crate::terminal::{Condition, Proofs, RowId, TerminalIngredients};
use std::collections::HashMap;

/// Multipliers below this are left out: what they add is left over, and the margin pays for it.
pub(super) const SMALLEST_MULTIPLIER: f64 = 1e-12;

/// Where a row of the problem stands in the file: constraint and side.
struct Places {
    constraints: Vec<Constraint>,
    of: HashMap<RowSource, (usize, bool)>,
}

impl Places {
    fn of(problem: &Problem) -> Self {
        let constraints = problem.constraints();
        let mut places = Self {
            constraints: Vec::new(),
            of: HashMap::new(),
        };
        let (lower, upper) = constraints.state_limits();
        for i in 0..constraints.states() {
            places.push(
                format!("state {i}"),
                vec![(i, 1.0)],
                Vec::new(),
                (lower[i], RowSource::StateLower(i)),
                (upper[i], RowSource::StateUpper(i)),
            );
        }
        let (lower, upper) = constraints.input_limits();
        for i in 0..constraints.inputs() {
            places.push(
                format!("input {i}"),
                Vec::new(),
                vec![(i, 1.0)],
                (lower[i], RowSource::InputLower(i)),
                (upper[i], RowSource::InputUpper(i)),
            );
        }
        for (block, rows) in constraints.mixed_rows().iter().enumerate() {
            for row in 0..rows.bound.len() {
                let source = RowSource::Mixed { block, row };
                places.push(
                    source.to_string(),
                    rows.c.row(row).collect(),
                    rows.d.row(row).collect(),
                    (f64::NEG_INFINITY, source),
                    (rows.bound[row], source),
                );
            }
        }
        places
    }

    fn push(
        &mut self,
        name: String,
        c: Vec<(usize, f64)>,
        d: Vec<(usize, f64)>,
        lower: (f64, RowSource),
        upper: (f64, RowSource),
    ) {
        let (below, above) = (lower.0.is_finite(), upper.0.is_finite());
        if !(below || above) || (c.is_empty() && d.is_empty()) {
            return;
        }
        let index = self.constraints.len();
        if below {
            self.of.insert(lower.1, (index, false));
        }
        if above {
            self.of.insert(upper.1, (index, true));
        }
        self.constraints.push(Constraint {
            name,
            c,
            d,
            lower: below.then_some(lower.0),
            upper: above.then_some(upper.0),
        });
    }
}

/// Claim and proof of a design.
pub(super) fn build(ingredients: &TerminalIngredients) -> Result<(Claim, Proof), DesignError> {
    let problem = ingredients.problem();
    let places = Places::of(problem);
    let sources = &problem.rows().source;
    let place = |row: usize| {
        places
            .of
            .get(&sources[row])
            .copied()
            .ok_or_else(|| DesignError::Solver {
                what: "the certificate".into(),
                detail: format!("{} is no row of the problem", sources[row]),
            })
    };
    let proof = if problem.norms().is_empty() {
        of_rows(ingredients, &place)?
    } else {
        super::build_ellipsoids::proof(ingredients, &place)?
    };
    let plant = problem.plant();
    let steady = ingredients.steady_states();
    let basis = |m: &SparseMatrix| match problem.task() {
        Task::Tracking => Sparse::from(m),
        Task::Regulation => Sparse::from(&SparseMatrix::zeros(m.rows(), 0)),
    };
    let claim = Claim {
        problem: problem.name().into(),
        a: plant.a().into(),
        b: plant.b().into(),
        operating_state: plant.operating_point().state.clone(),
        operating_input: plant.operating_point().input.clone(),
        q: problem.state_weight().into(),
        r: problem.input_weight().into(),
        scaling: problem.scaling(),
        gain: ingredients.gain().into(),
        weight: ingredients.terminal_weight().into(),
        state_basis: basis(steady.state_basis()),
        input_basis: basis(steady.input_basis()),
        condition: match problem.norms().is_empty() {
            true => ingredients.condition().to_string(),
            false => Condition::Sufficient.to_string(),
        },
        terminal_horizon: ingredients.terminal_horizon(),
        ellipsoids: super::build_ellipsoids::claim(problem),
        constraints: places.constraints,
    };
    Ok((claim, proof))
}

/// Constraint of the file and side of a row of the problem.
pub(super) type Place<'a> = dyn Fn(usize) -> Result<(usize, bool), DesignError> + 'a;

/// The proof when there are no ellipsoids.
fn of_rows(ingredients: &TerminalIngredients, place: &Place<'_>) -> Result<Proof, DesignError> {
    let problem = ingredients.problem();
    let proofs = ingredients.proofs()?;
    let multipliers = |list: &[(RowId, bool, f64)]| -> Result<Vec<Multiplier>, DesignError> {
        let kept = list.iter().filter(|m| m.2 > SMALLEST_MULTIPLIER);
        kept.map(|&(id, upper, y)| {
            // A pair is scaled to its upper bound, θ ∈ λΘ to 1; a row of the file to its own room.
            let (pair, step, scale) = match id {
                RowId::Static(pair) => (pair, None, 1.0 / problem.scaling()),
                RowId::Moving(pair, step) => (pair, Some(step), 1.0),
            };
            let (row, bound) = proofs.side(pair, upper)?;
            let (constraint, upper) = place(row)?;
            Ok((constraint, upper, step, y * bound * scale))
        })
        .collect()
    };
    let boxes = proofs
        .boxes
        .iter()
        .map(|b| match b {
            Some(b) => Ok(BoxProof {
                half_width: Some(b.half_width),
                upper: multipliers(&b.sides[0])?,
                lower: multipliers(&b.sides[1])?,
                upper_cones: Vec::new(),
                lower_cones: Vec::new(),
            }),
            None => Ok(BoxProof::default()),
        })
        .collect::<Result<_, DesignError>>()?;
    let mut spent = Vec::with_capacity(proofs.spent.len());
    for p in &proofs.spent {
        let (constraint, upper) = place(proofs.side(p.pair, p.upper)?.0)?;
        spent.push(SpentProof {
            constraint,
            upper,
            step: p.step,
            multipliers: multipliers(&p.multipliers)?,
            cones: Vec::new(),
        });
    }
    let witness = match &proofs.witness {
        None => None,
        Some(w) => {
            let (constraint, upper) = place(proofs.side(w.pair, w.upper)?.0)?;
            Some(Witness {
                constraint,
                upper,
                point: w.point.clone(),
            })
        }
    };
    Ok(Proof {
        box_steps: proofs.box_steps,
        boxes,
        spent,
        ellipsoids: Vec::new(),
        witness,
    })
}

impl Proofs {
    /// The row of the problem that is a side of a pair, and the bound of that side.
    fn side(&self, pair: usize, upper: bool) -> Result<(usize, f64), DesignError> {
        let (above, below) = self.pairs[pair];
        match (upper, below) {
            (true, _) => Ok((above, 1.0)),
            (false, Some(side)) => Ok(side),
            (false, None) => Err(DesignError::Solver {
                what: "the certificate".into(),
                detail: "a multiplier belongs to no row".into(),
            }),
        }
    }
}
