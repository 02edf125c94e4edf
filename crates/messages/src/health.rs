//! Diagnostics in one shape: what was fused, what was rejected, what the guard found and did.

use alula_geometry::Timestamp;
use serde::{Deserialize, Serialize};

/// The source of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sensor {
    /// Inertial measurement unit.
    Imu,
    /// Flow camera.
    Flow,
    /// Ultrasonic ranger.
    Sonar,
    /// Infrared or laser ranger.
    Infrared,
    /// External position.
    Position,
    /// External orientation.
    Orientation,
    /// Standing on the ground: position, velocity and angular rate are known.
    Ground,
}

/// Why a measurement was not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// Failed the chi-square gate.
    Gate,
    /// Not finite.
    NotFinite,
    /// Outside what the sensor can measure, or of too low quality.
    Invalid,
    /// Older than the history that is kept.
    TooOld,
    /// Older than, or as old as, a sample of the same sensor that was already used.
    OutOfOrder,
    /// Not trusted in this phase of flight.
    Phase,
    /// Unlike its recent neighbours.
    Outlier,
}

impl Rejection {
    /// A word for tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gate => "gate",
            Self::NotFinite => "not_finite",
            Self::Invalid => "invalid",
            Self::TooOld => "too_old",
            Self::OutOfOrder => "out_of_order",
            Self::Phase => "phase",
            Self::Outlier => "outlier",
        }
    }
}

/// One measurement that met a filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fusion {
    /// Time of measurement.
    pub time: Timestamp,
    /// Its source.
    pub sensor: Sensor,
    /// Measurement less prediction; components beyond the measurement's dimension are zero.
    pub innovation: [f64; 3],
    /// Variances of the innovation, in the same order.
    pub innovation_variance: [f64; 3],
    /// Squared Mahalanobis distance of the innovation.
    pub mahalanobis_squared: f64,
    /// The chi-square threshold it was held against.
    pub gate: f64,
    /// `None` if it was fused, else the reason why not.
    pub rejection: Option<Rejection>,
}

impl Fusion {
    /// Squared Mahalanobis distance over its threshold; up to 1 passes the gate.
    pub fn test_ratio(&self) -> f64 {
        self.mahalanobis_squared / self.gate
    }

    /// Whether the measurement was used.
    pub fn accepted(&self) -> bool {
        self.rejection.is_none()
    }
}

/// Something the guard found to be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Violation {
    /// Outside, or about to leave, the permitted volume.
    Geofence,
    /// Faster than permitted.
    Speed,
    /// Tilted more than permitted.
    Tilt,
    /// No usable estimate, or an old one.
    EstimateStale,
    /// The estimate contradicts raw sensor data or its own covariance has grown too large.
    EstimateInconsistent,
    /// Closer to the ground than permitted in this mode.
    RangeLow,
    /// A command with numbers that are not finite or beyond the vehicle.
    CommandInvalid,
    /// Inertial data are missing or not finite.
    ImuLost,
    /// Velocity measurements are missing.
    FlowLost,
    /// Height measurements are missing or stuck.
    RangeLost,
    /// Depth images, without which obstacles are not seen, are missing or empty.
    DepthLost,
}

impl Violation {
    /// A short phrase for people.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Geofence => "outside the geofence",
            Self::Speed => "too fast",
            Self::Tilt => "tilted too far",
            Self::EstimateStale => "the estimate is stale",
            Self::EstimateInconsistent => "the estimate contradicts the sensors",
            Self::RangeLow => "too close to the ground",
            Self::CommandInvalid => "the command is not valid",
            Self::ImuLost => "inertial data lost",
            Self::FlowLost => "flow data lost",
            Self::RangeLost => "range data lost",
            Self::DepthLost => "depth images lost",
        }
    }
}

/// What the guard does about it, mildest first.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Fallback {
    /// The command passes.
    #[default]
    None,
    /// Stop and hover.
    Hold,
    /// Land here under control of the estimate.
    Land,
    /// Level attitude and a gentle descent, without position or velocity.
    Descend,
    /// Motors off.
    Cut,
}

/// One finding of the guard.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// What is wrong.
    pub violation: Violation,
    /// The value found; its unit is that of the limit.
    pub found: f64,
    /// The limit that it broke.
    pub limit: f64,
}

/// What the guard found and did in one step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GuardReport {
    /// What it does: the gravest fallback of its findings, held until it is released.
    pub fallback: Fallback,
    /// What caused the present fallback, when it began.
    pub cause: Option<Finding>,
    /// All findings of this step.
    pub findings: Vec<Finding>,
}
