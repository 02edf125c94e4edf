//! Flights without faults: the guard is silent and passes every command.

use alula_geometry::{GRAVITY_M_S2, TimeDelta, Timestamp};
use alula_messages::{Command, EstimateHealth, FlightMode, GuardReport, Violation};
use alula_parameters::Parameters;

use super::bench::{Bench, HOVER_N, MASS_KG, Range, STEP_S, thrust};
use crate::{Guard, GuardConfig, GuardVehicle};

#[test]
fn the_default_limits_are_valid() {
    assert_eq!(GuardConfig::default().validate(), Ok(()));
}

#[test]
fn a_fence_without_inside_is_not_accepted() {
    let mut config = GuardConfig::default();
    config.fence.min_m[1] = 60.0;
    let vehicle = GuardVehicle {
        mass_kg: MASS_KG,
        max_thrust_n: 30.0,
    };
    let error = Guard::new(&config, &vehicle).unwrap_err();
    assert_eq!(error.key, "fence.min_m[1]");
}

#[test]
fn nothing_is_found_in_a_long_flight() {
    let mut bench = Bench::flying();
    let begin = bench.now();
    for k in 0..(300.0 / STEP_S) as i64 {
        // Back and forth along x at up to 2 m/s and sideways at up to 1 m/s, rolling as needed.
        let t = k as f64 * STEP_S;
        bench.velocity.x = 2.0 * (0.3 * t).sin();
        bench.velocity.y = 0.7 * (0.9 * t).sin();
        bench.acceleration.y = 0.63 * (0.9 * t).cos();
        bench.velocity.z = 0.3 * (0.5 * t).cos();
        bench.acceleration.z = -0.15 * (0.5 * t).sin();
        let roll_rad = -(bench.acceleration.y / GRAVITY_M_S2).atan();
        bench.roll_rate_rad_s = (roll_rad - bench.roll_rad) / STEP_S;
        bench.roll_rate_rad_s = bench.roll_rate_rad_s.clamp(-2.0, 2.0);
        bench.requested = thrust(HOVER_N * (1.0 + bench.acceleration.z / GRAVITY_M_S2));
        let report = bench.step().clone();
        assert_eq!(report, GuardReport::default(), "after {t} s");
        assert_eq!(bench.guard.command(), bench.requested);
    }
    assert!(bench.now().seconds_since(begin) > 299.0);
}

#[test]
fn a_nominal_landing_passes() {
    let mut bench = Bench::flying();
    bench.mode = FlightMode::Landing;
    bench.velocity.z = -0.4;
    bench.requested = thrust(0.98 * HOVER_N);
    bench.expect_nothing(1.5 / 0.4);
    bench.velocity.z = 0.0;
    bench.flow_quality = 0.0;
    bench.range = Range::Invalid;
    bench.expect_nothing(2.0);
    bench.mode = FlightMode::Disarmed;
    bench.expect_nothing(1.0);
}

#[test]
fn nothing_is_found_on_the_ground_whatever_is_missing() {
    for mode in [FlightMode::Disarmed, FlightMode::Armed] {
        let mut bench = Bench::on_ground();
        bench.mode = mode;
        bench.imu_works = false;
        bench.flow_quality = 0.0;
        bench.range = Range::Silent;
        bench.spoil = Box::new(|state| state.health = EstimateHealth::Failed);
        bench.requested = thrust(f64::NAN);
        bench.expect_nothing(5.0);
    }
}

#[test]
fn on_the_ground_no_thrust_passes() {
    let mut bench = Bench::on_ground();
    bench.requested = thrust(HOVER_N);
    bench.step();
    assert_eq!(bench.guard.command(), Command::Disarm);
    bench.mode = FlightMode::Armed;
    bench.step();
    assert_eq!(bench.guard.command(), Command::Idle);
    bench.mode = FlightMode::Killed;
    bench.step();
    assert_eq!(bench.guard.command(), Command::Disarm);
}

#[test]
fn a_vehicle_whose_data_arrive_and_agree_is_ready() {
    assert_eq!(Bench::on_ground().guard.ready(), Ok(()));
}

#[test]
fn a_flight_may_not_begin_without_its_data() {
    let not_ready = |spoil: fn(&mut Bench)| {
        let mut bench = Bench::on_ground();
        spoil(&mut bench);
        bench.run(1.5);
        bench.guard.ready().unwrap_err()
    };
    assert_eq!(
        not_ready(|bench| bench.imu_works = false),
        Violation::ImuLost
    );
    assert_eq!(
        not_ready(|bench| bench.range = Range::Silent),
        Violation::RangeLost
    );
    assert_eq!(
        not_ready(|bench| bench.position.x = 51.0),
        Violation::Geofence
    );
    assert_eq!(
        not_ready(|bench| bench.spoil = Box::new(|state| state.time = Timestamp::ZERO)),
        Violation::EstimateStale
    );
    assert_eq!(
        not_ready(|bench| bench.spoil = Box::new(|state| state.health = EstimateHealth::Failed)),
        Violation::EstimateStale
    );
}

#[test]
fn time_that_goes_backwards_does_not_confuse_the_steps() {
    let mut bench = Bench::flying();
    bench.spoil = Box::new(|state| state.time = state.time - TimeDelta::from_s(1e-4));
    bench.expect_nothing(1.0);
}
