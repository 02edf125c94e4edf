//! What the vehicle sees around it: boxes in one depth image, and obstacles followed through many.

use alula_geometry::Timestamp;
use nalgebra::{Matrix3, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// Shape of an obstacle seen from above, within its box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Footprint {
    /// An ellipse that fills the box: people, pillars, trees, and anything compact.
    #[default]
    Round,
    /// A thin flat piece of a surface, along the box's own x axis: walls and faces of large boxes.
    Flat,
}

/// Sides of the image, or of the range of depths, or of a neighbour, at which a box is cut off: it
/// may go on there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cut {
    /// At the left border.
    pub left: bool,
    /// At the right border.
    pub right: bool,
    /// At the upper border.
    pub top: bool,
    /// At the lower border.
    pub bottom: bool,
}

/// A part of an image, in pixels, borders included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PixelBox {
    /// First column.
    pub left: u16,
    /// Last column.
    pub right: u16,
    /// First row.
    pub top: u16,
    /// Last row.
    pub bottom: u16,
}

/// A box around a thing seen in one depth image (document L, section 5-1-3). Its vertical axis is
/// the world's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Detection {
    /// Which of the vehicle's depth cameras saw it.
    pub sensor: u8,
    /// Centre, world, m.
    pub centre_world: Vector3<f64>,
    /// Heading of the box's own x axis, counter-clockwise from east, rad.
    pub yaw_rad: f64,
    /// Full lengths along the box's own x, y and z axes, m.
    pub size_m: Vector3<f64>,
    /// What fills the box.
    pub footprint: Footprint,
    /// Covariance of the centre, world, m^2: of the sensor and of the vehicle's attitude, not of
    /// the vehicle's position, in which all detections share.
    pub centre_covariance: Matrix3<f64>,
    /// Variances of the lengths, m^2.
    pub size_variance_m2: Vector3<f64>,
    /// Where the image, or a neighbour that it touches, cuts it off.
    pub cut: Cut,
    /// Where it is in the image.
    pub window: PixelBox,
    /// Least and greatest depth of the seen surface along the level viewing direction, m.
    pub depth_m: [f64; 2],
    /// Pixels that support it.
    pub pixels: u32,
}

/// Whether an obstacle stands or moves, by test of its velocity against its covariance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObstacleMotion {
    /// Seen too briefly to tell.
    #[default]
    Undecided,
    /// Stands still.
    Static,
    /// Moves.
    Moving,
}

/// Whether an obstacle was seen in the last image, and why not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sight {
    /// Seen.
    #[default]
    Seen,
    /// Something nearer stands in the line of sight.
    Hidden,
    /// Outside the field of view.
    OutOfView,
    /// It should have been seen and was not.
    Missed,
}

/// Covariance of position (world, m) and velocity (world, m/s) of an obstacle.
pub type ObstacleCovariance = SMatrix<f64, 6, 6>;

/// An obstacle that is followed through the images (document L, section 5-2).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Obstacle {
    /// Number of the track; never used twice in a flight.
    pub id: u32,
    /// Time of the state.
    pub time: Timestamp,
    /// Centre, world, m.
    pub centre_world: Vector3<f64>,
    /// Velocity, world, m/s.
    pub velocity_world: Vector3<f64>,
    /// Covariance of centre and velocity. Velocity is bounded as the tracker's parameters say.
    pub covariance: ObstacleCovariance,
    /// Heading of the box's own x axis, rad.
    pub yaw_rad: f64,
    /// Full lengths along the box's own axes, m.
    pub size_m: Vector3<f64>,
    /// Variances of the lengths, m^2.
    pub size_variance_m2: Vector3<f64>,
    /// What fills the box.
    pub footprint: Footprint,
    /// Whether it moves.
    pub motion: ObstacleMotion,
    /// Whether it is seen.
    pub sight: Sight,
    /// When it was seen last.
    pub last_seen: Timestamp,
    /// Number of images in which it was seen.
    pub images: u32,
}

impl Obstacle {
    /// Centre after `dt_s` at constant velocity, world, m.
    pub fn centre_after(&self, dt_s: f64) -> Vector3<f64> {
        self.centre_world + self.velocity_world * dt_s
    }

    /// Covariance of the centre after `dt_s` at constant velocity, with the cross covariance of
    /// position and velocity, m^2.
    pub fn centre_covariance_after(&self, dt_s: f64) -> Matrix3<f64> {
        let position = self.covariance.fixed_view::<3, 3>(0, 0);
        let cross = self.covariance.fixed_view::<3, 3>(0, 3);
        let velocity = self.covariance.fixed_view::<3, 3>(3, 3);
        position + (cross + cross.transpose()) * dt_s + velocity * (dt_s * dt_s)
    }
}
