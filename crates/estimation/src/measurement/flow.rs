//! Raw flow at the principal point of a camera that looks at the ground (document S, 2.4.3).

use alula_geometry::{Pose, so3};
use alula_messages::{Rejection, error_index};
use nalgebra::{Matrix2x3, RowVector3, SMatrix, Vector2, Vector3};

use super::Model;
use crate::eskf::{Linearised, Nominal, Seen};

/// Least downward part of the optical axis: beyond 60 degrees the ground point is far away and
/// its distance changes too much over the image for one flow to describe it.
const LEAST_DOWNWARD: f64 = 0.5;

/// A reading of a flow camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowMeasurement {
    /// Image velocity, optical frame, rad/s.
    pub flow_rad_s: Vector2<f64>,
    /// Angular rate that the gyroscope measured over the same interval, body frame, bias
    /// included, rad/s.
    pub angular_rate: Vector3<f64>,
    /// Interval over which both were measured, s.
    pub interval_s: f64,
    /// Calibrated pose of the camera.
    pub body_from_camera: Pose,
    /// Standard deviation of the flow on each axis, rad/s.
    pub sigma_rad_s: f64,
    /// Distance along the optical axis below which the camera sees nothing sharp, m.
    pub min_distance_m: f64,
}

/// Distance along the optical axis of a downward sensor to the plane z = 0, with its derivative
/// with respect to the error state (document S, equation 2.26 with the sign of a z-up world).
///
/// d = -h / r with h = e3 . (p + R t), r = e3 . (R C e3); `None` unless `r` is below
/// -[`LEAST_DOWNWARD`].
pub(super) fn distance_to_ground(
    nominal: &Nominal,
    body_from_sensor: &Pose,
) -> Option<(f64, SMatrix<f64, 1, 15>)> {
    let rotation = nominal.world_from_body.to_rotation_matrix().into_inner();
    let up_body = rotation.transpose() * Vector3::z();
    let lever = body_from_sensor.translation.vector;
    let axis = body_from_sensor.rotation * Vector3::z();
    let height = nominal.position_world.z + up_body.dot(&lever);
    let downward = up_body.dot(&axis);
    if downward > -LEAST_DOWNWARD {
        return None;
    }
    // e3 . R Exp(error) a = u . a + (a x u) . error with u = R^T e3
    let height_from_turn = lever.cross(&up_body);
    let downward_from_turn = axis.cross(&up_body);
    let from_turn: RowVector3<f64> = (downward_from_turn * (height / (downward * downward))
        - height_from_turn / downward)
        .transpose();
    let mut jacobian = SMatrix::<f64, 1, 15>::zeros();
    jacobian[error_index::POSITION + 2] = -1.0 / downward;
    jacobian
        .fixed_columns_mut::<3>(error_index::ORIENTATION)
        .copy_from(&from_turn);
    Some((-height / downward, jacobian))
}

impl Model<2> for FlowMeasurement {
    /// flow = -v_c / d + (-w_y, w_x) with v_c, w_c in the optical frame (document S, 2.20-2.25):
    /// v_c = C^T (R^T v + w x t), w_c = C^T w, w = measured rate - bias.
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<2>, Rejection> {
        let (distance, distance_jacobian) =
            distance_to_ground(nominal, &self.body_from_camera).ok_or(Rejection::Invalid)?;
        if distance.is_nan() || distance < self.min_distance_m {
            return Err(Rejection::Phase);
        }
        let rotation = nominal.world_from_body.to_rotation_matrix().into_inner();
        let camera_from_body = self
            .body_from_camera
            .rotation
            .inverse()
            .to_rotation_matrix()
            .into_inner();
        let lever = self.body_from_camera.translation.vector;
        let rate = self.angular_rate - nominal.gyroscope_bias;
        let velocity_body = rotation.transpose() * nominal.velocity_world;
        let velocity_camera = camera_from_body * (velocity_body + rate.cross(&lever));
        let rate_camera = camera_from_body * rate;

        let turning = Matrix2x3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0);
        let prediction = turning * rate_camera - velocity_camera.xy() / distance;

        let select = Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0) / -distance;
        let from_velocity = select * camera_from_body;
        let mut jacobian = velocity_camera.xy() * distance_jacobian / (distance * distance);
        let mut add = |column, block: Matrix2x3<f64>| {
            let mut target = jacobian.fixed_columns_mut::<3>(column);
            target += block;
        };
        add(error_index::VELOCITY, from_velocity * rotation.transpose());
        add(
            error_index::ORIENTATION,
            from_velocity * so3::skew(&velocity_body),
        );
        add(
            error_index::GYROSCOPE_BIAS,
            from_velocity * so3::skew(&lever) - turning * camera_from_body,
        );
        Ok(Linearised {
            innovation: self.flow_rad_s - prediction,
            jacobian,
            variance: Vector2::repeat(self.sigma_rad_s * self.sigma_rad_s),
            from: Seen::FromBody,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_jacobian, random_states};
    use super::*;
    use alula_messages::{Looking, Mount};
    use nalgebra::{Point3, Translation3};

    fn measurement() -> FlowMeasurement {
        let mount = Mount {
            roll_pitch_yaw_deg: [2.0, -3.0, 5.0],
            ..Mount::at([0.1, -0.05, -0.07], Looking::Down)
        };
        FlowMeasurement {
            flow_rad_s: Vector2::new(0.3, -0.2),
            angular_rate: Vector3::new(0.4, -0.7, 0.2),
            interval_s: 0.01,
            body_from_camera: mount.body_from_sensor(),
            sigma_rad_s: 0.015,
            min_distance_m: 0.0,
        }
    }

    #[test]
    fn jacobian_meets_differences() {
        check_jacobian(&measurement());
    }

    /// The prediction is the derivative of the projection of the ground point that is on the
    /// optical axis, with the vehicle moved along its twist.
    #[test]
    fn prediction_is_the_motion_of_the_projected_ground_point() {
        let m = measurement();
        for nominal in random_states() {
            let rate = m.angular_rate - nominal.gyroscope_bias;
            let world_from_camera = |t: f64| {
                let position = nominal.position_world + nominal.velocity_world * t;
                Pose::from_parts(
                    Translation3::from(position),
                    nominal.world_from_body * so3::exp(&(rate * t)),
                ) * m.body_from_camera
            };
            let (distance, _) = distance_to_ground(&nominal, &m.body_from_camera).unwrap();
            let ground = world_from_camera(0.0) * Point3::new(0.0, 0.0, distance);
            assert!(ground.z.abs() < 1e-12);
            let image = |t| {
                let p = world_from_camera(t).inverse() * ground;
                p.coords.xy() / p.z
            };
            let flow = (image(1e-6) - image(-1e-6)) / 2e-6;
            let innovation = m.linearise(&nominal).unwrap().innovation;
            assert!((m.flow_rad_s - flow - innovation).norm() < 1e-8);
        }
    }

    #[test]
    fn flow_close_to_the_ground_is_not_trusted() {
        let m = FlowMeasurement {
            min_distance_m: 0.3,
            ..measurement()
        };
        let nominal = Nominal {
            position_world: Vector3::z() * 0.3,
            ..Nominal::default()
        };
        assert_eq!(m.linearise(&nominal).unwrap_err(), Rejection::Phase);
    }
}
