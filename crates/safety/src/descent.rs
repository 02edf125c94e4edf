//! The descent that the guard flies itself: a brake, then level attitude, vertical speed from raw data, motors
//! off when the ground carries the weight.

use alula_geometry::{GRAVITY_M_S2, Timestamp};
use alula_messages::{Command, NavState};

use crate::brake::Brake;
use crate::config::{DescentConfig, GuardVehicle};
use crate::raw::{RawMotion, low_pass_gain};

/// Time constant of the thrust that hovering takes, s.
const HOVER_S: f64 = 2.0;
/// Time constant of the thrust that is compared with the specific force, s.
const THRUST_S: f64 = 0.1;
/// Hovering takes this share of the weight at least and at most: thrust tables are that wrong.
const HOVER_SHARES: (f64, f64) = (0.6, 1.6);
/// The ground is suspected only when vertical motion is below this speed, m/s.
const STANDSTILL_M_S: f64 = 0.25;
/// The suspicion is withdrawn this many times faster than it grows.
const WITHDRAW: f64 = 5.0;
/// Least thrust while the ground is suspected, as a share of hovering.
const LEAST_SHARE: f64 = 0.3;

/// The descent and what it needs to know from the flight before.
#[derive(Clone, Debug)]
pub(crate) struct Descent {
    config: DescentConfig,
    max_thrust_n: f64,
    weight_n: f64,
    hover_thrust_n: f64,
    /// Thrust that the vehicle gives, low-passed, N.
    thrust_n: Option<f64>,
    began: Option<Timestamp>,
    /// Reduction of the thrust to try whether the ground is there, m/s^2.
    probe_m_s2: f64,
    /// For how long the ground carries the weight, and for how long it is near, s.
    supported_s: f64,
    near_s: f64,
    landed: bool,
    brake: Brake,
}

impl Descent {
    pub(crate) fn new(config: &DescentConfig, vehicle: &GuardVehicle) -> Self {
        let weight_n = vehicle.mass_kg * GRAVITY_M_S2;
        Self {
            config: config.clone(),
            max_thrust_n: vehicle.max_thrust_n,
            weight_n,
            hover_thrust_n: weight_n,
            thrust_n: None,
            began: None,
            probe_m_s2: 0.0,
            supported_s: 0.0,
            near_s: 0.0,
            landed: false,
            brake: Brake::new(&config.brake),
        }
    }

    /// Whether the descent has come to its end.
    pub(crate) fn has_ended(&self) -> bool {
        self.landed
    }

    /// Notes the thrust that is given now, N.
    pub(crate) fn note_thrust(&mut self, thrust_n: Option<f64>, step_s: f64) {
        self.thrust_n = match (thrust_n.filter(|t| t.is_finite()), self.thrust_n) {
            (Some(new), Some(old)) => Some(old + low_pass_gain(step_s, THRUST_S) * (new - old)),
            (new, _) => new,
        };
    }

    /// Learns the thrust of hovering in free flight: thrust is to specific force as the thrust of
    /// hovering is to gravity.
    pub(crate) fn learn_hover(&mut self, raw: &RawMotion, step_s: f64) {
        let Some(thrust_n) = self.thrust_n else {
            return;
        };
        let sample_n = thrust_n * GRAVITY_M_S2 / raw.lift_m_s2;
        let (least, most) = HOVER_SHARES;
        if sample_n >= least * self.weight_n && sample_n <= most * self.weight_n {
            let gain = low_pass_gain(step_s, HOVER_S);
            self.hover_thrust_n += gain * (sample_n - self.hover_thrust_n);
        }
    }

    /// Ends the descent and forgets it.
    pub(crate) fn reset(&mut self) {
        self.began = None;
        self.probe_m_s2 = 0.0;
        self.supported_s = 0.0;
        self.near_s = 0.0;
        self.landed = false;
        self.brake.reset();
    }

    /// Notes a state that no rule doubts, before the descent; `flow_gap_m_s` as in [`Brake::note`].
    pub(crate) fn note_trusted(&mut self, state: &NavState, flow_gap_m_s: Option<f64>) {
        if self.began.is_none() {
            self.brake.note(state, flow_gap_m_s);
        }
    }

    /// One step; the command has the interface of `requested`.
    pub(crate) fn fly(
        &mut self,
        now: Timestamp,
        step_s: f64,
        raw: &RawMotion,
        requested: &Command,
    ) -> Command {
        let began = *self.began.get_or_insert_with(|| {
            self.brake.begin(now);
            now
        });
        self.look_for_ground(raw, step_s);
        if now.seconds_since(began) >= self.config.limit_s {
            self.landed = true;
        }
        self.descend_at(self.brake.attitude(now), raw, requested)
    }

    /// A level attitude with a slow descent.
    pub(crate) fn level(&self, raw: &RawMotion, requested: &Command) -> Command {
        self.descend_at((0.0, 0.0), raw, requested)
    }

    fn descend_at(
        &self,
        (roll_rad, pitch_rad): (f64, f64),
        raw: &RawMotion,
        requested: &Command,
    ) -> Command {
        if matches!(requested, Command::TiltClimb { .. }) {
            return Command::TiltClimb {
                roll_rad,
                pitch_rad,
                yaw_rate_rad_s: 0.0,
                climb_rate_m_s: -self.config.speed_m_s,
            };
        }
        let upright = roll_rad.cos() * pitch_rad.cos();
        let thrust_n = self.thrust_for_descent_n(raw) / upright;
        Command::AttitudeThrust {
            roll_rad,
            pitch_rad,
            yaw_rate_rad_s: 0.0,
            thrust_n: thrust_n.min(self.max_thrust_n),
        }
    }

    /// T = T_hover (1 + (k (v_descent - v) - probe) / g), the correction bounded.
    fn thrust_for_descent_n(&self, raw: &RawMotion) -> f64 {
        let config = &self.config;
        let share = if raw.imu_is_fresh() {
            let bound = config.correction_m_s2;
            let error_m_s = -config.speed_m_s - raw.climb_m_s;
            let correction = (config.gain_hz * error_m_s).clamp(-bound, bound);
            (1.0 + (correction - self.probe_m_s2) / GRAVITY_M_S2).max(LEAST_SHARE)
        } else {
            config.blind_share
        };
        self.hover_thrust_n * share
    }

    /// The ground shows when it carries what the thrust does not: specific force along z stays at
    /// gravity while the thrust is less than hovering takes. Where that is suspected the thrust is
    /// lowered further; in the air the specific force would follow it.
    fn look_for_ground(&mut self, raw: &RawMotion, step_s: f64) {
        let config = &self.config;
        let support = self.support(raw);
        let stands = raw.climb_m_s.abs() <= STANDSTILL_M_S;
        if support >= config.suspect_support && stands {
            self.probe_m_s2 += config.probe_m_s3 * step_s;
        } else {
            self.probe_m_s2 -= WITHDRAW * config.probe_m_s3 * step_s;
        }
        self.probe_m_s2 = self.probe_m_s2.clamp(0.0, GRAVITY_M_S2);

        let carried = stands && support >= config.cut_support;
        let limit_m = raw.landed_height_m + config.near_ground_m;
        let near = raw.range_height_m().is_some_and(|h| h <= limit_m);
        self.supported_s = if carried {
            self.supported_s + step_s
        } else {
            0.0
        };
        self.near_s = if near { self.near_s + step_s } else { 0.0 };
        self.landed |= self.supported_s >= config.cut_s || self.near_s >= config.near_ground_s;
    }

    /// Share of the weight that the ground carries; zero when it cannot be known.
    pub(crate) fn support(&self, raw: &RawMotion) -> f64 {
        match self.thrust_n {
            Some(thrust_n) if raw.imu_is_fresh() => {
                raw.lift_m_s2 / GRAVITY_M_S2 - thrust_n / self.hover_thrust_n
            }
            _ => 0.0,
        }
    }
}
