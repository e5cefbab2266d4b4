//! Proved bounds against closed forms.

use super::*;
use crate::optimization::Ball;

/// A unit disc and a half-plane.
fn cut_disc() -> Body {
    Body {
        rows: Dense::from_fn(1, 2, |_, j| if j == 0 { 1.0 } else { 0.0 }),
        bounds: vec![0.5],
        balls: vec![Ball {
            map: Dense::identity(2, 2),
            offset: vec![0.0; 2],
            radius: 1.0,
        }],
    }
}

#[test]
fn multipliers_prove_what_geometry_says() {
    let body = cut_disc();
    // max z_0 + z_1 is at (1/2, √3/2).
    let exact = 0.5 + 0.75_f64.sqrt();
    let value = body.support(&[1.0, 1.0], &[0.0; 2]).unwrap();
    let upper = proved(&body, &[1.0, 1.0], &value.multipliers);
    assert!(upper >= exact - 1e-14 && upper <= exact + 1e-8, "{upper}");
    // Worse multipliers prove less, never too little.
    for (y, w) in [
        (0.0, [1.0, 1.0]),
        (1.0, [0.0, 1.0]),
        (0.3, [0.2, 0.9]),
        (0.0, [0.0, 0.0]),
    ] {
        let multipliers = Multipliers {
            rows: vec![y],
            balls: vec![w.to_vec()],
        };
        assert!(
            proved(&body, &[1.0, 1.0], &multipliers) >= exact,
            "{y} {w:?}"
        );
    }
    for y in [-0.1, f64::NAN] {
        let multipliers = Multipliers {
            rows: vec![y],
            balls: vec![vec![1.0, 1.0]],
        };
        assert_eq!(proved(&body, &[1.0, 1.0], &multipliers), f64::INFINITY);
    }
}
