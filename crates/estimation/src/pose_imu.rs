//! Inertial data and external poses (document O, sections 2.4.3 and 2.4.4).

use std::collections::VecDeque;

use alula_geometry::TimeDelta;
use alula_messages::{
    EstimateHealth, FlightMode, FlightPhase, Fusion, ImuSample, NavState, PoseSample, Rejection,
    Sensor, SensorBatch, Unobserved,
};
use alula_parameters::{ParameterError, Parameters, parameters};
use nalgebra::Vector3;

use crate::Estimator;
use crate::eskf::{ErrorVector, Filter, ImuNoise, Nominal};
use crate::estimator::TIED;
use crate::imu::{Contact, ImuLimits};
use crate::inertial_core::InertialCore;
use crate::measurement::{Measurement, OrientationMeasurement, PositionMeasurement};
use crate::pose_sensor::{PoseSensor, PoseSensorConfig};
use crate::watch::Watch;

/// Greatest time between the first pose and the inertial sample before it, s.
const START_TOLERANCE_S: f64 = 0.02;

parameters! {
    /// Inertial data and external poses, late and with losses.
    pub struct PoseImuConfig {
        /// Noise of the inertial unit.
        pub imu_noise: ImuNoise = ImuNoise::default(), nested();
        /// Plausibility of the inertial unit.
        pub imu_limits: ImuLimits = ImuLimits::default(), nested();
        /// Inertial samples that are kept for poses that come late.
        pub history_samples: usize = 250, within(10.0, 5000.0);
        /// Share of good measurements that pass the gate.
        pub gate_probability: f64 = 0.999, within(0.5, 0.999_999);
        /// The pose sensors by number, with their places in the body. If none is named there is one,
        /// which measures the pose of the body itself with the two standard deviations below.
        pub sensors: Vec<PoseSensorConfig> = Vec::new(), nested();
        /// Standard deviation of measured positions on each axis, m.
        pub position_sigma_m: f64 = 0.01, within(1e-5, 10.0);
        /// Standard deviation of measured orientations about each axis, rad.
        pub orientation_sigma_rad: f64 = 0.01, within(1e-5, 1.0);
        /// Standard deviation of the velocity at the first pose, m/s.
        pub start_velocity_sigma_m_s: f64 = 1.0, within(1e-3, 20.0);
        /// Standard deviation of the accelerometer's bias at the first pose, m/s^2.
        pub accelerometer_bias_sigma_m_s2: f64 = 0.2, within(1e-4, 5.0);
        /// Standard deviation of the gyroscope's bias at the first pose, rad/s.
        pub gyroscope_bias_sigma_rad_s: f64 = 0.1, within(1e-6, 0.5);
        /// Time without poses before the estimate is degraded, s.
        pub degraded_after_s: f64 = 0.5, within(0.05, 60.0);
        /// Time for which the gate may refuse all poses before the filter admits that it may
        /// itself be wrong, s.
        pub recovery_after_s: f64 = 1.0, within(0.1, 60.0);
        /// Standard deviations that it then adds: position (m), velocity (m/s), orientation (rad).
        pub recovery_sigma: [f64; 3] = [1.0, 1.0, 0.2], within(1e-3, 10.0);
    }
}

/// Integrates inertial data and corrects with poses at the time at which they were measured.
///
/// It starts at the first pose to which the inertial data reach back. Poses may come late, out of
/// order, with losses, and from several sensors in different places of the body. After inertial data were lost it starts again at the next pose, because
/// poses are absolute.
#[derive(Clone, Debug)]
pub struct PoseImu {
    config: PoseImuConfig,
    sensors: Vec<PoseSensor>,
    core: InertialCore,
    /// Inertial samples before the start, oldest first.
    early: VecDeque<ImuSample>,
    position_watch: Watch,
    orientation_watch: Watch,
}

impl PoseImu {
    /// An estimator that waits for the first pose.
    ///
    /// # Errors
    /// The first parameter that is not allowed.
    pub fn new(config: &PoseImuConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        let mut sensors: Vec<PoseSensor> = config.sensors.iter().map(PoseSensor::new).collect();
        if sensors.is_empty() {
            sensors.push(PoseSensor::of_body(
                config.position_sigma_m,
                config.orientation_sigma_rad,
            ));
        }
        Ok(Self {
            sensors,
            core: InertialCore::new(
                config.history_samples,
                config.imu_noise.clone(),
                config.imu_limits.clone(),
                config.gate_probability,
            ),
            early: VecDeque::with_capacity(config.history_samples + 1),
            position_watch: Watch::default(),
            orientation_watch: Watch::default(),
            config: config.clone(),
        })
    }

    fn take_inertial(&mut self, batch: &SensorBatch, mode: FlightMode) {
        if self.core.has_failed() && self.core.inertial_data_lost(batch.now) {
            self.core.forget();
            self.early.clear();
        }
        let contact = Contact::in_mode(mode);
        for sample in &batch.imu {
            let Some((sample, noise_scale)) = self.core.judge(sample, contact) else {
                continue;
            };
            if self.core.is_running() {
                self.core.push(&sample, noise_scale);
            } else {
                if self.early.len() == self.config.history_samples {
                    self.early.pop_front();
                }
                self.early.push_back(sample);
            }
        }
    }

    fn take_pose(&mut self, sample: &PoseSample, batch: &SensorBatch) {
        let Some(sensor) = self.sensors.get(usize::from(sample.sensor)).copied() else {
            self.core
                .reject(sample.time, Sensor::Position, Rejection::Invalid);
            return;
        };
        let pose = &sample.world_from_body;
        let finite = pose.translation.vector.iter().all(|x| x.is_finite())
            && pose.rotation.coords.iter().all(|x| x.is_finite());
        if !finite {
            self.core
                .reject(sample.time, Sensor::Position, Rejection::NotFinite);
        } else if (pose.rotation.norm() - 1.0).abs() > 1e-3 || sample.time > batch.now {
            self.core
                .reject(sample.time, Sensor::Position, Rejection::Invalid);
        } else if self.core.is_running() {
            self.submit(sample, &sensor);
        } else {
            self.start(sample, &sensor);
        }
    }

    fn submit(&mut self, sample: &PoseSample, sensor: &PoseSensor) {
        let pose = sensor.world_from_body(&sample.world_from_body);
        let position = PositionMeasurement {
            position_world: pose.translation.vector,
            sigma_m: sensor.position_sigma_m,
        };
        let orientation = OrientationMeasurement {
            world_from_body: pose.rotation,
            sigma_rad: sensor.orientation_sigma_rad,
        };
        let mut submit = |measurement| {
            self.core
                .submit_from(sample.sensor, sample.time, TimeDelta::ZERO, measurement);
        };
        submit(Measurement::Position(position));
        submit(Measurement::Orientation(orientation));
    }

    /// Starts at the last inertial sample before the pose and catches up with the present.
    fn start(&mut self, sample: &PoseSample, sensor: &PoseSensor) {
        let later = self.early.partition_point(|imu| imu.time <= sample.time);
        let before = later
            .checked_sub(1)
            .and_then(|i| self.early.get(i))
            .copied();
        let Some(first) =
            before.filter(|imu| sample.time.seconds_since(imu.time) <= START_TOLERANCE_S)
        else {
            self.core
                .reject(sample.time, Sensor::Position, Rejection::TooOld);
            return;
        };
        let filter = self.filter(sample, sensor);
        self.core.start(&first, filter);
        self.position_watch = Watch::since(sample.time);
        self.orientation_watch = Watch::since(sample.time);
        for imu in self.early.range(later..) {
            self.core.push(imu, 1.0);
        }
        self.early.clear();
    }

    fn filter(&self, sample: &PoseSample, sensor: &PoseSensor) -> Filter {
        let config = &self.config;
        let pose = sensor.world_from_body(&sample.world_from_body);
        let nominal = Nominal {
            position_world: pose.translation.vector,
            world_from_body: pose.rotation,
            ..Nominal::default()
        };
        let sigma = [
            sensor.position_sigma_m,
            config.start_velocity_sigma_m_s,
            sensor.orientation_sigma_rad,
            config.accelerometer_bias_sigma_m_s2,
            config.gyroscope_bias_sigma_rad_s,
        ];
        Filter::new(nominal, sigma.map(Vector3::repeat))
    }

    fn watch_fusions(&mut self) {
        for fusion in self.core.fusions() {
            match fusion.sensor {
                Sensor::Position => self.position_watch.note(fusion),
                Sensor::Orientation => self.orientation_watch.note(fusion),
                _ => {}
            }
        }
    }

    /// Adds uncertainty when all poses have contradicted the filter for long.
    fn recover(&mut self) {
        let Some(now) = self.core.latest_time() else {
            return;
        };
        let limit_s = self.config.recovery_after_s;
        let position_refused = self.position_watch.take_refusal(now, limit_s);
        let orientation_refused = self.orientation_watch.take_refusal(now, limit_s);
        if position_refused || orientation_refused {
            let parts = self.config.recovery_sigma;
            let sigma = ErrorVector::from_fn(|i, _| parts.get(i / 3).copied().unwrap_or(0.0));
            self.core
                .submit(now, TimeDelta::ZERO, Measurement::Inflation(sigma));
        }
    }

    fn health(&self) -> EstimateHealth {
        let now = self.core.latest_time().unwrap_or_default();
        let silent_s = self.position_watch.silent_s(now);
        if silent_s > self.config.degraded_after_s {
            EstimateHealth::Degraded {
                since_velocity_s: silent_s,
                since_height_s: silent_s,
            }
        } else {
            EstimateHealth::Good
        }
    }
}

impl Estimator for PoseImu {
    fn update(&mut self, batch: &SensorBatch, mode: FlightMode) {
        self.core.begin_update();
        self.take_inertial(batch, mode);
        for sample in &batch.poses {
            self.take_pose(sample, batch);
        }
        self.core.settle();
        self.core.check(batch.now);
        self.watch_fusions();
        self.recover();
        self.core.publish(phase(mode), self.health());
    }

    fn state(&self) -> &NavState {
        self.core.state()
    }

    fn fusions(&self) -> &[Fusion] {
        self.core.fusions()
    }

    fn unobserved(&self) -> Unobserved {
        let (Some(now), true) = (self.core.latest_time(), self.core.is_running()) else {
            return Unobserved::ALL;
        };
        let limit_s = self.config.degraded_after_s;
        let position = self.position_watch.silent_s(now) > limit_s;
        Unobserved {
            horizontal_position: position,
            height: position,
            velocity: position,
            yaw: self.orientation_watch.silent_s(now) > limit_s,
            level_accelerometer_bias: self.core.state().bias_is_tied_to_tilt(TIED),
        }
    }
}

/// External poses are as good at any height: the phase follows the mode alone.
fn phase(mode: FlightMode) -> FlightPhase {
    match mode {
        FlightMode::Disarmed | FlightMode::Armed => FlightPhase::Landed,
        FlightMode::TakingOff => FlightPhase::TakingOff,
        FlightMode::Landing => FlightPhase::Landing,
        FlightMode::Hovering | FlightMode::Flying | FlightMode::Killed => FlightPhase::Flying,
    }
}
