//! The state of motion as the vehicle believes it.

use alula_geometry::{Pose, Timestamp};
use nalgebra::{SMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// Covariance of the error state: position (world, m), velocity (world, m/s), orientation (body,
/// rad; `true = estimate * exp(error)`), accelerometer bias (m/s^2), gyroscope bias (rad/s).
pub type ErrorCovariance = SMatrix<f64, 15, 15>;

/// Rows of the parts of the error state in [`ErrorCovariance`].
pub mod error_index {
    /// First row of the position error.
    pub const POSITION: usize = 0;
    /// First row of the velocity error.
    pub const VELOCITY: usize = 3;
    /// First row of the orientation error.
    pub const ORIENTATION: usize = 6;
    /// First row of the accelerometer bias error.
    pub const ACCELEROMETER_BIAS: usize = 9;
    /// First row of the gyroscope bias error.
    pub const GYROSCOPE_BIAS: usize = 12;
}

/// What the vehicle is doing, as far as its sensors are concerned (document S, section 2.10.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightPhase {
    /// On the ground, motors off or idle: position and velocity are known to be constant.
    #[default]
    Landed,
    /// Leaving the ground, below the height at which the downward sensors are trustworthy.
    TakingOff,
    /// Airborne, sensors trusted.
    Flying,
    /// Descending to touch down, below the height at which the downward sensors are trustworthy.
    Landing,
}

/// How far an estimate can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EstimateHealth {
    /// Not yet aligned with gravity; the state means nothing.
    Initialising,
    /// All measurements that it needs arrive and agree.
    Good,
    /// Dead reckoning: velocity or height has not been corrected for this long.
    Degraded {
        /// Seconds since the last accepted velocity measurement.
        since_velocity_s: f64,
        /// Seconds since the last accepted height measurement.
        since_height_s: f64,
    },
    /// The state is not usable: the inertial data stopped or the filter diverged.
    Failed,
}

/// Parts of the state that the present measurements say nothing about: they drift, or stay what they
/// were when something last said so.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unobserved {
    /// Position along x and y.
    pub horizontal_position: bool,
    /// Position along z.
    pub height: bool,
    /// Velocity.
    pub velocity: bool,
    /// Heading.
    pub yaw: bool,
    /// The accelerometer's bias along the level axes of the body: a vehicle that hovers cannot tell
    /// it from a tilt.
    pub level_accelerometer_bias: bool,
}

impl Unobserved {
    /// Everything.
    pub const ALL: Self = Self {
        horizontal_position: true,
        height: true,
        velocity: true,
        yaw: true,
        level_accelerometer_bias: true,
    };

    /// Words for tables and JSON.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        let parts = [
            (self.horizontal_position, "horizontal_position"),
            (self.height, "height"),
            (self.velocity, "velocity"),
            (self.yaw, "yaw"),
            (self.level_accelerometer_bias, "level_accelerometer_bias"),
        ];
        parts
            .into_iter()
            .filter_map(|(unobserved, name)| unobserved.then_some(name))
    }
}

/// Position, velocity and attitude of the vehicle, with their covariance.
#[derive(Clone, Debug, PartialEq)]
pub struct NavState {
    /// Time of the state.
    pub time: Timestamp,
    /// Pose of the body in the world.
    pub world_from_body: Pose,
    /// Velocity of the body's origin, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Angular rate, body frame, bias removed, rad/s.
    pub angular_rate_body: Vector3<f64>,
    /// Acceleration of the body's origin, world frame, gravity and bias removed, m/s^2.
    pub acceleration_world: Vector3<f64>,
    /// Accelerometer bias, m/s^2.
    pub accelerometer_bias: Vector3<f64>,
    /// Gyroscope bias, rad/s.
    pub gyroscope_bias: Vector3<f64>,
    /// Covariance of the error state, see [`ErrorCovariance`].
    pub covariance: ErrorCovariance,
    /// Flight phase that the estimator assumes.
    pub phase: FlightPhase,
    /// How far to trust it.
    pub health: EstimateHealth,
}

impl NavState {
    /// Position of the body's origin, world frame, m.
    pub fn position_world(&self) -> Vector3<f64> {
        self.world_from_body.translation.vector
    }

    /// Standard deviation of three entries of the error state from `row` on.
    pub fn sigma(&self, row: usize) -> Vector3<f64> {
        Vector3::from_fn(|i, _| self.covariance[(row + i, row + i)].max(0.0).sqrt())
    }

    /// Whether the bias of the accelerometer along a level axis of the body is tied to the tilt by
    /// a correlation beyond `limit` (0 to 1), as it is while hovering: an error of both that leaves
    /// the measured specific force as it is cannot be seen.
    pub fn bias_is_tied_to_tilt(&self, limit: f64) -> bool {
        use error_index::{ACCELEROMETER_BIAS, ORIENTATION};
        let p = &self.covariance;
        let tied = |bias: usize, tilt: usize| {
            let variances = p[(bias, bias)] * p[(tilt, tilt)];
            p[(bias, tilt)].powi(2) > limit * limit * variances
        };
        tied(ACCELEROMETER_BIAS, ORIENTATION + 1) || tied(ACCELEROMETER_BIAS + 1, ORIENTATION)
    }

    /// Whether every number in the state itself is finite.
    pub fn is_finite(&self) -> bool {
        let pose = &self.world_from_body;
        pose.translation.vector.iter().all(|x| x.is_finite())
            && pose.rotation.coords.iter().all(|x| x.is_finite())
            && self.velocity_world.iter().all(|x| x.is_finite())
            && self.angular_rate_body.iter().all(|x| x.is_finite())
    }
}

impl Default for NavState {
    fn default() -> Self {
        Self {
            time: Timestamp::ZERO,
            world_from_body: Pose::identity(),
            velocity_world: Vector3::zeros(),
            angular_rate_body: Vector3::zeros(),
            acceleration_world: Vector3::zeros(),
            accelerometer_bias: Vector3::zeros(),
            gyroscope_bias: Vector3::zeros(),
            covariance: ErrorCovariance::zeros(),
            phase: FlightPhase::Landed,
            health: EstimateHealth::Initialising,
        }
    }
}
