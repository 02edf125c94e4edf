//! Odometry from inertial data, flow and range (document S, sections 2.3 to 2.7 and 2.10.2).

mod config;
mod downward;
mod ground;

pub use config::{FlowCalibration, FlowOdometryConfig, GroundConfig, SensorSet, SonarConfig};

use alula_geometry::{TimeDelta, Timestamp};
use alula_messages::{
    EstimateHealth, FlightMode, FlightPhase, FlowSample, Fusion, NavState, Sensor, SensorBatch,
    Unobserved, error_index,
};
use alula_parameters::{ParameterError, Parameters};
use nalgebra::Vector3;

use crate::Estimator;
use crate::alignment::Alignment;
use crate::eskf::{ErrorVector, Nominal};
use crate::estimator::TIED;
use crate::imu::Contact;
use crate::inertial_core::InertialCore;
use crate::measurement::Measurement;
use crate::watch::{Watch, health, silence_limit_s};
use downward::Downward;
use ground::Standing;

/// Inertial data, corrected by flow and range in flight and by standing still on the ground; which
/// filter and which sensors is configured.
///
/// Height, velocity, roll and pitch are observed; horizontal position and heading drift. The ground
/// is taken to be the plane z = 0. The world frame begins where the vehicle stands when it is
/// aligned: at the configured start.
///
/// - Inertial samples that are implausible are replaced by the last good one for a short time;
///   after a longer loss the estimate has failed, and starts anew only on the ground.
/// - When the gate refuses a sensor for some seconds in flight, the filter adds uncertainty to
///   what the sensor sees, so that it can agree again. The health says `Degraded` meanwhile.
/// - After touch-down only velocity and angular rate are fused: the vehicle stays where it landed,
///   with the uncertainty of where that is.
#[derive(Clone, Debug)]
pub struct FlowOdometry {
    config: FlowOdometryConfig,
    downward: Downward,
    core: InertialCore,
    alignment: Alignment,
    standing: Standing,
    phase: FlightPhase,
    flow_watch: Watch,
    range_watch: Watch,
}

impl FlowOdometry {
    /// An odometry that waits for the vehicle to stand still.
    ///
    /// # Errors
    /// The first parameter that is not allowed.
    pub fn new(
        config: &FlowOdometryConfig,
        calibration: &FlowCalibration,
    ) -> Result<Self, ParameterError> {
        config.validate()?;
        calibration.validate()?;
        Ok(Self {
            downward: Downward::new(config, calibration),
            core: InertialCore::new(
                config.history_samples,
                config.imu_noise.clone(),
                config.imu_limits.clone(),
                config.gate_probability,
            ),
            alignment: Alignment::new(config.alignment.clone()),
            standing: Standing::new(&config.ground, &config.alignment),
            phase: FlightPhase::Landed,
            flow_watch: Watch::default(),
            range_watch: Watch::default(),
            config: config.clone(),
        })
    }

    fn take_inertial(&mut self, batch: &SensorBatch, mode: FlightMode) {
        if self.core.has_failed() && is_on_ground(mode) && self.core.inertial_data_lost(batch.now) {
            self.core.forget();
            self.alignment.reset();
        }
        let contact = Contact::in_mode(mode);
        for sample in &batch.imu {
            let Some((sample, noise_scale)) = self.core.judge(sample, contact) else {
                continue;
            };
            if self.core.is_running() {
                self.core.push(&sample, noise_scale);
                if self.phase == FlightPhase::Landed {
                    self.standing.add(&sample, &mut self.core);
                }
            } else if is_on_ground(mode) || !self.core.has_failed() {
                self.align(&sample);
            }
        }
    }

    fn align(&mut self, sample: &alula_messages::ImuSample) {
        let place = Vector3::from(self.config.alignment.start_position_m);
        let yaw_rad = self.config.alignment.start_yaw_rad();
        if let Some(filter) = self.alignment.add(sample, &place, yaw_rad) {
            self.core
                .start(sample, filter.in_variant(self.config.variant));
            self.standing.start(sample.time);
            self.downward.clear();
            self.flow_watch = Watch::since(sample.time);
            self.range_watch = Watch::since(sample.time);
        }
    }

    fn take_flow(&mut self, sample: &FlowSample, now: Timestamp) {
        let state = self.airborne_state();
        let half_interval = TimeDelta::from_s(0.5 * sample.interval_s);
        match self.downward.flow(sample, now, state.as_ref()) {
            Ok(measurement) => self.core.submit(sample.time, half_interval, measurement),
            Err(reason) => self.core.reject(sample.time, Sensor::Flow, reason),
        }
    }

    fn take_ranges(&mut self, batch: &SensorBatch) {
        let state = self.airborne_state();
        let sensor = self.downward.height_sensor();
        let samples = match sensor {
            Sensor::Sonar => &batch.sonar,
            _ => &batch.infrared,
        };
        for sample in samples {
            let read = match sensor {
                Sensor::Sonar => self.downward.sonar(sample, batch.now, state.as_ref()),
                _ => self.downward.infrared(sample, batch.now, state.as_ref()),
            };
            match read {
                Ok(measurement) => self.core.submit(sample.time, TimeDelta::ZERO, measurement),
                Err(reason) => self.core.reject(sample.time, sensor, reason),
            }
        }
    }

    /// On the ground, or without a filter, the downward sensors say nothing.
    fn airborne_state(&self) -> Option<Nominal> {
        let airborne = self.phase != FlightPhase::Landed && self.core.is_running();
        self.core.nominal().copied().filter(|_| airborne)
    }

    fn watch_fusions(&mut self) {
        for fusion in self.core.fusions() {
            match fusion.sensor {
                Sensor::Flow => self.flow_watch.note(fusion),
                Sensor::Infrared | Sensor::Sonar => self.range_watch.note(fusion),
                Sensor::Ground if fusion.accepted() => {
                    self.flow_watch.note(fusion);
                    self.range_watch.note(fusion);
                }
                _ => {}
            }
        }
    }

    /// Adds uncertainty where a sensor has contradicted the filter for long.
    fn recover(&mut self) {
        let (Some(now), FlightPhase::Flying) = (self.core.latest_time(), self.phase) else {
            return;
        };
        let mut sigma = ErrorVector::zeros();
        let limit_s = self.config.recovery_after_s;
        if self.flow_watch.take_refusal(now, limit_s) {
            sigma
                .fixed_rows_mut::<3>(error_index::VELOCITY)
                .fill(self.config.recovery_velocity_sigma_m_s);
        }
        if self.range_watch.take_refusal(now, limit_s) {
            sigma[error_index::POSITION + 2] = self.config.recovery_height_sigma_m;
        }
        if sigma != ErrorVector::zeros() {
            self.core
                .submit(now, TimeDelta::ZERO, Measurement::Inflation(sigma));
        }
    }

    fn health(&self) -> EstimateHealth {
        let now = self.core.latest_time().unwrap_or_default();
        let (in_flight_s, near_ground_s) = (
            self.config.degraded_after_s,
            self.config.degraded_after_near_ground_s,
        );
        let limit_s = silence_limit_s(self.phase, in_flight_s, near_ground_s);
        health(&self.flow_watch, &self.range_watch, now, limit_s)
    }
}

impl Estimator for FlowOdometry {
    fn update(&mut self, batch: &SensorBatch, mode: FlightMode) {
        self.core.begin_update();
        let height_m = self.core.state().position_world().z;
        self.phase = next_phase(self.phase, mode, height_m, self.config.flow_min_distance_m);
        if self.phase != FlightPhase::Landed {
            self.standing.leave();
        }
        self.take_inertial(batch, mode);
        self.take_ranges(batch);
        for sample in &batch.flow {
            self.take_flow(sample, batch.now);
        }
        self.core.settle();
        self.core.check(batch.now);
        self.watch_fusions();
        self.recover();
        self.core.publish(self.phase, self.health());
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
        let landed = self.phase == FlightPhase::Landed;
        Unobserved {
            horizontal_position: !landed,
            height: self.range_watch.silent_s(now) > limit_s,
            velocity: self.flow_watch.silent_s(now) > limit_s,
            yaw: !landed,
            level_accelerometer_bias: self.core.state().bias_is_tied_to_tilt(TIED),
        }
    }
}

pub(crate) fn is_on_ground(mode: FlightMode) -> bool {
    matches!(mode, FlightMode::Disarmed | FlightMode::Armed)
}

/// The phase that follows from the mode of flight and the height above the ground (document S,
/// section 2.10.2): landed, taking off, flying, landing are its phases A, B, C, D.
pub(crate) fn next_phase(
    phase: FlightPhase,
    mode: FlightMode,
    height_m: f64,
    low_m: f64,
) -> FlightPhase {
    let low = height_m < low_m;
    match mode {
        FlightMode::Disarmed | FlightMode::Armed => FlightPhase::Landed,
        FlightMode::TakingOff if low => FlightPhase::TakingOff,
        FlightMode::Landing if low => FlightPhase::Landing,
        FlightMode::Hovering | FlightMode::Flying
            if low && matches!(phase, FlightPhase::Landed | FlightPhase::TakingOff) =>
        {
            FlightPhase::TakingOff
        }
        FlightMode::TakingOff | FlightMode::Landing | FlightMode::Hovering | FlightMode::Flying => {
            FlightPhase::Flying
        }
        FlightMode::Killed => phase,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check_phases(modes: &[(FlightMode, f64)], expected: &[FlightPhase]) {
        let mut phase = FlightPhase::Landed;
        for ((mode, height_m), expected) in modes.iter().zip(expected) {
            phase = next_phase(phase, *mode, *height_m, 0.3);
            assert_eq!(phase, *expected);
        }
    }

    #[test]
    fn a_flight_passes_through_all_phases() {
        check_phases(
            &[
                (FlightMode::Armed, 0.1),
                (FlightMode::TakingOff, 0.1),
                (FlightMode::TakingOff, 0.5),
                (FlightMode::Flying, 1.0),
                (FlightMode::Landing, 0.8),
                (FlightMode::Landing, 0.2),
                (FlightMode::Disarmed, 0.1),
            ],
            &[
                FlightPhase::Landed,
                FlightPhase::TakingOff,
                FlightPhase::Flying,
                FlightPhase::Flying,
                FlightPhase::Flying,
                FlightPhase::Landing,
                FlightPhase::Landed,
            ],
        );
    }

    #[test]
    fn killed_motors_in_the_air_do_not_count_as_landed() {
        check_phases(
            &[(FlightMode::Flying, 1.0), (FlightMode::Killed, 1.0)],
            &[FlightPhase::Flying, FlightPhase::Flying],
        );
    }
}
