//! The norm of a vector from its supports in finitely many directions.
//!
//! Let h(d) = max d·v over a set of vectors v in R^q, known from above in directions d_1, …, d_q that form a wedge. For a unit
//! vector d = Σ α_k d_k of the wedge, α ≥ 0, sublinearity gives h(d) ≤ Σ α_k h(d_k) = a·d with D a = h, where the rows of D
//! are the directions. So h(d) ≤ ‖a‖. A fan of wedges covers the space; the largest ‖a‖ bounds max ‖v‖.
//!
//! Directions are vectors of whole numbers. The fan starts with the 2^q orthants, whose bounds together are that of the
//! box, √Σ max(h(e_k), h(−e_k))². A wedge with too large a bound is cut in two along a + b for two of its directions:
//! the parts cover it exactly, det D stays ±1, and D⁻¹ is a matrix of whole numbers, so that nothing is rounded.

use std::collections::{BTreeMap, BinaryHeap};

/// A direction of whole numbers.
pub(crate) type Direction = Vec<i64>;

/// Up to this dimension wedges are cut; beyond, the box is all. A cone of q directions needs about (1/angle)^(q − 1) of them.
pub(super) const CUT: usize = 4;
/// Entries of a direction beyond this do not sharpen a bound any more.
const LONGEST: i64 = 1000;

/// The answer of a fan.
pub(super) enum Bounded {
    /// At most 1; the directions asked.
    Yes(Vec<Direction>),
    /// Not shown within the budget; the bound reached.
    No(f64),
}

/// What asking for a support may answer.
pub(super) enum Asked {
    /// An upper bound.
    AtMost(f64),
    /// A point was found that decides the question: no bound is needed any more.
    Stop,
}

#[derive(PartialEq)]
struct Wedge {
    bound: f64,
    directions: Vec<Direction>,
    /// D⁻¹, by rows.
    inverse: Vec<Vec<i64>>,
}

impl Eq for Wedge {}

impl PartialOrd for Wedge {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Wedge {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

/// ±e_k.
pub(super) fn axis(q: usize, k: usize, sign: i64) -> Direction {
    let mut d = vec![0; q];
    d[k] = sign;
    d
}

/// √Σ max(h(e_k), h(−e_k))²: the corner of the box that is furthest out.
pub(super) fn corner(sides: &[[f64; 2]]) -> f64 {
    sides
        .iter()
        .map(|s| s[0].max(s[1]).max(0.0))
        .fold(0.0_f64, f64::hypot)
}

/// Whether max ‖v‖ ≤ `limit`, with at most `budget` further supports. `sides` are h(±e_k). `None` when `ask` said stop.
pub(super) fn is_within(
    sides: &[[f64; 2]],
    limit: f64,
    budget: usize,
    mut ask: impl FnMut(&Direction) -> Asked,
) -> Option<Bounded> {
    let q = sides.len();
    let mut known: BTreeMap<Direction, f64> = BTreeMap::new();
    for (k, side) in sides.iter().enumerate() {
        known.insert(axis(q, k, 1), side[0]);
        known.insert(axis(q, k, -1), side[1]);
    }
    let at_root = corner(sides);
    if at_root <= limit {
        return Some(Bounded::Yes(known.into_keys().collect()));
    }
    if q > CUT {
        return Some(Bounded::No(at_root));
    }
    let mut open = BinaryHeap::new();
    for signs in 0..1_usize << q {
        let sign = |k: usize| if signs >> k & 1 == 1 { -1 } else { 1 };
        let directions: Vec<Direction> = (0..q).map(|k| axis(q, k, sign(k))).collect();
        let inverse = directions.clone();
        open.push(wedge(directions, inverse, &known));
    }
    let mut asked = 0;
    while let Some(worst) = open.pop() {
        if worst.bound <= limit {
            return Some(Bounded::Yes(known.into_keys().collect()));
        }
        let Some((i, j)) = widest(&worst.directions) else {
            return Some(Bounded::No(worst.bound));
        };
        let sum: Direction = worst.directions[i]
            .iter()
            .zip(&worst.directions[j])
            .map(|(a, b)| a + b)
            .collect();
        let too_long = sum.iter().any(|v| v.abs() > LONGEST);
        if !known.contains_key(&sum) {
            if asked == budget || too_long {
                return Some(Bounded::No(worst.bound));
            }
            asked += 1;
            match ask(&sum) {
                Asked::AtMost(value) => known.insert(sum.clone(), value),
                Asked::Stop => return None,
            };
        }
        // Replacing d_b by d_a + d_b is D ← (I + e_b e_aᵀ) D, and D⁻¹ ← D⁻¹ (I − e_b e_aᵀ): column a less column b.
        for (a, b) in [(i, j), (j, i)] {
            let mut directions = worst.directions.clone();
            directions[b].clone_from(&sum);
            let mut inverse = worst.inverse.clone();
            for row in &mut inverse {
                row[a] -= row[b];
            }
            open.push(wedge(directions, inverse, &known));
        }
    }
    Some(Bounded::Yes(known.into_keys().collect()))
}

fn wedge(
    directions: Vec<Direction>,
    inverse: Vec<Vec<i64>>,
    known: &BTreeMap<Direction, f64>,
) -> Wedge {
    let h: Vec<f64> = directions
        .iter()
        .map(|d| known.get(d).copied().unwrap_or(f64::INFINITY))
        .collect();
    let bound = inverse
        .iter()
        .map(|row| row.iter().zip(&h).map(|(i, h)| *i as f64 * h).sum::<f64>())
        .fold(0.0_f64, f64::hypot);
    Wedge {
        bound: if bound.is_nan() { f64::INFINITY } else { bound },
        directions,
        inverse,
    }
}

/// The two directions with the widest angle; `None` when there is only one.
fn widest(directions: &[Direction]) -> Option<(usize, usize)> {
    let dot = |a: &Direction, b: &Direction| -> f64 {
        a.iter().zip(b).map(|(x, y)| (x * y) as f64).sum()
    };
    let mut best: Option<(f64, (usize, usize))> = None;
    for i in 0..directions.len() {
        for j in i + 1..directions.len() {
            let (a, b) = (&directions[i], &directions[j]);
            let cosine = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt();
            if best.is_none_or(|b| cosine < b.0) {
                best = Some((cosine, (i, j)));
            }
        }
    }
    best.map(|b| b.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Supports of an ellipsoid {v : ‖S⁻¹ v‖ ≤ 1} are ‖Sᵀd‖; its largest norm is the largest singular value of S.
    fn ask(s: &[f64]) -> impl Fn(&Direction) -> f64 + '_ {
        move |d| {
            d.iter()
                .zip(s)
                .map(|(d, s)| *d as f64 * s)
                .fold(0.0, f64::hypot)
        }
    }

    #[test]
    fn balls_and_ellipsoids_are_bounded_as_they_should() {
        for s in [
            vec![0.97],
            vec![0.99, 0.2],
            vec![0.98, 0.98],
            vec![0.95, 0.95, 0.95],
            vec![0.8, 0.8, 0.8, 0.8],
        ] {
            let h = ask(&s);
            let q = s.len();
            let sides: Vec<[f64; 2]> = (0..q).map(|k| [h(&axis(q, k, 1)); 2]).collect();
            let found = is_within(&sides, 1.0, 4000, |d| Asked::AtMost(h(d)));
            assert!(matches!(found, Some(Bounded::Yes(_))), "{s:?}");
            // And what is larger than 1 is never called bounded.
            let large: Vec<f64> = s.iter().map(|v| v * 1.06).collect();
            let largest = large.iter().fold(0.0_f64, |a, v| a.max(*v));
            let h = ask(&large);
            let sides: Vec<[f64; 2]> = (0..q).map(|k| [h(&axis(q, k, 1)); 2]).collect();
            if largest > 1.0 {
                let found = is_within(&sides, 1.0, 500, |d| Asked::AtMost(h(d)));
                assert!(
                    matches!(found, Some(Bounded::No(b)) if b >= largest),
                    "{s:?}"
                );
            }
        }
    }

    #[test]
    fn beyond_four_dimensions_the_box_is_all() {
        let sides = vec![[0.5, 0.4]; 5];
        assert!(matches!(
            is_within(&sides, 1.0, 10, |_| Asked::Stop),
            Some(Bounded::No(b)) if (b - 0.5 * 5.0_f64.sqrt()).abs() < 1e-12
        ));
    }
}
