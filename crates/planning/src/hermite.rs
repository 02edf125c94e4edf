//! Polynomials of degree nine from position, velocity, acceleration, jerk and snap at both ends.
//!
//! Within a segment time is `u` in 0..1, so that the matrices here are constants of the method.

use nalgebra::{SMatrix, SVector};

/// Derivatives that are given at an end: orders 0 (position) to 4 (snap).
pub(crate) const ORDERS: usize = 5;
/// Coefficients of a polynomial of degree nine, constant term first.
pub(crate) const COEFFICIENTS: usize = 2 * ORDERS;

/// Derivatives with respect to `u` at `u = 0`, then at `u = 1`; one column per axis.
pub(crate) type Ends = SMatrix<f64, COEFFICIENTS, 3>;

/// The constant matrices.
#[derive(Clone, Debug)]
pub(crate) struct Hermite {
    /// Coefficients from the derivatives at both ends.
    coefficients_from_ends: SMatrix<f64, COEFFICIENTS, COEFFICIENTS>,
    /// `ends^T snap_cost ends` is the integral of the squared fourth derivative over `u`.
    pub(crate) snap_cost: SMatrix<f64, COEFFICIENTS, COEFFICIENTS>,
}

impl Hermite {
    /// `None` cannot happen: the matrix of a Hermite interpolation is regular.
    pub(crate) fn new() -> Option<Self> {
        let mut ends_from_coefficients = SMatrix::<f64, COEFFICIENTS, COEFFICIENTS>::zeros();
        for order in 0..ORDERS {
            ends_from_coefficients[(order, order)] = falling(order, order);
            for power in order..COEFFICIENTS {
                ends_from_coefficients[(ORDERS + order, power)] = falling(power, order);
            }
        }
        let coefficients_from_ends = ends_from_coefficients.try_inverse()?;
        let cost = SMatrix::<f64, COEFFICIENTS, COEFFICIENTS>::from_fn(snap_of_powers);
        let snap_cost = coefficients_from_ends.transpose() * cost * coefficients_from_ends;
        Some(Self {
            coefficients_from_ends,
            snap_cost: (snap_cost + snap_cost.transpose()) * 0.5,
        })
    }

    /// Coefficients of the powers of `u`, one column per axis.
    pub(crate) fn coefficients(&self, ends: &Ends) -> Ends {
        self.coefficients_from_ends * ends
    }

    /// Shares of the ten end derivatives in the position at `u`.
    pub(crate) fn weights(&self, u: f64) -> SVector<f64, COEFFICIENTS> {
        let powers = SVector::<f64, COEFFICIENTS>::from_fn(|power, _| u.powi(power as i32));
        self.coefficients_from_ends.tr_mul(&powers)
    }
}

/// Integral over 0..1 of the fourth derivatives of `u^i` and `u^j`.
fn snap_of_powers(i: usize, j: usize) -> f64 {
    if i < 4 || j < 4 {
        return 0.0;
    }
    falling(i, 4) * falling(j, 4) / (i + j - 7) as f64
}

/// `power (power - 1) ... (power - order + 1)`: the factor of the derivative of a power.
pub(crate) fn falling(power: usize, order: usize) -> f64 {
    (0..order).map(|k| power as f64 - k as f64).product()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends() -> Ends {
        Ends::from_fn(|i, axis| ((3 * i + axis) as f64).sin())
    }

    fn derivative(coefficients: &Ends, axis: usize, order: usize, u: f64) -> f64 {
        (order..COEFFICIENTS)
            .map(|p| falling(p, order) * coefficients[(p, axis)] * u.powi((p - order) as i32))
            .sum()
    }

    #[test]
    fn the_polynomial_has_the_given_derivatives_at_its_ends() {
        let (hermite, ends) = (Hermite::new().unwrap(), ends());
        let c = hermite.coefficients(&ends);
        for axis in 0..3 {
            for order in 0..ORDERS {
                // Coefficients reach 1e3 and derivatives multiply them by up to 3024.
                assert!((derivative(&c, axis, order, 0.0) - ends[(order, axis)]).abs() < 1e-12);
                let last = derivative(&c, axis, order, 1.0);
                assert!((last - ends[(ORDERS + order, axis)]).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn the_cost_is_the_integral_of_the_squared_snap() {
        let (hermite, ends) = (Hermite::new().unwrap(), ends());
        let c = hermite.coefficients(&ends);
        for axis in 0..3 {
            let n = 2000;
            let simpson: f64 = (0..=n)
                .map(|k| {
                    let weight = if k == 0 || k == n {
                        1.0
                    } else if k % 2 == 1 {
                        4.0
                    } else {
                        2.0
                    };
                    weight * derivative(&c, axis, 4, f64::from(k) / f64::from(n)).powi(2)
                })
                .sum::<f64>()
                / (3.0 * f64::from(n));
            let d = ends.column(axis);
            let cost = d.dot(&(hermite.snap_cost * d));
            assert!((cost / simpson - 1.0).abs() < 1e-8, "{cost} {simpson}");
        }
    }

    #[test]
    fn weights_give_the_position() {
        let (hermite, ends) = (Hermite::new().unwrap(), ends());
        let c = hermite.coefficients(&ends);
        let position = hermite.weights(0.37).dot(&ends.column(1));
        assert!((position - derivative(&c, 1, 0, 0.37)).abs() < 1e-10);
    }
}
