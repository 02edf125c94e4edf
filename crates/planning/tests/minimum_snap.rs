//! Trajectories against what they promise: limits, passage, continuity, optimality.

// Helpers of tests may unwrap as tests may.
#![allow(clippy::unwrap_used)]

use alula_geometry::so3;
use alula_messages::Reference;
use alula_planning::{
    MinimumSnap, MinimumSnapConfig, MotionLimits, PlanError, Trajectory, YawPolicy,
};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn planner() -> MinimumSnap {
    MinimumSnap::new(&MinimumSnapConfig::default()).unwrap()
}

/// A planner whose corridor never matters.
fn free_planner() -> MinimumSnap {
    let config = MinimumSnapConfig {
        corridor_m: 1000.0,
        ..MinimumSnapConfig::default()
    };
    MinimumSnap::new(&config).unwrap()
}

fn plan(waypoints: &[Vector3<f64>]) -> Result<Trajectory, PlanError> {
    planner().plan(
        &Reference::default(),
        waypoints,
        &MotionLimits::default(),
        YawPolicy::Hold,
    )
}

fn random_waypoints(random: &mut Pcg64, count: usize) -> Vec<Vector3<f64>> {
    let mut point = Vector3::zeros();
    (0..count)
        .map(|_| {
            let step = loop {
                let step = Vector3::from_fn(|_, _| random.random_range(-4.0..4.0));
                if step.norm() > 0.3 {
                    break step;
                }
            };
            point += step;
            point
        })
        .collect()
}

/// Distance from the path at `t_s` to the straight lines of the two segments around it.
fn deviation_m(trajectory: &Trajectory, points: &[Vector3<f64>], t_s: f64) -> f64 {
    let index = trajectory
        .waypoint_times_s()
        .partition_point(|end| *end <= t_s)
        .min(points.len() - 2);
    let (from, to) = (points[index], points[index + 1]);
    let position = trajectory.sample(t_s).position_world;
    let share = (position - from).dot(&(to - from)) / (to - from).norm_squared();
    (position - from - (to - from) * share.clamp(0.0, 1.0)).norm()
}

#[test]
fn limits_are_kept_and_used_over_random_waypoints() {
    let mut random = Pcg64::seed_from_u64(7);
    let (mut slowest, mut total, mut length) = (f64::INFINITY, 0.0, 0.0);
    for _ in 0..200 {
        let count = random.random_range(1..=15);
        let waypoints = random_waypoints(&mut random, count);
        let limits = MotionLimits {
            max_speed_m_s: random.random_range(0.5..5.0),
            max_acceleration_m_s2: random.random_range(0.5..6.0),
            ..MotionLimits::default()
        };
        let start = Reference::default();
        let trajectory = planner()
            .plan(&start, &waypoints, &limits, YawPolicy::FaceMotion)
            .unwrap();
        let (speed, acceleration) = (
            trajectory.max_speed_m_s() / limits.max_speed_m_s,
            trajectory.max_acceleration_m_s2() / limits.max_acceleration_m_s2,
        );
        assert!(
            speed <= 1.0 && acceleration <= 1.0,
            "{speed} {acceleration}"
        );
        slowest = slowest.min(speed.max(acceleration));
        assert!(trajectory.max_yaw_rate_rad_s() <= limits.max_yaw_rate_rad_s + 1e-9);
        let dt = trajectory.duration_s() / 400.0;
        for k in 0..=400 {
            let sample = trajectory.sample(f64::from(k) * dt);
            assert!(sample.velocity_world.norm() <= limits.max_speed_m_s);
            assert!(sample.acceleration_world.norm() <= limits.max_acceleration_m_s2);
            assert!(sample.yaw_rate_rad_s.abs() <= limits.max_yaw_rate_rad_s + 1e-9);
        }
        total += *trajectory.waypoint_times_s().last().unwrap() * limits.max_speed_m_s;
        length += waypoints
            .iter()
            .scan(Vector3::zeros(), |before: &mut Vector3<f64>, point| {
                let step = (point - *before).norm();
                *before = *point;
                Some(step)
            })
            .sum::<f64>();
    }
    println!(
        "least use of a limit: {slowest:.4}; mean speed {:.3} of the limit",
        length / total
    );
    assert!(slowest > 0.99);
}

#[test]
fn waypoints_are_passed_at_their_times() {
    let waypoints = random_waypoints(&mut Pcg64::seed_from_u64(1), 30);
    let trajectory = plan(&waypoints).unwrap();
    assert_eq!(trajectory.waypoint_times_s().len(), 30);
    for (time_s, waypoint) in trajectory.waypoint_times_s().iter().zip(&waypoints) {
        let miss = trajectory.sample(*time_s).position_world - waypoint;
        assert!(miss.norm() < 1e-9, "{}", miss.norm());
    }
}

fn derivatives(reference: &Reference) -> [Vector3<f64>; 5] {
    [
        reference.position_world,
        reference.velocity_world,
        reference.acceleration_world,
        reference.jerk_world,
        reference.snap_world,
    ]
}

#[test]
fn position_to_snap_are_continuous_with_and_without_corridor() {
    let waypoints = random_waypoints(&mut Pcg64::seed_from_u64(3), 12);
    for planner in [planner(), free_planner()] {
        let trajectory = planner
            .plan(
                &Reference::default(),
                &waypoints,
                &MotionLimits::default(),
                YawPolicy::FaceMotion,
            )
            .unwrap();
        let times = trajectory.waypoint_times_s();
        for t_s in &times[..times.len() - 1] {
            let (before, after) = (trajectory.sample(t_s - 1e-9), trajectory.sample(t_s + 1e-9));
            for (left, right) in derivatives(&before).iter().zip(&derivatives(&after)) {
                // 2e-9 s at a rate of at most 1e3 in the next derivative, and rounding.
                assert!((left - right).norm() < 1e-5, "{left} {right}");
            }
            assert!((before.yaw_rate_rad_s - after.yaw_rate_rad_s).abs() < 1e-6);
        }
    }
}

#[test]
fn every_sample_is_the_derivative_of_the_one_above() {
    let waypoints = random_waypoints(&mut Pcg64::seed_from_u64(4), 6);
    let trajectory = planner()
        .plan(
            &Reference::default(),
            &waypoints,
            &MotionLimits::default(),
            YawPolicy::FaceMotion,
        )
        .unwrap();
    let h = 1e-5;
    for k in 1..300 {
        let t_s = trajectory.duration_s() * f64::from(k) / 300.3;
        let (before, now, after) = (
            trajectory.sample(t_s - h),
            trajectory.sample(t_s),
            trajectory.sample(t_s + h),
        );
        for order in 0..4 {
            let slope = (derivatives(&after)[order] - derivatives(&before)[order]) / (2.0 * h);
            // Second order in h with derivatives below 1e4; rounding 1e-12 / h.
            assert!((slope - derivatives(&now)[order + 1]).norm() < 1e-4);
        }
        let turn = so3::wrap_angle(after.yaw_rad - before.yaw_rad) / (2.0 * h);
        assert!((turn - now.yaw_rate_rad_s).abs() < 1e-6);
        let spin = (after.yaw_rate_rad_s - before.yaw_rate_rad_s) / (2.0 * h);
        // The yaw acceleration may jump where a rate limit begins to hold.
        assert!((spin - now.yaw_acceleration_rad_s2).abs() < 1e-3);
    }
}

/// The minimum of the integral of squared snap from rest to rest is
/// p = L (35 s^4 - 84 s^5 + 70 s^6 - 20 s^7), by the Euler-Lagrange equation p^(8) = 0.
#[test]
fn a_single_segment_is_the_polynomial_of_degree_seven() {
    let target = Vector3::new(4.0, -2.0, 1.0);
    let trajectory = plan(&[target]).unwrap();
    let duration = trajectory.duration_s();
    for k in 0..=50 {
        let s = f64::from(k) / 50.0;
        let share = s.powi(4) * (35.0 - 84.0 * s + 70.0 * s * s - 20.0 * s.powi(3));
        let found = trajectory.sample(s * duration);
        assert!((found.position_world - target * share).norm() < 1e-10);
        let speed = 140.0 * s.powi(3) * (1.0 - s).powi(3) / duration;
        assert!((found.velocity_world - target * speed).norm() < 1e-9);
    }
}

#[test]
fn the_trajectory_begins_as_the_start_moves_and_ends_at_rest() {
    let start = Reference {
        position_world: Vector3::new(1.0, 2.0, 1.5),
        velocity_world: Vector3::new(1.2, -0.5, 0.2),
        acceleration_world: Vector3::new(0.3, 0.5, -0.2),
        jerk_world: Vector3::new(-0.4, 0.1, 0.3),
        yaw_rad: 0.4,
        yaw_rate_rad_s: 0.2,
        ..Reference::default()
    };
    let waypoints = [Vector3::new(5.0, 1.0, 2.0), Vector3::new(6.0, -3.0, 1.0)];
    let limits = MotionLimits::default();
    let trajectory = planner()
        .plan(&start, &waypoints, &limits, YawPolicy::Fixed(-1.0))
        .unwrap();
    let first = trajectory.sample(0.0);
    for (found, wanted) in derivatives(&first).iter().zip(&derivatives(&start)).take(4) {
        assert!((found - wanted).norm() < 1e-9);
    }
    assert!((first.yaw_rad - 0.4).abs() < 1e-9 && (first.yaw_rate_rad_s - 0.2).abs() < 1e-9);
    let end = trajectory.sample(trajectory.duration_s());
    let hover = Reference::hover(waypoints[1], -1.0);
    assert!((end.position_world - hover.position_world).norm() < 1e-9);
    assert!((end.yaw_rad - hover.yaw_rad).abs() < 1e-9);
    assert!(trajectory.max_speed_m_s() <= limits.max_speed_m_s);
    assert!(trajectory.max_acceleration_m_s2() <= limits.max_acceleration_m_s2);
    let just_before = trajectory.sample(trajectory.waypoint_times_s()[1] - 1e-9);
    for rest in &derivatives(&just_before)[1..4] {
        assert!(rest.norm() < 1e-6);
    }
    assert_eq!(trajectory.sample(1e6), end);
    assert_eq!(trajectory.sample(-1.0), first);
}

/// Replans from the middle of flights, as a change of mission does. Nearly all keep the limits; no
/// plan goes beyond the margin.
#[test]
fn a_moving_start_can_turn_back() {
    let mut random = Pcg64::seed_from_u64(11);
    let limits = MotionLimits::default();
    let (mut over, mut worst) = (0, 0.0_f64);
    for case in 0..60 {
        let first = plan(&random_waypoints(&mut random, 3)).unwrap();
        let start = first.sample(random.random_range(0.1..0.9) * first.duration_s());
        let waypoints: Vec<_> = random_waypoints(&mut random, 3)
            .iter()
            .map(|w| w + start.position_world)
            .collect();
        let trajectory = planner()
            .plan(&start, &waypoints, &limits, YawPolicy::Hold)
            .unwrap_or_else(|error| panic!("case {case}: {error}"));
        let speed = trajectory.max_speed_m_s() / limits.max_speed_m_s;
        let acceleration = trajectory.max_acceleration_m_s2() / limits.max_acceleration_m_s2;
        assert!(
            speed <= 1.1 && acceleration <= 1.21,
            "{speed} {acceleration}"
        );
        let effort = speed.max(acceleration.sqrt());
        worst = worst.max(effort);
        over += usize::from(effort > 1.0 + 1e-6);
    }
    println!("moving starts: {over} of 60 exceed a limit, by a factor of {worst:.3} at worst");
    assert!(over <= 3);
}

#[test]
fn the_path_stays_in_the_corridor_where_it_would_leave_it() {
    let waypoints = [
        Vector3::new(6.0, 0.0, 1.0),
        Vector3::new(6.3, 0.6, 1.0),
        Vector3::new(0.0, 1.0, 1.0),
        Vector3::new(0.0, 8.0, 3.0),
    ];
    let mut points = vec![Vector3::zeros()];
    points.extend_from_slice(&waypoints);
    let widest = |planner: &MinimumSnap| {
        let trajectory = planner
            .plan(
                &Reference::default(),
                &waypoints,
                &MotionLimits::default(),
                YawPolicy::Hold,
            )
            .unwrap();
        let dt = trajectory.duration_s() / 2000.0;
        (0..2000)
            .map(|k| deviation_m(&trajectory, &points, f64::from(k) * dt))
            .fold(0.0, f64::max)
    };
    let narrow = MinimumSnapConfig {
        corridor_m: 0.2,
        ..MinimumSnapConfig::default()
    };
    let (free, kept) = (
        widest(&free_planner()),
        widest(&MinimumSnap::new(&narrow).unwrap()),
    );
    println!("widest deviation {free:.3} m free, {kept:.3} m in a corridor of 0.2 m");
    assert!(free > 0.5);
    // Checked at 24 places a segment; between them the path can bulge by a few per cent.
    assert!(kept < 0.2 * 1.03);
}

#[test]
fn yaw_turns_to_a_fixed_angle_by_the_shorter_way_within_its_rate() {
    let start = Reference::hover(Vector3::zeros(), 3.0);
    let limits = MotionLimits {
        max_yaw_rate_rad_s: 0.3,
        ..MotionLimits::default()
    };
    let trajectory = planner()
        .plan(&start, &[Vector3::x()], &limits, YawPolicy::Fixed(-2.0))
        .unwrap();
    // The way over pi is 1.28 rad, which the rate limit makes longer than the hop.
    assert!(trajectory.duration_s() > *trajectory.waypoint_times_s().last().unwrap());
    assert!(trajectory.duration_s() > 1.28 / 0.3);
    assert!(trajectory.max_yaw_rate_rad_s() <= 0.3 + 1e-9);
    assert!(trajectory.sample(0.5).yaw_rate_rad_s >= 0.0);
    let end = trajectory.sample(trajectory.duration_s());
    assert!((end.yaw_rad + 2.0).abs() < 1e-6);
}

#[test]
fn facing_the_motion_looks_along_the_velocity_in_the_middle_of_segments() {
    let waypoints = [
        Vector3::new(8.0, 0.0, 0.0),
        Vector3::new(8.0, 8.0, 0.0),
        Vector3::new(0.0, 8.0, 1.0),
    ];
    let trajectory = planner()
        .plan(
            &Reference::default(),
            &waypoints,
            &MotionLimits::default(),
            YawPolicy::FaceMotion,
        )
        .unwrap();
    let mut start_s = 0.0;
    for end_s in trajectory.waypoint_times_s() {
        let sample = trajectory.sample(0.5 * (start_s + end_s));
        let heading = sample.velocity_world.y.atan2(sample.velocity_world.x);
        assert!(so3::wrap_angle(sample.yaw_rad - heading).abs() < 0.02);
        start_s = *end_s;
    }
}

#[test]
fn equal_input_gives_equal_bits() {
    let waypoints = random_waypoints(&mut Pcg64::seed_from_u64(5), 9);
    assert_eq!(plan(&waypoints), plan(&waypoints));
}

#[test]
fn what_cannot_be_planned_is_refused_with_its_reason() {
    assert_eq!(plan(&[]), Err(PlanError::NoWaypoints));
    let x = Vector3::x();
    assert!(matches!(
        plan(&[x, x * 2.0, x * 2.0]),
        Err(PlanError::TooClose { index: 2, .. })
    ));
    assert!(matches!(
        plan(&[Vector3::zeros()]),
        Err(PlanError::TooClose { index: 0, .. })
    ));
    assert_eq!(
        plan(&[x, Vector3::new(0.0, f64::NAN, 0.0)]),
        Err(PlanError::WaypointNotFinite { index: 1 })
    );
    let far: Vec<_> = (1..=61).map(|k| x * f64::from(k)).collect();
    assert_eq!(
        plan(&far),
        Err(PlanError::TooManyWaypoints { count: 61, max: 60 })
    );
}

#[test]
fn a_start_or_limits_that_make_no_sense_are_refused() {
    let attempt = |start: &Reference, limits: &MotionLimits, yaw| {
        planner().plan(start, &[Vector3::x()], limits, yaw)
    };
    let (rest, limits) = (Reference::default(), MotionLimits::default());
    let mut start = rest;
    start.jerk_world.x = f64::INFINITY;
    assert_eq!(
        attempt(&start, &limits, YawPolicy::Hold),
        Err(PlanError::StartNotFinite)
    );
    assert_eq!(
        attempt(&rest, &limits, YawPolicy::Fixed(f64::NAN)),
        Err(PlanError::StartNotFinite)
    );
    start = rest;
    start.velocity_world.x = 3.0;
    assert!(matches!(
        attempt(&start, &limits, YawPolicy::Hold),
        Err(PlanError::StartBeyondLimits { .. })
    ));
    let none = MotionLimits {
        max_speed_m_s: 0.0,
        ..limits
    };
    assert!(matches!(
        attempt(&rest, &none, YawPolicy::Hold),
        Err(PlanError::Limits(_))
    ));
}
