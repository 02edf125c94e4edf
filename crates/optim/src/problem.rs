//! The program, the ways a solver can end, and the optimality conditions.

use nalgebra::{DMatrix, DVector};

/// Rows `matrix * x` set against `bound`: `=` for equalities, `<=` for inequalities.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearRows {
    /// One constraint per row.
    pub matrix: DMatrix<f64>,
    /// Right-hand sides.
    pub bound: DVector<f64>,
}

impl LinearRows {
    /// No constraints on `variables` variables.
    pub fn none(variables: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(0, variables),
            bound: DVector::zeros(0),
        }
    }

    /// Number of constraints.
    pub fn len(&self) -> usize {
        self.matrix.nrows()
    }

    /// Whether there are no constraints.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub(crate) fn fits(&self, variables: usize) -> bool {
        self.matrix.ncols() == variables && self.bound.len() == self.matrix.nrows()
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.matrix
            .iter()
            .chain(self.bound.iter())
            .all(|v| v.is_finite())
    }
}

/// Minimise `1/2 x^T G x + g^T x` subject to `A x = b` and `C x <= d`.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticProgram {
    /// `G`, symmetric; only its lower triangle is read.
    pub hessian: DMatrix<f64>,
    /// `g`.
    pub gradient: DVector<f64>,
    /// `A x = b`.
    pub equality: LinearRows,
    /// `C x <= d`.
    pub inequality: LinearRows,
}

impl QuadraticProgram {
    /// A program without constraints.
    pub fn unconstrained(hessian: DMatrix<f64>, gradient: DVector<f64>) -> Self {
        let n = gradient.len();
        Self {
            hessian,
            gradient,
            equality: LinearRows::none(n),
            inequality: LinearRows::none(n),
        }
    }

    /// `1/2 x^T G x + g^T x`.
    pub fn cost(&self, x: &DVector<f64>) -> f64 {
        0.5 * x.dot(&(&self.hessian * x)) + self.gradient.dot(x)
    }
}

/// How a solver ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exit {
    /// The point meets the optimality conditions.
    Converged,
    /// The iterations ran out; the point is dual feasible but violates constraints.
    IterationLimit {
        /// Greatest violation of a constraint, divided by the norm of its row.
        violation: f64,
    },
    /// No point meets all constraints.
    Infeasible {
        /// Violation of the constraint that cannot be met beside the others, divided by the norm
        /// of its row, at the point where this was found.
        violation: f64,
    },
    /// The Hessian is not positive definite (where it must be).
    NotConvex,
    /// A number in the program is not finite.
    NotFinite,
    /// The sizes of matrices and vectors do not agree.
    ShapeMismatch,
}

impl Exit {
    /// Whether the point is the solution.
    pub fn is_converged(&self) -> bool {
        matches!(self, Self::Converged)
    }
}

/// Greatest absolute violation of each of the conditions of Karush, Kuhn and Tucker for
/// `L = 1/2 x^T G x + g^T x + y^T (A x - b) + z^T (C x - d)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KktResidual {
    /// `G x + g + A^T y + C^T z = 0`.
    pub stationarity: f64,
    /// `A x = b`.
    pub equality: f64,
    /// `C x <= d`.
    pub inequality: f64,
    /// `z >= 0`.
    pub dual: f64,
    /// `z_i (C x - d)_i = 0`.
    pub complementarity: f64,
}

impl KktResidual {
    /// The residuals of a point with its multipliers.
    pub fn of(
        program: &QuadraticProgram,
        x: &DVector<f64>,
        equality_multipliers: &DVector<f64>,
        inequality_multipliers: &DVector<f64>,
    ) -> Self {
        let stationarity = &program.hessian * x
            + &program.gradient
            + program.equality.matrix.tr_mul(equality_multipliers)
            + program.inequality.matrix.tr_mul(inequality_multipliers);
        let equality = &program.equality.matrix * x - &program.equality.bound;
        let inequality = &program.inequality.matrix * x - &program.inequality.bound;
        let z = inequality_multipliers;
        Self {
            stationarity: stationarity.amax(),
            equality: equality.amax(),
            inequality: inequality.iter().fold(0.0, |worst, s| s.max(worst)),
            dual: z.iter().fold(0.0, |worst, m| (-m).max(worst)),
            complementarity: z.component_mul(&inequality).amax(),
        }
    }

    /// The greatest of all.
    pub fn max(&self) -> f64 {
        self.stationarity
            .max(self.equality)
            .max(self.inequality)
            .max(self.dual)
            .max(self.complementarity)
    }
}
