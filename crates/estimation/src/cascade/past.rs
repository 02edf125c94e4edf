//! The recent past of the velocity filter: enough to hold a late measurement against what was
//! believed at its own time.

use std::collections::VecDeque;

use alula_geometry::{Timestamp, so3};
use nalgebra::{SVector, UnitQuaternion, Vector3};

use super::kalman::{HEIGHT, VELOCITY};
use crate::imu::mean_angular_rate;

/// What was believed at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The time.
    pub time: Timestamp,
    /// Attitude.
    pub world_from_body: UnitQuaternion<f64>,
    /// Reading of the gyroscope over the interval that ends here, bias included, rad/s.
    pub angular_rate: Vector3<f64>,
    /// Velocity, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Height above the ground, m.
    pub height_m: f64,
}

/// A ring of moments, oldest first.
#[derive(Clone, Debug)]
pub struct Past {
    capacity: usize,
    moments: VecDeque<Moment>,
}

impl Past {
    /// An empty ring of up to `capacity` moments.
    pub fn new(capacity: usize) -> Self {
        Self {
            capacity,
            moments: VecDeque::with_capacity(capacity + 1),
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.moments.clear();
    }

    /// Adds a moment later than all before.
    pub fn push(&mut self, moment: Moment) {
        if self.moments.len() == self.capacity {
            self.moments.pop_front();
        }
        self.moments.push_back(moment);
    }

    /// The latest moment.
    pub fn latest(&self) -> Option<&Moment> {
        self.moments.back()
    }

    /// What was believed at `time`, between two moments; the latest if `time` is later, `None` if
    /// it is earlier than all.
    pub fn at(&self, time: Timestamp) -> Option<Moment> {
        let next = self.moments.partition_point(|m| m.time < time);
        let Some(after) = self.moments.get(next) else {
            return self.moments.back().copied();
        };
        if after.time == time {
            return Some(*after);
        }
        let before = self.moments.get(next.checked_sub(1)?)?;
        let share = time.seconds_since(before.time) / after.time.seconds_since(before.time);
        let turn = so3::log(&(before.world_from_body.inverse() * after.world_from_body));
        Some(Moment {
            time,
            world_from_body: before.world_from_body * so3::exp(&(turn * share)),
            angular_rate: after.angular_rate,
            velocity_world: before.velocity_world.lerp(&after.velocity_world, share),
            height_m: before.height_m + (after.height_m - before.height_m) * share,
        })
    }

    /// Mean reading of the gyroscope between two times as far as the ring reaches, rad/s.
    pub fn mean_angular_rate(&self, from: Timestamp, to: Timestamp) -> Option<Vector3<f64>> {
        let samples = self.moments.iter().rev();
        mean_angular_rate(samples.map(|s| (s.time, s.angular_rate)), from, to)
    }

    /// Applies a correction of the present to the past, so that the next late measurement is not
    /// held against an error that is already removed. An error of velocity was the same before; one
    /// of height was smaller by what the velocity has added since.
    pub fn correct(&mut self, correction: &SVector<f64, 7>) {
        let Some(now) = self.latest().map(|m| m.time) else {
            return;
        };
        let velocity = correction.fixed_rows::<3>(VELOCITY).into_owned();
        for moment in &mut self.moments {
            moment.velocity_world += velocity;
            moment.height_m += correction[HEIGHT] - velocity.z * now.seconds_since(moment.time);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: i64) -> Timestamp {
        Timestamp::from_ns(ms * 1_000_000)
    }

    /// Turns at 1 rad/s about z and speeds up along x by 1 m/s^2.
    fn past() -> Past {
        let mut past = Past::new(10);
        for i in 0..20 {
            let time = ms(10 * i);
            past.push(Moment {
                time,
                world_from_body: so3::exp(&(Vector3::z() * time.as_s())),
                angular_rate: Vector3::z() * (i as f64),
                velocity_world: Vector3::x() * time.as_s(),
                height_m: 1.0,
            });
        }
        past
    }

    #[test]
    fn between_two_moments_the_motion_is_interpolated() {
        let moment = past().at(ms(155)).unwrap();
        assert!((moment.velocity_world.x - 0.155).abs() < 1e-12);
        assert!((so3::yaw_rad(&moment.world_from_body) - 0.155).abs() < 1e-12);
    }

    #[test]
    fn before_the_ring_nothing_is_known_and_after_it_the_latest_holds() {
        assert_eq!(past().at(ms(95)), None);
        assert_eq!(past().at(ms(100)).unwrap().time, ms(100));
        assert_eq!(past().at(ms(195)).unwrap().time, ms(190));
    }

    #[test]
    fn the_mean_rate_is_weighted_by_time() {
        let rate = past().mean_angular_rate(ms(145), ms(160)).unwrap();
        assert!((rate.z - (15.0 * 5.0 + 16.0 * 10.0) / 15.0).abs() < 1e-12);
    }

    #[test]
    fn a_correction_of_velocity_reaches_the_height_by_its_age() {
        let mut past = past();
        let mut correction = SVector::<f64, 7>::zeros();
        correction[2] = 0.5;
        correction[3] = 0.1;
        past.correct(&correction);
        let moment = past.at(ms(150)).unwrap();
        assert!((moment.height_m - (1.0 + 0.1 - 0.5 * 0.04)).abs() < 1e-12);
        assert!((moment.velocity_world.z - 0.5).abs() < 1e-12);
    }
}
