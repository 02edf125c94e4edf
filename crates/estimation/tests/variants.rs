//! Every variant of the flow odometry, and both sensor sets, on synthetic flights.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use alula_estimation::eskf::Variant;
use alula_estimation::{Estimator, FlowOdometry, FlowOdometryConfig, SensorSet};
use alula_geometry::TimeDelta;
use alula_messages::{EstimateHealth, FlightMode, Rejection, Sensor, SensorBatch};
use nalgebra::{Vector2, Vector3};
use support::{Flight, calibration, config};

/// Errors at the end of a flight, and how many sonar readings were outliers.
struct Flown {
    position_m: f64,
    height_m: f64,
    tilt_rad: f64,
    health: EstimateHealth,
    outliers: usize,
    corrections: usize,
}

/// A flight as its sensors saw it, so that all variants fly the same.
struct Recorded {
    flight: Flight,
    steps: Vec<(f64, SensorBatch)>,
}

fn recorded(seed: u64, end_s: f64) -> Recorded {
    let mut flight = Flight::new(seed, 60.0);
    let mut steps = Vec::new();
    let mut batch = SensorBatch::default();
    loop {
        let t = flight.step(&mut batch);
        if t > end_s {
            return Recorded { flight, steps };
        }
        steps.push((t, batch.clone()));
    }
}

fn fly(
    config: &FlowOdometryConfig,
    recorded: &Recorded,
    mut spoil: impl FnMut(f64, &mut SensorBatch),
) -> Flown {
    let mut odometry = FlowOdometry::new(config, &calibration()).unwrap();
    let (mut outliers, mut corrections) = (0, 0);
    for (t, batch) in &recorded.steps {
        let mut batch = batch.clone();
        spoil(*t, &mut batch);
        odometry.update(&batch, recorded.flight.mode(*t));
        for fusion in odometry.fusions() {
            outliers += usize::from(fusion.rejection == Some(Rejection::Outlier));
            corrections += usize::from(fusion.sensor != Sensor::Ground && fusion.accepted());
        }
    }
    let state = odometry.state();
    let truth = recorded.flight.truth(state.time.as_s());
    let error = state.position_world() - truth.position_world;
    let up = |q: nalgebra::UnitQuaternion<f64>| q.inverse() * Vector3::z();
    Flown {
        position_m: error.xy().norm(),
        height_m: error.z.abs(),
        tilt_rad: up(state.world_from_body.rotation).angle(&up(truth.world_from_body)),
        health: state.health,
        outliers,
        corrections,
    }
}

fn unspoilt(_: f64, _: &mut SensorBatch) {}

fn with(variant: Variant, sensors: SensorSet) -> FlowOdometryConfig {
    FlowOdometryConfig {
        variant,
        sensors,
        ..config()
    }
}

/// A flight of 20 s. Samples are means over the interval before them, which Q0F takes a
/// period too late: in curves of up to 2 rad/s that is 8 mrad.
fn check_all(sensors: SensorSet, height_m: f64) {
    let mut positions = Vec::new();
    let recorded = recorded(4, 20.0);
    for variant in Variant::all() {
        let flown = fly(&with(variant, sensors), &recorded, unspoilt);
        assert!(flown.position_m < 0.5, "{variant}: {}", flown.position_m);
        assert!(flown.height_m < height_m, "{variant}: {}", flown.height_m);
        assert!(flown.tilt_rad < 0.02, "{variant}: {}", flown.tilt_rad);
        assert_eq!(flown.health, EstimateHealth::Good, "{variant}");
        assert!(flown.corrections > 1000);
        positions.push(flown.position_m);
    }
    let greatest = positions.iter().fold(0.0_f64, |a, b| a.max(*b));
    println!("{sensors:?}: greatest error of position {greatest:.3} m");
}

/// Three standard deviations of the filter's own height are 3 cm.
#[test]
fn every_variant_flies_with_flow_and_infrared() {
    check_all(SensorSet::FlowAndInfrared, 0.03);
}

/// The sonar's noise is 5 cm at 15 Hz.
#[test]
fn every_variant_flies_with_velocity_and_sonar() {
    check_all(SensorSet::VelocityAndSonar, 0.1);
}

/// Document S, figure 2.9: wrong echoes; the flow then uses the height of the state.
#[test]
fn wrong_echoes_of_the_sonar_are_found_and_do_little_harm() {
    let sonar = with(Variant::default(), SensorSet::VelocityAndSonar);
    let mut count = 0;
    let mut wrong = 0;
    let flown = fly(&sonar, &recorded(4, 30.0), |t, batch| {
        for sample in &mut batch.sonar {
            count += 1;
            // Bursts of three readings every two seconds.
            if t > 10.0 && count % 30 < 3 {
                sample.range_m += 1.0;
                wrong += 1;
            }
        }
    });
    assert!(wrong > 20);
    assert!(
        flown.outliers * 10 >= wrong * 9,
        "{} of {wrong}",
        flown.outliers
    );
    assert!(flown.height_m < 0.1 && flown.position_m < 0.5);
    assert_eq!(flown.health, EstimateHealth::Good);
}

#[test]
fn without_sonar_the_flow_still_corrects_the_velocity() {
    let sonar = with(Variant::default(), SensorSet::VelocityAndSonar);
    let flown = fly(&sonar, &recorded(4, 20.0), |t, batch| {
        if t > 10.0 {
            batch.sonar.clear();
        }
    });
    assert!(flown.position_m < 0.5, "{}", flown.position_m);
    let EstimateHealth::Degraded {
        since_velocity_s,
        since_height_s,
    } = flown.health
    else {
        panic!("the height is not observed: {:?}", flown.health);
    };
    assert!(since_velocity_s < 0.1 && since_height_s > 9.0);
}

/// Nonsense of all kinds for a second; afterwards the estimate is finite and fuses again.
#[test]
fn every_variant_survives_nonsense() {
    let recorded = recorded(4, 15.0);
    for sensors in [SensorSet::FlowAndInfrared, SensorSet::VelocityAndSonar] {
        for variant in Variant::all() {
            let flown = fly(&with(variant, sensors), &recorded, |t, batch| {
                if (10.0..11.0).contains(&t) {
                    spoil_all(batch, (t * 250.0) as u64);
                }
            });
            assert!(flown.position_m < 5.0, "{variant}: {}", flown.position_m);
            assert!(flown.tilt_rad < 0.1, "{variant}: {}", flown.tilt_rad);
            assert_eq!(flown.health, EstimateHealth::Good, "{variant}");
        }
    }
}

fn spoil_all(batch: &mut SensorBatch, step: u64) {
    let nonsense = [f64::NAN, f64::INFINITY, -1e9, 1e30][(step % 4) as usize];
    for flow in &mut batch.flow {
        flow.flow_rad_s = Vector2::repeat(nonsense);
    }
    for range in batch.infrared.iter_mut().chain(&mut batch.sonar) {
        range.range_m = nonsense;
        range.time += TimeDelta::from_s(if step.is_multiple_of(2) { 5.0 } else { -5.0 });
    }
    if step.is_multiple_of(7) {
        for imu in &mut batch.imu {
            imu.angular_rate.x = nonsense;
            imu.specific_force.z = nonsense;
        }
    }
}

/// Silence is told.
#[test]
fn silence_of_the_inertial_unit_is_a_failure_of_every_variant() {
    let recorded = recorded(1, 8.0);
    for variant in Variant::all() {
        let config = with(variant, SensorSet::default());
        let mut odometry = FlowOdometry::new(&config, &calibration()).unwrap();
        let mut batch = SensorBatch::default();
        for (_, sensed) in &recorded.steps {
            batch.clone_from(sensed);
            odometry.update(&batch, FlightMode::Flying);
        }
        batch.clear();
        batch.now += TimeDelta::from_s(2.0);
        odometry.update(&batch, FlightMode::Flying);
        assert_eq!(odometry.state().health, EstimateHealth::Failed, "{variant}");
    }
}
