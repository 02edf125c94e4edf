//! Facts about the boxes that are found in rendered depth images.

// Helpers of tests may fail like tests do.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod scene;

use alula_messages::{DepthImage, Detection, Footprint};
use alula_perception::{Detector, DetectorConfig, RayEnd, View};
use nalgebra::{Matrix3, Vector2, Vector3};
use rand_distr::{Distribution, StandardNormal};
use scene::{Thing, camera, generator, noisy, render, view};

const FLOOR: Thing = Thing::Floor { height_m: 0.0 };

fn detect(image: &DepthImage, view: &View) -> Vec<Detection> {
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    detector.detect(image, view).to_vec()
}

/// The box whose centre, seen from above, is nearest to a place.
fn nearest(boxes: &[Detection], x: f64, y: f64) -> &Detection {
    let apart = |b: &Detection| (b.centre_world.xy() - Vector2::new(x, y)).norm();
    let by_distance = |a: &&Detection, b: &&Detection| apart(a).total_cmp(&apart(b));
    boxes.iter().min_by(by_distance).unwrap()
}

/// Corners of a box seen from above.
fn corners(found: &Detection) -> [Vector2<f64>; 4] {
    let (sine, cosine) = found.yaw_rad.sin_cos();
    let along = Vector2::new(cosine, sine) * (found.size_m.x / 2.0);
    let across = Vector2::new(-sine, cosine) * (found.size_m.y / 2.0);
    let c = found.centre_world.xy();
    [
        c + along + across,
        c + along - across,
        c - along - across,
        c - along + across,
    ]
}

/// Facades: top, bottom, left, right, front, back as seen from the origin along x.
fn facades(found: &Detection) -> [f64; 6] {
    let c = corners(found);
    let most = |f: fn(&Vector2<f64>) -> f64| c.iter().map(f).fold(f64::NEG_INFINITY, f64::max);
    [
        found.centre_world.z + found.size_m.z / 2.0,
        found.centre_world.z - found.size_m.z / 2.0,
        most(|p| p.y),
        -most(|p| -p.y),
        -most(|p| -p.x),
        most(|p| p.x),
    ]
}

/// Mean errors of the facades over noisy images.
fn facade_errors_m(things: &[Thing], at: (f64, f64), truth: [f64; 6]) -> [f64; 6] {
    let view = view(1.2, 0.0, 0.0, 0.0);
    let image = render(camera(), &view, things);
    let mut random = generator(3);
    let mut errors = [0.0; 6];
    for _ in 0..20 {
        let boxes = detect(&noisy(&image, &mut random), &view);
        let found = facades(nearest(&boxes, at.0, at.1));
        for (error, (found, truth)) in errors.iter_mut().zip(found.iter().zip(truth)) {
            *error += (found - truth) / 20.0;
        }
    }
    errors
}

/// Document L, figure 5-7, has a few centimetres for what is seen, a bottom that is dragged to the
/// floor, and the largest error for the back.
#[test]
fn the_six_facades_of_two_obstacles_are_where_they_are() {
    let things = [
        FLOOR,
        Thing::post(2.0, 0.0, 0.2, 0.0, 1.6),
        Thing::block([2.5, -1.0, 1.3], [0.1, 0.5, 0.6], 0.0),
    ];
    let standing = facade_errors_m(&things, (2.0, 0.0), [1.6, 0.0, 0.2, -0.2, 1.8, 2.2]);
    let hanging = facade_errors_m(&things, (2.5, -1.0), [1.6, 1.0, -0.75, -1.25, 2.45, 2.55]);
    println!("errors, m, of top, bottom, left, right, front, back");
    println!("standing cylinder {standing:.3?}\nhanging board {hanging:.3?}");
    // Two columns or rows at 2.5 m, of 11 mm, and the rows that are skipped.
    for error in standing[..5].iter().chain(&hanging) {
        assert!(error.abs() < 0.045);
    }
    // The unseen back of the cylinder: the goal set for it.
    assert!(standing[5].abs() < 0.1);
}

#[test]
fn a_tilted_camera_sees_the_same_boxes() {
    let things = [
        FLOOR,
        Thing::post(2.0, 0.3, 0.2, 0.6, 1.5),
        Thing::block([2.5, -0.6, 1.2], [0.1, 0.5, 0.6], 0.0),
    ];
    for (roll, pitch) in [(20.0, 0.0), (0.0, 20.0), (-20.0, 15.0), (20.0, 20.0)] {
        let view = view(1.2, roll, pitch, 0.0);
        let image = noisy(&render(camera(), &view, &things), &mut generator(5));
        let boxes = detect(&image, &view);
        for (x, y, z, size) in [
            (2.0, 0.3, 1.05, [0.4, 0.4, 0.9]),
            (2.5, -0.6, 1.2, [0.5, 0.1, 0.6]),
        ] {
            let found = nearest(&boxes, x, y);
            let apart = found.centre_world - Vector3::new(x, y, z);
            // As in the level view: a few columns of 11 mm.
            assert!(apart.norm() < 0.05, "{roll} {pitch} {found:?}");
            assert!(
                (found.size_m - Vector3::from(size)).amax() < 0.1,
                "{roll} {pitch} {found:?}"
            );
        }
    }
}

/// Mean normalised squared error of the centre of a post, over places, noise and attitude errors.
#[test]
fn the_covariance_of_a_centre_is_that_of_its_errors() {
    const ATTITUDE_SIGMA_RAD: f64 = 0.005;
    let mut random = generator(7);
    let (mut sum, mut number) = (0.0, 0);
    for place in 0..25 {
        let (x, y) = (1.6 + 0.1 * f64::from(place), 0.4 * f64::from(place % 5 - 2));
        let truth = Vector3::new(x, y, 0.8);
        let exact = view(1.2, 0.0, 0.0, 0.0);
        let image = render(
            camera(),
            &exact,
            &[FLOOR, Thing::post(x, y, 0.22, 0.0, 1.6)],
        );
        for _ in 0..20 {
            let error = Vector3::from_fn(|_, _| StandardNormal.sample(&mut random));
            let mut believed = exact;
            believed.world_from_body.rotation *=
                alula_geometry::so3::exp(&(error * ATTITUDE_SIGMA_RAD));
            believed.orientation_covariance = Matrix3::identity() * ATTITUDE_SIGMA_RAD.powi(2);
            let boxes = detect(&noisy(&image, &mut random), &believed);
            let found = nearest(&boxes, x, y);
            let error = found.centre_world - truth;
            let information = found.centre_covariance.try_inverse().unwrap();
            sum += error.dot(&(information * error));
            number += 1;
        }
    }
    let mean = sum / f64::from(number);
    println!("mean normalised squared error of the centre: {mean:.2} (3 is exact)");
    // Three degrees of freedom: a covariance that is right has 3. A third of it means standard
    // deviations 1.7 times too large, twice it 1.4 times too small.
    assert!(mean > 1.0 && mean < 6.0, "{mean}");
}

#[test]
fn a_person_before_a_wall_is_a_box_of_its_own() {
    let view = view(1.2, 0.0, 0.0, 0.0);
    let mut things = vec![FLOOR, Thing::block([3.65, 0.0, 1.5], [0.1, 8.0, 3.0], 0.0)];
    things.extend(Thing::person(2.8, 0.2));
    let image = noisy(&render(camera(), &view, &things), &mut generator(9));
    let boxes = detect(&image, &view);
    let person = nearest(&boxes, 2.8, 0.2);
    assert_eq!(person.footprint, Footprint::Round);
    assert!(person.size_m.xy().amax() < 0.6);
    // The top of the head, within two rows that are read, 25 mm at 2.8 m.
    assert!((person.centre_world.z + person.size_m.z / 2.0 - 1.75).abs() < 0.05);
    for wall in boxes.iter().filter(|b| *b != person) {
        assert_eq!(wall.footprint, Footprint::Flat);
        assert!((wall.centre_world.x - 3.65).abs() < 0.1, "{wall:?}");
    }
}

/// Columns see an ellipsoid's belly, on average further back than it comes forward.
#[test]
fn a_body_that_narrows_upwards_is_as_wide_and_deep_as_its_belly() {
    let view = view(1.2, 0.0, 10.0, 0.0);
    let mut random = generator(13);
    for distance in [1.3, 1.8, 2.5, 3.5] {
        let body = Thing::Ellipsoid {
            centre: Vector3::new(distance, 0.1, 0.9),
            radius_m: 0.4,
            half_height_m: 0.9,
        };
        let image = noisy(&render(camera(), &view, &[FLOOR, body]), &mut random);
        let boxes = detect(&image, &view);
        let found = nearest(&boxes, distance, 0.1);
        let error = (found.centre_world.xy() - Vector2::new(distance, 0.1)).norm();
        assert!(error < 0.1, "{error} at {distance}");
        let [width, depth] = [found.size_m.x, found.size_m.y];
        assert!((width - 0.8).abs() < 0.12, "{width} at {distance}");
        assert!((depth - 0.8).abs() < 0.2, "{depth} at {distance}");
    }
}

#[test]
fn people_side_by_side_are_two() {
    let view = view(1.2, 0.0, 0.0, 0.0);
    let mut things = vec![FLOOR];
    things.extend(Thing::person(2.5, 0.35));
    things.extend(Thing::person(2.5, -0.35));
    let image = noisy(&render(camera(), &view, &things), &mut generator(11));
    let boxes = detect(&image, &view);
    assert_eq!(boxes.len(), 2);
    for (found, y) in boxes.iter().zip([0.35, -0.35]) {
        assert!((found.centre_world.xy() - Vector2::new(2.5, y)).norm() < 0.1);
    }
}

/// Two who walk abreast, nearer to each other than their own width: their fronts meet in an inner
/// corner, and together they are wider than a compact thing.
#[test]
fn people_abreast_are_not_a_wall() {
    let mut random = generator(8);
    for apart_m in [0.55, 0.65, 0.75, 0.85] {
        for (ahead_m, turn_deg) in [(1.5, 0.0_f64), (2.0, 20.0), (2.0, -35.0), (3.0, 10.0)] {
            let (sine, cosine) = turn_deg.to_radians().sin_cos();
            let places = [-0.5, 0.5].map(|side| {
                let aside_m = side * apart_m;
                Vector2::new(ahead_m + aside_m * sine, aside_m * cosine)
            });
            let people = places.map(|place| Thing::Ellipsoid {
                centre: Vector3::new(place.x, place.y, 0.9),
                radius_m: 0.4,
                half_height_m: 0.9,
            });
            let view = view(1.2, 0.0, 10.0, 0.0);
            let image = noisy(
                &render(camera(), &view, &[FLOOR, people[0], people[1]]),
                &mut random,
            );
            let boxes = detect(&image, &view);
            let case = format!("{apart_m} m apart, {ahead_m} m ahead, {turn_deg} deg: {boxes:#?}");
            assert!(
                boxes.iter().all(|b| b.footprint == Footprint::Round),
                "{case}"
            );
            for place in &places {
                let found = nearest(&boxes, place.x, place.y);
                let error_m = (found.centre_world.xy() - place).norm();
                println!(
                    "{apart_m} {ahead_m} {turn_deg}: {error_m:.3} size {:.2} {:.2}",
                    found.size_m.x, found.size_m.y
                );
                assert!(error_m < 0.25, "{case}");
            }
        }
    }
}

/// Whether a place, seen from above, lies in a box.
fn covers(found: &Detection, place: &Vector2<f64>) -> bool {
    let (sine, cosine) = found.yaw_rad.sin_cos();
    let d = place - found.centre_world.xy();
    let own = Vector2::new(cosine * d.x + sine * d.y, cosine * d.y - sine * d.x);
    own.x.abs() <= found.size_m.x / 2.0 && own.y.abs() <= found.size_m.y / 2.0
}

#[test]
fn a_doorway_stays_free() {
    let view = view(1.2, 0.0, 0.0, 0.0);
    let things = [
        FLOOR,
        Thing::block([3.0, 2.45, 1.5], [0.1, 4.0, 3.0], 0.0),
        Thing::block([3.0, -2.45, 1.5], [0.1, 4.0, 3.0], 0.0),
    ];
    let image = noisy(&render(camera(), &view, &things), &mut generator(13));
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    let boxes = detector.detect(&image, &view).to_vec();
    assert!(boxes.len() >= 4, "{boxes:?}");
    for k in -40..=40 {
        // The door is 0.9 m wide; two columns of 13 mm may go to its frame.
        let place = Vector2::new(3.0, 0.01 * f64::from(k));
        assert!(!boxes.iter().any(|b| covers(b, &place)), "{place:?}");
    }
    let rays = &detector.contour().rays;
    let ahead = rays.iter().filter(|ray| ray.heading_rad.abs() < 0.13);
    let beside = rays
        .iter()
        .filter(|ray| (0.17..0.7).contains(&ray.heading_rad.abs()));
    assert!(ahead.clone().count() > 5);
    assert!(
        ahead
            .clone()
            .all(|ray| ray.end == RayEnd::Free && ray.range_m > 4.5)
    );
    for ray in beside {
        let true_m = 2.95 / ray.heading_rad.cos();
        // Noise of 64 mm at 3 m, averaged over a column and least of five; the slope in a ray.
        assert_eq!(ray.end, RayEnd::Hit);
        assert!((ray.range_m - true_m).abs() < 0.15, "{ray:?} {true_m}");
    }
}

#[test]
fn pieces_of_an_oblique_wall_lie_on_it() {
    let view = view(1.2, 0.0, 0.0, 0.0);
    for turn_deg in [20.0_f64, 45.0, 65.0] {
        let (sine, cosine) = turn_deg.to_radians().sin_cos();
        let normal = Vector2::new(cosine, sine);
        let centre = Vector2::new(2.5, 0.0) + normal * 0.05;
        let wall = Thing::block(
            [centre.x, centre.y, 1.5],
            [0.1, 12.0, 3.0],
            turn_deg.to_radians(),
        );
        let image = noisy(&render(camera(), &view, &[FLOOR, wall]), &mut generator(17));
        let boxes = detect(&image, &view);
        assert!(boxes.len() >= 3, "{turn_deg} {}", boxes.len());
        for found in &boxes {
            assert_eq!(found.footprint, Footprint::Flat);
            for corner in corners(found) {
                let behind = (corner - Vector2::new(2.5, 0.0)).dot(&normal);
                // The face, and the thickness of a piece behind it.
                assert!(
                    behind > -0.1 && behind < 0.2,
                    "{turn_deg} {behind} {found:?}"
                );
            }
        }
    }
}

#[test]
fn noise_at_the_end_of_the_range_does_not_hide_a_person() {
    let view = view(1.2, 0.0, 0.0, 0.0);
    let mut things = vec![FLOOR];
    things.extend(Thing::person(4.5, -0.8));
    let image = render(camera(), &view, &things);
    let mut random = generator(19);
    for _ in 0..100 {
        let boxes = detect(&noisy(&image, &mut random), &view);
        assert_eq!(boxes.len(), 1);
        assert!((boxes[0].centre_world.xy() - Vector2::new(4.5, -0.8)).norm() < 0.2);
    }
}

#[test]
fn the_floor_is_no_thing() {
    for (roll, pitch) in [(0.0, 0.0), (15.0, 0.0), (0.0, 20.0), (0.0, -10.0)] {
        let view = view(1.2, roll, pitch, 0.0);
        let image = noisy(&render(camera(), &view, &[FLOOR]), &mut generator(23));
        assert_eq!(detect(&image, &view), []);
    }
}

#[test]
fn the_map_counts_every_pixel_once() {
    let view = view(1.2, 10.0, -15.0, 30.0);
    let image = render(
        camera(),
        &view,
        &[Thing::block([3.0, 2.0, 1.0], [1.0, 1.0, 2.0], 0.4)],
    );
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    detector.detect(&image, &view);
    let map = detector.u_depth();
    let world_from_camera = view.world_from_body * image.body_from_camera;
    let axis = world_from_camera.rotation * Vector3::z();
    let forward = Vector3::new(axis.x, axis.y, 0.0).normalize();
    let mut expected = vec![0_i64; map.bins];
    for v in (0..240).step_by(2) {
        for u in 0..424 {
            let depth_m = f64::from(image.depth_mm[v * 424 + u]) * 1e-3;
            let point = image.camera.unproject(u as f64, v as f64, depth_m);
            let ahead_m = (world_from_camera.rotation * point.coords).dot(&forward);
            if depth_m > 0.0 {
                expected[(ahead_m / map.bin_m) as usize] += 1;
            }
        }
    }
    let mut moved = 0;
    for bin in 1..map.bins {
        let counted: i64 = map.row(bin).iter().map(|count| i64::from(*count)).sum();
        moved += (counted - expected[bin]).abs();
    }
    // Single precision may put a depth on a bin's border, whole millimetres, on its other side.
    let all: i64 = expected.iter().sum();
    assert!(all > 2000 && moved <= all / 50, "{moved} of {all}");
}

#[test]
fn the_same_image_gives_the_same_bits() {
    let view = view(1.2, 3.0, -4.0, 0.0);
    let image = noisy(&render(camera(), &view, &scene::room()), &mut generator(29));
    let other = render(camera(), &view, &[FLOOR]);
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    let first = detector.detect(&image, &view).to_vec();
    assert!(first.len() > 5);
    detector.detect(&other, &view);
    assert_eq!(detector.detect(&image, &view), first);
}

#[test]
fn useless_images_and_views_give_nothing() {
    let good = view(1.2, 0.0, 0.0, 0.0);
    let image = render(camera(), &good, &scene::room());
    let filled = |mm: u16| DepthImage {
        depth_mm: vec![mm; image.depth_mm.len()],
        ..image.clone()
    };
    let mut short = image.clone();
    short.depth_mm.pop();
    let mut empty = image.clone();
    empty.camera.width_px = 0;
    empty.depth_mm.clear();
    let mut nowhere = good;
    nowhere.world_from_body.translation.x = f64::NAN;
    let mut unsure = good;
    unsure.orientation_covariance[(0, 0)] = f64::INFINITY;
    let down = view(1.2, 0.0, 90.0, 0.0);
    let cases = [
        (filled(0), good),
        (filled(u16::MAX), good),
        (short, good),
        (empty, good),
        (image.clone(), nowhere),
        (image.clone(), unsure),
        (image.clone(), down),
    ];
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    for (image, view) in cases {
        assert_eq!(detector.detect(&image, &view), []);
        assert!(
            detector
                .contour()
                .rays
                .iter()
                .all(|ray| ray.end == RayEnd::Unknown)
        );
    }
}

#[test]
fn any_attitude_is_survived() {
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    let image = render(camera(), &view(1.2, 0.0, 0.0, 0.0), &scene::room());
    for roll in (-180..180).step_by(30) {
        for pitch in (-90..=90).step_by(15) {
            let view = view(1.2, f64::from(roll), f64::from(pitch), 10.0);
            for found in detector.detect(&image, &view) {
                assert!(found.centre_world.iter().all(|v| v.is_finite()));
                assert!(found.size_m.iter().all(|v| *v > 0.0));
                assert!(found.centre_covariance.cholesky().is_some());
            }
        }
    }
}
