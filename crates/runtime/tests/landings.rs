//! Landings of a vehicle that stands lower than its ranger can see: 4.5 cm above the ground, with a
//! ranger that needs 5 cm.

// Helpers of tests may fail like tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use alula_messages::{Command, Fallback};
use alula_runtime::Scenario;
use alula_runtime::flight::{Flight, Outcome, RecordTo, fly};
use support::first_flight;

/// Each case meets so many flights, with other noise and gusts.
const SEEDS: std::ops::Range<u64> = 0..25;

/// The low vehicle: sensors on its belly, 1.5 cm above the ground when it stands.
const LOW: [&str; 11] = [
    "simulation.preset=bebop2",
    "simulation.mass_factor=1.03",
    "simulation.sensors.flow.mount.position_m=[0.02, 0.0, -0.03]",
    "simulation.sensors.infrared.mount.position_m=[-0.02, 0.0, -0.03]",
    "stack.estimation.calibration.flow_camera.position_m=[0.02, 0.0, -0.03]",
    "stack.estimation.calibration.infrared.position_m=[-0.02, 0.0, -0.03]",
    "stack.estimation.parameters.flow_odometry.alignment.start_position_m=[0.0, 0.0, 0.045]",
    "stack.body.mass_kg=0.8",
    "stack.body.inertia_kg_m2=[2.07e-3, 2.08e-3, 3.78e-3]",
    "stack.body.max_thrust_n=24.0",
    "stack.control.attitude_lead_s=0.24",
];

/// Take-off and landing without a way in between; images are not looked at.
const UP_AND_DOWN: [&str; 2] = [
    "mission.waypoints_m=[]",
    "simulation.sensors.depth.model.rate_hz=1.0",
];

const WINDY: [&str; 2] = [
    "simulation.wind.mean_m_s=[2.0, 1.0, 0.0]",
    "simulation.wind.gust_sigma_m_s=[0.6, 0.6, 0.4]",
];

/// How a flight ended.
struct Landing {
    flight: Flight,
    /// From the first touch of the ground to the stop of the motors, s.
    delay_s: f64,
    /// True height above standing when the motors stopped, m.
    height_m: f64,
    guard: Fallback,
}

impl Landing {
    fn of(scenario: &Scenario, seed: u64) -> Self {
        let mut flew = false;
        let mut off_s = None;
        let mut guard = Fallback::None;
        let flight = fly(scenario, seed, &RecordTo::Nothing, &mut |progress| {
            let output = progress.output;
            guard = guard.max(output.guard.fallback);
            if !matches!(output.command, Command::Disarm | Command::Idle) {
                flew = true;
            } else if flew && off_s.is_none() {
                off_s = Some(progress.t_s);
            }
        })
        .unwrap();
        let samples = &flight.log.samples;
        let standing_m = samples[0].true_position.z;
        let height_m = |i: usize| samples[i].true_position.z - standing_m;
        let off_s = off_s.unwrap_or(f64::INFINITY);
        let off = samples.iter().rposition(|s| s.t_s <= off_s).unwrap();
        let aloft = (0..off).rposition(|i| height_m(i) > 0.2).unwrap();
        let touch = (aloft..off).find(|&i| height_m(i) < 0.005).unwrap_or(off);
        Self {
            delay_s: off_s - samples[touch].t_s,
            height_m: height_m(off),
            guard,
            flight,
        }
    }
}

fn landings(overrides: &[&[&str]]) -> Vec<Landing> {
    let scenario = first_flight(&overrides.concat());
    SEEDS.map(|seed| Landing::of(&scenario, seed)).collect()
}

/// All landings end by themselves, on the ground; the median and the greatest delay, s.
fn checked_delays_s(overrides: &[&[&str]]) -> (f64, f64) {
    let landings = landings(overrides);
    for landing in &landings {
        let summary = &landing.flight.summary;
        assert_eq!(summary.outcome, Outcome::Reached, "{summary:?}");
        assert!(landing.guard < Fallback::Descend, "{summary:?}");
        // The motors stop where a fall does no harm.
        assert!(
            landing.height_m < 0.1,
            "{} m: {summary:?}",
            landing.height_m
        );
    }
    let mut delays_s: Vec<f64> = landings.iter().map(|l| l.delay_s).collect();
    delays_s.sort_by(f64::total_cmp);
    (delays_s[delays_s.len() / 2], delays_s[delays_s.len() - 1])
}

#[test]
fn the_touchdown_is_believed_within_half_a_second() {
    let (median_s, _) = checked_delays_s(&[&LOW, &UP_AND_DOWN]);
    assert!(median_s <= 0.5, "{median_s}");
}

#[test]
fn in_wind_too() {
    let (median_s, _) = checked_delays_s(&[&LOW, &UP_AND_DOWN, &WINDY]);
    assert!(median_s <= 0.5, "{median_s}");
}

#[test]
fn a_vehicle_with_long_legs_lands_as_well() {
    let (median_s, _) = checked_delays_s(&[&UP_AND_DOWN, &WINDY]);
    assert!(median_s <= 0.5, "{median_s}");
}

/// Without a range the ground must carry more for longer: 0.3 of the weight for 1 s.
fn check_landing_without_range(since_s: f64, vehicle: &[&str]) {
    let lost = format!(
        "simulation.sensors.infrared.model.failures=[{{kind=\"drop_out\",start_s={since_s:?}}}]"
    );
    let (_, greatest_s) = checked_delays_s(&[vehicle, &UP_AND_DOWN, &[lost.as_str()]]);
    assert!(greatest_s < 1.7, "{greatest_s}");
}

#[test]
fn a_range_lost_at_the_beginning_of_the_descent_does_not_end_it_otherwise() {
    check_landing_without_range(6.0, &LOW);
}

#[test]
fn a_range_lost_in_the_middle_of_the_descent_does_not_end_it_otherwise() {
    check_landing_without_range(7.0, &LOW);
    check_landing_without_range(7.0, &[]);
}

#[test]
fn a_range_lost_just_above_the_ground_does_not_end_the_descent_otherwise() {
    check_landing_without_range(8.0, &LOW);
    check_landing_without_range(8.0, &[]);
}
