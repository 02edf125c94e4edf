//! Covariances to lists of numbers and back, every bit kept.
//!
//! A symmetric matrix is its upper triangle by rows; one that is not symmetric to the last bit is
//! all its numbers by rows.

use nalgebra::SMatrix;

use crate::convert::Mismatch;

fn is_symmetric_to_the_bit<const N: usize>(matrix: &SMatrix<f64, N, N>) -> bool {
    (0..N).all(|i| (0..i).all(|j| matrix[(i, j)].to_bits() == matrix[(j, i)].to_bits()))
}

/// Fills `numbers`, whose memory is used again.
pub(crate) fn fill_covariance<const N: usize>(numbers: &mut Vec<f64>, matrix: &SMatrix<f64, N, N>) {
    let symmetric = is_symmetric_to_the_bit(matrix);
    numbers.clear();
    for row in 0..N {
        let first = if symmetric { row } else { 0 };
        numbers.extend((first..N).map(|column| matrix[(row, column)]));
    }
}

pub(crate) fn covariance_to<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Vec<f64> {
    let mut numbers = Vec::with_capacity(N * (N + 1) / 2);
    fill_covariance(&mut numbers, matrix);
    numbers
}

pub(crate) fn covariance_from<const N: usize>(
    numbers: &[f64],
) -> Result<SMatrix<f64, N, N>, Mismatch> {
    let (triangle, whole) = (N * (N + 1) / 2, N * N);
    let found = numbers.len();
    if found == whole {
        return Ok(SMatrix::from_fn(|row, column| numbers[N * row + column]));
    }
    if found != triangle {
        return Err(Mismatch::Covariance {
            found,
            triangle,
            whole,
        });
    }
    let mut matrix = SMatrix::zeros();
    let mut rest = numbers.iter();
    for row in 0..N {
        for (column, value) in (row..N).zip(&mut rest) {
            matrix[(row, column)] = *value;
            matrix[(column, row)] = *value;
        }
    }
    Ok(matrix)
}
