//! A pose sensor at a known place in the body (document O, equations 2.50 to 2.53).

use alula_geometry::{Pose, so3};
use alula_parameters::parameters;
use nalgebra::{Translation3, Vector3};

parameters! {
    /// Where a pose sensor is in the body and how exact it is.
    pub struct PoseSensorConfig {
        /// Origin of the sensor's frame in the body frame, m.
        pub position_m: [f64; 3] = [0.0; 3], within(-5.0, 5.0);
        /// Orientation of the sensor's frame in the body frame: roll, pitch, yaw in degrees.
        pub roll_pitch_yaw_deg: [f64; 3] = [0.0; 3], within(-180.0, 180.0);
        /// Standard deviation of measured positions on each axis, m.
        pub position_sigma_m: f64 = 0.01, within(1e-5, 10.0);
        /// Standard deviation of measured orientations about each axis, rad.
        pub orientation_sigma_rad: f64 = 0.01, within(1e-5, 1.0);
    }
}

/// A pose sensor ready for use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSensor {
    sensor_from_body: Pose,
    /// Standard deviation of the body's position on each axis, m.
    pub position_sigma_m: f64,
    /// Standard deviation of the orientation about each axis, rad.
    pub orientation_sigma_rad: f64,
}

impl PoseSensor {
    /// A sensor that measures the pose of the body itself.
    pub fn of_body(position_sigma_m: f64, orientation_sigma_rad: f64) -> Self {
        Self {
            sensor_from_body: Pose::identity(),
            position_sigma_m,
            orientation_sigma_rad,
        }
    }

    /// The sensor of a configuration. An error of orientation moves the body's origin by up to the
    /// length of the lever between them: that is added to the noise of its position.
    pub fn new(config: &PoseSensorConfig) -> Self {
        let lever = Vector3::from(config.position_m);
        let [roll, pitch, yaw] = config.roll_pitch_yaw_deg.map(f64::to_radians);
        let turned = so3::from_roll_pitch_yaw(roll, pitch, yaw);
        let body_from_sensor = Pose::from_parts(Translation3::from(lever), turned);
        let swing_m = lever.norm() * config.orientation_sigma_rad;
        Self {
            sensor_from_body: body_from_sensor.inverse(),
            position_sigma_m: config.position_sigma_m.hypot(swing_m),
            orientation_sigma_rad: config.orientation_sigma_rad,
        }
    }

    /// Pose of the body from that of the sensor: R_WQ = R_WP R_QP^T and p_WQ = p_WP - R_WQ p_QP
    /// (document O, 2.53 and 2.52 with its sign put right).
    pub fn world_from_body(&self, world_from_sensor: &Pose) -> Pose {
        world_from_sensor * self.sensor_from_body
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_body_is_found_from_the_sensor() {
        let config = PoseSensorConfig {
            position_m: [0.03, -0.07, 0.1],
            roll_pitch_yaw_deg: [11.0, -6.0, 17.0],
            ..PoseSensorConfig::default()
        };
        let [roll, pitch, yaw] = config.roll_pitch_yaw_deg.map(f64::to_radians);
        let body = Pose::from_parts(
            Translation3::new(1.0, 2.0, 3.0),
            so3::from_roll_pitch_yaw(0.2, -0.1, 2.0),
        );
        let turned = so3::from_roll_pitch_yaw(roll, pitch, yaw);
        let place = body * nalgebra::Point3::from(Vector3::from(config.position_m));
        let sensor = Pose::from_parts(Translation3::from(place), body.rotation * turned);
        let found = PoseSensor::new(&config).world_from_body(&sensor);
        assert!((found.translation.vector - body.translation.vector).norm() < 1e-12);
        assert!(found.rotation.angle_to(&body.rotation) < 1e-12);
    }
}
