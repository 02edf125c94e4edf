//! Keeps the path near the straight lines between waypoints.
//!
//! The distance from a line is not linear, so the corridor is cut out step by step: wherever the
//! path leaves it, the half-space that touches the corridor there becomes an inequality of the
//! quadratic program, until the path stays inside.

use alula_optim::{ActiveSetSettings, ActiveSetSolver, Exit, LinearRows};
use nalgebra::{DMatrix, DVector, Vector3};

use crate::hermite::{COEFFICIENTS, ORDERS};
use crate::problem::{Knot, SnapProblem, SnapProgram, ends_in_unit};
use crate::trajectory::Segment;

/// Places per segment at which the distance is checked.
const CHECKS: usize = 24;
/// Cuts are made this much inside the corridor, so that rounds of cutting end.
const CUT_SHARE: f64 = 0.97;
/// Rounds of cutting; each halves the excess or better.
const MAX_ROUNDS: usize = 15;

/// A half-space `normal . p(u) <= bound` for a point of a segment.
struct Cut {
    segment: usize,
    u: f64,
    normal: Vector3<f64>,
    bound: f64,
}

/// The solution that keeps within `corridor_m(segment)` of the lines between the points, starting
/// from the one without corridor.
///
/// # Errors
/// How the solver ended if there is no such path.
pub(crate) fn solve(
    problem: &SnapProblem<'_>,
    times_s: &[f64],
    corridor_m: impl Fn(usize) -> f64,
    free: Vec<Knot>,
) -> Result<Vec<Knot>, Exit> {
    let mut knots = free;
    let mut cuts = Vec::new();
    let mut solver = None;
    for _ in 0..MAX_ROUNDS {
        let before = cuts.len();
        add_cuts(
            problem,
            &problem.polynomials(&knots, times_s),
            &corridor_m,
            &mut cuts,
        );
        if cuts.len() == before {
            return Ok(knots);
        }
        let joint = match &mut solver {
            Some(joint) => joint,
            None => solver.insert(Joint::new(problem, times_s)?),
        };
        knots = joint.solve(problem, times_s, &cuts)?;
    }
    Err(Exit::IterationLimit {
        violation: worst_excess(problem, &problem.polynomials(&knots, times_s), &corridor_m),
    })
}

/// The greatest distance (m) by which the path leaves the corridor.
fn worst_excess(
    problem: &SnapProblem<'_>,
    segments: &[Segment],
    corridor_m: impl Fn(usize) -> f64,
) -> f64 {
    let mut worst = 0.0_f64;
    for (i, segment) in segments.iter().enumerate() {
        for k in 1..CHECKS {
            let offset = offset(problem, i, segment, k as f64 / CHECKS as f64);
            worst = worst.max(offset.norm() - corridor_m(i));
        }
    }
    worst
}

/// From the nearest point of the straight line of segment `i` to the path at `u`.
fn offset(problem: &SnapProblem<'_>, i: usize, segment: &Segment, u: f64) -> Vector3<f64> {
    let (from, to) = (problem.points[i], problem.points[i + 1]);
    let line = to - from;
    let point = segment.derivative(0, u);
    let along = ((point - from).dot(&line) / line.norm_squared()).clamp(0.0, 1.0);
    point - (from + line * along)
}

/// Adds a cut at each place where the distance has a local maximum outside the corridor.
fn add_cuts(
    problem: &SnapProblem<'_>,
    segments: &[Segment],
    corridor_m: impl Fn(usize) -> f64,
    cuts: &mut Vec<Cut>,
) {
    for (i, segment) in segments.iter().enumerate() {
        let offsets: Vec<Vector3<f64>> = (0..=CHECKS)
            .map(|k| offset(problem, i, segment, k as f64 / CHECKS as f64))
            .collect();
        for k in 1..CHECKS {
            let distance = offsets[k].norm();
            let is_peak = distance >= offsets[k - 1].norm() && distance >= offsets[k + 1].norm();
            if distance > corridor_m(i) && is_peak {
                let u = k as f64 / CHECKS as f64;
                let normal = offsets[k] / distance;
                let nearest = segment.derivative(0, u) - offsets[k];
                cuts.push(Cut {
                    segment: i,
                    u,
                    normal,
                    bound: normal.dot(&nearest) + CUT_SHARE * corridor_m(i),
                });
            }
        }
    }
}

/// The program of all three axes together: a cut couples them.
struct Joint {
    solver: ActiveSetSolver,
    program: SnapProgram,
}

impl Joint {
    fn new(problem: &SnapProblem<'_>, times_s: &[f64]) -> Result<Self, Exit> {
        let program = problem.program(times_s);
        let n = problem.unknowns();
        let mut hessian = DMatrix::zeros(3 * n, 3 * n);
        for axis in 0..3 {
            hessian
                .view_mut((axis * n, axis * n), (n, n))
                .copy_from(&program.hessian);
        }
        let mut solver = ActiveSetSolver::new(ActiveSetSettings::default());
        solver.prepare(&hessian)?;
        Ok(Self { solver, program })
    }

    fn solve(
        &mut self,
        problem: &SnapProblem<'_>,
        times_s: &[f64],
        cuts: &[Cut],
    ) -> Result<Vec<Knot>, Exit> {
        let n = problem.unknowns();
        let variables = 3 * n;
        let mut rows = LinearRows {
            matrix: DMatrix::zeros(cuts.len(), variables),
            bound: DVector::zeros(cuts.len()),
        };
        let unit_s = self.program.time_unit_s;
        let prescribed = problem.knots(&DMatrix::zeros(n, 3), unit_s);
        for (row, cut) in cuts.iter().enumerate() {
            fill_row(problem, times_s, unit_s, &prescribed, cut, row, &mut rows);
        }
        let gradient = DVector::from_column_slice(self.program.gradient.as_slice());
        let none = LinearRows::none(variables);
        let report = self.solver.solve_prepared(&gradient, &none, &rows);
        if !report.exit.is_converged() {
            return Err(report.exit);
        }
        let solution = DMatrix::from_column_slice(n, 3, self.solver.x().as_slice());
        Ok(problem.knots(&solution, unit_s))
    }
}

/// Writes a cut in terms of the unknowns.
fn fill_row(
    problem: &SnapProblem<'_>,
    times_s: &[f64],
    unit_s: f64,
    prescribed: &[Knot],
    cut: &Cut,
    row: usize,
    rows: &mut LinearRows,
) {
    let (i, t_s, n) = (cut.segment, times_s[cut.segment], problem.unknowns());
    let weights = problem.hermite.weights(cut.u);
    let fixed = ends_in_unit(&prescribed[i], &prescribed[i + 1], t_s);
    rows.bound[row] = cut.bound - (fixed.tr_mul(&weights)).dot(&cut.normal);
    for a in 0..COEFFICIENTS {
        let order = a % ORDERS;
        if let Some(unknown) = problem.unknown(i + a / ORDERS, order) {
            let share = weights[a] * (t_s / unit_s).powi(order as i32);
            for axis in 0..3 {
                rows.matrix[(row, axis * n + unknown)] = share * cut.normal[axis];
            }
        }
    }
}
