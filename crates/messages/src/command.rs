//! What a vehicle is told to do.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A command to an autopilot. Angles follow the FLU body: positive pitch lowers the nose and flies
/// forward, positive roll lowers the right side and flies right, positive yaw rate turns left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// Motors off and locked.
    #[default]
    Disarm,
    /// Motors idle, ready to fly.
    Idle,
    /// Attitude and collective thrust, the interface of document O, section 1.2.3.
    AttitudeThrust {
        /// Roll, rad.
        roll_rad: f64,
        /// Pitch, rad.
        pitch_rad: f64,
        /// Yaw rate, rad/s.
        yaw_rate_rad_s: f64,
        /// Collective thrust along the body's z axis, N.
        thrust_n: f64,
    },
    /// Tilt, yaw rate and climb rate, the interface of a Bebop (document L, appendix A-4).
    TiltClimb {
        /// Roll, rad.
        roll_rad: f64,
        /// Pitch, rad.
        pitch_rad: f64,
        /// Yaw rate, rad/s.
        yaw_rate_rad_s: f64,
        /// Climb rate, m/s, up.
        climb_rate_m_s: f64,
    },
    /// Collective thrust and body torque, for vehicles that close no loop of their own
    /// (document S, equation 2.85).
    ThrustTorque {
        /// Collective thrust along the body's z axis, N.
        thrust_n: f64,
        /// Torque, body frame, N m.
        torque_body_nm: Vector3<f64>,
    },
}

impl Command {
    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        match *self {
            Self::Disarm | Self::Idle => true,
            Self::AttitudeThrust {
                roll_rad,
                pitch_rad,
                yaw_rate_rad_s,
                thrust_n,
            } => [roll_rad, pitch_rad, yaw_rate_rad_s, thrust_n]
                .iter()
                .all(|x| x.is_finite()),
            Self::TiltClimb {
                roll_rad,
                pitch_rad,
                yaw_rate_rad_s,
                climb_rate_m_s,
            } => [roll_rad, pitch_rad, yaw_rate_rad_s, climb_rate_m_s]
                .iter()
                .all(|x| x.is_finite()),
            Self::ThrustTorque {
                thrust_n,
                torque_body_nm,
            } => thrust_n.is_finite() && torque_body_nm.iter().all(|x| x.is_finite()),
        }
    }
}
