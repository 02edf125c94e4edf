//! A trajectory that meets the dynamics, and what it costs.

use nalgebra::SVector;

use super::problem::OptimalControl;
use super::qp::penalty;
use super::riccati::Riccati;

/// States and inputs over the horizon.
#[derive(Clone, Debug)]
pub(super) struct Trajectory<const NX: usize, const NU: usize> {
    pub states: Vec<SVector<f64, NX>>,
    pub inputs: Vec<SVector<f64, NU>>,
    /// Costs and penalties; not finite when the trajectory is without meaning.
    pub cost: f64,
    /// Greatest violation of a softened constraint.
    pub violation: f64,
}

/// A change of a trajectory in the linear model, and the feedback beside it.
pub(super) struct Change<'a, const NX: usize, const NU: usize> {
    pub states: &'a [SVector<f64, NX>],
    pub inputs: &'a [SVector<f64, NU>],
    pub riccati: &'a Riccati<NX, NU>,
}

impl<const NX: usize, const NU: usize> Trajectory<NX, NU> {
    pub fn new(intervals: usize) -> Self {
        Self {
            states: vec![SVector::zeros(); intervals + 1],
            inputs: vec![SVector::zeros(); intervals],
            cost: f64::INFINITY,
            violation: f64::INFINITY,
        }
    }

    pub fn is_finite(&self) -> bool {
        let states = self.states.iter().all(|x| x.iter().all(|v| v.is_finite()));
        states && self.inputs.iter().all(|u| u.iter().all(|v| v.is_finite()))
    }

    pub fn copy_from(&mut self, other: &Self) {
        self.states.copy_from_slice(&other.states);
        self.inputs.copy_from_slice(&other.inputs);
        self.cost = other.cost;
        self.violation = other.violation;
    }

    /// Brings the inputs within their bounds.
    pub fn clamp_inputs<P: OptimalControl<NX, NU>>(&mut self, problem: &P) {
        for (k, input) in self.inputs.iter_mut().enumerate() {
            *input = clamped(problem, k, input);
        }
    }

    /// Flies the inputs of `base` through the dynamics.
    pub fn roll_out<P: OptimalControl<NX, NU>>(&mut self, problem: &P, base: &Self) {
        self.states[0] = base.states[0];
        for k in 0..self.inputs.len() {
            self.inputs[k] = base.inputs[k];
            self.states[k + 1] = problem.next(k, &self.states[k], &self.inputs[k]);
        }
        self.weigh(problem);
    }

    /// Flies `base` changed by `share` of `change` through the dynamics, with its feedback.
    pub fn roll_out_changed<P: OptimalControl<NX, NU>>(
        &mut self,
        problem: &P,
        base: &Self,
        change: &Change<'_, NX, NU>,
        share: f64,
    ) {
        self.states[0] = base.states[0];
        for k in 0..self.inputs.len() {
            let off = self.states[k] - base.states[k] - change.states[k] * share;
            let mut input = base.inputs[k] + change.inputs[k] * share;
            input += change.riccati.gain_transposed(k).tr_mul(&off);
            self.inputs[k] = clamped(problem, k, &input);
            self.states[k + 1] = problem.next(k, &self.states[k], &self.inputs[k]);
        }
        self.weigh(problem);
    }

    /// Sets cost and violation.
    fn weigh<P: OptimalControl<NX, NU>>(&mut self, problem: &P) {
        (self.cost, self.violation) = weigh(problem, &self.states, &self.inputs);
    }
}

/// Costs and penalties of states and inputs, infinite for those without meaning, and the greatest
/// violation of a softened constraint. There is one state more than inputs.
pub fn weigh<const NX: usize, const NU: usize, P: OptimalControl<NX, NU>>(
    problem: &P,
    states: &[SVector<f64, NX>],
    inputs: &[SVector<f64, NU>],
) -> (f64, f64) {
    let (mut cost, mut violation) = (0.0, 0.0_f64);
    // Costs and penalties may ignore a number that is not finite.
    let mut is_meaningful = states[inputs.len()].iter().all(|v| v.is_finite());
    for (k, x) in states.iter().enumerate() {
        let input = inputs.get(k).copied().unwrap_or_else(SVector::zeros);
        cost += problem.cost_value(k, x, &input);
        if k > 0 {
            problem.constraint_values(k, x, &mut |value, linear, quadratic| {
                cost += penalty(value, linear, quadratic);
                violation = violation.max(-value);
                is_meaningful &= value.is_finite();
            });
        }
    }
    (if is_meaningful { cost } else { f64::INFINITY }, violation)
}

fn clamped<const NX: usize, const NU: usize, P: OptimalControl<NX, NU>>(
    problem: &P,
    k: usize,
    input: &SVector<f64, NU>,
) -> SVector<f64, NU> {
    let (lower, upper) = problem.input_bounds(k);
    input.zip_zip_map(&lower, &upper, |u, low, high| u.max(low).min(high))
}
