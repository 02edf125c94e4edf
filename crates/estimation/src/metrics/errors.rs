//! Absolute and relative errors of associated trajectories.

use alula_geometry::{Pose, Timestamp, so3};

use super::MetricsError;
use super::align::check_lengths;

/// Statistics of a list of errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Median: the mean of the two middle ones of an even number.
    pub median: f64,
    /// Greatest.
    pub max: f64,
    /// Least.
    pub min: f64,
}

/// Statistics of errors; `None` of an empty list.
pub fn statistics(errors: &[f64]) -> Option<Statistics> {
    if errors.is_empty() {
        return None;
    }
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    let count = sorted.len();
    let sum: f64 = sorted.iter().sum();
    let squares: f64 = sorted.iter().map(|e| e * e).sum();
    Some(Statistics {
        rmse: (squares / count as f64).sqrt(),
        mean: sum / count as f64,
        median: 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]),
        max: sorted[count - 1],
        min: sorted[0],
    })
}

/// Absolute trajectory error: distance (m) of each estimated position from its reference.
///
/// # Errors
/// If the numbers of poses differ.
pub fn absolute_translation_errors(
    reference: &[Pose],
    estimate: &[Pose],
) -> Result<Vec<f64>, MetricsError> {
    check_lengths(reference, estimate, 1)?;
    let distance = |(r, e): (&Pose, &Pose)| (r.translation.vector - e.translation.vector).norm();
    Ok(reference.iter().zip(estimate).map(distance).collect())
}

/// Angle (rad) of each estimated orientation from its reference.
///
/// # Errors
/// If the numbers of poses differ.
pub fn absolute_rotation_errors(
    reference: &[Pose],
    estimate: &[Pose],
) -> Result<Vec<f64>, MetricsError> {
    check_lengths(reference, estimate, 1)?;
    let angle = |(r, e): (&Pose, &Pose)| so3::log(&(r.rotation.inverse() * e.rotation)).norm();
    Ok(reference.iter().zip(estimate).map(angle).collect())
}

/// Which two poses bound each piece of a relative error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pairing {
    /// Poses `n` apart, each piece beginning where the last one ended.
    Frames(usize),
    /// Poses `n` apart, a piece beginning at every pose.
    AllFrames(usize),
    /// The pose nearest to this many seconds later (within a tenth of it), a piece beginning at
    /// every pose.
    Seconds(f64),
}

/// Relative pose errors of pieces of a trajectory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RelativeErrors {
    /// Translational part, m.
    pub translation_m: Vec<f64>,
    /// Angle of the rotational part, rad.
    pub rotation_rad: Vec<f64>,
}

/// Relative pose error: E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j) with reference Q and estimate P, for
/// each pair (document L, equation 4-5, term by term).
///
/// # Errors
/// If the numbers of poses differ, or there is no pair.
pub fn relative_errors(
    times: &[Timestamp],
    reference: &[Pose],
    estimate: &[Pose],
    pairing: Pairing,
) -> Result<RelativeErrors, MetricsError> {
    check_lengths(reference, estimate, 1)?;
    let mut errors = RelativeErrors::default();
    for (i, j) in pairs(times, reference.len(), pairing) {
        let moved = reference[i].inverse() * reference[j];
        let believed = estimate[i].inverse() * estimate[j];
        let error = moved.inverse() * believed;
        errors.translation_m.push(error.translation.vector.norm());
        errors.rotation_rad.push(so3::log(&error.rotation).norm());
    }
    if errors.translation_m.is_empty() {
        return Err(MetricsError::TooFew {
            found: reference.len(),
            needed: reference.len() + 1,
        });
    }
    Ok(errors)
}

fn pairs(times: &[Timestamp], count: usize, pairing: Pairing) -> Vec<(usize, usize)> {
    match pairing {
        Pairing::Frames(n) => {
            let n = n.max(1);
            (0..count)
                .step_by(n)
                .map(|i| (i, i + n))
                .filter(|p| p.1 < count)
                .collect()
        }
        Pairing::AllFrames(n) => (n..count).map(|j| (j - n, j)).collect(),
        Pairing::Seconds(delta_s) => (0..times.len().min(count))
            .filter_map(|i| Some((i, later(&times[..count.min(times.len())], i, delta_s)?)))
            .collect(),
    }
}

/// Index of the time nearest to `delta_s` after that of `i`, if it is within a tenth of it.
fn later(times: &[Timestamp], i: usize, delta_s: f64) -> Option<usize> {
    let wanted = delta_s;
    let after = times.partition_point(|t| t.seconds_since(times[i]) < wanted);
    let miss_s = |j: usize| (times[j].seconds_since(times[i]) - wanted).abs();
    [after.checked_sub(1), (after < times.len()).then_some(after)]
        .into_iter()
        .flatten()
        .filter(|&j| j > i && miss_s(j) <= 0.1 * delta_s)
        .min_by(|&a, &b| miss_s(a).total_cmp(&miss_s(b)))
}

/// Mean over `pieces` sub-trajectories of |estimated length / true length - 1| (document L,
/// equation 4-4, as its text describes it). Pieces in which the reference stands still, that is,
/// moves less than a tenth of the mean of all pieces, are left out. Lengths sum the noise of the
/// poses too: thin them first to a rate at which motion exceeds noise.
///
/// # Errors
/// If the numbers of poses differ, or there are fewer than two for each piece, or the reference
/// does not move at all.
pub fn scale_error(
    reference: &[Pose],
    estimate: &[Pose],
    pieces: usize,
) -> Result<f64, MetricsError> {
    let pieces = pieces.max(1);
    check_lengths(reference, estimate, pieces + 1)?;
    let border = |k: usize| k * (reference.len() - 1) / pieces;
    let standing_m = 0.1 * length_m(reference) / pieces as f64;
    let ratios: Vec<f64> = (0..pieces)
        .map(|k| (border(k), border(k + 1)))
        .map(|(a, b)| (length_m(&reference[a..=b]), length_m(&estimate[a..=b])))
        .filter(|(truth, _)| *truth > standing_m)
        .map(|(truth, found)| (found / truth - 1.0).abs())
        .collect();
    statistics(&ratios)
        .map(|s| s.mean)
        .ok_or(MetricsError::Degenerate)
}

fn length_m(poses: &[Pose]) -> f64 {
    poses
        .windows(2)
        .map(|w| (w[1].translation.vector - w[0].translation.vector).norm())
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Translation3;

    fn line(scale: f64) -> Vec<Pose> {
        (0..21)
            .map(|i| Pose::translation(scale * f64::from(i), 0.0, 0.0))
            .collect()
    }

    #[test]
    fn statistics_of_four_numbers() {
        let s = statistics(&[1.0, 4.0, 2.0, 3.0]).unwrap();
        assert_eq!((s.mean, s.median, s.max, s.min), (2.5, 2.5, 4.0, 1.0));
        assert!((s.rmse - 7.5_f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn scale_error_is_the_relative_excess_of_length() {
        assert!((scale_error(&line(1.0), &line(1.1), 10).unwrap() - 0.1).abs() < 1e-12);
    }

    #[test]
    fn relative_errors_do_not_see_a_common_motion() {
        let motion = Pose::from_parts(
            Translation3::new(1.0, 2.0, 3.0),
            so3::from_roll_pitch_yaw(0.1, 0.2, 0.3),
        );
        let moved: Vec<Pose> = line(1.0).iter().map(|p| motion * p).collect();
        let errors = relative_errors(&[], &line(1.0), &moved, Pairing::AllFrames(3)).unwrap();
        assert_eq!(errors.translation_m.len(), 18);
        assert!(errors.translation_m.iter().all(|e| *e < 1e-12));
    }

    #[test]
    fn seconds_and_frames_agree_on_regular_times() {
        let times: Vec<Timestamp> = (0..21)
            .map(|i| Timestamp::from_s(0.1 * f64::from(i)))
            .collect();
        let run = |pairing| relative_errors(&times, &line(1.0), &line(1.1), pairing).unwrap();
        assert_eq!(run(Pairing::Seconds(0.5)), run(Pairing::AllFrames(5)));
    }
}
