//! Time of tracking and of the memory of free space for one image. The budget of tracking is
//! 100 us at 10 detections, that of the memory 20 us at 96 rays.

// A benchmark that cannot start should stop.
#![allow(clippy::expect_used)]

#[path = "../tests/track_support/mod.rs"]
mod track_support;

use alula_messages::Detection;
use alula_perception::{Contour, SeenSpace, SeenSpaceConfig, Tracker, TrackerConfig};
use divan::{Bencher, black_box};
use track_support::*;

const IMAGES: usize = 300;

fn main() {
    divan::main();
}

/// Images of people who walk to and fro in rows of sixteen; a detector that looks through them.
fn images(count: usize) -> Vec<(Vec<Detection>, Contour)> {
    let (mut random, camera) = (random(1), at_origin());
    let image = |i: usize| {
        let sway = 0.2 * (0.1 * i as f64).sin();
        let person = |k: usize| Cylinder {
            radius_m: 0.1,
            ..cylinder(
                2.5 + 0.6 * (k / 16) as f64,
                0.28 * (k % 16) as f64 - 2.1 + sway,
            )
        };
        let people: Vec<_> = (0..count).map(person).collect();
        let seen = people
            .iter()
            .flat_map(|&one| detections(&camera, &[one], &[], &mut random))
            .collect();
        (seen, contour(&camera, stamp(i), &people, &[]))
    };
    (0..IMAGES).map(image).collect()
}

#[divan::bench(args = [2, 10, 64], sample_count = 1000, sample_size = 1)]
fn tracking(bencher: Bencher, detections: usize) {
    let images = images(detections);
    let here = at_origin().position();
    let mut tracker = Tracker::new(&TrackerConfig::default()).expect("defaults are valid");
    let mut image = 0;
    bencher.bench_local(|| {
        image += 1;
        let (seen, contour) = &images[image % IMAGES];
        black_box(tracker.update(stamp(image), seen, contour, &here).len())
    });
}

#[divan::bench(sample_count = 1000, sample_size = 1)]
fn seen_space(bencher: Bencher) {
    let images = images(10);
    let mut space = SeenSpace::new(&SeenSpaceConfig::default()).expect("defaults are valid");
    let mut image = 0;
    bencher.bench_local(|| {
        image += 1;
        let mut contour = images[image % IMAGES].1.clone();
        contour.time = stamp(image);
        space.update(black_box(&contour));
    });
}
