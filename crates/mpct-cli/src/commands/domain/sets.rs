//! A set of states, the questions, and its answers.

use crate::arguments::Set;
use mpct::DesignError;
use mpct::analysis::{
    Attraction, DomainOfAttraction, Membership, Polygon, Reach, StabilityRegion, Volume,
};

/// A set of states, ready for questions: the stability region where there is one, else the feasible states.
pub struct Asked<'a> {
    pub feasible: DomainOfAttraction,
    pub region: Option<StabilityRegion<'a>>,
}

/// Whether a state is inside, with what proves it.
pub enum Answer {
    Domain(Membership),
    Region(Attraction),
    /// (35) has no feasible point at the state.
    Infeasible(Membership),
}

/// A plane of two states, and whether it is projected on or cut along.
#[derive(Clone, Copy)]
pub enum View {
    Projection(usize, usize),
    Section(usize, usize),
}

/// What is asked of every set.
pub struct Questions {
    pub states: Vec<Vec<f64>>,
    pub directions: Vec<Vec<f64>>,
    pub from: Option<Vec<f64>>,
    pub view: Option<View>,
    pub volume: bool,
}

/// The answers about one set.
pub struct Told {
    pub set: &'static str,
    pub what: String,
    pub states: Vec<(Vec<f64>, Answer)>,
    pub reach: Vec<(Vec<f64>, Reach)>,
    pub outline: Option<Polygon>,
    pub volume: Option<Volume>,
}

impl Answer {
    pub fn is_inside(&self) -> bool {
        match self {
            Self::Domain(m) => m.is_inside(),
            Self::Region(a) => a.is_inside(),
            Self::Infeasible(_) => false,
        }
    }
}

impl Asked<'_> {
    fn contains(&self, state: &[f64]) -> Result<Answer, DesignError> {
        let Some(region) = &self.region else {
            return self.feasible.contains(state).map(Answer::Domain);
        };
        let found = region.contains(state)?;
        if found.cost.is_finite() {
            Ok(Answer::Region(found))
        } else {
            self.feasible.contains(state).map(Answer::Infeasible)
        }
    }

    fn reach(&self, from: Option<&[f64]>, direction: &[f64]) -> Result<Reach, DesignError> {
        match (&self.region, from) {
            (None, None) => self.feasible.reach(direction),
            (None, Some(x)) => self.feasible.reach_from(x, direction),
            (Some(r), None) => r.reach(direction),
            (Some(r), Some(x)) => r.reach_from(x, direction),
        }
    }

    fn view(&self, view: View, from: Option<&[f64]>) -> Result<Polygon, DesignError> {
        match (&self.region, view) {
            (None, View::Projection(i, j)) => self.feasible.projection((i, j)),
            (None, View::Section(i, j)) => {
                let through = from.unwrap_or(self.feasible.origin());
                self.feasible.section(through, (i, j))
            }
            (Some(r), View::Projection(i, j)) => r.projection((i, j)),
            (Some(r), View::Section(i, j)) => r.section((i, j)),
        }
    }

    fn volume(&self) -> Result<Volume, DesignError> {
        match &self.region {
            None => self.feasible.volume(),
            Some(r) => r.volume(),
        }
    }
}

/// The answers of one set.
pub fn answer(set: Set, asked: &Asked<'_>, questions: &Questions) -> Result<Told, DesignError> {
    let (name, what) = match set {
        Set::Implicit => ("implicit", "domain of attraction, implicit (30)"),
        Set::Explicit => ("explicit", "domain of attraction, explicit (9)"),
        Set::Regulation => ("regulation", "domain of attraction of regulation (3.1)"),
        Set::NoTerminalConstraint => (
            "no_terminal_constraint",
            "states at which (35) is feasible; what is attracted is the stability region",
        ),
        Set::StabilityRegion => ("stability_region", "stability region (section 3.5)"),
    };
    let what = match &asked.region {
        Some(r) => format!(
            "{what}: alpha = {:.6} for {}, d = {:.6}, level {:.6e}",
            r.alpha(),
            r.scope(),
            r.stage_cost_bound(),
            r.level()
        ),
        None => what.into(),
    };
    let from = questions.from.as_deref();
    let mut told = Told {
        set: name,
        what,
        states: Vec::new(),
        reach: Vec::new(),
        outline: None,
        volume: None,
    };
    for state in &questions.states {
        told.states.push((state.clone(), asked.contains(state)?));
    }
    for direction in &questions.directions {
        told.reach
            .push((direction.clone(), asked.reach(from, direction)?));
    }
    if let Some(view) = questions.view {
        told.outline = Some(asked.view(view, from)?);
    }
    if questions.volume {
        told.volume = Some(asked.volume()?);
    }
    Ok(told)
}
