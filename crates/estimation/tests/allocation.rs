//! No estimator asks for memory once it flies.

// An allocator is unsafe by its signature; this one counts and passes every call on.
#![allow(unsafe_code, clippy::unwrap_used)]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use alula_estimation::{ESTIMATOR_NAMES, EstimatorConfig, by_name};
use alula_geometry::{Pose, TimeDelta};
use alula_messages::{PoseSample, SensorBatch};
use nalgebra::Translation3;
use support::{Flight, LEGS_LAND_S, calibration};

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

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        unsafe { System.dealloc(old, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// From the first sample to after the landing.
#[test]
fn no_estimator_allocates_after_construction() {
    for name in ESTIMATOR_NAMES {
        let mut flight = Flight::legs(1);
        let config = EstimatorConfig::default();
        let mut estimator = by_name(name, &config, Some(&calibration())).unwrap();
        let mut batch = SensorBatch::default();
        let mut allocations = 0;
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
            let before = ALLOCATIONS.get();
            estimator.update(&batch, mode);
            allocations += ALLOCATIONS.get() - before;
        }
        assert_eq!(allocations, 0, "{name}");
    }
}
