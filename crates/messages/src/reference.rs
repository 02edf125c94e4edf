//! Where the vehicle should be.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A point on a trajectory: the flat outputs and their derivatives (document S, section 2.9.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// Desired position, world, m.
    pub position_world: Vector3<f64>,
    /// Desired velocity, world, m/s.
    pub velocity_world: Vector3<f64>,
    /// Desired acceleration, world, m/s^2.
    pub acceleration_world: Vector3<f64>,
    /// Desired jerk, world, m/s^3.
    pub jerk_world: Vector3<f64>,
    /// Desired snap, world, m/s^4.
    pub snap_world: Vector3<f64>,
    /// Desired yaw, rad.
    pub yaw_rad: f64,
    /// Desired yaw rate, rad/s.
    pub yaw_rate_rad_s: f64,
    /// Desired yaw acceleration, rad/s^2.
    pub yaw_acceleration_rad_s2: f64,
}

impl Reference {
    /// Standing still at a point with a heading.
    pub fn hover(position_world: Vector3<f64>, yaw_rad: f64) -> Self {
        Self {
            position_world,
            yaw_rad,
            ..Self::default()
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        [
            self.position_world,
            self.velocity_world,
            self.acceleration_world,
            self.jerk_world,
            self.snap_world,
            Vector3::new(
                self.yaw_rad,
                self.yaw_rate_rad_s,
                self.yaw_acceleration_rad_s2,
            ),
        ]
        .iter()
        .all(|v| v.iter().all(|x| x.is_finite()))
    }
}
