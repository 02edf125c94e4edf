//! The volume that the depth camera sees.

use alula_geometry::Pose;
use nalgebra::Vector3;

/// Half-spaces of a field of view.
pub const VIEW_SIDES: usize = 5;

/// The volume that a camera sees, as five half-spaces of the world: four sides and the range
/// (document L, equation 6-16).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldOfView {
    normals_world: [Vector3<f64>; VIEW_SIDES],
    offsets_m: [f64; VIEW_SIDES],
}

impl FieldOfView {
    /// The view of a camera with these full opening angles (rad, below pi) and this range (m)
    /// along its axis. The apex lies `setback_m` behind the camera, so that the vehicle itself is
    /// inside the volume.
    pub fn new(
        world_from_camera: &Pose,
        horizontal_rad: f64,
        vertical_rad: f64,
        range_m: f64,
        setback_m: f64,
    ) -> Self {
        let (sh, ch) = (0.5 * horizontal_rad).sin_cos();
        let (sv, cv) = (0.5 * vertical_rad).sin_cos();
        let normals_camera = [
            Vector3::new(ch, 0.0, -sh),
            Vector3::new(-ch, 0.0, -sh),
            Vector3::new(0.0, cv, -sv),
            Vector3::new(0.0, -cv, -sv),
            Vector3::z(),
        ];
        let apex_world = world_from_camera * nalgebra::Point3::new(0.0, 0.0, -setback_m);
        let normals_world = normals_camera.map(|n| world_from_camera.rotation * n);
        let mut offsets_m = normals_world.map(|n| n.dot(&apex_world.coords));
        offsets_m[VIEW_SIDES - 1] += setback_m + range_m;
        Self {
            normals_world,
            offsets_m,
        }
    }

    /// Distances inside the five sides (m, negative outside) with the gradients.
    pub fn sides(
        &self,
        point_world: &Vector3<f64>,
    ) -> impl Iterator<Item = (f64, Vector3<f64>)> + use<> {
        let (point, offsets) = (*point_world, self.offsets_m);
        self.normals_world
            .into_iter()
            .zip(offsets)
            .map(move |(n, m)| (m - n.dot(&point), -n))
    }

    /// Whether a point lies in the volume.
    pub fn contains(&self, point_world: &Vector3<f64>) -> bool {
        self.sides(point_world).all(|(inside_m, _)| inside_m >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    /// A camera at the origin that looks along the world's z axis.
    fn view() -> FieldOfView {
        FieldOfView::new(&Pose::identity(), 1.6, 1.0, 4.0, 0.5)
    }

    #[test]
    fn the_camera_itself_lies_inside() {
        assert!(view().contains(&Vector3::zeros()));
    }

    #[test]
    fn the_range_counts_from_the_camera() {
        assert!(view().contains(&Vector3::new(0.0, 0.0, 3.99)));
        assert!(!view().contains(&Vector3::new(0.0, 0.0, 4.01)));
    }

    #[test]
    fn sides_open_by_half_the_angle_from_the_apex() {
        let edge = 2.5 * 0.8_f64.tan();
        assert!(view().contains(&Vector3::new(edge - 1e-9, 0.0, 2.0)));
        assert!(!view().contains(&Vector3::new(edge + 1e-9, 0.0, 2.0)));
        let edge = 2.5 * 0.5_f64.tan();
        assert!(view().contains(&Vector3::new(0.0, -edge + 1e-9, 2.0)));
        assert!(!view().contains(&Vector3::new(0.0, -edge - 1e-9, 2.0)));
    }

    #[test]
    fn the_volume_moves_with_the_camera() {
        let pose = Pose::from_parts(
            Vector3::new(3.0, -2.0, 1.0).into(),
            UnitQuaternion::from_euler_angles(0.3, -0.8, 2.0),
        );
        let moved = FieldOfView::new(&pose, 1.6, 1.0, 4.0, 0.5);
        for point in [
            Vector3::new(0.3, 0.4, 2.0),
            Vector3::new(3.0, 0.0, 2.0),
            Vector3::new(0.0, 2.0, 1.0),
            Vector3::new(0.0, 0.0, 5.0),
        ] {
            let point_world = pose * nalgebra::Point3::from(point);
            for ((a, _), (b, _)) in view().sides(&point).zip(moved.sides(&point_world.coords)) {
                assert!((a - b).abs() < 1e-12);
            }
        }
    }
}
