//! In flight the stack asks the system for no memory.

// A flight without take-off should stop the test.
#![allow(clippy::unwrap_used)]

#[path = "../../../tests/allocations.rs"]
mod allocations;
mod support;

use allocations::allocations;
use alula_messages::{Fallback, FlightMode};
use support::{AMONG_PEOPLE, RATE_HZ, Step, flight, fly, replay, replayed};

/// The step at which the vehicle has left the ground.
fn take_off(steps: &[Step]) -> usize {
    let climbing = |step: &Step| step.output.mode == FlightMode::TakingOff;
    steps.iter().position(climbing).unwrap() + 1
}

/// A change of mode plans a trajectory, and so does a request; nothing else may allocate.
#[test]
fn from_take_off_to_touch_down_only_planning_allocates() {
    let steps = flight();
    let start = take_off(&steps);
    let mut stack = replayed(&steps, start);
    let mut quiet_steps = 0;
    for step in &steps[start..] {
        let before = stack.output().mode;
        let found = allocations(|| replay(&mut stack, step));
        let after = stack.output().mode;
        if step.intent.is_none() && before == after && after.is_airborne() {
            assert_eq!(found, 0, "{after:?} at {}", stack.output().time);
            quiet_steps += 1;
        }
    }
    // Requests and changes of mode are few.
    assert!(quiet_steps > (steps.len() - start) * 9 / 10);
}

/// The guard finds more and more while the sensors fall silent, and its report allocates nothing.
#[test]
fn a_guard_that_acts_allocates_nothing() {
    let mut steps = flight();
    let start = support::first_step_of_waypoints(&steps) + support::RATE_HZ;
    let mut stack = replayed(&steps, start);
    let mut gravest = Fallback::None;
    for step in &mut steps[start..start + 8 * support::RATE_HZ] {
        step.batch.flow.clear();
        step.batch.infrared.clear();
        step.batch.autopilot.clear();
        let before = stack.output().mode;
        let found = allocations(|| replay(&mut stack, step));
        let output = stack.output();
        if before == output.mode {
            assert_eq!(found, 0, "{:?} at {}", output.guard, output.time);
        }
        gravest = gravest.max(output.guard.fallback);
    }
    assert!(gravest >= Fallback::Land);
}

/// From images to plans: once every part has met what it has to keep, nothing asks for memory.
#[test]
fn flight_among_obstacles_allocates_nothing_once_it_is_warm() {
    const WARM_UP: usize = 2 * RATE_HZ;
    let (mut on_the_way, mut images, mut plans) = (0, 0, 0);
    fly(AMONG_PEOPLE, |stack, batch| {
        let before = stack.output().mode;
        let found = allocations(|| {
            stack.update(batch);
        });
        let output = stack.output();
        if before != FlightMode::Flying || output.mode != before {
            return;
        }
        on_the_way += 1;
        if on_the_way > WARM_UP {
            assert_eq!(found, 0, "at {}", output.time);
            images += usize::from(output.seen_at.is_some());
            plans += usize::from(output.plan.is_some());
        }
    });
    // Two seconds of images at 15 Hz and of plans every 60 ms at the least.
    assert!(
        images >= 30 && plans >= 30,
        "{images} images, {plans} plans"
    );
}
