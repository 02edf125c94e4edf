//! Programs with equalities only.

use nalgebra::{DMatrix, DVector};

use crate::{Exit, LinearRows};

/// Share of the largest entry by which the optimality conditions may be missed: the rounding of a
/// linear solve with a condition number up to 1e8.
const RESIDUAL_SHARE: f64 = 1e-8;

/// Solution of a program with equalities only.
#[derive(Clone, Debug, PartialEq)]
pub struct EqualitySolution {
    /// The minimiser.
    pub x: DVector<f64>,
    /// Multipliers of the equalities.
    pub multipliers: DVector<f64>,
}

/// Minimises `1/2 x^T G x + g^T x` subject to `A x = b` by solving
///
/// ```text
/// [ G  A^T ] [ x ]   [ -g ]
/// [ A   0  ] [ y ] = [  b ]
/// ```
///
/// `hessian` must be symmetric and positive definite on the null space of `A`, and the rows of `A`
/// independent.
///
/// # Errors
/// [`Exit::NotConvex`] when there is no unique minimiser, [`Exit::Infeasible`] when dependent rows
/// contradict each other, [`Exit::ShapeMismatch`], [`Exit::NotFinite`].
pub fn solve_equality(
    hessian: &DMatrix<f64>,
    gradient: &DVector<f64>,
    equality: &LinearRows,
) -> Result<EqualitySolution, Exit> {
    let (n, m) = (gradient.len(), equality.len());
    if hessian.shape() != (n, n) || !equality.fits(n) || m > n {
        return Err(Exit::ShapeMismatch);
    }
    if !equality.is_finite() || !hessian.iter().chain(gradient.iter()).all(|v| v.is_finite()) {
        return Err(Exit::NotFinite);
    }
    let mut rhs = DVector::zeros(n + m);
    rhs.rows_mut(0, n).copy_from(&-gradient);
    rhs.rows_mut(n, m).copy_from(&equality.bound);
    let matrix = kkt_matrix(hessian, &equality.matrix);
    let solution = matrix
        .clone()
        .full_piv_lu()
        .solve(&rhs)
        .ok_or(Exit::NotConvex)?;
    check(&matrix, &solution, &rhs, n)?;
    if !is_convex_on_null_space(hessian, &equality.matrix) {
        return Err(Exit::NotConvex);
    }
    Ok(EqualitySolution {
        x: solution.rows(0, n).into_owned(),
        multipliers: solution.rows(n, m).into_owned(),
    })
}

fn kkt_matrix(hessian: &DMatrix<f64>, rows: &DMatrix<f64>) -> DMatrix<f64> {
    let (n, m) = (hessian.nrows(), rows.nrows());
    let mut matrix = DMatrix::zeros(n + m, n + m);
    matrix.view_mut((0, 0), (n, n)).copy_from(hessian);
    matrix.view_mut((n, 0), (m, n)).copy_from(rows);
    matrix.view_mut((0, n), (n, m)).copy_from(&rows.transpose());
    matrix
}

/// A nearly singular matrix shows in the residual of the linear solve.
fn check(
    matrix: &DMatrix<f64>,
    solution: &DVector<f64>,
    rhs: &DVector<f64>,
    n: usize,
) -> Result<(), Exit> {
    let residual = matrix * solution - rhs;
    let allowed = RESIDUAL_SHARE * rhs.amax().max(matrix.amax() * solution.amax());
    let violation = residual.rows_range(n..).amax();
    if violation > allowed {
        return Err(Exit::Infeasible { violation });
    }
    if residual.amax() > allowed || !allowed.is_finite() {
        return Err(Exit::NotConvex);
    }
    Ok(())
}

/// `G + rho A^T A` is positive definite for a large enough `rho` exactly when `G` is positive
/// definite on the null space of `A` (Debreu's lemma).
fn is_convex_on_null_space(hessian: &DMatrix<f64>, rows: &DMatrix<f64>) -> bool {
    if rows.nrows() == 0 {
        return hessian.clone().cholesky().is_some();
    }
    let weight = 1e6 * (hessian.amax() / rows.amax().powi(2)).max(f64::MIN_POSITIVE);
    let augmented = hessian + rows.tr_mul(rows) * weight;
    augmented.cholesky().is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(matrix: DMatrix<f64>, bound: &[f64]) -> LinearRows {
        LinearRows {
            matrix,
            bound: DVector::from_column_slice(bound),
        }
    }

    #[test]
    fn a_flat_direction_may_be_fixed_by_an_equality() {
        let hessian = DMatrix::from_row_slice(2, 2, &[2.0, 0.0, 0.0, 0.0]);
        let equality = rows(DMatrix::from_row_slice(1, 2, &[1.0, 1.0]), &[3.0]);
        let found = solve_equality(&hessian, &DVector::zeros(2), &equality).unwrap();
        assert!((found.x - DVector::from_column_slice(&[0.0, 3.0])).norm() < 1e-14);
    }

    #[test]
    fn a_flat_direction_that_stays_free_is_not_convex() {
        let hessian = DMatrix::from_row_slice(2, 2, &[2.0, 0.0, 0.0, 0.0]);
        let equality = rows(DMatrix::from_row_slice(1, 2, &[1.0, 0.0]), &[3.0]);
        let exit = solve_equality(&hessian, &DVector::zeros(2), &equality);
        assert_eq!(exit, Err(Exit::NotConvex));
    }

    #[test]
    fn a_saddle_is_not_convex() {
        let hessian = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, -1.0]);
        let exit = solve_equality(&hessian, &DVector::zeros(2), &LinearRows::none(2));
        assert_eq!(exit, Err(Exit::NotConvex));
    }
}
