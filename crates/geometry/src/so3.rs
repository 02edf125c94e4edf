//! Rotations as unit quaternions with the exponential map, its inverse and its Jacobians.
//!
//! A rotation vector `phi` (rad) is axis times angle. All maps agree with
//! `R = exp([phi]x)` and with the Hamilton convention q = [cos(t/2), sin(t/2) axis], t = |phi|
//! (document S, equations 2.7 and 2.8).

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Below this angle the series are used: their truncation error is below f64 rounding.
const SMALL_ANGLE_RAD: f64 = 1e-3;

/// The matrix `[a]x` with `[a]x b = a x b` (document S, equation 2.8).
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Inverse of [`skew`] for a skew-symmetric matrix.
pub fn unskew(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(m[(2, 1)], m[(0, 2)], m[(1, 0)])
}

/// The rotation by the rotation vector `phi` (rad).
///
/// q = [cos(t/2), phi sin(t/2)/t], t = |phi|; sin(t/2)/t = 1/2 - t^2/48 + t^4/3840 for small t.
pub fn exp(phi: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle_squared = phi.norm_squared();
    let angle = angle_squared.sqrt();
    let (w, scale) = if angle < SMALL_ANGLE_RAD {
        (
            1.0 - angle_squared / 8.0 + angle_squared * angle_squared / 384.0,
            0.5 - angle_squared / 48.0 + angle_squared * angle_squared / 3840.0,
        )
    } else {
        ((0.5 * angle).cos(), (0.5 * angle).sin() / angle)
    };
    let v = phi * scale;
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(w, v.x, v.y, v.z))
}

/// The rotation vector (rad) of `q`, of length at most pi. Inverse of [`exp`].
pub fn log(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    // q and -q are the same rotation; the one with w >= 0 has the shorter vector.
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let v = Vector3::new(q.i, q.j, q.k) * sign;
    let w = q.w * sign;
    let sine = v.norm();
    if sine < SMALL_ANGLE_RAD {
        // atan2(s, w)/s = 1/w (1 - (s/w)^2/3 + (s/w)^4/5)
        let r = (sine / w).powi(2);
        v * (2.0 / w * (1.0 - r / 3.0 + r * r / 5.0))
    } else {
        v * (2.0 * sine.atan2(w) / sine)
    }
}

/// Left Jacobian of SO(3): `exp(phi + d) = exp(J_l(phi) d) exp(phi)` to first order in `d`.
///
/// `J_l = I + (1 - cos t)/t^2 [phi]x + (t - sin t)/t^3 [phi]x^2`, `t = |phi|`.
pub fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let t2 = phi.norm_squared();
    let t = t2.sqrt();
    let (a, b) = if t < SMALL_ANGLE_RAD {
        (0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0)
    } else {
        ((1.0 - t.cos()) / t2, (t - t.sin()) / (t2 * t))
    };
    let s = skew(phi);
    Matrix3::identity() + s * a + s * s * b
}

/// Right Jacobian of SO(3): `exp(phi + d) = exp(phi) exp(J_r(phi) d)` to first order in `d`.
pub fn right_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    left_jacobian(&-phi)
}

/// Inverse of [`left_jacobian`] for rotation vectors shorter than 2 pi.
///
/// `J_l^-1 = I - 1/2 [phi]x + (1/t^2 - (1 + cos t)/(2 t sin t)) [phi]x^2`.
pub fn left_jacobian_inverse(phi: &Vector3<f64>) -> Matrix3<f64> {
    let t2 = phi.norm_squared();
    let t = t2.sqrt();
    let b = if t < SMALL_ANGLE_RAD {
        1.0 / 12.0 + t2 / 720.0
    } else {
        let half = 0.5 * t;
        (1.0 - half * half.cos() / half.sin()) / t2
    };
    let s = skew(phi);
    Matrix3::identity() - s * 0.5 + s * s * b
}

/// Inverse of [`right_jacobian`] for rotation vectors shorter than 2 pi.
pub fn right_jacobian_inverse(phi: &Vector3<f64>) -> Matrix3<f64> {
    left_jacobian_inverse(&-phi)
}

/// Rotation `world_from_body` with R = R_z(yaw) R_y(pitch) R_x(roll), angles in rad
/// (document O, equation 2.3 in its expanded form).
///
/// In a z-up world with a forward-left-up body, positive pitch lowers the nose and positive roll
/// lowers the right side.
pub fn from_roll_pitch_yaw(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad)
}

/// Roll, pitch and yaw (rad) of `world_from_body` (document O, equations 2.5-2.7).
pub fn to_roll_pitch_yaw(world_from_body: &UnitQuaternion<f64>) -> (f64, f64, f64) {
    world_from_body.euler_angles()
}

/// Yaw (rad, in -pi..pi): the heading of the body's x axis in the world's horizontal plane.
pub fn yaw_rad(world_from_body: &UnitQuaternion<f64>) -> f64 {
    let forward = world_from_body * Vector3::x();
    forward.y.atan2(forward.x)
}

/// Angle (rad, in 0..pi) between the body's z axis and the vertical.
pub fn tilt_rad(world_from_body: &UnitQuaternion<f64>) -> f64 {
    let up = world_from_body * Vector3::z();
    up.xy().norm().atan2(up.z)
}

/// `angle_rad` brought into -pi..pi.
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let wrapped = angle_rad - turn * (angle_rad / turn).round();
    if wrapped.is_finite() {
        wrapped
    } else {
        f64::NAN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-limit..limit, -limit..limit, -limit..limit].prop_map(Vector3::from)
    }

    /// Central-difference Jacobian of `f` at `x`.
    fn differences(f: impl Fn(&Vector3<f64>) -> Vector3<f64>, x: &Vector3<f64>) -> Matrix3<f64> {
        let h = 1e-6;
        let mut j = Matrix3::zeros();
        for k in 0..3 {
            let mut d = Vector3::zeros();
            d[k] = h;
            j.set_column(k, &((f(&(x + d)) - f(&(x - d))) / (2.0 * h)));
        }
        j
    }

    proptest! {
        #[test]
        fn log_undoes_exp(phi in vector(1.8)) {
            prop_assert!((log(&exp(&phi)) - phi).norm() < 1e-12);
        }

        #[test]
        fn exp_agrees_with_the_matrix_exponential(phi in vector(3.0)) {
            let difference = exp(&phi).to_rotation_matrix().into_inner() - skew(&phi).exp();
            prop_assert!(difference.norm() < 1e-12);
        }

        #[test]
        fn left_jacobian_meets_differences(phi in vector(1.5)) {
            let numeric = differences(|p| log(&(exp(p) * exp(&phi).inverse())), &phi);
            prop_assert!((numeric - left_jacobian(&phi)).norm() < 1e-8);
        }

        #[test]
        fn right_jacobian_meets_differences(phi in vector(1.5)) {
            let numeric = differences(|p| log(&(exp(&phi).inverse() * exp(p))), &phi);
            prop_assert!((numeric - right_jacobian(&phi)).norm() < 1e-8);
        }

        #[test]
        fn jacobian_inverses_invert(phi in vector(1.8)) {
            let left = left_jacobian(&phi) * left_jacobian_inverse(&phi);
            let right = right_jacobian(&phi) * right_jacobian_inverse(&phi);
            prop_assert!((left - Matrix3::identity()).norm() < 1e-10);
            prop_assert!((right - Matrix3::identity()).norm() < 1e-10);
        }

        #[test]
        fn roll_pitch_yaw_round_trips(roll in -1.5..1.5, pitch in -1.5..1.5, yaw in -3.1..3.1) {
            let (r, p, y) = to_roll_pitch_yaw(&from_roll_pitch_yaw(roll, pitch, yaw));
            prop_assert!((r - roll).abs() + (p - pitch).abs() + (y - yaw).abs() < 1e-12);
        }

        #[test]
        fn wrapped_angles_differ_by_whole_turns(angle in -100.0..100.0_f64) {
            let wrapped = wrap_angle(angle);
            prop_assert!(wrapped.abs() <= std::f64::consts::PI + 1e-12);
            prop_assert!((angle - wrapped).rem_euclid(std::f64::consts::TAU).sin().abs() < 1e-9);
        }
    }

    #[test]
    fn the_series_meet_the_closed_forms_at_their_border() {
        for scale in [0.999, 1.001] {
            let phi = Vector3::new(0.6, -0.64, 0.48) * (SMALL_ANGLE_RAD * scale);
            assert!((log(&exp(&phi)) - phi).norm() < 1e-15);
            let product = left_jacobian(&phi) * left_jacobian_inverse(&phi);
            assert!((product - Matrix3::identity()).norm() < 1e-12);
        }
    }

    #[test]
    fn positive_pitch_lowers_the_nose_and_positive_roll_the_right_side() {
        let nose = from_roll_pitch_yaw(0.0, 0.1, 0.0) * Vector3::x();
        let right = from_roll_pitch_yaw(0.1, 0.0, 0.0) * -Vector3::y();
        assert!(nose.z < 0.0);
        assert!(right.z < 0.0);
    }

    /// The numeric example of docs/conventions.md.
    #[test]
    fn the_rotation_of_the_conventions_page() {
        let world_from_body = from_roll_pitch_yaw(
            10.0_f64.to_radians(),
            20.0_f64.to_radians(),
            30.0_f64.to_radians(),
        );
        let point_world = world_from_body * Vector3::new(1.0, 2.0, 3.0);
        let expected = Vector3::new(1.067_425, 2.289_059, 2.760_581);
        assert!((point_world - expected).norm() < 1e-6);
    }
}
