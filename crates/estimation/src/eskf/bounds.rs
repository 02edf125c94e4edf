//! Bounds of the covariance.

use super::{Covariance, FilterKind, PARTS, index};

/// Least standard deviations that the covariance may reach: m, m/s, rad, m/s^2, rad/s.
///
/// Far below what any of the sensors can resolve; they keep the covariance invertible.
const LEAST_SIGMA: [f64; 5] = [1e-5, 1e-5, 1e-6, 1e-6, 1e-7];

/// Greatest standard deviations that the covariance may reach, in the same order.
///
/// Beyond them the linearisation means nothing, whatever the number is.
const GREATEST_SIGMA: [f64; 5] = [1e4, 1e2, 2.0, 5.0, 1.0];

/// Row of [`LEAST_SIGMA`] and [`GREATEST_SIGMA`] for orientation.
const ORIENTATION: usize = 2;

/// Makes the covariance symmetric and keeps its variances between bounds. Scaling a row with its
/// column, or adding to the diagonal, keeps it positive definite.
pub(super) fn bound(covariance: &mut Covariance, filter: FilterKind) {
    for i in 0..16 {
        for j in 0..i {
            let mean = 0.5 * (covariance[(i, j)] + covariance[(j, i)]);
            covariance[(i, j)] = mean;
            covariance[(j, i)] = mean;
        }
    }
    for (own, error) in PARTS {
        let (least, greatest) = (LEAST_SIGMA[error / 3], GREATEST_SIGMA[error / 3]);
        (own..own + 3).for_each(|i| bound_variance(covariance, i, least, greatest));
    }
    // A rotation by an angle changes a quaternion by half of it at most, and the components that it
    // does not change have no variance.
    let (coordinates, least, greatest) = match filter {
        FilterKind::ErrorStateLocal | FilterKind::ErrorStateGlobal => {
            (3, LEAST_SIGMA[ORIENTATION], GREATEST_SIGMA[ORIENTATION])
        }
        FilterKind::Extended => (4, 0.0, 0.5 * GREATEST_SIGMA[ORIENTATION]),
    };
    for i in index::ORIENTATION..index::ORIENTATION + coordinates {
        bound_variance(covariance, i, least, greatest);
    }
}

fn bound_variance(covariance: &mut Covariance, i: usize, least_sigma: f64, greatest_sigma: f64) {
    let (least, greatest) = (least_sigma * least_sigma, greatest_sigma * greatest_sigma);
    if covariance[(i, i)] < least {
        covariance[(i, i)] = least;
    } else if covariance[(i, i)] > greatest {
        let scale = (greatest / covariance[(i, i)]).sqrt();
        covariance.row_mut(i).scale_mut(scale);
        covariance.column_mut(i).scale_mut(scale);
    }
}
