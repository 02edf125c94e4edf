//! What an operator or a mission asks for, the mode of flight, and why a request was refused.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A request to the flight modes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Intent {
    /// Let the motors turn.
    Arm,
    /// Stop the motors on the ground.
    Disarm,
    /// Climb to a height above the take-off point and hover there.
    TakeOff {
        /// Height above the take-off point, m.
        height_m: f64,
    },
    /// Fly through waypoints and hover at the last one.
    Fly {
        /// Points in the world frame, m, in order.
        waypoints_world: Vec<Vector3<f64>>,
    },
    /// Stop and hover.
    Hold,
    /// Descend vertically, touch down and stop the motors.
    Land,
    /// Stop the motors at once, wherever the vehicle is.
    Kill,
}

/// The mode of flight (document O, section 1.2.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightMode {
    /// On the ground, motors off.
    #[default]
    Disarmed,
    /// On the ground, motors idle.
    Armed,
    /// Climbing from the ground.
    TakingOff,
    /// Standing still in the air.
    Hovering,
    /// Following a trajectory.
    Flying,
    /// Descending to the ground.
    Landing,
    /// Motors stopped by force; only a new flight leaves this mode.
    Killed,
}

impl FlightMode {
    /// Every mode.
    pub const ALL: [Self; 7] = [
        Self::Disarmed,
        Self::Armed,
        Self::TakingOff,
        Self::Hovering,
        Self::Flying,
        Self::Landing,
        Self::Killed,
    ];

    /// Whether the vehicle flies on its motors in this mode, take-off and landing included.
    pub fn is_airborne(self) -> bool {
        matches!(
            self,
            Self::TakingOff | Self::Hovering | Self::Flying | Self::Landing
        )
    }
}

/// Why a request was refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// The request makes no sense in this mode.
    WrongMode {
        /// The mode in which it was made.
        mode: FlightMode,
    },
    /// The estimate is not good enough to start.
    EstimateNotReady,
    /// A number in the request is not finite or outside its limits.
    OutOfLimits {
        /// The value found.
        found: f64,
        /// Least value allowed.
        low: f64,
        /// Greatest value allowed.
        high: f64,
    },
    /// No trajectory through the waypoints exists.
    NoTrajectory,
    /// The guard has taken over.
    GuardActive,
}
