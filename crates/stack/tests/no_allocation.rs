//! In flight the stack asks the system for no memory.

// An allocator is unsafe by its signature; this one counts and passes every call on.
#![allow(unsafe_code)]
// A flight without take-off should stop the test.
#![allow(clippy::unwrap_used)]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use alula_messages::{Fallback, FlightMode};
use support::{AMONG_PEOPLE, RATE_HZ, Step, flight, fly, replay, replayed};

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

/// Allocations on this thread while `work` is done.
fn allocations(work: impl FnOnce()) -> usize {
    let before = ALLOCATIONS.get();
    work();
    ALLOCATIONS.get() - before
}

fn is_airborne(mode: FlightMode) -> bool {
    !matches!(mode, FlightMode::Disarmed | FlightMode::Armed)
}

/// The step at which the vehicle has left the ground.
fn take_off(steps: &[Step]) -> usize {
    let climbing = |step: &Step| step.output.mode == FlightMode::TakingOff;
    steps.iter().position(climbing).unwrap() + 1
}

#[test]
fn the_allocator_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))), 1);
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
        if step.intent.is_none() && before == after && is_airborne(after) {
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
