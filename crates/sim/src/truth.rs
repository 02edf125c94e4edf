//! What really happens, known to the simulator alone.

use alula_geometry::{Pose, Timestamp};
use alula_messages::{EstimateHealth, NavState};
use nalgebra::Vector3;

/// The true motion of a simulated vehicle at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Time since the start of the simulation.
    pub time: Timestamp,
    /// Pose of the body in the world.
    pub world_from_body: Pose,
    /// Velocity of the body's origin, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Acceleration of the body's origin, world frame, gravity included, m/s^2: zero at rest.
    pub acceleration_world: Vector3<f64>,
    /// Angular rate, body frame, rad/s.
    pub angular_rate_body: Vector3<f64>,
    /// Angular acceleration, body frame, rad/s^2.
    pub angular_acceleration_body: Vector3<f64>,
    /// Whether the landing gear touches the ground.
    pub on_ground: bool,
}

impl Truth {
    /// The truth in the shape of an estimate that knows everything.
    pub fn as_estimate(&self, now: Timestamp) -> NavState {
        NavState {
            time: now,
            world_from_body: self.world_from_body,
            velocity_world: self.velocity_world,
            angular_rate_body: self.angular_rate_body,
            acceleration_world: self.acceleration_world,
            health: EstimateHealth::Good,
            ..NavState::default()
        }
    }

    /// Position of the body's origin, world frame, m.
    pub fn position_world(&self) -> Vector3<f64> {
        self.world_from_body.translation.vector
    }

    /// Acceleration less gravity in the body frame, m/s^2: what a perfect accelerometer reads.
    pub fn specific_force_body(&self) -> Vector3<f64> {
        self.world_from_body.rotation.inverse()
            * (self.acceleration_world - alula_geometry::gravity_world())
    }
}
