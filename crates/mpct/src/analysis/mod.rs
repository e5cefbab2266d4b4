//! What an engineer wants to know about a design, each answer with its proof or its margin.

mod alpha;
mod domain;
mod performance;
mod polygon;
mod program;
mod region_shape;
pub mod reproduce;
mod scaling;
mod stability_region;
mod terminal_set;
mod volume;

pub use alpha::{AlphaBounds, AlphaScope};
pub use domain::{DomainOfAttraction, MEMBERSHIP, Membership, OUTLINE, Reach};
pub use performance::{ComparedFigure, ConstraintMargin, Performance, SETTLED, Settling, compare};
pub use polygon::Polygon;
pub use program::ProgramRow;
pub use region_shape::{CURVED_HULL, CURVED_OUTLINE};
pub use scaling::{SMALLEST_SCALING, ScalingAdvice, ScalingNeed, scaling_advice, scaling_need};
pub use stability_region::{Attraction, StabilityRegion};
pub use terminal_set::terminal_set;
pub use volume::{LARGEST_DIMENSION, Volume};
