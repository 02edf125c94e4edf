//! The solvers against the conditions of optimality and against another solver.

// Helpers of tests may unwrap as tests may.
#![allow(clippy::unwrap_used)]

mod ocp_support;

use alula_optim::{
    ActiveSetSettings, ActiveSetSolver, Exit, KktResidual, LinearRows, QuadraticProgram,
    solve_equality,
};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SupportedConeT, ZeroConeT,
};
use nalgebra::{DMatrix, DVector};
use ocp_support::Numbers;
use proptest::prelude::*;

/// A program with a feasible point. The equalities have rank `rank` at most.
fn program_of_rank(
    rank: usize,
    n: usize,
    equalities: usize,
    inequalities: usize,
    seed: u64,
) -> QuadraticProgram {
    let mut numbers = Numbers(seed);
    let mut matrix =
        |rows: usize, columns: usize| DMatrix::from_fn(rows, columns, |_, _| numbers.signed());
    let root = matrix(n, n);
    let hessian = &root * root.transpose() + DMatrix::identity(n, n) * 0.1;
    let gradient = matrix(n, 1).column(0) * 5.0;
    let inside = matrix(n, 1).column(0).into_owned();
    let mut a = matrix(equalities, n);
    let combined = matrix(equalities - rank, rank) * a.rows(0, rank);
    a.rows_mut(rank, equalities - rank).copy_from(&combined);
    let c = matrix(inequalities, n);
    let room = matrix(inequalities, 1).column(0).map(|r| r.max(0.0));
    QuadraticProgram {
        hessian,
        gradient,
        equality: LinearRows {
            bound: &a * &inside,
            matrix: a,
        },
        inequality: LinearRows {
            bound: &c * &inside + room,
            matrix: c,
        },
    }
}

/// A program with a feasible point and independent rows.
fn program(n: usize, equalities: usize, inequalities: usize, seed: u64) -> QuadraticProgram {
    program_of_rank(equalities, n, equalities, inequalities, seed)
}

fn solver() -> ActiveSetSolver {
    ActiveSetSolver::new(ActiveSetSettings::default())
}

fn residual(solver: &ActiveSetSolver, program: &QuadraticProgram) -> KktResidual {
    KktResidual::of(
        program,
        solver.x(),
        solver.equality_multipliers(),
        solver.inequality_multipliers(),
    )
}

/// The minimiser by an interior-point method.
fn by_clarabel(program: &QuadraticProgram) -> DVector<f64> {
    let dense = |m: &DMatrix<f64>| {
        let rows: Vec<Vec<f64>> = m.row_iter().map(|r| r.iter().copied().collect()).collect();
        CscMatrix::from(rows.as_slice())
    };
    let (e, i) = (&program.equality, &program.inequality);
    let mut stacked = DMatrix::zeros(e.len() + i.len(), program.gradient.len());
    stacked.rows_mut(0, e.len()).copy_from(&e.matrix);
    stacked.rows_mut(e.len(), i.len()).copy_from(&i.matrix);
    let bounds: Vec<f64> = e.bound.iter().chain(i.bound.iter()).copied().collect();
    let cones: [SupportedConeT<f64>; 2] = [ZeroConeT(e.len()), NonnegativeConeT(i.len())];
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(1e-11)
        .tol_gap_rel(1e-11)
        .tol_feas(1e-11)
        .build()
        .unwrap();
    let mut solver = DefaultSolver::new(
        &dense(&program.hessian).to_triu(),
        program.gradient.as_slice(),
        &dense(&stacked),
        &bounds,
        &cones,
        settings,
    )
    .unwrap();
    solver.solve();
    DVector::from_column_slice(&solver.solution.x)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn the_solution_meets_the_conditions_of_optimality(
        n in 1_usize..25,
        share in 0.0..0.8_f64,
        inequalities in 0_usize..60,
        seed: u64,
    ) {
        let program = program(n, (n as f64 * share) as usize, inequalities, seed);
        let mut solver = solver();
        prop_assert_eq!(solver.solve(&program).exit, Exit::Converged);
        // Condition numbers reach 1e4, multipliers 1e4: rounding of 1e-16 grows to 1e-8.
        let residual = residual(&solver, &program);
        prop_assert!(residual.max() < 1e-7, "{:?}", residual);
    }

    /// Rows that depend on others do so up to their rounding only. Taken for independent, they
    /// get multipliers as large as that rounding is small.
    #[test]
    fn dependent_equalities_are_left_out(
        n in 2_usize..25,
        inequalities in 0_usize..20,
        shares in (0.1..1.0_f64, 0.0..1.0_f64),
        seed: u64,
    ) {
        let equalities = (n as f64 * shares.0) as usize;
        let rank = (equalities as f64 * shares.1) as usize;
        let program = program_of_rank(rank, n, equalities, inequalities, seed);
        let mut solver = solver();
        prop_assert_eq!(solver.solve(&program).exit, Exit::Converged);
        let residual = residual(&solver, &program);
        prop_assert!(residual.max() < 1e-7, "{:?}", residual);
        let held = solver.equality_multipliers().iter().filter(|y| **y != 0.0).count();
        prop_assert!(held <= rank, "{} of rank {}", held, rank);
    }

    #[test]
    fn equalities_alone_agree_with_the_linear_solve(
        n in 2_usize..20,
        seed: u64,
    ) {
        let program = program(n, n / 2, 0, seed);
        let mut solver = solver();
        prop_assert_eq!(solver.solve(&program).exit, Exit::Converged);
        let direct = solve_equality(&program.hessian, &program.gradient, &program.equality).unwrap();
        prop_assert!((solver.x() - direct.x).amax() < 1e-8);
        let difference = solver.equality_multipliers() - &direct.multipliers;
        prop_assert!(difference.amax() < 1e-7 * (1.0 + direct.multipliers.amax()));
    }
}

#[test]
fn the_solution_agrees_with_an_interior_point_solver() {
    for case in 0..60_usize {
        let n = 2 + case % 30;
        let program = program(n, n / 4, 2 * n, case as u64);
        let mut solver = solver();
        assert_eq!(solver.solve(&program).exit, Exit::Converged);
        let difference = (solver.x() - by_clarabel(&program)).amax();
        assert!(difference < 1e-6, "case {case}: {difference}");
    }
}

#[test]
fn a_program_of_150_variables_is_solved() {
    let program = program(150, 20, 300, 1);
    let mut solver = solver();
    assert_eq!(solver.solve(&program).exit, Exit::Converged);
    assert!(residual(&solver, &program).max() < 1e-6);
}

#[test]
fn a_second_solve_has_no_memory_of_the_first() {
    let (large, small) = (program(20, 5, 40, 1), program(7, 2, 9, 1));
    let mut used = solver();
    used.solve(&large);
    used.solve(&small);
    let mut fresh = solver();
    fresh.solve(&small);
    assert_eq!(used.x(), fresh.x());
    assert_eq!(
        used.inequality_multipliers(),
        fresh.inequality_multipliers()
    );
}

fn on_a_line(rows: &[(f64, f64)], equalities: &[(f64, f64)]) -> Exit {
    let build = |list: &[(f64, f64)]| LinearRows {
        matrix: DMatrix::from_fn(list.len(), 1, |i, _| list[i].0),
        bound: DVector::from_fn(list.len(), |i, _| list[i].1),
    };
    let program = QuadraticProgram {
        hessian: DMatrix::identity(1, 1),
        gradient: DVector::zeros(1),
        equality: build(equalities),
        inequality: build(rows),
    };
    solver().solve(&program).exit
}

#[test]
fn bounds_that_exclude_each_other_are_infeasible_by_their_distance() {
    // x <= -1 and x >= 2
    let Exit::Infeasible { violation } = on_a_line(&[(1.0, -1.0), (-1.0, -2.0)], &[]) else {
        panic!("expected infeasibility");
    };
    assert!((violation - 3.0).abs() < 1e-12);
}

#[test]
fn repeated_equalities_are_harmless_and_contradictions_are_found() {
    assert_eq!(on_a_line(&[], &[(1.0, 2.0), (2.0, 4.0)]), Exit::Converged);
    assert!(matches!(
        on_a_line(&[], &[(1.0, 2.0), (2.0, 5.0)]),
        Exit::Infeasible { .. }
    ));
}

/// The span of two rows that are nearly parallel is known the less the smaller their angle, and so
/// is what remains of a third row outside of it.
#[test]
fn a_row_in_the_span_of_two_nearly_parallel_ones_is_left_out() {
    for (case, angle) in [1e-4, 1e-5, 1e-6, 1e-7].into_iter().enumerate() {
        let mut program = program(6, 3, 0, case as u64);
        let rows = &mut program.equality.matrix;
        let (first, across) = (rows.row(0).into_owned(), rows.row(1).into_owned());
        rows.set_row(1, &(&first + &across * angle));
        rows.set_row(2, &(&first * 0.3 + &across * 0.7));
        program.equality.bound = &program.equality.matrix * DVector::from_element(6, 0.4);
        let mut solver = solver();
        assert_eq!(solver.solve(&program).exit, Exit::Converged);
        let residual = residual(&solver, &program);
        assert!(residual.max() < 1e-7, "{angle}: {residual:?}");
        assert_eq!(solver.equality_multipliers()[2], 0.0, "{angle}");
    }
}

#[test]
fn what_is_not_a_strictly_convex_program_is_said_so() {
    let solve = |hessian: f64, gradient: f64| {
        let program = QuadraticProgram::unconstrained(
            DMatrix::from_element(1, 1, hessian),
            DVector::from_element(1, gradient),
        );
        solver().solve(&program).exit
    };
    assert_eq!(solve(0.0, 1.0), Exit::NotConvex);
    assert_eq!(solve(-1.0, 1.0), Exit::NotConvex);
    assert_eq!(solve(f64::NAN, 1.0), Exit::NotFinite);
    assert_eq!(solve(1.0, f64::INFINITY), Exit::NotFinite);
    let wrong = QuadraticProgram::unconstrained(DMatrix::identity(2, 2), DVector::zeros(3));
    assert_eq!(solver().solve(&wrong).exit, Exit::ShapeMismatch);
}

#[test]
fn the_iteration_limit_is_kept_and_says_how_far_off_it_is() {
    let settings = ActiveSetSettings {
        max_iterations: 1,
        ..ActiveSetSettings::default()
    };
    let mut program = QuadraticProgram::unconstrained(DMatrix::identity(2, 2), DVector::zeros(2));
    program.inequality = LinearRows {
        matrix: -DMatrix::identity(2, 2),
        bound: DVector::from_column_slice(&[-1.0, -2.0]),
    };
    let report = ActiveSetSolver::new(settings).solve(&program);
    assert_eq!(report.exit, Exit::IterationLimit { violation: 1.0 });
    assert_eq!(report.iterations, 1);
}
