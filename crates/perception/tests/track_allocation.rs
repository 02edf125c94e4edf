//! Tracking asks the system for no memory.

#[path = "../../../tests/allocations.rs"]
mod allocations;
mod track_support;

use allocations::allocations;
use alula_messages::Footprint;
use alula_perception::{SeenSpace, SeenSpaceConfig, Tracker, TrackerConfig};
use nalgebra::Vector3;
use track_support::*;

/// More detections than tracks fit in, round and flat, over a second; then the memory of space.
#[test]
fn nothing_is_allocated_after_construction() {
    let config = TrackerConfig {
        max_tracks: 20,
        max_detections: 30,
        ..TrackerConfig::default()
    };
    let mut tracker = Tracker::new(&config).unwrap();
    let mut space = SeenSpace::new(&SeenSpaceConfig::default()).unwrap();
    let (mut random, camera) = (random(1), at_origin());
    let mut count = 0;
    for image in 0..30 {
        let shift = 0.02 * image as f64;
        let people: Vec<_> = (0..40)
            .map(|i| cylinder(2.0 + 0.3 * f64::from(i % 8), f64::from(i / 8) - 2.0 + shift))
            .collect();
        let mut seen = detections(&camera, &people, &[], &mut random);
        while seen.len() < 40 {
            let mut more = seen[seen.len() - 5];
            more.centre_world += Vector3::new(0.4, 0.3, 0.0);
            more.footprint = Footprint::Flat;
            seen.push(more);
        }
        let contour = contour(&camera, stamp(image), &people, &[]);
        count += allocations(|| {
            tracker.update(stamp(image), &seen, &contour, &camera.position());
            space.update(&contour);
            space.mark_here(&camera.position(), 0.4, stamp(image));
        });
    }
    assert!(tracker.obstacles().len() > 10);
    assert_eq!(count, 0);
}
