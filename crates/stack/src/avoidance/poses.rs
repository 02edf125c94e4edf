//! Where the vehicle was when an image was exposed.

use alula_geometry::{Pose, Timestamp};
use alula_messages::NavState;
use nalgebra::{Matrix3, Translation3, Vector3};

/// States kept: a third of a second at 200 Hz and more at lower rates.
const CAPACITY: usize = 96;

/// A pose of the recent past.
#[derive(Clone, Copy, Debug)]
pub(super) struct PastPose {
    pub time: Timestamp,
    pub world_from_body: Pose,
    /// Of the orientation error, body, rad^2.
    pub orientation_covariance: Matrix3<f64>,
}

impl PastPose {
    /// Covariance of the orientation error without that of the heading, body, rad^2.
    ///
    /// The drift of the heading turns the vehicle and what it sees alike: it is common to all
    /// images, and neither moves an obstacle against the others nor against the vehicle.
    pub fn tilt_covariance(&self) -> Matrix3<f64> {
        let up_body = self.world_from_body.rotation.inverse() * Vector3::z();
        let level = Matrix3::identity() - up_body * up_body.transpose();
        level * self.orientation_covariance * level
    }
}

/// The poses of the recent past, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct PastPoses {
    poses: std::collections::VecDeque<PastPose>,
}

impl PastPoses {
    pub fn new() -> Self {
        Self {
            poses: std::collections::VecDeque::with_capacity(CAPACITY + 1),
        }
    }

    pub fn push(&mut self, state: &NavState) {
        let row = alula_messages::error_index::ORIENTATION;
        if self
            .poses
            .back()
            .is_some_and(|last| state.time <= last.time)
        {
            return;
        }
        if self.poses.len() == CAPACITY {
            self.poses.pop_front();
        }
        self.poses.push_back(PastPose {
            time: state.time,
            world_from_body: state.world_from_body,
            orientation_covariance: state.covariance.fixed_view::<3, 3>(row, row).into_owned(),
        });
    }

    /// Moves all of them, after a jump of the estimate.
    pub fn shift(&mut self, by_world: &Vector3<f64>) {
        for past in &mut self.poses {
            past.world_from_body.translation.vector += by_world;
        }
    }

    /// The pose at a time; `None` outside the times that are kept.
    pub fn at(&self, time: Timestamp) -> Option<PastPose> {
        let after = self.poses.partition_point(|p| p.time < time);
        let next = self.poses.get(after)?;
        if next.time == time {
            return Some(*next);
        }
        let last = self.poses.get(after.checked_sub(1)?)?;
        let share = time.seconds_since(last.time) / next.time.seconds_since(last.time);
        let (a, b) = (&last.world_from_body, &next.world_from_body);
        Some(PastPose {
            time,
            world_from_body: Pose::from_parts(
                Translation3::from(a.translation.vector.lerp(&b.translation.vector, share)),
                // Antipodal quaternions do not occur between neighbouring states.
                a.rotation
                    .try_slerp(&b.rotation, share, 1e-9)
                    .unwrap_or(b.rotation),
            ),
            orientation_covariance: next.orientation_covariance,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::so3;

    fn state(t_s: f64) -> NavState {
        let mut state = NavState {
            time: Timestamp::from_s(t_s),
            ..NavState::default()
        };
        state.world_from_body.translation.vector.x = 2.0 * t_s;
        state.world_from_body.rotation = so3::from_roll_pitch_yaw(0.0, 0.0, 0.5 * t_s);
        state
    }

    fn poses() -> PastPoses {
        let mut poses = PastPoses::new();
        for i in 0..300 {
            poses.push(&state(0.005 * f64::from(i)));
        }
        poses
    }

    #[test]
    fn a_pose_between_two_steps_is_interpolated() {
        let pose = poses()
            .at(Timestamp::from_s(1.4321))
            .unwrap()
            .world_from_body;
        assert!((pose.translation.vector.x - 2.8642).abs() < 1e-9);
        assert!((so3::yaw_rad(&pose.rotation) - 0.71605).abs() < 1e-9);
    }

    #[test]
    fn the_heading_adds_nothing_to_the_error_of_the_tilt() {
        let mut state = state(0.0);
        state.world_from_body.rotation = so3::from_roll_pitch_yaw(0.3, -0.2, 1.0);
        let up_body = state.world_from_body.rotation.inverse() * Vector3::z();
        let across = up_body.cross(&Vector3::x()).normalize();
        let covariance = 4.0 * up_body * up_body.transpose() + 0.01 * across * across.transpose();
        let row = alula_messages::error_index::ORIENTATION;
        state
            .covariance
            .fixed_view_mut::<3, 3>(row, row)
            .copy_from(&covariance);
        let mut poses = PastPoses::new();
        poses.push(&state);
        let tilt = poses.at(state.time).unwrap().tilt_covariance();
        assert!((tilt - 0.01 * across * across.transpose()).norm() < 1e-12);
    }

    #[test]
    fn times_before_and_after_the_history_have_no_pose() {
        assert!(poses().at(Timestamp::from_s(0.5)).is_none());
        assert!(poses().at(Timestamp::from_s(1.6)).is_none());
    }

    #[test]
    fn a_clock_that_goes_back_changes_nothing() {
        let mut poses = poses();
        poses.push(&state(0.1));
        assert!(poses.at(Timestamp::from_s(1.4)).is_some());
    }
}
