//! Has the vehicle touched down? The ground carries a part of its weight; the air never does.

use alula_geometry::{GRAVITY_M_S2, Timestamp, so3};
use alula_messages::{EstimateHealth, FlightMode};

use super::{Situation, TouchdownConfig};

/// Longest step that the filters take at once; longer pauses count as this long, s.
const MAX_STEP_S: f64 = 0.1;

/// Loads, in weights, at which thrust per load says something about hovering.
const PLAUSIBLE_LOADS: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// Time constant of the thrust in the take-off: short against its climb, long against vibration, s.
const TAKE_OFF_TIME_CONSTANT_S: f64 = 0.2;

/// A vehicle that never gave more thrust than this never left the ground.
const MIN_HOVER_FRACTION: f64 = 0.02;

/// Recognises the touchdown.
///
/// Along the vertical, `m (a_z + g) = T cos(tilt) + F_ground`. With T_h the thrust that hovering
/// takes (m g = T_h), the share of the weight that the ground carries is
///
/// s = F_ground / (m g) = 1 + a_z / g - cos(tilt) T / T_h.
///
/// In free flight s is zero whatever the controller does, except for drag and gusts; on the ground
/// it grows to 1 while a descent is commanded. T_h is learnt in flight.
#[derive(Clone, Debug)]
pub(super) struct Touchdown {
    config: TouchdownConfig,
    last: Option<Timestamp>,
    /// Share of the greatest thrust that hovering takes, once it is learnt.
    hover_fraction: Option<f64>,
    /// Low-pass of the thrust per load in the take-off.
    take_off_fraction: f64,
    /// Height that the ranger shows on the ground, m.
    landed_height_m: f64,
    /// Low-pass of the share of the weight that the ground carries.
    support: f64,
    /// For how long each kind of evidence has lasted, s.
    near_s: f64,
    blind_s: f64,
    contradicted_s: f64,
}

impl Touchdown {
    pub(super) fn new(config: &TouchdownConfig) -> Self {
        Self {
            config: config.clone(),
            last: None,
            hover_fraction: None,
            take_off_fraction: 0.0,
            landed_height_m: 0.0,
            support: 0.0,
            near_s: 0.0,
            blind_s: 0.0,
            contradicted_s: 0.0,
        }
    }

    /// A new flight begins: the height seen by the ranger is that of a standing vehicle, and
    /// hovering is learnt again, since the load and the battery may have changed.
    pub(super) fn learn_ground(&mut self, height_m: Option<f64>) {
        self.landed_height_m = height_m.filter(|h| h.is_finite()).unwrap_or(0.0);
        self.hover_fraction = None;
        self.take_off_fraction = 0.0;
    }

    /// Forgets the evidence.
    pub(super) fn restart(&mut self) {
        self.support = 0.0;
        self.near_s = 0.0;
        self.blind_s = 0.0;
        self.contradicted_s = 0.0;
    }

    /// Whether the vehicle stands on the ground.
    pub(super) fn is_certain(&self) -> bool {
        self.near_s >= self.config.near_dwell_s
            || self.blind_s >= self.config.blind_dwell_s
            || self.contradicted_s >= self.config.contradicted_dwell_s
    }

    pub(super) fn observe(&mut self, mode: FlightMode, situation: &Situation) {
        let step_s = self.step_s(situation.time);
        let Some((lift, load)) = forces(situation) else {
            self.restart();
            return;
        };
        match mode {
            FlightMode::TakingOff => self.learn_take_off(lift, load, step_s),
            FlightMode::Hovering | FlightMode::Flying => self.learn_hover(lift, load, step_s),
            FlightMode::Landing => self.weigh(lift, load, step_s, situation),
            FlightMode::Disarmed | FlightMode::Armed | FlightMode::Killed => {}
        }
    }

    fn step_s(&mut self, now: Timestamp) -> f64 {
        let step_s = self.last.map_or(0.0, |last| now.seconds_since(last));
        self.last = Some(now);
        step_s.clamp(0.0, MAX_STEP_S)
    }

    /// While the ground still carries a part, thrust per load is less than hovering takes; in the
    /// air it is just that. So the greatest value is taken, and no height needs to be trusted.
    fn learn_take_off(&mut self, lift: f64, load: f64, step_s: f64) {
        if !PLAUSIBLE_LOADS.contains(&load) {
            return;
        }
        let gain = low_pass_gain(step_s, TAKE_OFF_TIME_CONSTANT_S);
        self.take_off_fraction += gain * (lift / load - self.take_off_fraction);
        let hover = self.hover_fraction.unwrap_or(0.0);
        self.hover_fraction = Some(hover.max(self.take_off_fraction));
    }

    fn learn_hover(&mut self, lift: f64, load: f64, step_s: f64) {
        if !PLAUSIBLE_LOADS.contains(&load) {
            return;
        }
        let sample = lift / load;
        let gain = low_pass_gain(step_s, self.config.hover_time_constant_s);
        let hover = self.hover_fraction.unwrap_or(sample);
        self.hover_fraction = Some(hover + gain * (sample - hover));
    }

    /// Collects evidence for the three cases of what the ranger says.
    fn weigh(&mut self, lift: f64, load: f64, step_s: f64, situation: &Situation) {
        let hover = self
            .hover_fraction
            .filter(|&hover| hover > MIN_HOVER_FRACTION);
        let carried = hover.map_or(0.0, |hover| lift / hover);
        let gain = low_pass_gain(step_s, self.config.support_time_constant_s);
        self.support += gain * (load - carried - self.support);

        let limits = &self.config;
        let height_m = situation.height_above_ground_m;
        let is_near = |h: f64| h <= self.landed_height_m + limits.near_ground_m;
        let near = height_m.is_some_and(is_near);
        // A range beyond the near ground contradicts, one that is absent says nothing.
        let blind = near || height_m.is_none();
        let rests = speed_allows(situation, limits.speed_m_s);

        let hold = |seconds: f64, evidence: bool| if evidence { seconds + step_s } else { 0.0 };
        self.near_s = hold(
            self.near_s,
            rests && near && self.support >= limits.near_support,
        );
        self.blind_s = hold(
            self.blind_s,
            rests && blind && self.support >= limits.blind_support,
        );
        self.contradicted_s = hold(
            self.contradicted_s,
            rests && self.support >= limits.contradicted_support,
        );
    }
}

/// Vertical thrust as a share of the greatest thrust, and the load it balances in weights.
/// `None` when the estimate cannot say.
fn forces(situation: &Situation) -> Option<(f64, f64)> {
    let state = situation.state;
    if matches!(
        state.health,
        EstimateHealth::Failed | EstimateHealth::Initialising
    ) {
        return None;
    }
    let tilt_rad = so3::tilt_rad(&state.world_from_body.rotation);
    let lift = situation.thrust_fraction * tilt_rad.cos();
    let load = 1.0 + state.acceleration_world.z / GRAVITY_M_S2;
    (lift.is_finite() && load.is_finite()).then_some((lift, load))
}

/// A good estimate must say that the vehicle rests; one that is dead reckoning is not asked.
fn speed_allows(situation: &Situation, limit_m_s: f64) -> bool {
    situation.state.health != EstimateHealth::Good
        || situation.state.velocity_world.z.abs() <= limit_m_s
}

fn low_pass_gain(step_s: f64, time_constant_s: f64) -> f64 {
    step_s / (time_constant_s + step_s)
}
