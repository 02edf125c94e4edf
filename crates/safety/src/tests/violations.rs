//! One test for each violation: the guard acts within its time, and not just below the limit.

use alula_geometry::{GRAVITY_M_S2, TimeDelta, so3};
use alula_messages::{
    Command, ErrorCovariance, EstimateHealth, Fallback, FlightMode, NavState, Violation,
    error_index,
};
use nalgebra::Vector3;

use super::bench::{Bench, HOVER_N, Range, thrust};

fn spoiled(spoil: impl Fn(&mut NavState) + 'static) -> Bench {
    let mut bench = Bench::flying();
    bench.spoil = Box::new(spoil);
    bench
}

#[test]
fn the_fence_counts_the_way_to_stop() {
    // At 2 m/s and 2 m/s^2 the vehicle stops within 1 m: it may come up to 49 m.
    let mut bench = Bench::flying();
    bench.position.x = 47.5;
    bench.velocity.x = 2.0;
    bench.expect_nothing(0.7);
    bench.expect(Violation::Geofence, Fallback::Hold, 0.0, 0.1);
    assert!((bench.position.x - 49.0).abs() < 0.03);
}

#[test]
fn outside_the_fence_the_vehicle_lands() {
    let mut bench = Bench::flying();
    bench.position.y = -50.1;
    bench.expect(Violation::Geofence, Fallback::Hold, 0.0, 0.01);
    bench.expect(Violation::Geofence, Fallback::Land, 1.9, 2.05);
}

#[test]
fn the_ceiling_holds_above_the_ground_that_the_ranger_sees() {
    let mut bench = Bench::flying();
    bench.position.z = 19.8;
    bench.run(0.1);
    bench.expect_nothing(1.0);
    bench.position.z = 20.1;
    bench.expect(Violation::Geofence, Fallback::Hold, 0.0, 0.03);
}

#[test]
fn a_hold_is_released_when_its_cause_is_gone() {
    let mut bench = Bench::flying();
    bench.position.x = 50.1;
    bench.run(0.5);
    bench.position.x = 48.0;
    bench.run(0.9);
    assert_eq!(bench.guard.report().fallback, Fallback::Hold);
    bench.run(0.15);
    bench.expect_nothing(1.0);
}

#[test]
fn too_fast_is_held_and_then_landed() {
    let mut bench = Bench::flying();
    bench.velocity.x = 3.95;
    bench.expect_nothing(3.0);
    bench.velocity.x = 4.1;
    bench.expect(Violation::Speed, Fallback::Hold, 0.19, 0.22);
    bench.expect(Violation::Speed, Fallback::Land, 1.7, 1.85);
}

#[test]
fn too_much_tilt_is_held_and_then_levelled() {
    let mut bench = Bench::flying();
    bench.roll_rate_rad_s = 4.0;
    bench.run(44.0_f64.to_radians() / 4.0);
    bench.roll_rate_rad_s = 0.0;
    bench.expect_nothing(0.3);
    bench.roll_rad = 46.0_f64.to_radians();
    bench.expect(Violation::Tilt, Fallback::Hold, 0.19, 0.22);
    bench.expect(Violation::Tilt, Fallback::Descend, 0.7, 0.85);
}

#[test]
fn tilt_is_seen_by_the_gyroscope_when_the_estimate_denies_it() {
    let mut bench = spoiled(|state| state.world_from_body.rotation = so3::exp(&Vector3::zeros()));
    bench.roll_rate_rad_s = 5.0;
    bench.run(70.0_f64.to_radians() / 5.0);
    bench.roll_rate_rad_s = 0.0;
    bench.expect(Violation::Tilt, Fallback::Hold, 0.0, 0.25);
    // The verticals disagree as well, which is the graver finding.
    bench.expect(Violation::EstimateInconsistent, Fallback::Descend, 0.0, 0.5);
}

#[test]
fn tumbling_cuts_the_motors() {
    let mut bench = Bench::flying();
    bench.roll_rate_rad_s = 8.0;
    bench.run(110.0_f64.to_radians() / 8.0);
    bench.roll_rate_rad_s = 0.0;
    assert!(bench.guard.report().fallback < Fallback::Cut);
    bench.expect(Violation::Tilt, Fallback::Cut, 0.2, 0.31);
    assert_eq!(bench.guard.command(), Command::Disarm);
}

#[test]
fn an_old_estimate_is_not_flown() {
    let old =
        |age_s: f64| move |state: &mut NavState| state.time = state.time - TimeDelta::from_s(age_s);
    spoiled(old(0.095)).expect_nothing(1.0);
    spoiled(old(0.105)).expect(Violation::EstimateStale, Fallback::Descend, 0.0, 0.01);
    spoiled(old(-0.2)).expect(Violation::EstimateStale, Fallback::Descend, 0.0, 0.01);
}

#[test]
fn an_estimate_that_failed_is_not_flown() {
    for health in [EstimateHealth::Failed, EstimateHealth::Initialising] {
        let mut bench = spoiled(move |state| state.health = health);
        bench.expect(Violation::EstimateStale, Fallback::Descend, 0.0, 0.01);
    }
}

#[test]
fn an_estimate_that_is_not_finite_is_not_flown() {
    let mut bench = spoiled(|state| state.covariance[(3, 3)] = f64::NAN);
    bench.expect(
        Violation::EstimateInconsistent,
        Fallback::Descend,
        0.0,
        0.01,
    );
    let mut bench = spoiled(|state| state.velocity_world.x = f64::INFINITY);
    bench.expect(
        Violation::EstimateInconsistent,
        Fallback::Descend,
        0.0,
        0.01,
    );
}

fn with_sigma(row: usize, sigma: f64) -> Bench {
    spoiled(move |state| {
        state.covariance = ErrorCovariance::zeros();
        state.covariance[(row, row)] = sigma * sigma;
    })
}

#[test]
fn an_uncertain_estimate_is_landed() {
    for (row, limit) in [
        (error_index::POSITION, 10.0),
        (error_index::POSITION + 2, 1.0),
        (error_index::VELOCITY + 1, 1.0),
    ] {
        with_sigma(row, 0.99 * limit).expect_nothing(2.0);
        let mut bench = with_sigma(row, 1.01 * limit);
        bench.expect(Violation::EstimateInconsistent, Fallback::Land, 1.0, 1.05);
        bench.expect(
            Violation::EstimateInconsistent,
            Fallback::Descend,
            2.9,
            3.05,
        );
    }
}

#[test]
fn an_uncertain_attitude_is_levelled() {
    let limit = 10.0_f64.to_radians();
    with_sigma(error_index::ORIENTATION, 0.99 * limit).expect_nothing(2.0);
    with_sigma(error_index::ORIENTATION, 1.01 * limit).expect(
        Violation::EstimateInconsistent,
        Fallback::Descend,
        1.0,
        1.05,
    );
}

#[test]
fn a_height_that_contradicts_the_range_is_landed() {
    let lifted =
        |by_m: f64| move |state: &mut NavState| state.world_from_body.translation.vector.z += by_m;
    // The dither of the range is 0.01 m.
    spoiled(lifted(0.68)).expect_nothing(3.0);
    spoiled(lifted(0.73)).expect(Violation::EstimateInconsistent, Fallback::Land, 1.5, 1.55);
}

#[test]
fn a_vertical_speed_that_contradicts_the_range_is_landed() {
    let climbing = |by_m_s: f64| move |state: &mut NavState| state.velocity_world.z += by_m_s;
    // The dithers of range and specific force are 0.1 m/s in the vertical speed.
    spoiled(climbing(0.9)).expect_nothing(3.0);
    spoiled(climbing(1.1)).expect(Violation::EstimateInconsistent, Fallback::Land, 1.0, 1.3);
}

#[test]
fn a_velocity_that_contradicts_the_flow_is_landed() {
    let moving = |by_m_s: f64| move |state: &mut NavState| state.velocity_world.x += by_m_s;
    // The dither of the flow is 0.03 m/s, the low-pass takes 0.3 s.
    spoiled(moving(0.9)).expect_nothing(5.0);
    spoiled(moving(1.5)).expect(Violation::EstimateInconsistent, Fallback::Land, 1.0, 1.6);
}

#[test]
fn too_low_is_held_and_then_landed() {
    let mut bench = Bench::flying();
    bench.velocity.z = -0.5;
    bench.run((1.5 - 0.22) / 0.5);
    bench.velocity.z = 0.0;
    bench.expect_nothing(2.0);
    bench.position.z = 0.12;
    bench.expect(Violation::RangeLow, Fallback::Hold, 0.3, 0.34);
    bench.expect(Violation::RangeLow, Fallback::Land, 1.65, 1.75);
}

#[test]
fn a_command_that_is_not_finite_never_passes() {
    let mut bench = Bench::flying();
    bench.requested = thrust(f64::NAN);
    bench.expect(Violation::CommandInvalid, Fallback::Hold, 0.0, 0.01);
    assert!(bench.guard.command().is_finite());
    bench.expect(Violation::CommandInvalid, Fallback::Descend, 0.29, 0.31);
    assert!(bench.guard.command().is_finite());
}

#[test]
fn a_command_beyond_the_vehicle_never_passes() {
    let command = |roll_rad, yaw_rate_rad_s, thrust_n| Command::AttitudeThrust {
        roll_rad,
        pitch_rad: 0.0,
        yaw_rate_rad_s,
        thrust_n,
    };
    let limit_rad = 50.0_f64.to_radians();
    for (good, bad) in [
        (
            (0.99 * limit_rad, 0.0, HOVER_N),
            (-1.01 * limit_rad, 0.0, HOVER_N),
        ),
        ((0.0, -3.99, HOVER_N), (0.0, 4.01, HOVER_N)),
        ((0.0, 0.0, 2.5 * HOVER_N), (0.0, 0.0, 2.51 * HOVER_N)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, -0.01)),
    ] {
        let mut bench = Bench::flying();
        bench.requested = command(good.0, good.1, good.2);
        bench.expect_nothing(0.02);
        assert_eq!(bench.guard.command(), bench.requested);
        bench.requested = command(bad.0, bad.1, bad.2);
        bench.expect(Violation::CommandInvalid, Fallback::Hold, 0.0, 0.01);
        assert_ne!(bench.guard.command(), bench.requested);
    }
}

#[test]
fn lost_inertial_data_make_a_descent() {
    let mut bench = Bench::flying();
    bench.imu_works = false;
    bench.run(0.095);
    bench.imu_works = true;
    bench.expect_nothing(1.0);
    bench.imu_works = false;
    bench.expect(Violation::ImuLost, Fallback::Descend, 0.1, 0.11);
}

#[test]
fn lost_flow_is_held_landed_and_then_descended() {
    let mut bench = Bench::flying();
    bench.flow_quality = 0.31;
    bench.expect_nothing(2.0);
    bench.flow_quality = 0.29;
    bench.expect(Violation::FlowLost, Fallback::Hold, 0.98, 1.02);
    bench.expect(Violation::FlowLost, Fallback::Land, 1.98, 2.02);
    bench.expect(Violation::FlowLost, Fallback::Descend, 6.98, 7.02);
}

/// Flies by depth images that show a wall.
fn seeing() -> Bench {
    let mut bench = Bench::on_ground();
    bench.guard.expect_depth();
    bench.depth_mm = Some(3000);
    bench.mode = FlightMode::Armed;
    bench.run(0.1);
    bench.take_off_to(1.5);
    bench.mode = FlightMode::Flying;
    bench.expect_nothing(2.0);
    bench
}

#[test]
fn lost_depth_is_held_and_then_landed_where_obstacles_are_avoided() {
    let mut bench = seeing();
    bench.depth_mm = None;
    bench.expect(Violation::DepthLost, Fallback::Hold, 0.96, 1.04);
    bench.expect(Violation::DepthLost, Fallback::Land, 3.98, 4.02);
}

#[test]
fn a_covered_depth_camera_counts_as_lost() {
    let mut bench = seeing();
    bench.depth_mm = Some(0);
    bench.expect(Violation::DepthLost, Fallback::Hold, 0.96, 1.04);
}

#[test]
fn a_depth_camera_that_repeats_one_image_counts_as_lost() {
    let mut bench = seeing();
    bench.depth_stuck = true;
    bench.expect(Violation::DepthLost, Fallback::Hold, 0.96, 1.08);
}

#[test]
fn one_of_two_depth_cameras_is_missed_like_the_only_one() {
    let mut bench = seeing();
    bench.second_depth = true;
    bench.expect_nothing(2.0);
    bench.second_depth = false;
    bench.expect(Violation::DepthLost, Fallback::Hold, 0.96, 1.04);
}

/// What is dated ahead must not look fresh until the clock has caught up.
#[test]
fn a_sensor_whose_clock_runs_ahead_counts_as_lost() {
    let mut bench = seeing();
    bench.ahead_s.depth = 30.0;
    bench.expect(Violation::DepthLost, Fallback::Hold, 0.96, 1.08);
    let mut bench = Bench::flying();
    bench.ahead_s.range = 30.0;
    bench.expect(Violation::RangeLost, Fallback::Land, 0.98, 1.05);
    let mut bench = Bench::flying();
    bench.ahead_s.flow = 30.0;
    bench.expect(Violation::FlowLost, Fallback::Hold, 0.98, 1.02);
    let mut bench = Bench::flying();
    bench.ahead_s.imu = 30.0;
    bench.expect(Violation::ImuLost, Fallback::Descend, 0.1, 0.11);
}

#[test]
fn depth_is_not_missed_where_nothing_is_avoided_by_it() {
    let mut bench = Bench::flying();
    bench.depth_mm = Some(3000);
    bench.run(1.0);
    bench.depth_mm = None;
    bench.expect_nothing(3.0);
}

#[test]
fn flow_is_not_missed_near_the_ground() {
    let mut bench = Bench::flying();
    bench.velocity.z = -0.5;
    bench.run((1.5 - 0.3) / 0.5);
    bench.velocity.z = 0.0;
    bench.flow_quality = 0.0;
    bench.expect_nothing(5.0);
}

#[test]
fn a_range_that_is_lost_or_stuck_is_landed() {
    for range in [Range::Silent, Range::Invalid, Range::Stuck] {
        let mut bench = Bench::flying();
        bench.range = range;
        bench.run(0.9);
        assert_eq!(bench.guard.report().fallback, Fallback::None);
        bench.range = Range::Works;
        bench.expect_nothing(1.0);
        bench.range = range;
        bench.expect(Violation::RangeLost, Fallback::Land, 0.98, 1.05);
    }
}

#[test]
fn dead_reckoning_counts_as_a_lost_sensor() {
    let reckoning = |since_velocity_s, since_height_s| {
        spoiled(move |state| {
            state.health = EstimateHealth::Degraded {
                since_velocity_s,
                since_height_s,
            }
        })
    };
    reckoning(1.9, 1.9).expect_nothing(2.0);
    reckoning(2.1, 0.0).expect(Violation::FlowLost, Fallback::Hold, 0.0, 0.01);
    reckoning(0.0, 2.1).expect(Violation::RangeLost, Fallback::Land, 0.0, 0.01);
}

#[test]
fn a_hold_that_is_not_obeyed_becomes_a_landing_and_then_a_descent() {
    let mut bench = Bench::flying();
    bench.obedient = false;
    bench.flow_quality = 0.0;
    bench.expect(Violation::FlowLost, Fallback::Hold, 0.9, 1.05);
    bench.expect(Violation::FlowLost, Fallback::Land, 0.95, 1.05);
    bench.expect(Violation::FlowLost, Fallback::Descend, 0.95, 1.05);
}

#[test]
fn a_landing_that_does_not_end_becomes_a_descent() {
    let mut bench = Bench::flying();
    bench.range = Range::Silent;
    bench.run(1.1);
    bench.range = Range::Works;
    bench.run(58.0);
    assert_eq!(bench.guard.report().fallback, Fallback::Land);
    let seconds = bench.seconds_until(Fallback::Descend, 3.0);
    assert!(seconds.is_some_and(|s| s < 2.0));
}

#[test]
fn a_landing_is_kept_until_the_vehicle_is_disarmed() {
    let mut bench = Bench::flying();
    bench.range = Range::Stuck;
    bench.run(1.2);
    let cause = bench.guard.report().cause;
    assert!(cause.is_some_and(|c| c.violation == Violation::RangeLost));
    bench.range = Range::Works;
    bench.run(10.0);
    assert_eq!(bench.guard.report().fallback, Fallback::Land);
    assert_eq!(bench.guard.report().cause, cause);
    bench.mode = FlightMode::Disarmed;
    bench.expect_nothing(0.1);
}

#[test]
fn a_burst_of_inertial_outliers_is_data_lost() {
    let mut bench = Bench::flying();
    bench.acceleration = Vector3::repeat(30.0 * GRAVITY_M_S2);
    bench.expect(Violation::ImuLost, Fallback::Descend, 0.1, 0.11);
}

/// A landing without range whose estimate nothing has corrected for this long, s.
fn blind_landing(uncorrected_s: f64) -> Bench {
    let mut bench = Bench::hovering();
    bench.mode = FlightMode::Landing;
    bench.range = Range::Silent;
    bench.spoil = Box::new(move |state| {
        state.health = EstimateHealth::Degraded {
            since_velocity_s: uncorrected_s,
            since_height_s: uncorrected_s,
        };
    });
    bench
}

#[test]
fn a_landing_that_sees_nothing_becomes_a_descent() {
    let mut bench = blind_landing(0.5);
    bench.expect(Violation::RangeLost, Fallback::Descend, 0.8, 1.0);
}

#[test]
fn a_landing_that_the_ground_carries_is_left_to_end() {
    let mut bench = blind_landing(0.5);
    bench.requested = thrust(0.7 * HOVER_N);
    bench.expect_nothing(3.0);
}

#[test]
fn a_landing_that_the_ground_carries_and_that_does_not_end_is_taken_over() {
    let mut bench = blind_landing(2.0);
    bench.requested = thrust(0.7 * HOVER_N);
    bench.expect(Violation::RangeLost, Fallback::Descend, 0.6, 1.0);
}

#[test]
fn inertial_data_that_repeat_to_the_last_bit_are_lost() {
    let mut bench = Bench::hovering();
    bench.imu_stuck = true;
    bench.expect(Violation::ImuLost, Fallback::Descend, 0.1, 0.11);
}

#[test]
fn inertial_data_that_jump_most_of_the_time_are_lost() {
    let mut bench = Bench::hovering();
    bench.imu_jump_m_s2 = 20.0;
    bench.expect(Violation::ImuLost, Fallback::Descend, 0.1, 0.2);
}

#[test]
fn the_descent_begins_with_a_brake_when_the_velocity_was_known() {
    let mut bench = Bench::flying();
    bench.velocity.x = 2.0;
    bench.run(2.0);
    bench.imu_works = false;
    bench.seconds_until(Fallback::Descend, 1.0).unwrap();
    let pitch_rad = |bench: &Bench| match bench.guard.command() {
        Command::AttitudeThrust { pitch_rad, .. } => pitch_rad,
        _ => f64::NAN,
    };
    // Forward motion is braked with the nose up.
    assert!((pitch_rad(&bench) + 15.0_f64.to_radians()).abs() < 1e-9);
    bench.run(1.0);
    assert_eq!(pitch_rad(&bench), 0.0);
}
