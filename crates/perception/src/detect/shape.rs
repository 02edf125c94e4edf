//! Shapes seen from above: what a group of points is taken for.

use alula_messages::Footprint;
use nalgebra::Vector2;

use super::DetectorConfig;
use super::chains::Point;
use super::fit::{Arc, Line};
use super::level::Level;

/// A front narrower than this, m, is not told flat from round.
const NARROW_M: f64 = 0.25;
/// A remainder shorter than this share of a piece stays with its neighbour.
const SHORTEST_SHARE: f64 = 0.3;

/// What is known of an end of a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// It is seen to a column.
    Seen,
    /// The surface goes on in the next piece.
    Joint,
    /// The image ends there.
    Cut,
}

/// A rectangle around a shape seen from above: (right, ahead) in the level view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub footprint: Footprint,
    pub centre: Vector2<f64>,
    /// Unit, along the box's own x axis.
    pub axis: Vector2<f64>,
    /// Full lengths along and across the axis, m.
    pub size_m: Vector2<f64>,
    /// Variances of the centre along and across the axis, and of the lengths, m^2.
    pub centre_variance_m2: Vector2<f64>,
    pub size_variance_m2: Vector2<f64>,
}

/// How the points of a compact thing lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Front {
    /// Too narrow to be told flat from round.
    Narrow,
    Round,
    Flat,
    /// An inner corner, or more than one surface.
    Hollow,
}

/// Length and depth, m, of the smallest upright rectangle around points along their main axis.
fn extent_m(line: &Line, points: &[Point]) -> (f64, f64) {
    let (low, high) = line.range(points);
    let behind = points.iter().map(|point| line.behind(point));
    let (near, far) = behind.fold((f64::INFINITY, f64::NEG_INFINITY), |(near, far), b| {
        (near.min(b), far.max(b))
    });
    (high - low, far - near)
}

/// The front of a compact thing; `None` for what is too long or too deep for one.
pub(super) fn front(line: &Line, points: &[Point], config: &DetectorConfig) -> Option<Front> {
    let (length_m, depth_m) = extent_m(line, points);
    if length_m > config.max_box_m || depth_m > config.max_box_m {
        return None;
    }
    if length_m < NARROW_M {
        return Some(Front::Narrow);
    }
    let least_m = config.round_share * length_m;
    let sagitta_m = line.sagitta_m(points);
    Some(if sagitta_m < -least_m {
        Front::Hollow
    } else if sagitta_m < least_m && line.excess_m2 < 0.25 * config.bend_m * config.bend_m {
        Front::Flat
    } else {
        Front::Round
    })
}

/// Variance of where a thing ends between two columns or rows `pitch_m` apart: the last one that
/// is seen may be one too few or too many.
pub(super) fn end_variance_m2(end: End, pitch_m: f64, config: &DetectorConfig) -> f64 {
    let seen_m2 = pitch_m * pitch_m / 3.0;
    match end {
        End::Seen => seen_m2,
        End::Joint => seen_m2 + config.bend_m * config.bend_m / 4.0,
        End::Cut => seen_m2 + config.unseen_m * config.unseen_m,
    }
}

/// The ellipse of a round front, mended behind (document L, equations 5-3 to 5-6).
pub(super) fn round(
    points: &[Point],
    ends: [End; 2],
    level: &Level,
    config: &DetectorConfig,
) -> Option<Shape> {
    let half_column = 0.5 / level.columns_per_tan;
    let arc = Arc::fit(points, half_column, config.roughness_m)?;
    let excess_m2 = arc.excess_m2(points, config.roughness_m);
    let half_depth_m = arc.half_depth_m + excess_m2.sqrt();
    let pitch_m = arc.distance_m / level.columns_per_tan;
    let [left, right] = ends.map(|end| end_variance_m2(end, pitch_m, config));
    let rough_m2 = 0.25 * config.roughness_m * config.roughness_m;
    Some(Shape {
        footprint: Footprint::Round,
        centre: arc.sight * arc.distance_m,
        axis: Vector2::new(arc.sight.y, -arc.sight.x),
        size_m: 2.0 * Vector2::new(arc.half_width_m, half_depth_m),
        centre_variance_m2: Vector2::new(
            0.25 * (left + right),
            arc.covariance[(0, 0)] + rough_m2 + excess_m2 / points.len() as f64,
        ),
        size_variance_m2: Vector2::new(
            left + right,
            4.0 * (arc.covariance[(1, 1)] + rough_m2) + excess_m2,
        ),
    })
}

/// The part of a line from `low` to `high` (m from its centre), its face on the line.
pub(super) fn flat(
    line: &Line,
    (low, high): (f64, f64),
    ends: [End; 2],
    level: &Level,
    config: &DetectorConfig,
) -> Shape {
    let middle = 0.5 * (low + high);
    let excess_m = line.excess_m2.sqrt();
    let thickness_m = config.thickness_m + 2.0 * excess_m;
    let on_line = line.centre + line.direction * middle;
    let centre = on_line + line.away() * (0.5 * thickness_m - excess_m);
    // Of a column's width in tangent the length along the line, seen at its angle.
    let facing = (line.away().dot(&on_line) / on_line.norm()).abs().max(0.2);
    let pitch_m = on_line.norm() / level.columns_per_tan / facing;
    let [left, right] = ends.map(|end| end_variance_m2(end, pitch_m, config));
    let across_m2 = line.variance_m2 + line.angle_variance_rad2 * middle * middle;
    let rough_m2 = 0.25 * config.roughness_m * config.roughness_m;
    Shape {
        footprint: Footprint::Flat,
        centre,
        axis: line.direction,
        size_m: Vector2::new(high - low + pitch_m, thickness_m),
        centre_variance_m2: Vector2::new(0.25 * (left + right), across_m2 + rough_m2),
        size_variance_m2: Vector2::new(left + right, 4.0 * rough_m2 + 4.0 * line.excess_m2),
    }
}

/// Borders between the pieces of a line from `low` to `high`: at whole pieces from the foot of the
/// world's origin, so that the pieces of a wall are the same in every image.
pub(super) fn joints(
    line: &Line,
    (low, high): (f64, f64),
    level: &Level,
    config: &DetectorConfig,
) -> impl Iterator<Item = f64> + use<> {
    let piece_m = config.piece_m;
    let origin = level.world_from_level.transpose() * -level.camera_world;
    let foot = (Vector2::new(origin.x, origin.z) - line.centre).dot(&line.direction);
    let shortest_m = SHORTEST_SHARE * piece_m;
    let first = ((low + shortest_m - foot) / piece_m).ceil();
    let last = ((high - shortest_m - foot) / piece_m).floor();
    let count = if last >= first {
        (last - first) as usize + 1
    } else {
        0
    };
    (0..count).map(move |k| foot + (first + k as f64) * piece_m)
}
