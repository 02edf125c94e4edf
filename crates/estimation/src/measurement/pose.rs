//! External poses, for example of motion capture (document O, 2.4.3 and 2.4.4).

use alula_geometry::so3;
use alula_messages::{Rejection, error_index};
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

use super::{Model, variances};
use crate::eskf::{Linearised, Nominal, Seen};

/// A measured position of the body's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionMeasurement {
    /// Position, world frame, m.
    pub position_world: Vector3<f64>,
    /// Standard deviation on each axis, m.
    pub sigma_m: f64,
}

impl Model<3> for PositionMeasurement {
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<3>, Rejection> {
        let mut jacobian = SMatrix::<f64, 3, 15>::zeros();
        jacobian
            .fixed_columns_mut::<3>(error_index::POSITION)
            .copy_from(&Matrix3::identity());
        Ok(Linearised {
            innovation: self.position_world - nominal.position_world,
            jacobian,
            variance: variances(self.sigma_m),
            from: Seen::InWorld,
        })
    }
}

/// A measured orientation of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientationMeasurement {
    /// Orientation.
    pub world_from_body: UnitQuaternion<f64>,
    /// Standard deviation on each axis of the body, rad.
    pub sigma_rad: f64,
}

impl Model<3> for OrientationMeasurement {
    /// z = log(q^-1 q_measured); an error `e` of the estimate makes it log(exp(-e) exp(z)), whose
    /// derivative is minus the inverse left Jacobian at z.
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<3>, Rejection> {
        let innovation = so3::log(&(nominal.world_from_body.inverse() * self.world_from_body));
        let mut jacobian = SMatrix::<f64, 3, 15>::zeros();
        jacobian
            .fixed_columns_mut::<3>(error_index::ORIENTATION)
            .copy_from(&so3::left_jacobian_inverse(&innovation));
        Ok(Linearised {
            innovation,
            jacobian,
            variance: variances(self.sigma_rad),
            from: Seen::InWorld,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::check_jacobian;
    use super::*;

    #[test]
    fn position_jacobian_meets_differences() {
        check_jacobian(&PositionMeasurement {
            position_world: Vector3::new(1.0, 2.0, 3.0),
            sigma_m: 0.01,
        });
    }

    #[test]
    fn orientation_jacobian_meets_differences() {
        check_jacobian(&OrientationMeasurement {
            world_from_body: so3::from_roll_pitch_yaw(0.1, -0.2, 0.4),
            sigma_rad: 0.01,
        });
    }
}
