//! Minimum-snap trajectories through waypoints (document S, section 2.9.3; Mellinger and Kumar,
//! 2011).
//!
//! [`MinimumSnap::plan`] turns a start and waypoints into a [`Trajectory`] whose samples are the
//! [`alula_messages::Reference`] of a controller. The page `docs/derivations/minimum-snap.md`
//! gives the equations.

mod corridor;
mod extrema;
mod hermite;
mod minimum_snap;
pub mod mpc;
mod problem;
pub mod route;
mod timing;
mod trajectory;
mod yaw;

pub use minimum_snap::{MinimumSnap, MinimumSnapConfig, MotionLimits, PlanError};
pub use trajectory::Trajectory;
pub use yaw::YawPolicy;
