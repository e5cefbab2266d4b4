//! Model predictive control for tracking.
