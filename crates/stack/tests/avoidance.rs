//! The stack among people when its depth images are not what they should be.

// A broken set-up should stop the test.
#![allow(clippy::unwrap_used)]

mod support;

use std::sync::Arc;

use alula_geometry::TimeDelta;
use alula_messages::{Command, DepthImage, FlightMode, SensorBatch};
use support::{AMONG_PEOPLE, fly};

/// The commands of a flight whose stack looks at what `spoil` makes of each batch with images.
fn commands(mut spoil: impl FnMut(FlightMode, &mut SensorBatch)) -> Vec<Command> {
    let mut commands = Vec::new();
    fly(AMONG_PEOPLE, |stack, batch| {
        let mut batch = batch.clone();
        if !batch.depth.is_empty() {
            spoil(stack.output().mode, &mut batch);
        }
        commands.push(stack.update(&batch).command);
    });
    commands
}

/// An image dated ahead shows where nobody knows the vehicle was, and must not make all that follow
/// look late.
#[test]
fn images_dated_ahead_change_nothing() {
    let mut added = 0;
    let spoiled = commands(|mode, batch| {
        if mode == FlightMode::Flying {
            let mut image = DepthImage::clone(&batch.depth[0]);
            image.time = batch.now + TimeDelta::from_s(10.0);
            image.depth_mm.reverse();
            batch.depth.push(Arc::new(image));
            added += 1;
        }
    });
    assert!(added > 100, "{added}");
    assert!(commands(|_, _| {}) == spoiled);
}
