//! How well people are followed: document L, table 5-1, and the border of the image.

// A helper that finds nothing should stop its test.
#![allow(clippy::unwrap_used)]

mod track_support;

use alula_messages::Sight;
use alula_perception::{Tracker, TrackerConfig};
use nalgebra::Vector2;
use track_support::*;

/// As long as a turn of a right angle with a radius of 0.4 m at 1.2 m/s.
const TURN_S: f64 = 0.52;

fn two_walkers(time_s: f64) -> [(Vector2<f64>, Vector2<f64>); 2] {
    let corners = |list: &[[f64; 2]]| list.iter().map(|&c| Vector2::from(c)).collect::<Vec<_>>();
    let near = corners(&[[2.0, -0.8], [4.0, -2.2], [4.8, -0.4], [3.0, 0.0]]);
    let far = corners(&[[2.5, 0.6], [4.5, 0.4], [4.5, 2.4], [2.8, 2.0]]);
    [walker(&near, time_s), walker(&far, time_s + 1.0)]
}

/// Somebody who turns at corners within [`TURN_S`]: his velocity is the mean over that time of one
/// who turns on the spot.
fn walker(corners: &[Vector2<f64>], time_s: f64) -> (Vector2<f64>, Vector2<f64>) {
    const PARTS: usize = 40;
    let at = |share: f64| on_loop(corners, 1.2, time_s + TURN_S * (share - 0.5)).0;
    let places = (0..PARTS).map(|i| at((i as f64 + 0.5) / PARTS as f64));
    let place = places.sum::<Vector2<f64>>() / PARTS as f64;
    (place, (at(1.0) - at(0.0)) / TURN_S)
}

/// Mean errors of position and velocity over a minute of both walkers.
fn errors(seed: u64) -> (f64, f64) {
    let mut tracker = Tracker::new(&TrackerConfig::default()).unwrap();
    let mut random = random(seed);
    let camera = at_origin();
    let (mut position, mut velocity, mut count) = (0.0, 0.0, 0.0);
    for image in 0..(60.0 * RATE_HZ) as usize {
        let truth = two_walkers(stamp(image).as_s());
        let people = truth.map(|(place, _)| cylinder(place.x, place.y));
        let seen = detections(&camera, &people, &[], &mut random);
        let contour = contour(&camera, stamp(image), &people, &[]);
        let obstacles = tracker.update(stamp(image), &seen, &contour, &camera.position());
        for (place, speed) in truth {
            let found = find(obstacles, &place).filter(|o| o.sight == Sight::Seen);
            if let Some(obstacle) = found {
                position += (obstacle.centre_world.xy() - place).norm();
                velocity += (obstacle.velocity_world.xy() - speed).norm();
                count += 1.0;
            }
        }
    }
    assert!(
        count > 2.0 * 50.0 * RATE_HZ,
        "{count} sightings in a minute of two walkers"
    );
    (position / count, velocity / count)
}

/// Half of the errors of L, table 5-1: 0.26 m and 0.43 m/s.
#[test]
fn errors_are_half_of_those_of_the_source() {
    for seed in 0..5 {
        let (position_m, velocity_m_s) = errors(seed);
        assert!(
            position_m <= 0.13 && velocity_m_s <= 0.22,
            "seed {seed}: {position_m} {velocity_m_s}"
        );
    }
}
