//! From chains to boxes: what is near each other is one thing, what is long is cut into pieces,
//! and each gets its height, its covariance and its place in the image.

use std::ops::Range;

use alula_geometry::so3;
use alula_messages::{Detection, PixelBox};
use nalgebra::{Matrix3, Vector2, Vector3};

use super::chains::{Chains, Point};
use super::fit::Line;
use super::histogram::{self, LEFT, RIGHT};
use super::level::Level;
use super::shape::{self, End, Front, Shape};
use super::split::Splitter;
use super::{DetectorConfig, empty};

/// Pixels by which the lowest row of a thing may miss the floor: rows are skipped, and the last one
/// may see both.
const FLOOR_PIXELS: f64 = 2.0;

/// Makes boxes of chains.
#[derive(Clone, Debug, Default)]
pub(super) struct Boxes {
    bounds: Vec<Bounds>,
    /// Points of the present group.
    points: Vec<Point>,
    splitter: Splitter,
}

/// Where a chain lies.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    /// First and last column.
    columns: [usize; 2],
    /// Least and greatest depth and position to the right, m.
    depth_m: [f64; 2],
    right_m: [f64; 2],
    /// The chain whose group it belongs to.
    group: usize,
}

impl Boxes {
    pub fn make(
        &mut self,
        chains: &Chains,
        level: &Level,
        config: &DetectorConfig,
        detections: &mut Vec<Detection>,
    ) {
        let most = chains.points.capacity();
        empty(&mut self.bounds, most);
        empty(&mut self.points, most);
        self.splitter.reserve(most);
        self.group(chains, config);
        for group in 0..self.bounds.len() {
            self.gather(group, chains);
            if is_wide_enough(&self.points, level, config) {
                self.box_group(level, config, detections);
            }
        }
    }

    /// Joins compact chains that touch, as long as they remain compact together.
    fn group(&mut self, chains: &Chains, config: &DetectorConfig) {
        for (group, chain) in chains.chains.iter().enumerate() {
            let mut own = Bounds::of(&chains.points[chain.clone()], group);
            for earlier in 0..group {
                let place = self.bounds[earlier].group;
                let other = self.bounds[place];
                if own.touches(&other, config) && own.joint(&other).is_compact(config) {
                    own = own.joint(&other);
                    own.group = place;
                    self.bounds[place] = own;
                    break;
                }
            }
            self.bounds.push(own);
        }
    }

    /// Collects the points of a group, from left to right.
    fn gather(&mut self, group: usize, chains: &Chains) {
        self.points.clear();
        let members = self.bounds.iter().zip(&chains.chains);
        let mut number = 0;
        for (_, chain) in members.filter(|(bounds, _)| bounds.group == group) {
            self.points.extend_from_slice(&chains.points[chain.clone()]);
            number += 1;
        }
        if number > 1 {
            self.points.sort_unstable_by(|a, b| {
                let columns = a.surface.column.cmp(&b.surface.column);
                columns.then(a.at.y.total_cmp(&b.at.y))
            });
        }
    }

    fn box_group(&mut self, level: &Level, config: &DetectorConfig, out: &mut Vec<Detection>) {
        let points = &self.points;
        let Some(line) = Line::fit(points, config.roughness_m) else {
            return;
        };
        match shape::front(&line, points, config) {
            Some(Front::Narrow | Front::Round) => {
                let ends = ends(points);
                if let Some(shape) = shape::round(points, ends, level, config) {
                    out.extend(detection(&shape, points, level, config));
                }
            }
            Some(Front::Flat) => {
                let shape = shape::flat(&line, line.range(points), ends(points), level, config);
                out.extend(detection(&shape, points, level, config));
            }
            Some(Front::Hollow) | None => self.box_fronts(level, config, out),
        }
    }

    /// Boxes of a contour that is not compact: round ones for the fronts that are round, pieces of
    /// walls for what lies between them.
    fn box_fronts(&mut self, level: &Level, config: &DetectorConfig, out: &mut Vec<Detection>) {
        let Self {
            points, splitter, ..
        } = self;
        splitter.divide(points, config);
        let mut done = 0;
        for front in 0..splitter.fronts.len() {
            let range = splitter.fronts[front].clone();
            let Some(round) = round_front(points, &range, level, config) else {
                continue;
            };
            box_walls(points, done..range.start, splitter, level, config, out);
            out.push(round);
            done = range.end;
        }
        box_walls(points, done..points.len(), splitter, level, config, out);
    }
}

/// The box of a part of a contour, if it is compact and round.
fn round_front(
    points: &[Point],
    range: &Range<usize>,
    level: &Level,
    config: &DetectorConfig,
) -> Option<Detection> {
    let part = &points[range.clone()];
    let line = Line::fit(part, config.roughness_m)?;
    // A narrow front is part of what it touches.
    if shape::front(&line, part, config) != Some(Front::Round) {
        return None;
    }
    // It may go on behind what it touches, as behind the border of the image.
    let hidden = [range.start > 0, range.end < points.len()];
    let mut ends = ends(part);
    for (end, _) in ends.iter_mut().zip(hidden).filter(|(_, hidden)| *hidden) {
        *end = End::Cut;
    }
    let shape = shape::round(part, ends, level, config)?;
    let mut found = detection(&shape, part, level, config)?;
    found.cut.left |= hidden[0];
    found.cut.right |= hidden[1];
    Some(found)
}

/// Pieces of walls for a part of a contour.
fn box_walls(
    points: &[Point],
    range: Range<usize>,
    splitter: &mut Splitter,
    level: &Level,
    config: &DetectorConfig,
    out: &mut Vec<Detection>,
) {
    if range.is_empty() {
        return;
    }
    splitter.split(points, range, config);
    for part in &splitter.parts {
        box_part(points, part, level, config, out);
    }
}

impl Bounds {
    fn of(points: &[Point], group: usize) -> Self {
        let none = [f64::INFINITY, f64::NEG_INFINITY];
        let start = Self {
            columns: [usize::MAX, 0],
            depth_m: none,
            right_m: none,
            group,
        };
        points.iter().fold(start, |bounds, point| {
            let column = point.surface.column;
            bounds.joint(&Self {
                columns: [column, column],
                depth_m: [point.at.y - point.excess_m, point.at.y + point.excess_m],
                right_m: [point.at.x, point.at.x],
                group,
            })
        })
    }

    fn joint(&self, other: &Self) -> Self {
        let join = |a: &[f64; 2], b: &[f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self {
            columns: [
                self.columns[0].min(other.columns[0]),
                self.columns[1].max(other.columns[1]),
            ],
            depth_m: join(&self.depth_m, &other.depth_m),
            right_m: join(&self.right_m, &other.right_m),
            group: self.group,
        }
    }

    fn is_compact(&self, config: &DetectorConfig) -> bool {
        let length = |range: [f64; 2]| range[1] - range[0];
        length(self.depth_m).max(length(self.right_m)) <= config.max_box_m
    }

    /// Whether two share columns and lie less than two steps apart in depth.
    fn touches(&self, other: &Self, config: &DetectorConfig) -> bool {
        let overlap = self.columns[0] <= other.columns[1] && other.columns[0] <= self.columns[1];
        let gap_m = (self.depth_m[0] - other.depth_m[1]).max(other.depth_m[0] - self.depth_m[1]);
        overlap && gap_m < 2.0 * config.step_m
    }
}

/// Whether a group is wider than the least width (document L, equation 5-2, with the full width).
fn is_wide_enough(points: &[Point], level: &Level, config: &DetectorConfig) -> bool {
    let depths: f64 = points.iter().map(|point| point.at.y).sum();
    depths / level.columns_per_tan >= config.min_width_m
}

/// What is known of the ends of points.
fn ends(points: &[Point]) -> [End; 2] {
    let flags = points
        .iter()
        .fold(0, |all, p| all | p.surface.support.flags);
    [LEFT, RIGHT].map(|side| {
        if flags & side != 0 {
            End::Cut
        } else {
            End::Seen
        }
    })
}

/// Boxes along a straight part of a long contour.
fn box_part(
    points: &[Point],
    part: &Range<usize>,
    level: &Level,
    config: &DetectorConfig,
    out: &mut Vec<Detection>,
) {
    let points = &points[part.clone()];
    let Some(line) = Line::fit(points, config.roughness_m) else {
        return;
    };
    if !is_wide_enough(points, level, config) {
        return;
    }
    let range = line.range(points);
    let [left, right] = ends(points);
    let (mut from, mut end) = (range.0, left);
    let joints = shape::joints(&line, range, level, config).map(|joint| (joint, End::Joint));
    for (to, next) in joints.chain([(range.1, right)]) {
        let shape = shape::flat(&line, (from, to), [end, next], level, config);
        let members = points.iter().filter(|point| {
            let along = line.along(point);
            along >= from && along <= to
        });
        out.extend(detection(&shape, members, level, config));
        (from, end) = (to, next);
    }
}

/// What the points of a box say beside its shape from above.
struct Summary {
    up_m: f64,
    down_m: f64,
    depth_m: [f64; 2],
    tan: [f64; 2],
    flags: u8,
    pixels: u32,
    variance_m2: f64,
    points: u32,
}

fn summarise<'a>(points: impl IntoIterator<Item = &'a Point>) -> Summary {
    let mut summary = Summary {
        up_m: f64::NEG_INFINITY,
        down_m: f64::INFINITY,
        depth_m: [f64::INFINITY, f64::NEG_INFINITY],
        tan: [f64::INFINITY, f64::NEG_INFINITY],
        flags: 0,
        pixels: 0,
        variance_m2: 0.0,
        points: 0,
    };
    for point in points {
        let tan = point.at.x / point.at.y;
        summary.up_m = summary.up_m.max(point.up_m);
        summary.down_m = summary.down_m.min(point.down_m);
        summary.depth_m[0] = summary.depth_m[0].min(point.at.y - point.excess_m);
        summary.depth_m[1] = summary.depth_m[1].max(point.at.y + point.excess_m);
        summary.tan[0] = summary.tan[0].min(tan);
        summary.tan[1] = summary.tan[1].max(tan);
        summary.flags |= point.surface.support.flags;
        summary.pixels += point.surface.support.count;
        summary.variance_m2 += point.surface.variance_m2;
        summary.points += 1;
    }
    summary
}

/// The box of a shape; `None` without points or beyond the greatest depth.
fn detection<'a>(
    shape: &Shape,
    points: impl IntoIterator<Item = &'a Point>,
    level: &Level,
    config: &DetectorConfig,
) -> Option<Detection> {
    let seen = summarise(points);
    if seen.points == 0 || seen.depth_m[0] > config.max_depth_m {
        return None;
    }
    let cut = histogram::cut(seen.flags);
    let vertical = Vertical::of(&seen, shape.centre.y, level, config);
    let centre_world = level.point_world(&shape.centre, vertical.centre_m);
    let own = Vector3::new(
        shape.centre_variance_m2.x,
        shape.centre_variance_m2.y,
        vertical.centre_variance_m2,
    );
    Some(Detection {
        sensor: level.sensor,
        centre_world,
        yaw_rad: level.heading_rad(&shape.axis),
        size_m: Vector3::new(shape.size_m.x, shape.size_m.y, vertical.size_m),
        footprint: shape.footprint,
        centre_covariance: centre_covariance(&own, &shape.axis, &centre_world, level),
        size_variance_m2: Vector3::new(
            shape.size_variance_m2.x,
            shape.size_variance_m2.y,
            vertical.size_variance_m2,
        ),
        cut,
        window: window(&seen, level),
        depth_m: seen.depth_m,
        pixels: seen.pixels,
    })
}

/// Height of a box: its middle above the camera, its length, and their variances.
struct Vertical {
    centre_m: f64,
    size_m: f64,
    centre_variance_m2: f64,
    size_variance_m2: f64,
}

impl Vertical {
    /// A thing that reaches down to where the floor was taken out stands on the floor.
    fn of(seen: &Summary, depth_m: f64, level: &Level, config: &DetectorConfig) -> Self {
        let cut = histogram::cut(seen.flags);
        let pixel_m = depth_m / level.camera.fy_px;
        let pitch_m = f64::from(config.row_stride) * pixel_m;
        let mean_m2 = seen.variance_m2 / f64::from(seen.points);
        // An end keeps its elevation where its depth is wrong.
        let slide_m2 = |height_m: f64| (height_m / depth_m).powi(2) * mean_m2;
        let end = |is_cut: bool| if is_cut { End::Cut } else { End::Seen };
        let up_m2 = shape::end_variance_m2(end(cut.top), pitch_m, config) + slide_m2(seen.up_m);
        let reach_m = histogram::floor_margin_m(depth_m, level, config) + FLOOR_PIXELS * pitch_m;
        let floor_m = level.above_floor_m.map(|height_m| -height_m);
        let floor_m = floor_m.filter(|floor_m| seen.down_m < floor_m + reach_m);
        let down_m = floor_m.unwrap_or(seen.down_m);
        let down_m2 = match floor_m {
            Some(_) => config.roughness_m * config.roughness_m,
            None => {
                shape::end_variance_m2(end(cut.bottom), pitch_m, config) + slide_m2(seen.down_m)
            }
        };
        Self {
            centre_m: 0.5 * (seen.up_m + down_m),
            size_m: (seen.up_m - down_m).max(pixel_m),
            centre_variance_m2: 0.25 * (up_m2 + down_m2),
            size_variance_m2: up_m2 + down_m2,
        }
    }
}

/// Covariance of a centre in the world (the paper's equation 3 as corrected): `R S R^T` of the
/// box's own axes, and `[p]x S_att [p]x^T` with `p` from the vehicle to the centre.
fn centre_covariance(
    own: &Vector3<f64>,
    axis: &Vector2<f64>,
    centre_world: &Vector3<f64>,
    level: &Level,
) -> Matrix3<f64> {
    let along = level.direction_world(axis);
    let up = Vector3::z();
    let axes = Matrix3::from_columns(&[along, up.cross(&along), up]);
    let lever = so3::skew(&(centre_world - level.body_world));
    let covariance = axes * Matrix3::from_diagonal(own) * axes.transpose()
        + lever * level.orientation_world * lever.transpose();
    0.5 * (covariance + covariance.transpose())
}

/// The part of the image that holds the corners of a box's front.
fn window(seen: &Summary, level: &Level) -> PixelBox {
    let near_m = seen.depth_m[0].max(0.05);
    let far_m = seen.depth_m[1].max(near_m);
    let camera = &level.camera;
    let camera_from_level = level.level_from_camera.transpose();
    let (mut low, mut high) = (
        Vector2::repeat(f64::INFINITY),
        Vector2::repeat(-f64::INFINITY),
    );
    for tan in seen.tan {
        for (height_m, depth_m) in [
            (seen.up_m, if seen.up_m > 0.0 { near_m } else { far_m }),
            (seen.down_m, if seen.down_m < 0.0 { near_m } else { far_m }),
        ] {
            let ray = camera_from_level * Vector3::new(tan, -height_m / depth_m, 1.0);
            if let Some(pixel) = camera.project(&ray.into()) {
                low = low.inf(&pixel.coords);
                high = high.sup(&pixel.coords);
            }
        }
    }
    // Casts of floats saturate.
    let last = [camera.width_px - 1, camera.height_px - 1].map(f64::from);
    PixelBox {
        left: low.x.clamp(0.0, last[0]).round() as u16,
        right: high.x.clamp(0.0, last[0]).round() as u16,
        top: low.y.clamp(0.0, last[1]).round() as u16,
        bottom: high.y.clamp(0.0, last[1]).round() as u16,
    }
}
