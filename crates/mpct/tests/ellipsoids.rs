use mpct::*;

fn plant() -> Plant {
    Plant::discrete(
        Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
        Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
    )
    .unwrap()
}
#[test]
fn explore() {
    for scaling in [0.99, 0.9, 0.7, 0.5] {
        let problem = |c: Constraints| {
            Problem::new(plant(), c, Weights::new(10.0, 100.0, 1e4)).unwrap().with_scaling(scaling).unwrap()
        };
        let design = |c: Constraints| {
            let t = std::time::Instant::now();
            let d = TerminalIngredients::design(&problem(c), &DesignOptions::default()).unwrap();
            println!("λ {scaling} M {} minimal {} programs {} {:?}", d.terminal_horizon(), d.is_minimal(), d.linear_programs(), t.elapsed());
            d
        };
        let d = design(Constraints::new(2, 2).state_ellipsoid(1.0 / 9.0).unwrap().input_ellipsoid(0.25).unwrap());
        let mut controller = Controller::new(d).unwrap();
        println!("{controller:?} {} cones", controller.cones());
        let sim = Simulation { initial_state: vec![-2.0, 2.0], steps: 120, disturbance: None, set_points: vec![
            ScheduledSetPoint { from_step: 0, set_point: SetPoint::state([2.0, 0.5]) },
            ScheduledSetPoint { from_step: 40, set_point: SetPoint::state([-5.0, 0.1]) },
            ScheduledSetPoint { from_step: 80, set_point: SetPoint::state([0.0, 0.0]) },
        ] };
        let run = simulate(&mut controller, &sim, None).unwrap();
        for k in [0, 1, 2, 39, 40, 41, 79, 80, 119] { let s = &run.steps[k]; println!("{k} x {:?} u {:?} a {:?} cost {:.6} adm {} {} it {}", s.x, s.u, s.artificial_state, s.cost, s.admissible, s.status, s.iterations); }
        println!("worst {:e} mean {:e} max {:e}", run.summary.worst_violation, run.summary.mean_solve_seconds, run.summary.max_solve_seconds);
        for k in [8, 32, 64] {
            for outer in [false, true] {
            let poly = |r: f64| -> (Matrix, Vec<f64>) {
                let rows: Vec<Vec<f64>> = (0..k).map(|i| { let a = i as f64 / k as f64 * std::f64::consts::TAU; vec![a.cos(), a.sin()] }).collect();
                (Matrix::from_vecs("p", &rows).unwrap(), vec![if outer { r } else { r * (std::f64::consts::PI / k as f64).cos() }; k])
            };
            let (c, d) = poly(3.0);
            let (cu, du) = poly(2.0);
            let z = Matrix::zeros(k, 2);
            design(Constraints::new(2, 2).mixed(c, z.clone(), d).unwrap().mixed(z, cu, du).unwrap());
            }
        }
    }
}
