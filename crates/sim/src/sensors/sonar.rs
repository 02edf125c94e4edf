//! Ultrasonic ranger: the nearest echo in a wide cone, and wrong ones when tilted.

use std::f64::consts::TAU;

use alula_geometry::{Pose, Timestamp};
use alula_messages::{Mount, RangeSample};
use alula_parameters::{facts, parameters};
use nalgebra::{Point3, Vector3};

use super::channel::Channel;
use super::failure::FailureConfig;
use super::infrared::reading;
use super::noise::Noise;
use super::step::Step;

/// Rays on the edge of the cone; half as many run half-way to it.
const EDGE_RAYS: usize = 12;

parameters! {
    /// Errors and limits of an ultrasonic ranger (document S, sections 2.4.2 and 2.10.2: the sonar
    /// of a PX4Flow).
    pub struct SonarModel {
        /// Samples per second.
        pub rate_hz: f64 = 15.0, within(1.0, 100.0);
        /// Time from measurement to arrival, s.
        pub latency_s: f64 = 0.02, within(0.0, 1.0);
        /// White noise of a sample, m (document S, table 2.3).
        pub noise_m: f64 = 0.05, within(0.0, 1.0);
        /// Constant error, m.
        pub bias_m: f64 = 0.0, within(-1.0, 1.0);
        /// Least distance it can measure, m (document S, section 2.10.2).
        pub min_m: f64 = 0.3, within(0.01, 1.0);
        /// Greatest distance it can measure, m.
        pub max_m: f64 = 5.0, within(1.0, 20.0);
        /// Half of the opening angle of the beam, degrees.
        pub half_angle_deg: f64 = 20.0, within(0.0, 60.0);
        /// Angle of the beam from the vertical above which echoes may be wrong, degrees (document
        /// S, section 2.10.2).
        pub wrong_echo_tilt_deg: f64 = 20.0, within(0.0, 90.0);
        /// Probability that a sample is a wrong echo when tilted more than that; it is then
        /// uniform between the limits.
        pub wrong_echo_probability: f64 = 0.3, within(0.0, 1.0);
        /// Failures.
        pub failures: Vec<FailureConfig> = Vec::new(), nested();
    }
}

facts! {
    /// An ultrasonic ranger on a vehicle; the axis of the beam is the optical axis.
    pub struct SonarSetup {
        /// Calibrated pose in the body.
        pub mount: Mount, nested();
        /// Errors and limits.
        #[serde(default)]
        pub model: SonarModel, nested();
    }
}

/// The simulated sensor.
#[derive(Clone, Debug)]
pub(super) struct Sonar {
    model: SonarModel,
    body_from_beam: Pose,
    /// Unit directions within the beam, in its frame.
    rays: Vec<Vector3<f64>>,
    channel: Channel<RangeSample>,
    noise: Noise,
}

impl Sonar {
    pub(super) fn new(setup: &SonarSetup, flight_seed: u64) -> Self {
        let model = setup.model.clone();
        Self {
            body_from_beam: setup.mount.body_from_sensor(),
            rays: cone(model.half_angle_deg.to_radians()),
            channel: Channel::new(
                model.rate_hz,
                model.latency_s,
                &model.failures,
                flight_seed,
                "sonar",
            ),
            noise: Noise::new(flight_seed, "sonar"),
            model,
        }
    }

    pub(super) fn advance(&mut self, step: &Step) {
        while self.channel.due() <= step.to.time {
            let time = self.channel.due();
            let sample = self.measure(step, time);
            self.channel.send(sample);
        }
    }

    pub(super) fn deliver(&mut self, now: Timestamp, received: &mut Vec<RangeSample>) {
        self.channel.deliver(now, received);
    }

    fn measure(&mut self, step: &Step, time: Timestamp) -> RangeSample {
        let world_from_beam = step.pose_at(time) * self.body_from_beam;
        let (min_m, max_m) = (self.model.min_m, self.model.max_m);
        let error_m = self.model.bias_m + self.noise.normal() * self.model.noise_m;
        let distance_m = match self.wrong_echo(&world_from_beam) {
            Some(wrong_m) => Some(wrong_m),
            None => self.nearest_echo(step, time, &world_from_beam),
        };
        reading(time, distance_m, error_m, min_m, max_m)
    }

    /// A reading that has nothing to do with the distance, if the tilt and chance bring one.
    fn wrong_echo(&mut self, world_from_beam: &Pose) -> Option<f64> {
        let wrong = self.noise.happens(self.model.wrong_echo_probability);
        let share = self.noise.uniform();
        let tilted =
            angle_from_down_rad(world_from_beam) > self.model.wrong_echo_tilt_deg.to_radians();
        let span_m = self.model.max_m - self.model.min_m;
        (wrong && tilted).then_some(self.model.min_m + share * span_m)
    }

    /// The nearest surface in the cone. Straight down is tried as well when it lies in the cone:
    /// that is the nearest point of level ground, which falls between the other rays.
    fn nearest_echo(&self, step: &Step, time: Timestamp, world_from_beam: &Pose) -> Option<f64> {
        let origin = Point3::from(world_from_beam.translation.vector);
        let down_in_beam =
            angle_from_down_rad(world_from_beam) <= self.model.half_angle_deg.to_radians();
        let down = down_in_beam.then_some(-Vector3::z());
        self.rays
            .iter()
            .map(|ray| world_from_beam.rotation * ray)
            .chain(down)
            .filter_map(|direction| step.cast(time, &origin, &direction, self.model.max_m))
            .reduce(f64::min)
    }
}

/// Angle (rad) between the axis of a beam and straight down.
fn angle_from_down_rad(world_from_beam: &Pose) -> f64 {
    (world_from_beam.rotation * Vector3::z()).angle(&-Vector3::z())
}

/// The axis, rays half-way to the edge, and rays on the edge of a cone about z.
fn cone(half_angle_rad: f64) -> Vec<Vector3<f64>> {
    let ring = |count: usize, angle_rad: f64| {
        (0..count).map(move |k| {
            let azimuth_rad = TAU * k as f64 / count as f64;
            let (radius, axial) = angle_rad.sin_cos();
            Vector3::new(
                radius * azimuth_rad.cos(),
                radius * azimuth_rad.sin(),
                axial,
            )
        })
    };
    std::iter::once(Vector3::z())
        .chain(ring(EDGE_RAYS / 2, 0.5 * half_angle_rad))
        .chain(ring(EDGE_RAYS, half_angle_rad))
        .collect()
}
