//! How a sensor is fixed to the body.

use alula_geometry::{Pose, so3};
use alula_parameters::facts;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Where the optical axis of a sensor points when nothing is misaligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Looking {
    /// Along the body's x axis; the image's top is the body's z axis.
    Forward,
    /// Along the body's -z axis; the image's top is the body's x axis.
    Down,
}

impl Looking {
    /// Orientation of the optical frame (x right, y down, z forward) in the body frame.
    fn body_from_optical(self) -> UnitQuaternion<f64> {
        let columns = match self {
            Self::Forward => [-Vector3::y(), -Vector3::z(), Vector3::x()],
            Self::Down => [-Vector3::y(), -Vector3::x(), -Vector3::z()],
        };
        let matrix = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&columns));
        UnitQuaternion::from_rotation_matrix(&matrix)
    }
}

facts! {
    /// Calibrated pose of a sensor's optical frame in the body frame.
    pub struct Mount {
        /// Origin of the sensor in the body frame, m.
        pub position_m: [f64; 3], within(-2.0, 2.0);
        /// Direction of the optical axis before misalignment.
        pub looking: Looking, any();
        /// Rotation of the sensor about the body's axes, applied after `looking`: roll, pitch,
        /// yaw in degrees.
        pub roll_pitch_yaw_deg: [f64; 3], within(-180.0, 180.0);
    }
}

impl Mount {
    /// A sensor at a place in the body, looking straight.
    pub fn at(position_m: [f64; 3], looking: Looking) -> Self {
        Self {
            position_m,
            looking,
            roll_pitch_yaw_deg: [0.0; 3],
        }
    }

    /// The pose `body_from_sensor` of the optical frame.
    pub fn body_from_sensor(&self) -> Pose {
        let [roll, pitch, yaw] = self.roll_pitch_yaw_deg.map(f64::to_radians);
        Pose::from_parts(
            Translation3::from(Vector3::from(self.position_m)),
            so3::from_roll_pitch_yaw(roll, pitch, yaw) * self.looking.body_from_optical(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(looking: Looking, optical: Vector3<f64>) -> Vector3<f64> {
        Mount::at([0.0; 3], looking).body_from_sensor() * optical
    }

    #[test]
    fn optical_axes_point_where_the_names_say() {
        assert!((axis(Looking::Forward, Vector3::z()) - Vector3::x()).norm() < 1e-12);
        assert!((axis(Looking::Forward, -Vector3::y()) - Vector3::z()).norm() < 1e-12);
        assert!((axis(Looking::Down, Vector3::z()) + Vector3::z()).norm() < 1e-12);
        assert!((axis(Looking::Down, -Vector3::y()) - Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn a_camera_pitched_down_sees_below_the_horizon() {
        let mount = Mount {
            roll_pitch_yaw_deg: [0.0, 20.0, 0.0],
            ..Mount::at([0.1, 0.0, 0.0], Looking::Forward)
        };
        let axis = mount.body_from_sensor() * Vector3::z();
        assert!(axis.z < 0.0);
    }
}
