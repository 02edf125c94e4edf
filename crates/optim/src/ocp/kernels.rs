//! Products of small fixed matrices, column by column so that the compiler uses vector registers.

use nalgebra::{SMatrix, SVector};

/// `out += a b`.
#[inline(always)]
pub(super) fn add_product<const R: usize, const K: usize, const C: usize>(
    out: &mut SMatrix<f64, R, C>,
    a: &SMatrix<f64, R, K>,
    b: &SMatrix<f64, K, C>,
) {
    for j in 0..C {
        let mut column = out.data.0[j];
        for k in 0..K {
            let scale = b.data.0[j][k];
            for i in 0..R {
                column[i] += a.data.0[k][i] * scale;
            }
        }
        out.data.0[j] = column;
    }
}

/// `out += a v`.
#[inline(always)]
pub(super) fn add_times<const R: usize, const C: usize>(
    out: &mut SVector<f64, R>,
    a: &SMatrix<f64, R, C>,
    v: &SVector<f64, C>,
) {
    for k in 0..C {
        let scale = v.data.0[0][k];
        for i in 0..R {
            out.data.0[0][i] += a.data.0[k][i] * scale;
        }
    }
}

/// `out += aᵀ v`.
#[inline(always)]
pub(super) fn add_transpose_times<const R: usize, const C: usize>(
    out: &mut SVector<f64, C>,
    a: &SMatrix<f64, R, C>,
    v: &SVector<f64, R>,
) {
    for k in 0..C {
        out.data.0[0][k] += dot(&a.data.0[k], &v.data.0[0]);
    }
}

/// `out += scale v vᵀ`.
#[inline(always)]
pub(super) fn add_outer<const R: usize>(
    out: &mut SMatrix<f64, R, R>,
    scale: f64,
    v: &SVector<f64, R>,
) {
    let v = &v.data.0[0];
    for j in 0..R {
        let column = scale * v[j];
        for i in 0..R {
            out.data.0[j][i] += column * v[i];
        }
    }
}

/// The inner product, summed in two interleaved parts.
#[inline(always)]
pub(super) fn dot<const R: usize>(a: &[f64; R], b: &[f64; R]) -> f64 {
    let (mut even, mut odd) = (0.0, 0.0);
    let mut i = 0;
    while i + 1 < R {
        even += a[i] * b[i];
        odd += a[i + 1] * b[i + 1];
        i += 2;
    }
    if i < R {
        even += a[i] * b[i];
    }
    even + odd
}

/// Replaces the upper triangle by the lower.
#[inline(always)]
pub(super) fn mirror_lower<const R: usize>(matrix: &mut SMatrix<f64, R, R>) {
    for j in 0..R {
        for i in 0..j {
            matrix.data.0[j][i] = matrix.data.0[i][j];
        }
    }
}
