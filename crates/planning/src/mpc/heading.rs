//! Where to look: the wanted yaw at every point of the plan.

use std::f64::consts::PI;

use alula_geometry::so3::wrap_angle;
use alula_messages::PLAN_POINTS;
use nalgebra::{Vector2, Vector3};

use super::config::PredictiveConfig;
use super::dynamics::State;

/// What the yaw should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YawTarget {
    /// The direction of motion (document L, equation 6-10), and towards the target when slow.
    AlongMotion,
    /// Turn to this heading, rad.
    Towards(f64),
    /// Keep this heading, rad.
    Hold(f64),
}

/// Turns further than this may go either way round and keep the way they went before, rad.
const REVERSAL_RAD: f64 = 0.85 * PI;

/// Keeps the wanted yaw free of jumps from plan to plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Heading {
    /// The way of the last turn: positive to the left.
    way: f64,
}

impl Heading {
    /// Wanted yaw at every point, continuous from `yaw_rad` on, along the motion of `states`.
    pub fn targets(
        &mut self,
        config: &PredictiveConfig,
        wish: YawTarget,
        yaw_rad: f64,
        states: &[State],
        target_world: &Vector3<f64>,
        targets: &mut [f64; PLAN_POINTS],
    ) {
        let mut last = yaw_rad;
        for (k, state) in states.iter().enumerate().take(PLAN_POINTS) {
            let wanted = match wish {
                YawTarget::AlongMotion => direction(config, state, target_world),
                YawTarget::Towards(heading) | YawTarget::Hold(heading) => Some(heading),
            };
            if let Some(wanted) = wanted {
                last = if k == 0 {
                    self.first(yaw_rad, wanted)
                } else {
                    last + wrap_angle(wanted - last)
                };
            }
            targets[k] = last;
        }
        // The point of departure cannot be changed; looking ahead starts at the next one.
        targets[0] = targets[1];
    }

    /// The turn from the present yaw: the shorter way, or the way begun if they are nearly equal.
    fn first(&mut self, yaw_rad: f64, wanted: f64) -> f64 {
        let mut turn = wrap_angle(wanted - yaw_rad);
        if turn.abs() > REVERSAL_RAD && turn * self.way < 0.0 {
            turn += (2.0 * PI).copysign(self.way);
        } else {
            self.way = turn;
        }
        yaw_rad + turn
    }
}

/// Heading of the motion with a share of the direction to the target; none when both are small.
fn direction(config: &PredictiveConfig, state: &State, target_world: &Vector3<f64>) -> Option<f64> {
    let velocity = Vector2::new(state[3], state[4]);
    let way = target_world.xy() - Vector2::new(state[0], state[1]);
    let look = velocity + way * (config.yaw_lead_m_s / way.norm().max(1.0));
    (look.norm() > config.yaw_hold_m_s).then(|| look.y.atan2(look.x))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn targets(heading: &mut Heading, wish: YawTarget, yaw_rad: f64, velocity: [f64; 2]) -> f64 {
        let mut state = State::zeros();
        (state[3], state[4]) = (velocity[0], velocity[1]);
        let mut targets = [0.0; PLAN_POINTS];
        let config = PredictiveConfig::default();
        let states = [state; PLAN_POINTS];
        heading.targets(
            &config,
            wish,
            yaw_rad,
            &states,
            &Vector3::zeros(),
            &mut targets,
        );
        targets[PLAN_POINTS - 1]
    }

    #[test]
    fn the_yaw_follows_the_motion() {
        let yaw = targets(
            &mut Heading::default(),
            YawTarget::AlongMotion,
            1.0,
            [0.0, 2.0],
        );
        assert!((yaw - PI / 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_yaw_is_kept_at_rest() {
        let yaw = targets(
            &mut Heading::default(),
            YawTarget::AlongMotion,
            1.0,
            [0.01, 0.0],
        );
        assert_eq!(yaw, 1.0);
    }

    #[test]
    fn the_shorter_way_is_taken_across_the_border_of_angles() {
        let yaw = targets(
            &mut Heading::default(),
            YawTarget::Hold(-3.0),
            3.0,
            [0.0, 0.0],
        );
        assert!((yaw - (2.0 * PI - 3.0)).abs() < 1e-12);
    }

    #[test]
    fn a_reversal_keeps_its_way_round() {
        let mut heading = Heading::default();
        assert!(targets(&mut heading, YawTarget::Towards(3.10), 0.0, [0.0, 0.0]) > 0.0);
        assert!(targets(&mut heading, YawTarget::Towards(-3.10), 0.0, [0.0, 0.0]) > 0.0);
    }
}
