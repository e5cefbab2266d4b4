//! The report of a closed loop: one HTML page with its plots inside, for people. It needs no network.
//!
//! The plots are SVG written here: with classes instead of colours, one style sheet serves light, dark and printed pages.
//! Nothing here writes a file; the command and the Python package do.

mod axis;
mod closed_loop;
mod data;
mod from_run;
mod guarantees;
mod numbers;
mod page;
mod panel;
mod paper;
mod picture;
mod plane;
mod raster;
mod reproduction;
mod space;
mod svg;
mod tables;
#[cfg(test)]
mod tests;

pub use data::{Region, Signal};
pub use from_run::problem_signals;
pub use paper::figures as reproduction_figures;
pub use picture::Choice;
pub use plane::{Mark, Plane, Stroke};
pub use raster::Format;
pub use reproduction::{REPRODUCTION_FILES, reproduction_files};

use data::ReportData;
use mpct::{Controller, Run, TerminalIngredients};

/// What is reported of a closed loop and of the design behind it.
///
/// ```
/// use mpct::{Controller, DesignOptions, TerminalIngredients};
/// let file = mpct::cases::academic();
/// let ingredients = TerminalIngredients::design(&file.problem, &DesignOptions::default())?;
/// let mut controller = Controller::new(ingredients.clone())?;
/// let run = mpct::simulate(&mut controller, file.simulation.as_ref().unwrap(), None)?;
/// let report = mpct_report::Report::new(&ingredients, &run, false);
/// assert!(report.page().starts_with("<!DOCTYPE html>"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Report(ReportData);

impl Report {
    /// Of a run and the design of its controller. `disturbed` says that a disturbance acted: the cost need not decrease
    /// then.
    pub fn new(ingredients: &TerminalIngredients, run: &Run, disturbed: bool) -> Self {
        Self(ReportData::new(ingredients, run).with_disturbance(disturbed))
    }

    /// The same with the margins of what was proved: see the section on guarantees of the page.
    pub fn with_proofs(self, controller: &Controller, run: &Run) -> Self {
        Self(self.0.with_proofs(controller, run))
    }

    /// Where the stability region of section 3.5 was looked at.
    pub fn regions(&self) -> &[Region] {
        &self.0.design.regions
    }

    /// The page, as HTML.
    pub fn page(&self) -> String {
        page::render(&self.0)
    }

    /// Some states and inputs in one SVG file.
    pub fn picture(&self, choice: &Choice) -> String {
        picture::picture(&self.0, choice)
    }
}
