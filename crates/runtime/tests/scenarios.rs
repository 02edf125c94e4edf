//! The scenarios that come with alula: their worlds can be for every seed, nobody walks through
//! walls in them, and the vehicle takes off, hovers and lands in each.

// Helpers fail as tests do, and print what they measure.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use std::path::PathBuf;

use alula_geometry::Timestamp;
use alula_runtime::Scenario;
use alula_runtime::flight::Outcome;
use support::flown;

/// Scenarios with a vehicle that carries a depth camera among obstacles.
const NAMES: [&str; 7] = [
    "among-people",
    "watch-people",
    "lab-pillars",
    "lab-people",
    "corridor",
    "corridor-people",
    "forest",
];

/// The one with recorded walkers.
const RECORDED: &str = "forest-people";

/// Seeds for which worlds are built.
const SEEDS: u64 = 100;

/// Semi-axis of a person, m: nearer to an obstacle their centre cannot be.
const PERSON_M: f64 = 0.4;

fn scenario(name: &str, overrides: &[&str]) -> Scenario {
    let file = format!("../../scenarios/{name}.toml");
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(file);
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    Scenario::load(Some(&path), &overrides).unwrap()
}

/// The names of all scenarios whose files can be read here.
fn present() -> impl Iterator<Item = &'static str> {
    let recorded = std::env::var_os("ALULA_DATA").map(|_| RECORDED);
    if recorded.is_none() {
        println!("without {RECORDED}: ALULA_DATA does not name the folder of the real data");
    }
    NAMES.into_iter().chain(recorded)
}

#[test]
fn every_seed_has_a_world_in_which_nobody_walks_through_things() {
    for name in present() {
        let scenario = scenario(name, &[]);
        let limit_s = scenario.config().simulation.time_limit_s;
        let mut least_m = f64::INFINITY;
        let mut things = 0;
        for seed in 0..SEEDS {
            let world = scenario.build_world(seed).unwrap();
            things += world.obstacles().len();
            for i in 0..(10.0 * limit_s) as u32 {
                for person in world.people_at(Timestamp::from_s(0.1 * f64::from(i))) {
                    let nearest = world.clearance_of_obstacles(&person.centre_world);
                    least_m = least_m.min(nearest.map_or(f64::INFINITY, |n| n.distance_m));
                }
            }
        }
        let mean = things as f64 / SEEDS as f64;
        println!("{name}: {mean:.1} things, from which people stay {least_m:.3} m");
        assert!(least_m >= PERSON_M, "{name}: {least_m}");
    }
}

#[test]
fn seeds_vary_the_people() {
    for name in ["among-people", "lab-people", "corridor-people"] {
        let scenario = scenario(name, &[]);
        let places = |seed| -> Vec<_> {
            let world = scenario.build_world(seed).unwrap();
            world.people_at(Timestamp::ZERO).collect()
        };
        assert_eq!(places(3), places(3));
        assert_ne!(places(3), places(4), "{name}");
    }
}

#[test]
fn the_vehicle_hovers_and_lands_in_each() {
    for name in present() {
        let overrides = [
            "mission.waypoints_m=[]",
            "mission.hover_s=2.0",
            "simulation.sensors.depth.model.rate_hz=5.0",
        ];
        let summary = flown(&scenario(name, &overrides), 1).summary;
        println!(
            "{name}: landed {:.3} m away, nearest person {:?} m",
            summary.landing_distance_m, summary.min_person_distance_m
        );
        assert_eq!(summary.outcome, Outcome::Reached, "{name}: {summary:?}");
        assert_eq!(summary.failure, None);
        // Odometry on flow drifts by a few centimetres in a flight of ten seconds.
        assert!(summary.landing_distance_m < 0.2, "{name}: {summary:?}");
        assert_eq!(summary.contacts, [], "{name}");
    }
}

#[test]
fn a_file_in_a_folder_that_no_variable_names_is_refused_with_the_variable() {
    let file = "world.tracks=[{ file = \"${ALULA_NO_SUCH_FOLDER}/walk.csv\" }]";
    let error = scenario("lab-pillars", &[file]).build_world(1).unwrap_err();
    let message = error.to_string();
    assert!(
        message.ends_with(
            "lab-pillars.toml with --set: `world.tracks[0].file`: cannot read \
             `${ALULA_NO_SUCH_FOLDER}/walk.csv`: the environment variable `ALULA_NO_SUCH_FOLDER` \
             is not set; set it to the folder meant"
        ),
        "{message}"
    );
}
