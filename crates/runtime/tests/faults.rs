//! Faults in flight: whatever fails, the guard acts in time, and the vehicle ends upright on the
//! ground with its motors off.

// Helpers of tests may fail like tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use alula_messages::{Command, Fallback, Violation};
use alula_runtime::Scenario;
use alula_runtime::flight::{Flight, Outcome, RecordTo, fly};

/// The scenario that flies blind through waypoints.
const FIRST_FLIGHT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../scenarios/first-flight.toml"
);

/// When the faults begin: take-off is over, the vehicle is on its way at up to 2 m/s, s.
const FAULT_S: f64 = 8.0;
/// Each fault meets so many flights, with other noise, gusts and times.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=4;
/// What a landing gear takes without harm, and the simulator counts as a landing, m/s.
const GENTLE_M_S: f64 = 1.5;

/// What happened after a fault.
struct Fault {
    flight: Flight,
    /// When the guard first acted, s after the fault began, what it did and why.
    action: Option<(f64, Fallback, Violation)>,
    /// When it first went as far as to end the flight, s after the fault began.
    end_of_flight_s: Option<f64>,
    last_command: Command,
    seed: u64,
}

/// Flies the first flight with an override, in which `{start}` stands for the fault's time.
fn fly_with(fault: &str, seed: u64) -> Fault {
    let start_s = FAULT_S + 1.7 * seed as f64;
    let overrides = [
        fault.replace("{start}", &format!("{start_s:.3}")),
        // Nothing flies by depth images, and they take most of the time.
        "simulation.sensors.depth.model.rate_hz=1.0".to_owned(),
        "simulation.time_limit_s=110.0".to_owned(),
    ];
    let mut overrides = overrides.to_vec();
    if fault.contains("wind") {
        overrides.push("world.obstacles=[]".to_owned());
    }
    let scenario = Scenario::load(Some(Path::new(FIRST_FLIGHT)), &overrides).unwrap();
    let mut action = None;
    let mut end_of_flight_s = None;
    let mut last_command = Command::Disarm;
    let flight = fly(&scenario, seed, &RecordTo::Nothing, &mut |progress| {
        let report = &progress.output.guard;
        let after_s = progress.t_s - start_s;
        last_command = progress.output.command;
        if let Some(cause) = report.cause.filter(|_| after_s >= 0.0) {
            action.get_or_insert((after_s, report.fallback, cause.violation));
            if report.fallback >= Fallback::Land {
                end_of_flight_s.get_or_insert(after_s);
            }
        }
    });
    Fault {
        flight: flight.unwrap(),
        action,
        end_of_flight_s,
        last_command,
        seed,
    }
}

impl Fault {
    /// The guard acted within `limit_s`, because of `violation`, at least as gravely as `fallback`.
    fn expect(&self, violation: Violation, fallback: Fallback, limit_s: f64) {
        let Some((after_s, found_fallback, found)) = self.action else {
            panic!("{self}: the guard did nothing");
        };
        assert_eq!(found, violation, "{self}");
        assert!(after_s <= limit_s, "{self}: only after {after_s} s");
        assert!(found_fallback >= fallback, "{self}: {found_fallback:?}");
    }

    /// The vehicle stands on the ground, upright, with its motors off.
    fn expect_safe_ending(&self) {
        let outcome = self.flight.summary.outcome;
        assert!(
            matches!(outcome, Outcome::Reached | Outcome::Aborted),
            "{self}"
        );
        let last = self.flight.log.samples.last().unwrap();
        let standing_m = self.flight.log.samples[0].true_position.z;
        assert!((last.true_position.z - standing_m).abs() < 0.02, "{self}");
        assert!(last.true_velocity.norm() < 0.05, "{self}");
        assert_eq!(self.last_command, Command::Disarm, "{self}");
        assert!(self.touchdown_m_s() < GENTLE_M_S, "{self}");
    }

    /// True speed at the last instant above the ground, m/s.
    fn touchdown_m_s(&self) -> f64 {
        let samples = &self.flight.log.samples;
        let standing_m = samples[0].true_position.z;
        let above = |z_m: f64| z_m > standing_m + 0.02;
        let last = samples.iter().rev().find(|s| above(s.true_position.z));
        last.map_or(0.0, |s| s.true_velocity.norm())
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let summary = &self.flight.summary;
        write!(f, "seed {}: {}", self.seed, summary.reason)?;
        write!(f, ", touchdown at {:.2} m/s", self.touchdown_m_s())
    }
}

/// An override that makes a sensor fail until the end.
fn failure(sensor: &str, kind: &str) -> String {
    format!("simulation.sensors.{sensor}.failures=[{{kind=\"{kind}\",start_s={{start}}}}]")
}

fn each_seed(fault: &str, check: impl Fn(&Fault)) {
    for seed in SEEDS {
        let fault = fly_with(fault, seed);
        check(&fault);
        fault.expect_safe_ending();
    }
}

#[test]
fn without_flow_the_vehicle_holds_and_lands() {
    each_seed(&failure("flow.model", "drop_out"), |fault| {
        fault.expect(Violation::FlowLost, Fallback::Hold, 1.1);
        assert!(fault.end_of_flight_s.unwrap() <= 3.1, "{fault}");
    });
}

#[test]
fn with_a_stuck_range_the_vehicle_lands() {
    each_seed(&failure("infrared.model", "stuck"), |fault| {
        fault.expect(Violation::RangeLost, Fallback::Land, 1.1);
    });
}

#[test]
fn without_a_range_the_vehicle_lands() {
    each_seed(&failure("infrared.model", "drop_out"), |fault| {
        fault.expect(Violation::RangeLost, Fallback::Land, 1.1);
    });
}

#[test]
fn a_burst_of_impossible_inertial_data_is_data_lost() {
    let burst = "simulation.sensors.imu.failures=[{kind=\"outliers\",start_s={start},\
                 duration_s=1.0,magnitude=300.0}]";
    each_seed(burst, |fault| {
        fault.expect(Violation::ImuLost, Fallback::Descend, 0.15);
    });
}

#[test]
fn without_inertial_data_the_guard_brakes_and_descends() {
    each_seed(&failure("imu", "drop_out"), |fault| {
        fault.expect(Violation::ImuLost, Fallback::Descend, 0.15);
    });
}

#[test]
fn stuck_inertial_data_are_data_lost() {
    each_seed(&failure("imu", "stuck"), |fault| {
        fault.expect(Violation::ImuLost, Fallback::Descend, 0.15);
    });
}

#[test]
fn in_a_gust_beyond_the_vehicle_the_guard_acts() {
    // Above an open field, where the only harm is to be carried away.
    let pulse = "{start_s={start},duration_s=4.0,velocity_m_s=[29.0,29.0,0.0]}";
    let gust = format!("simulation.wind.pulses=[{pulse},{pulse}]");
    each_seed(&gust, |fault| {
        let (after_s, _, violation) = fault.action.unwrap();
        let expected = [Violation::Speed, Violation::Tilt, Violation::Geofence];
        assert!(expected.contains(&violation), "{fault}: {violation:?}");
        assert!(after_s <= 4.0, "{fault}: only after {after_s} s");
    });
}

/// Horizontal true speed when the descent by the guard has lasted for a time, m/s.
fn speed_in_descent_m_s(overrides: &[String], after_s: f64) -> f64 {
    let scenario = Scenario::load(Some(Path::new(FIRST_FLIGHT)), overrides).unwrap();
    let mut began_s = None;
    let mut speed_m_s = f64::NAN;
    fly(&scenario, 1, &RecordTo::Nothing, &mut |progress| {
        if progress.output.guard.fallback == Fallback::Descend {
            let began_s = *began_s.get_or_insert(progress.t_s);
            if progress.t_s - began_s <= after_s {
                speed_m_s = progress.velocity_world.xy().norm();
            }
        }
    })
    .unwrap();
    speed_m_s
}

#[test]
fn the_brake_takes_most_of_the_speed_away() {
    let dead = failure("imu", "drop_out").replace("{start}", "12.0");
    let level = "stack.guard.descent.brake.tilt_deg=0.0".to_owned();
    let gliding_m_s = speed_in_descent_m_s(&[dead.clone(), level], 1.2);
    let braked_m_s = speed_in_descent_m_s(&[dead], 1.2);
    assert!(gliding_m_s > 1.0, "{gliding_m_s}");
    assert!(
        braked_m_s < 0.3 * gliding_m_s,
        "{braked_m_s} of {gliding_m_s}"
    );
}
