//! The Riccati recursion: one stage-structured equality-constrained program.

use nalgebra::{SMatrix, SVector};

use super::kernels::{add_product, add_times, add_transpose_times, mirror_lower};
use super::problem::{StageCost, Step};

/// A pivot below this share of the largest diagonal counts as not positive.
const PIVOT_FLOOR: f64 = 1e-12;
/// What such a pivot is raised by, as a share of the largest diagonal.
const PIVOT_LIFT: f64 = 1e-4;

/// Factor of one interval.
#[derive(Clone, Debug)]
struct Interval<const NX: usize, const NU: usize> {
    /// Curvature of the cost to go after the interval.
    after: SMatrix<f64, NX, NX>,
    /// Cholesky factor (lower) of the curvature in the input, with reciprocal diagonal.
    chol: SMatrix<f64, NU, NU>,
    /// Feedback, transposed.
    gain_t: SMatrix<f64, NX, NU>,
    /// Curvature of the cost to go after the interval times the constant part of the dynamics.
    carried: SVector<f64, NX>,
    /// The input at state zero.
    feedforward: SVector<f64, NU>,
}

/// Factors of the stage-structured program without inequalities, from its end to its beginning.
#[derive(Clone, Debug)]
pub struct Riccati<const NX: usize, const NU: usize> {
    intervals: Vec<Interval<NX, NU>>,
    /// Curvature of the cost to go at the point that the recursion has come to.
    curvature: SMatrix<f64, NX, NX>,
    /// Slope of the cost to go at the point that the recursion has come to.
    slope: SVector<f64, NX>,
}

impl<const NX: usize, const NU: usize> Riccati<NX, NU> {
    /// Memory for a horizon.
    pub fn new(intervals: usize) -> Self {
        let interval = Interval {
            after: SMatrix::zeros(),
            chol: SMatrix::zeros(),
            gain_t: SMatrix::zeros(),
            carried: SVector::zeros(),
            feedforward: SVector::zeros(),
        };
        Self {
            intervals: vec![interval; intervals],
            curvature: SMatrix::zeros(),
            slope: SVector::zeros(),
        }
    }

    /// Number of intervals.
    pub fn intervals(&self) -> usize {
        self.intervals.len()
    }

    /// The feedback of interval `k`: how its input follows the state, transposed.
    pub fn gain_transposed(&self, k: usize) -> &SMatrix<f64, NX, NU> {
        &self.intervals[k].gain_t
    }

    /// Curvature of the cost to go at the first point.
    pub fn curvature(&self) -> &SMatrix<f64, NX, NX> {
        &self.curvature
    }

    /// Factors the curvatures. `xx_more(k, xx)` may add to the curvature in the state at point `k`,
    /// `uu_more(k)` gives what adds to the diagonal of the curvature in the input.
    ///
    /// ```text
    /// G = uu + b' P b,  H = ux + b' P a,  K = -G^-1 H,  P <- xx + a' P a - H' G^-1 H
    /// ```
    pub fn factor(
        &mut self,
        steps: &[Step<NX, NU>],
        costs: &[StageCost<NX, NU>],
        xx_more: impl FnMut(usize, &mut SMatrix<f64, NX, NX>),
        uu_more: impl FnMut(usize) -> SVector<f64, NU>,
    ) {
        self.refactor(self.intervals.len(), steps, costs, xx_more, uu_more);
    }

    /// As [`Self::factor`], where nothing beyond point `from` is other than it was at the last
    /// factorisation: the recursion begins there.
    pub fn refactor(
        &mut self,
        from: usize,
        steps: &[Step<NX, NU>],
        costs: &[StageCost<NX, NU>],
        mut xx_more: impl FnMut(usize, &mut SMatrix<f64, NX, NX>),
        mut uu_more: impl FnMut(usize) -> SVector<f64, NU>,
    ) {
        let last = self.intervals.len();
        if from < last {
            self.curvature = self.intervals[from].after;
        } else {
            self.curvature = costs[last].xx;
            xx_more(last, &mut self.curvature);
        }
        for k in (0..last.min(from + 1)).rev() {
            let mut xx = costs[k].xx;
            if k > 0 {
                xx_more(k, &mut xx);
            }
            let mut uu = costs[k].uu;
            let more = uu_more(k);
            for i in 0..NU {
                uu[(i, i)] += more[i];
            }
            self.factor_interval(k, &steps[k], xx, &costs[k].ux, uu);
        }
    }

    #[inline]
    fn factor_interval(
        &mut self,
        k: usize,
        step: &Step<NX, NU>,
        mut xx: SMatrix<f64, NX, NX>,
        ux: &SMatrix<f64, NU, NX>,
        mut uu: SMatrix<f64, NU, NU>,
    ) {
        let interval = &mut self.intervals[k];
        interval.after = self.curvature;
        interval.carried = SVector::zeros();
        add_times(&mut interval.carried, &self.curvature, &step.next);

        let a_t = step.a.transpose();
        let b_t = step.b.transpose();
        let mut pa = SMatrix::<f64, NX, NX>::zeros();
        add_product(&mut pa, &self.curvature, &step.a);
        let mut pb = SMatrix::<f64, NX, NU>::zeros();
        add_product(&mut pb, &self.curvature, &step.b);
        add_product(&mut uu, &b_t, &pb);
        let mut xu = ux.transpose();
        add_product(&mut xu, &a_t, &pb);
        add_product(&mut xx, &a_t, &pa);

        factor_with_reciprocals(&mut uu);
        interval.chol = uu;
        let half = right_solve_transposed(&xu, &uu);
        subtract_square(&mut xx, &half);
        mirror_lower(&mut xx);
        self.curvature = xx;
        interval.gain_t = -right_solve(&half, &uu);
    }

    /// The states and inputs that solve the program for the slopes `x_slope(k)`, `u_slope(k)`, with
    /// the factors of [`Self::factor`].
    pub fn solve(
        &mut self,
        steps: &[Step<NX, NU>],
        mut x_slope: impl FnMut(usize) -> SVector<f64, NX>,
        mut u_slope: impl FnMut(usize) -> SVector<f64, NU>,
        initial: &SVector<f64, NX>,
        states: &mut [SVector<f64, NX>],
        inputs: &mut [SVector<f64, NU>],
    ) {
        let last = self.intervals.len();
        self.slope = x_slope(last);
        for k in (0..last).rev() {
            let (interval, step) = (&mut self.intervals[k], &steps[k]);
            let after = self.slope + interval.carried;
            let mut hu = u_slope(k);
            add_transpose_times(&mut hu, &step.b, &after);
            interval.feedforward = -cholesky_solve(&interval.chol, &hu);
            if k > 0 {
                let mut slope = x_slope(k);
                add_transpose_times(&mut slope, &step.a, &after);
                add_times(&mut slope, &interval.gain_t, &hu);
                self.slope = slope;
            }
        }
        states[0] = *initial;
        for k in 0..last {
            let (interval, step) = (&self.intervals[k], &steps[k]);
            let mut input = interval.feedforward;
            add_transpose_times(&mut input, &interval.gain_t, &states[k]);
            let mut next = step.next;
            add_times(&mut next, &step.a, &states[k]);
            add_times(&mut next, &step.b, &input);
            inputs[k] = input;
            states[k + 1] = next;
        }
    }
}

/// Cholesky factor in the lower triangle, its diagonal inverted; pivots that are not positive are
/// lifted.
#[inline(always)]
fn factor_with_reciprocals<const N: usize>(m: &mut SMatrix<f64, N, N>) {
    let largest = (0..N).fold(0.0_f64, |largest, i| largest.max(m.data.0[i][i].abs()));
    let scale = if largest > 0.0 { largest } else { 1.0 };
    for j in 0..N {
        let mut pivot = m.data.0[j][j];
        for n in 0..j {
            pivot -= m.data.0[n][j] * m.data.0[n][j];
        }
        if pivot <= PIVOT_FLOOR * scale {
            pivot = pivot.abs() + PIVOT_LIFT * scale;
        }
        let reciprocal = 1.0 / pivot.sqrt();
        m.data.0[j][j] = reciprocal;
        for i in j + 1..N {
            let mut entry = m.data.0[j][i];
            for n in 0..j {
                entry -= m.data.0[n][i] * m.data.0[n][j];
            }
            m.data.0[j][i] = entry * reciprocal;
        }
    }
}

/// `m L^-T`.
#[inline(always)]
fn right_solve_transposed<const R: usize, const N: usize>(
    m: &SMatrix<f64, R, N>,
    chol: &SMatrix<f64, N, N>,
) -> SMatrix<f64, R, N> {
    let mut out = *m;
    for j in 0..N {
        let mut column = out.data.0[j];
        for n in 0..j {
            let scale = chol.data.0[n][j];
            for i in 0..R {
                column[i] -= out.data.0[n][i] * scale;
            }
        }
        for i in 0..R {
            column[i] *= chol.data.0[j][j];
        }
        out.data.0[j] = column;
    }
    out
}

/// `m L^-1`.
#[inline(always)]
fn right_solve<const R: usize, const N: usize>(
    m: &SMatrix<f64, R, N>,
    chol: &SMatrix<f64, N, N>,
) -> SMatrix<f64, R, N> {
    let mut out = *m;
    for j in (0..N).rev() {
        let mut column = out.data.0[j];
        for n in j + 1..N {
            let scale = chol.data.0[j][n];
            for i in 0..R {
                column[i] -= out.data.0[n][i] * scale;
            }
        }
        for i in 0..R {
            column[i] *= chol.data.0[j][j];
        }
        out.data.0[j] = column;
    }
    out
}

/// `out -= half halfᵀ`.
#[inline(always)]
fn subtract_square<const R: usize, const N: usize>(
    out: &mut SMatrix<f64, R, R>,
    half: &SMatrix<f64, R, N>,
) {
    for j in 0..R {
        let mut column = out.data.0[j];
        for n in 0..N {
            let scale = half.data.0[n][j];
            for i in 0..R {
                column[i] -= half.data.0[n][i] * scale;
            }
        }
        out.data.0[j] = column;
    }
}

/// `(L Lᵀ)^-1 v`.
#[inline(always)]
fn cholesky_solve<const N: usize>(
    chol: &SMatrix<f64, N, N>,
    v: &SVector<f64, N>,
) -> SVector<f64, N> {
    let mut out = *v;
    for j in 0..N {
        for n in 0..j {
            out[j] -= chol.data.0[n][j] * out[n];
        }
        out[j] *= chol.data.0[j][j];
    }
    for j in (0..N).rev() {
        for n in j + 1..N {
            out[j] -= chol.data.0[j][n] * out[n];
        }
        out[j] *= chol.data.0[j][j];
    }
    out
}
