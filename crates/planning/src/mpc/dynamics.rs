//! The vehicle as the planner sees it: tilt, climb rate and yaw rate follow their commands.

use alula_geometry::GRAVITY_M_S2;
use alula_optim::ocp::Step;
use alula_parameters::{ParameterError, Parameters, facts};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector3};

/// Size of the state.
pub const NX: usize = 9;
/// Size of the input.
pub const NU: usize = 4;

/// Position (world, m), velocity (world, m/s), roll, pitch, yaw (rad).
pub type State = SVector<f64, NX>;
/// Commanded roll and pitch (rad), climb rate (m/s, up), yaw rate (rad/s).
pub type Input = SVector<f64, NU>;

facts! {
    /// Response of a vehicle to tilt and climb commands (document L, appendix A-4, table A-3).
    /// Roll belongs to motion along the body's y axis, pitch to its x axis, which is forward.
    pub struct TiltModel {
        /// Climb rate reached per climb rate commanded.
        pub gain_climb: f64, within(0.1, 10.0);
        /// Time constant of the climb rate, s.
        pub tau_climb_s: f64, within(0.02, 5.0);
        /// Roll reached per roll commanded.
        pub gain_roll: f64, within(0.1, 10.0);
        /// Pitch reached per pitch commanded.
        pub gain_pitch: f64, within(0.1, 10.0);
        /// Time constant of roll, s.
        pub tau_roll_s: f64, within(0.02, 5.0);
        /// Time constant of pitch, s.
        pub tau_pitch_s: f64, within(0.02, 5.0);
        /// Deceleration by air per speed along the heading, 1/s.
        pub drag_x_1_s: f64, within(0.0, 5.0);
        /// Deceleration by air per speed across the heading, 1/s.
        pub drag_y_1_s: f64, within(0.0, 5.0);
    }
}

impl TiltModel {
    /// The vehicle of document L, table A-3.
    pub fn bebop() -> Self {
        Self {
            gain_climb: 1.2270,
            tau_climb_s: 0.3367,
            gain_roll: 1.0181,
            gain_pitch: 1.0167,
            tau_roll_s: 0.2386,
            tau_pitch_s: 0.2386,
            drag_x_1_s: 0.1840,
            drag_y_1_s: 0.2007,
        }
    }
}

/// How roll accelerates the vehicle across its heading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sideways {
    /// `-g tan(roll) / cos(pitch)`: exact while thrust carries the weight.
    #[default]
    Exact,
    /// `-g tan(roll)`, for comparison with other implementations.
    Decoupled,
}

/// A first-order lag through the four evaluations of a Runge-Kutta step with constant input: at
/// evaluation `i` the lagged value is `kept[i] y + (1 - kept[i]) gain u`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lag {
    gain: f64,
    tau_s: f64,
    kept: [f64; 4],
    /// Share kept over the whole step.
    end: f64,
    /// Mean share kept in the integral over the step.
    mean: f64,
}

impl Lag {
    fn new(gain: f64, tau_s: f64, interval_s: f64) -> Self {
        let z = interval_s / tau_s;
        let second = 1.0 - 0.5 * z;
        let third = 1.0 - 0.5 * z * second;
        let fourth = 1.0 - z * third;
        let kept = [1.0, second, third, fourth];
        let mean = (1.0 + 2.0 * second + 2.0 * third + fourth) / 6.0;
        Self {
            gain,
            tau_s,
            kept,
            end: 1.0 - z * mean,
            mean,
        }
    }

    /// Value where the share `kept` of the start is left.
    fn blend(&self, kept: f64, start: f64, command: f64) -> f64 {
        kept * start + (1.0 - kept) * self.gain * command
    }

    fn rate(&self, value: f64, command: f64) -> f64 {
        (self.gain * command - value) / self.tau_s
    }
}

/// [`TiltModel`] over intervals of constant input, by one Runge-Kutta step of order four each
/// (document L, equations, with the horizontal axes turned by the yaw).
#[derive(Clone, Debug, PartialEq)]
pub struct TiltDynamics {
    interval_s: f64,
    gravity_m_s2: f64,
    sideways: Sideways,
    climb: Lag,
    roll: Lag,
    pitch: Lag,
    drag: Vector2<f64>,
}

/// Shares of the interval at which the four evaluations lie.
const SHARES: [f64; 4] = [0.0, 0.5, 0.5, 1.0];
/// Their weights, times six.
const WEIGHTS: [f64; 4] = [1.0, 2.0, 2.0, 1.0];

/// What horizontal velocity depends on: vx, vy, roll, pitch, yaw, then the commands of roll,
/// pitch and yaw rate.
type Slopes = SMatrix<f64, 2, 8>;
/// Columns of [`Slopes`] that are states, and their rows in the state.
const STATE_COLUMNS: [(usize, usize); 5] = [(0, 3), (1, 4), (2, 6), (3, 7), (4, 8)];
/// Columns of [`Slopes`] that are inputs, and their rows in the input.
const INPUT_COLUMNS: [(usize, usize); 3] = [(5, 0), (6, 1), (7, 3)];

impl TiltDynamics {
    /// The dynamics over intervals of this length.
    ///
    /// # Errors
    /// A value of the model outside its range.
    pub fn new(model: &TiltModel, interval_s: f64) -> Result<Self, ParameterError> {
        model.validate()?;
        Ok(Self {
            interval_s,
            gravity_m_s2: GRAVITY_M_S2,
            sideways: Sideways::Exact,
            climb: Lag::new(model.gain_climb, model.tau_climb_s, interval_s),
            roll: Lag::new(model.gain_roll, model.tau_roll_s, interval_s),
            pitch: Lag::new(model.gain_pitch, model.tau_pitch_s, interval_s),
            drag: Vector2::new(model.drag_x_1_s, model.drag_y_1_s),
        })
    }

    /// The same with another acceleration of gravity (m/s^2) and another effect of roll.
    pub fn with(mut self, gravity_m_s2: f64, sideways: Sideways) -> Self {
        self.gravity_m_s2 = gravity_m_s2;
        self.sideways = sideways;
        self
    }

    /// Length of an interval, s.
    pub fn interval_s(&self) -> f64 {
        self.interval_s
    }

    /// Acceleration, world, m/s^2, at a state under an input.
    pub fn acceleration(&self, x: &State, u: &Input) -> Vector3<f64> {
        let turned = Turned::at(x[8], &self.drag);
        let push = turned.rotation * self.push(x[6], x[7]);
        let horizontal = push - turned.drag * Vector2::new(x[3], x[4]);
        Vector3::new(horizontal.x, horizontal.y, self.climb.rate(x[5], u[2]))
    }

    /// Time derivative of the state.
    pub fn derivative(&self, x: &State, u: &Input) -> State {
        let a = self.acceleration(x, u);
        let roll = self.roll.rate(x[6], u[0]);
        let pitch = self.pitch.rate(x[7], u[1]);
        State::from_column_slice(&[x[3], x[4], x[5], a.x, a.y, a.z, roll, pitch, u[3]])
    }

    /// The state one interval later.
    pub fn next(&self, x: &State, u: &Input) -> State {
        let start = Vector2::new(x[3], x[4]);
        let (mut rate, mut sum_v, mut sum_a) =
            (Vector2::zeros(), Vector2::zeros(), Vector2::zeros());
        for i in 0..4 {
            let velocity = start + rate * (SHARES[i] * self.interval_s);
            let turned = Turned::at(x[8] + SHARES[i] * self.interval_s * u[3], &self.drag);
            let roll = self.roll.blend(self.roll.kept[i], x[6], u[0]);
            let pitch = self.pitch.blend(self.pitch.kept[i], x[7], u[1]);
            rate = turned.rotation * self.push(roll, pitch) - turned.drag * velocity;
            sum_v += velocity * WEIGHTS[i];
            sum_a += rate * WEIGHTS[i];
        }
        self.assemble(x, u, &sum_v, &sum_a)
    }

    /// The state one interval later with its derivatives.
    pub fn step(&self, x: &State, u: &Input) -> Step<NX, NU> {
        let h = self.interval_s;
        let start = Vector2::new(x[3], x[4]);
        let (mut rate, mut sum_v, mut sum_a) =
            (Vector2::zeros(), Vector2::zeros(), Vector2::zeros());
        let (mut slope, mut slope_v, mut slope_a) =
            (Slopes::zeros(), Slopes::zeros(), Slopes::zeros());
        for i in 0..4 {
            let velocity = start + rate * (SHARES[i] * h);
            let mut velocity_slope = slope * (SHARES[i] * h);
            velocity_slope[(0, 0)] += 1.0;
            velocity_slope[(1, 1)] += 1.0;
            (rate, slope) = self.rate_with_slopes(i, x, u, &velocity, &velocity_slope);
            sum_v += velocity * WEIGHTS[i];
            sum_a += rate * WEIGHTS[i];
            slope_v += velocity_slope * WEIGHTS[i];
            slope_a += slope * WEIGHTS[i];
        }
        let next = self.assemble(x, u, &sum_v, &sum_a);
        let (a, b) = self.jacobians(&(slope_v * (h / 6.0)), &(slope_a * (h / 6.0)));
        Step { next, a, b }
    }

    /// Horizontal acceleration by tilt, heading axes, m/s^2.
    fn push(&self, roll: f64, pitch: f64) -> Vector2<f64> {
        let lift = match self.sideways {
            Sideways::Exact => 1.0 / pitch.cos(),
            Sideways::Decoupled => 1.0,
        };
        Vector2::new(pitch.tan(), -roll.tan() * lift) * self.gravity_m_s2
    }

    /// [`Self::push`] and its derivatives with respect to roll and pitch.
    fn push_with_slopes(&self, roll: f64, pitch: f64) -> [Vector2<f64>; 3] {
        let (g, tan_roll, tan_pitch) = (self.gravity_m_s2, roll.tan(), pitch.tan());
        let (lift, lift_slope) = match self.sideways {
            Sideways::Exact => {
                let lift = 1.0 / pitch.cos();
                (lift, lift * tan_pitch)
            }
            Sideways::Decoupled => (1.0, 0.0),
        };
        [
            Vector2::new(tan_pitch, -tan_roll * lift) * g,
            Vector2::new(0.0, -(1.0 + tan_roll * tan_roll) * lift) * g,
            Vector2::new(1.0 + tan_pitch * tan_pitch, -tan_roll * lift_slope) * g,
        ]
    }

    /// Horizontal acceleration at evaluation `i` and its derivatives.
    fn rate_with_slopes(
        &self,
        i: usize,
        x: &State,
        u: &Input,
        velocity: &Vector2<f64>,
        velocity_slope: &Slopes,
    ) -> (Vector2<f64>, Slopes) {
        let elapsed = SHARES[i] * self.interval_s;
        let (kept_roll, kept_pitch) = (self.roll.kept[i], self.pitch.kept[i]);
        let turned = Turned::at(x[8] + elapsed * u[3], &self.drag);
        let roll = self.roll.blend(kept_roll, x[6], u[0]);
        let pitch = self.pitch.blend(kept_pitch, x[7], u[1]);
        let [push, by_roll, by_pitch] = self.push_with_slopes(roll, pitch);
        let push = turned.rotation * push;
        let by_roll = turned.rotation * by_roll;
        let by_pitch = turned.rotation * by_pitch;
        let by_yaw = quarter(&push) - turned.drag_slope * velocity;

        let mut slope = -(turned.drag * velocity_slope);
        let mut add = |column: usize, value: Vector2<f64>| {
            slope[(0, column)] += value.x;
            slope[(1, column)] += value.y;
        };
        add(2, by_roll * kept_roll);
        add(3, by_pitch * kept_pitch);
        add(4, by_yaw);
        add(5, by_roll * ((1.0 - kept_roll) * self.roll.gain));
        add(6, by_pitch * ((1.0 - kept_pitch) * self.pitch.gain));
        add(7, by_yaw * elapsed);
        (push - turned.drag * velocity, slope)
    }

    /// The next state from the weighted sums of horizontal velocity and acceleration.
    fn assemble(&self, x: &State, u: &Input, sum_v: &Vector2<f64>, sum_a: &Vector2<f64>) -> State {
        let h = self.interval_s;
        State::from_column_slice(&[
            x[0] + sum_v.x * (h / 6.0),
            x[1] + sum_v.y * (h / 6.0),
            x[2] + h * self.climb.blend(self.climb.mean, x[5], u[2]),
            x[3] + sum_a.x * (h / 6.0),
            x[4] + sum_a.y * (h / 6.0),
            self.climb.blend(self.climb.end, x[5], u[2]),
            self.roll.blend(self.roll.end, x[6], u[0]),
            self.pitch.blend(self.pitch.end, x[7], u[1]),
            x[8] + h * u[3],
        ])
    }

    /// Derivatives of [`Self::assemble`] from those of horizontal position and velocity.
    fn jacobians(
        &self,
        position: &Slopes,
        velocity: &Slopes,
    ) -> (SMatrix<f64, NX, NX>, SMatrix<f64, NX, NU>) {
        let h = self.interval_s;
        let mut a = SMatrix::<f64, NX, NX>::identity();
        let mut b = SMatrix::<f64, NX, NU>::zeros();
        for row in 0..2 {
            for (column, state) in STATE_COLUMNS {
                a[(row, state)] += position[(row, column)];
                a[(3 + row, state)] += velocity[(row, column)];
            }
            for (column, input) in INPUT_COLUMNS {
                b[(row, input)] = position[(row, column)];
                b[(3 + row, input)] = velocity[(row, column)];
            }
        }
        a[(2, 5)] = h * self.climb.mean;
        b[(2, 2)] = h * (1.0 - self.climb.mean) * self.climb.gain;
        for (row, input, lag) in [(5, 2, &self.climb), (6, 0, &self.roll), (7, 1, &self.pitch)] {
            a[(row, row)] = lag.end;
            b[(row, input)] = (1.0 - lag.end) * lag.gain;
        }
        b[(8, 3)] = h;
        (a, b)
    }
}

/// A vector turned by a quarter to the left.
fn quarter(v: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

/// What depends on the yaw.
struct Turned {
    /// From heading axes to the world.
    rotation: Matrix2<f64>,
    /// Drag in world axes, 1/s.
    drag: Matrix2<f64>,
    /// Its derivative with respect to the yaw.
    drag_slope: Matrix2<f64>,
}

impl Turned {
    fn at(yaw: f64, drag: &Vector2<f64>) -> Self {
        let (s, c) = yaw.sin_cos();
        let (difference, double_sine, double_cosine) =
            (drag.x - drag.y, 2.0 * s * c, c * c - s * s);
        let off = difference * s * c;
        let turn = difference * double_cosine;
        Self {
            rotation: Matrix2::new(c, -s, s, c),
            drag: Matrix2::new(
                drag.x * c * c + drag.y * s * s,
                off,
                off,
                drag.x * s * s + drag.y * c * c,
            ),
            drag_slope: Matrix2::new(
                -difference * double_sine,
                turn,
                turn,
                difference * double_sine,
            ),
        }
    }
}
