//! Time stamps, rotations and poses with their Jacobians, camera models and Gaussian helpers.
//!
//! One convention holds in every crate: world ENU (x east, y north, z up), body FLU (x forward, y
//! left, z up), camera optical frame (x right, y down, z forward), SI units, Hamilton quaternions.
//! A transform is named `a_from_b` and maps coordinates in `b` to coordinates in `a`, so that names
//! cancel: `point_world = world_from_body * body_from_camera * point_camera`.

pub mod camera;
pub mod gaussian;
pub mod so3;
mod time;

pub use camera::PinholeCamera;
pub use time::{TimeDelta, Timestamp};

/// Rigid transform; `world_from_body` maps points in the body frame to points in the world frame.
pub type Pose = nalgebra::Isometry3<f64>;

/// Standard acceleration of gravity, m/s^2 (CGPM 1901).
pub const GRAVITY_M_S2: f64 = 9.80665;

/// Acceleration of gravity in the world frame (ENU), m/s^2.
pub fn gravity_world() -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::new(0.0, 0.0, -GRAVITY_M_S2)
}
