//! Failures that a scenario can switch on in any sensor.

use std::sync::Arc;

use alula_geometry::Timestamp;
use alula_messages::{AutopilotStatus, DepthImage, FlowSample, ImuSample, PoseSample, RangeSample};
use alula_parameters::parameters;
use serde::{Deserialize, Serialize};

use super::noise::Noise;

/// How a sensor fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureKind {
    /// Samples do not arrive.
    DropOut,
    /// The last sample before the failure is repeated with fresh time stamps.
    Stuck,
    /// Samples are far off.
    Outliers,
}

parameters! {
    /// A failure of one sensor for some time.
    pub struct FailureConfig {
        /// What happens.
        pub kind: FailureKind = FailureKind::DropOut, any();
        /// Start, seconds since the start of the simulation.
        pub start_s: f64 = 0.0, within(0.0, 1e6);
        /// Duration, s.
        pub duration_s: f64 = 1e6, within(0.0, 1e6);
        /// Probability that one sample in that time is affected.
        pub probability: f64 = 1.0, within(0.0, 1.0);
        /// Size of an outlier in the unit of the sensor: m/s^2 of specific force, rad/s of flow, m
        /// of range or position; a depth image gets a false surface at this distance (m).
        pub magnitude: f64 = 1.0, within(0.0, 1e3);
    }
}

impl FailureConfig {
    /// Whether a sample taken at `time` falls into the failure.
    pub(super) fn covers(&self, time: Timestamp) -> bool {
        let start = Timestamp::from_s(self.start_s);
        let end = Timestamp::from_s(self.start_s + self.duration_s);
        time >= start && time < end
    }
}

/// A sample that failures can act on.
pub(super) trait Sample: Clone {
    /// The same sample, stamped with the time of `fresh`.
    fn repeated_at(&self, fresh: &Self) -> Self;

    /// Moves the sample off by `magnitude` in its own unit.
    fn disturb(&mut self, magnitude: f64, noise: &mut Noise);
}

macro_rules! repeated_with_time {
    () => {
        fn repeated_at(&self, fresh: &Self) -> Self {
            Self {
                time: fresh.time,
                ..*self
            }
        }
    };
}

impl Sample for ImuSample {
    repeated_with_time!();
    fn disturb(&mut self, magnitude: f64, noise: &mut Noise) {
        self.specific_force += noise.direction() * magnitude;
    }
}

impl Sample for FlowSample {
    repeated_with_time!();
    fn disturb(&mut self, magnitude: f64, noise: &mut Noise) {
        let angle_rad = std::f64::consts::TAU * noise.uniform();
        self.flow_rad_s.x += magnitude * angle_rad.cos();
        self.flow_rad_s.y += magnitude * angle_rad.sin();
    }
}

impl Sample for RangeSample {
    repeated_with_time!();
    fn disturb(&mut self, magnitude: f64, noise: &mut Noise) {
        let sign = if noise.happens(0.5) { 1.0 } else { -1.0 };
        self.range_m = (self.range_m + sign * magnitude).max(0.0);
    }
}

impl Sample for PoseSample {
    repeated_with_time!();
    fn disturb(&mut self, magnitude: f64, noise: &mut Noise) {
        self.world_from_body.translation.vector += noise.direction() * magnitude;
    }
}

impl Sample for AutopilotStatus {
    repeated_with_time!();
    fn disturb(&mut self, magnitude: f64, noise: &mut Noise) {
        let sign = if noise.happens(0.5) { 1.0 } else { -1.0 };
        self.thrust_fraction = (self.thrust_fraction + sign * magnitude).clamp(0.0, 1.0);
    }
}

impl Sample for Arc<DepthImage> {
    fn repeated_at(&self, fresh: &Self) -> Self {
        Arc::new(DepthImage {
            time: fresh.time,
            ..DepthImage::clone(self)
        })
    }

    /// A rectangle of a quarter of the width and height, anywhere, at the distance `magnitude`.
    fn disturb(&mut self, magnitude: f64, noise: &mut Noise) {
        let image = Self::make_mut(self);
        let width = image.camera.width_px as usize;
        let height = image.camera.height_px as usize;
        let left = (0.75 * width as f64 * noise.uniform()) as usize;
        let top = (0.75 * height as f64 * noise.uniform()) as usize;
        let depth_mm = (magnitude * 1000.0).round() as u16;
        for row in image
            .depth_mm
            .chunks_exact_mut(width)
            .skip(top)
            .take(height / 4)
        {
            row[left..left + width / 4].fill(depth_mm);
        }
    }
}
