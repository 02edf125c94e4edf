//! What every inertial estimator does: judge inertial samples, wait until the inertial data reach a
//! measurement's time, keep the history, and publish the state.

use std::collections::VecDeque;

use alula_geometry::{Pose, TimeDelta, Timestamp};
use alula_messages::{EstimateHealth, FlightPhase, Fusion, ImuSample, NavState, Rejection, Sensor};
use nalgebra::{Translation3, Vector3};

use crate::eskf::{Filter, ImuNoise, InertialInput, Nominal};
use crate::history::History;
use crate::imu::{Contact, ImuLimits, ImuMonitor};
use crate::measurement::{Gates, Measurement, rejected};

/// Measurements that can wait for inertial data.
const WAITING_CAPACITY: usize = 256;

/// Fusions of one update; more than fit into any batch of a real vehicle.
pub(crate) const FUSIONS_CAPACITY: usize = 1024;

/// Greatest standard deviation of the velocity on an axis, m/s: with more, the estimate cannot
/// stop a small vehicle in a room.
pub(crate) const MAX_VELOCITY_SIGMA_M_S: f64 = 5.0;

#[derive(Clone, Copy, Debug)]
struct Waiting {
    source: u8,
    time: Timestamp,
    ready_at: Timestamp,
    measurement: Measurement,
}

/// The common core.
#[derive(Clone, Debug)]
pub struct InertialCore {
    monitor: ImuMonitor,
    history: History,
    waiting: VecDeque<Waiting>,
    fusions: Vec<Fusion>,
    state: NavState,
    running: bool,
}

impl InertialCore {
    pub fn new(samples: usize, noise: ImuNoise, limits: ImuLimits, gate_probability: f64) -> Self {
        Self {
            monitor: ImuMonitor::new(limits),
            history: History::new(samples, noise, Gates::new(gate_probability)),
            waiting: VecDeque::with_capacity(WAITING_CAPACITY),
            fusions: Vec::with_capacity(FUSIONS_CAPACITY),
            state: NavState::default(),
            running: false,
        }
    }

    pub fn state(&self) -> &NavState {
        &self.state
    }

    pub fn fusions(&self) -> &[Fusion] {
        &self.fusions
    }

    /// Whether there is a filter.
    pub fn is_running(&self) -> bool {
        self.running
    }

    pub fn has_failed(&self) -> bool {
        self.state.health == EstimateHealth::Failed
    }

    pub fn begin_update(&mut self) {
        self.fusions.clear();
    }

    /// Judges a sample and tells if it was not plainly used; `None` if it must be left out. The
    /// factor is that on its noise.
    pub fn judge(&mut self, sample: &ImuSample, contact: Contact) -> Option<(ImuSample, f64)> {
        // A gap beyond the limit must not be bridged by the sample that ends it.
        if self.running && self.monitor.is_lost(sample.time) {
            self.fail();
        }
        let (admitted, reason) = self.monitor.admit(sample, contact);
        if let Some(reason) = reason {
            self.reject(sample.time, Sensor::Imu, reason);
        }
        admitted
    }

    /// Starts a filter that is valid at the time of `sample`.
    pub fn start(&mut self, sample: &ImuSample, filter: Filter) {
        let input = InertialInput::steady(sample.specific_force, sample.angular_rate);
        self.waiting.clear();
        self.history.start(sample.time, input, filter);
        self.running = true;
        self.state.health = EstimateHealth::Good;
    }

    /// Adds a judged sample to the history.
    pub fn push(&mut self, sample: &ImuSample, noise_scale: f64) {
        let fusions = &mut self.fusions;
        self.history
            .push(sample, noise_scale, &mut |fusion| fusions.push(fusion));
    }

    /// Records that a measurement was not used.
    pub fn reject(&mut self, time: Timestamp, sensor: Sensor, reason: Rejection) {
        self.fusions.push(rejected(time, sensor, reason));
    }

    /// Takes a measurement, to be fused once inertial data reach `time` + `lag`.
    pub fn submit(&mut self, time: Timestamp, lag: TimeDelta, measurement: Measurement) {
        self.submit_from(0, time, lag, measurement);
    }

    /// The same for the sensor number `source` of several of a kind.
    pub fn submit_from(
        &mut self,
        source: u8,
        time: Timestamp,
        lag: TimeDelta,
        measurement: Measurement,
    ) {
        if self.waiting.len() == WAITING_CAPACITY
            && let Some(oldest) = self.waiting.pop_front()
        {
            self.reject_waiting(&oldest, Rejection::TooOld);
        }
        self.waiting.push_back(Waiting {
            source,
            time,
            ready_at: time + lag,
            measurement,
        });
    }

    /// The best estimate as of the last settling.
    pub fn nominal(&self) -> Option<&Nominal> {
        self.history.latest().map(|(filter, _)| &filter.nominal)
    }

    /// Time of the last inertial sample in the history.
    pub fn latest_time(&self) -> Option<Timestamp> {
        self.history.latest_time()
    }

    pub fn mean_angular_rate(&self, from: Timestamp, to: Timestamp) -> Option<Vector3<f64>> {
        self.history.mean_angular_rate(from, to)
    }

    /// Hands over what is ready and brings the history up to date.
    pub fn settle(&mut self) {
        if let Some(latest) = self.history.latest_time() {
            for _ in 0..self.waiting.len() {
                let Some(waiting) = self.waiting.pop_front() else {
                    break;
                };
                if waiting.ready_at <= latest {
                    self.hand_over(waiting);
                } else {
                    self.waiting.push_back(waiting);
                }
            }
        }
        let fusions = &mut self.fusions;
        self.history.settle(&mut |fusion| fusions.push(fusion));
    }

    fn hand_over(&mut self, mut waiting: Waiting) {
        if let Some((interval_s, angular_rate)) = waiting.measurement.angular_rate_mut() {
            let half = TimeDelta::from_s(0.5 * interval_s);
            if let Some(rate) = self
                .history
                .mean_angular_rate(waiting.time - half, waiting.time + half)
            {
                *angular_rate = rate;
            }
        }
        let Waiting { source, time, .. } = waiting;
        if let Err(reason) = self.history.insert_from(source, time, waiting.measurement) {
            self.reject_waiting(&waiting, reason);
        }
    }

    fn reject_waiting(&mut self, waiting: &Waiting, reason: Rejection) {
        if let Some(sensor) = waiting.measurement.sensor() {
            self.reject(waiting.time, sensor, reason);
        }
    }

    /// Fails if the inertial data stopped or the filter diverged.
    pub fn check(&mut self, now: Timestamp) {
        let diverged = self.history.latest().is_some_and(|(filter, _)| {
            let uncertain = MAX_VELOCITY_SIGMA_M_S * MAX_VELOCITY_SIGMA_M_S;
            !filter.is_finite() || filter.velocity_variance().max() > uncertain
        });
        if self.running && (diverged || self.monitor.is_lost(now)) {
            self.fail();
        }
    }

    fn fail(&mut self) {
        self.running = false;
        self.state.health = EstimateHealth::Failed;
        self.waiting.clear();
    }

    /// Makes ready for a new start after a failure, or for a clock that was set back.
    pub fn forget(&mut self) {
        self.monitor.reset();
    }

    /// Whether the clock or the inertial data are lost as of `now`.
    pub fn inertial_data_lost(&self, now: Timestamp) -> bool {
        self.monitor.is_lost(now)
    }

    /// Brings the published state up to date.
    pub fn publish(&mut self, phase: FlightPhase, health: EstimateHealth) {
        self.state.phase = phase;
        if !self.running {
            return;
        }
        self.state.health = health;
        let (Some((filter, input)), Some(time)) =
            (self.history.latest(), self.history.latest_time())
        else {
            return;
        };
        let nominal = &filter.nominal;
        self.state.time = time;
        self.state.world_from_body = Pose::from_parts(
            Translation3::from(nominal.position_world),
            nominal.world_from_body,
        );
        self.state.velocity_world = nominal.velocity_world;
        self.state.angular_rate_body = input.angular_rate - nominal.gyroscope_bias;
        self.state.acceleration_world = nominal.acceleration_world(input);
        self.state.accelerometer_bias = nominal.accelerometer_bias;
        self.state.gyroscope_bias = nominal.gyroscope_bias;
        self.state.covariance = filter.covariance();
    }
}
