//! `mpct scaling`: the smallest scaling that admits the set-points of a file, and the terminal horizon it costs.

use crate::arguments::Scaling;
use crate::commands::{headline, read, vector};
use crate::failure::{Class, Failure};
use crate::output::{print, print_json};
use mpct::analysis::{ScalingAdvice, scaling_advice};
use mpct::{DesignOptions, SetPoint};
use serde_json::json;
use std::fmt::Write;

pub fn run(arguments: &Scaling) -> Result<(), Failure> {
    let file = read(&arguments.file)?;
    let set_points: Vec<SetPoint> = if arguments.set_point.is_empty() {
        let simulation = file.simulation.as_ref().ok_or_else(|| {
            Failure::new(Class::Input, "the file has no set-points")
                .help("state them in [[simulation.setpoint]], or with --set-point 1.0,0.5")
                .in_file(&arguments.file)
        })?;
        simulation
            .set_points
            .iter()
            .map(|s| s.set_point.clone())
            .collect()
    } else {
        arguments
            .set_point
            .iter()
            .map(|s| SetPoint::state(s.0.clone()))
            .collect()
    };
    let advice = scaling_advice(&file.problem, &set_points, &DesignOptions::default())
        .map_err(|e| Failure::from(e).in_file(&arguments.file))?;
    if arguments.json {
        return print_json(&json!(advice));
    }
    print(&(headline(&file.problem) + "\n" + &text(&advice)))
}

fn text(advice: &ScalingAdvice) -> String {
    let mut text = String::new();
    for (k, need) in advice.needs.iter().enumerate() {
        let _ = writeln!(text, "  set-point {k}: {}", vector(&need.set_point.state));
        let rows: Vec<String> = need
            .limiting
            .iter()
            .take(4)
            .map(ToString::to_string)
            .collect();
        let verdict = if !need.equilibrium {
            "no equilibrium of the plant: no scaling admits it".to_string()
        } else if !need.is_attainable() {
            format!(
                "needs a scaling of {:.6}: on or beyond {}, no scaling admits it",
                need.needed,
                rows.join(", ")
            )
        } else if need.grow_by > 0.0 {
            format!(
                "needs a scaling of {:.6}, {:.6} more than now; limited by {}",
                need.needed,
                need.grow_by,
                rows.join(", ")
            )
        } else {
            format!("admissible; needs a scaling of {:.6}", need.needed)
        };
        let _ = writeln!(text, "    {verdict}");
        if !need.closest.admissible {
            let _ = writeln!(
                text,
                "    closest admissible now: {}",
                vector(&need.closest.state)
            );
        }
    }
    let _ = writeln!(
        text,
        "  scaling now            {} with terminal horizon {}\n  smallest that admits   {:.6} with terminal horizon {}",
        advice.scaling, advice.terminal_horizon, advice.advised, advice.advised_horizon
    );
    text
}
