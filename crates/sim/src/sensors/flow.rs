//! Flow camera: mean image motion around the principal point, as a PX4Flow reports it.

use alula_geometry::{Pose, Timestamp};
use alula_messages::{FlowSample, Mount};
use alula_parameters::{facts, parameters};
use nalgebra::{Point3, Vector2, Vector3};

use super::channel::Channel;
use super::failure::FailureConfig;
use super::noise::Noise;
use super::step::{Piece, Step};

parameters! {
    /// Errors and limits of a flow camera.
    pub struct FlowModel {
        /// Samples per second; each is the mean over the time since the one before.
        pub rate_hz: f64 = 100.0, within(1.0, 400.0);
        /// Time from the end of the interval to arrival, s.
        pub latency_s: f64 = 0.01, within(0.0, 1.0);
        /// White noise of a sample on each axis, rad/s. Document S, table 2.4: 10 pixels per
        /// second, over the 667 pixels of focal length of a PX4Flow (16 mm, 24 um with binning).
        pub noise_rad_s: f64 = 0.015, within(0.0, 1.0);
        /// Constant error on each axis, rad/s.
        pub bias_rad_s: [f64; 2] = [0.0; 2], within(-1.0, 1.0);
        /// Ratio of measured to true motion: the error of the calibrated focal length.
        pub scale: f64 = 1.0, within(0.5, 1.5);
        /// Least distance along the optical axis at which it is of use, m (document S,
        /// section 2.10.2).
        pub min_distance_m: f64 = 0.3, within(0.0, 10.0);
        /// Greatest distance along the optical axis at which the ground has texture, m.
        pub max_distance_m: f64 = 8.0, within(0.1, 100.0);
        /// Fastest image motion that can be matched, rad/s: 4 pixels between frames at 400 Hz.
        pub max_flow_rad_s: f64 = 2.4, above(0.0);
        /// Failures.
        pub failures: Vec<FailureConfig> = Vec::new(), nested();
    }
}

facts! {
    /// A flow camera on a vehicle.
    pub struct FlowSetup {
        /// Calibrated pose in the body.
        pub mount: Mount, nested();
        /// Errors and limits.
        #[serde(default)]
        pub model: FlowModel, nested();
    }
}

/// Image velocity (rad/s, optical frame) of the surface at `distance_m` along the optical axis
/// (document S, equations 2.19 to 2.22, with unit focal length): `-v_xy / z + (-w_y, w_x)` by the
/// sign of (2.20), for the camera's own velocity and angular rate in its optical frame.
pub(super) fn flow_rad_s(
    velocity_camera: &Vector3<f64>,
    angular_rate_camera: &Vector3<f64>,
    distance_m: f64,
) -> Vector2<f64> {
    let turning = Vector2::new(-angular_rate_camera.y, angular_rate_camera.x);
    turning - velocity_camera.xy() / distance_m
}

/// The running mean of the motion of the image since the last sample.
#[derive(Clone, Debug, Default)]
struct Mean {
    flow: Vector2<f64>,
    duration_s: f64,
    /// Whether the surface was in reach during all of the interval.
    lost: bool,
}

/// The simulated sensor.
#[derive(Clone, Debug)]
pub(super) struct Flow {
    model: FlowModel,
    body_from_camera: Pose,
    channel: Channel<FlowSample>,
    noise: Noise,
    mean: Mean,
}

impl Flow {
    pub(super) fn new(setup: &FlowSetup, flight_seed: u64) -> Self {
        let model = setup.model.clone();
        Self {
            body_from_camera: setup.mount.body_from_sensor(),
            channel: Channel::new(
                model.rate_hz,
                model.latency_s,
                &model.failures,
                flight_seed,
                "flow",
            ),
            noise: Noise::new(flight_seed, "flow"),
            mean: Mean::default(),
            model,
        }
    }

    pub(super) fn advance(&mut self, step: &Step) {
        let mut start = step.from.time;
        while self.channel.due() <= step.to.time {
            let due = self.channel.due();
            self.accumulate(step, step.piece(start, due));
            let sample = self.sample(due);
            self.channel.send(sample);
            start = due;
        }
        self.accumulate(step, step.piece(start, step.to.time));
    }

    pub(super) fn deliver(&mut self, now: Timestamp, received: &mut Vec<FlowSample>) {
        self.channel.deliver(now, received);
    }

    /// Adds the motion at the middle of `piece`.
    fn accumulate(&mut self, step: &Step, piece: Piece) {
        let duration_s = piece.duration_s();
        if duration_s <= 0.0 {
            return;
        }
        self.mean.duration_s += duration_s;
        match self.flow_at(step, piece.middle()) {
            Some(flow) => self.mean.flow += flow * duration_s,
            None => self.mean.lost = true,
        }
    }

    /// Image velocity at an instant, if the surface is in reach.
    fn flow_at(&self, step: &Step, time: Timestamp) -> Option<Vector2<f64>> {
        let world_from_body = step.pose_at(time);
        let world_from_camera = world_from_body * self.body_from_camera;
        let origin_world = Point3::from(world_from_camera.translation.vector);
        let axis_world = world_from_camera.rotation * Vector3::z();
        let distance_m = step
            .cast(time, &origin_world, &axis_world, self.model.max_distance_m)
            .filter(|&distance_m| distance_m >= self.model.min_distance_m)?;
        let rate_body = step.mean_angular_rate();
        let lever_body = self.body_from_camera.translation.vector;
        let velocity_body = world_from_body.rotation.inverse() * step.velocity_at(time)
            + rate_body.cross(&lever_body);
        let camera_from_body = self.body_from_camera.rotation.inverse();
        Some(flow_rad_s(
            &(camera_from_body * velocity_body),
            &(camera_from_body * rate_body),
            distance_m,
        ))
    }

    /// Without a match the sensor reports no motion with quality 0, as a PX4Flow does. The share
    /// of blocks that match falls with the square of the speed and reaches 0 at the limit.
    fn sample(&mut self, end: Timestamp) -> FlowSample {
        let mean = std::mem::take(&mut self.mean);
        let noise = Vector2::new(self.noise.normal(), self.noise.normal());
        let flow = mean.flow * self.model.scale / mean.duration_s;
        let speed = flow.amax() / self.model.max_flow_rad_s;
        let matched = !mean.lost && speed < 1.0;
        FlowSample {
            time: Timestamp::from_ns(end.as_ns() - (0.5e9 * mean.duration_s).round() as i64),
            interval_s: mean.duration_s,
            flow_rad_s: if matched {
                flow + noise * self.model.noise_rad_s + Vector2::from(self.model.bias_rad_s)
            } else {
                Vector2::zeros()
            },
            quality: if matched { 1.0 - speed * speed } else { 0.0 },
        }
    }
}
