//! The greatest value of a polynomial on 0..1, by its Bernstein coefficients.
//!
//! A polynomial lies below the greatest of its Bernstein coefficients, and takes the first and last
//! of them at the ends. Halving the interval (de Casteljau) brings the bounds together, so that the
//! maximum is found without missing a peak between samples.

/// Relative distance between the value returned and the true maximum.
const TOLERANCE: f64 = 1e-7;
/// Halvings: intervals below 2^-40 are points.
const MAX_DEPTH: u32 = 40;

/// An upper bound of the maximum on 0..1 of the polynomial with the given coefficients of powers
/// (constant first) which is not negative, exact to [`TOLERANCE`].
pub(crate) fn maximum(powers: &[f64]) -> f64 {
    let whole = bernstein(powers);
    let mut best = f64::NEG_INFINITY;
    let mut stack = vec![(whole, 0_u32)];
    let mut bound = f64::NEG_INFINITY;
    while let Some((coefficients, depth)) = stack.pop() {
        let ends = coefficients[0].max(coefficients[coefficients.len() - 1]);
        best = best.max(ends);
        let upper = coefficients.iter().copied().fold(ends, f64::max);
        if upper <= best * (1.0 + TOLERANCE) || depth == MAX_DEPTH {
            bound = bound.max(upper);
            continue;
        }
        let (left, right) = halves(coefficients);
        stack.push((left, depth + 1));
        stack.push((right, depth + 1));
    }
    bound.max(best)
}

/// Bernstein coefficients b_j = sum_{i <= j} C(j, i) / C(n, i) a_i.
fn bernstein(powers: &[f64]) -> Vec<f64> {
    let n = powers.len() - 1;
    (0..=n)
        .map(|j| {
            let mut ratio = 1.0;
            let mut sum = 0.0;
            for i in 0..=j {
                sum += ratio * powers[i];
                ratio *= (j - i) as f64 / (n - i).max(1) as f64;
            }
            sum
        })
        .collect()
}

/// Coefficients on the two halves of the interval.
fn halves(mut coefficients: Vec<f64>) -> (Vec<f64>, Vec<f64>) {
    let n = coefficients.len();
    let mut left = Vec::with_capacity(n);
    for step in 0..n {
        left.push(coefficients[0]);
        for k in 0..n - 1 - step {
            coefficients[k] = 0.5 * (coefficients[k] + coefficients[k + 1]);
        }
    }
    // What remains is the right half: coefficient k of it was last written in step n - 1 - k.
    (left, coefficients)
}

/// Adds the square of a polynomial to `sum`.
pub(crate) fn add_square(sum: &mut [f64], powers: &[f64]) {
    for (i, a) in powers.iter().enumerate() {
        for (j, b) in powers.iter().enumerate() {
            sum[i + j] += a * b;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_peak_between_samples_is_found() {
        // 1 - 1e4 (u - 1/3)^2
        let third = 1.0 / 3.0;
        let powers = [1.0 - 1e4 * third * third, 2e4 * third, -1e4];
        assert!((maximum(&powers) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_maximum_may_lie_at_an_end() {
        assert!((maximum(&[1.0, 2.0, 0.5]) - 3.5).abs() < 1e-12);
        assert!((maximum(&[4.0, -2.0, 0.5]) - 4.0).abs() < 1e-12);
        assert_eq!(maximum(&[2.0]), 2.0);
        assert_eq!(maximum(&[0.0, 0.0, 0.0]), 0.0);
    }

    #[test]
    fn it_is_never_below_a_dense_sampling_and_hardly_above() {
        for case in 0..200 {
            let root: Vec<f64> = (0..9).map(|i| f64::from(case * 9 + i).sin()).collect();
            let mut square = vec![0.0; 17];
            add_square(&mut square, &root);
            let sampled = (0..=20_000)
                .map(|k| {
                    let u = f64::from(k) / 20_000.0;
                    root.iter().rev().fold(0.0, |sum, a| sum * u + a).powi(2)
                })
                .fold(0.0, f64::max);
            let found = maximum(&square);
            // The samples are 5e-5 apart; curvature of these polynomials is below 1e4.
            assert!(found >= sampled * (1.0 - 1e-12));
            assert!(found <= sampled * (1.0 + 1e-6) + 3e-6, "{found} {sampled}");
        }
    }
}
