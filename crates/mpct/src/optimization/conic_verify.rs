//! Checks of answers to programs with second-order cones, from the data alone. Nothing here calls, or is called by, a
//! solver.
//!
//! min ½ zᵀHz + fᵀz subject to G z ≤ b and ‖T_k z + t_k‖ ≤ ρ_k. With ‖v‖ ≤ ρ written as max over w of wᵀv − ‖w‖ρ ≤ 0, the optimum
//! is where H z + f + Gᵀy + Σ T_kᵀw_k = 0, y ≥ 0, yᵀ(b − G z) = 0 and ‖w_k‖ρ_k = w_kᵀ(T_k z + t_k).

use super::body::{add_product, dot, norm};
use super::verify::{self, Farkas, Residuals};
use crate::linalg::Dense;

/// ‖T z + t‖ ≤ ρ.
#[derive(Clone, Copy)]
pub(crate) struct Cone<'a> {
    pub(crate) map: &'a Dense,
    pub(crate) offset: &'a [f64],
    pub(crate) radius: f64,
}

impl Cone<'_> {
    pub(crate) fn at(&self, z: &[f64]) -> Vec<f64> {
        let mut v = self.offset.to_vec();
        add_product(&mut v, self.map, z, 1.0);
        v
    }
}

/// out += Tᵀw.
fn add_transposed(out: &mut [f64], map: &Dense, w: &[f64]) {
    for (j, o) in out.iter_mut().enumerate() {
        *o += map.col(j).iter().zip(w).map(|(a, b)| a * b).sum::<f64>();
    }
}

/// Largest violation of a row or cone, at least 0; NaN counts as infinite.
pub(crate) fn violation(g: &Dense, b: &[f64], cones: &[Cone<'_>], z: &[f64]) -> f64 {
    let mut over: Vec<f64> = b.iter().map(|b| -b).collect();
    add_product(&mut over, g, z, 1.0);
    over.extend(cones.iter().map(|c| norm(&c.at(z)) - c.radius));
    over.iter().fold(
        0.0,
        |a, &v| if v.is_nan() { f64::INFINITY } else { a.max(v) },
    )
}

/// Residuals of (z, y, w).
#[allow(clippy::too_many_arguments)]
pub(crate) fn residuals(
    h: &Dense,
    f: &[f64],
    g: &Dense,
    b: &[f64],
    cones: &[Cone<'_>],
    z: &[f64],
    y: &[f64],
    w: &[Vec<f64>],
) -> Residuals {
    // The cones enter the conditions as a linear term Tᵀw, which is taken into f; the rest is as without cones.
    let mut with_cones = f.to_vec();
    let mut size = vec![0.0_f64; f.len()];
    for (cone, w) in cones.iter().zip(w) {
        let mut term = vec![0.0; f.len()];
        add_transposed(&mut term, cone.map, w);
        for ((f, s), t) in with_cones.iter_mut().zip(&mut size).zip(&term) {
            *f += t;
            *s = s.max(t.abs());
        }
    }
    let plain = verify::residuals(h, &with_cones, g, b, z, y);
    let objective: f64 = {
        let mut hz = vec![0.0; z.len()];
        add_product(&mut hz, h, z, 0.5);
        dot(z, &hz) + dot(z, f)
    };
    // Its gap is relative to an objective with the cones' term in it.
    let of_cones = dot(z, &with_cones) - dot(z, f);
    let mut gap = plain.gap * (1.0 + (objective + of_cones).abs());
    for (cone, w) in cones.iter().zip(w) {
        gap += (norm(w) * cone.radius - dot(w, &cone.at(z))).abs();
    }
    Residuals {
        primal: violation(g, b, cones, z).max(plain.primal),
        gap: gap / (1.0 + objective.abs()),
        ..plain
    }
}

/// A proof that no z with ‖z‖₁ below a radius satisfies rows and cones: every solution would satisfy
/// 0 ≤ yᵀ(b − G z) + Σ ‖w‖ρ − wᵀ(T z + t) ≤ bᵀy + Σ (‖w‖ρ − wᵀt) + ‖Gᵀy + Σ Tᵀw‖∞ ‖z‖₁.
pub(crate) fn farkas(
    g: &Dense,
    b: &[f64],
    cones: &[Cone<'_>],
    y: &[f64],
    w: &[Vec<f64>],
) -> Option<Farkas> {
    let y: Vec<f64> = y.iter().map(|v| v.max(0.0)).collect();
    let total = y.iter().sum::<f64>() + w.iter().map(|w| norm(w)).sum::<f64>();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    let mut value = dot(b, &y);
    let mut leak = vec![0.0; g.ncols()];
    add_transposed(&mut leak, g, &y);
    for (cone, w) in cones.iter().zip(w) {
        value += norm(w) * cone.radius - dot(w, cone.offset);
        add_transposed(&mut leak, cone.map, w);
    }
    let gap = -value / total;
    let leak = leak.iter().fold(0.0_f64, |a, v| a.max(v.abs())) / total;
    let radius = if leak > 0.0 {
        gap / leak
    } else {
        f64::INFINITY
    };
    (gap > 0.0 && !radius.is_nan()).then_some(Farkas { gap, radius })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_projection_on_a_disc_passes_and_its_neighbours_do_not() {
        // min ½‖z‖² − (3, 4)·z over the unit disc: z = (0.6, 0.8), w = 4 z.
        let (h, g) = (Dense::identity(2, 2), Dense::zeros(0, 2));
        let (map, offset) = (Dense::identity(2, 2), [0.0; 2]);
        let cones = [Cone {
            map: &map,
            offset: &offset,
            radius: 1.0,
        }];
        let of = |z: [f64; 2], w: [f64; 2]| {
            residuals(&h, &[-3.0, -4.0], &g, &[], &cones, &z, &[], &[w.to_vec()])
        };
        assert!(of([0.6, 0.8], [2.4, 3.2]).within(1e-14));
        for (z, w) in [
            ([0.61, 0.8], [2.4, 3.2]),
            ([0.6, 0.8], [2.5, 3.2]),
            ([0.59, 0.8], [2.41, 3.2]),
            ([0.6, f64::NAN], [2.4, 3.2]),
        ] {
            assert!(!of(z, w).within(1e-3), "{z:?} {w:?}");
        }
    }

    #[test]
    fn a_disc_that_a_row_misses_is_proved_empty() {
        let (map, offset) = (Dense::identity(2, 2), [0.0; 2]);
        let cones = [Cone {
            map: &map,
            offset: &offset,
            radius: 1.0,
        }];
        // x ≥ 1.5.
        let g = Dense::from_fn(1, 2, |_, j| if j == 0 { -1.0 } else { 0.0 });
        let proof = farkas(&g, &[-1.5], &cones, &[1.0], &[vec![1.0, 0.0]]).unwrap();
        assert!((proof.gap - 0.25).abs() < 1e-15 && proof.radius == f64::INFINITY);
        // x ≥ 0.5 cuts the disc: the same multipliers prove nothing.
        assert!(farkas(&g, &[-0.5], &cones, &[1.0], &[vec![1.0, 0.0]]).is_none());
    }
}
