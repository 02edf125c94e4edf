//! The solver in a closed loop: what a warm start is worth, and that it asks for no memory.

#[path = "../../../tests/allocations.rs"]
mod allocations;
mod ocp_support;

use allocations::allocations;
use alula_optim::ocp::{OcpExit, OcpReport, OcpSettings, OcpSolver, OptimalControl};
use nalgebra::{SVector, Vector3};
use ocp_support::Numbers;
use ocp_support::mover::{Ellipsoid, INTERVAL_S, Mover, NU, NX, State, max_input};

const INTERVALS: usize = 25;

/// Ellipsoids that cross the way at random, and a solver that has not solved yet.
struct Loop {
    solver: OcpSolver<NX, NU>,
    state: State,
    ellipsoids: Vec<Ellipsoid>,
    numbers: Numbers,
}

impl Loop {
    fn new(seed: u64, settings: OcpSettings) -> Self {
        let mut numbers = Numbers(seed);
        let mut state = State::zeros();
        state[0] = -4.0;
        let crossing = |_| {
            let angle = std::f64::consts::PI * numbers.signed();
            let velocity = Vector3::new(angle.cos(), angle.sin(), 0.0) * (1.0 + numbers.unit());
            let meeting = Vector3::new(2.5 * numbers.signed(), 0.3 * numbers.signed(), 0.0);
            Ellipsoid {
                centre: meeting - velocity * ((meeting.x + 4.0) / 1.6),
                velocity,
                semi_axes: Vector3::new(0.85, 0.85, 1.5),
            }
        };
        let ellipsoids = (0..2).map(crossing).collect();
        let mut solver = OcpSolver::new(INTERVALS, 8, settings);
        solver.set_guess(&[state; INTERVALS + 1], &[SVector::zeros(); INTERVALS]);
        Self {
            solver,
            state,
            ellipsoids,
            numbers,
        }
    }

    /// The problem now, its ellipsoids seen with noise.
    fn problem(&mut self) -> Mover {
        let mut seen = self.ellipsoids.clone();
        for ellipsoid in &mut seen {
            let noise = self.numbers.matrix::<3, 1>();
            ellipsoid.centre += noise * 0.05;
        }
        let here = self.state.fixed_rows::<3>(0).into_owned();
        Mover::new(Vector3::new(4.0, 0.0, 0.0), here, seen)
    }

    fn advance(&mut self, problem: &Mover) {
        self.state = problem.next(0, &self.state, &self.solver.inputs()[0]);
        for i in 3..6 {
            self.state[i] += 0.005 * self.numbers.signed();
        }
        for ellipsoid in &mut self.ellipsoids {
            ellipsoid.centre += ellipsoid.velocity * INTERVAL_S;
        }
        self.solver.shift();
    }
}

/// Calls `each` with the solver's report at every step of some flights.
fn fly(settings: OcpSettings, mut each: impl FnMut(&mut Loop, &Mover, OcpReport)) {
    for seed in 0..4 {
        let mut run = Loop::new(seed, settings);
        for _ in 0..80 {
            let problem = run.problem();
            let state = run.state;
            let before = run.solver.clone();
            let report = run.solver.solve(&problem, &state);
            let after = std::mem::replace(&mut run.solver, before);
            each(&mut run, &problem, report);
            run.solver = after;
            run.advance(&problem);
        }
    }
}

#[test]
fn a_warm_start_takes_fewer_newton_steps_than_a_cold_one() {
    let (mut warm, mut cold) = (0, 0);
    fly(OcpSettings::default(), |run, problem, report| {
        warm += report.qp_iterations;
        let mut solver = OcpSolver::<NX, NU>::new(INTERVALS, 8, OcpSettings::default());
        solver.set_guess(&[run.state; INTERVALS + 1], &[SVector::zeros(); INTERVALS]);
        cold += solver.solve(problem, &run.state).qp_iterations;
    });
    assert!(warm < cold / 2, "{warm} warm, {cold} cold");
}

#[test]
fn nearly_every_step_converges_within_the_default_limit() {
    let (mut converged, mut all) = (0, 0);
    fly(OcpSettings::default(), |_, _, report| {
        converged += usize::from(report.exit == OcpExit::Converged);
        all += 1;
    });
    assert!(converged * 100 >= all * 99, "{converged} of {all}");
}

/// The default tolerance is a thousandth of the width of the bounds; ten times that covers what
/// the estimate of the distance misses.
#[test]
fn the_first_input_is_that_of_a_solution_to_many_digits() {
    let tight = OcpSettings {
        max_iterations: 100,
        tolerance: 1e-7,
        ..OcpSettings::default()
    };
    let mut errors = vec![];
    fly(OcpSettings::default(), |run, problem, _| {
        let (mut normal, state) = (run.solver.clone(), run.state);
        normal.solve(problem, &state);
        let mut exact = OcpSolver::<NX, NU>::new(INTERVALS, 8, tight);
        exact.set_guess(normal.states(), normal.inputs());
        exact.solve(problem, &state);
        let error = normal.inputs()[0] - exact.inputs()[0];
        errors.push(error.component_div(&(max_input() * 2.0)).amax());
    });
    errors.sort_by(f64::total_cmp);
    let p99 = errors[errors.len() * 99 / 100];
    assert!(p99 < 1e-2, "{p99}");
}

#[test]
fn a_solve_asks_for_no_memory() {
    for seed in 0..3 {
        let mut run = Loop::new(seed, OcpSettings::default());
        for _ in 0..60 {
            let problem = run.problem();
            let found = allocations(|| {
                run.solver.solve(&problem, &run.state);
                run.solver.shift();
            });
            assert_eq!(found, 0);
            run.advance(&problem);
        }
    }
}
