//! Velocity along a downward camera's image plane, in metres (document S, 2.4.2).

use alula_geometry::{Pose, so3};
use alula_messages::{Rejection, error_index};
use nalgebra::{Matrix2x3, SMatrix, Vector2, Vector3};

use super::Model;
use crate::eskf::{Linearised, Nominal, Seen};

/// What a flow camera with a ranger of its own says about the velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarVelocityMeasurement {
    /// Velocity of the camera against the ground as its image shows it, optical frame, m/s: minus
    /// the flow times the distance.
    pub apparent_velocity: Vector2<f64>,
    /// Distance with which the flow was multiplied, m: the rotation of the camera is still in the
    /// velocity, this far away. 0 if the camera has taken it out itself.
    pub turning_distance_m: f64,
    /// Angular rate that the gyroscope measured over the same interval, body frame, bias included,
    /// rad/s.
    pub angular_rate: Vector3<f64>,
    /// Interval over which both were measured, s.
    pub interval_s: f64,
    /// Calibrated pose of the camera.
    pub body_from_camera: Pose,
    /// Standard deviation on each axis, m/s.
    pub sigma_m_s: f64,
}

impl PlanarVelocityMeasurement {
    /// The measurement that flow and distance make (document S, equation 2.16 without the turning
    /// part, which the filter takes out with its own bias).
    pub fn from_flow(flow_rad_s: Vector2<f64>, distance_m: f64) -> Self {
        Self {
            apparent_velocity: -flow_rad_s * distance_m,
            turning_distance_m: distance_m,
            angular_rate: Vector3::zeros(),
            interval_s: 0.0,
            body_from_camera: Pose::identity(),
            sigma_m_s: 1.0,
        }
    }
}

impl Model<2> for PlanarVelocityMeasurement {
    /// The first two numbers of v_c = C^T (R^T v + w x t) (document S, equation 2.14), less what
    /// turning adds to the apparent velocity: -d (-w_y, w_x) with w_c = C^T w.
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<2>, Rejection> {
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
        let turning = Matrix2x3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0)
            * camera_from_body
            * -self.turning_distance_m;
        let select = camera_from_body.fixed_rows::<2>(0).into_owned();
        let prediction = select * (velocity_body + rate.cross(&lever)) + turning * rate;

        let mut jacobian = SMatrix::<f64, 2, 15>::zeros();
        let mut set = |column, block: Matrix2x3<f64>| {
            jacobian.fixed_columns_mut::<3>(column).copy_from(&block);
        };
        set(error_index::VELOCITY, select * rotation.transpose());
        set(error_index::ORIENTATION, select * so3::skew(&velocity_body));
        set(
            error_index::GYROSCOPE_BIAS,
            select * so3::skew(&lever) - turning,
        );
        Ok(Linearised {
            innovation: self.apparent_velocity - prediction,
            jacobian,
            variance: Vector2::repeat(self.sigma_m_s * self.sigma_m_s),
            from: Seen::FromBody,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_jacobian, random_states};
    use super::super::{FlowMeasurement, Model};
    use super::*;
    use alula_messages::{Looking, Mount};

    fn mount() -> Pose {
        let mount = Mount {
            roll_pitch_yaw_deg: [2.0, -3.0, 5.0],
            ..Mount::at([0.1, -0.05, -0.07], Looking::Down)
        };
        mount.body_from_sensor()
    }

    fn measurement(flow_rad_s: Vector2<f64>, distance_m: f64) -> PlanarVelocityMeasurement {
        PlanarVelocityMeasurement {
            angular_rate: Vector3::new(0.4, -0.7, 0.2),
            body_from_camera: mount(),
            ..PlanarVelocityMeasurement::from_flow(flow_rad_s, distance_m)
        }
    }

    #[test]
    fn jacobian_meets_differences() {
        check_jacobian(&measurement(Vector2::new(0.3, -0.2), 1.7));
        check_jacobian(&measurement(Vector2::zeros(), 0.0));
    }

    /// Flow that is as predicted, times the true distance, is a velocity that is as predicted.
    #[test]
    fn true_flow_times_true_distance_is_the_velocity_of_the_camera() {
        for nominal in random_states() {
            let flow = FlowMeasurement {
                flow_rad_s: Vector2::zeros(),
                angular_rate: Vector3::new(0.4, -0.7, 0.2),
                interval_s: 0.01,
                body_from_camera: mount(),
                sigma_rad_s: 1.0,
                min_distance_m: 0.0,
            };
            let true_flow = -flow.linearise(&nominal).unwrap().innovation;
            let camera = mount();
            let axis = nominal.world_from_body * camera.rotation * Vector3::z();
            let lever = nominal.world_from_body * camera.translation.vector;
            let distance_m = -(nominal.position_world.z + lever.z) / axis.z;
            let seen = measurement(true_flow, distance_m)
                .linearise(&nominal)
                .unwrap();
            assert!(seen.innovation.norm() < 1e-12);
        }
    }
}
