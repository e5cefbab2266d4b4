//! What an engineer wants to know about a design, each answer with its proof or its margin.

mod domain;
mod polygon;
mod program;

pub use domain::{DomainOfAttraction, MEMBERSHIP, Membership, OUTLINE, Reach};
pub use polygon::Polygon;
pub use program::ProgramRow;
