//! What every estimator does when its data are not a number, late, from the wrong time, or missing:
//! it recovers, or says that it cannot, and its numbers stay finite.

#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use alula_estimation::{ESTIMATOR_NAMES, Estimator, EstimatorConfig, by_name};
use alula_geometry::{Pose, TimeDelta, Timestamp};
use alula_messages::{EstimateHealth, FlightMode, PoseSample, SensorBatch, error_index};
use nalgebra::{Translation3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use support::{Flight, LEGS_LAND_S, STAND_HEIGHT_M, TAKE_OFF_S, UP_S, calibration};

/// Claimed standard deviations of velocity within which its error must be while the health is good
/// or degraded. On each of three axes, in a few thousand correlated states of each of some dozens of
/// flights, a Gauss would not leave six.
const WITHIN_SIGMA: f64 = 6.0;

fn build(name: &str) -> Box<dyn Estimator> {
    let mut config = EstimatorConfig::default();
    for alignment in [
        &mut config.flow_odometry.alignment,
        &mut config.cascade.alignment,
    ] {
        alignment.start_position_m = [0.0, 0.0, STAND_HEIGHT_M];
    }
    by_name(name, &config, Some(&calibration())).unwrap()
}

fn all() -> impl Iterator<Item = &'static str> {
    ESTIMATOR_NAMES.into_iter()
}

/// The next 4 ms of a flight, with an exact pose at 10 Hz that comes 0.1 s late.
fn step(flight: &mut Flight, batch: &mut SensorBatch) -> f64 {
    let t = flight.step(batch);
    let time = batch.now - TimeDelta::from_s(0.1);
    if (t * 250.0).round() % 25.0 == 0.0 && time > Timestamp::ZERO {
        let truth = flight.truth(time.as_s());
        batch.poses.push(PoseSample {
            time,
            sensor: 0,
            world_from_body: Pose::from_parts(
                Translation3::from(truth.position_world),
                truth.world_from_body,
            ),
        });
    }
    t
}

/// Whatever happens, what is published is finite and its variances are positive.
fn check_sound(name: &str, t: f64, estimator: &dyn Estimator) {
    let state = estimator.state();
    assert!(state.is_finite(), "{name} at {t}");
    assert!(
        state.covariance.iter().all(|x| x.is_finite()),
        "{name} at {t}"
    );
    let diagonal = state.covariance.diagonal();
    assert!(
        diagonal.iter().all(|x| *x >= 0.0),
        "{name} at {t}: {diagonal}"
    );
}

fn is_usable(health: EstimateHealth) -> bool {
    matches!(
        health,
        EstimateHealth::Good | EstimateHealth::Degraded { .. }
    )
}

/// Flies the legs with what `spoil` does to the data. As long as the estimator does not say that it
/// failed, the truth must be within its claims. Gives the health at the end of the flight.
fn fly(name: &str, seed: u64, mut spoil: impl FnMut(f64, &mut SensorBatch)) -> EstimateHealth {
    let mut flight = Flight::legs(seed);
    let mut estimator = build(name);
    let mut batch = SensorBatch::default();
    loop {
        let t = step(&mut flight, &mut batch);
        if t > LEGS_LAND_S - 4.5 {
            return estimator.state().health;
        }
        spoil(t, &mut batch);
        estimator.update(&batch, flight.mode(t));
        check_sound(name, t, estimator.as_ref());
        let state = estimator.state();
        if t > UP_S && is_usable(state.health) {
            let error = state.velocity_world - flight.truth(state.time.as_s()).velocity_world;
            let claimed = state.sigma(error_index::VELOCITY);
            let ratio = error.component_div(&claimed).amax();
            assert!(
                ratio < WITHIN_SIGMA,
                "{name} at {t}: {error} claimed {claimed}"
            );
        }
    }
}

/// Numbers that are not numbers, everywhere, one sample in twenty.
#[test]
fn scattered_nan_does_no_harm() {
    for name in all() {
        let mut rng = Pcg64::seed_from_u64(1);
        let health = fly(name, 1, |_, batch| {
            let mut hit = || rng.random_range(0..20) == 0;
            let nan = Vector3::repeat(f64::NAN);
            for sample in &mut batch.imu {
                if hit() {
                    sample.specific_force = nan;
                }
                if hit() {
                    sample.angular_rate = nan;
                }
            }
            for sample in &mut batch.flow {
                if hit() {
                    sample.flow_rad_s = Vector2::repeat(f64::NAN);
                }
            }
            for sample in batch.infrared.iter_mut().chain(&mut batch.sonar) {
                if hit() {
                    sample.range_m = f64::NAN;
                }
            }
            for sample in &mut batch.poses {
                if hit() {
                    sample.world_from_body.translation.vector = nan;
                }
            }
        });
        assert_eq!(health, EstimateHealth::Good, "{name}");
    }
}

/// All that corrects falls silent for three seconds.
#[test]
fn silence_of_what_corrects_is_admitted_and_got_over() {
    for name in all() {
        let mut silent = false;
        let health = fly(name, 2, |t, batch| {
            if (12.0..15.0).contains(&t) {
                silent = true;
                batch.flow.clear();
                batch.infrared.clear();
                batch.sonar.clear();
                batch.poses.clear();
            }
        });
        assert!(silent);
        assert_eq!(health, EstimateHealth::Good, "{name}");
    }
}

/// A second without inertial data: what was integrated is lost. With poses it starts anew, without
/// it says that it cannot go on.
#[test]
fn silence_of_the_inertial_unit_is_got_over_or_admitted() {
    for name in all() {
        let health = fly(name, 3, |t, batch| {
            if (12.0..13.0).contains(&t) {
                batch.imu.clear();
            }
        });
        let expected = if name == "pose-imu" {
            EstimateHealth::Good
        } else {
            EstimateHealth::Failed
        };
        assert_eq!(health, expected, "{name}");
    }
}

/// Single stamps that are far away, in both directions.
#[test]
fn samples_from_another_time_do_no_harm() {
    for name in all() {
        let mut rng = Pcg64::seed_from_u64(4);
        fly(name, 4, |t, batch| {
            if t < TAKE_OFF_S {
                return;
            }
            let mut shifted = |time: &mut Timestamp| {
                if rng.random_range(0..30) == 0 {
                    *time += TimeDelta::from_s(rng.random_range(-5.0..-0.5));
                } else if rng.random_range(0..30) == 0 {
                    *time += TimeDelta::from_s(rng.random_range(0.5..1e6));
                }
            };
            batch.flow.iter_mut().for_each(|s| shifted(&mut s.time));
            batch.infrared.iter_mut().for_each(|s| shifted(&mut s.time));
            batch.poses.iter_mut().for_each(|s| shifted(&mut s.time));
        });
    }
}

/// The clock of everything jumps, forward or back, in flight. Nobody can know where the vehicle is
/// now: an estimator may start anew from poses, or must say that it failed.
#[test]
fn a_jump_of_the_clock_is_got_over_or_admitted() {
    for name in all() {
        for jump_s in [-5.0, 30.0] {
            let mut flight = Flight::legs(5);
            let mut estimator = build(name);
            let mut batch = SensorBatch::default();
            loop {
                let t = step(&mut flight, &mut batch);
                if t > 20.0 {
                    break;
                }
                if t > 12.0 {
                    shift(&mut batch, TimeDelta::from_s(jump_s));
                }
                estimator.update(&batch, flight.mode(t));
                check_sound(name, t, estimator.as_ref());
            }
            let health = estimator.state().health;
            let usable = is_usable(health);
            assert!(
                usable == (name == "pose-imu"),
                "{name} {jump_s}: {health:?}"
            );
        }
    }
}

fn shift(batch: &mut SensorBatch, by: TimeDelta) {
    batch.now += by;
    batch.imu.iter_mut().for_each(|s| s.time += by);
    batch.flow.iter_mut().for_each(|s| s.time += by);
    batch.infrared.iter_mut().for_each(|s| s.time += by);
    batch.poses.iter_mut().for_each(|s| s.time += by);
}

/// Batches of anything at all, with anything for a mode.
#[test]
fn nonsense_is_survived() {
    let modes = FlightMode::ALL;
    for name in all() {
        for seed in 0..5 {
            let mut rng = Pcg64::seed_from_u64(seed);
            let mut flight = Flight::legs(seed);
            let mut estimator = build(name);
            let mut batch = SensorBatch::default();
            for _ in 0..3000 {
                let t = step(&mut flight, &mut batch);
                let scale = [0.0, 1.0, -1.0, 1e3, 1e300, f64::INFINITY, f64::NAN];
                let mut wild = || match rng.random_range(0..40) {
                    i @ 0..7 => scale[i],
                    _ => 1.0,
                };
                for sample in &mut batch.imu {
                    sample.specific_force *= wild();
                    sample.angular_rate *= wild();
                }
                for sample in &mut batch.flow {
                    sample.flow_rad_s *= wild();
                    sample.interval_s *= wild();
                    sample.quality *= wild();
                }
                for sample in &mut batch.infrared {
                    sample.range_m *= wild();
                }
                for sample in &mut batch.poses {
                    sample.world_from_body.translation.vector *= wild();
                }
                let mode = modes[rng.random_range(0..modes.len())];
                estimator.update(&batch, mode);
                check_sound(name, t, estimator.as_ref());
            }
        }
    }
}

#[test]
fn what_is_not_observed_is_named() {
    for name in all() {
        let mut flight = Flight::legs(6);
        let mut estimator = build(name);
        let mut batch = SensorBatch::default();
        assert_eq!(estimator.unobserved().names().count(), 5, "{name}");
        while step(&mut flight, &mut batch) < UP_S + 1.0 {
            estimator.update(&batch, flight.mode(batch.now.as_s()));
        }
        let named: Vec<&str> = estimator.unobserved().names().collect();
        let expected: &[&str] = match name {
            "pose-imu" => &[],
            _ => &["horizontal_position", "yaw", "level_accelerometer_bias"],
        };
        assert_eq!(named, expected, "{name}");
    }
}
