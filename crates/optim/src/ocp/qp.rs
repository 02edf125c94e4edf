//! The subproblem: quadratic costs, affine dynamics, input bounds, softened affine constraints.

use nalgebra::SVector;

use super::kernels::dot;
use super::problem::{SoftConstraint, StageCost, Step};

/// Minimise over `x_1..x_N`, `u_0..u_{N-1}`
///
/// ```text
/// sum_k [ value + x'x_k + u'u_k + 1/2 (x_k' xx x_k + 2 u_k' ux x_k + u_k' uu u_k) ]  +  penalties
/// subject to  x_{k+1} = a x_k + b u_k + next,  x_0 = initial,  lower <= u_k <= upper,
/// ```
///
/// where a softened constraint's value at `x_k` is `value + gradient' x_k`.
#[derive(Clone, Debug, PartialEq)]
pub struct StageQp<const NX: usize, const NU: usize> {
    /// `x_0`.
    pub initial: SVector<f64, NX>,
    /// The dynamics of the N intervals; `next` is the constant part.
    pub steps: Vec<Step<NX, NU>>,
    /// The costs of the N + 1 points; at the last the terms with the input do not count.
    pub costs: Vec<StageCost<NX, NU>>,
    /// Bounds of the N inputs, lower first.
    pub bounds: Vec<(SVector<f64, NU>, SVector<f64, NU>)>,
    /// The softened constraints of the N + 1 points; those of the first do not count.
    pub constraints: Vec<Vec<SoftConstraint<NX>>>,
}

impl<const NX: usize, const NU: usize> StageQp<NX, NU> {
    /// A program of zeros without bounds, with room for `max_constraints` at every point.
    pub fn new(intervals: usize, max_constraints: usize) -> Self {
        let step = Step {
            next: SVector::zeros(),
            a: nalgebra::SMatrix::zeros(),
            b: nalgebra::SMatrix::zeros(),
        };
        let bound = SVector::repeat(f64::INFINITY);
        Self {
            initial: SVector::zeros(),
            steps: vec![step; intervals],
            costs: vec![StageCost::default(); intervals + 1],
            bounds: vec![(-bound, bound); intervals],
            constraints: (0..=intervals)
                .map(|_| Vec::with_capacity(max_constraints))
                .collect(),
        }
    }

    /// Number of intervals N.
    pub fn intervals(&self) -> usize {
        self.steps.len()
    }

    /// Costs and penalties of a trajectory, whether or not it meets the dynamics and bounds.
    pub fn objective(&self, states: &[SVector<f64, NX>], inputs: &[SVector<f64, NU>]) -> f64 {
        let last = self.intervals();
        let mut sum = 0.0;
        for k in 0..=last {
            let (cost, x) = (&self.costs[k], &states[k]);
            sum += cost.value + x.dot(&(cost.x + 0.5 * (cost.xx * x)));
            if k < last {
                let u = &inputs[k];
                sum += u.dot(&(cost.u + cost.ux * x + 0.5 * (cost.uu * u)));
            }
            if k > 0 {
                sum += self.penalties(k, x);
            }
        }
        sum
    }

    fn penalties(&self, k: usize, x: &SVector<f64, NX>) -> f64 {
        let penalty = |row: &SoftConstraint<NX>| {
            let value = row.value + dot(&row.gradient.data.0[0], &x.data.0[0]);
            penalty(value, row.linear, row.quadratic)
        };
        self.constraints[k].iter().map(penalty).sum()
    }
}

/// What a softened constraint with this value costs.
pub(super) fn penalty(value: f64, linear: f64, quadratic: f64) -> f64 {
    let violation = (-value).max(0.0);
    violation * (linear + quadratic * violation)
}

/// Settings of [`super::StageQpSolver`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageQpSettings {
    /// Greatest number of Newton steps; each is one Riccati recursion, or its vector part alone.
    pub max_iterations: u32,
    /// What an input may exceed its bounds by, and what a constraint may be off its kink by
    /// (in the units of input and constraint).
    pub tolerance: f64,
    /// Stiffness that stands for a bound at first, relative to the largest curvature in the inputs.
    pub bound_stiffness: f64,
    /// Stiffness that stands for a constraint's kink at first, relative to
    /// `linear + 2 quadratic` of the constraint, per unit of the constraint.
    pub kink_stiffness: f64,
}

impl Default for StageQpSettings {
    fn default() -> Self {
        Self {
            max_iterations: 60,
            tolerance: 1e-6,
            bound_stiffness: 1e2,
            kink_stiffness: 1e1,
        }
    }
}

/// How the solution of a subproblem ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StageQpExit {
    /// The point meets the optimality conditions.
    Converged,
    /// The iterations ran out. The point meets the dynamics.
    IterationLimit {
        /// What bounds are exceeded and kinks missed by.
        residual: f64,
    },
    /// A number is not finite; the point is without meaning.
    NotFinite,
}

/// How the solution of a subproblem went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageQpReport {
    /// How it ended.
    pub exit: StageQpExit,
    /// Newton steps.
    pub iterations: u32,
    /// Riccati recursions among them; the other steps needed the vector part alone.
    pub factorisations: u32,
}
