//! The memory of a banded controller, divided.

use super::factor::Factor;
use super::tables::BandedTables;
use crate::Scalar;
use core::ops::Range;

/// Variables or states whose movement is measured together.
pub(crate) const BLOCK: usize = 16;

/// What is remembered besides the arrays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State<T> {
    /// Active rows.
    pub active: usize,
    /// Pairs whose centre is not zero.
    pub centred: usize,
    /// Changes of the factors since they were computed; `None` when they are not valid.
    pub changes: Option<u32>,
    /// Longest window of a row.
    pub longest: usize,
    /// The sizes of the tables that the memory was divided for.
    pub sizes: [usize; 7],
    /// Some rows are stiffer than usual.
    pub is_stiff: bool,
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
            longest: 0,
            sizes: [0; 7],
            is_stiff: false,
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
    pub z: &'w mut [T],
    pub plan: &'w mut [T],
    /// f.
    pub linear: &'w mut [T],
    /// F_r r.
    pub linear_set_point: &'w mut [T],
    /// H z + f.
    pub gradient: &'w mut [T],
    pub direction: &'w mut [T],
    /// Zero between uses.
    pub scratch: &'w mut [T],
    /// Square root of the diagonal of H.
    pub unit: &'w mut [T],
    /// Squared movement by blocks.
    pub blocks: &'w mut [T],
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
    /// V x of the pairs of groups that were measured in this step.
    pub of_state: &'w mut [T],
    /// Largest excess of a row of each group when it was measured.
    pub known: &'w mut [T],
    /// How much it can have grown since.
    pub moved: &'w mut [T],
    /// Largest ‖G D^(−1/2)‖ and ‖V‖ in each group.
    pub reach: [&'w mut [T]; 2],
    /// Active pairs, ascending.
    pub active: &'w mut [u32],
    /// 0 inactive, 1 upper side, 2 lower side.
    pub side: &'w mut [u32],
    /// Pairs with a centre.
    pub centred: &'w mut [u32],
    /// Whether `of_state` holds for each group: 0 or 1.
    pub is_dated: &'w mut [u32],
    /// The row of that excess.
    pub best: &'w mut [u32],
    /// First variable, end, first state, end of each group.
    pub spans: [&'w mut [u32]; 4],
}

fn blocks<T: Scalar>(tables: &BandedTables<'_, T>) -> usize {
    tables.variables().max(tables.states()) / BLOCK + 1
}

pub(crate) fn numbers<T: Scalar>(tables: &BandedTables<'_, T>) -> usize {
    tables.factor_entries()
        + 9 * tables.variables()
        + blocks(tables)
        + tables.states()
        + tables.set_point()
        + tables.inputs()
        + 5 * tables.pairs()
        + 4 * tables.groups()
}

pub(crate) fn indices<T: Scalar>(tables: &BandedTables<'_, T>) -> usize {
    2 * tables.variables() + 1 + 3 * tables.pairs() + 6 * tables.groups()
}

/// What decides how memory is divided.
pub(crate) fn sizes<T: Scalar>(tables: &BandedTables<'_, T>) -> [usize; 7] {
    [
        tables.factor_entries(),
        tables.variables(),
        tables.states(),
        tables.set_point(),
        tables.inputs(),
        tables.pairs(),
        tables.groups(),
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
        direction: numbers(nz),
        scratch: numbers(nz),
        unit: numbers(nz),
        blocks: numbers(blocks(tables)),
        x: numbers(tables.states()),
        r: numbers(tables.set_point()),
        input: numbers(tables.inputs()),
        y: numbers(pairs),
        centre: numbers(pairs),
        stiff: numbers(pairs),
        slope: numbers(pairs),
        of_state: numbers(pairs),
        known: numbers(groups),
        moved: numbers(groups),
        reach: [numbers(groups), numbers(groups)],
        active: indices(pairs),
        side: indices(pairs),
        centred: indices(pairs),
        is_dated: indices(groups),
        best: indices(groups),
        spans: [
            indices(groups),
            indices(groups),
            indices(groups),
            indices(groups),
        ],
    })
}

/// The smallest range that covers both; an empty one covers nothing.
fn hull(a: Option<Range<usize>>, b: Range<usize>) -> Option<Range<usize>> {
    match a {
        _ if b.is_empty() => a,
        None => Some(b),
        Some(a) => Some(a.start.min(b.start)..a.end.max(b.end)),
    }
}

impl<T: Scalar> Parts<'_, T> {
    /// What depends on the tables alone, and an empty memory. Returns the longest window of a row.
    pub fn clear(&mut self, tables: &BandedTables<'_, T>) -> usize {
        let d = &tables.data;
        self.factor.shape(tables);
        for v in 0..tables.variables() {
            self.unit[v] = d.hessian.row(v)[0].sqrt_core();
        }
        let mut longest = 0;
        for group in 0..tables.groups() {
            let pairs = d.groups[group] as usize..d.groups[group + 1] as usize;
            let (mut of_z, mut of_x) = (None, None);
            let (mut reach_z, mut reach_x) = (T::ZERO, T::ZERO);
            for pair in pairs {
                let (z, x) = (d.rows.window(pair), d.rows_state.window(pair));
                longest = longest.max(z.len());
                let (mut square_z, mut square_x) = (T::ZERO, T::ZERO);
                for (&g, &u) in d.rows.row(pair).iter().zip(&self.unit[z.clone()]) {
                    square_z += (g / u) * (g / u);
                }
                for &v in d.rows_state.row(pair) {
                    square_x += v * v;
                }
                reach_z = reach_z.max(square_z);
                reach_x = reach_x.max(square_x);
                (of_z, of_x) = (hull(of_z, z), hull(of_x, x));
            }
            // A little more than the norm, for the rounding of what it bounds.
            let margin = T::ONE + T::from_f64(1e3) * T::EPSILON;
            self.reach[0][group] = reach_z.sqrt_upper() * margin;
            self.reach[1][group] = reach_x.sqrt_upper() * margin;
            let (of_z, of_x) = (of_z.unwrap_or(0..0), of_x.unwrap_or(0..0));
            let ends = [of_z.start, of_z.end, of_x.start, of_x.end];
            for (span, value) in self.spans.iter_mut().zip(ends) {
                span[group] = value as u32;
            }
        }
        for vector in [
            &mut self.z,
            &mut self.plan,
            &mut self.linear,
            &mut self.linear_set_point,
            &mut self.gradient,
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
        self.is_dated.fill(0);
        longest
    }
}
