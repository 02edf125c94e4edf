//! The solver of stage programs against another solver and against the conditions of optimality.

// Helpers of tests may unwrap as tests may.
#![allow(clippy::unwrap_used)]

mod ocp_support;

use alula_optim::ocp::{
    Riccati, StageQp, StageQpExit, StageQpReport, StageQpSettings, StageQpSolver,
};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus,
    SupportedConeT, ZeroConeT,
};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use ocp_support::{Numbers, random_qp};

/// The program with its dynamics as equalities and a variable for every violation.
struct Dense {
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    rows: DMatrix<f64>,
    bounds: DVector<f64>,
    equalities: usize,
}

fn dense<const NX: usize, const NU: usize>(qp: &StageQp<NX, NU>) -> Dense {
    let last = qp.intervals();
    let soft: Vec<(usize, usize)> = (1..=last)
        .flat_map(|k| (0..qp.constraints[k].len()).map(move |i| (k, i)))
        .collect();
    let (x_at, u_at) = (|k: usize| (k - 1) * NX, |k: usize| last * NX + k * NU);
    let s_at = last * (NX + NU);
    let n = s_at + soft.len();
    let (mut hessian, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
    for (k, cost) in qp.costs.iter().enumerate() {
        if k > 0 {
            hessian
                .view_mut((x_at(k), x_at(k)), (NX, NX))
                .copy_from(&cost.xx);
            gradient.rows_mut(x_at(k), NX).copy_from(&cost.x);
        }
        if k < last {
            hessian
                .view_mut((u_at(k), u_at(k)), (NU, NU))
                .copy_from(&cost.uu);
            let mut u = cost.u;
            if k > 0 {
                hessian
                    .view_mut((u_at(k), x_at(k)), (NU, NX))
                    .copy_from(&cost.ux);
                let mut xu = hessian.view_mut((x_at(k), u_at(k)), (NX, NU));
                xu.copy_from(&cost.ux.transpose());
            } else {
                u += cost.ux * qp.initial;
            }
            gradient.rows_mut(u_at(k), NU).copy_from(&u);
        }
    }
    let equalities = last * NX;
    let inequalities = 2 * last * NU + 2 * soft.len();
    let mut rows = DMatrix::zeros(equalities + inequalities, n);
    let mut bounds = DVector::zeros(equalities + inequalities);
    for (k, step) in qp.steps.iter().enumerate() {
        let mut bound = step.next;
        rows.view_mut((k * NX, x_at(k + 1)), (NX, NX))
            .fill_with_identity();
        rows.view_mut((k * NX, u_at(k)), (NX, NU))
            .copy_from(&-step.b);
        if k > 0 {
            rows.view_mut((k * NX, x_at(k)), (NX, NX))
                .copy_from(&-step.a);
        } else {
            bound += step.a * qp.initial;
        }
        bounds.rows_mut(k * NX, NX).copy_from(&bound);
    }
    let mut row = equalities;
    for (k, (lower, upper)) in qp.bounds.iter().enumerate() {
        for i in 0..NU {
            rows[(row, u_at(k) + i)] = 1.0;
            bounds[row] = upper[i];
            rows[(row + 1, u_at(k) + i)] = -1.0;
            bounds[row + 1] = -lower[i];
            row += 2;
        }
    }
    for (j, &(k, i)) in soft.iter().enumerate() {
        let constraint = &qp.constraints[k][i];
        hessian[(s_at + j, s_at + j)] = 2.0 * constraint.quadratic;
        gradient[s_at + j] = constraint.linear;
        let gradient = constraint.gradient.transpose();
        rows.view_mut((row, x_at(k)), (1, NX)).copy_from(&-gradient);
        rows[(row, s_at + j)] = -1.0;
        bounds[row] = constraint.value;
        rows[(row + 1, s_at + j)] = -1.0;
        row += 2;
    }
    Dense {
        hessian,
        gradient,
        rows,
        bounds,
        equalities,
    }
}

/// States after the first and inputs, stacked, by an interior-point method.
fn by_clarabel<const NX: usize, const NU: usize>(qp: &StageQp<NX, NU>) -> Option<DVector<f64>> {
    let program = dense(qp);
    let sparse = |m: &DMatrix<f64>| {
        let rows: Vec<Vec<f64>> = m.row_iter().map(|r| r.iter().copied().collect()).collect();
        CscMatrix::from(rows.as_slice())
    };
    let rest = program.bounds.len() - program.equalities;
    let cones: [SupportedConeT<f64>; 2] = [ZeroConeT(program.equalities), NonnegativeConeT(rest)];
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(1e-12)
        .tol_gap_rel(1e-12)
        .tol_feas(1e-11)
        .build()
        .unwrap();
    let mut solver = DefaultSolver::new(
        &sparse(&program.hessian).to_triu(),
        program.gradient.as_slice(),
        &sparse(&program.rows),
        program.bounds.as_slice(),
        &cones,
        settings,
    )
    .unwrap();
    solver.solve();
    let trajectory = qp.intervals() * (NX + NU);
    (solver.solution.status == SolverStatus::Solved)
        .then(|| DVector::from_column_slice(&solver.solution.x[..trajectory]))
}

fn stacked<const NX: usize, const NU: usize>(solver: &StageQpSolver<NX, NU>) -> DVector<f64> {
    let states = solver.states().iter().skip(1).flatten();
    let inputs = solver.inputs().iter().flatten();
    DVector::from_iterator(
        (solver.states().len() - 1) * NX + solver.inputs().len() * NU,
        states.chain(inputs).copied(),
    )
}

fn precise() -> StageQpSettings {
    StageQpSettings {
        tolerance: 1e-10,
        max_iterations: 200,
        ..StageQpSettings::default()
    }
}

fn solved<const NX: usize, const NU: usize>(
    qp: &StageQp<NX, NU>,
) -> (StageQpSolver<NX, NU>, StageQpReport) {
    let mut solver = StageQpSolver::new(qp.intervals(), 0, precise());
    let report = solver.solve(qp);
    (solver, report)
}

fn check_against_clarabel<const NX: usize, const NU: usize>(
    intervals: usize,
    constraints: usize,
    spread: f64,
    cases: u64,
) {
    let mut compared = 0;
    for case in 0..cases {
        let qp: StageQp<NX, NU> = random_qp(&mut Numbers(case), intervals, constraints, spread);
        let (solver, report) = solved(&qp);
        assert_eq!(
            report.exit,
            StageQpExit::Converged,
            "case {case}: {report:?}"
        );
        let Some(reference) = by_clarabel(&qp) else {
            continue;
        };
        compared += 1;
        let difference = (stacked(&solver) - &reference).amax() / (1.0 + reference.amax());
        assert!(difference < 1e-6, "case {case}: {difference}");
    }
    // The other solver gives up at this tolerance now and then.
    assert!(compared * 10 >= cases * 7, "{compared}");
}

#[test]
fn bounds_and_few_constraints_agree_with_an_interior_point_solver() {
    check_against_clarabel::<4, 2>(10, 1, 1.0, 30);
}

#[test]
fn many_violated_constraints_agree_with_an_interior_point_solver() {
    check_against_clarabel::<3, 2>(10, 6, 3.0, 30);
}

#[test]
fn the_size_of_flight_agrees_with_an_interior_point_solver() {
    check_against_clarabel::<9, 4>(25, 2, 2.0, 3);
}

/// The greatest violation of the conditions of optimality, from an adjoint recursion.
fn optimality_gap<const NX: usize, const NU: usize>(
    qp: &StageQp<NX, NU>,
    solver: &StageQpSolver<NX, NU>,
) -> f64 {
    let (states, inputs) = (solver.states(), solver.inputs());
    let last = qp.intervals();
    let mut worst = 0.0_f64;
    let mut adjoint = SVector::<f64, NX>::zeros();
    for k in (0..=last).rev() {
        let (cost, x) = (&qp.costs[k], &states[k]);
        let mut slope = cost.x + cost.xx * x;
        if k < last {
            let (step, u, (lower, upper)) = (&qp.steps[k], &inputs[k], &qp.bounds[k]);
            let missed = step.a * x + step.b * u + step.next - states[k + 1];
            worst = worst.max(missed.amax());
            let mut input_slope = cost.u + cost.uu * u + cost.ux * x + step.b.tr_mul(&adjoint);
            for i in 0..NU {
                let y = solver.bound_multiplier(k, i);
                input_slope[i] += y;
                worst = worst.max(u[i] - upper[i]).max(lower[i] - u[i]);
                worst = worst.max(y.max(0.0) * (upper[i] - u[i]).max(0.0));
                worst = worst.max((-y).max(0.0) * (u[i] - lower[i]).max(0.0));
            }
            worst = worst.max(input_slope.amax());
            slope += cost.ux.tr_mul(u) + step.a.tr_mul(&adjoint);
        }
        if k > 0 {
            for (i, row) in qp.constraints[k].iter().enumerate() {
                let multiplier = solver.constraint_multiplier(k, i);
                let value = row.value + row.gradient.dot(x);
                let s = (-value).max(0.0);
                // Nothing where it holds, the penalty's slope where it is violated, between at zero.
                worst = worst.max(-multiplier).max(multiplier * value.max(0.0));
                worst = worst.max(multiplier - row.linear - 2.0 * row.quadratic * s);
                worst = worst.max((row.linear - multiplier) * s);
                slope -= row.gradient * multiplier;
            }
        }
        adjoint = slope;
    }
    worst
}

#[test]
fn the_multipliers_meet_the_conditions_of_optimality() {
    for case in 100..160 {
        let spread = 0.2 + (case % 7) as f64 * 0.4;
        let qp: StageQp<6, 3> = random_qp(&mut Numbers(case), 15, 3, spread);
        let (solver, report) = solved(&qp);
        assert_eq!(
            report.exit,
            StageQpExit::Converged,
            "case {case}: {report:?}"
        );
        // Multipliers reach 1e4 and stiffnesses 1e6 times that: rounding of 1e-16 grows to 1e-6.
        let gap = optimality_gap(&qp, &solver);
        assert!(gap < 1e-6, "case {case}: {gap}");
    }
}

#[test]
fn the_known_multipliers_make_a_second_solve_short() {
    let (mut cold, mut warm) = (0, 0);
    for case in 0..10 {
        let qp: StageQp<4, 2> = random_qp(&mut Numbers(case), 15, 2, 1.0);
        let mut solver = StageQpSolver::new(15, 2, StageQpSettings::default());
        cold += solver.solve(&qp).factorisations;
        warm += solver.solve(&qp).factorisations;
    }
    assert!(warm * 3 < cold, "{warm} warm, {cold} cold");
}

/// A double integrator, the same in every interval.
fn regulator(intervals: usize) -> StageQp<2, 1> {
    let mut qp = StageQp::new(intervals, 0);
    for step in &mut qp.steps {
        step.a = SMatrix::<f64, 2, 2>::new(1.0, 0.1, 0.0, 1.0);
        step.b = SMatrix::<f64, 2, 1>::new(0.005, 0.1);
    }
    for cost in &mut qp.costs {
        cost.xx = SMatrix::<f64, 2, 2>::new(2.0, 0.3, 0.3, 1.0);
        cost.ux = SMatrix::<f64, 1, 2>::new(0.1, -0.05);
        cost.uu = SMatrix::<f64, 1, 1>::new(0.5);
    }
    qp.initial = SVector::<f64, 2>::new(1.0, -0.5);
    qp
}

#[test]
fn without_bounds_the_input_is_the_linear_quadratic_regulators() {
    let qp = regulator(400);
    let (solver, report) = solved(&qp);
    assert_eq!(report.factorisations, 1);
    // The discrete algebraic Riccati equation, which the gain's cost to go must meet.
    let (a, b) = (&qp.steps[0].a, &qp.steps[0].b);
    let (q, s, r) = (&qp.costs[0].xx, &qp.costs[0].ux, &qp.costs[0].uu);
    let p = solver.riccati().curvature();
    let cross = s + b.transpose() * p * a;
    let inverse = (r + b.transpose() * p * b).try_inverse().unwrap();
    let residual = q + a.transpose() * p * a - cross.transpose() * inverse * cross - p;
    assert!(residual.amax() < 1e-10, "{residual}");
    let expected = -inverse * cross * qp.initial;
    assert!((solver.inputs()[0] - expected).amax() < 1e-10);
}

#[test]
fn a_recursion_that_begins_where_something_changed_is_the_whole_one() {
    let qp = random_qp::<6, 3>(&mut Numbers(5), 12, 0, 0.1);
    // What stands for a constraint at a point and for a bound in an interval.
    let factor = |riccati: &mut Riccati<6, 3>, from: usize, changed: usize, by: f64| {
        riccati.refactor(
            from,
            &qp.steps,
            &qp.costs,
            |k, xx| xx[(0, 0)] += if k == changed { by } else { 0.0 },
            |k| SVector::repeat(if k == changed { by } else { 0.0 }),
        );
    };
    for changed in 0..=12 {
        let (mut part, mut whole) = (Riccati::new(12), Riccati::new(12));
        factor(&mut part, 12, changed, 0.0);
        factor(&mut part, changed, changed, 3.0);
        factor(&mut whole, 12, changed, 3.0);
        assert_eq!(part.curvature(), whole.curvature());
        for k in 0..12 {
            assert_eq!(part.gain_transposed(k), whole.gain_transposed(k));
        }
    }
}

#[test]
fn what_is_not_finite_is_said_so_and_forgotten() {
    let mut qp = regulator(10);
    let mut solver = StageQpSolver::new(10, 0, precise());
    qp.costs[3].x[0] = f64::NAN;
    assert_eq!(solver.solve(&qp).exit, StageQpExit::NotFinite);
    qp.costs[3].x[0] = 0.0;
    assert_eq!(solver.solve(&qp).exit, StageQpExit::Converged);
}
