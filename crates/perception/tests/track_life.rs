//! Whom the tracker knows, and for how long.

// A helper that finds nothing should stop its test.
#![allow(clippy::unwrap_used)]

mod track_support;

use std::f64::consts::FRAC_PI_2;

use alula_messages::{Detection, Obstacle, ObstacleMotion, Sight};
use alula_perception::{Contour, Tracker, TrackerConfig};
use nalgebra::{Vector2, Vector3};
use rand_pcg::Pcg64;
use track_support::*;

/// A tracker that looks at a world from a camera.
struct Watch {
    tracker: Tracker,
    camera: Camera,
    random: Pcg64,
    image: usize,
}

impl Watch {
    fn new(seed: u64) -> Self {
        Self {
            tracker: Tracker::new(&TrackerConfig::default()).unwrap(),
            camera: at_origin(),
            random: random(seed),
            image: 0,
        }
    }

    fn time_s(&self) -> f64 {
        stamp(self.image).as_s()
    }

    fn see(&mut self, things: &[Cylinder]) -> Vec<Obstacle> {
        self.see_changed(things, |_| {})
    }

    /// Looks, after `change` was made to what the detector reports.
    fn see_changed(
        &mut self,
        things: &[Cylinder],
        change: impl FnOnce(&mut Vec<Detection>),
    ) -> Vec<Obstacle> {
        self.image += 1;
        let time = stamp(self.image);
        let mut seen = detections(&self.camera, things, &[], &mut self.random);
        change(&mut seen);
        let contour = contour(&self.camera, time, things, &[]);
        let here = self.camera.position();
        self.tracker.update(time, &seen, &contour, &here).to_vec()
    }

    fn see_for(&mut self, seconds: f64, things: impl Fn(f64) -> Vec<Cylinder>) -> Vec<Obstacle> {
        let mut obstacles = Vec::new();
        for _ in 0..(seconds * RATE_HZ).round() as usize {
            let time_s = self.time_s();
            obstacles = self.see(&things(time_s));
        }
        obstacles
    }
}

fn id_at(obstacles: &[Obstacle], x: f64, y: f64) -> u32 {
    find(obstacles, &Vector2::new(x, y)).unwrap().id
}

/// He turned where he was not seen, and comes back where he was not expected.
#[test]
fn who_comes_back_from_elsewhere_keeps_his_number() {
    for seed in 0..5 {
        let mut watch = Watch::new(seed);
        // Out of the view to the left, and back in 0.7 m nearer.
        let walker = |t: f64| {
            let (x, y) = if t < 2.0 {
                (2.5, 1.2 * t)
            } else {
                (1.8, 2.4 - 1.2 * (t - 2.0))
            };
            vec![cylinder(x, y)]
        };
        let before = watch.see_for(1.5, walker);
        let number = before.iter().find(|o| o.sight == Sight::Seen).unwrap().id;
        let after = watch.see_for(1.6, walker);
        let moving: Vec<_> = after.iter().filter(|o| o.sight == Sight::Seen).collect();
        assert_eq!(moving.len(), 1, "{moving:?}");
        assert_eq!(moving[0].id, number, "seed {seed}");
        assert_eq!(after.len(), 1, "{after:?}");
    }
}

#[test]
fn people_who_cross_keep_their_numbers() {
    for seed in 0..5 {
        let mut watch = Watch::new(seed);
        let people = |t: f64| vec![cylinder(3.0, -1.8 + 1.2 * t), cylinder(4.2, 1.8 - 1.2 * t)];
        let before = watch.see_for(0.8, people);
        let after = watch.see_for(1.6, people);
        let t = watch.time_s() - 1.0 / RATE_HZ;
        let ids = |o: &[Obstacle], t: f64| {
            let [near, far] = [people(t)[0].place, people(t)[1].place];
            [id_at(o, near.x, near.y), id_at(o, far.x, far.y)]
        };
        assert_eq!(ids(&before, 0.8 - 1.0 / RATE_HZ), ids(&after, t));
        assert_eq!(after.len(), 2);
    }
}

#[test]
fn somebody_hidden_behind_another_is_found_again() {
    for seed in 0..5 {
        let mut watch = Watch::new(seed);
        let people = |t: f64| vec![cylinder(2.0, 0.0), cylinder(4.0, -1.8 + 1.2 * t)];
        let before = watch.see_for(0.8, people);
        let id = id_at(&before, 4.0, -1.8 + 1.2 * 0.8);
        let mut was_hidden = false;
        for _ in 0..(1.6 * RATE_HZ) as usize {
            let now = watch.see(&people(watch.time_s()));
            let track = now.iter().find(|o| o.id == id);
            was_hidden |= track.unwrap().sight == Sight::Hidden;
        }
        let after = watch.see(&people(watch.time_s()));
        assert!(was_hidden);
        assert_eq!(id_at(&after, 4.0, -1.8 + 1.2 * watch.time_s()), id);
    }
}

/// A walker who left is out of view for as long as the place is known to a metre.
#[test]
fn somebody_who_left_the_view_is_remembered_and_then_forgotten() {
    let mut watch = Watch::new(1);
    let walker = |t: f64| vec![cylinder(3.0, 1.0 + 1.2 * t)];
    watch.see_for(2.5, walker);
    let mut remembered_s = 0.0;
    while let Some(obstacle) = watch.see(&walker(watch.time_s())).first() {
        assert_eq!(obstacle.sight, Sight::OutOfView);
        let gap = obstacle.centre_world.y - (1.0 + 1.2 * (watch.time_s() - 1.0 / RATE_HZ));
        assert!(gap.abs() < 0.5, "{gap}");
        remembered_s += 1.0 / RATE_HZ;
    }
    assert!((0.5..3.0).contains(&remembered_s), "{remembered_s}");
}

#[test]
fn a_pillar_is_remembered_until_the_vehicle_is_far() {
    let mut watch = Watch::new(2);
    let pillar = [cylinder(3.0, 0.5)];
    watch.see_for(2.0, |_| pillar.to_vec());
    // 0.5 m/s past the pillar and on.
    for _ in 0..(23.0 * RATE_HZ) as usize {
        watch.camera.place.x += 0.5 / RATE_HZ;
        let now = watch.see(&pillar);
        let distance = (watch.camera.place - pillar[0].place).norm();
        // Besides what the track errs.
        if (distance - 8.0).abs() > 0.15 {
            assert_eq!(now.len(), usize::from(distance < 8.0), "at {distance} m");
        }
        for obstacle in now {
            assert!((obstacle.centre_world.xy() - pillar[0].place).norm() < 0.15);
        }
    }
    assert!((watch.camera.place - pillar[0].place).norm() > 8.2);
}

#[test]
fn somebody_who_vanishes_in_plain_view_is_gone_in_a_third_of_a_second() {
    let mut watch = Watch::new(3);
    watch.see_for(2.0, |t| vec![cylinder(3.0, -1.0 + t)]);
    let last = watch.see_for(0.3, |_| Vec::new());
    assert_eq!(last.len(), 1);
    assert_eq!(watch.see_for(0.1, |_| Vec::new()), Vec::new());
}

#[test]
fn a_false_detection_is_acted_on_at_once_and_gone_after_two_images() {
    let mut watch = Watch::new(4);
    let first = watch.see(&[cylinder(3.0, 0.0)]);
    assert_eq!(first.len(), 1);
    assert_eq!(first[0].images, 1);
    assert_eq!(first[0].velocity_world, Vector3::zeros());
    assert_eq!(watch.see(&[]).len(), 1);
    assert_eq!(watch.see(&[]).len(), 0);
}

/// Left and right half of a detection, as of two legs.
fn halves(detection: &Detection) -> [Detection; 2] {
    let axis = Vector3::new(detection.yaw_rad.cos(), detection.yaw_rad.sin(), 0.0);
    [-0.3, 0.3].map(|share| {
        let mut half = *detection;
        half.centre_world += axis * (share * detection.size_m.x);
        half.size_m.x *= 0.4;
        half
    })
}

#[test]
fn a_person_that_falls_into_two_boxes_stays_one() {
    let mut watch = Watch::new(5);
    let walker = |t: f64| [cylinder(3.0, -1.2 + 1.2 * t)];
    for image in 0..60 {
        let now = watch.see_changed(&walker(watch.time_s()), |seen| {
            if image > 10 && image % 3 == 0 {
                *seen = seen.iter().flat_map(halves).collect();
            }
        });
        assert_eq!((now.len(), now[0].id), (1, 0), "image {image}");
        if image > 15 {
            let error = now[0].velocity_world - Vector3::new(0.0, 1.2, 0.0);
            assert!(error.norm() < 0.4, "image {image}: {error}");
        }
    }
}

#[test]
fn two_people_in_one_box_stay_two() {
    let mut watch = Watch::new(6);
    let people = |_: f64| [cylinder(3.0, -0.3), cylinder(3.0, 0.3)];
    for image in 0..60 {
        let now = watch.see_changed(&people(watch.time_s()), |seen| {
            if (30..40).contains(&image) {
                let mut both = seen[0];
                both.centre_world = 0.5 * (seen[0].centre_world + seen[1].centre_world);
                both.size_m.x = 1.1;
                *seen = vec![both];
            }
        });
        let ids: Vec<_> = now.iter().map(|o| o.id).collect();
        assert_eq!(ids, [0, 1], "image {image}");
    }
}

/// A tracker behind a camera that looks ahead and one that looks to the left, with images of the
/// same times.
struct Pair {
    tracker: Tracker,
    random: Pcg64,
}

impl Pair {
    fn new(seed: u64) -> Self {
        Self {
            tracker: Tracker::new(&TrackerConfig::default()).unwrap(),
            random: random(seed),
        }
    }

    /// Images of the cameras named, 0 ahead and 1 to the left.
    fn see(&mut self, image: usize, cameras: &[u8], things: &[Cylinder]) -> Vec<Obstacle> {
        for &sensor in cameras {
            let camera = Camera {
                yaw_rad: f64::from(sensor) * FRAC_PI_2,
                ..at_origin()
            };
            let seen = detections(&camera, things, &[], &mut self.random);
            let contour = Contour {
                sensor,
                ..contour(&camera, stamp(image), things, &[])
            };
            let here = camera.position();
            self.tracker.update(stamp(image), &seen, &contour, &here);
        }
        self.tracker.obstacles().to_vec()
    }
}

#[test]
fn who_walks_from_one_camera_into_the_next_is_one_and_seen() {
    for seed in 1..9 {
        let mut pair = Pair::new(seed);
        for image in 1..120 {
            // From ahead to the left at 1.2 m/s; between the views are three degrees.
            let y_m = -0.5 + 1.2 * stamp(image).as_s();
            let known = pair.see(image, &[0, 1], &[cylinder(2.0, y_m)]);
            assert_eq!(known.len(), 1, "image {image}: {known:?}");
            assert_eq!(
                (known[0].id, known[0].sight),
                (0, Sight::Seen),
                "image {image}"
            );
            let off_m = (known[0].centre_world.xy() - Vector2::new(2.0, y_m)).norm();
            assert!(image < 10 || off_m < 0.2, "{off_m} at image {image}");
        }
    }
}

/// The images of the second camera arrive when the next ones of the first have been looked at.
#[test]
fn a_camera_that_answers_later_is_heard_until_a_tenth_of_a_second() {
    for (late, is_heard) in [(1, true), (2, true), (4, false)] {
        let mut pair = Pair::new(5);
        for image in 10..40 {
            pair.see(image, &[0], &[cylinder(0.3, 2.5)]);
            pair.see(image - late, &[1], &[cylinder(0.3, 2.5)]);
        }
        let known = pair.tracker.obstacles();
        let is_seen = known.first().is_some_and(|o| o.sight == Sight::Seen);
        assert_eq!(is_seen, is_heard, "{late} images late: {known:?}");
    }
}

#[test]
fn a_pillar_beside_is_not_missed_by_the_camera_ahead() {
    let mut pair = Pair::new(3);
    let known = (1..60).map(|image| pair.see(image, &[0, 1], &[cylinder(0.3, 2.5)]));
    let known = known.last().unwrap();
    assert_eq!(
        (known[0].sight, known[0].motion),
        (Sight::Seen, ObstacleMotion::Static)
    );
}

#[test]
fn what_a_silent_camera_showed_is_out_of_view() {
    let mut pair = Pair::new(4);
    let walker = |image| [cylinder(0.0, 2.5 - 0.01 * image as f64)];
    for image in 1..40 {
        pair.see(image, &[0, 1], &walker(image));
    }
    let mut last = Sight::Seen;
    for image in 40..55 {
        last = pair.see(image, &[0], &walker(image))[0].sight;
    }
    assert_eq!(last, Sight::OutOfView);
}

#[test]
fn images_that_are_not_later_change_nothing() {
    let mut watch = Watch::new(7);
    let before = watch.see_for(0.5, |_| vec![cylinder(3.0, 0.0)]);
    watch.image -= 1;
    assert_eq!(watch.see(&[]), before);
    watch.image -= 10;
    assert_eq!(watch.see(&[cylinder(2.0, 1.0)]), before);
}

#[test]
fn detections_that_are_not_finite_are_left_out() {
    let mut watch = Watch::new(8);
    let people = [cylinder(3.0, 0.0), cylinder(3.0, 1.0)];
    let now = watch.see_changed(&people, |seen| seen[0].centre_covariance[(0, 0)] = f64::NAN);
    assert_eq!(now.len(), 1);
    let now = watch.see_changed(&people, |seen| seen[1].size_m.y = f64::INFINITY);
    assert_eq!(now.len(), 2);
}

#[test]
fn tracks_move_along_when_the_estimate_jumps() {
    let mut watch = Watch::new(9);
    let jump = Vector3::new(1.0, -2.0, 0.3);
    let before = watch.see_for(0.5, |_| vec![cylinder(3.0, 0.0)]);
    watch.tracker.shift(&jump);
    assert_eq!(
        watch.tracker.obstacles()[0].centre_world,
        before[0].centre_world + jump
    );
    watch.camera.place += jump.xy();
    let after = watch.see(&[cylinder(4.0, -2.0)]);
    assert_eq!((after.len(), after[0].id), (1, before[0].id));
}

#[test]
fn the_nearest_stay_when_there_is_no_room() {
    let config = TrackerConfig {
        max_tracks: 3,
        ..TrackerConfig::default()
    };
    let mut watch = Watch::new(10);
    watch.tracker = Tracker::new(&config).unwrap();
    let people = [5.5, 4.5, 3.5, 2.5, 2.0].map(|x| cylinder(x, 1.6 - 0.4 * x));
    let now = watch.see_for(0.2, |_| people.to_vec());
    let mut places: Vec<_> = now.iter().map(|o| o.centre_world.x).collect();
    places.sort_by(f64::total_cmp);
    assert_eq!(places.len(), 3);
    assert!(places[2] < 4.0, "{places:?}");
}

#[test]
fn the_same_images_give_the_same_bits() {
    let run = || Watch::new(11).see_for(3.0, |t| vec![cylinder(3.0, t - 1.5), cylinder(2.0, 0.2)]);
    assert_eq!(run(), run());
}
