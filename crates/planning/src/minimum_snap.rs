//! The planner: from waypoints and limits to a trajectory.

use alula_geometry::so3;
use alula_messages::Reference;
use alula_optim::Exit;
use alula_parameters::{ParameterError, Parameters, parameters};
use nalgebra::Vector3;

use crate::hermite::Hermite;
use crate::problem::SnapProblem;
use crate::timing::{self, Effort};
use crate::trajectory::{Segment, Trajectory};
use crate::yaw::{YawPolicy, YawSpline, YawWish};

parameters! {
    /// Settings of the planner.
    pub struct MinimumSnapConfig {
        /// Greatest distance of the path from the straight lines between waypoints, m. A start
        /// that moves gets its braking distance on top, on the first line.
        pub corridor_m: f64 = 0.5, within(0.05, 1000.0);
        /// Waypoints closer than this to the one before are refused, m.
        pub min_spacing_m: f64 = 0.05, within(0.001, 10.0);
        /// Greatest number of waypoints.
        pub max_waypoints: usize = 60, within(1.0, 200.0);
        /// Steps of the descent on snap over the relative segment times.
        pub descent_steps: usize = 12, within(0.0, 500.0);
        /// Share by which a speed limit may be exceeded on the way from a start that moves, if no
        /// timing keeps it; an acceleration limit by twice that share.
        pub start_margin: f64 = 0.1, within(0.0, 1.0);
    }
}

parameters! {
    /// What a trajectory must keep.
    pub struct MotionLimits {
        /// Greatest speed, m/s.
        pub max_speed_m_s: f64 = 2.0, within(0.05, 50.0);
        /// Greatest acceleration, m/s^2.
        pub max_acceleration_m_s2: f64 = 2.5, within(0.05, 50.0);
        /// Greatest yaw rate, rad/s.
        pub max_yaw_rate_rad_s: f64 = 1.0, within(0.01, 20.0);
    }
}

/// Why there is no trajectory.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// There is nowhere to go.
    #[error("there are no waypoints")]
    NoWaypoints,
    /// More waypoints than the planner takes.
    #[error("there are {count} waypoints; at most {max} are allowed")]
    TooManyWaypoints {
        /// How many there are.
        count: usize,
        /// How many there may be.
        max: usize,
    },
    /// A waypoint is not a place.
    #[error("waypoint {index} is not finite")]
    WaypointNotFinite {
        /// Its place in the list, from 0.
        index: usize,
    },
    /// The start, or the wanted yaw, is not finite.
    #[error("the start or the wanted yaw is not finite")]
    StartNotFinite,
    /// A waypoint repeats the point before it, or nearly so; the point before the first is the
    /// start.
    #[error(
        "waypoint {index} is {distance_m} m from the point before it; at least {min_m} m are needed"
    )]
    TooClose {
        /// Its place in the list, from 0.
        index: usize,
        /// Distance from the point before, m.
        distance_m: f64,
        /// Least distance, m.
        min_m: f64,
    },
    /// A limit is not allowed.
    #[error("limit {0}")]
    Limits(#[from] ParameterError),
    /// The start moves so much faster than the limits that they cannot be kept.
    #[error("the start moves at {speed_m_s} m/s and {acceleration_m_s2} m/s^2, beyond the limits")]
    StartBeyondLimits {
        /// Speed of the start, m/s.
        speed_m_s: f64,
        /// Acceleration of the start, m/s^2.
        acceleration_m_s2: f64,
    },
    /// No timing keeps the limits from this moving start.
    #[error("no timing keeps the limits: the best reaches {effort} times a limit")]
    LimitsUnreachable {
        /// Greatest of speed over its limit and the root of acceleration over its limit.
        effort: f64,
    },
    /// The quadratic program has no solution: the corridor is too narrow for the start.
    #[error("the quadratic program ended with {exit:?}")]
    Unsolved {
        /// How the solver ended.
        exit: Exit,
    },
}

/// Plans minimum-snap trajectories through waypoints.
#[derive(Clone, Debug)]
pub struct MinimumSnap {
    config: MinimumSnapConfig,
    hermite: Hermite,
}

impl MinimumSnap {
    /// A planner.
    ///
    /// # Errors
    /// The first parameter that is not allowed.
    pub fn new(config: &MinimumSnapConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        let hermite = Hermite::new()
            .ok_or_else(|| ParameterError::new("hermite", "singular", "a regular matrix"))?;
        Ok(Self {
            config: config.clone(),
            hermite,
        })
    }

    /// A trajectory from `start` (position, velocity, acceleration and jerk are kept; snap is not)
    /// through the waypoints (world, m) to rest at the last, as fast as the limits allow for its
    /// shape.
    ///
    /// # Errors
    /// See [`PlanError`].
    pub fn plan(
        &self,
        start: &Reference,
        waypoints_world: &[Vector3<f64>],
        limits: &MotionLimits,
        yaw: YawPolicy,
    ) -> Result<Trajectory, PlanError> {
        self.check(start, waypoints_world, limits, yaw)?;
        let problem = SnapProblem::new(&self.hermite, start, waypoints_world);
        let effort = self.effort(start, limits)?;
        let times_s = timing::allocate(&problem, &effort, &self.config)?;
        let segments = timing::meet_limits(&problem, &effort, &self.config, &times_s)?;
        let yaw = plan_yaw(start, &segments, limits, yaw)?;
        Ok(Trajectory::new(segments, yaw))
    }

    fn check(
        &self,
        start: &Reference,
        waypoints_world: &[Vector3<f64>],
        limits: &MotionLimits,
        yaw: YawPolicy,
    ) -> Result<(), PlanError> {
        limits.validate()?;
        let yaw_is_finite = !matches!(yaw, YawPolicy::Fixed(yaw_rad) if !yaw_rad.is_finite());
        if !start.is_finite() || !yaw_is_finite {
            return Err(PlanError::StartNotFinite);
        }
        if waypoints_world.is_empty() {
            return Err(PlanError::NoWaypoints);
        }
        if waypoints_world.len() > self.config.max_waypoints {
            return Err(PlanError::TooManyWaypoints {
                count: waypoints_world.len(),
                max: self.config.max_waypoints,
            });
        }
        self.check_waypoints(start, waypoints_world)
    }

    fn check_waypoints(
        &self,
        start: &Reference,
        waypoints_world: &[Vector3<f64>],
    ) -> Result<(), PlanError> {
        let mut before = start.position_world;
        for (index, waypoint) in waypoints_world.iter().enumerate() {
            if !waypoint.iter().all(|x| x.is_finite()) {
                return Err(PlanError::WaypointNotFinite { index });
            }
            let distance_m = (waypoint - before).norm();
            if distance_m < self.config.min_spacing_m {
                return Err(PlanError::TooClose {
                    index,
                    distance_m,
                    min_m: self.config.min_spacing_m,
                });
            }
            before = *waypoint;
        }
        Ok(())
    }

    /// The limits, widened where the start moves at them or beyond.
    fn effort(&self, start: &Reference, limits: &MotionLimits) -> Result<Effort, PlanError> {
        let speed_m_s = start.velocity_world.norm();
        let acceleration_m_s2 = start.acceleration_world.norm();
        let room = 1.0 + self.config.start_margin;
        if speed_m_s > room * limits.max_speed_m_s
            || acceleration_m_s2 > room * room * limits.max_acceleration_m_s2
        {
            return Err(PlanError::StartBeyondLimits {
                speed_m_s,
                acceleration_m_s2,
            });
        }
        Ok(Effort {
            max_speed_m_s: limits.max_speed_m_s.max(speed_m_s),
            max_acceleration_m_s2: limits.max_acceleration_m_s2.max(acceleration_m_s2),
        })
    }
}

fn plan_yaw(
    start: &Reference,
    segments: &[Segment],
    limits: &MotionLimits,
    policy: YawPolicy,
) -> Result<YawSpline, PlanError> {
    let duration_s = segments.iter().map(|segment| segment.duration_s).sum();
    let (wishes, end_rad) = match policy {
        YawPolicy::Hold => plain_turn(start.yaw_rad, 0.0, duration_s, limits),
        YawPolicy::Fixed(yaw_rad) => {
            let turn = so3::wrap_angle(yaw_rad - start.yaw_rad);
            plain_turn(start.yaw_rad, turn, duration_s, limits)
        }
        YawPolicy::FaceMotion => face_motion(start.yaw_rad, segments),
    };
    YawSpline::plan(
        (start.yaw_rad, start.yaw_rate_rad_s),
        &wishes,
        end_rad,
        limits.max_yaw_rate_rad_s,
    )
    .map_err(|exit| PlanError::Unsolved { exit })
}

/// Pieces into which a turn without wishes is cut, so that it can hold the rate limit.
const TURN_PIECES: usize = 8;

/// One turn over the whole motion, or longer where the rate limit asks for it: a cubic turn from
/// rest to rest peaks at 1.5 times its mean rate.
fn plain_turn(
    start_rad: f64,
    turn_rad: f64,
    duration_s: f64,
    limits: &MotionLimits,
) -> (Vec<YawWish>, f64) {
    let shortest_s = 1.5 * turn_rad.abs() / limits.max_yaw_rate_rad_s;
    let length_s = duration_s.max(shortest_s) / TURN_PIECES as f64;
    let wishes = (1..=TURN_PIECES)
        .map(|k| YawWish {
            time_s: length_s * k as f64,
            yaw_rad: None,
        })
        .collect();
    (wishes, start_rad + turn_rad)
}

/// Wishes to look along the velocity in the middle of each segment, without whole turns between
/// them, and the last of them as the end.
fn face_motion(start_rad: f64, segments: &[Segment]) -> (Vec<YawWish>, f64) {
    let mut yaw_rad = start_rad;
    let mut start_s = 0.0;
    let mut wishes = Vec::with_capacity(2 * segments.len());
    for segment in segments {
        let velocity = segment.derivative(1, 0.5);
        // Climbs steeper than one in twenty have no heading worth a turn.
        if velocity.xy().norm() > 0.05 * velocity.norm() {
            let heading = velocity.y.atan2(velocity.x);
            yaw_rad += so3::wrap_angle(heading - yaw_rad);
        }
        wishes.push(YawWish {
            time_s: start_s + 0.5 * segment.duration_s,
            yaw_rad: Some(yaw_rad),
        });
        start_s += segment.duration_s;
        wishes.push(YawWish {
            time_s: start_s,
            yaw_rad: None,
        });
    }
    (wishes, yaw_rad)
}
