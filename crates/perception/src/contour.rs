//! How far the view is free in every direction of one depth image.

use alula_geometry::Timestamp;
use nalgebra::Vector3;

/// An image may be so much older than the last one of another camera, which arrives sooner, s; it is
/// then taken for one of the same time.
pub const MOST_LATE_S: f64 = 0.1;

/// Whether an image is older than the last one of all by more than [`MOST_LATE_S`].
pub(crate) fn is_too_late(time: Timestamp, last: Option<Timestamp>) -> bool {
    last.is_some_and(|last| time.seconds_since(last) < -MOST_LATE_S)
}

/// What ends the free view in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RayEnd {
    /// The image says nothing in this direction.
    #[default]
    Unknown,
    /// Nothing was met up to the range: seen ground or distant things lie behind it.
    Free,
    /// Something stands there.
    Hit,
}

/// The view in one horizontal direction, at the heights at which the vehicle may fly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ray {
    /// Heading in the world, counter-clockwise from east, rad.
    pub heading_rad: f64,
    /// Horizontal distance from the camera up to which the view is free, m.
    pub range_m: f64,
    /// What ends it.
    pub end: RayEnd,
}

/// The free view of one image: rays from left to right (falling heading), of equal width in the
/// image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contour {
    /// Time of exposure.
    pub time: Timestamp,
    /// Which of the vehicle's depth cameras took the image.
    pub sensor: u8,
    /// Position of the camera, world, m.
    pub camera_world: Vector3<f64>,
    /// The rays.
    pub rays: Vec<Ray>,
}
