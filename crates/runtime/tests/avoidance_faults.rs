//! Faults in flight among obstacles: whatever happens, the vehicle touches nothing and says why.

// Helpers of tests may fail like tests do, and print what they measure.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use std::path::{Path, PathBuf};

use alula_geometry::Timestamp;
use alula_messages::{Fallback, FlightMode, Hindrance, NavState, SensorBatch, Vehicle, Violation};
use alula_runtime::Scenario;
use alula_runtime::flight::{Flight, Outcome, RecordTo, fly};
use alula_runtime::mission::{Mission, Step};
use alula_sim::Truth;
use nalgebra::{Vector2, Vector3};

/// The scenario that flies among people and pillars.
const AMONG_PEOPLE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../scenarios/among-people.toml"
);

/// Each fault meets so many flights, with other noise and times.
const SEEDS: std::ops::Range<u64> = 1..4;

/// When the faults begin: the vehicle is on its way at its speed, s.
fn fault_s(seed: u64) -> f64 {
    8.5 + 0.6 * seed as f64
}

fn scenario(overrides: &[&str]) -> Scenario {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    Scenario::load(Some(Path::new(AMONG_PEOPLE)), &overrides).unwrap()
}

/// Nobody walks.
const DESERTED: &str = "world.people=[]";
/// Nothing stands but the walls.
const EMPTY: &str = "world.obstacles=[]";

/// An override that puts one person on recorded places: `(t_s, x_m, y_m)`. Before the first and
/// after the last time nobody is there.
fn person_on(name: &str, places: &[(f64, f64, f64)]) -> String {
    let lines = places
        .iter()
        .map(|(t_s, x, y)| format!("{t_s:?},1,{x:?},{y:?}\n"));
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.csv"));
    let text = format!("t_s,id,x_m,y_m\n{}", lines.collect::<String>());
    std::fs::write(&file, text).unwrap();
    format!("world.tracks=[{{file=\"{}\"}}]", file.display())
}

fn flown(overrides: &[&str], seed: u64) -> Flight {
    fly(&scenario(overrides), seed, &RecordTo::Nothing, &mut |_| {}).unwrap()
}

/// True place and velocity at a time.
fn at(flight: &Flight, t_s: f64) -> (Vector3<f64>, Vector3<f64>) {
    let samples = &flight.log.samples;
    let sample = samples.iter().find(|s| s.t_s >= t_s).unwrap();
    (sample.true_position, sample.true_velocity)
}

/// A flight that touches nothing and comes to an end in this way.
fn untouched(overrides: &[&str], seed: u64, outcome: Outcome) -> Flight {
    let flight = flown(overrides, seed);
    expect_no_touch(&flight);
    assert_eq!(flight.summary.outcome, outcome, "{:?}", flight.summary);
    flight
}

fn expect_no_touch(flight: &Flight) {
    let summary = &flight.summary;
    assert_ne!(summary.outcome, Outcome::Collision, "{summary:?}");
    assert_ne!(summary.outcome, Outcome::Timeout, "{summary:?}");
}

/// Way from `v` to rest that is allowed: at most 0.3 s until images count as old, 0.06 s to the
/// next plan, 0.5 s until tilt and speed answer, then a brake of 1.5 m/s^2.
fn stopping_m(v_m_s: f64) -> f64 {
    0.86 * v_m_s + v_m_s * v_m_s / 3.0
}

#[test]
fn without_images_the_vehicle_brakes_holds_and_lands() {
    for seed in SEEDS {
        let start_s = fault_s(seed);
        let dead = format!(
            "simulation.sensors.depth.model.failures=[{{kind=\"drop_out\",start_s={start_s:?}}}]"
        );
        let mut held = None;
        let scenario = scenario(&[DESERTED, &dead]);
        let flight = fly(&scenario, seed, &RecordTo::Nothing, &mut |progress| {
            let report = &progress.output.guard;
            if report.fallback >= Fallback::Hold {
                held.get_or_insert((progress.t_s, report.cause.unwrap().violation));
            }
        })
        .unwrap();
        expect_no_touch(&flight);
        let (held_s, why) = held.unwrap();
        assert_eq!(why, Violation::DepthLost);
        assert!(held_s - start_s < 1.2, "held after {} s", held_s - start_s);
        let (from, velocity) = at(&flight, start_s);
        let (to, _) = at(&flight, start_s + 4.0);
        let way_m = (to - from).xy().norm();
        assert!(
            way_m < stopping_m(velocity.norm()),
            "seed {seed}: {way_m} m from {} m/s",
            velocity.norm()
        );
        assert_eq!(flight.summary.failure.as_deref(), Some("guard_depth_lost"));
    }
}

/// Who sees to all sides does not fly on with one side blind.
#[test]
fn without_one_of_two_cameras_the_vehicle_brakes_holds_and_lands() {
    let seed = 1;
    let start_s = fault_s(seed);
    let behind = format!(
        "simulation.sensors.more_depth=[{{mount={{position_m=[-0.1,0.0,0.0],looking=\"forward\",\
         roll_pitch_yaw_deg=[0.0,0.0,180.0]}},\
         model={{failures=[{{kind=\"drop_out\",start_s={start_s:?}}}]}}}}]"
    );
    let flight = flown(&[DESERTED, &behind], seed);
    expect_no_touch(&flight);
    assert_eq!(flight.summary.failure.as_deref(), Some("guard_depth_lost"));
    let (from, velocity) = at(&flight, start_s);
    let (to, _) = at(&flight, start_s + 4.0);
    assert!((to - from).xy().norm() < stopping_m(velocity.norm()));
}

/// Someone who is suddenly there.
#[test]
fn what_appears_a_metre_ahead_is_not_run_into() {
    for seed in SEEDS {
        let appears_s = fault_s(seed);
        let clear = flown(&[DESERTED, EMPTY], seed);
        let (place, velocity) = at(&clear, appears_s);
        // From surface to surface: vehicle 0.245 m, person 0.4 m.
        let there = place.xy() + velocity.xy().normalize() * (1.0 + 0.245 + 0.4);
        let who = person_on(
            &format!("appears-{seed}"),
            &[
                (appears_s, there.x, there.y),
                (appears_s + 100.0, there.x, there.y),
            ],
        );
        let flight = flown(&[DESERTED, EMPTY, &who], seed);
        expect_no_touch(&flight);
        let (_, before) = at(&flight, appears_s);
        println!(
            "seed {seed}: at {:.2} m/s, {:?} m",
            before.norm(),
            flight.summary.min_person_distance_m
        );
        assert!(before.norm() > 0.8, "seed {seed}: {}", before.norm());
    }
}

#[test]
fn a_hovering_vehicle_gives_way_and_comes_back() {
    for seed in SEEDS {
        let y = 0.1 * seed as f64 - 0.2;
        let who = person_on(&format!("walks-{seed}"), &[(6.0, 8.0, y), (16.0, -2.0, y)]);
        let flight = untouched(
            &[
                DESERTED,
                EMPTY,
                &who,
                // Room on all sides: what is behind a hovering vehicle was never seen.
                "world.room.size_m=[30.0, 20.0, 3.0]",
                "stack.guard.fence.min_m=[-8.0, -8.0, -1.0]",
                "stack.guard.fence.max_m=[15.0, 8.0, 2.8]",
                "mission.waypoints_m=[]",
                "mission.hover_s=20.0",
            ],
            seed,
            Outcome::Reached,
        );
        let summary = &flight.summary;
        assert!(summary.contacts.is_empty(), "seed {seed}: {summary:?}");
        let aside_m = |s: &alula_runtime::flight_log::Sample| s.true_position.xy().norm();
        let farthest_m = flight.log.samples.iter().map(aside_m).fold(0.0, f64::max);
        assert!(farthest_m > 0.4, "seed {seed}: gave way by {farthest_m} m");
        let end_m = summary.landing_distance_m;
        assert!(end_m < 0.4, "seed {seed}: came back to {end_m} m");
    }
}

#[test]
fn someone_on_the_goal_is_told_of() {
    for seed in SEEDS {
        let who = person_on("stands", &[(0.0, 9.0, 0.3), (500.0, 9.0, 0.3)]);
        let flight = untouched(
            &[
                DESERTED,
                EMPTY,
                &who,
                "mission.waypoints_m=[[9.0, 0.3, 1.2]]",
                "stack.avoidance.conduct.give_up_s=8.0",
            ],
            seed,
            Outcome::Aborted,
        );
        let summary = &flight.summary;
        assert_eq!(summary.failure.as_deref(), Some("goal_blocked"));
        assert!(summary.reason.contains("an obstacle stands on the goal"));
        assert_eq!(summary.guard, Fallback::None, "{summary:?}");
    }
}

#[test]
fn a_vehicle_that_starts_too_near_to_a_pillar_leaves_it() {
    for seed in SEEDS {
        // 37 cm from the vehicle's centre to the pillar: the planner wants 40 and more.
        let pillar =
            "world.obstacles=[{kind=\"cylinder\",centre_m=[0.62,0.05],radius_m=0.25,height_m=3.0}]";
        untouched(&[DESERTED, pillar], seed, Outcome::Reached);
    }
}

/// The truth, moved aside, in the shape of an estimate.
fn believed(truth: &Truth, now: Timestamp, aside: &Vector3<f64>) -> NavState {
    let mut state = truth.as_estimate(now);
    state.world_from_body.translation.vector += aside;
    state
}

#[test]
fn an_estimate_that_jumps_by_half_a_metre_is_told_of_and_leads_into_nothing() {
    for seed in SEEDS {
        let direction = Vector2::new((2.0 * seed as f64).cos(), (2.0 * seed as f64).sin());
        let jump = Vector3::new(direction.x, direction.y, 0.0) * 0.5;
        let scenario = scenario(&[DESERTED]);
        let world = scenario.build_world(seed).unwrap();
        let mut vehicle = scenario.build_vehicle(world, seed).unwrap();
        let mut stack = scenario.build_stack().unwrap();
        let mut mission = Mission::new(&scenario.config().mission);
        let mut batch = SensorBatch::default();
        let mut told_m: Option<f64> = None;
        while mission.step() != Step::Done && batch.now.as_s() < 60.0 {
            if let Some(intent) = mission.next(stack.output()) {
                stack.request(intent);
            }
            vehicle.sense(&mut batch).unwrap();
            let jumped = batch.now.as_s() >= fault_s(seed);
            let aside = if jumped { jump } else { Vector3::zeros() };
            let state = believed(vehicle.truth(), batch.now, &aside);
            let output = stack.update_with_state(&batch, &state, &mut |_| {});
            if let Some(Hindrance::EstimateJumped { jump_m }) = output.hindrance {
                assert_eq!(output.mode, FlightMode::Flying);
                told_m.get_or_insert(jump_m);
            }
            vehicle.command(&stack.output().command).unwrap();
        }
        assert!(
            vehicle.collision().is_none(),
            "seed {seed}: {:?}",
            vehicle.collision()
        );
        assert!(mission.succeeded(), "seed {seed}: {:?}", mission.step());
        let told_m = told_m.unwrap();
        assert!((told_m - 0.5).abs() < 0.02, "seed {seed}: {told_m} m");
    }
}
