//! From the desired force and yaw to the desired attitude, its angular rate and acceleration.

use alula_geometry::so3;
use alula_messages::Reference;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::GeometricConfig;
use super::position::SpecificForce;

/// `R_c` with its derivatives, each in the frame of `R_c`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DesiredAttitude {
    pub world_from_desired: Matrix3<f64>,
    pub angular_rate: Vector3<f64>,
    pub angular_acceleration: Vector3<f64>,
}

/// A vector and its first two time derivatives.
#[derive(Clone, Copy)]
struct Moving {
    value: Vector3<f64>,
    rate: Vector3<f64>,
    acceleration: Vector3<f64>,
}

impl Moving {
    /// The direction u = a/|a|: u' = (a' - n' u)/n, u'' = (a'' - 2 n' u' - n'' u)/n with n = |a|,
    /// n' = u . a', n'' = u' . a' + u . a''.
    fn direction(&self) -> Self {
        let n = self.value.norm();
        let u = self.value / n;
        let n_rate = u.dot(&self.rate);
        let u_rate = (self.rate - u * n_rate) / n;
        let n_acceleration = u_rate.dot(&self.rate) + u.dot(&self.acceleration);
        Self {
            value: u,
            rate: u_rate,
            acceleration: (self.acceleration - u_rate * (2.0 * n_rate) - u * n_acceleration) / n,
        }
    }

    fn cross(&self, other: &Self) -> Self {
        Self {
            value: self.value.cross(&other.value),
            rate: self.rate.cross(&other.value) + self.value.cross(&other.rate),
            acceleration: self.acceleration.cross(&other.value)
                + self.rate.cross(&other.rate) * 2.0
                + self.value.cross(&other.acceleration),
        }
    }
}

impl DesiredAttitude {
    /// z along the force; x in the vertical plane of the desired yaw, so that the yaw of `R_c` is
    /// the desired one. Both exist because the force points up and tilts less than 90 degrees.
    pub(super) fn new(force: &SpecificForce, reference: &Reference) -> Self {
        let z = Moving {
            value: force.force,
            rate: force.rate,
            acceleration: force.acceleration,
        }
        .direction();
        let x = left_of_heading(reference).cross(&z).direction();
        let y = z.cross(&x);
        let r = Matrix3::from_columns(&[x.value, y.value, z.value]);
        let r_rate = Matrix3::from_columns(&[x.rate, y.rate, z.rate]);
        let r_acceleration =
            Matrix3::from_columns(&[x.acceleration, y.acceleration, z.acceleration]);
        // R' = R [w]x and R'' = R ([w]x^2 + [w']x): the skew part of R^T R'' is [w']x.
        let second = r.transpose() * r_acceleration;
        Self {
            world_from_desired: r,
            angular_rate: so3::unskew(&(r.transpose() * r_rate)),
            angular_acceleration: 0.5 * so3::unskew(&(second - second.transpose())),
        }
    }

    /// With rate and acceleration shortened to the limits.
    pub(super) fn limited(mut self, config: &GeometricConfig) -> Self {
        let rate = self.angular_rate.norm();
        if rate > config.max_angular_rate_rad_s {
            self.angular_rate *= config.max_angular_rate_rad_s / rate;
        }
        let acceleration = self.angular_acceleration.norm();
        if acceleration > config.max_angular_acceleration_rad_s2 {
            self.angular_acceleration *= config.max_angular_acceleration_rad_s2 / acceleration;
        }
        self
    }

    pub(super) fn rotation(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
            self.world_from_desired,
        ))
    }
}

/// The horizontal unit vector to the left of the desired yaw.
fn left_of_heading(reference: &Reference) -> Moving {
    let (sin, cos) = reference.yaw_rad.sin_cos();
    let (rate, acceleration) = (reference.yaw_rate_rad_s, reference.yaw_acceleration_rad_s2);
    let left = Vector3::new(-sin, cos, 0.0);
    let back = Vector3::new(-cos, -sin, 0.0);
    Moving {
        value: left,
        rate: back * rate,
        acceleration: back * acceleration - left * (rate * rate),
    }
}
