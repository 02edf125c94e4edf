//! Who moves and who stands; walls never move.

// A helper that finds nothing should stop its test.
#![allow(clippy::unwrap_used)]

mod track_support;

use alula_messages::{Detection, Footprint, Obstacle, ObstacleMotion};
use alula_perception::{Contour, Tracker, TrackerConfig};
use nalgebra::{Matrix3, Vector2, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;
use track_support::*;

fn tracker() -> Tracker {
    Tracker::new(&TrackerConfig::default()).unwrap()
}

/// Follows one cylinder; calls `check` with the time and the track of every image.
fn follow(
    seed: u64,
    seconds: f64,
    place: impl Fn(f64) -> Vector2<f64>,
    mut check: impl FnMut(f64, &Obstacle),
) {
    let (mut tracker, mut random, camera) = (tracker(), random(seed), at_origin());
    for image in 0..(seconds * RATE_HZ) as usize {
        let time = stamp(image);
        let at = place(time.as_s());
        let things = [cylinder(at.x, at.y)];
        let seen = detections(&camera, &things, &[], &mut random);
        let contour = contour(&camera, time, &things, &[]);
        let obstacles = tracker.update(time, &seen, &contour, &camera.position());
        check(time.as_s(), &obstacles[0]);
    }
}

/// Ten minutes in all: an alarm a minute would show.
#[test]
fn a_pillar_becomes_static_and_never_moves() {
    for seed in 0..10 {
        follow(
            seed,
            60.0,
            |_| Vector2::new(3.0, 0.7),
            |time_s, obstacle| {
                assert_ne!(
                    obstacle.motion,
                    ObstacleMotion::Moving,
                    "seed {seed}, {time_s} s"
                );
                if time_s > 3.0 {
                    assert_eq!(
                        obstacle.motion,
                        ObstacleMotion::Static,
                        "seed {seed}, {time_s} s"
                    );
                    assert_eq!(obstacle.velocity_world, Vector3::zeros());
                }
            },
        );
    }
}

#[test]
fn a_walker_is_moving_within_half_a_second() {
    for seed in 0..10 {
        follow(
            seed,
            2.0,
            |t| Vector2::new(3.0, -1.2 + 1.2 * t),
            |time_s, obstacle| {
                assert_ne!(
                    obstacle.motion,
                    ObstacleMotion::Static,
                    "seed {seed}, {time_s} s"
                );
                if time_s > 0.5 {
                    assert_eq!(
                        obstacle.motion,
                        ObstacleMotion::Moving,
                        "seed {seed}, {time_s} s"
                    );
                }
            },
        );
    }
}

#[test]
fn somebody_who_stood_and_walks_on_is_moving_within_half_a_second() {
    let start_s = 4.0;
    let place = |t: f64| Vector2::new(3.0, -0.5 + 1.2 * (t - start_s).max(0.0));
    for seed in 0..10 {
        follow(seed, 6.0, place, |time_s, obstacle| {
            if time_s > 3.0 && time_s < start_s {
                assert_eq!(
                    obstacle.motion,
                    ObstacleMotion::Static,
                    "seed {seed}, {time_s} s"
                );
            }
            if time_s > start_s + 0.5 {
                assert_eq!(
                    obstacle.motion,
                    ObstacleMotion::Moving,
                    "seed {seed}, {time_s} s"
                );
            }
        });
    }
}

#[test]
fn somebody_who_stops_becomes_static() {
    let place = |t: f64| Vector2::new(3.0, -1.2 + 1.2 * t.min(1.5));
    follow(0, 5.0, place, |time_s, obstacle| {
        if time_s > 3.5 {
            assert_eq!(obstacle.motion, ObstacleMotion::Static, "{time_s} s");
        }
    });
}

/// A wall at x = 4 from y = -2.4 to 2.4, cut into pieces of about 0.8 m at other places in every
/// image.
fn cut_wall(random: &mut Pcg64) -> Vec<Detection> {
    let start: f64 = random.random();
    let mut borders: Vec<f64> = (0..7).map(|i| -2.4 + 0.8 * (i as f64 - start)).collect();
    borders.retain(|b| b.abs() < 2.2);
    borders.insert(0, -2.4);
    borders.push(2.4);
    borders
        .windows(2)
        .map(|ends| {
            let across = 0.03 * normal(random);
            Detection {
                sensor: 0,
                centre_world: Vector3::new(4.05 + across, 0.5 * (ends[0] + ends[1]), 1.2),
                yaw_rad: -std::f64::consts::FRAC_PI_2 + 0.03 * normal(random),
                size_m: Vector3::new(ends[1] - ends[0], 0.1, 2.4),
                footprint: Footprint::Flat,
                centre_covariance: Matrix3::from_diagonal(&Vector3::new(9e-4, 4e-4, 4e-4)),
                size_variance_m2: Vector3::repeat(4e-4),
                cut: Default::default(),
                window: Default::default(),
                depth_m: [4.0, 4.0],
                pixels: 500,
            }
        })
        .collect()
}

#[test]
fn pieces_of_a_wall_never_move_and_cover_it() {
    let (mut tracker, mut random, camera) = (tracker(), random(1), at_origin());
    let wall = [Wall {
        from: Vector2::new(4.0, -2.4),
        to: Vector2::new(4.0, 2.4),
    }];
    let mut error = 0.0_f64;
    for image in 0..600 {
        let contour = contour(&camera, stamp(image), &[], &wall);
        let seen = cut_wall(&mut random);
        let pieces = tracker.update(stamp(image), &seen, &contour, &camera.position());
        assert!(
            pieces.len() <= seen.len() + 3,
            "{} for {}",
            pieces.len(),
            seen.len()
        );
        for piece in pieces {
            assert_eq!(piece.motion, ObstacleMotion::Static);
            assert_eq!(piece.velocity_world, Vector3::zeros());
            error = error.max((piece.centre_world.x - 4.05).abs());
        }
        for y in (-23..=23).map(|i| 0.1 * f64::from(i)) {
            let covers = |o: &Obstacle| (o.centre_world.y - y).abs() <= 0.5 * o.size_m.x + 0.01;
            assert!(pieces.iter().any(covers), "hole at {y} in image {image}");
        }
    }
    // Five standard deviations of a single piece, and no walking off.
    assert!(error < 0.15, "{error}");
}

#[test]
fn a_wall_that_leaves_the_view_stays() {
    let (mut tracker, mut random, mut camera) = (tracker(), random(2), at_origin());
    for image in 0..20 {
        let seen = cut_wall(&mut random);
        tracker.update(stamp(image), &seen, &Contour::default(), &camera.position());
    }
    camera.yaw_rad = std::f64::consts::PI;
    for image in 20..320 {
        let contour = contour(&camera, stamp(image), &[], &[]);
        let pieces = tracker.update(stamp(image), &[], &contour, &camera.position());
        let length: f64 = pieces.iter().map(|piece| piece.size_m.x).sum();
        assert!(length > 4.6, "{length} m in image {image}");
    }
}

/// Mean error of the velocity over the first half second of people who walk into the view.
fn error_on_entry(change: impl Fn(&mut Detection)) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..10 {
        let (mut tracker, mut random, camera) = (tracker(), random(seed), at_origin());
        let mut images = 0;
        for image in 0..60 {
            let time = stamp(image);
            let things = [cylinder(2.5, -3.0 + 1.2 * time.as_s())];
            let mut seen = detections(&camera, &things, &[], &mut random);
            seen.iter_mut().for_each(&change);
            let contour = contour(&camera, time, &things, &[]);
            let obstacles = tracker.update(time, &seen, &contour, &camera.position());
            for obstacle in obstacles.iter().filter(|o| (5..15).contains(&o.images)) {
                images += 1;
                sum += (obstacle.velocity_world.xy() - Vector2::new(0.0, 1.2)).norm();
                count += 1.0;
            }
        }
        assert!(images >= 10);
    }
    sum / count
}

/// Document L, section 5-2-3: the first estimates of somebody who comes into view are unreliable,
/// because the box grows. Its centre moves at half the speed of its leading side.
#[test]
fn somebody_who_enters_the_view_is_followed_by_the_side_that_is_seen() {
    let by_sides = error_on_entry(|_| {});
    let by_centre = error_on_entry(|detection| {
        detection.cut = Default::default();
        let axis = Vector3::new(detection.yaw_rad.cos(), detection.yaw_rad.sin(), 0.0);
        let unseen = 0.25 * 0.3 * 0.3;
        detection.centre_covariance -= axis * axis.transpose() * unseen;
        detection.size_variance_m2.x = 1e-4;
    });
    assert!(by_sides < 0.3, "{by_sides}");
    assert!(by_sides < 0.5 * by_centre, "{by_sides} {by_centre}");
}
