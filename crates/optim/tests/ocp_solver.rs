//! The solver of optimal control problems: conditions of optimality, bad starts, bad problems.

// Helpers of tests may unwrap as tests may.
#![allow(clippy::unwrap_used)]

mod ocp_support;

use alula_optim::ocp::{
    OcpExit, OcpReport, OcpSettings, OcpSolver, OptimalControl, SoftConstraint, StageCost,
    StageQpSettings, Step,
};
use nalgebra::{SMatrix, SVector, Vector1, Vector3};
use ocp_support::Numbers;
use ocp_support::mover::{Ellipsoid, Input, Mover, NU, NX, State};

fn start(x: f64, y: f64) -> State {
    let mut state = State::zeros();
    state[0] = x;
    state[1] = y;
    state
}

fn still(x: f64, y: f64) -> Ellipsoid {
    Ellipsoid {
        centre: Vector3::new(x, y, 0.0),
        velocity: Vector3::zeros(),
        semi_axes: Vector3::new(0.8, 0.8, 1.5),
    }
}

fn problem(ellipsoids: Vec<Ellipsoid>) -> Mover {
    Mover::new(Vector3::new(3.0, 0.0, 0.0), Vector3::zeros(), ellipsoids)
}

fn precise() -> OcpSettings {
    OcpSettings {
        max_iterations: 100,
        max_newton_steps: 10_000,
        tolerance: 1e-6,
        qp: StageQpSettings {
            tolerance: 1e-9,
            ..StageQpSettings::default()
        },
    }
}

fn solver(problem: &Mover, from: &State, settings: OcpSettings) -> OcpSolver<NX, NU> {
    let mut solver = OcpSolver::new(problem.intervals, problem.max_constraints(), settings);
    let states = vec![*from; problem.intervals + 1];
    solver.set_guess(&states, &vec![Input::zeros(); problem.intervals]);
    solver
}

fn solve_cold(
    problem: &Mover,
    from: &State,
    settings: OcpSettings,
) -> (OcpSolver<NX, NU>, OcpReport) {
    let mut solver = solver(problem, from, settings);
    let report = solver.solve(problem, from);
    (solver, report)
}

/// Costs and penalties of inputs flown from a state.
fn flown_cost(problem: &Mover, from: &State, inputs: &[Input]) -> f64 {
    let (mut x, mut sum) = (*from, 0.0);
    for k in 0..=inputs.len() {
        let input = inputs.get(k).copied().unwrap_or_else(Input::zeros);
        sum += problem.cost_value(k, &x, &input);
        if k > 0 {
            problem.constraint_values(k, &x, &mut |value, linear, quadratic| {
                let s = (-value).max(0.0);
                sum += linear * s + quadratic * s * s;
            });
        }
        if k < inputs.len() {
            x = problem.next(k, &x, &input);
        }
    }
    sum
}

/// The greatest decrease of the flown cost, per length, over many short changes of the inputs
/// within their bounds.
fn steepest_descent(problem: &Mover, from: &State, inputs: &[Input]) -> f64 {
    const LENGTH: f64 = 1e-5;
    let here = flown_cost(problem, from, inputs);
    let mut numbers = Numbers(3);
    let mut steepest = 0.0_f64;
    for case in 0..600 {
        let mut changed = inputs.to_vec();
        for (k, input) in changed.iter_mut().enumerate() {
            let (lower, upper) = problem.input_bounds(k);
            let direction = numbers.matrix::<NU, 1>();
            // Every input alone both ways, then all together.
            let single = |i: usize| case / 2 == k * NU + i;
            for i in 0..NU {
                let alone = f64::from(u8::from(single(i))) * if case % 2 == 0 { 1.0 } else { -1.0 };
                let change = if case < 200 {
                    alone
                } else {
                    0.1 * direction[i]
                };
                input[i] = (input[i] + LENGTH * change).clamp(lower[i], upper[i]);
            }
        }
        steepest = steepest.max((here - flown_cost(problem, from, &changed)) / LENGTH);
    }
    steepest
}

/// A slope that is left: curvatures of inputs reach 10, what is left of the way to the solution
/// 1e-6 of it; differences over 1e-5 round at 1e-10.
const SLOPE_LEFT: f64 = 1e-4;

fn check_stationary(ellipsoids: Vec<Ellipsoid>, from: State) {
    let problem = problem(ellipsoids);
    let (solver, report) = solve_cold(&problem, &from, precise());
    assert_eq!(report.exit, OcpExit::Converged, "{report:?}");
    let slope = steepest_descent(&problem, &from, solver.inputs());
    // A promised decrease of 1e-10 of the cost ends the solve; it is slope² / (2 curvature).
    let flat = (2.0 * 10.0 * 1e-10 * report.cost).sqrt();
    assert!(slope < SLOPE_LEFT.max(flat), "{slope} {report:?}");
    let cost = flown_cost(&problem, &from, solver.inputs());
    assert!((cost - report.cost).abs() < 1e-9 * cost);
}

#[test]
fn in_the_open_no_change_of_the_inputs_lowers_the_cost() {
    check_stationary(vec![], start(0.0, 0.0));
}

#[test]
fn past_an_ellipsoid_no_change_of_the_inputs_lowers_the_cost() {
    check_stationary(vec![still(1.5, 0.2)], start(0.0, 0.0));
}

#[test]
fn between_ellipsoids_no_change_of_the_inputs_lowers_the_cost() {
    check_stationary(vec![still(1.2, 1.0), still(1.2, -0.9)], start(0.0, 0.1));
}

#[test]
fn from_within_an_ellipsoid_no_change_of_the_inputs_lowers_the_cost() {
    check_stationary(vec![still(-0.2, 0.1)], start(0.0, 0.0));
}

#[test]
fn before_the_end_some_change_of_the_inputs_lowers_the_cost() {
    let (problem, from) = (problem(vec![still(1.5, 0.2)]), start(0.0, 0.0));
    let settings = OcpSettings {
        max_iterations: 1,
        ..precise()
    };
    let (solver, report) = solve_cold(&problem, &from, settings);
    assert_eq!(report.exit, OcpExit::IterationLimit);
    assert!(steepest_descent(&problem, &from, solver.inputs()) > SLOPE_LEFT);
}

#[test]
fn the_derivatives_of_the_test_problem_are_those_of_its_values() {
    let problem = problem(vec![still(1.0, 0.2)]);
    let mut numbers = Numbers(5);
    let (x, u) = (
        numbers.matrix::<NX, 1>() * 0.5,
        numbers.matrix::<NU, 1>() * 0.5,
    );
    let (step, mut cost) = (problem.step(0, &x, &u), StageCost::default());
    problem.cost(0, &x, &u, &mut cost);
    let h = 1e-5;
    for i in 0..NX {
        let mut off = State::zeros();
        off[i] = h;
        let column =
            (problem.next(0, &(x + off), &u) - problem.next(0, &(x - off), &u)) / (2.0 * h);
        assert!((column - step.a.column(i)).amax() < 1e-8);
        let (more, less) = (x + off, x - off);
        let slope =
            (problem.cost_value(0, &more, &u) - problem.cost_value(0, &less, &u)) / (2.0 * h);
        assert!((slope - cost.x[i]).abs() < 1e-7);
    }
    for i in 0..NU {
        let mut off = Input::zeros();
        off[i] = h;
        let column =
            (problem.next(0, &x, &(u + off)) - problem.next(0, &x, &(u - off))) / (2.0 * h);
        assert!((column - step.b.column(i)).amax() < 1e-8);
    }
}

#[test]
fn a_way_out_of_an_ellipsoid_is_found() {
    let (problem, from) = (problem(vec![still(-0.2, 0.1)]), start(0.0, 0.0));
    let (solver, report) = solve_cold(&problem, &from, OcpSettings::default());
    assert!(report.max_violation > 0.1);
    let mut last_values = vec![];
    problem.constraint_values(25, &solver.states()[25], &mut |value, _, _| {
        last_values.push(value)
    });
    assert!(last_values.iter().all(|v| *v > -1e-6), "{last_values:?}");
}

#[test]
fn a_guess_that_misses_the_dynamics_ends_in_a_trajectory_that_meets_them() {
    let (problem, from) = (problem(vec![still(1.5, 0.2)]), start(0.0, 0.0));
    let mut solver = solver(&problem, &from, OcpSettings::default());
    // A straight line, faster than allowed, without inputs.
    let line: Vec<State> = (0..=25).map(|k| start(0.12 * k as f64, 0.0)).collect();
    solver.set_guess(&line, &[Input::zeros(); 25]);
    let report = solver.solve(&problem, &from);
    assert_eq!(report.exit, OcpExit::Converged);
    assert_eq!(solver.states()[0], from);
    for k in 0..25 {
        let (x, u) = (&solver.states()[k], &solver.inputs()[k]);
        assert_eq!(problem.next(k, x, u), solver.states()[k + 1]);
        let (lower, upper) = problem.input_bounds(k);
        assert!((0..NU).all(|i| lower[i] <= u[i] && u[i] <= upper[i]));
    }
}

#[test]
fn more_iterations_never_cost_more() {
    for (seed, ellipsoids) in [(1, 1), (2, 2), (3, 4)] {
        let mut numbers = Numbers(seed);
        let place = |_| still(1.5 + numbers.signed(), numbers.signed());
        let problem = problem((0..ellipsoids).map(place).collect());
        let from = start(0.0, 0.1);
        let mut last = f64::INFINITY;
        for max_iterations in 0..12 {
            let settings = OcpSettings {
                max_iterations,
                ..precise()
            };
            let (_, report) = solve_cold(&problem, &from, settings);
            assert!(report.cost.is_finite() && report.cost <= last, "{report:?}");
            last = report.cost;
        }
    }
}

#[test]
fn newton_steps_are_bounded_over_a_whole_solve() {
    let (problem, from) = (problem(vec![still(1.5, 0.2)]), start(0.0, 0.0));
    for max_newton_steps in [0, 1, 7, 15] {
        let settings = OcpSettings {
            max_newton_steps,
            ..precise()
        };
        let (_, report) = solve_cold(&problem, &from, settings);
        assert_eq!(report.qp_iterations, max_newton_steps);
        assert_eq!(report.exit, OcpExit::IterationLimit);
        assert!(report.cost.is_finite());
    }
}

/// With one Newton step a subproblem whose bounds act is not solved.
#[test]
fn a_subproblem_that_was_not_solved_is_no_convergence() {
    let (problem, from) = (problem(vec![still(1.5, 0.2)]), start(0.0, 0.0));
    let hasty = OcpSettings {
        max_iterations: 1,
        // Any step would be small enough.
        tolerance: 1e3,
        qp: StageQpSettings {
            max_iterations: 1,
            ..StageQpSettings::default()
        },
        ..OcpSettings::default()
    };
    let (_, report) = solve_cold(&problem, &from, hasty);
    assert_ne!(report.exit, OcpExit::Converged, "{report:?}");
}

#[test]
fn what_is_not_finite_leaves_the_trajectory_as_it_was() {
    let (mut problem, from) = (problem(vec![still(1.5, 0.2)]), start(0.0, 0.0));
    let (mut solver, _) = solve_cold(&problem, &from, OcpSettings::default());
    let before = solver.clone();
    let mut check = |problem: &Mover, from: &State| {
        let report = solver.solve(problem, from);
        assert_eq!(report.exit, OcpExit::NotFinite);
        assert_eq!(solver.states(), before.states());
        assert_eq!(solver.inputs(), before.inputs());
    };
    check(&problem, &start(f64::NAN, 0.0));
    check(&problem, &start(0.0, f64::INFINITY));
    problem.ellipsoids[0].centre.x = f64::NAN;
    check(&problem, &from);
    // And it recovers.
    problem.ellipsoids[0].centre.x = 1.5;
    assert_eq!(solver.solve(&problem, &from).exit, OcpExit::Converged);
}

#[test]
fn ellipsoids_everywhere_end_in_a_finite_trajectory() {
    let mut numbers = Numbers(11);
    for _ in 0..20 {
        let count = 3 + (8.0 * numbers.unit()) as usize;
        let place = |_| still(numbers.signed(), numbers.signed());
        let problem = problem((0..count).map(place).collect());
        let (solver, report) = solve_cold(&problem, &start(0.0, 0.0), OcpSettings::default());
        assert!(report.cost.is_finite() && report.max_violation.is_finite());
        assert!(solver.inputs().iter().flatten().all(|u| u.is_finite()));
        assert_ne!(report.exit, OcpExit::NotFinite);
    }
}

#[test]
fn a_shift_moves_everything_one_interval_earlier_and_repeats_the_last() {
    let (problem, from) = (problem(vec![]), start(0.0, 0.0));
    let (mut solver, _) = solve_cold(&problem, &from, OcpSettings::default());
    let before = solver.clone();
    solver.shift();
    assert_eq!(solver.states()[..25], before.states()[1..]);
    assert_eq!(solver.states()[25], before.states()[25]);
    assert_eq!(solver.inputs()[..24], before.inputs()[1..]);
    assert_eq!(solver.inputs()[24], before.inputs()[24]);
}

/// A point on a line that is told to stay right of 1 and left of -1.
struct Torn {
    /// Curvature in the input.
    effort: f64,
}

impl OptimalControl<1, 1> for Torn {
    fn intervals(&self) -> usize {
        4
    }

    fn next(&self, _: usize, x: &Vector1<f64>, u: &Vector1<f64>) -> Vector1<f64> {
        x + u
    }

    fn step(&self, k: usize, x: &Vector1<f64>, u: &Vector1<f64>) -> Step<1, 1> {
        Step {
            next: self.next(k, x, u),
            a: SMatrix::identity(),
            b: SMatrix::identity(),
        }
    }

    fn input_bounds(&self, _: usize) -> (Vector1<f64>, Vector1<f64>) {
        (SVector::repeat(-1.0), SVector::repeat(1.0))
    }

    fn cost_value(&self, _: usize, _: &Vector1<f64>, u: &Vector1<f64>) -> f64 {
        0.5 * self.effort * u[0] * u[0]
    }

    fn cost(&self, k: usize, x: &Vector1<f64>, u: &Vector1<f64>, cost: &mut StageCost<1, 1>) {
        *cost = StageCost::default();
        cost.value = self.cost_value(k, x, u);
        cost.u = u * self.effort;
        cost.uu[0] = self.effort;
    }

    fn max_constraints(&self) -> usize {
        2
    }

    fn constraints(&self, _: usize, x: &Vector1<f64>, take: &mut dyn FnMut(&SoftConstraint<1>)) {
        for sign in [1.0, -1.0] {
            take(&SoftConstraint {
                value: sign * x[0] - 1.0,
                gradient: Vector1::new(sign),
                linear: 10.0,
                quadratic: 10.0,
            });
        }
    }

    fn constraint_values(&self, _: usize, x: &Vector1<f64>, take: &mut dyn FnMut(f64, f64, f64)) {
        take(x[0] - 1.0, 10.0, 10.0);
        take(-x[0] - 1.0, 10.0, 10.0);
    }
}

fn torn(effort: f64) -> (OcpSolver<1, 1>, OcpReport) {
    let mut solver = OcpSolver::new(4, 2, precise());
    let report = solver.solve(&Torn { effort }, &Vector1::new(0.9));
    (solver, report)
}

#[test]
fn constraints_that_contradict_each_other_share_the_violation() {
    let (solver, report) = torn(1e-6);
    assert_eq!(report.exit, OcpExit::Converged);
    // The squares are least in the middle; the effort of the move is a millionth.
    assert!(solver.states()[1..].iter().all(|x| x[0].abs() < 1e-6));
    assert!((report.max_violation - 1.0).abs() < 1e-6);
}

#[test]
fn inputs_without_curvature_are_no_harm() {
    let (solver, report) = torn(0.0);
    assert!(
        solver.states()[1..].iter().all(|x| x[0].abs() < 1e-3),
        "{report:?}"
    );
}
