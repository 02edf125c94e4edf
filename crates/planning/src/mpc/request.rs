//! What the predictive planner is asked.

use alula_geometry::Timestamp;
use alula_messages::{NavState, Obstacle, PLAN_POINTS};
use nalgebra::Vector3;

use super::heading::YawTarget;
use super::view::FieldOfView;

/// How the plan ends at its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// Stop there.
    Stop,
    /// Fly through it, straight on.
    Pass,
}

/// The situation in which a plan is made.
#[derive(Clone, Copy, Debug)]
pub struct PlanRequest<'a> {
    /// Time of the plan's first point.
    pub now: Timestamp,
    /// State of the vehicle at `now`.
    pub state: &'a NavState,
    /// Where to go, world, m.
    pub target_world: Vector3<f64>,
    /// Whether to stop there.
    pub arrival: Arrival,
    /// Where to look.
    pub yaw: YawTarget,
    /// Limit of the horizontal speed at each point, m/s.
    pub max_speed_m_s: &'a [f64; PLAN_POINTS],
    /// What to keep clear of.
    pub obstacles: &'a [Obstacle],
    /// Least and greatest height, world, m: as binding as what to keep clear of.
    pub height_band_m: Option<[f64; 2]>,
    /// Volume that the plan should not leave.
    pub view: Option<&'a FieldOfView>,
}

impl PlanRequest<'_> {
    /// Whether every number in it is finite.
    pub fn is_finite(&self) -> bool {
        let yaw = match self.yaw {
            YawTarget::AlongMotion => 0.0,
            YawTarget::Towards(yaw) | YawTarget::Hold(yaw) => yaw,
        };
        self.state.is_finite()
            && self.state.covariance.iter().all(|c| c.is_finite())
            && self.target_world.iter().all(|c| c.is_finite())
            && yaw.is_finite()
            && self.height_band_m.iter().flatten().all(|z| z.is_finite())
            && self.max_speed_m_s.iter().all(|v| v.is_finite())
            && self.obstacles.iter().all(obstacle_is_finite)
    }
}

fn obstacle_is_finite(obstacle: &Obstacle) -> bool {
    [
        obstacle.centre_world,
        obstacle.velocity_world,
        obstacle.size_m,
    ]
    .iter()
    .all(|v| v.iter().all(|c| c.is_finite()))
        && obstacle.yaw_rad.is_finite()
        && obstacle.covariance.iter().all(|c| c.is_finite())
}
