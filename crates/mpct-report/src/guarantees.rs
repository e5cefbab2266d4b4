//! What is guaranteed for a closed loop, and the numbers that the guarantees rest on.

use super::axis::{duration, number};
use super::data::{CertificateNumbers, RegionNumbers, ReportData};
use super::page::count;
use super::svg::escape;
use super::tables::rows;
use mpct::analysis::{AlphaScope, StabilityRegion};
use mpct::certificate::{Certificate, VerifyOptions, verify};
use mpct::{Controller, Formulation, Run, SetPoint};

/// Beyond this many states the report does not wait for a certificate; `mpct design --certificate` writes one.
const CERTIFIED: usize = 400;
/// Beyond this many variables of the program the stability region is not examined.
const EXAMINED: usize = 200;

impl ReportData {
    /// Adds what needs a controller: the margins of the design's proof, checked by the code of `mpct verify`; and without
    /// terminal constraint, whether the states at which set-points change lie in the stability region.
    pub fn with_proofs(mut self, controller: &Controller, run: &Run) -> Self {
        let ingredients = controller.ingredients();
        if ingredients.problem().plant().states() <= CERTIFIED {
            let checked = Certificate::of(ingredients)
                .map_err(|e| e.to_string())
                .and_then(|c| {
                    verify(&c.to_json(), VerifyOptions::default()).map_err(|e| e.to_string())
                });
            self.design.certificate = Some(checked.map(|v| CertificateNumbers {
                smallest_margin: v.smallest_margin,
                tightest_row: named(&v.tightest_row, &self),
                rows: v.rows_rigorous + v.rows_to_tolerance,
                ellipsoids: v.ellipsoids,
                rows_to_tolerance: v.rows_to_tolerance,
                lyapunov_residual: v.lyapunov_residual,
                witness: v.witness,
            }));
        }
        if controller.formulation() == Formulation::NoTerminalConstraint
            && controller.variables() <= EXAMINED
        {
            self.design.regions = self
                .changes()
                .into_iter()
                .map(|k| {
                    (
                        k,
                        examined(controller, &run.steps[k].x, &run.steps[k].setpoint),
                    )
                })
                .collect();
        }
        self
    }
}

/// Whether a state lies in the stability region of a set-point.
fn examined(
    controller: &Controller,
    state: &[f64],
    set_point: &[f64],
) -> Result<RegionNumbers, String> {
    let set_point = SetPoint::state(set_point);
    // The widest scope that proves convergence.
    let region = StabilityRegion::of(controller, &set_point, AlphaScope::ThroughoutRegion)
        .map_err(|e| e.to_string())?;
    let found = region.contains(state).map_err(|e| e.to_string())?;
    Ok(RegionNumbers {
        alpha: region.alpha(),
        scope: region.scope().to_string(),
        cost: found.cost,
        level: found.level,
    })
}

/// "state 2" by its name.
fn named(row: &str, data: &ReportData) -> String {
    let find = |prefix: &str, signals: &[super::data::Signal]| {
        let i: usize = row.strip_prefix(prefix)?.parse().ok()?;
        signals.get(i).map(|s| s.name.clone())
    };
    find("state ", &data.states)
        .or_else(|| find("input ", &data.inputs))
        .unwrap_or_else(|| row.into())
}

/// What is guaranteed, and the numbers it rests on.
pub fn guarantees(data: &ReportData) -> String {
    let d = &data.design;
    let regulation = d.task == "regulation";
    let rho = d.spectral_radius;
    let slow = if rho > 0.0 && rho < 1.0 {
        format!(
            "; the slowest mode of the terminal law has a time constant of {} {}",
            number(-data.step_length() / rho.ln()),
            data.time_unit()
        )
    } else {
        String::new()
    };
    let (symbol, reference) = if regulation {
        ("M", "(20)")
    } else {
        ("M̃", "(29)")
    };
    let form = match d.condition.as_str() {
        _ if d.ellipsoids > 0 && d.minimal => {
            "shown to be the smallest with ellipsoids: a point refutes one step less"
        }
        _ if d.ellipsoids > 0 => {
            "sufficient: the smallest for which proofs were found with ellipsoids"
        }
        "exact" => "first form, exact: the smallest integer for which the set is invariant",
        "sufficient" => "second form, sufficient: the exact horizon may be shorter",
        other => other,
    };
    let mut pairs = vec![
        (
            "A + B K is Schur",
            format!(
                "spectral radius {}, margin {}{slow}",
                number(rho),
                number(1.0 - rho)
            ),
        ),
        (
            "P solves (3)",
            match d.equation_3_residual {
                Some(r) => format!("largest residual {} of the largest entry of P", number(r)),
                None => "residual not computed for this report".into(),
            },
        ),
        (
            "Terminal horizon",
            format!(
                "{symbol} = {} by {reference}, {}; {} in {}",
                d.terminal_horizon,
                escape(form),
                count(
                    d.linear_programs,
                    if d.ellipsoids > 0 {
                        "linear or second-order cone program"
                    } else {
                        "linear program"
                    }
                ),
                duration(d.seconds)
            ),
        ),
    ];
    if !regulation {
        pairs.push((
            "Scaling",
            format!(
                "λ = {}: artificial set-points keep {} % of the room of every constraint",
                number(d.scaling),
                number(100.0 * (1.0 - d.scaling))
            ),
        ));
    }
    if let Some((steps, gamma)) = d.extension {
        pairs.push((
            "No terminal constraint",
            format!(
                "the terminal law runs for M̄ = {steps} more steps, and the terminal cost is multiplied by γ = {} (35); {symbol} above is not imposed",
                number(gamma)
            ),
        ));
    }
    pairs.extend(proof(data));
    pairs.push((
        "It follows",
        match (d.extension, regulation) {
            (Some(_), _) => "states in the stability region Υ of their set-point stay feasible and converge (section 3.5); outside of it nothing is proved",
            (None, true) => "a state that is feasible once stays feasible, and converges to the origin of the model",
            (None, false) => "a state that is feasible once stays feasible for every set-point (Theorem 3), and converges to an admissible one (Theorem 4)",
        }
        .into(),
    ));
    rows(&pairs)
}

/// The margins of the proof.
fn proof(data: &ReportData) -> Vec<(&'static str, String)> {
    let mut pairs = Vec::new();
    match &data.design.certificate {
        None => {}
        Some(Err(why)) => pairs.push((
            "Proof",
            format!(
                "<span class=\"no\">no certificate passes its check</span>: {}",
                escape(why)
            ),
        )),
        Some(Ok(c)) => {
            let tolerance = match c.rows_to_tolerance {
                0 => String::new(),
                n => format!("; {n} of them to a tolerance only"),
            };
            pairs.push((
                "Proof",
                format!(
                    "{}{} implied by the steps before, with bounds on every rounding error{tolerance}; smallest margin {} of a bound ({}); x\u{1d40}Px falls in every step by the stage cost to within {} of it",
                    count(c.rows.saturating_sub(c.ellipsoids), "row"),
                    match c.ellipsoids {
                        0 => String::new(),
                        k => format!(" and {}", count(k, "ellipsoid")),
                    },
                    number(c.smallest_margin),
                    escape(&c.tightest_row),
                    number(c.lyapunov_residual)
                ),
            ));
            if let Some(beyond) = c.witness {
                pairs.push((
                    "One step less",
                    format!(
                        "is too few: a point that satisfies it breaks a constraint by {} of its bound",
                        number(beyond)
                    ),
                ));
            }
        }
    }
    for (k, region) in &data.design.regions {
        let at = format!(
            "at {} {}",
            number(*k as f64 * data.step_length()),
            data.time_unit()
        );
        let words = match region {
            Err(why) => format!("{at}: not examined, {}", escape(why)),
            Ok(r) if r.is_inside() => format!(
                "{at} the state is in \u{3a5}: V* \u{2212} V\u{b0} = {} \u{2264} {} (\u{3b1} = {}, admissible for {})",
                number(r.cost),
                number(r.level),
                number(r.alpha),
                r.scope
            ),
            Ok(r) => format!(
                "<span class=\"no\">{at} the state is not in \u{3a5}</span>: V* \u{2212} V\u{b0} = {} > {} (\u{3b1} = {}, admissible for {}); nothing is proved for this set-point from there",
                number(r.cost),
                number(r.level),
                number(r.alpha),
                r.scope
            ),
        };
        pairs.push(("Stability region", words.replace(" > ", " &gt; ")));
    }
    pairs
}
