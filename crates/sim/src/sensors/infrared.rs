//! Infrared ranger: distance along a narrow beam.

use alula_geometry::{Pose, Timestamp};
use alula_messages::{Mount, RangeSample};
use alula_parameters::{facts, parameters};
use nalgebra::{Point3, Vector3};

use super::channel::Channel;
use super::failure::FailureConfig;
use super::noise::Noise;
use super::step::Step;

parameters! {
    /// Errors and limits of an infrared time-of-flight ranger (document S, sections 2.4.4 and
    /// 2.10.2: TeraRanger One).
    pub struct InfraredModel {
        /// Samples per second.
        pub rate_hz: f64 = 50.0, within(1.0, 800.0);
        /// Time from measurement to arrival, s.
        pub latency_s: f64 = 0.002, within(0.0, 1.0);
        /// White noise of a sample, m (document S, table 2.4).
        pub noise_m: f64 = 0.02, within(0.0, 1.0);
        /// Constant error, m.
        pub bias_m: f64 = 0.0, within(-1.0, 1.0);
        /// Least distance it can measure, m.
        pub min_m: f64 = 0.05, within(0.01, 1.0);
        /// Greatest distance it can measure, m.
        pub max_m: f64 = 14.0, within(1.0, 100.0);
        /// Failures.
        pub failures: Vec<FailureConfig> = Vec::new(), nested();
    }
}

facts! {
    /// An infrared ranger on a vehicle; the beam is the optical axis.
    pub struct InfraredSetup {
        /// Calibrated pose in the body.
        pub mount: Mount, nested();
        /// Errors and limits.
        #[serde(default)]
        pub model: InfraredModel, nested();
    }
}

/// The reading of a ranger that measured `distance_m`, or nothing, with an error: outside of its
/// limits a ranger reads 0 when too near and twice its limit when there is no echo.
pub(super) fn reading(
    time: Timestamp,
    distance_m: Option<f64>,
    error_m: f64,
    min_m: f64,
    max_m: f64,
) -> RangeSample {
    let range_m = match distance_m {
        Some(distance_m) if distance_m < min_m => 0.0,
        Some(distance_m) => (distance_m + error_m).max(0.0),
        None => 2.0 * max_m,
    };
    RangeSample {
        time,
        range_m,
        min_m,
        max_m,
    }
}

/// The simulated sensor.
#[derive(Clone, Debug)]
pub(super) struct Infrared {
    model: InfraredModel,
    body_from_beam: Pose,
    channel: Channel<RangeSample>,
    noise: Noise,
}

impl Infrared {
    pub(super) fn new(setup: &InfraredSetup, flight_seed: u64) -> Self {
        let model = setup.model.clone();
        Self {
            body_from_beam: setup.mount.body_from_sensor(),
            channel: Channel::new(
                model.rate_hz,
                model.latency_s,
                &model.failures,
                flight_seed,
                "infrared",
            ),
            noise: Noise::new(flight_seed, "infrared"),
            model,
        }
    }

    pub(super) fn advance(&mut self, step: &Step) {
        while self.channel.due() <= step.to.time {
            let time = self.channel.due();
            let world_from_beam = step.pose_at(time) * self.body_from_beam;
            let origin = Point3::from(world_from_beam.translation.vector);
            let axis = world_from_beam.rotation * Vector3::z();
            let distance_m = step.cast(time, &origin, &axis, self.model.max_m);
            let error_m = self.model.bias_m + self.noise.normal() * self.model.noise_m;
            let (min_m, max_m) = (self.model.min_m, self.model.max_m);
            self.channel
                .send(reading(time, distance_m, error_m, min_m, max_m));
        }
    }

    pub(super) fn deliver(&mut self, now: Timestamp, received: &mut Vec<RangeSample>) {
        self.channel.deliver(now, received);
    }
}
