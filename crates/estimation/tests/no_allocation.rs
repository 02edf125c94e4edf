//! After construction the estimators ask the system for no memory.

#![allow(clippy::unwrap_used)]

#[path = "../../../tests/allocations.rs"]
mod allocations;
mod support;

use allocations::allocations;
use alula_estimation::eskf::Variant;
use alula_estimation::{
    ESTIMATOR_NAMES, Estimator, EstimatorConfig, FlowOdometry, FlowOdometryConfig, SensorSet,
    by_name,
};
use alula_geometry::{Pose, TimeDelta};
use alula_messages::{FlightMode, PoseSample, SensorBatch};
use nalgebra::Translation3;
use support::{Flight, LEGS_LAND_S, calibration, config};

/// Batches and modes of a flight with take-off, curves and landing.
fn batches() -> Vec<(SensorBatch, FlightMode)> {
    let mut flight = Flight::new(3, 14.0);
    let mut batches = Vec::new();
    let mut batch = SensorBatch::default();
    loop {
        let t = flight.step(&mut batch);
        if t > 15.0 {
            return batches;
        }
        batches.push((batch.clone(), flight.mode(t)));
    }
}

/// Allocations over the flight, the first update included.
fn found(config: &FlowOdometryConfig, batches: &[(SensorBatch, FlightMode)]) -> usize {
    let mut odometry = FlowOdometry::new(config, &calibration()).unwrap();
    allocations(|| {
        for (batch, mode) in batches {
            odometry.update(batch, *mode);
        }
    })
}

#[test]
fn a_flight_allocates_nothing_whatever_the_variant_and_the_sensors() {
    let batches = batches();
    for sensors in [SensorSet::FlowAndInfrared, SensorSet::VelocityAndSonar] {
        for variant in Variant::all() {
            let config = FlowOdometryConfig {
                variant,
                sensors,
                ..config()
            };
            assert_eq!(found(&config, &batches), 0, "{variant} {sensors:?}");
        }
    }
}

/// From the first sample to after the landing.
#[test]
fn no_estimator_allocates_after_construction() {
    for name in ESTIMATOR_NAMES {
        let mut flight = Flight::legs(1);
        let config = EstimatorConfig::default();
        let mut estimator = by_name(name, &config, Some(&calibration())).unwrap();
        let mut batch = SensorBatch::default();
        let mut found = 0;
        for i in 1.. {
            let t = flight.step(&mut batch);
            if t > LEGS_LAND_S + 1.0 {
                break;
            }
            let time = batch.now - TimeDelta::from_s(0.1);
            if i % 25 == 0 && t > 0.2 {
                let truth = flight.truth(time.as_s());
                let place = Translation3::from(truth.position_world);
                batch.poses.push(PoseSample {
                    time,
                    sensor: 0,
                    world_from_body: Pose::from_parts(place, truth.world_from_body),
                });
            }
            let mode = flight.mode(t);
            found += allocations(|| {
                estimator.update(&batch, mode);
            });
        }
        assert_eq!(found, 0, "{name}");
    }
}
