//! What a report is made of: plain data, so that it can be drawn and tested without a solver.

use mpct::analysis::SETTLED;

/// A state or an input: its name, its unit when known, its bounds (±∞ for none).
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Its name.
    pub name: String,
    /// Its unit, when the problem states one.
    pub unit: Option<String>,
    /// Lower bound, −∞ for none.
    pub lower: f64,
    /// Upper bound, +∞ for none.
    pub upper: f64,
}

impl Signal {
    /// The name with its unit: "x1 (m)".
    pub fn title(&self) -> String {
        match &self.unit {
            Some(unit) => format!("{} ({unit})", self.name),
            None => self.name.clone(),
        }
    }
}

/// One step of the closed loop, in the coordinates of the problem file.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct StepRecord {
    pub x: Vec<f64>,
    pub u: Vec<f64>,
    pub artificial_state: Vec<f64>,
    pub artificial_input: Vec<f64>,
    pub set_point: Vec<f64>,
    pub cost: f64,
    pub offset_cost: f64,
    pub admissible: bool,
    pub status: String,
    pub iterations: usize,
    pub solve_seconds: f64,
}

/// What was designed, and how it was found.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct DesignNumbers {
    pub spectral_radius: f64,
    /// Largest entry of the residual of (3), relative to the largest entry of P, when it was computed.
    pub equation_3_residual: Option<f64>,
    /// "tracking" or "regulation".
    pub task: String,
    /// "implicit" or "explicit".
    pub formulation: String,
    /// M̄ and γ of section 3.5, when there is no terminal constraint: the guarantees are weaker then.
    pub extension: Option<(usize, f64)>,
    pub prediction_horizon: usize,
    pub terminal_horizon: usize,
    /// "exact" or "sufficient".
    pub condition: String,
    /// Whether one step less is shown to be too few; asked for with ellipsoids alone.
    pub minimal: bool,
    pub scaling: f64,
    pub linear_programs: usize,
    pub seconds: f64,
    pub constraint_rows: usize,
    pub ellipsoids: usize,
    /// Q, R and O in words.
    pub weights: String,
    /// The first step at which each constraint row is spent, the row in words.
    pub spent: Vec<(String, usize)>,
    /// The margins of the design's proof, or why there is none; `None` when it was not made.
    pub certificate: Option<Result<CertificateNumbers, String>>,
    /// Without terminal constraint: where each change of the set-point found the state, by its step.
    pub regions: Vec<Region>,
}

/// What the checker of certificates found.
#[derive(Clone, Debug, PartialEq)]
pub struct CertificateNumbers {
    /// Smallest of 1 − support/bound over the rows.
    pub smallest_margin: f64,
    pub tightest_row: String,
    /// Rows and ellipsoids.
    pub rows: usize,
    /// How many of them are ellipsoids.
    pub ellipsoids: usize,
    pub rows_to_tolerance: usize,
    pub lyapunov_residual: f64,
    /// By how much one step less breaks a bound.
    pub witness: Option<f64>,
}

/// A step, and where its state lies in the stability region of its set-point; or why there is no region.
pub type Region = (usize, Result<RegionNumbers, String>);

impl RegionNumbers {
    pub fn is_inside(&self) -> bool {
        self.cost <= self.level
    }
}

/// A state and the stability region of its set-point.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionNumbers {
    pub alpha: f64,
    pub scope: String,
    /// V* − V°.
    pub cost: f64,
    pub level: f64,
}

/// A closed loop and the design behind it.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ReportData {
    pub name: String,
    pub states: Vec<Signal>,
    pub inputs: Vec<Signal>,
    /// Seconds; steps are the unit of time when it is not known.
    pub sampling_time: Option<f64>,
    /// The model was continuous and discretised with a zero-order hold.
    pub continuous: bool,
    pub design: DesignNumbers,
    pub steps: Vec<StepRecord>,
    /// The state after the last input; empty when not known.
    pub final_state: Vec<f64>,
    /// Vcc of section 4.1.
    pub cumulative_cost: f64,
    /// Largest violation of a constraint row in its own unit; 0 for none.
    pub worst_violation: f64,
    /// A disturbance acted: the cost need not decrease.
    pub disturbed: bool,
}

/// The steps between two changes of the set-point.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// First step.
    pub from: usize,
    /// One past the last step.
    pub to: usize,
    pub admissible: bool,
    pub offset_cost: f64,
    /// Largest |x − x_s^a| at the last step, over the states.
    pub distance: f64,
    /// Steps until the state stays within 2 % of its largest distance from the last artificial set-point; `None` when it
    /// does not.
    pub settled_after: Option<usize>,
    /// Largest rise of the cost from one step to the next, relative to the cost at the beginning.
    pub largest_rise: f64,
}

/// Distances below this count as none, as in [`mpct::analysis::Performance`], whose settling times these are.
const AT_REST: f64 = 1e-9;

impl ReportData {
    /// Seconds a step takes, or 1 when time is counted in steps.
    pub fn step_length(&self) -> f64 {
        self.sampling_time
            .filter(|t| t.is_finite() && *t > 0.0)
            .unwrap_or(1.0)
    }

    /// "s" or "steps".
    pub fn time_unit(&self) -> &'static str {
        match self.sampling_time {
            Some(t) if t.is_finite() && t > 0.0 => "s",
            _ => "steps",
        }
    }

    /// The name of the time axis.
    pub fn time_title(&self) -> &'static str {
        match self.time_unit() {
            "s" => "time (s)",
            _ => "step",
        }
    }

    /// The steps at which the set-point changes, the first step among them.
    pub fn changes(&self) -> Vec<usize> {
        let differ = |a: &[f64], b: &[f64]| {
            a.len() != b.len() || a.iter().zip(b).any(|(p, q)| p.to_bits() != q.to_bits())
        };
        (0..self.steps.len())
            .filter(|&k| k == 0 || differ(&self.steps[k].set_point, &self.steps[k - 1].set_point))
            .collect()
    }

    /// The closed loop, one set-point after the other.
    pub fn segments(&self) -> Vec<Segment> {
        let changes = self.changes();
        (0..changes.len())
            .map(|i| {
                let to = changes.get(i + 1).copied().unwrap_or(self.steps.len());
                self.segment(changes[i], to)
            })
            .collect()
    }

    fn segment(&self, from: usize, to: usize) -> Segment {
        let steps = &self.steps[from..to];
        let last = &steps[steps.len() - 1];
        let away = |s: &StepRecord| distance(&s.x, &last.artificial_state);
        let way = steps.iter().map(away).fold(0.0, f64::max);
        let near = (SETTLED * way).max(AT_REST);
        let unsettled = steps.iter().rposition(|s| !(away(s) <= near));
        let settled = unsettled.map_or(0, |k| k + 1);
        let rise = steps
            .windows(2)
            .map(|w| w[1].cost - w[0].cost)
            .fold(0.0, f64::max);
        Segment {
            from,
            to,
            admissible: steps.iter().all(|s| s.admissible),
            offset_cost: last.offset_cost,
            distance: largest_distance(&last.x, &last.artificial_state),
            settled_after: (settled < steps.len()).then_some(settled),
            largest_rise: if rise > 0.0 {
                rise / steps[0].cost.abs().max(f64::MIN_POSITIVE)
            } else {
                0.0
            },
        }
    }

    /// Solve times that are numbers, ascending.
    pub fn solve_times(&self) -> Vec<f64> {
        let mut times: Vec<f64> = self
            .steps
            .iter()
            .map(|s| s.solve_seconds)
            .filter(|t| t.is_finite() && *t >= 0.0)
            .collect();
        times.sort_by(f64::total_cmp);
        times
    }
}

/// ‖a − b‖; NaN when there is no entry.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    if a.is_empty() || b.is_empty() {
        return f64::NAN;
    }
    let squares: f64 = a.iter().zip(b).map(|(p, q)| (p - q).powi(2)).sum();
    squares.sqrt()
}

/// Largest |a − b| over the entries; NaN when there is none.
fn largest_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(p, q)| (p - q).abs())
        .fold(f64::NAN, f64::max)
}

/// Entry `q` (in [0, 1]) of ascending values, the nearest one; NaN when there is none.
pub fn quantile(ascending: &[f64], q: f64) -> f64 {
    if ascending.is_empty() {
        return f64::NAN;
    }
    let i = ((ascending.len() - 1) as f64 * q).round() as usize;
    ascending[i.min(ascending.len() - 1)]
}
