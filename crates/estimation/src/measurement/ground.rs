//! Standing on the ground (document S, 2.10.2, phase A): velocity and angular rate are zero, and
//! before the first flight place and heading are what the frame of the world was chosen to say.

use alula_geometry::so3;
use alula_messages::{Rejection, error_index};
use nalgebra::{Matrix3, RowVector3, SMatrix, Vector2, Vector3};

use super::{Model, variances};
use crate::eskf::{Linearised, Nominal, Seen};

/// The velocity is zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VelocityMeasurement {
    /// Standard deviation on each axis, m/s.
    pub sigma_m_s: f64,
}

impl Model<3> for VelocityMeasurement {
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<3>, Rejection> {
        let mut jacobian = SMatrix::<f64, 3, 15>::zeros();
        jacobian
            .fixed_columns_mut::<3>(error_index::VELOCITY)
            .copy_from(&Matrix3::identity());
        Ok(Linearised {
            innovation: -nominal.velocity_world,
            jacobian,
            variance: variances(self.sigma_m_s),
            from: Seen::FromBody,
        })
    }
}

/// The angular rate is zero: what the gyroscope reads is its bias, about all three axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AngularRateMeasurement {
    /// Mean reading of the gyroscope, rad/s.
    pub angular_rate: Vector3<f64>,
    /// Standard deviation on each axis, rad/s.
    pub sigma_rad_s: f64,
}

impl Model<3> for AngularRateMeasurement {
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<3>, Rejection> {
        let mut jacobian = SMatrix::<f64, 3, 15>::zeros();
        jacobian
            .fixed_columns_mut::<3>(error_index::GYROSCOPE_BIAS)
            .copy_from(&Matrix3::identity());
        Ok(Linearised {
            innovation: self.angular_rate - nominal.gyroscope_bias,
            jacobian,
            variance: variances(self.sigma_rad_s),
            from: Seen::FromBody,
        })
    }
}

/// Horizontal place and heading are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldMeasurement {
    /// Horizontal position, world frame, m.
    pub position_world: Vector2<f64>,
    /// Heading of the body's x axis, rad.
    pub yaw_rad: f64,
    /// Standard deviation of the position on each axis, m.
    pub sigma_m: f64,
    /// Standard deviation of the heading, rad.
    pub sigma_rad: f64,
}

impl Model<3> for HoldMeasurement {
    /// With f = R e1: yaw = atan2(f_y, f_x), and an error turns f by -R [e1]x.
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<3>, Rejection> {
        let rotation = nominal.world_from_body.to_rotation_matrix().into_inner();
        let forward = rotation.column(0);
        let forward_from_turn = -rotation * so3::skew(&Vector3::x());
        let level_squared = forward.x * forward.x + forward.y * forward.y;
        let yaw_from_turn: RowVector3<f64> = (forward_from_turn.row(1) * forward.x
            - forward_from_turn.row(0) * forward.y)
            / level_squared;

        let offset = self.position_world - nominal.position_world.xy();
        let yaw_rad = so3::yaw_rad(&nominal.world_from_body);
        let mut jacobian = SMatrix::<f64, 3, 15>::zeros();
        jacobian[(0, error_index::POSITION)] = 1.0;
        jacobian[(1, error_index::POSITION + 1)] = 1.0;
        jacobian
            .fixed_view_mut::<1, 3>(2, error_index::ORIENTATION)
            .copy_from(&yaw_from_turn);
        let (place, heading) = (self.sigma_m.powi(2), self.sigma_rad.powi(2));
        Ok(Linearised {
            innovation: Vector3::new(offset.x, offset.y, so3::wrap_angle(self.yaw_rad - yaw_rad)),
            jacobian,
            variance: Vector3::new(place, place, heading),
            from: Seen::InWorld,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::check_jacobian;
    use super::*;

    #[test]
    fn velocity_jacobian_meets_differences() {
        check_jacobian(&VelocityMeasurement { sigma_m_s: 0.01 });
    }

    #[test]
    fn angular_rate_jacobian_meets_differences() {
        check_jacobian(&AngularRateMeasurement {
            angular_rate: Vector3::new(0.1, -0.1, 0.02),
            sigma_rad_s: 0.01,
        });
    }

    #[test]
    fn hold_jacobian_meets_differences() {
        check_jacobian(&HoldMeasurement {
            position_world: Vector2::new(0.1, 0.2),
            yaw_rad: 0.3,
            sigma_m: 0.01,
            sigma_rad: 0.01,
        });
    }
}
