//! The banded regime against the dense one.

use super::online::Limits;
use super::regime::Regime;
use crate::terminal::{DesignOptions, TerminalIngredients};

/// Closed loop of a chain of carts; the largest difference of z between the regimes.
fn compare(carts: usize, steps: usize, period: usize) {
    let problem = crate::cases::carts(carts).unwrap().problem;
    let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default()).unwrap();
    let formulation = problem.formulation();
    let t = std::time::Instant::now();
    let mut banded = Regime::new(&ingredients, formulation).unwrap().solver;
    eprintln!("banded built in {:?}", t.elapsed());
    assert!(matches!(banded, Regime::Banded(_)));
    let with_dense = carts <= 50;
    let mut dense = with_dense.then(|| Regime::dense(&ingredients, formulation).unwrap().solver);
    let (n, m) = (problem.plant().states(), problem.plant().inputs());
    let steady = ingredients.steady_states();
    let gain = ingredients.gain();
    let mut seed = 7_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let mut x = vec![0.0; n];
    let mut r = vec![0.0; n + m];
    let (mut worst, mut times, mut iterations) = (0.0_f64, Vec::new(), Vec::new());
    for k in 0..steps {
        if k % period == 0 {
            for cart in 0..carts {
                r[2 * cart] = 3.0 * random();
            }
        }
        let t = std::time::Instant::now();
        let own = banded.solve(&x, &r, Limits::default()).unwrap_or_else(|e| panic!("step {k}: {e:?}"));
        times.push(t.elapsed().as_secs_f64());
        iterations.push(own.iterations);
        assert!(own.optimal);
        if let Some(dense) = &mut dense {
            let other = dense.solve(&x, &r, Limits::default()).unwrap();
            for (a, b) in own.z.iter().zip(&other.z) {
                worst = worst.max((a - b).abs());
            }
        }
        let theta = &own.z[own.z.len() - m..];
        let (xs, us) = (steady.state_basis().mul_vec(theta), steady.input_basis().mul_vec(theta));
        let e: Vec<f64> = x.iter().zip(&xs).map(|(a, b)| a - b).collect();
        let mut u = gain.mul_vec(&e);
        for i in 0..m {
            u[i] += us[i] + own.z[i];
        }
        let (ax, bu) = (problem.plant().a().mul_vec(&x), problem.plant().b().mul_vec(&u));
        x = ax.iter().zip(&bu).map(|(a, b)| a + b).collect();
    }
    let jumps: Vec<String> = times.iter().step_by(period).zip(iterations.iter().step_by(period)).map(|(t, i)| format!("{:.2}ms/{i}", 1e3 * t)).collect();
    let quiet: Vec<f64> = (0..steps).filter(|k| k % period != 0).map(|k| times[k]).collect();
    let its: f64 = (0..steps).filter(|k| k % period != 0).map(|k| iterations[k] as f64).sum::<f64>() / quiet.len() as f64;
    eprintln!("{carts} carts: worst difference {worst:.1e}; jumps {jumps:?}; quiet mean {:.3} ms, its {its:.1}, max {:.3} ms; mean {:.3} ms",
        1e3 * quiet.iter().sum::<f64>() / quiet.len() as f64, 1e3 * quiet.iter().fold(0.0_f64, |a, &b| a.max(b)), 1e3 * times.iter().sum::<f64>() / times.len() as f64);
    assert!(worst < 1e-6);
}

#[test]
fn experiment() {
    for carts in std::env::var("CARTS").unwrap_or("25".into()).split(',') {
        compare(carts.parse().unwrap(), 160, 80);
    }
}
