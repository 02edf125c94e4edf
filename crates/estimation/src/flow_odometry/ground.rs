//! What is fused while the vehicle stands on the ground.

use alula_geometry::{TimeDelta, Timestamp};
use alula_messages::ImuSample;
use nalgebra::Vector3;

use super::config::GroundConfig;
use crate::alignment::AlignmentConfig;
use crate::inertial_core::InertialCore;
use crate::measurement::{
    AngularRateMeasurement, HoldMeasurement, Measurement, VelocityMeasurement,
};

/// Submits zero velocity and zero angular rate at a fixed rate, and the place and heading of the
/// start until the first flight.
///
/// After a flight the place is not fused: where the vehicle landed is known no better for being
/// told again, and zero velocity alone keeps it there.
#[derive(Clone, Debug)]
pub struct Standing {
    config: GroundConfig,
    place: HoldMeasurement,
    flown: bool,
    since: Timestamp,
}

impl Standing {
    pub fn new(config: &GroundConfig, start: &AlignmentConfig) -> Self {
        Self {
            place: HoldMeasurement {
                position_world: Vector3::from(start.start_position_m).xy(),
                yaw_rad: start.start_yaw_rad(),
                sigma_m: config.position_sigma_m,
                sigma_rad: config.yaw_sigma_rad,
            },
            config: config.clone(),
            flown: false,
            since: Timestamp::ZERO,
        }
    }

    /// The vehicle is aligned at the start.
    pub fn start(&mut self, now: Timestamp) {
        self.flown = false;
        self.since = now;
    }

    /// The vehicle leaves the ground.
    pub fn leave(&mut self) {
        self.flown = true;
    }

    /// Takes a sample that is already in the history of `core`.
    pub fn add(&mut self, sample: &ImuSample, core: &mut InertialCore) {
        let period_s = 1.0 / self.config.rate_hz;
        let elapsed_s = sample.time.seconds_since(self.since);
        // The stamps of a regular sensor jitter by less than a hundredth of the period.
        if elapsed_s < 0.99 * period_s {
            return;
        }
        let begin = self
            .since
            .max(sample.time - TimeDelta::from_s(2.0 * period_s));
        if let Some(angular_rate) = core.mean_angular_rate(begin, sample.time) {
            let still = Measurement::GroundRate(AngularRateMeasurement {
                angular_rate,
                sigma_rad_s: self.config.angular_rate_sigma_rad_s,
            });
            core.submit(sample.time, TimeDelta::ZERO, still);
        }
        let velocity = VelocityMeasurement {
            sigma_m_s: self.config.velocity_sigma_m_s,
        };
        core.submit(
            sample.time,
            TimeDelta::ZERO,
            Measurement::GroundVelocity(velocity),
        );
        if !self.flown {
            core.submit(
                sample.time,
                TimeDelta::ZERO,
                Measurement::GroundHold(self.place),
            );
        }
        self.since = sample.time;
    }
}
