//! Optimal control over a horizon: programs whose stages are linked by dynamics.

mod problem;

pub use problem::{OptimalControl, SoftConstraint, StageCost, Step};
