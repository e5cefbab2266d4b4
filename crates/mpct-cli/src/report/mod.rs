//! The report of a closed loop: one HTML page with its plots inside, for people.
//!
//! [`ReportData`] is plain data; [`render`] draws it. The plots are SVG written here: with classes instead of
//! colours, one style sheet serves light, dark and printed pages.

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
mod space;
mod svg;
mod tables;
#[cfg(test)]
mod tests;

pub use data::{Region, ReportData, Signal};
pub use from_run::problem_signals;
pub use page::render;
pub use paper::{figures as reproduction_figures, reproduction_page};
pub use picture::{choose, picture};
pub use plane::{Mark, Plane, Stroke};
pub use raster::Format;
