//! The quadratic program of minimum snap for given segment times (document S, equation 2.88).
//!
//! Unknowns are the derivatives at the knots that are not prescribed. Continuity holds by
//! construction, because both neighbours of a knot share its derivatives.

use alula_messages::Reference;
use alula_optim::BandedCholesky;
use nalgebra::{DMatrix, DVector, SMatrix, Vector3};

use crate::hermite::{COEFFICIENTS, Ends, Hermite, ORDERS};
use crate::trajectory::Segment;

/// Derivatives with respect to time at a knot: one row per order, one column per axis.
pub(crate) type Knot = SMatrix<f64, ORDERS, 3>;

/// Unknowns of neighbouring knots are at most this far apart: two times four, less one.
const BANDWIDTH: usize = 7;

/// Hessian and gradient for one set of segment times.
#[derive(Clone, Debug)]
pub(crate) struct SnapProgram {
    /// The same for each axis.
    pub hessian: DMatrix<f64>,
    /// One column per axis.
    pub gradient: DMatrix<f64>,
    /// The unknown of an order is the derivative times this to the power of the order, s.
    pub time_unit_s: f64,
}

/// What does not depend on the segment times.
#[derive(Clone, Debug)]
pub(crate) struct SnapProblem<'a> {
    pub hermite: &'a Hermite,
    /// Start and waypoints, world, m.
    pub points: Vec<Vector3<f64>>,
    start: Knot,
}

impl<'a> SnapProblem<'a> {
    pub(crate) fn new(
        hermite: &'a Hermite,
        start: &Reference,
        waypoints_world: &[Vector3<f64>],
    ) -> Self {
        let mut points = vec![start.position_world];
        points.extend_from_slice(waypoints_world);
        let rows = [
            start.position_world,
            start.velocity_world,
            start.acceleration_world,
            start.jerk_world,
            Vector3::zeros(),
        ];
        Self {
            hermite,
            points,
            start: Knot::from_fn(|order, axis| rows[order][axis]),
        }
    }

    pub(crate) fn segments(&self) -> usize {
        self.points.len() - 1
    }

    /// Whether the start is at rest: then the shape of the path does not depend on the total time.
    pub(crate) fn starts_at_rest(&self) -> bool {
        self.start.rows_range(1..).amax() == 0.0
    }

    pub(crate) fn start_velocity(&self) -> Vector3<f64> {
        self.start.row(1).transpose()
    }

    /// Number of unknowns per axis: snap at both ends, velocity to snap at each waypoint between.
    pub(crate) fn unknowns(&self) -> usize {
        4 * (self.segments() - 1) + 2
    }

    /// The unknown that is the derivative of `order` at `knot`; `None` if that is prescribed.
    pub(crate) fn unknown(&self, knot: usize, order: usize) -> Option<usize> {
        let last = self.segments();
        if knot == 0 {
            (order == ORDERS - 1).then_some(0)
        } else if knot == last {
            (order == ORDERS - 1).then_some(4 * last - 3)
        } else {
            (order > 0).then(|| 4 * knot + order - 4)
        }
    }

    /// The knots with zeros for the unknowns.
    fn prescribed(&self) -> Vec<Knot> {
        let mut knots = vec![Knot::zeros(); self.points.len()];
        for (knot, point) in knots.iter_mut().zip(&self.points) {
            knot.row_mut(0).copy_from(&point.transpose());
        }
        knots[0] = self.start;
        knots
    }

    /// The knots without corridor. `None` if rounding spoils the factorisation.
    pub(crate) fn solve(&self, times_s: &[f64]) -> Option<Vec<Knot>> {
        let program = self.program(times_s);
        let n = self.unknowns();
        let factor = BandedCholesky::factor(n, BANDWIDTH, |i, j| program.hessian[(i, j)])?;
        let mut solution = DMatrix::zeros(n, 3);
        for axis in 0..3 {
            let mut x: DVector<f64> = -program.gradient.column(axis);
            factor.solve_mut(&mut x);
            solution.set_column(axis, &x);
        }
        Some(self.knots(&solution, program.time_unit_s))
    }

    /// Hessian (the same for each axis) and gradient (a column per axis) in a time unit that makes
    /// the unknowns alike in size.
    pub(crate) fn program(&self, times_s: &[f64]) -> SnapProgram {
        let n = self.unknowns();
        let time_unit_s = times_s.iter().sum::<f64>() / times_s.len() as f64;
        let mut hessian = DMatrix::zeros(n, n);
        let mut gradient = DMatrix::zeros(n, 3);
        let prescribed = self.prescribed();
        for (i, t_s) in times_s.iter().enumerate() {
            let block = self.block(t_s / time_unit_s);
            let ends = ends_in_unit(&prescribed[i], &prescribed[i + 1], time_unit_s);
            let slope = block * ends;
            for a in 0..COEFFICIENTS {
                let Some(row) = self.unknown(i + a / ORDERS, a % ORDERS) else {
                    continue;
                };
                for axis in 0..3 {
                    gradient[(row, axis)] += slope[(a, axis)];
                }
                for b in 0..COEFFICIENTS {
                    if let Some(column) = self.unknown(i + b / ORDERS, b % ORDERS) {
                        hessian[(row, column)] += block[(a, b)];
                    }
                }
            }
        }
        SnapProgram {
            hessian,
            gradient,
            time_unit_s,
        }
    }

    /// Cost of a segment of duration `s` in end derivatives with respect to time:
    /// H_ab s^(order a + order b - 7).
    fn block(&self, s: f64) -> SMatrix<f64, COEFFICIENTS, COEFFICIENTS> {
        SMatrix::from_fn(|a, b| {
            let orders = (a % ORDERS + b % ORDERS) as i32;
            self.hermite.snap_cost[(a, b)] * s.powi(orders - 7)
        })
    }

    /// The knots with the unknowns put in; one column of `solution` per axis.
    pub(crate) fn knots(&self, solution: &DMatrix<f64>, time_unit_s: f64) -> Vec<Knot> {
        let mut knots = self.prescribed();
        for (k, knot) in knots.iter_mut().enumerate() {
            for order in 0..ORDERS {
                if let Some(row) = self.unknown(k, order) {
                    let unit = time_unit_s.powi(order as i32);
                    for axis in 0..3 {
                        knot[(order, axis)] = solution[(row, axis)] / unit;
                    }
                }
            }
        }
        knots
    }

    /// The polynomials between knots.
    pub(crate) fn polynomials(&self, knots: &[Knot], times_s: &[f64]) -> Vec<Segment> {
        knots
            .windows(2)
            .zip(times_s)
            .map(|(pair, t_s)| Segment {
                duration_s: *t_s,
                coefficients: self
                    .hermite
                    .coefficients(&ends_in_unit(&pair[0], &pair[1], *t_s)),
            })
            .collect()
    }

    /// Integral of squared snap over the whole path, m^2/s^7.
    pub(crate) fn cost(&self, knots: &[Knot], times_s: &[f64]) -> f64 {
        self.costs(knots, times_s)
            .iter()
            .map(|(cost, _)| cost)
            .sum()
    }

    /// Cost of each segment, integral of squared snap (m^2/s^7), and its derivative with respect
    /// to the logarithm of the segment's time while the knots stay: with D_a the end derivatives
    /// over `u`, cost = T^-7 D^T H D and D_a grows as T^order.
    pub(crate) fn costs(&self, knots: &[Knot], times_s: &[f64]) -> Vec<(f64, f64)> {
        knots
            .windows(2)
            .zip(times_s)
            .map(|(pair, t_s)| {
                let ends = ends_in_unit(&pair[0], &pair[1], *t_s);
                let slope = self.hermite.snap_cost * ends;
                let by_order = Ends::from_fn(|a, axis| (a % ORDERS) as f64 * ends[(a, axis)]);
                let scale = t_s.powi(-7);
                let cost = ends.dot(&slope) * scale;
                (cost, 2.0 * by_order.dot(&slope) * scale - 7.0 * cost)
            })
            .collect()
    }
}

/// Derivatives at both ends of a segment with time counted in `unit_s`.
pub(crate) fn ends_in_unit(left: &Knot, right: &Knot, unit_s: f64) -> Ends {
    Ends::from_fn(|row, axis| {
        let (knot, order) = if row < ORDERS {
            (left, row)
        } else {
            (right, row - ORDERS)
        };
        knot[(order, axis)] * unit_s.powi(order as i32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    const TIMES_S: [f64; 4] = [2.0, 1.2, 4.5, 2.2];

    fn problem(hermite: &Hermite) -> SnapProblem<'_> {
        let start = Reference {
            velocity_world: Vector3::new(0.8, 0.1, 0.0),
            jerk_world: Vector3::new(0.0, 0.5, -0.3),
            ..Reference::default()
        };
        let waypoints = [
            Vector3::new(3.0, 0.0, 1.0),
            Vector3::new(3.0, 2.0, 1.5),
            Vector3::new(-1.0, 4.0, 0.5),
            Vector3::new(-2.0, 4.5, 0.5),
        ];
        SnapProblem::new(hermite, &start, &waypoints)
    }

    #[test]
    fn no_change_of_the_free_derivatives_lowers_the_cost() {
        let hermite = Hermite::new().unwrap();
        let problem = problem(&hermite);
        let knots = problem.solve(&TIMES_S).unwrap();
        let least = problem.cost(&knots, &TIMES_S);
        let mut random = Pcg64::seed_from_u64(2);
        for case in 0..500 {
            let size = 10_f64.powi(case % 5 - 4);
            let mut moved = knots.clone();
            for (k, knot) in moved.iter_mut().enumerate() {
                for order in 0..ORDERS {
                    if problem.unknown(k, order).is_some() {
                        for axis in 0..3 {
                            knot[(order, axis)] += size * random.random_range(-1.0..1.0);
                        }
                    }
                }
            }
            assert!(problem.cost(&moved, &TIMES_S) > least);
        }
    }

    /// The optimum through given positions is the natural spline of degree seven: what degree nine
    /// has beyond it stays zero.
    #[test]
    fn the_optimum_is_of_degree_seven() {
        let hermite = Hermite::new().unwrap();
        let problem = problem(&hermite);
        let knots = problem.solve(&TIMES_S).unwrap();
        for segment in problem.polynomials(&knots, &TIMES_S) {
            let beyond = segment.coefficients.rows_range(8..).amax() / segment.coefficients.amax();
            // Rounding of 1e-16 times the condition number of the program, some 1e8.
            assert!(beyond < 1e-7, "{beyond}");
        }
    }

    #[test]
    fn times_that_differ_by_a_hundred_are_solved() {
        let hermite = Hermite::new().unwrap();
        let problem = problem(&hermite);
        let times_s = [0.2, 20.0, 0.5, 3.0];
        let knots = problem.solve(&times_s).unwrap();
        for (k, segment) in problem.polynomials(&knots, &times_s).iter().enumerate() {
            let miss = segment.derivative(0, 1.0) - problem.points[k + 1];
            // Powers of a long segment cancel from 1e7 m, with which rounding grows.
            assert!(miss.norm() < 1e-6, "{}", miss.norm());
        }
    }
}
