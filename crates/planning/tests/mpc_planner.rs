//! The predictive planner among obstacles, flown on its own model.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot set itself up should fail, and prints what it measures"
)]

use alula_geometry::{Pose, Timestamp, so3};
use alula_messages::{
    Footprint, NO_OBSTACLE, NavState, Obstacle, ObstacleCovariance, ObstacleMotion, PLAN_POINTS,
    Plan, PlanExit, Sight,
};
use alula_planning::mpc::{
    Arrival, FieldOfView, Input, PlanRequest, PredictiveConfig, PredictivePlanner, State,
    TiltDynamics, TiltModel, YawTarget, reference_at,
};
use nalgebra::{Translation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

const INTERVAL_S: f64 = 0.06;
const RADIUS_M: f64 = 0.4;

fn planner() -> PredictivePlanner {
    PredictivePlanner::new(&PredictiveConfig::default(), &TiltModel::bebop()).unwrap()
}

/// A person-sized upright cylinder.
fn person(id: u32, centre: [f64; 3], velocity: [f64; 2]) -> Obstacle {
    let mut covariance = ObstacleCovariance::zeros();
    for i in 0..3 {
        covariance[(i, i)] = 0.05 * 0.05;
        covariance[(3 + i, 3 + i)] = 0.1 * 0.1;
    }
    let speed = velocity[0].hypot(velocity[1]);
    Obstacle {
        id,
        time: Timestamp::ZERO,
        centre_world: Vector3::from(centre),
        velocity_world: Vector3::new(velocity[0], velocity[1], 0.0),
        covariance,
        yaw_rad: 0.0,
        size_m: Vector3::new(0.6, 0.6, 1.8),
        size_variance_m2: Vector3::zeros(),
        footprint: Footprint::Round,
        motion: if speed > 0.0 {
            ObstacleMotion::Moving
        } else {
            ObstacleMotion::Static
        },
        sight: Sight::Seen,
        last_seen: Timestamp::ZERO,
        images: 10,
    }
}

fn nav_state(time: Timestamp, x: &State) -> NavState {
    let mut state = NavState {
        time,
        world_from_body: Pose::from_parts(
            Translation3::new(x[0], x[1], x[2]),
            so3::from_roll_pitch_yaw(x[6], x[7], x[8]),
        ),
        velocity_world: Vector3::new(x[3], x[4], x[5]),
        ..NavState::default()
    };
    for i in 3..9 {
        state.covariance[(i, i)] = 0.03 * 0.03;
    }
    state
}

fn at(position: [f64; 3]) -> State {
    let mut x = State::zeros();
    x.fixed_rows_mut::<3>(0).copy_from(&Vector3::from(position));
    x
}

struct Flight {
    planner: PredictivePlanner,
    dynamics: TiltDynamics,
    x: State,
    now: Timestamp,
    target: Vector3<f64>,
    speed_m_s: f64,
    obstacles: Vec<Obstacle>,
    /// Noise of the measured obstacles and of the acceleration.
    noise: Option<Pcg64>,
    least_clearance_m: f64,
}

impl Flight {
    fn new(start: [f64; 3], target: [f64; 3], obstacles: Vec<Obstacle>) -> Self {
        Self {
            planner: planner(),
            dynamics: TiltDynamics::new(&TiltModel::bebop(), INTERVAL_S).unwrap(),
            x: at(start),
            now: Timestamp::from_s(1.0),
            target: Vector3::from(target),
            speed_m_s: 2.0,
            obstacles: obstacles
                .into_iter()
                .map(|o| Obstacle {
                    time: Timestamp::from_s(1.0),
                    ..o
                })
                .collect(),
            noise: None,
            least_clearance_m: f64::INFINITY,
        }
    }

    fn seen(&mut self) -> Vec<Obstacle> {
        let mut seen = self.obstacles.clone();
        if let Some(noise) = &mut self.noise {
            for obstacle in &mut seen {
                for i in 0..2 {
                    let (p, v): (f64, f64) =
                        (StandardNormal.sample(noise), StandardNormal.sample(noise));
                    obstacle.centre_world[i] += 0.05 * p;
                    obstacle.velocity_world[i] += 0.1 * v;
                }
            }
        }
        seen
    }

    fn plan(&mut self) -> Plan {
        let seen = self.seen();
        *self.planner.plan(&PlanRequest {
            now: self.now,
            state: &nav_state(self.now, &self.x),
            target_world: self.target,
            arrival: Arrival::Stop,
            yaw: YawTarget::AlongMotion,
            max_speed_m_s: &[self.speed_m_s; PLAN_POINTS],
            obstacles: &seen,
            height_band_m: None,
            view: None,
        })
    }

    /// Plans and flies one interval by the plan's tilt, which the plan states by its acceleration.
    fn step(&mut self) -> Plan {
        let plan = self.plan();
        let u = self.input(&plan);
        self.x = self.dynamics.next(&self.x, &u);
        if let Some(noise) = &mut self.noise {
            for i in 3..6 {
                let a: f64 = StandardNormal.sample(noise);
                self.x[i] += 0.1 * INTERVAL_S * a;
            }
        }
        self.now += alula_geometry::TimeDelta::from_s(INTERVAL_S);
        for obstacle in &mut self.obstacles {
            obstacle.centre_world = obstacle.centre_after(INTERVAL_S);
            obstacle.time = self.now;
        }
        self.least_clearance_m = self.least_clearance_m.min(self.clearance_m());
        plan
    }

    fn input(&self, plan: &Plan) -> Input {
        assert_ne!(plan.exit, PlanExit::Failed);
        self.planner.first_input()
    }

    /// True distance between the vehicle's sphere and the nearest cylinder; below zero: collision.
    fn clearance_m(&self) -> f64 {
        let distance = |o: &Obstacle| {
            let level = (self.x.fixed_rows::<2>(0) - o.centre_world.xy()).norm() - 0.5 * o.size_m.x;
            let height = (self.x[2] - o.centre_world.z).abs() - 0.5 * o.size_m.z;
            let outside = level.max(0.0).hypot(height.max(0.0));
            outside + level.max(height).min(0.0) - RADIUS_M
        };
        self.obstacles
            .iter()
            .map(distance)
            .fold(f64::INFINITY, f64::min)
    }

    fn distance_m(&self) -> f64 {
        (self.x.fixed_rows::<3>(0) - self.target).norm()
    }

    /// Flies until the target is reached; the time it took, s.
    fn reach(&mut self, limit_s: f64) -> Option<f64> {
        let steps = (limit_s / INTERVAL_S) as usize;
        (0..steps).find_map(|k| {
            self.step();
            (self.distance_m() < 0.3).then_some(k as f64 * INTERVAL_S)
        })
    }
}

#[test]
fn the_target_is_reached_at_the_speed_limit() {
    let mut flight = Flight::new([0.0, 0.0, 1.5], [6.0, 0.0, 1.5], vec![]);
    let mut fastest = 0.0_f64;
    for _ in 0..100 {
        flight.step();
        fastest = fastest.max(flight.x.fixed_rows::<2>(3).norm());
    }
    assert!(flight.distance_m() < 0.05, "{}", flight.distance_m());
    assert!((1.8..2.1).contains(&fastest), "{fastest}");
    assert!(flight.x.fixed_rows::<3>(3).norm() < 0.05);
}

/// A flight of seven metres in eight seconds past somebody or something, without touching it.
fn expect_passed(what: &str, obstacle: Obstacle) {
    let mut flight = Flight::new([0.0, 0.0, 1.0], [7.0, 0.0, 1.0], vec![obstacle]);
    let time = flight.reach(8.0);
    println!(
        "{what}: {time:?} s, clearance {:.3} m",
        flight.least_clearance_m
    );
    assert!(time.is_some());
    assert!(
        flight.least_clearance_m > 0.0,
        "{}",
        flight.least_clearance_m
    );
}

#[test]
fn a_pillar_on_the_line_is_passed() {
    expect_passed("pillar", person(1, [3.5, 0.0, 0.9], [0.0; 2]));
}

#[test]
fn a_walker_who_comes_head_on_is_dodged() {
    expect_passed("walker", person(1, [8.0, 0.0, 0.9], [-1.2, 0.0]));
}

#[test]
fn a_hovering_vehicle_gives_way_to_a_walker() {
    let mut flight = Flight::new(
        [0.0, 0.0, 1.0],
        [0.0, 0.0, 1.0],
        vec![person(1, [4.0, 0.0, 0.9], [-1.2, 0.0])],
    );
    for _ in 0..100 {
        flight.step();
    }
    println!("hovering: clearance {:.3} m", flight.least_clearance_m);
    assert!(
        flight.least_clearance_m > 0.0,
        "{}",
        flight.least_clearance_m
    );
    assert!(
        flight.distance_m() < 0.3,
        "it returns: {}",
        flight.distance_m()
    );
}

#[test]
fn a_start_within_an_obstacle_leaves_it() {
    // At the centre itself, and off it: the sphere around a tracked obstacle may be too large.
    for offset in [0.0, 0.3] {
        let mut flight = Flight::new(
            [0.0, 0.0, 1.0],
            [0.0, 0.0, 1.0],
            vec![person(1, [offset, 0.0, 0.9], [0.0; 2])],
        );
        let plan = flight.step();
        assert_ne!(plan.exit, PlanExit::Failed);
        assert!(plan.max_violation_m > 0.0);
        for _ in 0..40 {
            flight.step();
        }
        assert!(
            flight.clearance_m() > 0.0,
            "{offset}: {}",
            flight.clearance_m()
        );
    }
}

fn wall(id: u32, centre: [f64; 3], yaw_rad: f64, length_m: f64) -> Obstacle {
    Obstacle {
        footprint: Footprint::Flat,
        yaw_rad,
        size_m: Vector3::new(length_m, 0.1, 3.0),
        ..person(id, centre, [0.0; 2])
    }
}

#[test]
fn a_wall_across_the_way_is_not_flown_through() {
    let mut flight = Flight::new(
        [0.0, 0.3, 1.0],
        [6.0, 0.0, 1.0],
        vec![wall(1, [3.0, 0.0, 1.5], std::f64::consts::FRAC_PI_2, 20.0)],
    );
    for _ in 0..120 {
        flight.step();
        let distance = 3.0 - 0.05 - RADIUS_M - flight.x[0];
        assert!(distance > 0.0, "{distance}");
    }
    assert!(flight.x[0] > 1.5, "it comes near: {}", flight.x[0]);
}

#[test]
fn a_low_box_under_the_way_is_flown_over() {
    let low = Obstacle {
        size_m: Vector3::new(1.0, 4.0, 0.6),
        ..person(1, [3.0, 0.0, 0.3], [0.0; 2])
    };
    let mut flight = Flight::new([0.0, 0.0, 1.5], [6.0, 0.0, 1.5], vec![low]);
    let time = flight.reach(6.0);
    assert!(time.is_some());
    assert!(flight.x[1].abs() < 0.1);
}

#[test]
fn a_narrow_gap_between_two_pillars_is_flown_through() {
    let pillars = vec![
        person(1, [3.0, 1.2, 0.9], [0.0; 2]),
        person(2, [3.0, -1.2, 0.9], [0.0; 2]),
    ];
    let mut flight = Flight::new([0.0, 0.2, 1.0], [6.0, 0.0, 1.0], pillars);
    let time = flight.reach(7.0);
    assert!(time.is_some());
    assert!(
        flight.least_clearance_m > 0.0,
        "{}",
        flight.least_clearance_m
    );
}

/// Ten obstacles along the way, `spacing_m` apart, every third of them moving.
fn ten_obstacles(seed: u64, spacing_m: f64) -> Vec<Obstacle> {
    let mut generator = Pcg64::seed_from_u64(seed);
    (0..10)
        .map(|id| {
            let centre = [
                2.0 + f64::from(id) * spacing_m,
                generator.random_range(-2.0..2.0),
                0.9,
            ];
            let speed = if id % 3 == 0 { 0.8 } else { 0.0 };
            let velocity = [speed, speed].map(|s| s * generator.random_range(-1.0..1.0));
            person(id, centre, velocity)
        })
        .collect()
}

#[test]
fn ten_obstacles_are_passed() {
    for seed in 0..5 {
        let obstacles = ten_obstacles(seed, 1.2);
        let mut flight = Flight::new([0.0, 0.0, 1.0], [15.0, 0.0, 1.0], obstacles);
        let time = flight.reach(25.0);
        println!(
            "ten obstacles, seed {seed}: {time:?} s, clearance {:.3} m",
            flight.least_clearance_m
        );
        assert!(
            flight.least_clearance_m > 0.0,
            "seed {seed}: {}",
            flight.least_clearance_m
        );
        assert!(time.is_some(), "seed {seed}");
    }
}

/// Without a planner of routes a thicket may hold the vehicle up, but it hits nothing.
#[test]
fn a_thicket_is_never_hit() {
    for seed in 0..5 {
        let obstacles = ten_obstacles(seed, 0.8);
        let mut flight = Flight::new([0.0, 0.0, 1.0], [12.0, 0.0, 1.0], obstacles);
        let time = flight.reach(15.0);
        println!(
            "thicket, seed {seed}: {time:?} s, clearance {:.3} m",
            flight.least_clearance_m
        );
        assert!(
            flight.least_clearance_m > 0.0,
            "seed {seed}: {}",
            flight.least_clearance_m
        );
    }
}

/// The closed loop of the peers' comparison: two obstacles aimed at the way.
fn crossing(seed: u64) -> Flight {
    let mut generator = Pcg64::seed_from_u64(1000 + seed);
    let start = [-4.0, generator.random_range(-0.3..0.3), 1.2];
    let obstacles = (0..2)
        .map(|i| {
            let meet_s = generator.random_range(1.8..3.6);
            let sign = if i == 0 { 1.0 } else { -1.0 };
            let angle: f64 = sign * generator.random_range(0.35..2.8);
            let speed = generator.random_range(1.0..2.0);
            let velocity = [speed * angle.cos(), speed * angle.sin()];
            let hit = [-4.0 + 1.6 * meet_s, generator.random_range(-0.2..0.2)];
            let centre = [
                hit[0] - velocity[0] * meet_s,
                hit[1] - velocity[1] * meet_s,
                0.9,
            ];
            person(i, centre, velocity)
        })
        .collect();
    let mut flight = Flight::new(start, [4.0, 0.0, 1.2], obstacles);
    flight.noise = Some(generator);
    flight
}

#[test]
fn two_crossing_walkers_are_never_hit() {
    let mut least = f64::INFINITY;
    for seed in 0..20 {
        let mut flight = crossing(seed);
        let time = flight.reach(10.0);
        least = least.min(flight.least_clearance_m);
        println!(
            "seed {seed}: {time:?} s, clearance {:.3} m",
            flight.least_clearance_m
        );
        assert!(
            flight.least_clearance_m > 0.0,
            "seed {seed}: {}",
            flight.least_clearance_m
        );
        assert!(time.is_some(), "seed {seed}");
    }
    println!("least clearance {least:.3} m");
}

#[test]
fn the_same_flight_gives_the_same_bits() {
    let fly = || {
        let mut flight = crossing(3);
        (0..40).map(|_| flight.step()).collect::<Vec<Plan>>()
    };
    assert_eq!(fly(), fly());
}

#[test]
fn numbers_that_are_not_finite_brake_the_last_plan() {
    let mut flight = Flight::new([0.0, 0.0, 1.0], [6.0, 0.0, 1.0], vec![]);
    for _ in 0..20 {
        flight.step();
    }
    let before = flight.plan();
    flight.x[0] = f64::NAN;
    let plan = flight.plan();
    assert_eq!(plan.exit, PlanExit::Failed);
    assert!((plan.points[0].position_world - before.points[0].position_world).norm() < 1e-9);
    let last = plan.points[PLAN_POINTS - 1];
    assert!(last.velocity_world.norm() < 0.2 * plan.points[0].velocity_world.norm());
    // It goes on braking, and is not braked anew.
    flight.now += alula_geometry::TimeDelta::from_s(0.5);
    let next = flight.plan();
    let expected = reference_at(&plan, flight.now);
    assert!((next.points[0].position_world - expected.position_world).norm() < 1e-9);
    assert!(next.points[0].velocity_world.norm() < plan.points[0].velocity_world.norm());
}

#[test]
fn a_first_request_that_is_not_finite_stands_still() {
    let mut flight = Flight::new([1.0, 2.0, 1.0], [f64::NAN, 0.0, 1.0], vec![]);
    let plan = flight.plan();
    assert_eq!(plan.exit, PlanExit::Failed);
    assert!(
        plan.points
            .iter()
            .all(|p| p.position_world == Vector3::new(1.0, 2.0, 1.0))
    );
}

#[test]
fn the_planner_recovers_after_a_failure() {
    let mut flight = Flight::new([0.0, 0.0, 1.0], [3.0, 0.0, 1.0], vec![]);
    flight.step();
    let x = flight.x;
    flight.x[3] = f64::INFINITY;
    assert_eq!(flight.plan().exit, PlanExit::Failed);
    flight.x = x;
    assert_eq!(flight.plan().exit, PlanExit::Converged);
}

#[test]
fn obstacles_far_from_the_way_are_left_out() {
    let near = person(7, [3.0, 0.8, 0.9], [0.0; 2]);
    let far = person(8, [-9.0, 0.0, 0.9], [0.0; 2]);
    let coming = person(9, [3.0, 4.0, 0.9], [0.0, -1.5]);
    let plan = Flight::new([0.0, 0.0, 1.0], [6.0, 0.0, 1.0], vec![far, coming, near]).plan();
    let ids: Vec<u32> = plan
        .obstacles
        .iter()
        .copied()
        .filter(|&id| id != NO_OBSTACLE)
        .collect();
    assert!(
        ids.contains(&7) && ids.contains(&9) && !ids.contains(&8),
        "{ids:?}"
    );
}

#[test]
fn a_narrow_view_bends_the_plan_into_it() {
    let mut flight = Flight::new([0.0, 0.0, 1.0], [0.0, 5.0, 1.0], vec![]);
    let free = flight.plan();
    let camera = Pose::from_parts(
        Translation3::new(0.0, 0.0, 1.0),
        so3::from_roll_pitch_yaw(0.0, 0.0, 0.0)
            * alula_messages::Mount::at([0.0; 3], alula_messages::Looking::Forward)
                .body_from_sensor()
                .rotation,
    );
    let view = FieldOfView::new(&camera, 1.5, 1.0, 5.0, 0.4);
    flight.planner.reset();
    let seen = *flight.planner.plan(&PlanRequest {
        now: flight.now,
        state: &nav_state(flight.now, &flight.x),
        target_world: flight.target,
        arrival: Arrival::Stop,
        yaw: YawTarget::AlongMotion,
        max_speed_m_s: &[2.0; PLAN_POINTS],
        obstacles: &[],
        height_band_m: None,
        view: Some(&view),
    });
    let outside = |plan: &Plan| {
        let p = plan.points[PLAN_POINTS - 1].position_world;
        view.sides(&p)
            .map(|(inside, _)| -inside)
            .fold(0.0, f64::max)
    };
    assert!(outside(&free) > 0.5, "{}", outside(&free));
    assert!(outside(&seen) < 0.5 * outside(&free), "{}", outside(&seen));
}

#[test]
fn a_target_to_pass_is_passed_at_speed() {
    let mut flight = Flight::new([0.0, 0.0, 1.0], [4.0, 0.0, 1.0], vec![]);
    let mut fastest_at_target = 0.0_f64;
    for _ in 0..60 {
        let plan = *flight.planner.plan(&PlanRequest {
            now: flight.now,
            state: &nav_state(flight.now, &flight.x),
            target_world: flight.target,
            arrival: Arrival::Pass,
            yaw: YawTarget::AlongMotion,
            max_speed_m_s: &[2.0; PLAN_POINTS],
            obstacles: &[],
            height_band_m: None,
            view: None,
        });
        assert_ne!(plan.exit, PlanExit::Failed);
        flight.x = flight
            .dynamics
            .next(&flight.x, &flight.planner.first_input());
        flight.now += alula_geometry::TimeDelta::from_s(INTERVAL_S);
        if flight.distance_m() < 0.5 {
            fastest_at_target = fastest_at_target.max(flight.x[3]);
            break;
        }
    }
    assert!(fastest_at_target > 1.5, "{fastest_at_target}");
}

#[test]
fn replanning_at_other_rates_goes_on_smoothly() {
    let mut flight = Flight::new([0.0, 0.0, 1.0], [6.0, 0.0, 1.0], vec![]);
    let mut last = flight.plan();
    for _ in 0..90 {
        // 15 Hz on a vehicle that follows the plan exactly.
        flight.now += alula_geometry::TimeDelta::from_s(1.0 / 15.0);
        let reference = reference_at(&last, flight.now);
        let pitch = (reference.acceleration_world.x + 0.184 * reference.velocity_world.x) / 9.80665;
        flight
            .x
            .fixed_rows_mut::<3>(0)
            .copy_from(&reference.position_world);
        flight
            .x
            .fixed_rows_mut::<3>(3)
            .copy_from(&reference.velocity_world);
        flight.x[7] = pitch.atan();
        last = flight.plan();
        assert_eq!(last.exit, PlanExit::Converged);
    }
    assert!(flight.distance_m() < 0.2, "{}", flight.distance_m());
}
