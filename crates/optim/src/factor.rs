//! The factors that the dual active-set method keeps: `J` with `J J^T = G^-1`, and the triangle `R`
//! with `J^T N = [R; 0]` for the normals `N` of the active constraints.

use nalgebra::{DMatrix, DVector};

/// Relative rounding of a normal, and with it of what remains of it outside a span: above the
/// spacing of `f64` by what products and rotations of 100 variables add.
pub(crate) const ROUNDING: f64 = 1e-12;

#[derive(Clone, Debug)]
pub(crate) struct ActiveFactor {
    /// `J` without active constraints: `L^-T D`, with `D G D = L L^T` and `D` the scaling that
    /// gives `D G D` a unit diagonal.
    free: DMatrix<f64>,
    j: DMatrix<f64>,
    r: DMatrix<f64>,
    /// Number of active constraints.
    active: usize,
    /// `J^T normal` of the constraint at hand.
    d: DVector<f64>,
}

impl ActiveFactor {
    pub(crate) fn new() -> Self {
        Self {
            free: DMatrix::zeros(0, 0),
            j: DMatrix::zeros(0, 0),
            r: DMatrix::zeros(0, 0),
            active: 0,
            d: DVector::zeros(0),
        }
    }

    /// Factors the Hessian; `None` if it is not positive definite.
    pub(crate) fn prepare(&mut self, hessian: &DMatrix<f64>) -> Option<()> {
        let n = hessian.nrows();
        if hessian.diagonal().iter().any(|h| h.is_nan() || *h <= 0.0) {
            return None;
        }
        let scale = hessian.diagonal().map(|h| 1.0 / h.sqrt());
        let scaled = DMatrix::from_fn(n, n, |i, k| hessian[(i, k)] * scale[i] * scale[k]);
        let lower = scaled.cholesky()?.unpack();
        self.free = DMatrix::from_diagonal(&scale);
        // J^T = L^-1 D; its transpose is taken because columns of J are what is rotated.
        lower.solve_lower_triangular_mut(&mut self.free);
        self.free.transpose_mut();
        self.r.resize_mut(n, n, 0.0);
        self.d = DVector::zeros(n);
        Some(())
    }

    /// Forgets the active constraints.
    pub(crate) fn reset(&mut self) {
        self.j.clone_from(&self.free);
        self.active = 0;
    }

    pub(crate) fn variables(&self) -> usize {
        self.free.nrows()
    }

    /// Unconstrained minimiser `-G^-1 g`.
    pub(crate) fn minimiser(&self, gradient: &DVector<f64>) -> DVector<f64> {
        -(&self.free * self.free.tr_mul(gradient))
    }

    /// For a constraint normal: the step `z` in the primal that keeps the active constraints, and
    /// the change `r` of their multipliers. Returns `z^T normal`, or zero if the normal depends on
    /// the active ones.
    pub(crate) fn directions(
        &mut self,
        normal: &DVector<f64>,
        z: &mut DVector<f64>,
        r: &mut DVector<f64>,
    ) -> f64 {
        let q = self.active;
        self.j.tr_mul_to(normal, &mut self.d);
        for i in (0..q).rev() {
            let mut sum = self.d[i];
            for k in i + 1..q {
                sum -= self.r[(i, k)] * r[k];
            }
            r[i] = sum / self.r[(i, i)];
        }
        z.fill(0.0);
        for k in q..self.variables() {
            z.axpy(self.d[k], &self.j.column(k), 1.0);
        }
        let free = self.d.rows_range(q..).norm_squared();
        if free.sqrt() > ROUNDING * self.reach(r) {
            free
        } else {
            0.0
        }
    }

    /// Length of the terms that must cancel where the normal at hand depends on the active ones:
    /// `|J^T n| + sum |r_i| |J^T n_i|`. What remains outside the span is known to its rounding only.
    fn reach(&self, r: &DVector<f64>) -> f64 {
        let of_active = |i: usize| r[i].abs() * self.r.view((0, i), (i + 1, 1)).norm();
        self.d.norm() + (0..self.active).map(of_active).sum::<f64>()
    }

    /// Adds the constraint whose normal was last given to [`Self::directions`].
    pub(crate) fn add(&mut self) {
        let (n, q) = (self.variables(), self.active);
        for k in (q + 1..n).rev() {
            let (c, s, length) = givens(self.d[k - 1], self.d[k]);
            self.d[k - 1] = length;
            self.d[k] = 0.0;
            rotate_columns(&mut self.j, k - 1, k, c, s);
        }
        for i in 0..=q {
            self.r[(i, q)] = self.d[i];
        }
        self.active += 1;
    }

    /// Drops the active constraint at a place in the order of addition.
    pub(crate) fn drop(&mut self, place: usize) {
        let q = self.active;
        for k in place..q - 1 {
            for i in 0..=k + 1 {
                self.r[(i, k)] = self.r[(i, k + 1)];
            }
            let (c, s, length) = givens(self.r[(k, k)], self.r[(k + 1, k)]);
            self.r[(k, k)] = length;
            self.r[(k + 1, k)] = 0.0;
            for i in k + 2..q {
                let (a, b) = (self.r[(k, i)], self.r[(k + 1, i)]);
                self.r[(k, i)] = c * a + s * b;
                self.r[(k + 1, i)] = c * b - s * a;
            }
            rotate_columns(&mut self.j, k, k + 1, c, s);
        }
        self.active -= 1;
    }
}

/// The rotation that turns `(a, b)` into `(length, 0)`.
fn givens(a: f64, b: f64) -> (f64, f64, f64) {
    let length = a.hypot(b);
    if length == 0.0 {
        (1.0, 0.0, 0.0)
    } else {
        (a / length, b / length, length)
    }
}

fn rotate_columns(j: &mut DMatrix<f64>, first: usize, second: usize, c: f64, s: f64) {
    let (mut left, mut right) = j.columns_range_pair_mut(first, second);
    for (a, b) in left.iter_mut().zip(right.iter_mut()) {
        let (x, y) = (*a, *b);
        *a = c * x + s * y;
        *b = c * y - s * x;
    }
}
