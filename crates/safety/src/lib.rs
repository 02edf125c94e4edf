//! The guard: independent limits, health rules and fallbacks. It can only make a command safer.
//!
//! It is the last part before the vehicle. It sees the raw sensor data beside the estimate, keeps
//! its own simple record of the motion and has its own limits. The table of its rules is in
//! `docs/derivations/flight-modes-and-guard.md`.

mod brake;
mod checks;
mod config;
mod descent;
mod guard;
mod raw;
mod rules;

#[cfg(test)]
mod tests;

pub use config::{
    BrakeConfig, CommandLimits, DescentConfig, EstimateLimits, FenceConfig, GuardConfig,
    GuardVehicle, MotionLimits, SensorLimits,
};
pub use guard::{Guard, GuardInput};
