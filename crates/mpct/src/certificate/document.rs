//! The file: a claim, its proof, and a digest of both.

use crate::matrix::SparseMatrix;
use serde::{Deserialize, Serialize};

/// First line of every certificate.
pub(super) const FORMAT: &str = "mpct certificate 1";

/// The whole file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Document {
    pub(super) format: String,
    /// SHA-256 of the claim and the proof as compact JSON.
    pub(super) digest: String,
    pub(super) claim: Claim,
    pub(super) proof: Proof,
}

/// A sparse matrix: its shape, and the entries of each row as (column, value).
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sparse {
    pub(super) columns: usize,
    pub(super) rows: Vec<Vec<(usize, f64)>>,
}

impl From<&SparseMatrix> for Sparse {
    fn from(m: &SparseMatrix) -> Self {
        Self {
            columns: m.cols(),
            rows: (0..m.rows()).map(|i| m.row(i).collect()).collect(),
        }
    }
}

/// lower ≤ C x + D u ≤ upper in physical coordinates; a missing side is no constraint.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Constraint {
    pub(super) name: String,
    pub(super) c: Vec<(usize, f64)>,
    pub(super) d: Vec<(usize, f64)>,
    pub(super) lower: Option<f64>,
    pub(super) upper: Option<f64>,
}

/// ‖F (x − x_c) + G (u − u_c)‖ ≤ 1 in physical coordinates.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Ellipsoid {
    pub(super) name: String,
    pub(super) f: Sparse,
    pub(super) g: Sparse,
    pub(super) center_state: Vec<f64>,
    pub(super) center_input: Vec<f64>,
}

/// What is claimed: for every (x, θ) that satisfies the constraints along steps 0, …, M̃ of the terminal law, with θ
/// in λΘ, they are satisfied for ever; and, under the exact condition, M̃ − 1 steps are too few for that. With ellipsoids
/// the condition is stated as sufficient.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Claim {
    pub(super) problem: String,
    /// x⁺ − x_op = A (x − x_op) + B (u − u_op).
    pub(super) a: Sparse,
    pub(super) b: Sparse,
    pub(super) operating_state: Vec<f64>,
    pub(super) operating_input: Vec<f64>,
    pub(super) constraints: Vec<Constraint>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) ellipsoids: Vec<Ellipsoid>,
    pub(super) q: Sparse,
    pub(super) r: Sparse,
    /// λ.
    pub(super) scaling: f64,
    /// K.
    pub(super) gain: Sparse,
    /// P.
    pub(super) weight: Sparse,
    /// M_θ; without columns for regulation.
    pub(super) state_basis: Sparse,
    pub(super) input_basis: Sparse,
    /// "exact" or "sufficient".
    pub(super) condition: String,
    pub(super) terminal_horizon: usize,
}

/// A row of a proof: constraint, its upper side or not, the step (none: θ ∈ λΘ), and the multiplier of the row divided
/// by its room at the operating point.
pub(super) type Multiplier = (usize, bool, Option<usize>, f64);

/// An ellipsoid in a proof: its index, the step (none: θ ∈ λΘ), and the multiplier w of its vector.
pub(super) type ConeMultiplier = (usize, Option<usize>, Vec<f64>);

/// A coordinate of z = (e, θ), e = x − x_op − M_θx θ, lies within ± half_width at every point of the set of
/// `box_steps` steps. Without a half width it is not bounded.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BoxProof {
    pub(super) half_width: Option<f64>,
    pub(super) upper: Vec<Multiplier>,
    pub(super) lower: Vec<Multiplier>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) upper_cones: Vec<ConeMultiplier>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) lower_cones: Vec<ConeMultiplier>,
}

/// A side of a constraint at a step follows from rows of steps before.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SpentProof {
    pub(super) constraint: usize,
    pub(super) upper: bool,
    pub(super) step: usize,
    pub(super) multipliers: Vec<Multiplier>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) cones: Vec<ConeMultiplier>,
}

/// An ellipsoid at a step follows from constraints of steps before: supports of its vector in directions of whole
/// numbers, or of the e part alone when `split`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EllipsoidProof {
    pub(super) ellipsoid: usize,
    pub(super) step: usize,
    pub(super) split: bool,
    pub(super) supports: Vec<SupportProof>,
}

/// The multipliers of one support.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SupportProof {
    pub(super) direction: Vec<i64>,
    pub(super) multipliers: Vec<Multiplier>,
    pub(super) cones: Vec<ConeMultiplier>,
}

/// A point (e, θ) of the set of M̃ − 1 steps from which a constraint is broken at step M̃.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Witness {
    pub(super) constraint: usize,
    pub(super) upper: bool,
    pub(super) point: Vec<(usize, f64)>,
}

/// The proof.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Proof {
    /// How many steps of the terminal law it takes to bound every coordinate: 0 unless constraints are one-sided.
    pub(super) box_steps: usize,
    pub(super) boxes: Vec<BoxProof>,
    pub(super) spent: Vec<SpentProof>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) ellipsoids: Vec<EllipsoidProof>,
    /// Missing when M̃ = 1, the smallest there is.
    pub(super) witness: Option<Witness>,
}
