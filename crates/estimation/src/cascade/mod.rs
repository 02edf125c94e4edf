//! The cascade velocity estimator of document O, section 2.5: a complementary filter for attitude,
//! whose result turns the inertial data into the world for a linear Kalman filter of velocity and
//! height. Derivation: `docs/derivations/cascade-velocity-estimator.md`.

mod config;
mod downward;
mod kalman;
mod past;
mod publish;
mod sight;

pub use config::{CascadeConfig, Ranger};

use alula_geometry::{Pose, Timestamp, so3};
use alula_messages::{
    EstimateHealth, FlightMode, FlightPhase, Fusion, ImuSample, NavState, Rejection, Sensor,
    SensorBatch, Unobserved,
};
use alula_parameters::{ParameterError, Parameters};
use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};

use crate::alignment::Alignment;
use crate::complementary::Complementary;
use crate::flow_odometry::{is_on_ground, next_phase};
use crate::imu::{Contact, ImuMonitor};
use crate::inertial_core::{FUSIONS_CAPACITY, MAX_VELOCITY_SIGMA_M_S};
use crate::measurement::{Gates, rejected};
use crate::watch::{Repetition, Watch, health, silence_limit_s};
use crate::{Estimator, FlowCalibration};
use kalman::{Biases, HEIGHT, Push, Seen, VELOCITY, VelocityFilter};
use past::{Moment, Past};
use publish::Drift;

/// Standard deviation of the velocity at the start, m/s.
const START_VELOCITY_SIGMA_M_S: f64 = 0.01;

/// Complementary attitude filter, then a linear Kalman filter for velocity and height.
///
/// Velocity, height, roll and pitch are observed. Horizontal position is the integral of velocity
/// and heading that of the gyroscope: both drift, and their variances say how far at most. The
/// accelerometer's bias is estimated on the ground and frozen at lift-off. Measurements that come
/// late are held against what was believed at their own time. The ground is the plane z = 0.
///
/// After a loss of the inertial data the estimate has failed; it starts anew on the ground.
#[derive(Clone, Debug)]
pub struct Cascade {
    config: CascadeConfig,
    body_from_camera: Pose,
    body_from_ranger: Pose,
    gates: Gates,
    monitor: ImuMonitor,
    alignment: Alignment,
    attitude: Complementary,
    velocity: VelocityFilter,
    past: Past,
    drift: Drift,
    push: Push,
    phase: FlightPhase,
    ground_since: Timestamp,
    flow_watch: Watch,
    range_watch: Watch,
    flow_repetition: Repetition,
    range_repetition: Repetition,
    flow_last: Option<Timestamp>,
    range_last: Option<Timestamp>,
    fusions: Vec<Fusion>,
    state: NavState,
    running: bool,
}

impl Cascade {
    /// An estimator that waits for the vehicle to stand still.
    ///
    /// # Errors
    /// The first parameter that is not allowed.
    pub fn new(
        config: &CascadeConfig,
        calibration: &FlowCalibration,
    ) -> Result<Self, ParameterError> {
        config.validate()?;
        calibration.validate()?;
        let body_from_camera = calibration.flow_camera.body_from_sensor();
        let attitude = Complementary::new(
            &config.attitude,
            UnitQuaternion::identity(),
            Vector3::zeros(),
        )
        .map_err(|error| error.under("attitude"))?;
        Ok(Self {
            body_from_camera,
            body_from_ranger: match config.ranger {
                Ranger::Infrared => calibration.infrared.body_from_sensor(),
                Ranger::Sonar => body_from_camera,
            },
            gates: Gates::new(config.gate_probability),
            monitor: ImuMonitor::new(config.imu_limits.clone()),
            alignment: Alignment::new(config.alignment.clone()),
            attitude,
            velocity: VelocityFilter::at_rest(0.0, [0.0; 3]),
            past: Past::new(config.history_samples),
            drift: Drift::default(),
            push: Push::level(),
            phase: FlightPhase::Landed,
            ground_since: Timestamp::ZERO,
            flow_watch: Watch::default(),
            range_watch: Watch::default(),
            flow_repetition: Repetition::default(),
            range_repetition: Repetition::default(),
            flow_last: None,
            range_last: None,
            fusions: Vec::with_capacity(FUSIONS_CAPACITY),
            state: NavState::default(),
            running: false,
            config: config.clone(),
        })
    }

    fn take_inertial(&mut self, batch: &SensorBatch, mode: FlightMode) {
        let failed = self.state.health == EstimateHealth::Failed;
        if failed && is_on_ground(mode) && self.monitor.is_lost(batch.now) {
            self.monitor.reset();
            self.alignment.reset();
        }
        for sample in &batch.imu {
            // A gap beyond the limit must not be bridged by the sample that ends it.
            if self.running && self.monitor.is_lost(sample.time) {
                self.fail();
            }
            let Some((sample, noise_scale)) = self.judge(sample, Contact::in_mode(mode)) else {
                continue;
            };
            if self.running {
                self.propagate(&sample, noise_scale);
            } else if is_on_ground(mode) || self.state.health != EstimateHealth::Failed {
                self.align(&sample);
            }
        }
    }

    /// The sample to use, with the factor on its noise.
    fn judge(&mut self, sample: &ImuSample, contact: Contact) -> Option<(ImuSample, f64)> {
        let (admitted, reason) = self.monitor.admit(sample, contact);
        if let Some(reason) = reason {
            self.reject(sample.time, Sensor::Imu, reason);
        }
        admitted
    }

    fn align(&mut self, sample: &ImuSample) {
        let start = &self.config.alignment;
        let place = Vector3::from(start.start_position_m);
        let Some(found) = self.alignment.add(sample, &place, start.start_yaw_rad()) else {
            return;
        };
        let nominal = &found.nominal;
        let yaw_sigma_rad = start.start_yaw_sigma_deg.to_radians();
        self.attitude.restart(
            nominal.world_from_body,
            nominal.gyroscope_bias,
            yaw_sigma_rad,
        );
        let sigma = [
            START_VELOCITY_SIGMA_M_S,
            start.start_height_sigma_m,
            start.accelerometer_bias_sigma_m_s2,
        ];
        self.velocity = VelocityFilter::at_rest(place.z, sigma);
        self.drift = Drift::at(place.xy(), start.start_position_sigma_m);
        self.past.clear();
        self.remember(sample);
        self.ground_since = sample.time;
        self.flow_watch = Watch::since(sample.time);
        self.range_watch = Watch::since(sample.time);
        self.running = true;
    }

    /// Attitude first, then what it turns into the world (document O, figure 2.16).
    fn propagate(&mut self, sample: &ImuSample, noise_scale: f64) {
        let Some(last) = self.past.latest().copied() else {
            return;
        };
        let dt_s = sample.time.seconds_since(last.time);
        let (force, rate) = (&sample.specific_force, &sample.angular_rate);
        if self.phase == FlightPhase::Landed {
            self.attitude.rest(force, rate, dt_s);
        } else {
            self.attitude.update(force, rate, dt_s);
        }
        self.push = self.push_of(sample, &last, noise_scale);
        let walk = self.config.imu_noise.accelerometer_bias_walk_m_s3_sqrt_hz;
        self.velocity.propagate(&self.push, walk, dt_s);
        if self.phase != FlightPhase::Landed {
            let yaw_sigma_rad = self.attitude.yaw_sigma_rad();
            self.drift.pass(&self.velocity, yaw_sigma_rad, dt_s);
        }
        self.remember(sample);
        if self.phase == FlightPhase::Landed {
            self.stand(sample.time);
        }
    }

    fn push_of(&self, sample: &ImuSample, last: &Moment, noise_scale: f64) -> Push {
        let turn = so3::log(&(last.world_from_body.inverse() * self.attitude.world_from_body()));
        let middle = last.world_from_body * so3::exp(&(turn * 0.5));
        let white = self.config.imu_noise.accelerometer_noise_m_s2_sqrt_hz * noise_scale;
        Push {
            rotation: middle.to_rotation_matrix().into_inner(),
            force: sample.specific_force,
            noise: white.hypot(self.config.acceleration_noise_m_s2_sqrt_hz),
            tilt_sigma_rad: self.attitude.tilt_sigma_rad(),
            unseen_s: self.flow_watch.silent_s(sample.time),
        }
    }

    fn remember(&mut self, sample: &ImuSample) {
        self.past.push(Moment {
            time: sample.time,
            world_from_body: *self.attitude.world_from_body(),
            angular_rate: sample.angular_rate,
            velocity_world: self.velocity.velocity_world,
            height_m: self.velocity.height_m,
        });
    }

    /// On the ground the velocity is zero and the height that of the start (document O, section
    /// 2.5.2).
    fn stand(&mut self, now: Timestamp) {
        // The stamps of a regular sensor jitter by less than a hundredth of the period.
        if now.seconds_since(self.ground_since) < 0.99 / self.config.ground_rate_hz {
            return;
        }
        self.ground_since = now;
        let sigma = self.config.ground_velocity_sigma_m_s;
        let mut jacobian = SMatrix::<f64, 3, 7>::zeros();
        jacobian
            .fixed_columns_mut::<3>(VELOCITY)
            .fill_with_identity();
        let still = Seen {
            innovation: -self.velocity.velocity_world,
            jacobian,
            variance: Vector3::repeat(sigma * sigma),
        };
        self.fuse(now, Sensor::Ground, &still);
        let start = &self.config.alignment;
        let mut jacobian = SMatrix::<f64, 1, 7>::zeros();
        jacobian[HEIGHT] = 1.0;
        let low = Seen {
            innovation: SVector::from([start.start_position_m[2] - self.velocity.height_m]),
            jacobian,
            variance: SVector::from([start.start_height_sigma_m.powi(2)]),
        };
        self.fuse(now, Sensor::Ground, &low);
    }

    fn fuse<const M: usize>(&mut self, time: Timestamp, sensor: Sensor, seen: &Seen<M>) {
        let gate = self.gates.threshold(M);
        let biases = match self.phase {
            FlightPhase::Landed => Biases::Estimated,
            _ => Biases::Frozen,
        };
        let outcome = self.velocity.fuse(seen, gate, biases);
        let mut fusion = rejected(time, sensor, Rejection::Gate);
        fusion.gate = gate;
        fusion.mahalanobis_squared = outcome.mahalanobis_squared;
        for i in 0..M {
            fusion.innovation[i] = seen.innovation[i];
            fusion.innovation_variance[i] = outcome.innovation_variance[i];
        }
        if let Some(correction) = outcome.correction {
            self.past.correct(&correction);
            fusion.rejection = None;
        }
        self.watch(&fusion);
        self.fusions.push(fusion);
    }

    fn reject(&mut self, time: Timestamp, sensor: Sensor, reason: Rejection) {
        self.fusions.push(rejected(time, sensor, reason));
    }

    fn watch(&mut self, fusion: &Fusion) {
        match fusion.sensor {
            Sensor::Flow => self.flow_watch.note(fusion),
            Sensor::Infrared | Sensor::Sonar => self.range_watch.note(fusion),
            Sensor::Ground => {
                self.flow_watch.note(fusion);
                self.range_watch.note(fusion);
            }
            _ => {}
        }
    }

    /// Adds uncertainty where a sensor has contradicted the filter for long.
    fn recover(&mut self) {
        let Some(now) = self.past.latest().map(|m| m.time) else {
            return;
        };
        let limit_s = self.config.recovery_after_s;
        if self.flow_watch.take_refusal(now, limit_s) {
            let sigma = self.config.recovery_velocity_sigma_m_s;
            self.velocity.inflate(sigma, 0.0);
        }
        if self.range_watch.take_refusal(now, limit_s) {
            let sigma = self.config.recovery_height_sigma_m;
            self.velocity.inflate(0.0, sigma);
        }
    }

    /// Fails if the inertial data stopped or the filter diverged.
    fn check(&mut self, now: Timestamp) {
        let limit = MAX_VELOCITY_SIGMA_M_S * MAX_VELOCITY_SIGMA_M_S;
        let unusable = (VELOCITY..HEIGHT).any(|i| self.velocity.covariance[(i, i)] > limit);
        let diverged = !self.velocity.is_finite() || unusable;
        if self.running && (diverged || self.monitor.is_lost(now)) {
            self.fail();
        }
    }

    fn fail(&mut self) {
        self.running = false;
        self.state.health = EstimateHealth::Failed;
    }

    fn health(&self) -> EstimateHealth {
        let now = self.past.latest().map_or(Timestamp::ZERO, |m| m.time);
        let (in_flight_s, near_ground_s) = (
            self.config.degraded_after_s,
            self.config.degraded_after_near_ground_s,
        );
        let limit_s = silence_limit_s(self.phase, in_flight_s, near_ground_s);
        health(&self.flow_watch, &self.range_watch, now, limit_s)
    }
}

impl Estimator for Cascade {
    fn update(&mut self, batch: &SensorBatch, mode: FlightMode) {
        self.fusions.clear();
        let low_m = self.config.flow_min_distance_m;
        self.phase = next_phase(self.phase, mode, self.velocity.height_m, low_m);
        self.take_inertial(batch, mode);
        for sample in &batch.flow {
            self.take_flow(sample, batch.now);
        }
        let ranges = match self.config.ranger {
            Ranger::Infrared => &batch.infrared,
            Ranger::Sonar => &batch.sonar,
        };
        for sample in ranges {
            self.take_range(sample, batch.now);
        }
        self.recover();
        self.check(batch.now);
        self.publish();
    }

    fn state(&self) -> &NavState {
        &self.state
    }

    fn fusions(&self) -> &[Fusion] {
        &self.fusions
    }

    fn unobserved(&self) -> Unobserved {
        let (Some(latest), true) = (self.past.latest(), self.running) else {
            return Unobserved::ALL;
        };
        let limit_s = self.config.degraded_after_s;
        let landed = self.phase == FlightPhase::Landed;
        Unobserved {
            horizontal_position: !landed,
            height: self.range_watch.silent_s(latest.time) > limit_s,
            velocity: self.flow_watch.silent_s(latest.time) > limit_s,
            yaw: !landed,
            // On the ground it is tied to the tilt, in flight it is frozen.
            level_accelerometer_bias: true,
        }
    }
}
