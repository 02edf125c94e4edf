//! What the memory of free space claims.

// A helper that finds nothing should stop its test.
#![allow(clippy::unwrap_used)]

use std::f64::consts::FRAC_PI_2;

use alula_geometry::Timestamp;
use alula_perception::{Contour, Ray, RayEnd, SeenSpace, SeenSpaceConfig};
use nalgebra::Vector3;
use proptest::prelude::*;

const CELL_M: f64 = 0.25;

fn space() -> SeenSpace {
    SeenSpace::new(&SeenSpaceConfig::default()).unwrap()
}

fn at(x: f64, y: f64) -> Vector3<f64> {
    Vector3::new(x, y, 1.0)
}

/// 101 rays over 80 degrees about east, all of one range.
fn fan(camera: Vector3<f64>, range_m: f64, end: RayEnd, time_s: f64) -> Contour {
    let ray = |i: i32| Ray {
        heading_rad: 0.014 * f64::from(50 - i),
        range_m,
        end,
    };
    Contour {
        time: Timestamp::from_s(time_s),
        sensor: 0,
        camera_world: camera,
        rays: (0..=100).map(ray).collect(),
    }
}

#[test]
fn nothing_is_free_before_it_was_seen() {
    assert!(!space().is_free(&at(0.0, 0.0)));
}

#[test]
fn space_before_a_hit_is_free_and_behind_it_unseen() {
    let mut space = space();
    space.update(&fan(at(0.1, 0.1), 4.0, RayEnd::Hit, 1.0));
    assert!(space.is_free(&at(3.5, 0.1)));
    assert!(!space.is_free(&at(4.2, 0.1)));
    assert!(!space.is_free(&at(-1.0, 0.1)));
}

#[test]
fn rays_that_know_nothing_free_nothing() {
    let mut space = space();
    space.update(&fan(at(0.1, 0.1), 4.0, RayEnd::Unknown, 1.0));
    assert!(!space.is_free(&at(2.0, 0.1)));
}

#[test]
fn what_appears_is_not_free_and_what_leaves_frees_its_place() {
    let mut space = space();
    let behind = at(4.6, 0.1);
    space.update(&fan(at(0.1, 0.1), 6.0, RayEnd::Free, 1.0));
    assert!(space.is_free(&behind));
    space.update(&fan(at(0.1, 0.1), 4.0, RayEnd::Hit, 2.0));
    assert!(!space.is_free(&at(4.1, 0.1)));
    space.update(&fan(at(0.1, 0.1), 6.0, RayEnd::Free, 3.0));
    assert!(space.is_free(&at(4.1, 0.1)));
}

#[test]
fn freedom_is_forgotten_with_time() {
    let mut space = space();
    space.update(&fan(at(0.1, 0.1), 4.0, RayEnd::Free, 1.0));
    space.update(&fan(at(0.1, 0.1), 4.0, RayEnd::Unknown, 10.9));
    assert!(space.is_free(&at(2.0, 0.1)));
    space.update(&fan(at(0.1, 0.1), 4.0, RayEnd::Unknown, 11.1));
    assert!(!space.is_free(&at(2.0, 0.1)));
}

#[test]
fn older_images_change_nothing() {
    let mut space = space();
    space.update(&fan(at(0.1, 0.1), 4.0, RayEnd::Free, 5.0));
    space.update(&fan(at(0.1, 0.1), 2.0, RayEnd::Hit, 4.0));
    assert!(space.is_free(&at(2.0, 0.1)));
}

#[test]
fn the_place_of_the_vehicle_is_free() {
    let mut space = space();
    let here = at(0.3, -0.7);
    space.mark_here(&here, 0.5, Timestamp::from_s(1.0));
    for i in 0..8 {
        let heading = FRAC_PI_2 / 2.0 * f64::from(i);
        let inside = here + at(heading.cos(), heading.sin()) * (0.5 - 0.5 * CELL_M * 2_f64.sqrt());
        assert!(space.is_free(&inside));
    }
    assert!(!space.is_free(&at(0.3 + 0.5 + CELL_M, -0.7)));
}

#[test]
fn what_left_the_square_is_forgotten() {
    let mut space = space();
    space.update(&fan(at(0.1, 0.1), 4.0, RayEnd::Free, 1.0));
    space.mark_here(&at(12.0, 0.1), 0.3, Timestamp::from_s(2.0));
    assert!(!space.is_free(&at(2.0, 0.1)));
    space.mark_here(&at(0.1, 0.1), 0.1, Timestamp::from_s(3.0));
    assert!(!space.is_free(&at(2.0, 0.1)));
}

#[test]
fn nonsense_changes_nothing() {
    let mut space = space();
    let mut nowhere = fan(at(f64::NAN, 0.1), 4.0, RayEnd::Free, 1.0);
    space.update(&nowhere);
    nowhere.camera_world = at(0.1, 0.1);
    nowhere
        .rays
        .iter_mut()
        .for_each(|ray| ray.range_m = f64::NAN);
    space.update(&nowhere);
    space.mark_here(&at(1e300, 0.0), 1.0, Timestamp::from_s(1.0));
    assert!(!space.is_free(&at(2.0, 0.1)));
    assert!(!space.is_free(&at(f64::NAN, 0.0)));
}

proptest! {
    /// A ring that moves and clears its borders knows within the square what one square that
    /// never moves would know.
    #[test]
    fn a_moving_square_knows_what_a_standing_one_knows(
        steps in prop::collection::vec((-6.0..6.0, -6.0..6.0), 1..12),
        asked in prop::collection::vec((-12.0..12.0, -12.0..12.0), 50),
    ) {
        let wide = SeenSpaceConfig { extent_m: 64.0, ..Default::default() };
        let (mut moving, mut standing) = (space(), SeenSpace::new(&wide).unwrap());
        let mut end = at(0.0, 0.0);
        for (i, (x, y)) in steps.iter().enumerate() {
            end = at(*x, *y);
            let contour = fan(end, 1.0 + 0.5 * i as f64, RayEnd::Hit, i as f64);
            moving.update(&contour);
            standing.update(&contour);
        }
        for (x, y) in asked {
            let point = at(x, y);
            let inside = (point - end).amax() < 8.0 - CELL_M;
            // What was outside in between is forgotten: the moving one knows no more.
            prop_assert!(!moving.is_free(&point) || standing.is_free(&point));
            let stayed = steps.iter().all(|(a, b)| (point - at(*a, *b)).amax() < 8.0 - CELL_M);
            if inside && stayed {
                prop_assert_eq!(moving.is_free(&point), standing.is_free(&point));
            }
        }
    }
}
