//! Derivatives of the predictive planner's model, costs and constraints against central
//! differences at random points.

#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot set itself up should fail"
)]

use alula_geometry::Pose;
use alula_optim::ocp::{OptimalControl, SoftConstraint, StageCost};
use alula_planning::mpc::{
    FieldOfView, Input, Keepout, NU, NX, Penalty, Potential, Problem, Sideways, SpeedCost, Stage,
    State, TiltDynamics, TiltModel, Volume,
};
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Step of the differences; their error is about its square times the third derivative.
const STEP: f64 = 1e-5;
/// Agreement, relative to `1 + |derivative|`.
const TOLERANCE: f64 = 2e-6;

fn uniform(generator: &mut Pcg64, limit: f64) -> f64 {
    generator.random_range(-limit..limit)
}

fn random_state(generator: &mut Pcg64) -> State {
    let scale = [3.0, 3.0, 2.0, 2.0, 2.0, 1.0, 0.4, 0.4, 3.0];
    State::from_fn(|i, _| uniform(generator, scale[i]))
}

fn random_input(generator: &mut Pcg64) -> Input {
    let scale = [0.2, 0.2, 1.0, 1.5];
    Input::from_fn(|i, _| uniform(generator, scale[i]))
}

fn random_covariance(generator: &mut Pcg64) -> Matrix3<f64> {
    let root = Matrix3::from_fn(|_, _| uniform(generator, 0.3));
    root * root.transpose()
}

/// Jacobian of `f` at `x` by central differences.
fn differences<const R: usize, const C: usize>(
    x: &SVector<f64, C>,
    f: impl Fn(&SVector<f64, C>) -> SVector<f64, R>,
) -> SMatrix<f64, R, C> {
    let mut jacobian = SMatrix::<f64, R, C>::zeros();
    for j in 0..C {
        let mut d = SVector::<f64, C>::zeros();
        d[j] = STEP;
        jacobian.set_column(j, &((f(&(x + d)) - f(&(x - d))) / (2.0 * STEP)));
    }
    jacobian
}

fn assert_close<const R: usize, const C: usize>(
    analytic: &SMatrix<f64, R, C>,
    numeric: &SMatrix<f64, R, C>,
) {
    let error = (analytic - numeric).amax() / (1.0 + numeric.amax());
    assert!(error < TOLERANCE, "{error}: {analytic} against {numeric}");
}

fn dynamics() -> TiltDynamics {
    let mut model = TiltModel::bebop();
    // Unequal drag and time constants, so that no two terms can be mistaken for one another.
    (model.drag_x_1_s, model.drag_y_1_s) = (0.15, 0.6);
    (model.tau_roll_s, model.tau_pitch_s) = (0.2, 0.3);
    TiltDynamics::new(&model, 0.06).unwrap()
}

fn volumes() -> [Volume; 6] {
    let wall = |side| Volume::Wall {
        along: Vector2::new(0.6, 0.8),
        half_length_m: 1.0,
        standoff_m: 0.5,
        side,
    };
    [
        Volume::ellipsoid(&Vector3::new(0.8, 1.4, 2.5), 0.7),
        Volume::Level {
            up: 1.0,
            standoff_m: 0.7,
        },
        Volume::Level {
            up: -1.0,
            standoff_m: 0.7,
        },
        wall(0.0),
        wall(1.0),
        wall(-1.0),
    ]
}

fn problem(generator: &mut Pcg64) -> Problem {
    let keepouts: Vec<Keepout> = volumes()
        .into_iter()
        .map(|volume| Keepout {
            centre: Vector3::from_fn(|_, _| uniform(generator, 2.0)),
            covariance: random_covariance(generator),
            volume,
        })
        .collect();
    let stage = Stage {
        target: Vector3::new(2.0, -1.0, 1.0),
        position_weight: Vector3::new(0.3, 0.5, 0.7),
        velocity_weight: Vector3::new(0.1, 0.2, 0.3),
        yaw_rad: 0.4,
        yaw_weight: 0.6,
        speed: Some(SpeedCost {
            limit_m_s: 1.2,
            softness_m_s: 0.2,
            weight: 1.5,
        }),
        potential_weight: 2.0,
        keepouts,
    };
    let view = FieldOfView::new(&Pose::translation(1.0, 0.0, 0.5), 1.5, 1.0, 4.0, 0.5);
    Problem {
        dynamics: dynamics(),
        input_limit: Input::new(0.2, 0.2, 1.0, 1.5),
        input_weight: 0.1,
        potential: Potential {
            slope_1_m: 3.0,
            buffer_m: 0.4,
        },
        quantile: 1.88,
        collision: Penalty {
            linear: 50.0,
            quadratic: 200.0,
        },
        velocity_bound: Some((
            Vector3::new(2.0, 2.0, 1.0),
            Penalty {
                linear: 5.0,
                quadratic: 2.0,
            },
        )),
        height_band: Some((
            [0.8, 1.1],
            Penalty {
                linear: 3.0,
                quadratic: 2.0,
            },
        )),
        view: Some((
            view,
            Penalty {
                linear: 1.0,
                quadratic: 1.0,
            },
        )),
        stages: vec![stage; 3],
    }
}

#[test]
fn dynamics_meet_differences() {
    let mut generator = Pcg64::seed_from_u64(1);
    for sideways in [Sideways::Exact, Sideways::Decoupled] {
        let dynamics = dynamics().with(9.81, sideways);
        for _ in 0..200 {
            let (x, u) = (random_state(&mut generator), random_input(&mut generator));
            let step = dynamics.step(&x, &u);
            assert_eq!(step.next, dynamics.next(&x, &u));
            assert_close(&step.a, &differences(&x, |x| dynamics.next(x, &u)));
            assert_close(&step.b, &differences(&u, |u| dynamics.next(&x, u)));
        }
    }
}

#[test]
fn steps_are_those_of_the_classical_runge_kutta_method() {
    let mut generator = Pcg64::seed_from_u64(2);
    let (dynamics, h) = (dynamics(), 0.06);
    for _ in 0..100 {
        let (x, u) = (random_state(&mut generator), random_input(&mut generator));
        let k1 = dynamics.derivative(&x, &u);
        let k2 = dynamics.derivative(&(x + k1 * (0.5 * h)), &u);
        let k3 = dynamics.derivative(&(x + k2 * (0.5 * h)), &u);
        let k4 = dynamics.derivative(&(x + k3 * h), &u);
        let next = x + (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
        assert!((next - dynamics.next(&x, &u)).amax() < 1e-13);
    }
}

/// Error of flying one second in `count` steps against a hundred times as many.
fn flight_error(count: usize) -> f64 {
    let fly = |count: usize| {
        let dynamics = TiltDynamics::new(&TiltModel::bebop(), 1.0 / count as f64).unwrap();
        let u = Input::new(0.1, -0.15, 0.5, 1.0);
        let start = State::from_column_slice(&[0.0, 0.0, 1.0, 1.0, -0.5, 0.2, -0.1, 0.1, 0.3]);
        (0..count).fold(start, |x, _| dynamics.next(&x, &u))
    };
    (fly(count) - fly(100 * count)).amax()
}

#[test]
fn halving_the_step_divides_the_error_by_sixteen() {
    let ratio = flight_error(10) / flight_error(20);
    // Order four, to within the next order's share at this step.
    assert!((13.0..20.0).contains(&ratio), "{ratio}");
}

#[test]
fn forward_flight_follows_the_heading() {
    let dynamics = TiltDynamics::new(&TiltModel::bebop(), 0.06).unwrap();
    let mut x = State::zeros();
    (x[7], x[8]) = (0.1, std::f64::consts::FRAC_PI_2);
    let a = dynamics.acceleration(&x, &Input::zeros());
    assert!(a.x.abs() < 1e-12 && a.y > 0.9, "pitch flies forward: {a}");
    (x[6], x[7], x[8]) = (0.1, 0.0, 0.0);
    let a = dynamics.acceleration(&x, &Input::zeros());
    assert!(a.y < -0.9, "roll flies right: {a}");
}

#[test]
fn costs_meet_differences() {
    let mut generator = Pcg64::seed_from_u64(3);
    for _ in 0..200 {
        let problem = problem(&mut generator);
        let (x, u) = (random_state(&mut generator), random_input(&mut generator));
        for k in [0, 2] {
            let mut cost = StageCost::default();
            problem.cost(k, &x, &u, &mut cost);
            let value = problem.cost_value(k, &x, &u);
            assert!((cost.value - value).abs() < 1e-12 * (1.0 + value));
            let by_x = differences(&x, |x| SVector::<f64, 1>::new(problem.cost_value(k, x, &u)));
            let by_u = differences(&u, |u| SVector::<f64, 1>::new(problem.cost_value(k, &x, u)));
            assert_close(&cost.x.transpose(), &by_x);
            assert_close(&cost.u.transpose(), &by_u);
        }
    }
}

/// With residual zero the model of the curvature is the Hessian: at the target, at rest, with the
/// speed far below its limit and no obstacle.
#[test]
fn curvature_is_exact_where_residuals_vanish() {
    let mut generator = Pcg64::seed_from_u64(4);
    let mut problem = problem(&mut generator);
    problem.stages.iter_mut().for_each(|s| s.keepouts.clear());
    let (mut x, u) = (State::zeros(), Input::zeros());
    x.fixed_rows_mut::<3>(0)
        .copy_from(&problem.stages[0].target);
    x[8] = problem.stages[0].yaw_rad;
    let gradient = |x: &State, u: &Input| {
        let mut cost = StageCost::<NX, NU>::default();
        problem.cost(0, x, u, &mut cost);
        cost
    };
    let cost = gradient(&x, &u);
    assert_close(&cost.uu, &differences(&u, |u| gradient(&x, u).u));
    let rows = differences(&x, |x| gradient(x, &u).x);
    // The softplus leaves a share exp(-limit / softness) of its weight.
    assert!((cost.xx - rows).amax() < 0.05);
}

fn constraint_list(problem: &Problem, k: usize, x: &State) -> Vec<SoftConstraint<NX>> {
    let mut list = Vec::new();
    problem.constraints(k, x, &mut |c| list.push(c.clone()));
    list
}

#[test]
fn constraints_meet_differences() {
    let mut generator = Pcg64::seed_from_u64(5);
    for _ in 0..200 {
        let problem = problem(&mut generator);
        let x = random_state(&mut generator);
        let list = constraint_list(&problem, 1, &x);
        assert_eq!(list.len(), problem.max_constraints());
        let mut values = Vec::new();
        problem.constraint_values(1, &x, &mut |v, l, q| values.push((v, l, q)));
        for (i, constraint) in list.iter().enumerate() {
            assert!(
                (values[i].0 - constraint.value).abs() < 1e-12 * (1.0 + constraint.value.abs())
            );
            assert_eq!(
                (values[i].1, values[i].2),
                (constraint.linear, constraint.quadratic)
            );
            let numeric = differences(&x, |x| {
                SVector::<f64, 1>::new(constraint_list(&problem, 1, x)[i].value)
            });
            assert_close(&constraint.gradient.transpose(), &numeric);
        }
    }
}

#[test]
fn the_way_out_of_the_very_centre_is_defined() {
    for volume in volumes() {
        let keepout = Keepout {
            centre: Vector3::new(1.0, 2.0, 3.0),
            covariance: Matrix3::identity() * 0.01,
            volume,
        };
        let clearance = keepout.chance(&keepout.centre, 1.88);
        assert!(clearance.value < 0.0);
        assert!(clearance.gradient.norm() > 0.1 && clearance.gradient.norm().is_finite());
    }
}

#[test]
fn far_obstacles_cost_nothing_and_stay_finite() {
    let mut generator = Pcg64::seed_from_u64(6);
    let mut problem = problem(&mut generator);
    problem.stages[0].keepouts[0].centre = Vector3::repeat(1e5);
    let mut cost = StageCost::default();
    problem.cost(0, &State::zeros(), &Input::zeros(), &mut cost);
    assert!(cost.value.is_finite() && cost.x.iter().all(|v| v.is_finite()));
}
