//! The opening of the guard's own descent: a tilt against the last velocity that could be trusted.

use alula_geometry::{GRAVITY_M_S2, TimeDelta, Timestamp, so3};
use alula_messages::{NavState, error_index};
use nalgebra::{Vector2, Vector3};

use crate::config::BrakeConfig;

/// Roll and pitch of a level attitude, rad.
const LEVEL: (f64, f64) = (0.0, 0.0);

/// Horizontal motion in the heading frame: x to the front, y to the left.
#[derive(Clone, Copy, Debug)]
struct Motion {
    time: Timestamp,
    velocity_m_s: Vector2<f64>,
    /// Acceleration that the tilt makes, m/s^2.
    acceleration_m_s2: Vector2<f64>,
}

/// A tilt that is held until a time.
#[derive(Clone, Copy, Debug)]
struct Tilt {
    roll_rad: f64,
    pitch_rad: f64,
    until: Timestamp,
}

/// Remembers the last trusted velocity and brakes it once.
///
/// With deceleration `a = g tan(tilt)` a velocity v is gone after `|v| / a`. The attitude follows
/// with a lag; what that lacks at the beginning it adds at the end, so the time stays the same. Until
/// the attitude has followed, the tilt of before acts: v = v_trusted + g tan(tilt_before) (age + lag).
#[derive(Clone, Debug)]
pub(crate) struct Brake {
    config: BrakeConfig,
    trusted: Option<Motion>,
    tilt: Option<Tilt>,
}

impl Brake {
    pub(crate) fn new(config: &BrakeConfig) -> Self {
        Self {
            config: config.clone(),
            trusted: None,
            tilt: None,
        }
    }

    /// Notes a state that no rule doubts. `flow_gap_m_s` is how far its velocity is from that by
    /// flow, where there is flow.
    pub(crate) fn note(&mut self, state: &NavState, flow_gap_m_s: Option<f64>) {
        let sigma_m_s = state.sigma(error_index::VELOCITY).xy().max();
        let agrees = flow_gap_m_s.is_none_or(|gap| gap <= self.config.flow_gap_m_s);
        if agrees && sigma_m_s <= self.config.sigma_m_s {
            self.trusted = motion(state);
        }
    }

    /// Plans the brake; without a velocity that is recent there is none.
    pub(crate) fn begin(&mut self, now: Timestamp) {
        self.tilt = self.trusted.and_then(|motion| self.plan(&motion, now));
    }

    /// Forgets everything.
    pub(crate) fn reset(&mut self) {
        self.trusted = None;
        self.tilt = None;
    }

    /// Roll and pitch to command now, rad.
    pub(crate) fn attitude(&self, now: Timestamp) -> (f64, f64) {
        match self.tilt {
            Some(tilt) if now < tilt.until => (tilt.roll_rad, tilt.pitch_rad),
            _ => LEVEL,
        }
    }

    fn plan(&self, motion: &Motion, now: Timestamp) -> Option<Tilt> {
        let config = &self.config;
        let age_s = now.seconds_since(motion.time);
        if !(0.0..=config.max_age_s).contains(&age_s) {
            return None;
        }
        let drift = motion.acceleration_m_s2 * (age_s + config.lag_s);
        let velocity = motion.velocity_m_s + drift;
        let speed_m_s = velocity.norm();
        // A comparison with a number that is not one is false.
        let worth_it = speed_m_s >= config.min_speed_m_s;
        let slope = config.tilt_deg.to_radians().tan();
        if !worth_it || slope <= 0.0 {
            return None;
        }
        let braking_s = (speed_m_s / (GRAVITY_M_S2 * slope)).min(config.max_duration_s);
        let (roll_rad, pitch_rad) = tilt_towards(&(velocity * (-slope / speed_m_s)));
        Some(Tilt {
            roll_rad,
            pitch_rad,
            until: now + TimeDelta::from_s(braking_s),
        })
    }
}

fn motion(state: &NavState) -> Option<Motion> {
    let rotation = &state.world_from_body.rotation;
    let heading_from_world = so3::from_roll_pitch_yaw(0.0, 0.0, so3::yaw_rad(rotation)).inverse();
    let up = heading_from_world * (rotation * Vector3::z());
    let velocity = heading_from_world * state.velocity_world;
    (up.z > 0.5).then(|| Motion {
        time: state.time,
        velocity_m_s: velocity.xy(),
        acceleration_m_s2: up.xy() * (GRAVITY_M_S2 / up.z),
    })
}

/// Roll and pitch whose thrust leans by `slope` (horizontal over vertical) in the heading frame.
///
/// The body's z axis is (sin p cos r, -sin r, cos p cos r), so tan p = slope_x and
/// tan r = -slope_y cos p.
fn tilt_towards(slope: &Vector2<f64>) -> (f64, f64) {
    let pitch_rad = slope.x.atan();
    let roll_rad = (-slope.y * pitch_rad.cos()).atan();
    (roll_rad, pitch_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::Pose;
    use nalgebra::Translation3;
    use proptest::prelude::*;

    fn moving(velocity_world: Vector3<f64>, yaw_rad: f64) -> NavState {
        NavState {
            time: Timestamp::from_s(10.0),
            world_from_body: Pose::from_parts(
                Translation3::identity(),
                so3::from_roll_pitch_yaw(0.0, 0.0, yaw_rad),
            ),
            velocity_world,
            ..NavState::default()
        }
    }

    fn braking(state: &NavState, age_s: f64) -> Brake {
        let mut brake = Brake::new(&BrakeConfig::default());
        brake.note(state, None);
        brake.begin(Timestamp::from_s(10.0 + age_s));
        brake
    }

    proptest! {
        #[test]
        fn the_thrust_leans_against_the_velocity(
            x in -3.0..3.0, y in -3.0..3.0, yaw_rad in -3.0..3.0,
        ) {
            let velocity = Vector3::new(x, y, 0.0);
            prop_assume!(velocity.norm() >= 0.5);
            let brake = braking(&moving(velocity, yaw_rad), 0.1);
            let (roll_rad, pitch_rad) = brake.attitude(Timestamp::from_s(10.1));
            let up = so3::from_roll_pitch_yaw(roll_rad, pitch_rad, yaw_rad) * Vector3::z();
            let wanted = BrakeConfig::default().tilt_deg.to_radians();
            prop_assert!((up.angle(&Vector3::z()) - wanted).abs() < 1e-9);
            // An angle by its cosine has half the digits.
            prop_assert!(up.xy().angle(&-velocity.xy()) < 1e-6);
        }

        #[test]
        fn it_lasts_until_the_velocity_is_gone(speed_m_s in 0.5..3.0) {
            let config = BrakeConfig::default();
            let brake = braking(&moving(Vector3::x() * speed_m_s, 0.0), 0.0);
            let end_s = speed_m_s / (GRAVITY_M_S2 * config.tilt_deg.to_radians().tan());
            prop_assert_ne!(brake.attitude(Timestamp::from_s(10.0 + end_s - 1e-3)), LEVEL);
            prop_assert_eq!(brake.attitude(Timestamp::from_s(10.0 + end_s + 1e-3)), LEVEL);
        }
    }

    fn is_level(state: &NavState, age_s: f64, flow_gap_m_s: f64) -> bool {
        let now = Timestamp::from_s(10.0 + age_s);
        let mut brake = Brake::new(&BrakeConfig::default());
        brake.note(state, Some(flow_gap_m_s));
        brake.begin(now);
        brake.attitude(now) == LEVEL
    }

    #[test]
    fn an_old_velocity_is_not_braked() {
        let state = moving(Vector3::x() * 2.0, 0.0);
        assert!(!is_level(&state, 0.2, 0.0));
        assert!(is_level(&state, 0.4, 0.0));
        assert!(is_level(&state, -0.1, 0.0));
    }

    #[test]
    fn a_velocity_that_contradicts_the_flow_is_not_braked() {
        assert!(is_level(&moving(Vector3::x() * 2.0, 0.0), 0.0, 0.6));
    }

    #[test]
    fn an_uncertain_velocity_is_not_braked() {
        let mut state = moving(Vector3::x() * 2.0, 0.0);
        state.covariance[(error_index::VELOCITY, error_index::VELOCITY)] = 1.0;
        assert!(is_level(&state, 0.0, 0.0));
    }

    #[test]
    fn without_a_velocity_the_attitude_is_level() {
        let mut brake = Brake::new(&BrakeConfig::default());
        brake.begin(Timestamp::from_s(10.0));
        assert_eq!(brake.attitude(Timestamp::from_s(10.0)), LEVEL);
        assert!(is_level(&moving(Vector3::x() * f64::NAN, 0.0), 0.0, 0.0));
        assert!(is_level(&moving(Vector3::x() * 0.1, 0.0), 0.0, 0.0));
    }

    #[test]
    fn no_brake_lasts_longer_than_its_limit() {
        let brake = braking(&moving(Vector3::x() * 1e6, 0.0), 0.0);
        let end_s = 10.0 + BrakeConfig::default().max_duration_s;
        assert_eq!(brake.attitude(Timestamp::from_s(end_s + 1e-3)), LEVEL);
    }
}
