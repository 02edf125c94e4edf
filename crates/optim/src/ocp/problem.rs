//! What an optimal control problem must answer.

use nalgebra::{SMatrix, SVector};

/// A step of the dynamics with its derivatives.
#[derive(Clone, Debug, PartialEq)]
pub struct Step<const NX: usize, const NU: usize> {
    /// The next state.
    pub next: SVector<f64, NX>,
    /// Derivative of the next state with respect to the state.
    pub a: SMatrix<f64, NX, NX>,
    /// Derivative of the next state with respect to the input.
    pub b: SMatrix<f64, NX, NU>,
}

/// A cost with its gradient and a positive semi-definite model of its curvature (Gauss-Newton).
#[derive(Clone, Debug, PartialEq)]
pub struct StageCost<const NX: usize, const NU: usize> {
    /// The cost.
    pub value: f64,
    /// Gradient with respect to the state.
    pub x: SVector<f64, NX>,
    /// Gradient with respect to the input; zero at the last point.
    pub u: SVector<f64, NU>,
    /// Curvature in the state.
    pub xx: SMatrix<f64, NX, NX>,
    /// Curvature between input (rows) and state (columns).
    pub ux: SMatrix<f64, NU, NX>,
    /// Curvature in the input; the solver needs it positive definite before the last point.
    pub uu: SMatrix<f64, NU, NU>,
}

impl<const NX: usize, const NU: usize> Default for StageCost<NX, NU> {
    fn default() -> Self {
        Self {
            value: 0.0,
            x: SVector::zeros(),
            u: SVector::zeros(),
            xx: SMatrix::zeros(),
            ux: SMatrix::zeros(),
            uu: SMatrix::zeros(),
        }
    }
}

/// A softened constraint `value >= 0` on the state: a violation `s = max(0, -value)` costs
/// `linear * s + quadratic * s^2`. With a large enough `linear` it is exact: it is violated only
/// where nothing else is possible.
#[derive(Clone, Debug, PartialEq)]
pub struct SoftConstraint<const NX: usize> {
    /// The constraint's value; it holds when this is not negative.
    pub value: f64,
    /// Its gradient with respect to the state.
    pub gradient: SVector<f64, NX>,
    /// Weight of the violation.
    pub linear: f64,
    /// Weight of its square.
    pub quadratic: f64,
}

/// Minimise over states `x_1..x_N` and inputs `u_0..u_{N-1}`
///
/// ```text
/// sum_{k<N} cost(k, x_k, u_k) + cost(N, x_N) + penalties of the softened constraints at k = 1..N
/// subject to  x_{k+1} = f(k, x_k, u_k),  x_0 given,  lower(k) <= u_k <= upper(k).
/// ```
pub trait OptimalControl<const NX: usize, const NU: usize> {
    /// Number of intervals N, at least one and constant.
    fn intervals(&self) -> usize;

    /// The dynamics of interval `k` alone.
    fn next(&self, k: usize, x: &SVector<f64, NX>, u: &SVector<f64, NU>) -> SVector<f64, NX>;

    /// The dynamics of interval `k` with derivatives.
    fn step(&self, k: usize, x: &SVector<f64, NX>, u: &SVector<f64, NU>) -> Step<NX, NU>;

    /// Bounds of the input in interval `k`, lower first.
    fn input_bounds(&self, k: usize) -> (SVector<f64, NU>, SVector<f64, NU>);

    /// The cost at point `k` alone; at `k = N` the input does not count.
    fn cost_value(&self, k: usize, x: &SVector<f64, NX>, u: &SVector<f64, NU>) -> f64;

    /// The cost at point `k` with derivatives, written over all of `cost`.
    fn cost(
        &self,
        k: usize,
        x: &SVector<f64, NX>,
        u: &SVector<f64, NU>,
        cost: &mut StageCost<NX, NU>,
    );

    /// Greatest number of softened constraints at any point, constant.
    fn max_constraints(&self) -> usize;

    /// Calls `take` for every softened constraint at point `k` (1 to N), always the same number in
    /// the same order for equal `k`.
    fn constraints(
        &self,
        k: usize,
        x: &SVector<f64, NX>,
        take: &mut dyn FnMut(&SoftConstraint<NX>),
    );

    /// Calls `take` with the value and the two weights (linear, quadratic) of every softened
    /// constraint at point `k`, in the order of [`Self::constraints`].
    fn constraint_values(
        &self,
        k: usize,
        x: &SVector<f64, NX>,
        take: &mut dyn FnMut(f64, f64, f64),
    );
}
