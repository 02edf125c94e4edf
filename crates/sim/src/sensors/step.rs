//! The span of true motion from which sensors measure.

use alula_geometry::{Pose, Timestamp, gravity_world, so3};
use nalgebra::{Point3, Translation3, Vector3};

use crate::Truth;
use crate::world::World;

/// What the motors do, as far as sensors notice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorActivity {
    /// Whether the motors may turn.
    pub armed: bool,
    /// Collective thrust as a share (0 to 1) of the greatest possible.
    pub thrust_fraction: f64,
}

/// Motion between two neighbouring instants of the simulation.
pub(super) struct Step<'a> {
    pub(super) world: &'a World,
    pub(super) from: &'a Truth,
    pub(super) to: &'a Truth,
    pub(super) motors: &'a MotorActivity,
}

/// One piece of a step, in which a sensor neither starts nor ends a sample.
#[derive(Clone, Copy)]
pub(super) struct Piece {
    pub(super) start: Timestamp,
    pub(super) end: Timestamp,
}

impl Piece {
    pub(super) fn duration_s(&self) -> f64 {
        self.end.seconds_since(self.start)
    }

    pub(super) fn middle(&self) -> Timestamp {
        Timestamp::from_ns(self.start.as_ns().midpoint(self.end.as_ns()))
    }
}

impl Step<'_> {
    /// Duration of the step, s.
    fn duration_s(&self) -> f64 {
        self.to.time.seconds_since(self.from.time)
    }

    /// The part of the step after `start` and up to `end`.
    pub(super) fn piece(&self, start: Timestamp, end: Timestamp) -> Piece {
        Piece {
            start: start.max(self.from.time),
            end: end.min(self.to.time),
        }
    }

    /// The pose at a time within the step, along the constant twist between its ends.
    pub(super) fn pose_at(&self, time: Timestamp) -> Pose {
        let (from, to) = (&self.from.world_from_body, &self.to.world_from_body);
        let share = self.share(time);
        let turn = so3::log(&(from.rotation.inverse() * to.rotation));
        let shift = to.translation.vector - from.translation.vector;
        Pose::from_parts(
            Translation3::from(from.translation.vector + shift * share),
            from.rotation * so3::exp(&(turn * share)),
        )
    }

    /// The velocity (world frame, m/s) at a time within the step.
    pub(super) fn velocity_at(&self, time: Timestamp) -> Vector3<f64> {
        self.from
            .velocity_world
            .lerp(&self.to.velocity_world, self.share(time))
    }

    /// Mean specific force over the step, body frame, m/s^2: the change of velocity, not the
    /// acceleration at an instant, so that the sum over a flight is the true velocity even when
    /// the ground stops the vehicle within one step.
    pub(super) fn mean_specific_force(&self) -> Vector3<f64> {
        let change = self.to.velocity_world - self.from.velocity_world;
        let acceleration_world = change / self.duration_s();
        let middle = self.pose_at(self.piece(self.from.time, self.to.time).middle());
        middle.rotation.inverse() * (acceleration_world - gravity_world())
    }

    /// Mean angular rate over the step, body frame, rad/s: the rotation between the two ends.
    pub(super) fn mean_angular_rate(&self) -> Vector3<f64> {
        let turn = self.from.world_from_body.rotation.inverse() * self.to.world_from_body.rotation;
        so3::log(&turn) / self.duration_s()
    }

    /// Distance (m) from `origin_world` to the first surface along `direction_world`, if there is
    /// one within `max_m`.
    pub(super) fn cast(
        &self,
        time: Timestamp,
        origin_world: &Point3<f64>,
        direction_world: &Vector3<f64>,
        max_m: f64,
    ) -> Option<f64> {
        self.world
            .cast_ray(origin_world, direction_world, max_m, time)
            .map(|hit| hit.distance_m)
    }

    fn share(&self, time: Timestamp) -> f64 {
        time.seconds_since(self.from.time) / self.duration_s()
    }
}
