//! Whether errors are as large as their covariance says (document S, equations 2.91 and 2.92).

use alula_geometry::gaussian::chi_square_quantile;
use alula_messages::ErrorCovariance;
use nalgebra::{SMatrix, SVector};

use crate::eskf::ErrorVector;

/// Normalised estimation error squared: e^T P^-1 e; `None` if the covariance has no inverse.
pub fn nees<const N: usize>(
    error: &SVector<f64, N>,
    covariance: &SMatrix<f64, N, N>,
) -> Option<f64> {
    let inverse = covariance.try_inverse()?;
    Some((error.transpose() * inverse * error)[0])
}

/// The normalised squared error of some rows of the error state.
pub fn nees_of<const N: usize>(
    error: &ErrorVector,
    covariance: &ErrorCovariance,
    rows: [usize; N],
) -> Option<f64> {
    let error = SVector::<f64, N>::from_fn(|i, _| error[rows[i]]);
    let covariance = SMatrix::<f64, N, N>::from_fn(|i, j| covariance[(rows[i], rows[j])]);
    nees(&error, &covariance)
}

/// The band in which the average of normalised errors over independent runs lies with a given
/// probability if the filter is consistent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AneesBand {
    /// Below: the filter is conservative.
    pub low: f64,
    /// Above: the filter is optimistic.
    pub high: f64,
}

/// The two-sided band for `runs` runs of an error with `dimension` degrees of freedom.
pub fn anees_band(dimension: u32, runs: u32, probability: f64) -> AneesBand {
    let tail = 0.5 * (1.0 - probability);
    let quantile = |p| chi_square_quantile(p, dimension * runs) / f64::from(runs);
    AneesBand {
        low: quantile(tail),
        high: quantile(1.0 - tail),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    /// Document S, equation 2.92, with the labels as they should be.
    #[test]
    fn the_band_of_the_source() {
        let band = anees_band(6, 25, 0.95);
        assert!((band.low - 4.719).abs() < 1e-3 && (band.high - 7.432).abs() < 1e-3);
    }

    #[test]
    fn errors_are_measured_in_standard_deviations() {
        let covariance = Matrix2::new(4.0, 0.0, 0.0, 0.25);
        assert!((nees(&Vector2::new(2.0, 1.0), &covariance).unwrap() - 5.0).abs() < 1e-12);
        assert!(nees(&Vector2::new(2.0, 1.0), &Matrix2::zeros()).is_none());
    }
}
