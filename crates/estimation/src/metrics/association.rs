//! Trajectories and the poses that two of them have in common.

use alula_geometry::{Pose, Timestamp};

use super::MetricsError;

/// Poses in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Times, increasing.
    pub times: Vec<Timestamp>,
    /// Pose of the body in the world at each time.
    pub poses: Vec<Pose>,
}

impl Trajectory {
    /// Appends a pose.
    pub fn push(&mut self, time: Timestamp, world_from_body: Pose) {
        self.times.push(time);
        self.poses.push(world_from_body);
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// Whether there is no pose.
    pub fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    fn select(&self, indices: impl Iterator<Item = usize>) -> Self {
        let mut selected = Self::default();
        for i in indices {
            selected.push(self.times[i], self.poses[i]);
        }
        selected
    }
}

/// The poses of both trajectories whose times differ by at most `max_difference_s`: for each
/// pose of the shorter trajectory the nearest in time of the longer (the estimate counts as the
/// shorter one if both are equally long; the earlier of two equally near).
///
/// # Errors
/// If there are none.
pub fn associate(
    reference: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<(Trajectory, Trajectory), MetricsError> {
    let estimate_is_longer = estimate.len() > reference.len();
    let (short, long) = if estimate_is_longer {
        (reference, estimate)
    } else {
        (estimate, reference)
    };
    let pairs = nearest_pairs(&short.times, &long.times, max_difference_s);
    if pairs.is_empty() {
        return Err(MetricsError::NothingInCommon { max_difference_s });
    }
    let short = short.select(pairs.iter().map(|p| p.0));
    let long = long.select(pairs.iter().map(|p| p.1));
    Ok(if estimate_is_longer {
        (short, long)
    } else {
        (long, short)
    })
}

fn nearest_pairs(short: &[Timestamp], long: &[Timestamp], limit_s: f64) -> Vec<(usize, usize)> {
    let mut pairs = Vec::new();
    for (i, &time) in short.iter().enumerate() {
        let after = long.partition_point(|&t| t <= time);
        let distance_s = |j: usize| long[j].seconds_since(time).abs();
        let nearest = [after.checked_sub(1), (after < long.len()).then_some(after)]
            .into_iter()
            .flatten()
            .min_by(|&a, &b| distance_s(a).total_cmp(&distance_s(b)));
        if let Some(j) = nearest.filter(|&j| distance_s(j) <= limit_s) {
            pairs.push((i, j));
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(times_s: &[f64]) -> Trajectory {
        let mut trajectory = Trajectory::default();
        for &t in times_s {
            trajectory.push(Timestamp::from_s(t), Pose::translation(t, 0.0, 0.0));
        }
        trajectory
    }

    #[test]
    fn the_nearest_pose_in_time_is_taken() {
        let (reference, estimate) =
            associate(&at(&[0.0, 0.1, 0.2, 0.3]), &at(&[0.108, 0.296, 0.7]), 0.01).unwrap();
        assert_eq!(reference, at(&[0.1, 0.3]));
        assert_eq!(estimate, at(&[0.108, 0.296]));
    }

    #[test]
    fn trajectories_apart_have_nothing_in_common() {
        assert!(associate(&at(&[0.0]), &at(&[1.0]), 0.01).is_err());
    }
}
