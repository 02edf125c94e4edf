//! Inertial measurement unit: scale, bias, random walk, white noise and vibration on the mean
//! motion of each interval.

use alula_geometry::{Timestamp, so3};
use alula_messages::ImuSample;
use alula_parameters::parameters;
use nalgebra::{UnitQuaternion, Vector3};

use super::channel::Channel;
use super::failure::FailureConfig;
use super::noise::Noise;
use super::step::Step;

parameters! {
    /// Errors of an inertial measurement unit at the body's origin.
    ///
    /// Densities and random walks default to document L, table A-1 (Bosch BMI055); initial biases
    /// to document S, table 2.4; limits to the widest ranges of the BMI055.
    pub struct ImuModel {
        /// Samples per second.
        pub rate_hz: f64 = 250.0, within(50.0, 1000.0);
        /// Time from measurement to arrival, s.
        pub latency_s: f64 = 0.0, within(0.0, 1.0);
        /// White noise of the accelerometer, m/s^2/sqrt(Hz).
        pub accelerometer_noise_m_s2_sqrt_hz: f64 = 1.317e-3, within(0.0, 1.0);
        /// Random walk of the accelerometer's bias, m/s^3/sqrt(Hz).
        pub accelerometer_bias_walk_m_s3_sqrt_hz: f64 = 3.163e-4, within(0.0, 1.0);
        /// Standard deviation from which each axis draws its initial bias, m/s^2.
        pub accelerometer_bias_sigma_m_s2: f64 = 0.02, within(0.0, 5.0);
        /// Initial bias of the accelerometer, m/s^2; if absent it is drawn.
        pub accelerometer_bias_m_s2: Option<[f64; 3]> = None, within(-5.0, 5.0);
        /// Scale of each axis of the accelerometer.
        pub accelerometer_scale: [f64; 3] = [1.0; 3], within(0.5, 1.5);
        /// Greatest specific force it can read, m/s^2 (16 g).
        pub accelerometer_limit_m_s2: f64 = 156.9, above(0.0);
        /// White noise of the gyroscope, rad/s/sqrt(Hz).
        pub gyroscope_noise_rad_s_sqrt_hz: f64 = 1.143e-4, within(0.0, 1.0);
        /// Random walk of the gyroscope's bias, rad/s^2/sqrt(Hz).
        pub gyroscope_bias_walk_rad_s2_sqrt_hz: f64 = 3.013e-6, within(0.0, 1.0);
        /// Standard deviation from which each axis draws its initial bias, rad/s.
        pub gyroscope_bias_sigma_rad_s: f64 = 0.004, within(0.0, 1.0);
        /// Initial bias of the gyroscope, rad/s; if absent it is drawn.
        pub gyroscope_bias_rad_s: Option<[f64; 3]> = None, within(-1.0, 1.0);
        /// Scale of each axis of the gyroscope.
        pub gyroscope_scale: [f64; 3] = [1.0; 3], within(0.5, 1.5);
        /// Greatest angular rate it can read, rad/s (2000 degrees per second).
        pub gyroscope_limit_rad_s: f64 = 34.9, above(0.0);
        /// White noise of the accelerometer that the propellers add at full thrust,
        /// m/s^2/sqrt(Hz); in proportion to thrust. Document S, table 2.4, fits 0.4 m/s^2 at
        /// 100 Hz in flight, which is a density of 0.04; the default is half of that.
        pub accelerometer_vibration_m_s2_sqrt_hz: f64 = 0.02, within(0.0, 1.0);
        /// White noise of the gyroscope that the propellers add at full thrust, rad/s/sqrt(Hz); in
        /// proportion to thrust. Document S, table 2.4: 0.005 rad/s at 100 Hz, a density of
        /// 5e-4; the default is half of that.
        pub gyroscope_vibration_rad_s_sqrt_hz: f64 = 2.5e-4, within(0.0, 1.0);
        /// Failures.
        pub failures: Vec<FailureConfig> = Vec::new(), nested();
    }
}

/// The errors of three axes of one kind.
#[derive(Clone, Debug)]
struct Triad {
    scale: Vector3<f64>,
    bias: Vector3<f64>,
    noise_density: f64,
    bias_walk: f64,
    vibration_density: f64,
    limit: f64,
}

impl Triad {
    /// A reading of `truth`, the mean over `interval_s` (document O, equations 2.11 and 2.12):
    /// `scale (truth + white noise) + bias`, cut off at the limit. The mean of white noise with
    /// density `s` over an interval `T` has standard deviation `s / sqrt(T)`; a walk with density
    /// `b` moves by `b sqrt(T)`.
    fn read(
        &mut self,
        truth: &Vector3<f64>,
        thrust_fraction: f64,
        interval_s: f64,
        noise: &mut Noise,
    ) -> Vector3<f64> {
        self.bias += noise.normal_vector() * self.bias_walk * interval_s.sqrt();
        let density = self
            .noise_density
            .hypot(self.vibration_density * thrust_fraction);
        let white = noise.normal_vector() * density / interval_s.sqrt();
        let reading = self.scale.component_mul(&(truth + white)) + self.bias;
        reading.map(|x| x.clamp(-self.limit, self.limit))
    }
}

/// The motion since the last sample. Rotations are multiplied, not added, so that the mean rate is
/// exact when the axis of rotation wanders (no coning error).
#[derive(Clone, Debug, Default)]
struct Mean {
    velocity_change: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    thrust: f64,
    duration_s: f64,
}

/// The simulated sensor.
#[derive(Clone, Debug)]
pub(super) struct Imu {
    channel: Channel<ImuSample>,
    noise: Noise,
    accelerometer: Triad,
    gyroscope: Triad,
    mean: Mean,
}

impl Imu {
    pub(super) fn new(model: &ImuModel, flight_seed: u64) -> Self {
        let mut noise = Noise::new(flight_seed, "imu");
        let mut bias = |given: Option<[f64; 3]>, sigma: f64| {
            let drawn = noise.normal_vector() * sigma;
            given.map_or(drawn, Vector3::from)
        };
        let accelerometer = Triad {
            scale: model.accelerometer_scale.into(),
            bias: bias(
                model.accelerometer_bias_m_s2,
                model.accelerometer_bias_sigma_m_s2,
            ),
            noise_density: model.accelerometer_noise_m_s2_sqrt_hz,
            bias_walk: model.accelerometer_bias_walk_m_s3_sqrt_hz,
            vibration_density: model.accelerometer_vibration_m_s2_sqrt_hz,
            limit: model.accelerometer_limit_m_s2,
        };
        let gyroscope = Triad {
            scale: model.gyroscope_scale.into(),
            bias: bias(model.gyroscope_bias_rad_s, model.gyroscope_bias_sigma_rad_s),
            noise_density: model.gyroscope_noise_rad_s_sqrt_hz,
            bias_walk: model.gyroscope_bias_walk_rad_s2_sqrt_hz,
            vibration_density: model.gyroscope_vibration_rad_s_sqrt_hz,
            limit: model.gyroscope_limit_rad_s,
        };
        Self {
            channel: Channel::new(
                model.rate_hz,
                model.latency_s,
                &model.failures,
                flight_seed,
                "imu",
            ),
            noise,
            accelerometer,
            gyroscope,
            mean: Mean::default(),
        }
    }

    pub(super) fn advance(&mut self, step: &Step) {
        let mut start = step.from.time;
        while self.channel.due() <= step.to.time {
            let due = self.channel.due();
            self.accumulate(step, start, due);
            let sample = self.sample(due);
            self.channel.send(sample);
            start = due;
        }
        self.accumulate(step, start, step.to.time);
    }

    pub(super) fn deliver(&mut self, now: Timestamp, received: &mut Vec<ImuSample>) {
        self.channel.deliver(now, received);
    }

    fn accumulate(&mut self, step: &Step, start: Timestamp, end: Timestamp) {
        let duration_s = step.piece(start, end).duration_s();
        self.mean.velocity_change += step.mean_specific_force() * duration_s;
        self.mean.rotation *= so3::exp(&(step.mean_angular_rate() * duration_s));
        self.mean.thrust += step.motors.thrust_fraction * duration_s;
        self.mean.duration_s += duration_s;
    }

    fn sample(&mut self, time: Timestamp) -> ImuSample {
        let mean = std::mem::take(&mut self.mean);
        let (interval_s, thrust) = (mean.duration_s, mean.thrust / mean.duration_s);
        let specific_force = mean.velocity_change / interval_s;
        let angular_rate = so3::log(&mean.rotation) / interval_s;
        let noise = &mut self.noise;
        ImuSample {
            time,
            specific_force: self
                .accelerometer
                .read(&specific_force, thrust, interval_s, noise),
            angular_rate: self
                .gyroscope
                .read(&angular_rate, thrust, interval_s, noise),
        }
    }
}
