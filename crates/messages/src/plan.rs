//! What the predictive planner intends and why it may not advance.

use alula_geometry::Timestamp;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Intervals of a plan's horizon (document L, section 6; paper section V-A).
pub const PLAN_INTERVALS: usize = 25;

/// Points of a plan: its start and the end of every interval.
pub const PLAN_POINTS: usize = PLAN_INTERVALS + 1;

/// Most obstacles that a plan keeps clear of.
pub const PLAN_OBSTACLES: usize = 16;

/// Number of an obstacle that is not there.
pub const NO_OBSTACLE: u32 = u32::MAX;

/// The vehicle's intended state at one point of a plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlanPoint {
    /// Position, world, m.
    pub position_world: Vector3<f64>,
    /// Velocity, world, m/s.
    pub velocity_world: Vector3<f64>,
    /// Acceleration, world, m/s^2.
    pub acceleration_world: Vector3<f64>,
    /// Yaw, rad.
    pub yaw_rad: f64,
    /// Yaw rate, rad/s.
    pub yaw_rate_rad_s: f64,
    /// Covariance of the position, world, m^2.
    pub position_covariance: Matrix3<f64>,
}

/// How the solver ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlanExit {
    /// The optimality conditions hold to the tolerance.
    #[default]
    Converged,
    /// The iteration limit came first; the plan is the best iterate.
    IterationLimit,
    /// No step was found that improves; the plan is the best iterate.
    NoProgress,
    /// The numbers broke down; the last plan goes on and brakes.
    Failed,
}

impl PlanExit {
    /// A word for tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::IterationLimit => "iteration_limit",
            Self::NoProgress => "no_progress",
            Self::Failed => "failed",
        }
    }
}

/// A plan of the predictive planner over its horizon (document L, chapter 6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Time of the first point.
    pub time: Timestamp,
    /// Length of an interval, s.
    pub interval_s: f64,
    /// The points, one interval apart.
    pub points: [PlanPoint; PLAN_POINTS],
    /// Where it leads, world, m: the goal or a point on the way to it.
    pub target_world: Vector3<f64>,
    /// How the solver ended.
    pub exit: PlanExit,
    /// Subproblems solved.
    pub iterations: u32,
    /// Cost of the plan, without unit.
    pub cost: f64,
    /// Greatest violation of a softened constraint, m; 0 when all hold.
    pub max_violation_m: f64,
    /// Obstacles it keeps clear of; the rest is [`NO_OBSTACLE`].
    pub obstacles: [u32; PLAN_OBSTACLES],
}

impl Default for Plan {
    fn default() -> Self {
        Self {
            time: Timestamp::ZERO,
            interval_s: 0.06,
            points: [PlanPoint::default(); PLAN_POINTS],
            target_world: Vector3::zeros(),
            exit: PlanExit::default(),
            iterations: 0,
            cost: 0.0,
            max_violation_m: 0.0,
            obstacles: [NO_OBSTACLE; PLAN_OBSTACLES],
        }
    }
}

/// Why a vehicle that should advance does not, or does so with less than it needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hindrance {
    /// No depth image has arrived for this long, s: it brakes and waits.
    DepthStale {
        /// Age of the newest image, s.
        age_s: f64,
    },
    /// The estimate jumped or is not good: what was seen before no longer fits.
    EstimateJumped {
        /// Length of the jump, m.
        jump_m: f64,
    },
    /// The solver failed: the last plan goes on and brakes.
    PlannerFailed,
    /// The goal lies in, or too close to, an obstacle.
    GoalBlocked {
        /// Number of the obstacle.
        obstacle: u32,
    },
    /// No way to the goal round what is known.
    NoRoute,
    /// It stands although nothing forbids to go on: it has not come nearer for this long, s.
    Stalled {
        /// Time without progress, s.
        since_s: f64,
    },
}

impl Hindrance {
    /// A short phrase for people.
    pub fn describe(self) -> &'static str {
        match self {
            Self::DepthStale { .. } => "no depth images arrive",
            Self::EstimateJumped { .. } => "the estimate jumped",
            Self::PlannerFailed => "the planner failed",
            Self::GoalBlocked { .. } => "an obstacle stands on the goal",
            Self::NoRoute => "no way round the obstacles is known",
            Self::Stalled { .. } => "no progress towards the goal",
        }
    }

    /// A word for tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::DepthStale { .. } => "depth_stale",
            Self::EstimateJumped { .. } => "estimate_jumped",
            Self::PlannerFailed => "planner_failed",
            Self::GoalBlocked { .. } => "goal_blocked",
            Self::NoRoute => "no_route",
            Self::Stalled { .. } => "stalled",
        }
    }
}
