//! What the tests of whole flights have in common.

// Every test program compiles this file and uses its own part of it.
#![allow(dead_code)]

use std::path::{Path, PathBuf};

use alula_runtime::Scenario;
use alula_runtime::flight::{Flight, RecordTo, fly};

/// The scenario that flies blind through waypoints.
pub const FIRST_FLIGHT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../scenarios/first-flight.toml"
);

/// A mission of a few metres, with few depth images, for tests that look at something else.
pub const SHORT: [&str; 3] = [
    "mission.waypoints_m=[[2.0, -1.0, 1.3]]",
    "mission.hover_s=0.2",
    "simulation.sensors.depth.model.rate_hz=1.0",
];

/// Still air.
pub const NO_WIND: [&str; 2] = [
    "simulation.wind.mean_m_s=[0.0, 0.0, 0.0]",
    "simulation.wind.gust_sigma_m_s=[0.0, 0.0, 0.0]",
];

/// The first flight with changes.
pub fn first_flight(overrides: &[&str]) -> Scenario {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    Scenario::load(Some(Path::new(FIRST_FLIGHT)), &overrides).unwrap()
}

/// A flight without recording.
pub fn flown(scenario: &Scenario, seed: u64) -> Flight {
    fly(scenario, seed, &RecordTo::Nothing, &mut |_| {}).unwrap()
}

/// A flight and its recording, `flight-SEED.mcap` in a folder.
pub fn recorded(scenario: &Scenario, seed: u64, folder: &Path) -> (Flight, PathBuf) {
    let path = folder.join(format!("flight-{seed}.mcap"));
    let flight = fly(scenario, seed, &RecordTo::File(path.clone()), &mut |_| {}).unwrap();
    (flight, path)
}
