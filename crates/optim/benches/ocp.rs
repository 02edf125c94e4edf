//! Time of one Riccati recursion, one subproblem, one solve at 9 states, 4 inputs, 25 intervals.
//! The fastest and the median count: both parts of the recursion are a fixed amount of work.

// It prints its budgets.
#![allow(clippy::print_stdout)]

#[path = "../tests/ocp_support/mod.rs"]
mod ocp_support;

use alula_optim::ocp::{OcpSettings, OcpSolver, OptimalControl, Riccati, StageQp, StageQpSolver};
use divan::{Bencher, black_box};
use nalgebra::{SVector, Vector3};
use ocp_support::mover::{Ellipsoid, Mover, NU, NX, State};
use ocp_support::{Numbers, random_qp};

const INTERVALS: usize = 25;

fn main() {
    println!("budgets: recursion 40 us, subproblem 250 us, solve 600 us");
    divan::main();
}

fn program(constraints: usize, spread: f64) -> StageQp<NX, NU> {
    random_qp(&mut Numbers(7), INTERVALS, constraints, spread)
}

#[divan::bench]
fn recursion_matrices(bencher: Bencher<'_, '_>) {
    let qp = program(0, 0.1);
    let mut riccati = Riccati::<NX, NU>::new(INTERVALS);
    bencher.bench_local(|| {
        let qp = black_box(&qp);
        riccati.factor(&qp.steps, &qp.costs, |_, _| {}, |_| SVector::zeros());
    });
}

#[divan::bench]
fn recursion_vectors(bencher: Bencher<'_, '_>) {
    let qp = program(0, 0.1);
    let mut riccati = Riccati::<NX, NU>::new(INTERVALS);
    riccati.factor(&qp.steps, &qp.costs, |_, _| {}, |_| SVector::zeros());
    let mut states = [SVector::zeros(); INTERVALS + 1];
    let mut inputs = [SVector::zeros(); INTERVALS];
    bencher.bench_local(|| {
        let qp = black_box(&qp);
        riccati.solve(
            &qp.steps,
            |k| qp.costs[k].x,
            |k| qp.costs[k].u,
            &qp.initial,
            &mut states,
            &mut inputs,
        );
    });
}

/// The multipliers of the last solve are those of this one.
#[divan::bench(args = [2, 10])]
fn subproblem_warm(bencher: Bencher<'_, '_>, constraints: usize) {
    let qp = program(constraints, 0.1);
    let mut solver = StageQpSolver::new(INTERVALS, constraints, Default::default());
    solver.solve(&qp);
    bencher.bench_local(|| solver.solve(black_box(&qp)));
}

#[divan::bench(args = [2, 10])]
fn subproblem_cold(bencher: Bencher<'_, '_>, constraints: usize) {
    let qp = program(constraints, 0.1);
    let mut solver = StageQpSolver::new(INTERVALS, constraints, Default::default());
    bencher.bench_local(|| {
        solver.forget();
        solver.solve(black_box(&qp))
    });
}

fn scene(ellipsoids: usize) -> (Mover, State) {
    let mut start = State::zeros();
    start[0] = -4.0;
    start[3] = 1.5;
    let place = |i: usize| Ellipsoid {
        centre: Vector3::new(-2.5 + 0.9 * i as f64, 1.0 - 2.1 * (i % 2) as f64, 0.0),
        velocity: Vector3::new(-0.3, 0.2 - 0.4 * (i % 2) as f64, 0.0),
        semi_axes: Vector3::new(0.85, 0.85, 1.5),
    };
    let ellipsoids = (0..ellipsoids).map(place).collect();
    let start_position = start.fixed_rows::<3>(0).into_owned();
    let goal = Vector3::new(4.0, 0.0, 0.0);
    (Mover::new(goal, start_position, ellipsoids), start)
}

/// One interval after the last solve, with everything moved on.
#[divan::bench(args = [2, 10])]
fn solve_warm(bencher: Bencher<'_, '_>, ellipsoids: usize) {
    let (mut problem, start) = scene(ellipsoids);
    let mut solver =
        OcpSolver::<NX, NU>::new(INTERVALS, problem.max_constraints(), OcpSettings::default());
    solver.set_guess(&[start; INTERVALS + 1], &[SVector::zeros(); INTERVALS]);
    solver.solve(&problem, &start);
    let mut now = problem.next(0, &start, &solver.inputs()[0]);
    now[0] += 0.01;
    now[4] += 0.02;
    for ellipsoid in &mut problem.ellipsoids {
        ellipsoid.centre += ellipsoid.velocity * 0.06;
    }
    solver.shift();
    bencher
        .with_inputs(|| solver.clone())
        .bench_local_values(|mut solver| solver.solve(black_box(&problem), &now));
}

#[divan::bench(args = [2, 10])]
fn solve_cold(bencher: Bencher<'_, '_>, ellipsoids: usize) {
    let (problem, start) = scene(ellipsoids);
    let mut solver =
        OcpSolver::<NX, NU>::new(INTERVALS, problem.max_constraints(), OcpSettings::default());
    bencher.bench_local(|| {
        solver.forget();
        solver.set_guess(&[start; INTERVALS + 1], &[SVector::zeros(); INTERVALS]);
        solver.solve(black_box(&problem), &start)
    });
}
