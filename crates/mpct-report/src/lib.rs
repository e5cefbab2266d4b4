//! The report of a closed loop: one HTML page with its plots inside, for people.
//!
//! [`ReportData`] is plain data; [`render`] draws it. The plots are SVG written here: with classes instead of
//! colours, one style sheet serves light, dark and printed pages.

// A part of the workspace: names that say all have no comment.
#![allow(missing_docs)]

mod reproduction;

pub use reproduction::{REPRODUCTION_FILES, machine, reproduction_files, table_1, table_2};

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
mod svg;
mod tables;
#[cfg(test)]
mod tests;

pub use data::ReportData;
pub use page::render;
pub use paper::reproduction_page;
pub use picture::{choose, picture};
