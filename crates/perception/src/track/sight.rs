//! Whether a track that was not detected should have been: what the contour says about its place.

use std::f64::consts::TAU;

use alula_messages::Footprint;
use nalgebra::{Vector2, Vector3};

use super::followed::Track;
use crate::{Contour, Ray, RayEnd};

/// Places across a track at which the view is asked.
const SAMPLES: usize = 5;

/// What one image says about the place where a track should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum View {
    /// It does not show the place.
    Outside,
    /// Something nearer hides the place, or nothing is known of it.
    Hidden,
    /// Something ends the view there.
    Doubtful,
    /// The view is free beyond.
    Clear,
}

/// The view of a track's place: the verdict of most samples across it, if the image shows most of
/// them. Free only if all of them are, over the width and the uncertainty of the position.
pub(super) fn view(contour: &Contour, track: &Track, margin_m: f64) -> View {
    let mut count = [0_usize; 4];
    for_samples(contour, track, |place| {
        let view = view_of_place(contour, &place, margin_m);
        count[view as usize] += 1;
    });
    let shown = SAMPLES - count[View::Outside as usize];
    if 2 * shown <= SAMPLES {
        return View::Outside;
    }
    if count[View::Clear as usize] == shown {
        return View::Clear;
    }
    if count[View::Hidden as usize] > count[View::Doubtful as usize] {
        return View::Hidden;
    }
    View::Doubtful
}

/// A place on a track and how far it reaches in the line of sight.
struct Place {
    point_world: Vector3<f64>,
    reach_m: f64,
}

fn for_samples(contour: &Contour, track: &Track, mut ask: impl FnMut(Place)) {
    let centre = track.position();
    let sight = (centre - contour.camera_world).xy();
    let Some(sight) = sight.try_normalize(1e-6) else {
        return (0..SAMPLES).for_each(|_| {
            ask(Place {
                point_world: centre,
                reach_m: f64::INFINITY,
            });
        });
    };
    let left = Vector2::new(-sight.y, sight.x);
    let (direction, half_width, reach) = match track.footprint {
        // Inwards of the rim, where rays pass by; outwards by where it may be.
        Footprint::Round => {
            let half_width = 0.6 * track.reach_m(&left) + track.state.position_sigma_along_m(&left);
            let reach = track.reach_m(&sight) + track.state.position_sigma_along_m(&sight);
            (left, half_width, reach)
        }
        Footprint::Flat => {
            let (sin, cos) = track.yaw_rad.sin_cos();
            let across = 0.5 * track.size().y + track.state.position_sigma_along_m(&sight);
            (Vector2::new(cos, sin), 0.4 * track.size().x, across)
        }
    };
    for i in 0..SAMPLES {
        let share = 2.0 * i as f64 / (SAMPLES - 1) as f64 - 1.0;
        let offset = direction * (share * half_width);
        ask(Place {
            point_world: centre + Vector3::new(offset.x, offset.y, 0.0),
            reach_m: reach,
        });
    }
}

fn view_of_place(contour: &Contour, place: &Place, margin_m: f64) -> View {
    let offset = (place.point_world - contour.camera_world).xy();
    let Some(ray) = ray_towards(contour, offset.y.atan2(offset.x)) else {
        return View::Outside;
    };
    let distance = offset.norm();
    match ray.end {
        RayEnd::Unknown => View::Hidden,
        _ if ray.range_m > distance + place.reach_m + margin_m => View::Clear,
        // A free ray that ends short shows ground or nothing at all: no evidence for a thing.
        RayEnd::Free => View::Hidden,
        RayEnd::Hit if ray.range_m < distance - place.reach_m - margin_m => View::Hidden,
        RayEnd::Hit => View::Doubtful,
    }
}

/// The ray nearest to a heading, if the image covers it. Headings fall from ray to ray.
fn ray_towards(contour: &Contour, heading_rad: f64) -> Option<&Ray> {
    let rays = contour.rays.as_slice();
    let (first, last) = (rays.first()?, rays.last()?);
    let clockwise = |ray: &Ray| (first.heading_rad - ray.heading_rad).rem_euclid(TAU);
    let wanted = (first.heading_rad - heading_rad).rem_euclid(TAU);
    let is_covered = wanted <= clockwise(last);
    if !is_covered {
        return None;
    }
    let after = rays.partition_point(|ray| clockwise(ray) < wanted);
    let before = after.saturating_sub(1);
    let gap = |i: usize| (clockwise(&rays[i]) - wanted).abs();
    Some(
        &rays[if after < rays.len() && gap(after) < gap(before) {
            after
        } else {
            before
        }],
    )
}
