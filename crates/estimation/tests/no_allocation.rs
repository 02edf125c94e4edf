//! After construction the estimators ask the system for no memory.

// An allocator is unsafe by its signature; this one counts and passes every call on.
#![allow(unsafe_code)]
#![allow(clippy::unwrap_used)]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use alula_estimation::eskf::Variant;
use alula_estimation::{Estimator, FlowOdometry, FlowOdometryConfig, SensorSet};
use alula_messages::{FlightMode, SensorBatch};
use support::{Flight, calibration, config};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        unsafe { System.realloc(old, layout, new_size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        unsafe { System.dealloc(old, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

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
fn allocations(config: &FlowOdometryConfig, batches: &[(SensorBatch, FlightMode)]) -> usize {
    let mut odometry = FlowOdometry::new(config, &calibration()).unwrap();
    let before = ALLOCATIONS.get();
    for (batch, mode) in batches {
        odometry.update(batch, *mode);
    }
    ALLOCATIONS.get() - before
}

#[test]
fn the_allocator_counts() {
    let before = ALLOCATIONS.get();
    let grown: Vec<u8> = Vec::with_capacity(8);
    assert_eq!(ALLOCATIONS.get() - before, 1);
    drop(grown);
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
            assert_eq!(allocations(&config, &batches), 0, "{variant} {sensors:?}");
        }
    }
}
