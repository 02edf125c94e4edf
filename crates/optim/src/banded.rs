//! Positive definite systems whose matrix is a narrow band.

use nalgebra::{DMatrix, DVector};

/// Cholesky factor `L L^T = M` of a symmetric positive definite matrix with `M_ij = 0` for
/// `|i - j| > bandwidth`, in `O(n bandwidth^2)`.
#[derive(Clone, Debug, PartialEq)]
pub struct BandedCholesky {
    bandwidth: usize,
    /// Row `i` holds `L[i, i - bandwidth ..= i]`; the diagonal is the last column.
    lower: DMatrix<f64>,
}

impl BandedCholesky {
    /// Factors the matrix whose entry `(i, j)`, for `i - bandwidth <= j <= i`, is `entry(i, j)`;
    /// `None` if it is not positive definite.
    pub fn factor(
        size: usize,
        bandwidth: usize,
        entry: impl Fn(usize, usize) -> f64,
    ) -> Option<Self> {
        let mut lower = DMatrix::zeros(size, bandwidth + 1);
        for i in 0..size {
            let first = i.saturating_sub(bandwidth);
            for j in first..=i {
                let from = first.max(j.saturating_sub(bandwidth));
                let mut sum = entry(i, j);
                for k in from..j {
                    sum -= lower[(i, k + bandwidth - i)] * lower[(j, k + bandwidth - j)];
                }
                lower[(i, j + bandwidth - i)] = if i == j {
                    positive_root(sum)?
                } else {
                    sum / lower[(j, bandwidth)]
                };
            }
        }
        Some(Self { bandwidth, lower })
    }

    /// Solves `M x = rhs` in place.
    pub fn solve_mut(&self, rhs: &mut DVector<f64>) {
        let (n, w) = (self.lower.nrows(), self.bandwidth);
        for i in 0..n {
            for k in i.saturating_sub(w)..i {
                rhs[i] -= self.lower[(i, k + w - i)] * rhs[k];
            }
            rhs[i] /= self.lower[(i, w)];
        }
        for i in (0..n).rev() {
            for k in i + 1..n.min(i + w + 1) {
                rhs[i] -= self.lower[(k, i + w - k)] * rhs[k];
            }
            rhs[i] /= self.lower[(i, w)];
        }
    }
}

fn positive_root(square: f64) -> Option<f64> {
    (square > 0.0 && square.is_finite()).then(|| square.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_solution_solves_the_system(
            entries in proptest::collection::vec(-1.0..1.0_f64, 60),
            rhs in proptest::collection::vec(-1.0..1.0_f64, 12),
        ) {
            // Five per row; the diagonal outweighs the row, which makes it positive definite.
            let entry = |i: usize, j: usize| match i - j {
                0 => 9.0 + entries[5 * i],
                d @ 1..=4 => entries[5 * i + d],
                _ => 0.0,
            };
            let dense = DMatrix::from_fn(12, 12, |i, j| entry(i.max(j), i.min(j)));
            let mut x = DVector::from_vec(rhs.clone());
            BandedCholesky::factor(12, 4, entry).unwrap().solve_mut(&mut x);
            prop_assert!((dense * x - DVector::from_vec(rhs)).amax() < 1e-13);
        }
    }

    #[test]
    fn an_indefinite_matrix_is_refused() {
        let matrix = |i: usize, j: usize| if i == j { 1.0 } else { 2.0 };
        assert_eq!(BandedCholesky::factor(3, 1, matrix), None);
    }
}
