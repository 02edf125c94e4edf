//! Chance-constrained model predictive control among moving obstacles (document L, chapter 6 and
//! section IV of its paper). `docs/derivations/chance-constrained-mpc.md` gives the equations.
//!
//! [`PredictivePlanner::plan`] turns a [`PlanRequest`] into an [`alula_messages::Plan`], and
//! [`reference_at`] a plan into the reference of a controller. [`Problem`] is the problem that is
//! solved, open for comparison with other solvers.

mod config;
mod detour;
mod dynamics;
mod follow;
mod guess;
mod heading;
mod keepout;
mod planner;
mod prediction;
mod problem;
mod request;
mod uncertainty;
mod view;

pub use config::PredictiveConfig;
pub use dynamics::{Input, NU, NX, Sideways, State, TiltDynamics, TiltModel};
pub use follow::{braking_reference_at, reference_at};
pub use heading::YawTarget;
pub use keepout::{Clearance, Hull, Keepout, Volume, sum_with_sphere};
pub use planner::PredictivePlanner;
pub use problem::{Penalty, Potential, Problem, SpeedCost, Stage};
pub use request::{Arrival, PlanRequest};
pub use view::{FieldOfView, VIEW_SIDES};
