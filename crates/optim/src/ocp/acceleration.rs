//! Anderson acceleration of the sequence of inputs.
//!
//! Gauss-Newton curvatures make the steps of sequential quadratic programming shrink by a constant
//! factor, slowly where the curvature that they leave out is large. A few steps tell how the step
//! depends on the inputs, and where it would vanish.

use nalgebra::{SMatrix, SVector};

/// Greatest number of remembered differences.
const DEPTH: usize = 4;
/// Ridge of the least-squares fit, relative to its largest entry.
const RIDGE: f64 = 1e-9;
/// An accelerated step longer than this many plain ones is not believed.
const MAX_STRETCH: f64 = 8.0;

/// Differences between successive inputs and between their steps.
#[derive(Clone, Debug)]
struct Difference<const NU: usize> {
    inputs: Vec<SVector<f64, NU>>,
    steps: Vec<SVector<f64, NU>>,
}

/// What the last steps tell about the next.
#[derive(Clone, Debug)]
pub(super) struct Acceleration<const NU: usize> {
    differences: [Difference<NU>; DEPTH],
    /// Differences that are filled.
    filled: usize,
    /// The difference that is filled next.
    next: usize,
    last_inputs: Vec<SVector<f64, NU>>,
    last_steps: Vec<SVector<f64, NU>>,
    is_started: bool,
    /// The accelerated step.
    step: Vec<SVector<f64, NU>>,
}

impl<const NU: usize> Acceleration<NU> {
    pub fn new(intervals: usize) -> Self {
        let zeros = vec![SVector::zeros(); intervals];
        let difference = Difference {
            inputs: zeros.clone(),
            steps: zeros.clone(),
        };
        Self {
            differences: std::array::from_fn(|_| difference.clone()),
            filled: 0,
            next: 0,
            last_inputs: zeros.clone(),
            last_steps: zeros.clone(),
            is_started: false,
            step: zeros,
        }
    }

    pub fn forget(&mut self) {
        self.filled = 0;
        self.next = 0;
        self.is_started = false;
    }

    /// Takes note of the plain step from these inputs. The accelerated one, when enough is known.
    /// `scales` are the units of the inputs.
    pub fn accelerate(
        &mut self,
        inputs: &[SVector<f64, NU>],
        steps: &[SVector<f64, NU>],
        scales: &SVector<f64, NU>,
    ) -> Option<&[SVector<f64, NU>]> {
        if self.is_started {
            self.note(inputs, steps);
        }
        self.last_inputs.copy_from_slice(inputs);
        self.last_steps.copy_from_slice(steps);
        self.is_started = true;
        if self.filled == 0 {
            return None;
        }
        let shares = self.fit(steps, scales)?;
        self.step.copy_from_slice(steps);
        for (share, difference) in shares.iter().zip(&self.differences).take(self.filled) {
            let both = difference.inputs.iter().zip(&difference.steps);
            for (step, (du, dr)) in self.step.iter_mut().zip(both) {
                *step -= (du + dr) * *share;
            }
        }
        let size = |list: &[SVector<f64, NU>]| {
            let scaled = list.iter().map(|v| v.component_div(scales).norm_squared());
            scaled.sum::<f64>()
        };
        let stretch = size(&self.step) / size(steps);
        (stretch <= MAX_STRETCH * MAX_STRETCH).then_some(&self.step)
    }

    fn note(&mut self, inputs: &[SVector<f64, NU>], steps: &[SVector<f64, NU>]) {
        let difference = &mut self.differences[self.next];
        for k in 0..inputs.len() {
            difference.inputs[k] = inputs[k] - self.last_inputs[k];
            difference.steps[k] = steps[k] - self.last_steps[k];
        }
        self.next = (self.next + 1) % DEPTH;
        self.filled = (self.filled + 1).min(DEPTH);
    }

    /// The shares of the differences of steps that come closest to `steps`.
    fn fit(
        &self,
        steps: &[SVector<f64, NU>],
        scales: &SVector<f64, NU>,
    ) -> Option<SVector<f64, DEPTH>> {
        let weights = scales.map(|s| 1.0 / (s * s));
        let inner = |a: &[SVector<f64, NU>], b: &[SVector<f64, NU>]| {
            let products = a.iter().zip(b);
            let sum = |(a, b): (&SVector<f64, NU>, _)| a.component_mul(&weights).dot(b);
            products.map(sum).sum::<f64>()
        };
        let mut gram = SMatrix::<f64, DEPTH, DEPTH>::identity();
        let mut right = SVector::<f64, DEPTH>::zeros();
        for i in 0..self.filled {
            for j in 0..self.filled {
                gram[(i, j)] = inner(&self.differences[i].steps, &self.differences[j].steps);
            }
            right[i] = inner(&self.differences[i].steps, steps);
        }
        let ridge = RIDGE * (0..self.filled).fold(0.0, |most, i| gram[(i, i)].max(most));
        for i in 0..self.filled {
            gram[(i, i)] += ridge;
        }
        Some(gram.cholesky()?.solve(&right))
    }
}
