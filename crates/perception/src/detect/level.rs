//! The camera's view with its roll and pitch taken out, so that columns are vertical in the world.

use alula_geometry::{PinholeCamera, Pose};
use alula_messages::DepthImage;
use nalgebra::{Matrix3, Vector2, Vector3};

use super::View;

/// Least horizontal share of the optical axis: a camera that looks nearly straight up or down has
/// no level view.
const LEAST_FORWARD: f64 = 0.2;

/// Least depth, as a share of that along the optical axis, of a ray in the level view.
pub(super) const LEAST_AHEAD: f64 = 0.3;

/// A camera that looks horizontally from where the real one is: x right, y down along the world's
/// vertical, z ahead. Its columns are as wide (in tangent) as those of the real camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    pub world_from_level: Matrix3<f64>,
    pub level_from_camera: Matrix3<f64>,
    /// Which of the vehicle's depth cameras it is.
    pub sensor: u8,
    pub camera: PinholeCamera,
    pub camera_world: Vector3<f64>,
    pub body_world: Vector3<f64>,
    /// Covariance of the vehicle's orientation in the world, rad^2.
    pub orientation_world: Matrix3<f64>,
    /// Largest standard deviation of its orientation, rad.
    pub orientation_sigma_rad: f64,
    /// Height of the camera above the floor, m.
    pub above_floor_m: Option<f64>,
    /// Columns per unit of tangent.
    pub columns_per_tan: f64,
    /// Tangent of the first column's middle.
    pub first_tan: f64,
    /// Columns of the level view.
    pub columns: usize,
    /// Columns that no attitude exceeds.
    pub most_columns: usize,
    /// No elevation's tangent is larger.
    pub steepest_tan: f64,
}

impl Level {
    /// `None` where the image or the view makes no sense, or where the camera looks straight up or
    /// down.
    pub fn new(image: &DepthImage, view: &View) -> Option<Self> {
        let camera = image.camera;
        let world_from_camera = view.world_from_body * image.body_from_camera;
        let finite = is_usable(&camera)
            && is_finite(&world_from_camera)
            && view.orientation_covariance.iter().all(|v| v.is_finite())
            && view.floor_height_m.is_none_or(f64::is_finite);
        let pixels = camera.width_px as usize * camera.height_px as usize;
        if !finite || image.depth_mm.len() != pixels {
            return None;
        }
        let world_from_level = level_axes(&world_from_camera)?;
        let world_from_body = view.world_from_body.rotation.to_rotation_matrix();
        let r = world_from_body.matrix();
        let rotation = world_from_camera.rotation.to_rotation_matrix();
        let mut level = Self {
            world_from_level,
            level_from_camera: world_from_level.transpose() * rotation.matrix(),
            sensor: image.sensor,
            camera,
            camera_world: world_from_camera.translation.vector,
            body_world: view.world_from_body.translation.vector,
            orientation_world: r * view.orientation_covariance * r.transpose(),
            orientation_sigma_rad: view.orientation_covariance.diagonal().max().max(0.0).sqrt(),
            above_floor_m: view
                .floor_height_m
                .map(|floor| world_from_camera.translation.z - floor),
            columns_per_tan: camera.fx_px,
            first_tan: 0.0,
            columns: 0,
            most_columns: 0,
            steepest_tan: 0.0,
        };
        level.span();
        Some(level)
    }

    /// Covers the image. Tangents over a rectangle are extreme at its corners, unless it reaches
    /// rays that are hardly ahead: then everything that is ahead is covered.
    fn span(&mut self) {
        let (w, h) = (
            f64::from(self.camera.width_px) - 1.0,
            f64::from(self.camera.height_px) - 1.0,
        );
        let corners = [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)];
        let rays = corners.map(|(u, v)| self.level_from_camera * self.camera.ray(u, v));
        let across = rays.iter().fold(0.0_f64, |most, ray| most.max(ray.x.abs()));
        let upright = rays.iter().fold(0.0_f64, |most, ray| most.max(ray.y.abs()));
        self.steepest_tan = upright / LEAST_AHEAD + 1.0;
        let (mut low, mut high) = (-across / LEAST_AHEAD, across / LEAST_AHEAD);
        if rays.iter().all(|ray| ray.z >= LEAST_AHEAD) {
            let tans = rays.map(|ray| ray.x / ray.z);
            low = tans.iter().copied().fold(f64::INFINITY, f64::min);
            high = tans.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        }
        let longest = rays.iter().fold(0.0_f64, |most, ray| most.max(ray.norm()));
        self.most_columns =
            (2.0 * longest / LEAST_AHEAD * self.columns_per_tan).ceil() as usize + 1;
        self.first_tan = low;
        self.columns = ((high - low) * self.columns_per_tan).ceil() as usize + 1;
    }

    /// Tangent of the direction of a column's middle.
    pub fn tan(&self, column: usize) -> f64 {
        self.first_tan + column as f64 / self.columns_per_tan
    }

    /// Direction in the world of a horizontal direction (right, ahead) of the level view.
    pub fn direction_world(&self, direction: &Vector2<f64>) -> Vector3<f64> {
        self.world_from_level * Vector3::new(direction.x, 0.0, direction.y)
    }

    /// Heading in the world of a horizontal direction (right, ahead), rad.
    pub fn heading_rad(&self, direction: &Vector2<f64>) -> f64 {
        let d = self.direction_world(direction);
        d.y.atan2(d.x)
    }

    /// Point in the world at (right, ahead), m, and a height above the camera, m.
    pub fn point_world(&self, point: &Vector2<f64>, up_m: f64) -> Vector3<f64> {
        self.camera_world + self.direction_world(point) + Vector3::new(0.0, 0.0, up_m)
    }
}

/// Axes of the level view: down is the world's, ahead is the horizontal part of the optical axis.
fn level_axes(world_from_camera: &Pose) -> Option<Matrix3<f64>> {
    let axis = world_from_camera.rotation * Vector3::z();
    let forward = Vector3::new(axis.x, axis.y, 0.0);
    if forward.norm() < LEAST_FORWARD {
        return None;
    }
    let forward = forward.normalize();
    let down = -Vector3::z();
    Some(Matrix3::from_columns(&[
        down.cross(&forward),
        down,
        forward,
    ]))
}

fn is_usable(camera: &PinholeCamera) -> bool {
    let focal = [camera.fx_px, camera.fy_px];
    let centre = [camera.cx_px, camera.cy_px];
    let size = [camera.width_px, camera.height_px];
    focal.iter().all(|f| f.is_finite() && *f > 0.0)
        && centre.iter().all(|c| c.is_finite())
        && size.iter().all(|s| (1..=4096).contains(s))
}

fn is_finite(pose: &Pose) -> bool {
    let q = pose.rotation.coords;
    let unit = (q.norm_squared() - 1.0).abs() < 1e-3;
    unit && pose.translation.vector.iter().all(|v| v.is_finite())
}
