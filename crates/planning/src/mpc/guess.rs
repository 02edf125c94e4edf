//! First guesses: the last plan moved on in time, or a simple flight towards the target.

use std::f64::consts::FRAC_PI_2;

use alula_geometry::GRAVITY_M_S2;
use alula_messages::{PLAN_INTERVALS, PLAN_POINTS};
use nalgebra::Vector3;

use super::detour::Via;
use super::dynamics::{Input, State, TiltDynamics};

/// States and inputs over the horizon.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Path {
    pub states: [State; PLAN_POINTS],
    pub inputs: [Input; PLAN_INTERVALS],
}

impl Path {
    pub fn standing(start: &State) -> Self {
        Self {
            states: [*start; PLAN_POINTS],
            inputs: [Input::zeros(); PLAN_INTERVALS],
        }
    }

    /// The same path `shift` intervals later, starting at `start`; its end is repeated.
    pub fn shifted(&self, shift: f64, start: &State) -> Self {
        let mut path = Self::standing(start);
        for (k, state) in path.states.iter_mut().enumerate().skip(1) {
            let (at, share) = place(k as f64 + shift, PLAN_INTERVALS);
            let next = (at + 1).min(PLAN_INTERVALS);
            *state = self.states[at] * (1.0 - share) + self.states[next] * share;
        }
        for (k, input) in path.inputs.iter_mut().enumerate() {
            let (at, share) = place(k as f64 + shift, PLAN_INTERVALS - 1);
            let next = (at + 1).min(PLAN_INTERVALS - 1);
            *input = self.inputs[at] * (1.0 - share) + self.inputs[next] * share;
        }
        path
    }
}

/// Index and share of the way to the next one, at most `last`.
fn place(position: f64, last: usize) -> (usize, f64) {
    let whole = position.floor().clamp(0.0, last as f64);
    let share = (position - whole).clamp(0.0, 1.0);
    // A shift by whole intervals that is off by rounding is one by whole intervals.
    if share > 1.0 - 1e-6 {
        return ((whole as usize + 1).min(last), 0.0);
    }
    (whole as usize, if share < 1e-6 { 0.0 } else { share })
}

/// Time constant in which the simple flight takes up its velocity, s.
const TAKE_UP_S: f64 = 0.4;
/// Time constant of its approach, s.
const APPROACH_S: f64 = 0.8;

/// A flight towards the target, past `via` if there is one, at most at `speed_m_s` and with yaw
/// towards `yaw`, within the limits of the inputs.
pub(super) fn simple_flight(
    dynamics: &TiltDynamics,
    limit: &Input,
    start: &State,
    target: &Vector3<f64>,
    via: Option<&Via>,
    speed_m_s: f64,
    yaw_rad: &[f64; PLAN_POINTS],
) -> Path {
    let mut path = Path::standing(start);
    for k in 0..PLAN_INTERVALS {
        let x = path.states[k];
        let position = Vector3::new(x[0], x[1], x[2]);
        let aim = match via {
            Some(via) if via.along.dot(&(via.point - position)) > 0.0 => via.point,
            _ => *target,
        };
        let u = towards(&x, &(aim - position), speed_m_s, yaw_rad[k], limit);
        path.inputs[k] = u;
        path.states[k + 1] = dynamics.next(&x, &u);
    }
    path
}

/// Inputs that take up the velocity towards a point.
fn towards(x: &State, way: &Vector3<f64>, speed_m_s: f64, yaw_rad: f64, limit: &Input) -> Input {
    let level = way.xy();
    let wanted = level / APPROACH_S * (speed_m_s * APPROACH_S / level.norm().max(1e-9)).min(1.0);
    let a = (wanted - nalgebra::Vector2::new(x[3], x[4])) / TAKE_UP_S;
    let (s, c) = x[8].sin_cos();
    let pitch = ((c * a.x + s * a.y) / GRAVITY_M_S2).atan();
    let roll = -((c * a.y - s * a.x) / GRAVITY_M_S2).atan();
    let climb = way.z / APPROACH_S;
    let yaw_rate = (yaw_rad - x[8]).clamp(-FRAC_PI_2, FRAC_PI_2) / TAKE_UP_S;
    let u = Input::new(roll, pitch, climb, yaw_rate);
    Input::from_fn(|i, _| u[i].clamp(-limit[i], limit[i]))
}

#[cfg(test)]
mod tests {
    use super::super::dynamics::TiltModel;
    use super::*;

    fn ramp() -> Path {
        Path {
            states: std::array::from_fn(|k| State::repeat(k as f64)),
            inputs: std::array::from_fn(|k| Input::repeat(k as f64)),
        }
    }

    #[test]
    fn a_path_moves_on_in_time_and_keeps_its_end() {
        let start = State::repeat(-1.0);
        let path = ramp().shifted(1.5, &start);
        assert_eq!(path.states[0], start);
        assert_eq!(path.states[1][0], 2.5);
        assert_eq!(path.inputs[3][0], 4.5);
        assert_eq!(path.states[PLAN_INTERVALS][0], PLAN_INTERVALS as f64);
    }

    #[test]
    fn a_shift_by_a_whole_interval_is_exact_but_for_rounding() {
        let path = ramp().shifted(1.0 - 1e-9, &State::zeros());
        assert_eq!(path.states[1][0], 2.0);
        assert_eq!(path.inputs[0][0], 1.0);
    }

    #[test]
    fn the_simple_flight_passes_beside_and_keeps_the_limits() {
        let dynamics = TiltDynamics::new(&TiltModel::bebop(), 0.1).unwrap();
        let limit = Input::new(0.2, 0.2, 1.0, 1.5);
        let via = Via {
            point: Vector3::new(1.0, 1.0, 1.0),
            along: Vector3::x(),
        };
        let mut start = State::zeros();
        start[2] = 1.0;
        let target = Vector3::new(4.0, 0.0, 1.0);
        let yaw = [0.0; PLAN_POINTS];
        let path = simple_flight(&dynamics, &limit, &start, &target, Some(&via), 2.0, &yaw);
        let left = path.states.iter().map(|x| x[1]).fold(0.0, f64::max);
        assert!(left > 0.4, "{left}");
        assert!(path.states[PLAN_INTERVALS][0] > 1.0);
        assert!(
            path.inputs
                .iter()
                .all(|u| (0..4).all(|i| u[i].abs() <= limit[i]))
        );
    }
}
