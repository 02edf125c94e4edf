//! Alignment of an estimated trajectory with its reference.

use alula_geometry::Pose;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::MetricsError;

/// What may be chosen freely before errors are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alignment {
    /// Nothing.
    None,
    /// The estimate is moved so that the first poses agree.
    Origin,
    /// Position and heading: what odometry with gravity cannot observe.
    PositionYaw,
    /// Position and rotation.
    Rigid,
    /// Position, rotation and scale.
    Similarity,
}

/// `p_reference = scale * R * p_estimate + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Rotation and translation.
    pub reference_from_estimate: Pose,
    /// Scale, applied before the rotation.
    pub scale: f64,
}

impl Similarity {
    /// Moves a pose; the rotation is not scaled.
    pub fn apply(&self, pose: &Pose) -> Pose {
        let scaled = Pose::from_parts(
            Translation3::from(pose.translation.vector * self.scale),
            pose.rotation,
        );
        self.reference_from_estimate * scaled
    }
}

/// The transform that brings the positions of `estimate` closest to those of `reference`, in the
/// sense of least squares (Umeyama 1991), within what `alignment` leaves free.
///
/// # Errors
/// If the numbers of poses differ or are too small, or if the positions lie on a line.
pub fn align(
    reference: &[Pose],
    estimate: &[Pose],
    alignment: Alignment,
) -> Result<Similarity, MetricsError> {
    check_lengths(reference, estimate, 1)?;
    let (rotation, scale) = match alignment {
        Alignment::None => return Ok(rigid(Pose::identity())),
        Alignment::Origin => return Ok(rigid(reference[0] * estimate[0].inverse())),
        Alignment::PositionYaw => (heading(reference, estimate), 1.0),
        Alignment::Rigid => (umeyama(reference, estimate)?.0, 1.0),
        Alignment::Similarity => umeyama(reference, estimate)?,
    };
    let shift = mean(reference) - rotation * mean(estimate) * scale;
    Ok(Similarity {
        reference_from_estimate: Pose::from_parts(Translation3::from(shift), rotation),
        scale,
    })
}

fn rigid(reference_from_estimate: Pose) -> Similarity {
    Similarity {
        reference_from_estimate,
        scale: 1.0,
    }
}

pub(super) fn check_lengths(
    reference: &[Pose],
    estimate: &[Pose],
    needed: usize,
) -> Result<(), MetricsError> {
    if reference.len() != estimate.len() {
        return Err(MetricsError::DifferentLengths {
            reference: reference.len(),
            estimate: estimate.len(),
        });
    }
    if reference.len() < needed {
        return Err(MetricsError::TooFew {
            found: reference.len(),
            needed,
        });
    }
    Ok(())
}

fn mean(poses: &[Pose]) -> Vector3<f64> {
    let sum: Vector3<f64> = poses.iter().map(|p| p.translation.vector).sum();
    sum / poses.len() as f64
}

/// Cross covariance of the positions, reference times estimate transposed, and the variance of the
/// estimate.
fn moments(reference: &[Pose], estimate: &[Pose]) -> (Matrix3<f64>, f64) {
    let (mean_reference, mean_estimate) = (mean(reference), mean(estimate));
    let mut cross = Matrix3::zeros();
    let mut variance = 0.0;
    for (r, e) in reference.iter().zip(estimate) {
        let (r, e) = (
            r.translation.vector - mean_reference,
            e.translation.vector - mean_estimate,
        );
        cross += r * e.transpose();
        variance += e.norm_squared();
    }
    let count = reference.len() as f64;
    (cross / count, variance / count)
}

/// Umeyama (1991), equations 40 to 43: with the cross covariance U D V^T, R = U S V^T and
/// scale = tr(D S) / variance, where S turns the last axis if U V^T would be a reflection.
fn umeyama(
    reference: &[Pose],
    estimate: &[Pose],
) -> Result<(UnitQuaternion<f64>, f64), MetricsError> {
    let (cross, variance) = moments(reference, estimate);
    let svd = cross.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err(MetricsError::Degenerate);
    };
    let d = svd.singular_values;
    if d[1].is_nan() || d[1] <= d[0] * f64::EPSILON {
        return Err(MetricsError::Degenerate);
    }
    let mut s = Vector3::repeat(1.0);
    if u.determinant() * v_t.determinant() < 0.0 {
        s.z = -1.0;
    }
    let rotation = u * Matrix3::from_diagonal(&s) * v_t;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Ok((rotation, d.dot(&s) / variance))
}

/// The rotation about the vertical that maximises sum r . R e: with c = sum r_xy . e_xy and
/// s = sum e_xy x r_xy the angle is atan2(s, c).
fn heading(reference: &[Pose], estimate: &[Pose]) -> UnitQuaternion<f64> {
    let (cross, _) = moments(reference, estimate);
    let along = cross[(0, 0)] + cross[(1, 1)];
    let across = cross[(1, 0)] - cross[(0, 1)];
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), across.atan2(along))
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::so3;

    fn helix() -> Vec<Pose> {
        (0..40)
            .map(|i| {
                let t = 0.2 * f64::from(i);
                Pose::from_parts(
                    Translation3::new(t.cos(), 2.0 * t.sin(), 0.3 * t),
                    so3::from_roll_pitch_yaw(0.1 * t, 0.05, t),
                )
            })
            .collect()
    }

    fn check(alignment: Alignment, reference_from_estimate: Pose, scale: f64) {
        let truth = Similarity {
            reference_from_estimate,
            scale,
        };
        let estimate = helix();
        let reference: Vec<Pose> = estimate.iter().map(|p| truth.apply(p)).collect();
        let found = align(&reference, &estimate, alignment).unwrap();
        for (r, e) in reference.iter().zip(&estimate) {
            let difference = r.inverse() * found.apply(e);
            assert!(difference.translation.vector.norm() < 1e-12);
            assert!(difference.rotation.angle() < 1e-7);
        }
        assert!((found.scale - scale).abs() < 1e-12);
    }

    #[test]
    fn a_rigid_motion_is_found() {
        let motion = Pose::from_parts(
            Translation3::new(1.0, -2.0, 3.0),
            so3::from_roll_pitch_yaw(0.5, -0.7, 2.0),
        );
        check(Alignment::Rigid, motion, 1.0);
        check(Alignment::Origin, motion, 1.0);
        check(Alignment::Similarity, motion, 1.7);
    }

    #[test]
    fn a_heading_is_found() {
        let motion = Pose::from_parts(
            Translation3::new(1.0, -2.0, 3.0),
            so3::from_roll_pitch_yaw(0.0, 0.0, 2.0),
        );
        check(Alignment::PositionYaw, motion, 1.0);
    }

    #[test]
    fn points_on_a_line_do_not_determine_a_rotation() {
        let line: Vec<Pose> = (0..9)
            .map(|i| Pose::translation(f64::from(i), 0.0, 0.0))
            .collect();
        assert_eq!(
            align(&line, &line, Alignment::Rigid),
            Err(MetricsError::Degenerate)
        );
    }
}
