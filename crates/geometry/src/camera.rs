//! Camera models. The optical frame has x right, y down, z forward; pixel (0, 0) is the centre of
//! the top-left pixel.

use nalgebra::{Matrix2x3, Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A pinhole camera without distortion (document O, equation 2.17).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PinholeCamera {
    /// Columns of the image.
    pub width_px: u32,
    /// Rows of the image.
    pub height_px: u32,
    /// Focal length along x, pixels.
    pub fx_px: f64,
    /// Focal length along y, pixels.
    pub fy_px: f64,
    /// Column of the principal point, pixels.
    pub cx_px: f64,
    /// Row of the principal point, pixels.
    pub cy_px: f64,
}

impl PinholeCamera {
    /// A camera whose image spans the given full opening angles (rad), centred.
    pub fn from_field_of_view(
        width_px: u32,
        height_px: u32,
        horizontal_rad: f64,
        vertical_rad: f64,
    ) -> Self {
        let (w, h) = (f64::from(width_px), f64::from(height_px));
        Self {
            width_px,
            height_px,
            fx_px: 0.5 * w / (0.5 * horizontal_rad).tan(),
            fy_px: 0.5 * h / (0.5 * vertical_rad).tan(),
            cx_px: 0.5 * (w - 1.0),
            cy_px: 0.5 * (h - 1.0),
        }
    }

    /// Full opening angles of a centred image, horizontal and vertical, rad.
    pub fn field_of_view_rad(&self) -> [f64; 2] {
        [(self.width_px, self.fx_px), (self.height_px, self.fy_px)]
            .map(|(pixels, focal_px)| 2.0 * (0.5 * f64::from(pixels) / focal_px).atan())
    }

    /// Pixel of a point in the optical frame (m); `None` behind or in the plane of the camera.
    pub fn project(&self, point_camera: &Point3<f64>) -> Option<Point2<f64>> {
        (point_camera.z > 0.0).then(|| {
            Point2::new(
                self.fx_px * point_camera.x / point_camera.z + self.cx_px,
                self.fy_px * point_camera.y / point_camera.z + self.cy_px,
            )
        })
    }

    /// Derivative (pixels per metre) of [`Self::project`] with respect to the point.
    pub fn project_jacobian(&self, point_camera: &Point3<f64>) -> Matrix2x3<f64> {
        let (x, y, z) = (point_camera.x, point_camera.y, point_camera.z);
        Matrix2x3::new(
            self.fx_px / z,
            0.0,
            -self.fx_px * x / (z * z),
            0.0,
            self.fy_px / z,
            -self.fy_px * y / (z * z),
        )
    }

    /// Direction through a pixel in the optical frame, scaled to unit depth (z = 1).
    pub fn ray(&self, u_px: f64, v_px: f64) -> Vector3<f64> {
        Vector3::new(
            (u_px - self.cx_px) / self.fx_px,
            (v_px - self.cy_px) / self.fy_px,
            1.0,
        )
    }

    /// Point in the optical frame (m) seen at a pixel with depth `depth_m` along z.
    pub fn unproject(&self, u_px: f64, v_px: f64, depth_m: f64) -> Point3<f64> {
        Point3::from(self.ray(u_px, v_px) * depth_m)
    }

    /// Whether a pixel lies on the image.
    pub fn contains(&self, pixel: &Point2<f64>) -> bool {
        pixel.x >= -0.5
            && pixel.y >= -0.5
            && pixel.x <= f64::from(self.width_px) - 0.5
            && pixel.y <= f64::from(self.height_px) - 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera() -> PinholeCamera {
        PinholeCamera::from_field_of_view(424, 240, 87_f64.to_radians(), 58_f64.to_radians())
    }

    proptest! {
        #[test]
        fn unproject_undoes_project(x in -3.0..3.0, y in -2.0..2.0, z in 0.2..10.0_f64) {
            let point = Point3::new(x, y, z);
            let pixel = camera().project(&point).unwrap();
            prop_assert!((camera().unproject(pixel.x, pixel.y, z) - point).norm() < 1e-12);
        }

        #[test]
        fn projection_jacobian_meets_differences(x in -1.0..1.0, y in -1.0..1.0, z in 0.5..5.0_f64) {
            let h = 1e-6;
            let point = Point3::new(x, y, z);
            let jacobian = camera().project_jacobian(&point);
            for k in 0..3 {
                let mut d = Vector3::zeros();
                d[k] = h;
                let ahead = camera().project(&(point + d)).unwrap();
                let behind = camera().project(&(point - d)).unwrap();
                let column = (ahead - behind) / (2.0 * h);
                prop_assert!((column - jacobian.column(k)).norm() < 1e-4);
            }
        }
    }

    #[test]
    fn the_field_of_view_is_that_of_construction() {
        let camera = PinholeCamera::from_field_of_view(424, 240, 1.5, 1.0);
        let [horizontal, vertical] = camera.field_of_view_rad();
        assert!((horizontal - 1.5).abs() < 1e-12 && (vertical - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_field_of_view_ends_at_the_outer_edges_of_the_pixels() {
        let half = 43.5_f64.to_radians();
        let edge = camera()
            .project(&Point3::new(half.tan(), 0.0, 1.0))
            .unwrap();
        assert!((edge.x - 423.5).abs() < 1e-9);
    }

    #[test]
    fn points_behind_the_camera_have_no_pixel() {
        assert!(camera().project(&Point3::new(0.0, 0.0, -1.0)).is_none());
    }
}
