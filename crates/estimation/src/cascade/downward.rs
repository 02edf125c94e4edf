//! What the downward sensors of the cascade say: flow and range, held against what was believed at
//! their own time.

use alula_geometry::{TimeDelta, Timestamp};
use alula_messages::{FlightPhase, FlowSample, RangeSample, Rejection, Sensor};

use super::kalman::Seen;
use super::past::Moment;
use super::sight::{self, FirstStage, Flow};
use super::{Cascade, Ranger};
use crate::watch::{check_flow, check_range};

impl Cascade {
    pub(super) fn take_flow(&mut self, sample: &FlowSample, now: Timestamp) {
        match self.flow_seen(sample, now) {
            Ok(seen) => self.fuse(sample.time, Sensor::Flow, &seen),
            Err(reason) => self.reject(sample.time, Sensor::Flow, reason),
        }
    }

    fn flow_seen(&mut self, sample: &FlowSample, now: Timestamp) -> Result<Seen<2>, Rejection> {
        check_flow(
            sample,
            now,
            self.check_phase(),
            &mut self.flow_repetition,
            self.config.flow_min_quality,
            self.config.stuck_after_s,
        )?;
        check_order(&mut self.flow_last, sample.time)?;
        let (moment, age_s) = self.moment_at(sample.time)?;
        let half = TimeDelta::from_s(0.5 * sample.interval_s);
        let (from, to) = (sample.time - half, sample.time + half);
        let rate = self.past.mean_angular_rate(from, to);
        Flow {
            flow_rad_s: sample.flow_rad_s,
            angular_rate: rate.unwrap_or(moment.angular_rate) - self.attitude.gyroscope_bias(),
            sigma_rad_s: self.config.flow_sigma_rad_s,
            min_distance_m: self.config.flow_min_distance_m,
        }
        .seen(&self.body_from_camera, &moment, age_s, &self.first_stage())
    }

    pub(super) fn take_range(&mut self, sample: &RangeSample, now: Timestamp) {
        let sensor = self.range_sensor();
        match self.range_seen(sample, now) {
            Ok(seen) => self.fuse(sample.time, sensor, &seen),
            Err(reason) => self.reject(sample.time, sensor, reason),
        }
    }

    fn range_seen(&mut self, sample: &RangeSample, now: Timestamp) -> Result<Seen<1>, Rejection> {
        let (ready, repetition) = (self.check_phase(), &mut self.range_repetition);
        check_range(sample, now, ready, repetition, self.config.stuck_after_s)?;
        check_order(&mut self.range_last, sample.time)?;
        let (moment, age_s) = self.moment_at(sample.time)?;
        let sigma_m = self.config.range_sigma_m;
        let first = self.first_stage();
        sight::range(
            sample.range_m,
            sigma_m,
            &self.body_from_ranger,
            &moment,
            age_s,
            &first,
        )
    }

    /// What was believed at `time`, and how long ago that was, s.
    fn moment_at(&self, time: Timestamp) -> Result<(Moment, f64), Rejection> {
        let moment = self.past.at(time).ok_or(Rejection::TooOld)?;
        let latest = self.past.latest().map_or(time, |m| m.time);
        Ok((moment, latest.seconds_since(time).max(0.0)))
    }

    fn first_stage(&self) -> FirstStage {
        FirstStage {
            tilt_sigma_rad: self.attitude.tilt_sigma_rad(),
            rate_sigma_rad_s: self.attitude.gyroscope_bias_sigma_rad_s(),
        }
    }

    fn range_sensor(&self) -> Sensor {
        match self.config.ranger {
            Ranger::Infrared => Sensor::Infrared,
            Ranger::Sonar => Sensor::Sonar,
        }
    }

    /// On the ground, or before the start, the downward sensors say nothing.
    fn check_phase(&self) -> Result<(), Rejection> {
        if self.phase == FlightPhase::Landed || !self.running {
            return Err(Rejection::Phase);
        }
        Ok(())
    }
}

/// Refuses what is not later than the last sample of the same sensor.
fn check_order(last: &mut Option<Timestamp>, time: Timestamp) -> Result<(), Rejection> {
    if last.is_some_and(|last| time <= last) {
        return Err(Rejection::OutOfOrder);
    }
    *last = Some(time);
    Ok(())
}
