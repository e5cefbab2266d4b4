//! The command line.

use clap::{Args, Parser, Subcommand, ValueEnum};
use mpct::Condition;
use std::path::PathBuf;

/// Model predictive control for tracking: design, simulate and analyse controllers.
#[derive(Debug, Parser)]
#[command(name = "mpct", version, about, max_term_width = 100)]
#[command(after_help = "\
Exit codes: 0 done; 2 bad file or arguments; 3 an assumption fails; 4 terminal horizon not determined; \
5 infeasible; 6 solver failure; 7 input/output; 130 Ctrl-C.

Start with: mpct example academic > academic.toml && mpct simulate academic.toml")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Read a problem file and check everything that can be checked without a design
    Check(Check),
    /// Compute the gain, the terminal cost, the steady states and the terminal horizon
    Design(Design),
    /// Check a certificate with code that shares nothing with the search
    Verify(Verify),
    /// Design the controller and run its closed loop; writes a report (HTML) and the trajectories (CSV)
    Simulate(Simulate),
    /// Design and simulate for several scalings of the steady states
    Sweep(Sweep),
    /// The smallest scaling that admits the set-points of a file, and the terminal horizon it costs
    Scaling(Scaling),
    /// States in the domain of attraction: membership with proof, reach, outlines, areas
    Domain(Domain),
    /// Two problem files side by side: closed loops, costs, settling, margins, times
    Compare(Compare),
    /// Run section 4 of the paper: its tables and figures as one page and as data
    Reproduce(Reproduce),
    /// Print the problem file of a case study
    Example(Example),
}

#[derive(Debug, Args)]
pub struct Check {
    /// The problem file
    pub file: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// What limits the search for the terminal horizon.
#[derive(Debug, Args)]
pub struct Limits {
    /// Form of the condition: exact (shortest horizon) or sufficient
    #[arg(long, value_enum, default_value_t = Form::Exact)]
    pub condition: Form,
    /// Give up beyond this terminal horizon
    #[arg(long, value_name = "STEPS", default_value_t = mpct::terminal::DEFAULT_MAX_HORIZON, value_parser = at_least_one)]
    pub max_horizon: usize,
    /// Give up after this time
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub time_limit: Option<f64>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Form {
    Exact,
    Sufficient,
}

impl From<Form> for Condition {
    fn from(form: Form) -> Self {
        match form {
            Form::Exact => Self::Exact,
            Form::Sufficient => Self::Sufficient,
        }
    }
}

#[derive(Debug, Args)]
pub struct Design {
    /// The problem file
    pub file: PathBuf,
    #[command(flatten)]
    pub limits: Limits,
    /// Also compute the explicit terminal set without redundant rows
    #[arg(long)]
    pub explicit_set: bool,
    /// Also write a proof of the design, which `mpct verify` checks
    #[arg(long, value_name = "FILE")]
    pub certificate: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Verify {
    /// The certificate, written by `mpct design --certificate`
    pub file: PathBuf,
    /// Check the claim even when the digest does not fit the file
    #[arg(long)]
    pub ignore_digest: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Simulate {
    /// The problem file
    pub file: PathBuf,
    #[command(flatten)]
    pub limits: Limits,
    /// Where the report goes [default: the name of the file, .html, in this folder]
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Where the trajectories go [default: the name of the file, .csv, in this folder]
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Also draw some states and inputs as one picture: SVG, or PNG when the name ends in .png
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// States and inputs in the picture, by name, comma separated [default: the first four states and two inputs]
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "NAMES",
        requires = "picture"
    )]
    pub signals: Vec<String>,
    /// Write neither report nor trajectories, unless named
    #[arg(long)]
    pub no_files: bool,
    /// Simulate this many steps instead of the file's
    #[arg(long, value_name = "STEPS", value_parser = at_least_one)]
    pub steps: Option<usize>,
    /// Use this formulation instead of the file's
    #[arg(long, value_enum)]
    pub formulation: Option<Formulation>,
    /// Open the report with the program that shows web pages here
    #[arg(long)]
    pub open: bool,
    /// Print JSON; files are then written only when named
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Formulation {
    Implicit,
    Explicit,
    #[value(name = "no_terminal_constraint", alias = "no-terminal-constraint")]
    NoTerminalConstraint,
}

impl From<Formulation> for mpct::Formulation {
    fn from(f: Formulation) -> Self {
        match f {
            Formulation::Implicit => Self::Implicit,
            Formulation::Explicit => Self::Explicit,
            Formulation::NoTerminalConstraint => Self::NoTerminalConstraint,
        }
    }
}

#[derive(Debug, Args)]
pub struct Sweep {
    /// The problem file
    pub file: PathBuf,
    /// Scalings, comma separated
    #[arg(long, value_delimiter = ',', required = true, value_name = "NUMBERS")]
    pub scaling: Vec<f64>,
    #[command(flatten)]
    pub limits: Limits,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Scaling {
    /// The problem file
    pub file: PathBuf,
    /// A set-point's state, comma separated, instead of the file's; may be repeated
    #[arg(long, value_name = "NUMBERS", value_parser = numbers, allow_hyphen_values = true)]
    pub set_point: Vec<Numbers>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// A list of numbers in one argument.
#[derive(Clone, Debug)]
pub struct Numbers(pub Vec<f64>);

fn numbers(text: &str) -> Result<Numbers, String> {
    text.split(',')
        .map(|t| {
            t.trim()
                .parse::<f64>()
                .map_err(|_| format!("\"{t}\" is not a number"))
        })
        .collect::<Result<_, _>>()
        .map(Numbers)
}

#[derive(Debug, Args)]
pub struct Domain {
    /// The problem file
    pub file: PathBuf,
    #[command(flatten)]
    pub limits: Limits,
    /// Which set of states; may be repeated, to compare [default: that of the file's formulation]
    #[arg(long, value_enum, value_name = "SET")]
    pub set: Vec<Set>,
    /// Is this state in the set? Comma separated; may be repeated. Exit code 5 when one is outside
    #[arg(long, value_name = "NUMBERS", value_parser = numbers, allow_hyphen_values = true)]
    pub state: Vec<Numbers>,
    /// How far does the set reach in this direction? Comma separated; may be repeated
    #[arg(long, value_name = "NUMBERS", value_parser = numbers, allow_hyphen_values = true)]
    pub direction: Vec<Numbers>,
    /// Where the reach is measured from, and the state that a section of a domain goes through [default: the operating
    /// point; for the stability region its set-point]
    #[arg(long, value_name = "NUMBERS", value_parser = numbers, allow_hyphen_values = true)]
    pub from: Option<Numbers>,
    /// Project on two states, named or counted from 0: x1,x2 or 0,1
    #[arg(long, value_name = "I,J", conflicts_with = "section")]
    pub outline: Option<String>,
    /// Cut along two states, named or counted from 0; the others stay as they are in --from
    #[arg(long, value_name = "I,J")]
    pub section: Option<String>,
    /// Length, area or volume of the set, for up to three states
    #[arg(long)]
    pub volume: bool,
    /// The set-point of the stability region of section 3.5 [default: the file's first, or the operating point]
    #[arg(long, value_name = "NUMBERS", value_parser = numbers, allow_hyphen_values = true)]
    pub set_point: Option<Numbers>,
    /// For which artificial set-points the level alpha of section 3.5 has to be admissible
    #[arg(long, value_enum, default_value_t = Scope::EveryEquilibrium)]
    pub scope: Scope,
    /// Draw the outlines: SVG, or PNG when the name ends in .png
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// A set of states to ask about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Set {
    /// Where the implicit controller (30) is feasible
    Implicit,
    /// Where the explicit controller (9) is feasible; the same set
    Explicit,
    /// Where the controller that holds the operating point is feasible (section 3.1)
    Regulation,
    /// The stability region of section 3.5
    #[value(name = "stability_region", alias = "stability-region")]
    StabilityRegion,
    /// Where the controller without terminal constraint (35) is feasible
    #[value(name = "no_terminal_constraint", alias = "no-terminal-constraint")]
    NoTerminalConstraint,
}

/// For which artificial set-points alpha is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scope {
    /// Every admissible equilibrium
    #[value(name = "every_equilibrium", alias = "every-equilibrium")]
    EveryEquilibrium,
    /// Every artificial set-point that the region allows
    #[value(name = "throughout_region", alias = "throughout-region")]
    ThroughoutRegion,
    /// The set-point alone; no proof of convergence from elsewhere
    #[value(name = "around_set_point", alias = "around-set-point")]
    AroundSetPoint,
}

impl From<Scope> for mpct::analysis::AlphaScope {
    fn from(scope: Scope) -> Self {
        match scope {
            Scope::EveryEquilibrium => Self::EveryEquilibrium,
            Scope::ThroughoutRegion => Self::ThroughoutRegion,
            Scope::AroundSetPoint => Self::AroundSetPoint,
        }
    }
}

#[derive(Debug, Args)]
pub struct Compare {
    /// The first problem file
    pub first: PathBuf,
    /// The second problem file
    pub second: PathBuf,
    #[command(flatten)]
    pub limits: Limits,
    /// Simulate this many steps instead of the files'
    #[arg(long, value_name = "STEPS", value_parser = at_least_one)]
    pub steps: Option<usize>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Reproduce {
    /// The folder for the page and the data; made if it is missing
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// All sizes of the paper, up to 200 carts; takes long
    #[arg(long)]
    pub full: bool,
    /// A short form in seconds: three carts, fewer scalings
    #[arg(long, conflicts_with = "full")]
    pub short: bool,
    /// Also write each figure as a PNG file
    #[arg(long)]
    pub png: bool,
}

#[derive(Debug, Args)]
pub struct Example {
    /// The case study
    #[arg(value_enum)]
    pub case: Case,
    /// Number of carts
    #[arg(long, default_value_t = 10)]
    pub count: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Case {
    Academic,
    Carts,
    Drone,
}

fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if n >= 1 => Ok(n),
        _ => Err("expected a whole number >= 1".into()),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v.is_finite() => Ok(v),
        _ => Err("expected a number of seconds > 0".into()),
    }
}
