//! Sensor samples and truth to their schemas and back, every bit kept.

use alula_geometry::{PinholeCamera, Pose, Timestamp};
use alula_messages::{
    AutopilotStatus, DepthImage, FlowSample, ImuSample, MAX_DEPTH_CAMERAS, PoseSample, RangeSample,
    SensorBatch,
};
use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector2, Vector3};

use crate::recording::TruthRecord;
use crate::schema;

/// Why a message is not one that this crate wrote.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum Mismatch {
    /// Not a message of its schema.
    #[error("a message does not fit its schema: {0}")]
    Decode(#[from] prost::DecodeError),
    /// An enumeration with an unknown value.
    #[error("a message holds {0}")]
    Enumeration(#[from] prost::UnknownEnumValue),
    /// A field that its neighbours call for is not there.
    #[error("a message lacks `{0}`")]
    Absent(&'static str),
    /// A matrix of another size.
    #[error("a covariance has {found} numbers instead of {triangle} or {whole}")]
    Covariance {
        found: usize,
        triangle: usize,
        whole: usize,
    },
    /// A plan with another horizon.
    #[error("a plan has {0} points instead of 26")]
    PlanPoints(usize),
    /// A number that is too large for its field.
    #[error("`{0}` is too large")]
    TooLarge(&'static str),
    /// A batch or an output whose parts are not all there.
    #[error("{0} is incomplete")]
    Incomplete(&'static str),
}

/// A type with a schema.
pub(crate) trait Recorded: Sized {
    /// Its schema.
    type Message;
    fn to_message(&self) -> Self::Message;
    fn from_message(message: &Self::Message) -> Result<Self, Mismatch>;
}

pub(crate) fn time(ns: i64) -> Timestamp {
    Timestamp::from_ns(ns)
}

pub(crate) fn vector_to(v: &Vector3<f64>) -> schema::Vector3 {
    schema::Vector3 {
        x: v.x,
        y: v.y,
        z: v.z,
    }
}

pub(crate) fn vector_from(v: &schema::Vector3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

pub(crate) fn pose_to(pose: &Pose) -> schema::Pose {
    let q = &pose.rotation;
    schema::Pose {
        position_m: vector_to(&pose.translation.vector),
        orientation: schema::Quaternion {
            w: q.w,
            x: q.i,
            y: q.j,
            z: q.k,
        },
    }
}

pub(crate) fn pose_from(pose: &schema::Pose) -> Pose {
    let q = &pose.orientation;
    // Normalising again could change the last bit.
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z));
    Pose::from_parts(Translation3::from(vector_from(&pose.position_m)), rotation)
}

impl Recorded for ImuSample {
    type Message = schema::ImuSample;

    fn to_message(&self) -> schema::ImuSample {
        schema::ImuSample {
            time_ns: self.time.as_ns(),
            specific_force_body_m_s2: vector_to(&self.specific_force),
            angular_rate_body_rad_s: vector_to(&self.angular_rate),
        }
    }

    fn from_message(message: &schema::ImuSample) -> Result<Self, Mismatch> {
        Ok(Self {
            time: time(message.time_ns),
            specific_force: vector_from(&message.specific_force_body_m_s2),
            angular_rate: vector_from(&message.angular_rate_body_rad_s),
        })
    }
}

impl Recorded for FlowSample {
    type Message = schema::FlowSample;

    fn to_message(&self) -> schema::FlowSample {
        schema::FlowSample {
            time_ns: self.time.as_ns(),
            interval_s: self.interval_s,
            flow_x_rad_s: self.flow_rad_s.x,
            flow_y_rad_s: self.flow_rad_s.y,
            quality: self.quality,
        }
    }

    fn from_message(message: &schema::FlowSample) -> Result<Self, Mismatch> {
        Ok(Self {
            time: time(message.time_ns),
            interval_s: message.interval_s,
            flow_rad_s: Vector2::new(message.flow_x_rad_s, message.flow_y_rad_s),
            quality: message.quality,
        })
    }
}

impl Recorded for RangeSample {
    type Message = schema::RangeSample;

    fn to_message(&self) -> schema::RangeSample {
        schema::RangeSample {
            time_ns: self.time.as_ns(),
            range_m: self.range_m,
            min_m: self.min_m,
            max_m: self.max_m,
        }
    }

    fn from_message(message: &schema::RangeSample) -> Result<Self, Mismatch> {
        Ok(Self {
            time: time(message.time_ns),
            range_m: message.range_m,
            min_m: message.min_m,
            max_m: message.max_m,
        })
    }
}

impl Recorded for PoseSample {
    type Message = schema::PoseSample;

    fn to_message(&self) -> schema::PoseSample {
        schema::PoseSample {
            time_ns: self.time.as_ns(),
            world_from_body: pose_to(&self.world_from_body),
            sensor: (self.sensor != 0).then_some(u32::from(self.sensor)),
        }
    }

    fn from_message(message: &schema::PoseSample) -> Result<Self, Mismatch> {
        Ok(Self {
            time: time(message.time_ns),
            sensor: u8::try_from(message.sensor.unwrap_or(0))
                .map_err(|_| Mismatch::TooLarge("sensor"))?,
            world_from_body: pose_from(&message.world_from_body),
        })
    }
}

impl Recorded for AutopilotStatus {
    type Message = schema::AutopilotStatus;

    fn to_message(&self) -> schema::AutopilotStatus {
        schema::AutopilotStatus {
            time_ns: self.time.as_ns(),
            armed: self.armed,
            thrust_fraction: self.thrust_fraction,
        }
    }

    fn from_message(message: &schema::AutopilotStatus) -> Result<Self, Mismatch> {
        Ok(Self {
            time: time(message.time_ns),
            armed: message.armed,
            thrust_fraction: message.thrust_fraction,
        })
    }
}

impl Recorded for TruthRecord {
    type Message = schema::Truth;

    fn to_message(&self) -> schema::Truth {
        schema::Truth {
            time_ns: self.time.as_ns(),
            world_from_body: pose_to(&self.world_from_body),
            velocity_world_m_s: vector_to(&self.velocity_world),
            clearance_m: self.clearance_m,
        }
    }

    fn from_message(message: &schema::Truth) -> Result<Self, Mismatch> {
        Ok(Self {
            time: time(message.time_ns),
            world_from_body: pose_from(&message.world_from_body),
            velocity_world: vector_from(&message.velocity_world_m_s),
            clearance_m: message.clearance_m,
        })
    }
}

/// What a depth image is, without its pixels.
pub(crate) fn depth_info(image: &DepthImage) -> schema::DepthImageInfo {
    let camera = &image.camera;
    schema::DepthImageInfo {
        time_ns: image.time.as_ns(),
        sensor: Some(u32::from(image.sensor)),
        width_px: camera.width_px,
        height_px: camera.height_px,
        fx_px: camera.fx_px,
        fy_px: camera.fy_px,
        cx_px: camera.cx_px,
        cy_px: camera.cy_px,
        body_from_camera: pose_to(&image.body_from_camera),
    }
}

/// A depth image from what it is and its pixels.
pub(crate) fn depth_image(
    info: &schema::DepthImageInfo,
    depth_mm: Vec<u16>,
) -> Result<DepthImage, Mismatch> {
    Ok(DepthImage {
        time: time(info.time_ns),
        sensor: depth_sensor(info.sensor())?,
        camera: PinholeCamera {
            width_px: info.width_px,
            height_px: info.height_px,
            fx_px: info.fx_px,
            fy_px: info.fy_px,
            cx_px: info.cx_px,
            cy_px: info.cy_px,
        },
        body_from_camera: pose_from(&info.body_from_camera),
        depth_mm,
    })
}

/// The number of a depth camera.
pub(crate) fn depth_sensor(number: u32) -> Result<u8, Mismatch> {
    let number = u8::try_from(number).ok();
    number
        .filter(|number| usize::from(*number) < MAX_DEPTH_CAMERAS)
        .ok_or(Mismatch::TooLarge("sensor"))
}

/// Fills the message that ends a batch.
pub(crate) fn fill_batch(message: &mut schema::Batch, batch: &SensorBatch) {
    // No vehicle delivers four thousand million samples in one period.
    let count = |length: usize| length as u32;
    message.now_ns = batch.now.as_ns();
    message.imu = count(batch.imu.len());
    message.flow = count(batch.flow.len());
    message.sonar = count(batch.sonar.len());
    message.infrared = count(batch.infrared.len());
    message.motion_capture = count(batch.poses.len());
    message.autopilot = count(batch.autopilot.len());
    message.depth.clear();
    message
        .depth
        .extend(batch.depth.iter().map(|image| depth_info(image)));
}
