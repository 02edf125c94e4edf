//! The optimal control problem: costs and constraints at every point of the horizon.

use alula_optim::ocp::{OptimalControl, SoftConstraint, StageCost, Step};
use nalgebra::{SVector, Vector3};

use super::dynamics::{Input, NU, NX, State, TiltDynamics};
use super::keepout::{Clearance, Keepout};
use super::view::{FieldOfView, VIEW_SIDES};

/// Weights of the violation of a softened constraint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Penalty {
    /// Per unit of violation.
    pub linear: f64,
    /// Per squared unit.
    pub quadratic: f64,
}

/// A logistic step, `1 / (1 + exp(slope_1_m (distance - buffer_m)))`, squared and weighted as the
/// cost of being near an obstacle (document L, equation 6-9).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Potential {
    /// Steepness, 1/m.
    pub slope_1_m: f64,
    /// Distance from the volume at which the step is one half, m.
    pub buffer_m: f64,
}

/// The cost of horizontal speed above a limit: the squared softplus of the excess, whose slope is
/// the step of document L, equation 6-8.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedCost {
    /// Speed that should not be exceeded, m/s.
    pub limit_m_s: f64,
    /// Width of the transition, m/s.
    pub softness_m_s: f64,
    /// Weight of the squared excess, s^2/m^2.
    pub weight: f64,
}

/// What is wanted at one point of the horizon. All weights are of squares.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Where to be, world, m.
    pub target: Vector3<f64>,
    /// Weights of the distance from it, per axis, 1/m^2.
    pub position_weight: Vector3<f64>,
    /// Weights of the velocity, per axis, s^2/m^2.
    pub velocity_weight: Vector3<f64>,
    /// Yaw to have, rad, without jumps of whole turns.
    pub yaw_rad: f64,
    /// Weight of the difference from it, 1/rad^2.
    pub yaw_weight: f64,
    /// Limit of the horizontal speed.
    pub speed: Option<SpeedCost>,
    /// Weight of the potential of each obstacle.
    pub potential_weight: f64,
    /// Volumes to keep out of.
    pub keepouts: Vec<Keepout>,
}

impl Stage {
    /// A point at which nothing is wanted, with room for this many volumes.
    pub fn with_capacity(keepouts: usize) -> Self {
        Self {
            target: Vector3::zeros(),
            position_weight: Vector3::zeros(),
            velocity_weight: Vector3::zeros(),
            yaw_rad: 0.0,
            yaw_weight: 0.0,
            speed: None,
            potential_weight: 0.0,
            keepouts: Vec::with_capacity(keepouts),
        }
    }
}

/// The chance-constrained problem (document L, section 6-1), stated point by point.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// The vehicle.
    pub dynamics: TiltDynamics,
    /// Greatest inputs, both ways.
    pub input_limit: Input,
    /// Weight of the inputs as shares of their limits, squared.
    pub input_weight: f64,
    /// Shape of the potential of obstacles.
    pub potential: Potential,
    /// Quantile of the standard normal distribution for the allowed chance of collision.
    pub quantile: f64,
    /// Penalty of coming too near to an obstacle, per m.
    pub collision: Penalty,
    /// Greatest velocity along each axis (m/s, both ways) and the penalty per m/s.
    pub velocity_bound: Option<(Vector3<f64>, Penalty)>,
    /// Least and greatest height (world, m) and the penalty per m.
    pub height_band: Option<([f64; 2], Penalty)>,
    /// Volume to stay in and the penalty per m.
    pub view: Option<(FieldOfView, Penalty)>,
    /// The points, one more than intervals; all hold as many volumes from the second point on.
    pub stages: Vec<Stage>,
}

/// Constraints that a problem may state for the vehicle's velocity.
const VELOCITY_SIDES: usize = 6;

/// Constraints that a problem may state for its height.
pub(super) const HEIGHT_SIDES: usize = 2;

/// The logistic step `1 / (1 + exp(z))`, in a form that does not overflow.
fn step_down(z: f64) -> f64 {
    0.5 * (1.0 - (0.5 * z).tanh())
}

/// `ln(1 + exp(z))` without overflow.
fn softplus(z: f64) -> f64 {
    z.max(0.0) + (-z.abs()).exp().ln_1p()
}

/// Least horizontal speed used as a divisor, m/s.
const LEAST_SPEED_M_S: f64 = 1e-3;

/// Horizontal speed, differentiable at rest, m/s.
fn level_speed(x: &State) -> f64 {
    (x[3] * x[3] + x[4] * x[4] + LEAST_SPEED_M_S * LEAST_SPEED_M_S).sqrt()
}

fn position(x: &State) -> Vector3<f64> {
    Vector3::new(x[0], x[1], x[2])
}

impl Potential {
    /// Value at a distance and its derivative.
    fn at(&self, distance_m: f64) -> (f64, f64) {
        let value = step_down(self.slope_1_m * (distance_m - self.buffer_m));
        (value, -self.slope_1_m * value * (1.0 - value))
    }
}

impl SpeedCost {
    /// Residual at a speed and its derivative, without the weight.
    fn at(&self, speed_m_s: f64) -> (f64, f64) {
        let z = (speed_m_s - self.limit_m_s) / self.softness_m_s;
        (self.softness_m_s * softplus(z), step_down(-z))
    }
}

impl Problem {
    fn state_cost_value(&self, k: usize, x: &State) -> f64 {
        let stage = &self.stages[k];
        let p = position(x);
        let mut cost = 0.0;
        for i in 0..3 {
            cost += stage.position_weight[i] * (p[i] - stage.target[i]).powi(2);
            cost += stage.velocity_weight[i] * x[3 + i] * x[3 + i];
        }
        cost += stage.yaw_weight * (x[8] - stage.yaw_rad).powi(2);
        if let Some(speed) = &stage.speed {
            cost += speed.weight * speed.at(level_speed(x)).0.powi(2);
        }
        for keepout in &stage.keepouts {
            let (value, _) = self.potential.at(keepout.distance(&p).value);
            cost += stage.potential_weight * value * value;
        }
        cost
    }

    fn add_state_cost(&self, k: usize, x: &State, cost: &mut StageCost<NX, NU>) {
        let stage = &self.stages[k];
        for i in 0..3 {
            add_square(cost, i, stage.position_weight[i], x[i] - stage.target[i]);
            add_square(cost, 3 + i, stage.velocity_weight[i], x[3 + i]);
        }
        add_square(cost, 8, stage.yaw_weight, x[8] - stage.yaw_rad);
        if let Some(speed) = &stage.speed {
            add_speed(cost, x, speed);
        }
        let p = position(x);
        for keepout in &stage.keepouts {
            let distance = keepout.distance(&p);
            add_potential(cost, stage.potential_weight, &distance, &self.potential);
        }
    }
}

/// Adds `weight residual^2` of one state.
fn add_square(cost: &mut StageCost<NX, NU>, row: usize, weight: f64, residual: f64) {
    cost.value += weight * residual * residual;
    cost.x[row] += 2.0 * weight * residual;
    cost.xx[(row, row)] += 2.0 * weight;
}

fn add_speed(cost: &mut StageCost<NX, NU>, x: &State, speed: &SpeedCost) {
    let v = level_speed(x);
    let (residual, slope) = speed.at(v);
    let gradient = [slope * x[3] / v, slope * x[4] / v];
    cost.value += speed.weight * residual * residual;
    for i in 0..2 {
        cost.x[3 + i] += 2.0 * speed.weight * residual * gradient[i];
        for j in 0..2 {
            cost.xx[(3 + i, 3 + j)] += 2.0 * speed.weight * gradient[i] * gradient[j];
        }
    }
}

fn add_potential(
    cost: &mut StageCost<NX, NU>,
    weight: f64,
    distance: &Clearance,
    potential: &Potential,
) {
    let (value, slope) = potential.at(distance.value);
    let gradient = distance.gradient * slope;
    cost.value += weight * value * value;
    for i in 0..3 {
        cost.x[i] += 2.0 * weight * value * gradient[i];
        for j in 0..3 {
            cost.xx[(i, j)] += 2.0 * weight * gradient[i] * gradient[j];
        }
    }
}

fn in_position(gradient: &Vector3<f64>) -> SVector<f64, NX> {
    let mut g = SVector::<f64, NX>::zeros();
    g.fixed_rows_mut::<3>(0).copy_from(gradient);
    g
}

impl OptimalControl<NX, NU> for Problem {
    fn intervals(&self) -> usize {
        self.stages.len() - 1
    }

    fn next(&self, _k: usize, x: &State, u: &Input) -> State {
        self.dynamics.next(x, u)
    }

    fn step(&self, _k: usize, x: &State, u: &Input) -> Step<NX, NU> {
        self.dynamics.step(x, u)
    }

    fn input_bounds(&self, _k: usize) -> (Input, Input) {
        (-self.input_limit, self.input_limit)
    }

    fn cost_value(&self, k: usize, x: &State, u: &Input) -> f64 {
        let mut cost = self.state_cost_value(k, x);
        if k < self.intervals() {
            cost += self.input_weight * u.component_div(&self.input_limit).norm_squared();
        }
        cost
    }

    fn cost(&self, k: usize, x: &State, u: &Input, cost: &mut StageCost<NX, NU>) {
        *cost = StageCost::default();
        self.add_state_cost(k, x, cost);
        if k < self.intervals() {
            for i in 0..NU {
                let weight = self.input_weight / (self.input_limit[i] * self.input_limit[i]);
                cost.value += weight * u[i] * u[i];
                cost.u[i] = 2.0 * weight * u[i];
                cost.uu[(i, i)] = 2.0 * weight;
            }
        }
    }

    fn max_constraints(&self) -> usize {
        let keepouts = self.stages.iter().map(|s| s.keepouts.len()).max();
        keepouts.unwrap_or(0)
            + self.velocity_bound.map_or(0, |_| VELOCITY_SIDES)
            + self.height_band.map_or(0, |_| HEIGHT_SIDES)
            + self.view.map_or(0, |_| VIEW_SIDES)
    }

    fn constraints(&self, k: usize, x: &State, take: &mut dyn FnMut(&SoftConstraint<NX>)) {
        let p = position(x);
        let mut give = |value: f64, gradient: SVector<f64, NX>, penalty: &Penalty| {
            take(&SoftConstraint {
                value,
                gradient,
                linear: penalty.linear,
                quadratic: penalty.quadratic,
            });
        };
        for keepout in &self.stages[k].keepouts {
            let clearance = keepout.chance(&p, self.quantile);
            give(
                clearance.value,
                in_position(&clearance.gradient),
                &self.collision,
            );
        }
        if let Some((bound, penalty)) = &self.velocity_bound {
            for i in 0..3 {
                let mut gradient = SVector::zeros();
                gradient[3 + i] = 1.0;
                give(bound[i] - x[3 + i], -gradient, penalty);
                give(bound[i] + x[3 + i], gradient, penalty);
            }
        }
        if let Some(([low, high], penalty)) = &self.height_band {
            give(p.z - low, in_position(&Vector3::z()), penalty);
            give(high - p.z, in_position(&-Vector3::z()), penalty);
        }
        if let Some((view, penalty)) = &self.view {
            for (inside_m, gradient) in view.sides(&p) {
                give(inside_m, in_position(&gradient), penalty);
            }
        }
    }

    fn constraint_values(&self, k: usize, x: &State, take: &mut dyn FnMut(f64, f64, f64)) {
        let p = position(x);
        for keepout in &self.stages[k].keepouts {
            let value = keepout.chance_value(&p, self.quantile);
            take(value, self.collision.linear, self.collision.quadratic);
        }
        if let Some((bound, penalty)) = &self.velocity_bound {
            for i in 0..3 {
                take(bound[i] - x[3 + i], penalty.linear, penalty.quadratic);
                take(bound[i] + x[3 + i], penalty.linear, penalty.quadratic);
            }
        }
        if let Some(([low, high], penalty)) = &self.height_band {
            take(p.z - low, penalty.linear, penalty.quadratic);
            take(high - p.z, penalty.linear, penalty.quadratic);
        }
        if let Some((view, penalty)) = &self.view {
            for (inside_m, _) in view.sides(&p) {
                take(inside_m, penalty.linear, penalty.quadratic);
            }
        }
    }
}
