//! From a solution to what a step answers.

use super::Controller;
use crate::control::{Step, StepStatus, weighted_square};
use crate::optimization::add_product;
use crate::problem::Task;
use std::time::Duration;

impl Controller {
    /// Predictions and costs of z, from the plant itself.
    pub(super) fn describe(&self, x: &[f64], r: &[f64], z: &[f64]) -> Step {
        let problem = self.ingredients.problem();
        let plant = problem.plant();
        let (n, m, horizon) = (plant.states(), plant.inputs(), problem.prediction_horizon());
        let steady = self.ingredients.steady_states();
        let (xs, us) = match problem.task() {
            Task::Tracking => {
                let theta = &z[horizon * m..];
                (
                    steady.state_basis().mul_vec(theta),
                    steady.input_basis().mul_vec(theta),
                )
            }
            Task::Regulation => (vec![0.0; n], vec![0.0; m]),
        };
        let at = plant.operating_point();
        let minus =
            |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
        let physical =
            |v: &[f64], o: &[f64]| -> Vec<f64> { v.iter().zip(o).map(|(v, o)| v + o).collect() };
        let gain = self.ingredients.gain();
        let (mut states, mut inputs) =
            (Vec::with_capacity(horizon + 1), Vec::with_capacity(horizon));
        let (mut state, mut next, mut e) = (x.to_vec(), vec![0.0; n], minus(x, &xs));
        let (mut du, mut u) = (vec![0.0; m], vec![0.0; m]);
        let mut cost = 0.0;
        for c in z.chunks_exact(m).take(horizon) {
            for i in 0..m {
                du[i] = c[i] + gain.row_dot(i, &e);
                u[i] = du[i] + us[i];
            }
            cost += weighted_square(problem.state_weight(), &e)
                + weighted_square(problem.input_weight(), &du);
            for i in 0..n {
                next[i] = plant.a().row_dot(i, &state) + plant.b().row_dot(i, &u);
            }
            states.push(physical(&state, &at.state));
            inputs.push(physical(&u, &at.input));
            std::mem::swap(&mut state, &mut next);
            for ((e, x), s) in e.iter_mut().zip(&state).zip(&xs) {
                *e = x - s;
            }
        }
        states.push(physical(&state, &at.state));
        cost += weighted_square(self.ingredients.terminal_weight(), &e);
        if let Some(extra) = &self.extra {
            for _ in 0..extra.steps {
                next.fill(0.0);
                add_product(&mut next, &self.ingredients.law().closed_loop, &e, 1.0);
                std::mem::swap(&mut e, &mut next);
            }
            next.fill(0.0);
            add_product(&mut next, &extra.weight, &e, 1.0);
            cost += e.iter().zip(&next).map(|(a, b)| a * b).sum::<f64>();
        }
        let offset_cost = match problem.task() {
            Task::Tracking => {
                weighted_square(problem.offset_weight(), &minus(&xs, &r[..n]))
                    + weighted_square(problem.offset_input_weight(), &minus(&us, &r[n..]))
            }
            Task::Regulation => 0.0,
        };
        Step {
            input: inputs[0].clone(),
            artificial_state: physical(&xs, &at.state),
            artificial_input: physical(&us, &at.input),
            cost: cost + offset_cost,
            offset_cost,
            admissible: false,
            predicted_states: states,
            predicted_inputs: inputs,
            status: StepStatus::Optimal,
            violation: 0.0,
            iterations: 0,
            elapsed: Duration::ZERO,
        }
    }
}
