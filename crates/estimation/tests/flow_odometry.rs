//! The flow odometry on synthetic flights: accuracy, consistency, and what it does when sensors
//! fail.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use alula_estimation::eskf::Nominal;
use alula_estimation::metrics::{anees_band, nees_of};
use alula_estimation::{Estimator, FlowOdometry};
use alula_geometry::{TimeDelta, Timestamp};
use alula_messages::{
    EstimateHealth, FlightMode, FlightPhase, NavState, Rejection, Sensor, SensorBatch, error_index,
};
use nalgebra::Vector3;
use support::{Flight, calibration, config};

fn odometry() -> FlowOdometry {
    FlowOdometry::new(&config(), &calibration()).unwrap()
}

fn nominal(state: &NavState) -> Nominal {
    Nominal {
        position_world: state.position_world(),
        velocity_world: state.velocity_world,
        world_from_body: state.world_from_body.rotation,
        accelerometer_bias: state.accelerometer_bias,
        gyroscope_bias: state.gyroscope_bias,
    }
}

fn true_nominal(flight: &Flight, t: f64) -> Nominal {
    let truth = flight.truth(t);
    Nominal {
        position_world: truth.position_world,
        velocity_world: truth.velocity_world,
        world_from_body: truth.world_from_body,
        accelerometer_bias: flight.accelerometer_bias(),
        gyroscope_bias: flight.gyroscope_bias(),
    }
}

/// Flies until `end_s`; `spoil` may change each batch, `look` sees the estimate after it.
fn fly(
    flight: &mut Flight,
    end_s: f64,
    spoil: impl FnMut(f64, &mut SensorBatch),
    look: impl FnMut(f64, &Flight, &FlowOdometry),
) -> FlowOdometry {
    fly_with(odometry(), flight, end_s, spoil, look)
}

/// The same with a given odometry.
fn fly_with(
    mut odometry: FlowOdometry,
    flight: &mut Flight,
    end_s: f64,
    mut spoil: impl FnMut(f64, &mut SensorBatch),
    mut look: impl FnMut(f64, &Flight, &FlowOdometry),
) -> FlowOdometry {
    let mut batch = SensorBatch::default();
    loop {
        let t = flight.step(&mut batch);
        if t > end_s {
            return odometry;
        }
        spoil(t, &mut batch);
        odometry.update(&batch, flight.mode(t));
        look(t, flight, &odometry);
    }
}

fn no_change(_: f64, _: &mut SensorBatch) {}

fn no_look(_: f64, _: &Flight, _: &FlowOdometry) {}

fn position_error(flight: &Flight, odometry: &FlowOdometry, t: f64) -> Vector3<f64> {
    odometry.state().position_world() - flight.truth(t).position_world
}

/// Without noise what remains is integration: alignment leaves the bias in tilt, the flow's mean
/// over 12 ms differs from its middle, F1 and the held input from the exact motion.
#[test]
fn without_noise_a_flight_ends_where_it_does() {
    let mut flight = Flight::new(1, 40.0);
    flight.noise = false;
    let odometry = fly(&mut flight, 41.0, no_change, no_look);
    let error = position_error(&flight, &odometry, 41.0);
    println!("noise-free final error {:.4} m", error.norm());
    assert!(error.norm() < 0.05, "{error}");
    assert_eq!(odometry.state().health, EstimateHealth::Good);
    assert_eq!(odometry.state().phase, FlightPhase::Landed);
}

/// Rows of height, velocity, roll and pitch: what the sensors observe.
const OBSERVED: [usize; 6] = [2, 3, 4, 5, 6, 7];
/// Rows of the pose, as in document S, equation 2.91.
const POSE: [usize; 6] = [0, 1, 2, 6, 7, 8];

/// 20 seeds; the average over the flight of a consistent filter lies within the band for one time,
/// because averaging over time only narrows it.
#[test]
fn errors_are_as_large_as_the_covariance_says() {
    const RUNS: u32 = 20;
    let mut sums = [0.0; 2];
    let mut count = 0.0;
    for seed in 0..u64::from(RUNS) {
        let mut next = 8.0;
        fly(
            &mut Flight::new(seed, 30.0),
            26.0,
            no_change,
            |t, flight, odometry| {
                if t >= next {
                    next += 0.5;
                    let state = odometry.state();
                    let error = nominal(state).error_to(&true_nominal(flight, t));
                    for (sum, rows) in sums.iter_mut().zip([OBSERVED, POSE]) {
                        *sum += nees_of(&error, &state.covariance, rows).unwrap();
                    }
                    count += 1.0;
                }
            },
        );
    }
    let band = anees_band(6, RUNS, 0.999);
    let (observed, pose) = (sums[0] / count, sums[1] / count);
    println!("ANEES of 6: observed {observed:.2}, pose {pose:.2}, band {band:?}");
    assert!(
        (band.low..band.high).contains(&observed),
        "{observed} {band:?}"
    );
    assert!((band.low..band.high).contains(&pose), "{pose} {band:?}");
}

#[test]
fn a_minute_of_flight_drifts_less_than_half_a_metre() {
    let mut finals: Vec<f64> = (0..10)
        .map(|seed| {
            let mut flight = Flight::new(100 + seed, 60.0);
            let odometry = fly(&mut flight, 61.0, no_change, no_look);
            position_error(&flight, &odometry, 61.0).xy().norm()
        })
        .collect();
    finals.sort_by(f64::total_cmp);
    println!("final horizontal errors {finals:.3?} m");
    assert!(finals[5] < 0.5, "{finals:?}");
}

#[test]
fn the_gyroscope_bias_is_found_on_the_ground_about_all_axes() {
    let mut flight = Flight::new(5, 30.0);
    let odometry = fly(&mut flight, 2.9, no_change, no_look);
    let error = odometry.state().gyroscope_bias - flight.gyroscope_bias();
    let sigma = odometry.state().sigma(error_index::GYROSCOPE_BIAS);
    assert!(sigma.max() < 1e-3, "{sigma}");
    assert!(error.amax() < 4.0 * sigma.max(), "{error}");
}

#[test]
fn after_landing_it_stays_where_it_landed() {
    let mut flight = Flight::new(6, 20.0);
    let mut landed = None;
    let odometry = fly(&mut flight, 60.0, no_change, |t, _, odometry| {
        if t > 21.0 && landed.is_none() {
            landed = Some(odometry.state().position_world());
        }
    });
    let moved = odometry.state().position_world() - landed.unwrap();
    println!("moved {:.4} m on the ground", moved.norm());
    assert!(moved.norm() < 0.01, "{moved}");
}

#[test]
fn the_same_samples_give_the_same_bits() {
    let run = || fly(&mut Flight::new(7, 20.0), 15.0, no_change, no_look);
    assert_eq!(run().state(), run().state());
}

#[test]
fn without_flow_it_degrades_and_recovers() {
    let mut seen = Vec::new();
    let odometry = fly(
        &mut Flight::new(8, 40.0),
        20.0,
        |t, batch| {
            if (10.0..12.0).contains(&t) {
                batch.flow.clear();
            }
        },
        |t, _, odometry| seen.push((t, odometry.state().health)),
    );
    let health_at = |s: f64| seen.iter().find(|(t, _)| *t >= s).unwrap().1;
    assert_eq!(health_at(10.3), EstimateHealth::Good);
    let EstimateHealth::Degraded {
        since_velocity_s,
        since_height_s,
    } = health_at(11.5)
    else {
        panic!("{:?}", health_at(11.5));
    };
    assert!((since_velocity_s - 1.5).abs() < 0.05 && since_height_s < 0.1);
    assert_eq!(odometry.state().health, EstimateHealth::Good);
}

#[test]
fn a_stuck_ranger_is_found_out() {
    let mut stuck = None;
    let mut worst: f64 = 0.0;
    let odometry = fly(
        &mut Flight::new(9, 40.0),
        14.0,
        |t, batch| {
            for sample in &mut batch.infrared {
                if t > 10.0 {
                    sample.range_m = *stuck.get_or_insert(sample.range_m);
                }
            }
        },
        |t, flight, odometry| {
            if t > 10.0 {
                worst = worst.max(position_error(flight, odometry, t).z.abs());
            }
        },
    );
    assert!(matches!(
        odometry.state().health,
        EstimateHealth::Degraded { .. }
    ));
    println!("worst height error {worst:.3} m in 4 s without range");
    assert!(worst < 0.5);
}

/// Over a large table the ground is higher: refused at first, then believed.
#[test]
fn a_lasting_contradiction_is_believed_in_the_end() {
    let mut flight = Flight::new(10, 40.0);
    flight.raised = Some((10.0, 0.6));
    let mut refused = 0;
    let mut degraded = false;
    let odometry = fly(&mut flight, 14.0, no_change, |t, _, odometry| {
        refused += odometry
            .fusions()
            .iter()
            .filter(|f| f.sensor == Sensor::Infrared && f.rejection == Some(Rejection::Gate))
            .count();
        degraded |= t > 10.0 && odometry.state().health != EstimateHealth::Good;
    });
    assert!(refused > 20 && degraded);
    assert_eq!(odometry.state().health, EstimateHealth::Good);
    let above_table = position_error(&flight, &odometry, 14.0).z + 0.6;
    assert!(above_table.abs() < 0.1, "{above_table}");
}

#[test]
fn a_short_burst_of_nonsense_in_the_inertial_data_is_bridged() {
    let mut flight = Flight::new(11, 40.0);
    let mut flip = 1.0;
    let odometry = fly(
        &mut flight,
        14.0,
        |t, batch| {
            for sample in &mut batch.imu {
                if (10.0..10.1).contains(&t) {
                    flip = -flip;
                    sample.specific_force = Vector3::repeat(flip * 80.0);
                    sample.angular_rate.x = f64::NAN;
                }
            }
        },
        |_, _, odometry| assert!(odometry.state().is_finite()),
    );
    assert_eq!(odometry.state().health, EstimateHealth::Good);
    assert!(position_error(&flight, &odometry, 14.0).norm() < 0.5);
}

#[test]
fn inertial_silence_is_a_failure_that_only_the_ground_ends() {
    let mut flight = Flight::new(12, 20.0);
    let mut seen = Vec::new();
    fly(
        &mut flight,
        30.0,
        |t, batch| {
            if (10.0..11.0).contains(&t) {
                batch.imu.clear();
            }
        },
        |t, _, odometry| seen.push((t, odometry.state().health)),
    );
    let health_at = |s: f64| seen.iter().find(|(t, _)| *t >= s).unwrap().1;
    assert_eq!(health_at(10.1), EstimateHealth::Good);
    assert_eq!(health_at(10.3), EstimateHealth::Failed);
    assert_eq!(health_at(15.0), EstimateHealth::Failed);
    assert_eq!(health_at(25.0), EstimateHealth::Good);
}

#[test]
fn time_that_goes_backwards_is_refused_and_survived_on_the_ground() {
    let mut flight = Flight::new(13, 20.0);
    let mut refused = 0;
    let back = TimeDelta::from_s(100.0);
    let odometry = fly(
        &mut flight,
        2.9,
        |t, batch| {
            // The clock of the autopilot is set back once.
            if t > 1.5 {
                batch.now = batch.now - back;
                batch.imu.iter_mut().for_each(|s| s.time = s.time - back);
            }
        },
        |_, _, odometry| {
            refused += odometry
                .fusions()
                .iter()
                .filter(|f| f.sensor == Sensor::Imu && f.rejection == Some(Rejection::OutOfOrder))
                .count();
        },
    );
    assert!(refused > 10);
    assert_eq!(odometry.state().health, EstimateHealth::Good);
    assert!(odometry.state().time < Timestamp::ZERO);
}

#[test]
fn measurements_that_are_not_finite_are_refused_with_that_reason() {
    let mut reasons = Vec::new();
    let odometry = fly(
        &mut Flight::new(14, 40.0),
        12.0,
        |t, batch| {
            if t > 10.0 && t < 11.0 {
                batch
                    .flow
                    .iter_mut()
                    .for_each(|s| s.flow_rad_s.x = f64::NAN);
                batch
                    .infrared
                    .iter_mut()
                    .for_each(|s| s.range_m = f64::INFINITY);
            }
        },
        |t, _, odometry| {
            if t > 10.1 && t < 11.0 {
                reasons.extend(odometry.fusions().iter().map(|f| f.rejection));
            }
        },
    );
    assert!(reasons.len() > 50);
    assert!(reasons.iter().all(|r| *r == Some(Rejection::NotFinite)));
    assert!(odometry.state().is_finite());
}

#[test]
fn an_empty_batch_changes_nothing() {
    let mut odometry = odometry();
    odometry.update(&SensorBatch::default(), FlightMode::Disarmed);
    assert_eq!(odometry.state().health, EstimateHealth::Initialising);
    assert!(odometry.fusions().is_empty());
}
