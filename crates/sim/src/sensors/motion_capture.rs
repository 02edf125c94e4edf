//! Motion capture: the pose seen from outside, late and with losses.

use alula_geometry::{Pose, Timestamp, so3};
use alula_messages::PoseSample;
use alula_parameters::parameters;
use nalgebra::Translation3;

use super::channel::Channel;
use super::failure::FailureConfig;
use super::noise::Noise;
use super::step::Step;

parameters! {
    /// Errors of a motion capture system.
    pub struct MotionCaptureModel {
        /// Samples per second.
        pub rate_hz: f64 = 120.0, within(1.0, 500.0);
        /// Time from measurement to arrival, s.
        pub latency_s: f64 = 0.02, within(0.0, 1.0);
        /// White noise of the position on each axis, m.
        pub position_noise_m: f64 = 0.001, within(0.0, 1.0);
        /// White noise of the orientation on each axis, rad.
        pub orientation_noise_rad: f64 = 0.002, within(0.0, 0.5);
        /// Constant error of the position, world frame, m: the error of its calibration.
        pub position_bias_m: [f64; 3] = [0.0; 3], within(-1.0, 1.0);
        /// Probability that a sample is lost.
        pub loss_probability: f64 = 0.01, within(0.0, 1.0);
        /// Failures.
        pub failures: Vec<FailureConfig> = Vec::new(), nested();
    }
}

/// The simulated sensor.
#[derive(Clone, Debug)]
pub(super) struct MotionCapture {
    model: MotionCaptureModel,
    channel: Channel<PoseSample>,
    noise: Noise,
}

impl MotionCapture {
    pub(super) fn new(model: &MotionCaptureModel, flight_seed: u64) -> Self {
        Self {
            model: model.clone(),
            channel: Channel::new(
                model.rate_hz,
                model.latency_s,
                &model.failures,
                flight_seed,
                "motion_capture",
            ),
            noise: Noise::new(flight_seed, "motion_capture"),
        }
    }

    pub(super) fn advance(&mut self, step: &Step) {
        while self.channel.due() <= step.to.time {
            let time = self.channel.due();
            let sample = PoseSample {
                time,
                sensor: 0,
                world_from_body: self.measured(&step.pose_at(time)),
            };
            if self.noise.happens(self.model.loss_probability) {
                self.channel.skip();
            } else {
                self.channel.send(sample);
            }
        }
    }

    pub(super) fn deliver(&mut self, now: Timestamp, received: &mut Vec<PoseSample>) {
        self.channel.deliver(now, received);
    }

    /// `pose` with noise on its position (world) and its orientation (body).
    fn measured(&mut self, pose: &Pose) -> Pose {
        let shift = self.noise.normal_vector() * self.model.position_noise_m
            + nalgebra::Vector3::from(self.model.position_bias_m);
        let turn = self.noise.normal_vector() * self.model.orientation_noise_rad;
        Pose::from_parts(
            Translation3::from(pose.translation.vector + shift),
            pose.rotation * so3::exp(&turn),
        )
    }
}
