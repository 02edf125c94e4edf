//! Samples of sensors, each with the time at which it was true.

use std::sync::Arc;

use alula_geometry::{PinholeCamera, Pose, Timestamp};
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// A sample of the inertial measurement unit, in the body frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImuSample {
    /// Time of measurement.
    pub time: Timestamp,
    /// Acceleration less gravity, body frame, m/s^2: +9.8 along z at rest.
    pub specific_force: Vector3<f64>,
    /// Angular rate of the body with respect to the world, body frame, rad/s.
    pub angular_rate: Vector3<f64>,
}

/// Mean image motion around the principal point of a flow camera over an exposure interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlowSample {
    /// Middle of the interval over which the motion was measured.
    pub time: Timestamp,
    /// Length of that interval, s.
    pub interval_s: f64,
    /// Image velocity in the camera's optical frame (x right, y down), rad/s: pixels per second
    /// divided by the focal length in pixels. Rotation is not compensated.
    pub flow_rad_s: Vector2<f64>,
    /// Share of the image that could be matched, 0 (useless) to 1.
    pub quality: f64,
}

/// A reading of a ranger. Readings outside the limits mean that there was no valid echo.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RangeSample {
    /// Time of measurement.
    pub time: Timestamp,
    /// Distance along the beam, m.
    pub range_m: f64,
    /// Least distance the sensor can measure, m.
    pub min_m: f64,
    /// Greatest distance the sensor can measure, m.
    pub max_m: f64,
}

impl RangeSample {
    /// Whether the reading is a distance.
    pub fn is_valid(&self) -> bool {
        self.range_m >= self.min_m && self.range_m <= self.max_m
    }
}

/// A pose measured from outside, for example by motion capture, or by a camera that knows the room.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseSample {
    /// Time of measurement; the sample may arrive much later.
    pub time: Timestamp,
    /// Which of the vehicle's pose sensors it comes from, from 0.
    #[serde(default)]
    pub sensor: u8,
    /// The measured pose, in the world frame, of the body frame; or of the sensor's own frame if
    /// the estimator is told where in the body the sensor is.
    pub world_from_body: Pose,
}

/// Depth cameras that a vehicle can carry.
pub const MAX_DEPTH_CAMERAS: usize = 4;

/// A depth image, rows from the top, millimetres along the optical axis; 0 means no return.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthImage {
    /// Time of exposure.
    pub time: Timestamp,
    /// Which of the vehicle's depth cameras took it, below [`MAX_DEPTH_CAMERAS`]; 0 looks ahead.
    pub sensor: u8,
    /// Projection of the camera, which also gives the size of the image.
    pub camera: PinholeCamera,
    /// Pose of the camera's optical frame in the body frame.
    pub body_from_camera: Pose,
    /// `width * height` depths, mm.
    pub depth_mm: Vec<u16>,
}

impl DepthImage {
    /// A number that two images share only if they show the same to the last bit, as a camera that
    /// is stuck does. It looks at every 97th pixel, a step coprime to common widths.
    pub fn fingerprint(&self) -> u64 {
        // FNV-1a.
        let start = 0xcbf2_9ce4_8422_2325_u64;
        let looked = self.depth_mm.iter().step_by(97);
        looked.fold(start, |hash, mm| {
            (hash ^ u64::from(*mm)).wrapping_mul(0x0100_0000_01b3)
        })
    }
}

/// What an autopilot says about itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutopilotStatus {
    /// Time of the report.
    pub time: Timestamp,
    /// Whether the motors may turn.
    pub armed: bool,
    /// Collective thrust that is being produced, as a share (0 to 1) of the greatest possible.
    pub thrust_fraction: f64,
}

/// All that arrived from a vehicle since the last batch. The vectors are cleared and filled again,
/// so that a flight allocates nothing once they have grown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorBatch {
    /// The present: no sample is later. One that is counts for the guard as not arrived.
    pub now: Timestamp,
    /// Inertial samples, oldest first.
    pub imu: Vec<ImuSample>,
    /// Flow camera samples, oldest first.
    pub flow: Vec<FlowSample>,
    /// Ultrasonic ranger, oldest first.
    pub sonar: Vec<RangeSample>,
    /// Infrared or laser ranger, oldest first.
    pub infrared: Vec<RangeSample>,
    /// External poses, oldest first.
    pub poses: Vec<PoseSample>,
    /// Depth images of all cameras, oldest first; shared because they are large.
    pub depth: Vec<Arc<DepthImage>>,
    /// Reports of the autopilot, oldest first.
    pub autopilot: Vec<AutopilotStatus>,
}

impl SensorBatch {
    /// Removes all samples and keeps their memory.
    pub fn clear(&mut self) {
        self.imu.clear();
        self.flow.clear();
        self.sonar.clear();
        self.infrared.clear();
        self.poses.clear();
        self.depth.clear();
        self.autopilot.clear();
    }
}
