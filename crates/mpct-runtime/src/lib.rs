//! The online solver of model predictive control for tracking.
#![no_std]
