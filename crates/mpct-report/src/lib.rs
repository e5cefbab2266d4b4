//! The report of a closed loop: one HTML page with its plots inside, for people. It needs no network.
//!
//! The plots are SVG written here: with classes instead of colours, one style sheet serves light, dark and printed pages.
//! Nothing here writes a file; the command and the Python package do.

mod axis;
mod closed_loop;
mod data;
mod from_run;
mod numbers;
mod page;
mod panel;
mod paper;
mod picture;
mod plane;
mod reproduction;
mod svg;
mod tables;
#[cfg(test)]
mod tests;

pub use picture::Choice;
pub use reproduction::{REPRODUCTION_FILES, reproduction_files};

use data::ReportData;
use mpct::{Run, TerminalIngredients};

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

    /// The page, as HTML.
    pub fn page(&self) -> String {
        page::render(&self.0)
    }

    /// Some states and inputs in one SVG file.
    pub fn picture(&self, choice: &Choice) -> String {
        picture::picture(&self.0, choice)
    }
}
