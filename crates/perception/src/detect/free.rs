//! How far the view is free, from the surfaces and the seen floor of the columns.

use alula_messages::DepthImage;
use nalgebra::Vector2;

use super::DetectorConfig;
use super::columns::{Columns, Surface};
use super::histogram::Histogram;
use super::level::Level;
use crate::{Contour, Ray, RayEnd};

/// Fills the rays of a contour.
pub(super) fn look(
    contour: &mut Contour,
    image: &DepthImage,
    map: &Histogram,
    columns: &Columns,
    level: &Level,
    config: &DetectorConfig,
) {
    contour.time = image.time;
    contour.sensor = image.sensor;
    contour.camera_world = level.camera_world;
    contour.rays.clear();
    let rays = config.rays as usize;
    let border = |ray: usize| ray * level.columns / rays;
    for ray in 0..rays {
        let range = border(ray)..border(ray + 1).max(border(ray) + 1).min(level.columns);
        let tan = 0.5 * (level.tan(range.start) + level.tan(range.end.max(1) - 1));
        let mut hit_m = f64::INFINITY;
        let mut seen_m: Option<f64> = None;
        for column in range {
            let hits = columns
                .of(column)
                .iter()
                .filter(|s| matters(s, level, config));
            hit_m = hits.fold(hit_m, |least, s| least.min(s.support.depth_m));
            seen_m = seen_m
                .into_iter()
                .chain(map.seen_m(column))
                .reduce(f64::max);
        }
        contour.rays.push(end(tan, hit_m, seen_m, level, config));
    }
}

fn end(tan: f64, hit_m: f64, seen_m: Option<f64>, level: &Level, config: &DetectorConfig) -> Ray {
    let (depth_m, end) = match seen_m {
        _ if hit_m <= config.max_depth_m => (hit_m, RayEnd::Hit),
        Some(seen_m) => (seen_m.min(config.max_depth_m), RayEnd::Free),
        None => (0.0, RayEnd::Unknown),
    };
    Ray {
        heading_rad: level.heading_rad(&Vector2::new(tan, 1.0)),
        range_m: depth_m * tan.hypot(1.0),
        end,
    }
}

/// Whether a surface stands at heights at which the vehicle may fly.
fn matters(surface: &Surface, level: &Level, config: &DetectorConfig) -> bool {
    let (from_m, to_m) = match level.above_floor_m {
        Some(height_m) => (config.free_from_m - height_m, config.free_to_m - height_m),
        None => (-config.free_about_m, config.free_about_m),
    };
    let support = &surface.support;
    support.up_tan * support.depth_m >= from_m && support.down_tan * support.depth_m <= to_m
}
