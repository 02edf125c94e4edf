//! What the controller says.

use alula_geometry::{GRAVITY_M_S2, so3};
use alula_messages::{Command, NavState};
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Whether the controller gave what the reference asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GeometricStatus {
    /// Within all limits.
    Tracking,
    /// The desired force met a limit of tilt or thrust.
    Limited,
    /// The input was not finite; the output is level hover thrust.
    BadInput,
}

/// One step of the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometricOutput {
    /// Collective thrust along the body's z axis, N.
    pub thrust_n: f64,
    /// Torque, body frame, N m.
    pub torque_body_nm: Vector3<f64>,
    /// Desired attitude `R_c`.
    pub world_from_body_desired: UnitQuaternion<f64>,
    /// Angular rate of the desired attitude, in its own frame, rad/s.
    pub angular_rate_desired_body: Vector3<f64>,
    /// Angular acceleration of the desired attitude, in its own frame, rad/s^2.
    pub angular_acceleration_desired_body: Vector3<f64>,
    /// Position less reference, world, m (document S, equation 2.86a).
    pub position_error_world: Vector3<f64>,
    /// Velocity less reference, world, m/s (document S, equation 2.86b).
    pub velocity_error_world: Vector3<f64>,
    /// Roll that points the thrust where it is wanted at the present yaw, rad.
    pub roll_rad: f64,
    /// Pitch that points the thrust where it is wanted at the present yaw, rad.
    pub pitch_rad: f64,
    /// Yaw rate towards the desired yaw, rad/s.
    pub yaw_rate_rad_s: f64,
    /// Whether limits were met.
    pub status: GeometricStatus,
}

impl GeometricOutput {
    /// The command for an autopilot that closes the attitude loop itself.
    pub fn attitude_thrust_command(&self) -> Command {
        Command::AttitudeThrust {
            roll_rad: self.roll_rad,
            pitch_rad: self.pitch_rad,
            yaw_rate_rad_s: self.yaw_rate_rad_s,
            thrust_n: self.thrust_n,
        }
    }

    /// The command for a vehicle that closes no loop of its own.
    pub fn thrust_torque_command(&self) -> Command {
        Command::ThrustTorque {
            thrust_n: self.thrust_n,
            torque_body_nm: self.torque_body_nm,
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.attitude_thrust_command().is_finite()
            && self.thrust_torque_command().is_finite()
            && self
                .world_from_body_desired
                .coords
                .iter()
                .all(|x| x.is_finite())
            && [
                self.angular_rate_desired_body,
                self.angular_acceleration_desired_body,
                self.position_error_world,
                self.velocity_error_world,
            ]
            .iter()
            .all(|v| v.iter().all(|x| x.is_finite()))
    }

    /// Level, with the thrust of the weight, without rotation.
    pub(super) fn level_hover(mass_kg: f64, state: &NavState) -> Self {
        let yaw = so3::yaw_rad(&state.world_from_body.rotation);
        let yaw = if yaw.is_finite() { yaw } else { 0.0 };
        Self {
            thrust_n: mass_kg * GRAVITY_M_S2,
            torque_body_nm: Vector3::zeros(),
            world_from_body_desired: so3::from_roll_pitch_yaw(0.0, 0.0, yaw),
            angular_rate_desired_body: Vector3::zeros(),
            angular_acceleration_desired_body: Vector3::zeros(),
            position_error_world: Vector3::zeros(),
            velocity_error_world: Vector3::zeros(),
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rate_rad_s: 0.0,
            status: GeometricStatus::BadInput,
        }
    }
}
