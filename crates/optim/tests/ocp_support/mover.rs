//! A body that accelerates by tilting, with keep-out ellipsoids on its way: nine states, four
//! inputs.

use alula_optim::ocp::{OptimalControl, SoftConstraint, StageCost, Step};
use nalgebra::{SMatrix, SVector, Vector3};

pub const NX: usize = 9;
pub const NU: usize = 4;
/// Position, velocity, two tilts, heading.
pub type State = SVector<f64, NX>;
/// Two tilts, climb, turn.
pub type Input = SVector<f64, NU>;

const GRAVITY: f64 = 9.81;
const LAG_S: f64 = 0.24;
const CLIMB_LAG_S: f64 = 0.33;
const DRAG: f64 = 0.2;
pub const INTERVAL_S: f64 = 0.06;
const MAX_SPEED: [f64; 3] = [2.0, 2.0, 1.0];

pub fn max_input() -> Input {
    Input::new(0.209, 0.209, 1.0, 1.57)
}

/// What must be kept out of, moving steadily.
#[derive(Clone, Debug)]
pub struct Ellipsoid {
    pub centre: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub semi_axes: Vector3<f64>,
}

#[derive(Clone, Debug)]
pub struct Mover {
    pub intervals: usize,
    pub goal: Vector3<f64>,
    pub heading: f64,
    /// Weight of the final distance.
    pub pull: f64,
    pub ellipsoids: Vec<Ellipsoid>,
    /// Weights of violations: linear, quadratic.
    pub weights: (f64, f64),
}

impl Mover {
    pub fn new(goal: Vector3<f64>, start: Vector3<f64>, ellipsoids: Vec<Ellipsoid>) -> Self {
        Self {
            intervals: 25,
            goal,
            heading: 0.0,
            pull: 8.0 / (goal - start).norm_squared().max(1.0),
            ellipsoids,
            weights: (50.0, 200.0),
        }
    }

    fn rate(x: &State, u: &Input) -> State {
        let (s, c) = x[8].sin_cos();
        let (forward, left) = (GRAVITY * x[7].tan(), -GRAVITY * x[6].tan());
        State::from_column_slice(&[
            x[3],
            x[4],
            x[5],
            c * forward - s * left - DRAG * x[3],
            s * forward + c * left - DRAG * x[4],
            (u[2] - x[5]) / CLIMB_LAG_S,
            (u[0] - x[6]) / LAG_S,
            (u[1] - x[7]) / LAG_S,
            u[3],
        ])
    }

    fn rate_by_state(x: &State) -> SMatrix<f64, NX, NX> {
        let (s, c) = x[8].sin_cos();
        let (forward, left) = (GRAVITY * x[7].tan(), -GRAVITY * x[6].tan());
        let by_forward = GRAVITY * (1.0 + x[7].tan().powi(2));
        let by_left = -GRAVITY * (1.0 + x[6].tan().powi(2));
        let mut a = SMatrix::zeros();
        for i in 0..3 {
            a[(i, i + 3)] = 1.0;
        }
        a[(3, 3)] = -DRAG;
        a[(4, 4)] = -DRAG;
        a[(5, 5)] = -1.0 / CLIMB_LAG_S;
        a[(6, 6)] = -1.0 / LAG_S;
        a[(7, 7)] = -1.0 / LAG_S;
        a[(3, 6)] = -s * by_left;
        a[(3, 7)] = c * by_forward;
        a[(3, 8)] = -s * forward - c * left;
        a[(4, 6)] = c * by_left;
        a[(4, 7)] = s * by_forward;
        a[(4, 8)] = c * forward - s * left;
        a
    }

    fn rate_by_input() -> SMatrix<f64, NX, NU> {
        let mut b = SMatrix::zeros();
        b[(5, 2)] = 1.0 / CLIMB_LAG_S;
        b[(6, 0)] = 1.0 / LAG_S;
        b[(7, 1)] = 1.0 / LAG_S;
        b[(8, 3)] = 1.0;
        b
    }

    /// The offset from an ellipsoid in its axes, and how far that is.
    fn offset(&self, k: usize, x: &State, ellipsoid: &Ellipsoid) -> (Vector3<f64>, f64) {
        let centre = ellipsoid.centre + ellipsoid.velocity * (k as f64 * INTERVAL_S);
        let q = (x.fixed_rows::<3>(0) - centre).component_div(&ellipsoid.semi_axes);
        // Smooth at the centre.
        (q, (q.norm_squared() + 1e-6).sqrt())
    }

    /// The soft push away from an ellipsoid: value and derivative by the distance.
    fn nearness(distance: f64) -> (f64, f64) {
        let value = 0.5 * (1.0 - (5.0 * (distance - 1.4)).tanh());
        (value, -10.0 * value * (1.0 - value))
    }
}

impl OptimalControl<NX, NU> for Mover {
    fn intervals(&self) -> usize {
        self.intervals
    }

    fn next(&self, _: usize, x: &State, u: &Input) -> State {
        let h = INTERVAL_S;
        let k1 = Self::rate(x, u);
        let k2 = Self::rate(&(x + k1 * (h / 2.0)), u);
        let k3 = Self::rate(&(x + k2 * (h / 2.0)), u);
        let k4 = Self::rate(&(x + k3 * h), u);
        x + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0)
    }

    fn step(&self, _: usize, x: &State, u: &Input) -> Step<NX, NU> {
        let h = INTERVAL_S;
        let (mut sum, mut sum_x, mut sum_u) = (State::zeros(), SMatrix::zeros(), SMatrix::zeros());
        let (mut at, mut at_x) = (*x, SMatrix::<f64, NX, NX>::identity());
        let mut at_u = SMatrix::<f64, NX, NU>::zeros();
        for (weight, ahead) in [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)] {
            let (k, by_state) = (Self::rate(&at, u), Self::rate_by_state(&at));
            let (k_x, k_u) = (by_state * at_x, by_state * at_u + Self::rate_by_input());
            sum += k * weight;
            sum_x += k_x * weight;
            sum_u += k_u * weight;
            at = x + k * (h * ahead);
            at_x = SMatrix::identity() + k_x * (h * ahead);
            at_u = k_u * (h * ahead);
        }
        Step {
            next: x + sum * (h / 6.0),
            a: SMatrix::identity() + sum_x * (h / 6.0),
            b: sum_u * (h / 6.0),
        }
    }

    fn input_bounds(&self, _: usize) -> (Input, Input) {
        (-max_input(), max_input())
    }

    fn cost_value(&self, k: usize, x: &State, u: &Input) -> f64 {
        let mut cost = StageCost::default();
        self.cost(k, x, u, &mut cost);
        cost.value
    }

    fn cost(&self, k: usize, x: &State, u: &Input, cost: &mut StageCost<NX, NU>) {
        *cost = StageCost::default();
        let is_last = k == self.intervals;
        let mut add = |i: usize, weight: f64, off: f64| {
            cost.value += weight * off * off;
            cost.x[i] += 2.0 * weight * off;
            cost.xx[(i, i)] += 2.0 * weight;
        };
        for i in 0..3 {
            let weight = if is_last {
                self.pull
            } else {
                0.01 * self.pull / 8.0
            };
            add(i, weight, x[i] - self.goal[i]);
            add(i + 3, 0.005, x[i + 3]);
        }
        add(8, if is_last { 0.5 } else { 0.025 }, x[8] - self.heading);
        if !is_last {
            for (i, most) in max_input().iter().enumerate() {
                let weight = 0.1 / (most * most);
                cost.value += weight * u[i] * u[i];
                cost.u[i] += 2.0 * weight * u[i];
                cost.uu[(i, i)] += 2.0 * weight;
            }
        }
        for ellipsoid in &self.ellipsoids {
            let (q, distance) = self.offset(k, x, ellipsoid);
            let (near, by_distance) = Self::nearness(distance);
            let gradient = q.component_div(&ellipsoid.semi_axes) * (by_distance / distance);
            cost.value += near * near;
            let mut x3 = cost.x.fixed_rows_mut::<3>(0);
            x3 += gradient * (2.0 * near);
            let mut xx3 = cost.xx.fixed_view_mut::<3, 3>(0, 0);
            xx3 += gradient * gradient.transpose() * 2.0;
        }
    }

    fn max_constraints(&self) -> usize {
        6 + self.ellipsoids.len()
    }

    fn constraints(&self, k: usize, x: &State, take: &mut dyn FnMut(&SoftConstraint<NX>)) {
        let (linear, quadratic) = self.weights;
        for i in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut gradient = State::zeros();
                gradient[3 + i] = sign;
                take(&SoftConstraint {
                    value: MAX_SPEED[i] + sign * x[3 + i],
                    gradient,
                    linear,
                    quadratic,
                });
            }
        }
        for ellipsoid in &self.ellipsoids {
            let (q, distance) = self.offset(k, x, ellipsoid);
            let mut gradient = State::zeros();
            let normal = q.component_div(&ellipsoid.semi_axes) / distance;
            gradient.fixed_rows_mut::<3>(0).copy_from(&normal);
            take(&SoftConstraint {
                value: distance - 1.0,
                gradient,
                linear,
                quadratic,
            });
        }
    }

    fn constraint_values(&self, k: usize, x: &State, take: &mut dyn FnMut(f64, f64, f64)) {
        let (linear, quadratic) = self.weights;
        for i in 0..3 {
            take(MAX_SPEED[i] - x[3 + i], linear, quadratic);
            take(MAX_SPEED[i] + x[3 + i], linear, quadratic);
        }
        for ellipsoid in &self.ellipsoids {
            take(self.offset(k, x, ellipsoid).1 - 1.0, linear, quadratic);
        }
    }
}
