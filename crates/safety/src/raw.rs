//! The guard's own record of the motion, from raw data alone: coarse, simple, independent.

use alula_geometry::{GRAVITY_M_S2, Timestamp, so3};
use alula_messages::{FlowSample, ImuSample, MAX_DEPTH_CAMERAS, RangeSample, SensorBatch};
use nalgebra::{Vector2, Vector3};

use crate::config::{DescentConfig, SensorLimits};

/// Longest time over which one inertial sample is believed to last, s.
const MAX_STEP_S: f64 = 0.05;
/// Time constants of the vertical: standing, and flying, where specific force shows the thrust, s.
const VERTICAL_GROUND_S: f64 = 0.5;
const VERTICAL_FLIGHT_S: f64 = 20.0;
/// The vertical is corrected in flight only by specific forces this close to gravity, m/s^2.
const QUIET_M_S2: f64 = 1.0;
/// Time constant of the gyroscope's bias while standing, s.
const BIAS_S: f64 = 1.0;
/// Angular rates up to this one are bias while standing, rad/s.
const BIAS_LIMIT_RAD_S: f64 = 0.2;
/// Natural frequency of the observer of height and vertical speed, critically damped, rad/s.
const OBSERVER_RAD_S: f64 = 2.0;
/// A range this far from the observed height is a step of the ground, not a motion, m.
const STEP_M: f64 = 0.5;
/// A range counts as present for this long, s.
const RANGE_FRESH_S: f64 = 0.3;
/// Least cosine of the tilt with which a range gives a height.
const MIN_COSINE: f64 = 0.5;
/// Time constant of velocity by flow, s.
const FLOW_S: f64 = 0.3;
/// Time constant of the share of inertial samples that jump, s.
const JUMPS_S: f64 = 0.1;
/// From this share of jumps on nothing is founded on inertial data any more.
const DOUBTED_JUMPS: f64 = 0.2;
/// Time constant of the specific force along the body's z axis, s.
const LIFT_S: f64 = 0.1;

/// One ranger.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ranger {
    /// Latest reading of any kind.
    pub(crate) arrived: Option<Timestamp>,
    /// Latest valid reading.
    pub(crate) valid: Option<Timestamp>,
    /// Since when the reading is the same to the last bit.
    pub(crate) same_since: Option<Timestamp>,
    range_m: f64,
}

impl Ranger {
    fn take(&mut self, sample: &RangeSample) {
        if sample.range_m.to_bits() != self.range_m.to_bits() || self.same_since.is_none() {
            self.same_since = Some(sample.time);
        }
        self.arrived = Some(sample.time);
        self.range_m = sample.range_m;
        if sample.is_valid() {
            self.valid = Some(sample.time);
        }
    }

    /// How long the reading has been the same, s.
    pub(crate) fn same_s(&self) -> f64 {
        match (self.arrived, self.same_since) {
            (Some(arrived), Some(since)) => arrived.seconds_since(since),
            _ => 0.0,
        }
    }
}

/// Whether an image holds enough returns to show an obstacle: a covered or dead camera gives none.
fn shows_anything(depth_mm: &[u16]) -> bool {
    /// Every so many pixels are looked at; coprime to common widths, so that all columns are met.
    const STRIDE: usize = 97;
    /// Least share of them with a return.
    const SHARE: f64 = 0.02;
    let looked = depth_mm.iter().step_by(STRIDE);
    let count = looked.len();
    let returns = looked.filter(|mm| !matches!(**mm, 0 | u16::MAX));
    returns.count() as f64 > SHARE * count as f64
}

/// What came from one depth camera.
#[derive(Clone, Copy, Debug, Default)]
struct DepthCamera {
    /// Latest image that shows anything.
    newest: Option<Timestamp>,
    /// What the last image shows, to tell a camera that is stuck.
    fingerprint: Option<u64>,
}

/// What raw data say about the motion.
#[derive(Clone, Debug)]
pub(crate) struct RawMotion {
    limits: SensorLimits,
    forget_s: f64,
    now: Timestamp,
    /// Latest usable inertial sample.
    pub(crate) imu: Option<Timestamp>,
    /// The last inertial numbers: a sensor that repeats them to the last bit is stuck.
    imu_numbers: Option<(Vector3<f64>, Vector3<f64>)>,
    imu_arrived: Option<Timestamp>,
    /// Share of inertial samples that jump, low-passed.
    jumps: f64,
    /// Angular rate, bias removed, body, rad/s.
    rate_body: Vector3<f64>,
    bias_body: Vector3<f64>,
    /// World's up, seen from the body.
    pub(crate) up_body: Vector3<f64>,
    /// Specific force along the body's z axis, low-passed, m/s^2.
    pub(crate) lift_m_s2: f64,
    /// Vertical speed, m/s, and height above the ground below, m.
    pub(crate) climb_m_s: f64,
    pub(crate) height_m: f64,
    pub(crate) sonar: Ranger,
    pub(crate) infrared: Ranger,
    /// Slant distance of the latest valid range that is not stuck, m, and its time.
    slant: Option<(Timestamp, f64)>,
    /// What the height was on the ground, m.
    pub(crate) landed_height_m: f64,
    /// Latest flow sample of any kind, and latest usable one.
    pub(crate) flow_arrived: Option<Timestamp>,
    /// What came from each depth camera.
    depth: [DepthCamera; MAX_DEPTH_CAMERAS],
    pub(crate) flow: Option<Timestamp>,
    /// Horizontal velocity by flow less the estimate's, body, low-passed, m/s.
    pub(crate) flow_gap_m_s: Vector2<f64>,
}

impl RawMotion {
    pub(crate) fn new(limits: &SensorLimits, descent: &DescentConfig) -> Self {
        Self {
            limits: limits.clone(),
            forget_s: descent.forget_s,
            now: Timestamp::ZERO,
            imu: None,
            imu_numbers: None,
            imu_arrived: None,
            jumps: 0.0,
            rate_body: Vector3::zeros(),
            bias_body: Vector3::zeros(),
            up_body: Vector3::z(),
            lift_m_s2: GRAVITY_M_S2,
            climb_m_s: 0.0,
            height_m: 0.0,
            sonar: Ranger::default(),
            infrared: Ranger::default(),
            slant: None,
            landed_height_m: 0.0,
            flow_arrived: None,
            depth: [DepthCamera::default(); MAX_DEPTH_CAMERAS],
            flow: None,
            flow_gap_m_s: Vector2::zeros(),
        }
    }

    /// Takes a batch while the vehicle stands.
    pub(crate) fn observe_standing(&mut self, batch: &SensorBatch) {
        self.now = batch.now;
        for sample in &batch.imu {
            let step_s = self.take_imu(sample, VERTICAL_GROUND_S, f64::INFINITY);
            self.learn_bias(sample, step_s);
        }
        self.take_ranges(batch);
        self.take_images(batch);
        self.climb_m_s = 0.0;
        self.height_m = self.range_height_m().unwrap_or(0.0);
        self.landed_height_m = self.height_m;
        self.flow_gap_m_s = Vector2::zeros();
        for sample in &batch.flow {
            self.mark_flow(sample);
        }
    }

    /// Takes a batch in flight; `velocity_body` is the estimate's, m/s.
    pub(crate) fn observe_flying(&mut self, batch: &SensorBatch, velocity_body: &Vector3<f64>) {
        self.now = batch.now;
        for sample in &batch.imu {
            self.take_imu(sample, VERTICAL_FLIGHT_S, QUIET_M_S2);
        }
        self.take_ranges(batch);
        self.take_images(batch);
        for sample in &batch.flow {
            self.compare_flow(sample, velocity_body);
        }
    }

    /// Whether a sample is not dated ahead: one that is would look fresh long after its sensor died,
    /// and counts as none.
    fn has_come(&self, time: Timestamp) -> bool {
        time <= self.now
    }

    fn take_images(&mut self, batch: &SensorBatch) {
        for image in &batch.depth {
            if !self.has_come(image.time) {
                continue;
            }
            let Some(camera) = self.depth.get_mut(usize::from(image.sensor)) else {
                continue;
            };
            let fingerprint = image.fingerprint();
            let is_stuck = camera.fingerprint.replace(fingerprint) == Some(fingerprint);
            if !is_stuck && shows_anything(&image.depth_mm) {
                camera.newest = camera.newest.max(Some(image.time));
            }
        }
    }

    /// Latest image that shows anything, of the depth camera that has shown nothing for longest;
    /// cameras that never showed anything are not known of.
    pub(crate) fn depth(&self) -> Option<Timestamp> {
        self.depth.iter().filter_map(|camera| camera.newest).min()
    }

    /// Angle between the body's z axis and the vertical, rad.
    pub(crate) fn tilt_rad(&self) -> f64 {
        self.up_body.xy().norm().atan2(self.up_body.z)
    }

    /// Height above the ground below by a recent range that is not stuck, m.
    pub(crate) fn range_height_m(&self) -> Option<f64> {
        let (time, slant_m) = self.slant?;
        let fresh = self.now.seconds_since(time) <= RANGE_FRESH_S;
        (fresh && self.up_body.z >= MIN_COSINE).then_some(slant_m * self.up_body.z)
    }

    /// Whether inertial data arrive.
    pub(crate) fn imu_is_fresh(&self) -> bool {
        self.seconds_since(self.imu) <= self.limits.imu_lost_s
    }

    /// Whether inertial data are fit to found something on.
    pub(crate) fn imu_is_calm(&self) -> bool {
        self.imu_is_fresh() && self.jumps <= DOUBTED_JUMPS
    }

    /// Seconds since `time`, infinite if it never was.
    pub(crate) fn seconds_since(&self, time: Option<Timestamp>) -> f64 {
        time.map_or(f64::INFINITY, |time| self.now.seconds_since(time))
    }

    fn is_usable(&self, sample: &ImuSample) -> bool {
        // Comparisons with numbers that are not finite are false.
        self.has_come(sample.time)
            && sample.specific_force.norm() <= self.limits.specific_force_m_s2
            && sample.angular_rate.norm() <= self.limits.angular_rate_rad_s
    }

    /// Whether the sample is more than a repetition or noise: noise of a working sensor never
    /// repeats six numbers, and the specific force of a vehicle does not jump most of the time.
    fn is_alive(&mut self, sample: &ImuSample) -> bool {
        let numbers = (sample.specific_force, sample.angular_rate);
        let pause_s = self
            .imu_arrived
            .map_or(0.0, |t| sample.time.seconds_since(t));
        self.imu_arrived = Some(sample.time);
        let Some(last) = self.imu_numbers.replace(numbers) else {
            return true;
        };
        let jump_m_s2 = (numbers.0 - last.0).norm();
        let jumped = f64::from(jump_m_s2 > self.limits.imu_jump_m_s2);
        let gain = low_pass_gain(pause_s.clamp(0.0, MAX_STEP_S), JUMPS_S);
        self.jumps += gain * (jumped - self.jumps);
        numbers != last && self.jumps <= self.limits.imu_jump_share
    }

    /// up' = -omega x up, pulled slowly to the direction of the specific force; the vertical speed
    /// integrates the specific force along it, less gravity.
    ///
    /// Returns the time since the sample before, s.
    fn take_imu(&mut self, sample: &ImuSample, vertical_s: f64, quiet_m_s2: f64) -> f64 {
        if !self.is_usable(sample) || !self.is_alive(sample) {
            return 0.0;
        }
        let Some(last) = self.imu else {
            self.imu = Some(sample.time);
            let direction = sample.specific_force.try_normalize(0.1);
            self.up_body = direction.unwrap_or(Vector3::z());
            return 0.0;
        };
        let step_s = sample.time.seconds_since(last).clamp(0.0, MAX_STEP_S);
        self.imu = Some(last.max(sample.time));
        self.rate_body = sample.angular_rate - self.bias_body;
        self.up_body = so3::exp(&(self.rate_body * -step_s)) * self.up_body;
        self.pull_vertical(&sample.specific_force, step_s / vertical_s, quiet_m_s2);

        let force = &sample.specific_force;
        self.lift_m_s2 += low_pass_gain(step_s, LIFT_S) * (force.z - self.lift_m_s2);
        self.climb_m_s += (force.dot(&self.up_body) - GRAVITY_M_S2) * step_s;
        if self.range_height_m().is_none() {
            self.climb_m_s -= self.climb_m_s * (step_s / self.forget_s);
        }
        self.height_m += self.climb_m_s * step_s;
        step_s
    }

    fn pull_vertical(&mut self, force: &Vector3<f64>, gain: f64, quiet_m_s2: f64) {
        let size = force.norm();
        if size > 0.1 && (size - GRAVITY_M_S2).abs() <= quiet_m_s2 {
            self.up_body += (force / size - self.up_body) * gain;
        }
        self.up_body = self.up_body.try_normalize(1e-6).unwrap_or(Vector3::z());
    }

    fn learn_bias(&mut self, sample: &ImuSample, step_s: f64) {
        let rate = sample.angular_rate;
        if self.is_usable(sample) && rate.norm() <= BIAS_LIMIT_RAD_S {
            self.bias_body += (rate - self.bias_body) * low_pass_gain(step_s, BIAS_S);
        }
    }

    fn take_ranges(&mut self, batch: &SensorBatch) {
        for sample in &batch.sonar {
            if !self.has_come(sample.time) {
                continue;
            }
            self.sonar.take(sample);
            self.take_range(sample, self.sonar.same_s());
        }
        for sample in &batch.infrared {
            if !self.has_come(sample.time) {
                continue;
            }
            self.infrared.take(sample);
            self.take_range(sample, self.infrared.same_s());
        }
    }

    /// Corrects height and vertical speed: height += 2 w dt e, speed += w^2 dt e.
    fn take_range(&mut self, sample: &RangeSample, same_s: f64) {
        if !sample.is_valid() || same_s > RANGE_FRESH_S {
            return;
        }
        let last = self.slant.map(|(time, _)| time);
        self.slant = Some((sample.time, sample.range_m));
        let Some(height_m) = self.range_height_m() else {
            return;
        };
        let pause_s = last.map_or(0.0, |last| sample.time.seconds_since(last));
        let step_s = pause_s.clamp(0.0, 0.2);
        let error_m = height_m - self.height_m;
        if error_m.abs() > STEP_M {
            self.height_m = height_m;
            return;
        }
        self.height_m += (2.0 * OBSERVER_RAD_S * step_s).min(1.0) * error_m;
        self.climb_m_s += OBSERVER_RAD_S * OBSERVER_RAD_S * step_s * error_m;
    }

    fn mark_flow(&mut self, sample: &FlowSample) -> bool {
        if !self.has_come(sample.time) {
            return false;
        }
        self.flow_arrived = Some(sample.time);
        let usable = sample.quality >= self.limits.flow_quality
            && sample.flow_rad_s.iter().all(|x| x.is_finite());
        if usable {
            self.flow = Some(sample.time);
        }
        usable
    }

    /// Velocity over the ground by a camera that looks down, whose image has x to the right and y
    /// to the rear (document S, equation 2.21, with the camera at the body's origin):
    /// v_x = d (flow_y + rate_y), v_y = d (flow_x - rate_x), d the distance along the axis.
    fn compare_flow(&mut self, sample: &FlowSample, velocity_body: &Vector3<f64>) {
        let last = self.flow;
        if !self.mark_flow(sample) || self.range_height_m().is_none() {
            return;
        }
        let Some((_, slant_m)) = self.slant else {
            return;
        };
        let flow = &sample.flow_rad_s;
        let by_flow = Vector2::new(flow.y + self.rate_body.y, flow.x - self.rate_body.x) * slant_m;
        let gap = by_flow - velocity_body.xy();
        if gap.iter().all(|x| x.is_finite()) {
            let pause_s = last.map_or(0.0, |last| sample.time.seconds_since(last));
            let gain = low_pass_gain(pause_s.clamp(0.0, 0.2), FLOW_S);
            self.flow_gap_m_s += (gap - self.flow_gap_m_s) * gain;
        }
    }
}

pub(crate) fn low_pass_gain(step_s: f64, time_constant_s: f64) -> f64 {
    step_s / (time_constant_s + step_s)
}
