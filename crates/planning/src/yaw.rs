//! Yaw with the least integral of squared yaw acceleration that keeps a rate limit: a quadratic
//! program over cubic pieces (document S, equation 2.88, second term).

use alula_geometry::so3;
use alula_optim::{ActiveSetSettings, ActiveSetSolver, Exit, LinearRows, QuadraticProgram};
use nalgebra::{DMatrix, DVector, Matrix4};
use serde::{Deserialize, Serialize};

/// Weight of a wish for a yaw against squared yaw acceleration, in units of a piece: the wish is
/// met to a thousandth of what the turn costs unless the rate limit forbids it.
const WISH_WEIGHT: f64 = 1e4;
/// A yaw closer than this to the last wish needs no turn in place, rad.
const CLOSE_RAD: f64 = 1e-6;

/// Where the vehicle looks on its way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum YawPolicy {
    /// Keep the yaw of the start.
    #[default]
    Hold,
    /// Look where the motion goes; vertical motion keeps the yaw.
    FaceMotion,
    /// Turn to this yaw by the shorter way, rad.
    Fixed(f64),
}

/// A knot of the yaw: its time and the yaw that is wished for there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct YawWish {
    pub time_s: f64,
    pub yaw_rad: Option<f64>,
}

/// A cubic piece by the values at its ends.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    start_s: f64,
    duration_s: f64,
    yaw_rad: [f64; 2],
    rate_rad_s: [f64; 2],
}

/// Yaw over time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct YawSpline {
    pieces: Vec<Piece>,
}

impl YawSpline {
    /// The spline from a start through wishes to rest at `end_rad`. Wishes that the rate limit
    /// forbids are missed, and the end is reached by a turn in place after the last knot.
    ///
    /// # Errors
    /// How the solver ended if not with a solution.
    pub(crate) fn plan(
        start: (f64, f64),
        wishes: &[YawWish],
        end_rad: f64,
        max_rate_rad_s: f64,
    ) -> Result<Self, Exit> {
        // The start may turn faster than allowed; it is not for the plan to forbid that.
        let limit = max_rate_rad_s.max(start.1.abs());
        let program = YawProgram::new(start, wishes, limit);
        let mut spline = match program.solve(End::Fixed(end_rad)) {
            Err(Exit::Infeasible { .. }) => program.solve(End::Wished(end_rad))?,
            other => other?,
        };
        spline.turn_in_place(end_rad, max_rate_rad_s);
        Ok(spline)
    }

    pub(crate) fn duration_s(&self) -> f64 {
        self.pieces.last().map_or(0.0, |p| p.start_s + p.duration_s)
    }

    /// Yaw (wrapped, rad), rate and acceleration; at rest after the end.
    pub(crate) fn sample(&self, t_s: f64) -> (f64, f64, f64) {
        let index = self
            .pieces
            .partition_point(|p| p.start_s + p.duration_s <= t_s);
        match (self.pieces.get(index), self.pieces.last()) {
            (Some(piece), _) => piece.sample(t_s),
            (None, Some(last)) => (so3::wrap_angle(last.yaw_rad[1]), 0.0, 0.0),
            (None, None) => (0.0, 0.0, 0.0),
        }
    }

    pub(crate) fn max_rate_rad_s(&self) -> f64 {
        self.pieces.iter().map(Piece::max_rate).fold(0.0, f64::max)
    }

    /// A cubic turn from rest to rest peaks at 1.5 times its mean rate.
    fn turn_in_place(&mut self, end_rad: f64, max_rate_rad_s: f64) {
        let Some(last) = self.pieces.last() else {
            return;
        };
        let (from, start_s) = (last.yaw_rad[1], last.start_s + last.duration_s);
        let turn = end_rad - from;
        if turn.abs() > CLOSE_RAD {
            self.pieces.push(Piece {
                start_s,
                duration_s: 1.5 * turn.abs() / max_rate_rad_s,
                yaw_rad: [from, end_rad],
                rate_rad_s: [0.0, 0.0],
            });
        }
    }
}

impl Piece {
    /// Rate at the ends and the middle Bernstein coefficient of the rate, a quadratic.
    fn rate_coefficients(&self) -> [f64; 3] {
        let mean = (self.yaw_rad[1] - self.yaw_rad[0]) / self.duration_s;
        let [first, last] = self.rate_rad_s;
        [first, 3.0 * mean - first - last, last]
    }

    fn sample(&self, t_s: f64) -> (f64, f64, f64) {
        let h = self.duration_s;
        let u = (t_s - self.start_s) / h;
        let [a, b, c] = self.rate_coefficients();
        // The integral of a(1-u)^2 + 2b u(1-u) + c u^2.
        let turned = a * (u - u * u + u * u * u / 3.0)
            + b * (u * u - 2.0 / 3.0 * u * u * u)
            + c * u * u * u / 3.0;
        let rate = a * (1.0 - u).powi(2) + 2.0 * b * u * (1.0 - u) + c * u * u;
        let acceleration = 2.0 * ((b - a) * (1.0 - u) + (c - b) * u) / h;
        (
            so3::wrap_angle(self.yaw_rad[0] + h * turned),
            rate,
            acceleration,
        )
    }

    fn max_rate(&self) -> f64 {
        let [a, b, c] = self.rate_coefficients();
        let curvature = a - 2.0 * b + c;
        let u = if curvature == 0.0 {
            0.0
        } else {
            ((a - b) / curvature).clamp(0.0, 1.0)
        };
        let middle = a * (1.0 - u).powi(2) + 2.0 * b * u * (1.0 - u) + c * u * u;
        a.abs().max(c.abs()).max(middle.abs())
    }
}

/// How the last knot is treated.
#[derive(Clone, Copy)]
enum End {
    Fixed(f64),
    Wished(f64),
}

/// Adds a wish for the value of an unknown.
fn wish(program: &mut QuadraticProgram, unknown: usize, value: f64) {
    program.hessian[(unknown, unknown)] += 2.0 * WISH_WEIGHT;
    program.gradient[unknown] -= 2.0 * WISH_WEIGHT * value;
}

/// The program over yaw and rate at the knots, with time in mean pieces.
struct YawProgram {
    program: QuadraticProgram,
    start: (f64, f64),
    times_s: Vec<f64>,
    unit_s: f64,
}

impl YawProgram {
    fn new(start: (f64, f64), wishes: &[YawWish], limit_rad_s: f64) -> Self {
        let mut times_s = vec![0.0];
        times_s.extend(wishes.iter().map(|wish| wish.time_s));
        let pieces = wishes.len();
        let unit_s = times_s[pieces] / pieces as f64;
        let n = 2 * pieces;
        let mut this = Self {
            program: QuadraticProgram::unconstrained(DMatrix::zeros(n, n), DVector::zeros(n)),
            start,
            times_s,
            unit_s,
        };
        this.program.inequality = LinearRows {
            matrix: DMatrix::zeros(4 * pieces, n),
            bound: DVector::from_element(4 * pieces, limit_rad_s * unit_s),
        };
        for piece in 0..pieces {
            this.add_acceleration(piece);
            this.add_rate_limits(piece);
        }
        for (knot, wish) in wishes.iter().enumerate() {
            if let Some(yaw_rad) = wish.yaw_rad {
                self::wish(&mut this.program, 2 * knot, yaw_rad);
            }
        }
        this
    }

    fn length(&self, piece: usize) -> f64 {
        (self.times_s[piece + 1] - self.times_s[piece]) / self.unit_s
    }

    /// Value of an unknown that is prescribed: yaw and rate of the start.
    fn start_value(&self, entry: usize) -> f64 {
        [self.start.0, self.start.1 * self.unit_s][entry]
    }

    /// Twice the integral of squared acceleration of a cubic with end values (yaw, rate, yaw, rate).
    fn add_acceleration(&mut self, piece: usize) {
        let h = self.length(piece);
        let (a, b, c, d) = (12.0 / h.powi(3), 6.0 / h.powi(2), 4.0 / h, 2.0 / h);
        let cost = Matrix4::new(a, b, -a, b, b, c, -b, d, -a, -b, a, -b, b, d, -b, c) * 2.0;
        for i in 0..4 {
            let Some(row) = (2 * piece + i).checked_sub(2) else {
                continue;
            };
            for j in 0..4 {
                match (2 * piece + j).checked_sub(2) {
                    Some(column) => self.program.hessian[(row, column)] += cost[(i, j)],
                    None => self.program.gradient[row] += cost[(i, j)] * self.start_value(j),
                }
            }
        }
    }

    /// The middle Bernstein coefficient of the rate and the rate at the end keep the limit, so the
    /// rate keeps it everywhere between.
    fn add_rate_limits(&mut self, piece: usize) {
        let h = self.length(piece);
        let middle = [-3.0 / h, -1.0, 3.0 / h, -1.0];
        let end = [0.0, 0.0, 0.0, 1.0];
        for (k, row) in [middle, end].into_iter().enumerate() {
            for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
                let at = 4 * piece + 2 * k + side;
                for (i, share) in row.into_iter().enumerate() {
                    match (2 * piece + i).checked_sub(2) {
                        Some(column) => {
                            self.program.inequality.matrix[(at, column)] = sign * share;
                        }
                        None => {
                            self.program.inequality.bound[at] -= sign * share * self.start_value(i);
                        }
                    }
                }
            }
        }
    }

    /// The spline that ends at rest.
    fn solve(&self, end: End) -> Result<YawSpline, Exit> {
        let mut program = self.program.clone();
        let n = program.gradient.len();
        // Row 0: rate at the end; row 1: yaw at the end.
        let bound = match end {
            End::Fixed(yaw_rad) => DVector::from_column_slice(&[0.0, yaw_rad]),
            End::Wished(yaw_rad) => {
                wish(&mut program, n - 2, yaw_rad);
                DVector::zeros(1)
            }
        };
        let matrix = DMatrix::from_fn(bound.len(), n, |row, column| {
            if column + 1 + row == n { 1.0 } else { 0.0 }
        });
        program.equality = LinearRows { matrix, bound };
        let mut solver = ActiveSetSolver::new(ActiveSetSettings::default());
        let report = solver.solve(&program);
        if !report.exit.is_converged() {
            return Err(report.exit);
        }
        Ok(self.spline(solver.x()))
    }

    fn spline(&self, x: &DVector<f64>) -> YawSpline {
        let value = |knot: usize, entry: usize| match (2 * knot + entry).checked_sub(2) {
            Some(i) => x[i],
            None => self.start_value(entry),
        };
        let pieces = (0..self.times_s.len() - 1)
            .map(|k| Piece {
                start_s: self.times_s[k],
                duration_s: self.times_s[k + 1] - self.times_s[k],
                yaw_rad: [value(k, 0), value(k + 1, 0)],
                rate_rad_s: [value(k, 1) / self.unit_s, value(k + 1, 1) / self.unit_s],
            })
            .collect();
        YawSpline { pieces }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knots(times_s: &[f64]) -> Vec<YawWish> {
        times_s
            .iter()
            .map(|time_s| YawWish {
                time_s: *time_s,
                yaw_rad: None,
            })
            .collect()
    }

    /// The Euler-Lagrange equation of squared acceleration is a vanishing fourth derivative.
    #[test]
    fn without_limits_the_turn_is_one_cubic() {
        let spline = YawSpline::plan((0.0, 0.0), &knots(&[0.5, 1.7, 2.0, 4.0]), 1.5, 50.0).unwrap();
        for k in 0..=40 {
            let s = f64::from(k) / 40.0;
            let (yaw, rate, acceleration) = spline.sample(4.0 * s - 1e-12);
            assert!((yaw - 1.5 * s * s * (3.0 - 2.0 * s)).abs() < 1e-9);
            assert!((rate - 1.5 * 6.0 * s * (1.0 - s) / 4.0).abs() < 1e-9);
            assert!((acceleration - 1.5 * (6.0 - 12.0 * s) / 16.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_tight_limit_is_held_for_a_part_of_the_turn() {
        let pieces: Vec<f64> = (1..=8).map(|k| f64::from(k) * 0.5).collect();
        let spline = YawSpline::plan((0.0, 0.0), &knots(&pieces), 1.5, 0.5).unwrap();
        assert!((spline.duration_s() - 4.0).abs() < 1e-12);
        assert!((spline.max_rate_rad_s() - 0.5).abs() < 1e-9);
        assert!((spline.sample(2.0).1 - 0.5).abs() < 1e-9);
    }

    #[test]
    fn a_turn_that_takes_longer_than_its_knots_ends_in_place() {
        let spline = YawSpline::plan((0.0, 0.0), &knots(&[0.5, 1.0]), 2.0, 0.5).unwrap();
        assert!(spline.duration_s() > 4.0);
        assert!(spline.max_rate_rad_s() < 0.5 + 1e-9);
        assert_eq!(spline.sample(100.0), (2.0, 0.0, 0.0));
    }

    #[test]
    fn a_start_that_turns_too_fast_is_slowed_down() {
        let spline = YawSpline::plan((0.0, 2.0), &knots(&[1.0, 2.0, 4.0]), 0.0, 0.5).unwrap();
        assert!((spline.sample(0.0).1 - 2.0).abs() < 1e-12);
        assert!(spline.max_rate_rad_s() <= 2.0 + 1e-9);
        assert_eq!(spline.sample(100.0), (0.0, 0.0, 0.0));
    }
}
