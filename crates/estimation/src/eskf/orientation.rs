//! The coordinates in which a filter keeps its uncertainty of orientation.
//!
//! A covariance has room for four of them: the components x, y, z, w of a quaternion. The
//! error-state filters use the first three as a rotation vector, and the fourth stays zero.

use alula_geometry::so3;
use nalgebra::{Matrix3, Matrix3x4, Matrix4, Matrix4x3, UnitQuaternion, Vector3, Vector4};

use super::FilterKind;
use super::nominal::renormalised;

/// Derivatives of the motion, the blocks of A that differ between filters (document S, equations
/// 2.38 to 2.46). `o` are the coordinates of orientation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// V: of the acceleration with respect to `o`.
    pub velocity_from_orientation: Matrix3x4<f64>,
    /// -R: of the acceleration with respect to the accelerometer's bias.
    pub velocity_from_bias: Matrix3<f64>,
    /// W: of the change of `o` with respect to `o`.
    pub orientation_from_orientation: Matrix4<f64>,
    /// Q: of the change of `o` with respect to the gyroscope's bias.
    pub orientation_from_bias: Matrix4x3<f64>,
}

impl FilterKind {
    /// Derivatives at orientation `q` under specific force and angular rate without bias.
    pub(super) fn motion(
        self,
        q: &UnitQuaternion<f64>,
        force: &Vector3<f64>,
        rate: &Vector3<f64>,
    ) -> Motion {
        let rotation = q.to_rotation_matrix().into_inner();
        let (from_orientation, turning) = match self {
            Self::ErrorStateLocal => (
                wide(&(-rotation * so3::skew(force))),
                tall(&-so3::skew(rate)),
            ),
            Self::ErrorStateGlobal => (wide(&-so3::skew(&(rotation * force))), Matrix4x3::zeros()),
            Self::Extended => {
                return Motion {
                    velocity_from_orientation: rotated_from_quaternion(q, force),
                    velocity_from_bias: -rotation,
                    orientation_from_orientation: half_omega(rate),
                    orientation_from_bias: -self.coordinates_from_local(q),
                };
            }
        };
        Motion {
            velocity_from_orientation: from_orientation,
            velocity_from_bias: -rotation,
            orientation_from_orientation: turning.fixed_resize::<4, 4>(0.0),
            orientation_from_bias: -self.coordinates_from_local(q),
        }
    }

    /// The coordinates of a small local rotation vector at `q`.
    ///
    /// The rotation vector itself; turned into the world; or q * (0, theta / 2), document S,
    /// equation 2.78.
    pub(super) fn coordinates_from_local(self, q: &UnitQuaternion<f64>) -> Matrix4x3<f64> {
        match self {
            Self::ErrorStateLocal => tall(&Matrix3::identity()),
            Self::ErrorStateGlobal => tall(&q.to_rotation_matrix().into_inner()),
            Self::Extended => {
                let vector = q.vector().into_owned();
                let top = Matrix3::identity() * q.w + so3::skew(&vector);
                let mut coordinates_from_local = tall(&top);
                coordinates_from_local.set_row(3, &-vector.transpose());
                coordinates_from_local * 0.5
            }
        }
    }

    /// The local rotation vector of small coordinates at `q`: undoes [`Self::coordinates_from_local`]. Of a
    /// quaternion it takes no notice of a change in length.
    pub(super) fn local_from_coordinates(self, q: &UnitQuaternion<f64>) -> Matrix3x4<f64> {
        let transposed = self.coordinates_from_local(q).transpose();
        match self {
            Self::ErrorStateLocal | Self::ErrorStateGlobal => transposed,
            Self::Extended => transposed * 4.0,
        }
    }

    /// The orientation after a correction, and the derivative of the error that remains, in the
    /// coordinates there, with respect to the error before.
    ///
    /// The derivatives of document S, equations 2.60, 2.61 (to first order in the correction) and
    /// 2.82 (exact for a quaternion of length 1).
    pub(super) fn correct(
        self,
        q: &UnitQuaternion<f64>,
        correction: &Vector4<f64>,
    ) -> (UnitQuaternion<f64>, Matrix4<f64>) {
        let turn = correction.xyz();
        match self {
            Self::ErrorStateLocal => (
                renormalised(q * so3::exp(&turn)),
                tall(&so3::right_jacobian(&turn)).fixed_resize(0.0),
            ),
            Self::ErrorStateGlobal => (
                renormalised(so3::exp(&turn) * q),
                tall(&so3::left_jacobian(&turn)).fixed_resize(0.0),
            ),
            Self::Extended => {
                let sum = q.coords + correction;
                let length = sum.norm();
                let unit = sum / length;
                let reset = (Matrix4::identity() - unit * unit.transpose()) / length;
                (UnitQuaternion::new_unchecked(unit.into()), reset)
            }
        }
    }
}

/// Derivative of R(q) a with respect to the components x, y, z, w of q (document S, equation
/// 2.43).
fn rotated_from_quaternion(q: &UnitQuaternion<f64>, a: &Vector3<f64>) -> Matrix3x4<f64> {
    let (w, rho) = (q.w, q.vector().into_owned());
    let from_vector = rho * a.transpose() - a * rho.transpose() + Matrix3::identity() * a.dot(&rho)
        - so3::skew(a) * w;
    let mut derivative = wide(&(from_vector * 2.0));
    derivative.set_column(3, &((a * w + rho.cross(a)) * 2.0));
    derivative
}

/// Derivative of q * (0, rate) / 2 with respect to the components x, y, z, w of q (document S,
/// equation 2.45).
fn half_omega(rate: &Vector3<f64>) -> Matrix4<f64> {
    let mut omega = Matrix4::zeros();
    omega
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&(so3::skew(rate) * -0.5));
    omega.fixed_view_mut::<3, 1>(0, 3).copy_from(&(rate * 0.5));
    omega
        .fixed_view_mut::<1, 3>(3, 0)
        .copy_from(&(rate.transpose() * -0.5));
    omega
}

/// A block whose fourth coordinate does nothing.
fn wide(block: &Matrix3<f64>) -> Matrix3x4<f64> {
    block.fixed_resize(0.0)
}

/// A block whose fourth coordinate stays zero.
fn tall(block: &Matrix3<f64>) -> Matrix4x3<f64> {
    block.fixed_resize(0.0)
}
