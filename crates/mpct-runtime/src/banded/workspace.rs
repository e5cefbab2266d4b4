//! The memory of a banded controller, divided.

use super::factor::Factor;
use super::movement::blocks;
use super::tables::BandedTables;
use crate::Scalar;

/// What is remembered besides the arrays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State<T> {
    /// Active rows.
    pub active: usize,
    /// Pairs whose centre is not zero.
    pub centred: usize,
    /// Changes of the factors since they were computed; `None` when they are not valid.
    pub changes: Option<u32>,
    /// Solutions that were needed only because changes have left rounding in the factors.
    pub refined: u32,
    /// Longest window of a row.
    pub longest: usize,
    /// Longest span of variables of a group.
    pub widest: usize,
    /// The sizes of the tables that the memory was divided for.
    pub sizes: [usize; 8],
    /// Some rows are stiffer than usual.
    pub is_stiff: bool,
    /// `gradient`, `slope` and the multipliers belong to `z`, and `z` is an optimum.
    pub is_settled: bool,
    /// `pull` belongs to `slope` and the stiffness.
    pub has_pull: bool,
    pub has_plan: bool,
    pub is_optimum: bool,
    /// Nothing was loaded since the last reset.
    pub is_fresh: bool,
    /// Whether the proof of the last step stands in `proof`.
    pub has_proof: bool,
    pub stationarity: T,
    /// Largest violation seen when the solve ended, in units of right-hand sides.
    pub violation: T,
}

impl<T: Scalar> State<T> {
    pub fn new() -> Self {
        Self {
            active: 0,
            centred: 0,
            changes: None,
            refined: 0,
            longest: 0,
            widest: 0,
            sizes: [0; 8],
            is_stiff: false,
            is_settled: false,
            has_pull: false,
            has_plan: false,
            is_optimum: false,
            is_fresh: true,
            has_proof: false,
            stationarity: T::INFINITY,
            violation: T::ZERO,
        }
    }
}

/// The arrays by name.
#[derive(Debug)]
pub(crate) struct Parts<'w, T> {
    pub factor: Factor<'w, T>,
    /// The neighbourhood of groups that is being worked on.
    pub turn: usize,
    pub z: &'w mut [T],
    pub plan: &'w mut [T],
    /// f.
    pub linear: &'w mut [T],
    /// F_r r.
    pub linear_set_point: &'w mut [T],
    /// H z + f + Gᵀy.
    pub gradient: &'w mut [T],
    /// ρ Gᵀ times the residuals of the active rows.
    pub pull: &'w mut [T],
    pub direction: &'w mut [T],
    /// Zero between uses.
    pub scratch: &'w mut [T],
    /// Square root of the diagonal of H.
    pub unit: &'w mut [T],
    /// Movement by blocks: of c, and of θ.
    pub blocks: [&'w mut [T]; 2],
    /// Measured state and set-point in the order of the tables.
    pub x: &'w mut [T],
    pub r: &'w mut [T],
    pub input: &'w mut [T],
    /// Multiplier of each pair: positive on the upper side, negative on the lower.
    pub y: &'w mut [T],
    /// The multipliers that the quadratic penalty is centred at.
    pub centre: &'w mut [T],
    /// ρ of each pair.
    pub stiff: &'w mut [T],
    /// A number for each active row; the proof when there is one (of each pair).
    pub slope: &'w mut [T],
    /// V x of the pairs that were measured in this step, NaN of others.
    pub of_state: &'w mut [T],
    /// What each pair reached when it was measured, less its excess, see `pricing.rs`.
    pub key: &'w mut [T],
    /// Shares of c, θ and x of each pair, see `movement.rs`.
    pub share: [&'w mut [T]; 3],
    /// Largest excess of a row of each group when it was measured, or a bound that is not positive.
    pub known: &'w mut [T],
    /// The same in units of right-hand sides.
    pub nearest: &'w mut [T],
    /// How much that can have grown since.
    pub moved: &'w mut [T],
    /// Sums of the movements of c, θ and x near each group.
    pub path: [&'w mut [T]; 3],
    /// Weights of the blocks of each group.
    pub weights: &'w mut [T],
    /// Active pairs, ascending.
    pub active: &'w mut [u32],
    /// 0 inactive, 1 upper side, 2 lower side.
    pub side: &'w mut [u32],
    /// Pairs with a centre.
    pub centred: &'w mut [u32],
    /// The row of that excess.
    pub best: &'w mut [u32],
    /// First variable, end, first state, end of each group.
    pub spans: [&'w mut [u32]; 4],
    /// Where the weights of each group begin.
    pub weight_start: &'w mut [u32],
}

fn moving_blocks<T: Scalar>(tables: &BandedTables<'_, T>) -> usize {
    blocks(tables.variables().max(tables.states()))
}

pub(crate) fn numbers<T: Scalar>(tables: &BandedTables<'_, T>) -> usize {
    tables.factor_entries()
        + 10 * tables.variables()
        + 2 * moving_blocks(tables)
        + tables.states()
        + tables.set_point()
        + tables.inputs()
        + 9 * tables.pairs()
        + 6 * tables.groups()
        + tables.weights()
}

pub(crate) fn indices<T: Scalar>(tables: &BandedTables<'_, T>) -> usize {
    2 * tables.variables() + 1 + 3 * tables.pairs() + 6 * tables.groups()
}

/// What decides how memory is divided.
pub(crate) fn sizes<T: Scalar>(tables: &BandedTables<'_, T>) -> [usize; 8] {
    [
        tables.factor_entries(),
        tables.variables(),
        tables.states(),
        tables.set_point(),
        tables.inputs(),
        tables.pairs(),
        tables.groups(),
        tables.weights(),
    ]
}

/// Divides memory of exactly the right lengths; `None` for others.
pub(crate) fn divide<'w, T: Scalar>(
    tables: &BandedTables<'_, T>,
    mut numbers_left: &'w mut [T],
    mut indices_left: &'w mut [u32],
) -> Option<Parts<'w, T>> {
    if numbers_left.len() != numbers(tables) || indices_left.len() != indices(tables) {
        return None;
    }
    let (nz, pairs, groups) = (tables.variables(), tables.pairs(), tables.groups());
    let numbers = &mut |len: usize| {
        let (head, tail) = core::mem::take(&mut numbers_left).split_at_mut(len);
        numbers_left = tail;
        head
    };
    let indices = &mut |len: usize| {
        let (head, tail) = core::mem::take(&mut indices_left).split_at_mut(len);
        indices_left = tail;
        head
    };
    Some(Parts {
        turn: 0,
        factor: Factor {
            end: indices(nz),
            start: indices(nz + 1),
            lower: numbers(tables.factor_entries()),
            diagonal: numbers(nz),
        },
        z: numbers(nz),
        plan: numbers(nz),
        linear: numbers(nz),
        linear_set_point: numbers(nz),
        gradient: numbers(nz),
        pull: numbers(nz),
        direction: numbers(nz),
        scratch: numbers(nz),
        unit: numbers(nz),
        blocks: [
            numbers(moving_blocks(tables)),
            numbers(moving_blocks(tables)),
        ],
        x: numbers(tables.states()),
        r: numbers(tables.set_point()),
        input: numbers(tables.inputs()),
        y: numbers(pairs),
        centre: numbers(pairs),
        stiff: numbers(pairs),
        slope: numbers(pairs),
        of_state: numbers(pairs),
        key: numbers(pairs),
        share: [numbers(pairs), numbers(pairs), numbers(pairs)],
        known: numbers(groups),
        nearest: numbers(groups),
        moved: numbers(groups),
        path: [numbers(groups), numbers(groups), numbers(groups)],
        weights: numbers(tables.weights()),
        active: indices(pairs),
        side: indices(pairs),
        centred: indices(pairs),
        best: indices(groups),
        spans: [
            indices(groups),
            indices(groups),
            indices(groups),
            indices(groups),
        ],
        weight_start: indices(groups),
    })
}

impl<T: Scalar> Parts<'_, T> {
    /// What depends on the tables alone, and an empty memory. Returns the longest window of a row and the longest span of a group.
    pub fn clear(&mut self, tables: &BandedTables<'_, T>) -> [usize; 2] {
        let d = &tables.data;
        self.factor.shape(tables);
        for v in 0..tables.variables() {
            self.unit[v] = d.hessian.row(v)[0].sqrt_core();
        }
        let lengths = self.weigh(tables);
        for vector in [
            &mut self.z,
            &mut self.plan,
            &mut self.linear,
            &mut self.linear_set_point,
            &mut self.gradient,
            &mut self.pull,
            &mut self.direction,
            &mut self.scratch,
            &mut self.x,
            &mut self.r,
            &mut self.input,
            &mut self.y,
            &mut self.centre,
            &mut self.slope,
            &mut self.moved,
        ] {
            vector.fill(T::ZERO);
        }
        self.known.fill(T::INFINITY);
        self.stiff.fill(super::solve::stiffness());
        self.side.fill(0);
        self.of_state.fill(T::NAN);
        self.key.fill(-T::INFINITY);
        self.path.iter_mut().for_each(|path| path.fill(T::ZERO));
        lengths
    }
}
