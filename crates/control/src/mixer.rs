//! Mixing: from collective thrust and body torque to four rotor thrusts.
//!
//! Document O, equation 1.1, derived for a forward-left-up body. Rotors are counted
//! counter-clockwise seen from above: front, left, rear, right (plus), or front left, rear left,
//! rear right, front right (x). The first and third turn clockwise, so that their drag torque turns
//! the body counter-clockwise (positive yaw).

use alula_parameters::{ParameterError, Parameters, facts};
use nalgebra::{Matrix4, Vector3};
use serde::{Deserialize, Serialize};

/// Where the rotors are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// Rotors on the body's x and y axes: front, left, rear, right.
    Plus,
    /// Rotors between the axes: front left, rear left, rear right, front right.
    X,
}

impl Layout {
    /// Unit vectors (x forward, y left) from the centre to the four rotors.
    pub fn rotor_directions(self) -> [[f64; 2]; 4] {
        const H: f64 = std::f64::consts::FRAC_1_SQRT_2;
        match self {
            Self::Plus => [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]],
            Self::X => [[H, H], [-H, H], [-H, -H], [H, -H]],
        }
    }
}

/// Signs of the yaw torque that the rotors' drag exerts on the body.
pub const YAW_TORQUE_SIGNS: [f64; 4] = [1.0, -1.0, 1.0, -1.0];

facts! {
    /// What an autopilot knows of the vehicle that it flies.
    pub struct AirframeFacts {
        /// Mass, kg.
        pub mass_kg: f64, above(0.0);
        /// Principal moments of inertia about the body's axes, kg m^2.
        pub inertia_kg_m2: [f64; 3], above(0.0);
        /// Distance from the centre to each rotor's axis, m.
        pub arm_length_m: f64, above(0.0);
        /// Where the rotors are.
        pub layout: Layout, any();
        /// Drag torque per thrust of a rotor, m.
        pub thrust_to_torque_m: f64, above(0.0);
        /// Greatest thrust of one rotor, N.
        pub max_thrust_per_rotor_n: f64, above(0.0);
    }
}

/// The rotor thrusts for a request, and how much of the request they give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mix {
    /// Thrust of each rotor, N, from zero to the greatest possible.
    pub rotor_thrusts_n: [f64; 4],
    /// Share of the requested roll and pitch torque that is given, 0 to 1.
    pub roll_pitch_share: f64,
    /// Collective thrust that is given, N.
    pub thrust_n: f64,
    /// Share of the requested yaw torque that is given, 0 to 1.
    pub yaw_share: f64,
}

/// Distributes thrust and torque to rotors that can only push, and only so much.
#[derive(Clone, Debug)]
pub struct Mixer {
    positions_m: [[f64; 2]; 4],
    arm_length_m: f64,
    thrust_to_torque_m: f64,
    max_thrust_n: f64,
}

impl Mixer {
    /// A mixer for an airframe.
    ///
    /// # Errors
    /// When a fact is out of its range.
    pub fn new(facts: &AirframeFacts) -> Result<Self, ParameterError> {
        facts.validate()?;
        let arm = facts.arm_length_m;
        Ok(Self {
            positions_m: facts.layout.rotor_directions().map(|d| d.map(|c| c * arm)),
            arm_length_m: arm,
            thrust_to_torque_m: facts.thrust_to_torque_m,
            max_thrust_n: facts.max_thrust_per_rotor_n,
        })
    }

    /// The matrix from rotor thrusts to collective thrust and torque:
    /// T = sum f, tau_x = sum y f, tau_y = -sum x f, tau_z = c sum s f.
    pub fn allocation(&self) -> Matrix4<f64> {
        Matrix4::from_fn(|row, rotor| match row {
            0 => 1.0,
            1 => self.positions_m[rotor][1],
            2 => -self.positions_m[rotor][0],
            _ => self.thrust_to_torque_m * YAW_TORQUE_SIGNS[rotor],
        })
    }

    /// Greatest collective thrust, N.
    pub fn max_collective_n(&self) -> f64 {
        4.0 * self.max_thrust_n
    }

    /// Rotor thrusts for a collective thrust and a body torque.
    ///
    /// Within the rotors' limits this is the inverse of [`Mixer::allocation`],
    /// f_i = T/4 + (y_i tau_x - x_i tau_y) / (2 l^2) + s_i tau_z / (4 c), since
    /// sum x^2 = sum y^2 = 2 l^2 for both layouts. Beyond them, roll and pitch are served first,
    /// then thrust, and yaw takes what is left: between none and all of what is asked.
    pub fn mix(&self, thrust_n: f64, torque_body_nm: &Vector3<f64>) -> Mix {
        let (tilt, roll_pitch_share) = self.tilt_shares(torque_body_nm);
        let yaw_wanted = torque_body_nm.z / (4.0 * self.thrust_to_torque_m);
        let room = Room::new(&tilt, self.max_thrust_n);
        let mean = room.mean_nearest(0.25 * thrust_n, yaw_wanted);
        let yaw = room.yaw_nearest(yaw_wanted, mean);
        let mut rotor_thrusts_n = [0.0; 4];
        for i in 0..4 {
            let thrust = mean + tilt[i] + YAW_TORQUE_SIGNS[i] * yaw;
            // Only rounding is left to cut off.
            rotor_thrusts_n[i] = thrust.clamp(0.0, self.max_thrust_n);
        }
        Mix {
            rotor_thrusts_n,
            roll_pitch_share,
            thrust_n: 4.0 * mean,
            yaw_share: if yaw_wanted == 0.0 {
                1.0
            } else {
                yaw / yaw_wanted
            },
        }
    }

    /// Shares of roll and pitch in each rotor, scaled down together when no collective thrust
    /// could carry them: their spread must fit between zero and the greatest thrust. Yaw cannot
    /// help, because it moves opposite rotors together.
    fn tilt_shares(&self, torque_body_nm: &Vector3<f64>) -> ([f64; 4], f64) {
        let scale = 1.0 / (2.0 * self.arm_length_m * self.arm_length_m);
        let wanted = self
            .positions_m
            .map(|[x, y]| (y * torque_body_nm.x - x * torque_body_nm.y) * scale);
        let low = wanted.into_iter().fold(f64::INFINITY, f64::min);
        let high = wanted.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let share = (self.max_thrust_n / (high - low).max(f64::MIN_POSITIVE)).min(1.0);
        (wanted.map(|w| w * share), share)
    }
}

/// The room that roll and pitch leave: rotors of positive yaw torque may move by
/// `mean + yaw` within `positive`, the others by `mean - yaw` within `negative`.
struct Room {
    positive: (f64, f64),
    negative: (f64, f64),
}

impl Room {
    fn new(tilt: &[f64; 4], max_thrust_n: f64) -> Self {
        let pair =
            |i: usize, j: usize| (-tilt[i].min(tilt[j]), max_thrust_n - tilt[i].max(tilt[j]));
        Self {
            positive: pair(0, 2),
            negative: pair(1, 3),
        }
    }

    /// Least mean thrust at a yaw share of each rotor.
    fn least(&self, yaw: f64) -> f64 {
        (self.positive.0 - yaw).max(self.negative.0 + yaw)
    }

    /// Greatest mean thrust at a yaw share of each rotor.
    fn greatest(&self, yaw: f64) -> f64 {
        (self.positive.1 - yaw).min(self.negative.1 + yaw)
    }

    /// The mean thrust nearest to `mean` that some yaw between zero and `yaw` allows.
    ///
    /// `least` and `greatest` are lowest and highest where their two lines cross, or as near to
    /// there as the interval of yaw goes.
    fn mean_nearest(&self, mean: f64, yaw: f64) -> f64 {
        let within = |w: f64| w.max(yaw.min(0.0)).min(yaw.max(0.0));
        let low = self.least(within(0.5 * (self.positive.0 - self.negative.0)));
        let high = self.greatest(within(0.5 * (self.positive.1 - self.negative.1)));
        mean.min(high).max(low)
    }

    /// The yaw nearest to `yaw` that leaves the mean thrust as it is.
    fn yaw_nearest(&self, yaw: f64, mean: f64) -> f64 {
        let low = (self.positive.0 - mean).max(mean - self.negative.1);
        let high = (self.positive.1 - mean).min(mean - self.negative.0);
        yaw.min(high).max(low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector4;
    use proptest::prelude::*;

    const MAX_N: f64 = 6.0;

    fn mixer(layout: Layout) -> Mixer {
        Mixer::new(&AirframeFacts {
            mass_kg: 1.0,
            inertia_kg_m2: [0.01, 0.01, 0.02],
            arm_length_m: 0.2,
            layout,
            thrust_to_torque_m: 0.016,
            max_thrust_per_rotor_n: MAX_N,
        })
        .unwrap()
    }

    fn layout() -> impl Strategy<Value = Layout> {
        prop_oneof![Just(Layout::Plus), Just(Layout::X)]
    }

    /// Collective thrust and torque that a mix gives.
    fn given(mixer: &Mixer, mix: &Mix) -> Vector4<f64> {
        mixer.allocation() * Vector4::from(mix.rotor_thrusts_n)
    }

    proptest! {
        #[test]
        fn mixing_inverts_the_allocation(
            layout in layout(),
            f in prop::array::uniform4(0.0..MAX_N),
        ) {
            let mixer = mixer(layout);
            let wanted = mixer.allocation() * Vector4::from(f);
            let mix = mixer.mix(wanted[0], &wanted.fixed_rows::<3>(1).into_owned());
            for i in 0..4 {
                prop_assert!((mix.rotor_thrusts_n[i] - f[i]).abs() < 1e-12);
            }
        }

        #[test]
        fn rotors_stay_within_their_limits(
            layout in layout(),
            thrust in -50.0..100.0,
            torque in prop::array::uniform3(-5.0..5.0),
        ) {
            let mix = mixer(layout).mix(thrust, &Vector3::from(torque));
            for f in mix.rotor_thrusts_n {
                prop_assert!((0.0..=MAX_N).contains(&f));
            }
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&mix.yaw_share));
        }

        #[test]
        fn roll_and_pitch_survive_whatever_thrust_and_yaw_are_asked(
            layout in layout(),
            f in prop::array::uniform4(0.0..MAX_N),
            thrust in -50.0..100.0,
            yaw_torque in -5.0..5.0,
        ) {
            // Torque of rotor thrusts within their limits is feasible at some collective.
            let mixer = mixer(layout);
            let feasible = mixer.allocation() * Vector4::from(f);
            let wanted = Vector3::new(feasible[1], feasible[2], yaw_torque);
            let given = given(&mixer, &mixer.mix(thrust, &wanted));
            prop_assert!((given[1] - wanted.x).abs() < 1e-12);
            prop_assert!((given[2] - wanted.y).abs() < 1e-12);
        }

        #[test]
        fn infeasible_roll_and_pitch_keep_their_direction(
            layout in layout(),
            roll in 2.0..20.0,
            pitch in -20.0..20.0,
        ) {
            let mixer = mixer(layout);
            let mix = mixer.mix(12.0, &Vector3::new(roll, pitch, 0.0));
            let given = given(&mixer, &mix);
            prop_assert!((given[1] - roll * mix.roll_pitch_share).abs() < 1e-12);
            prop_assert!((given[2] - pitch * mix.roll_pitch_share).abs() < 1e-12);
            prop_assert!(mix.roll_pitch_share < 1.0);
        }
    }

    #[test]
    fn yaw_gives_way_to_thrust() {
        let mixer = mixer(Layout::X);
        let mix = mixer.mix(4.0 * MAX_N, &Vector3::new(0.0, 0.0, 0.1));
        assert_eq!((mix.thrust_n, mix.yaw_share), (4.0 * MAX_N, 0.0));
    }

    #[test]
    fn left_rotors_push_for_positive_roll_and_rear_rotors_for_positive_pitch() {
        let f = mixer(Layout::X)
            .mix(12.0, &Vector3::new(0.1, 0.0, 0.0))
            .rotor_thrusts_n;
        assert!(f[0] > 3.0 && f[1] > 3.0 && f[2] < 3.0 && f[3] < 3.0);
        let f = mixer(Layout::Plus)
            .mix(12.0, &Vector3::new(0.0, 0.1, 0.0))
            .rotor_thrusts_n;
        assert!(f[0] < 3.0 && f[2] > 3.0 && f[1] == 3.0 && f[3] == 3.0);
    }
}
