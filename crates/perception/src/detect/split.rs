//! Long contours into fronts between inner corners, and into straight pieces by split and merge.

use std::ops::Range;

use super::chains::Point;
use super::fit::Line;
use super::{DetectorConfig, empty};

/// Standard deviations of noise that a point may lie off its line.
const NOISE_SIGMAS: f64 = 2.5;

/// An inner corner lies behind the hull of a front by at least this share of what bends a line.
const CORNER_SHARE: f64 = 0.5;

/// Cuts contours where they bend.
#[derive(Clone, Debug, Default)]
pub(super) struct Splitter {
    open: Vec<Range<usize>>,
    /// Points on the hull of a front.
    hull: Vec<usize>,
    /// Parts of the last contour between its inner corners, from left to right; none without a
    /// corner.
    pub fronts: Vec<Range<usize>>,
    /// Straight parts of the last contour, from left to right.
    pub parts: Vec<Range<usize>>,
}

impl Splitter {
    /// Takes the memory for the parts of so many points.
    pub fn reserve(&mut self, points: usize) {
        empty(&mut self.open, points);
        empty(&mut self.hull, points);
        empty(&mut self.fronts, points);
        empty(&mut self.parts, points);
    }

    /// Finds the fronts of a contour: where two things touch, as people do who walk abreast, their
    /// fronts meet in an inner corner.
    pub fn divide(&mut self, points: &[Point], config: &DetectorConfig) {
        self.fronts.clear();
        self.open.clear();
        self.open.push(0..points.len());
        while let Some(range) = self.open.pop() {
            self.span(points, &range);
            match inner_corner(points, &self.hull, config) {
                Some(at) => {
                    self.open.push(at..range.end);
                    self.open.push(range.start..at);
                }
                None if range.len() < points.len() => self.fronts.push(range),
                None => {}
            }
        }
    }

    /// The hull of a front on the side of the camera: a string drawn tight before it.
    fn span(&mut self, points: &[Point], range: &Range<usize>) {
        self.hull.clear();
        for place in range.clone() {
            while let [.., a, b] = self.hull[..] {
                let (from, middle, to) = (points[a].at, points[b].at, points[place].at);
                if (middle - from).perp(&(to - middle)) > 0.0 {
                    break;
                }
                self.hull.pop();
            }
            self.hull.push(place);
        }
    }

    /// Finds the straight parts of `range` of the points of a chain.
    pub fn split(&mut self, points: &[Point], range: Range<usize>, config: &DetectorConfig) {
        self.parts.clear();
        self.open.clear();
        self.open.push(range);
        while let Some(range) = self.open.pop() {
            match bend(points, &range, config) {
                // The last pushed is done first: parts come from left to right.
                Some(at) => {
                    self.open.push(at..range.end);
                    self.open.push(range.start..at);
                }
                None => self.parts.push(range),
            }
        }
        self.merge(points, config);
    }

    /// Joins neighbours that are straight together.
    fn merge(&mut self, points: &[Point], config: &DetectorConfig) {
        let mut kept = 0;
        for part in 1..self.parts.len() {
            let joint = self.parts[kept].start..self.parts[part].end;
            if is_straight(&points[joint.clone()], config) {
                self.parts[kept] = joint;
            } else {
                kept += 1;
                self.parts[kept] = self.parts[part].clone();
            }
        }
        self.parts.truncate(kept + 1);
    }
}

fn tolerance_m(point: &Point, config: &DetectorConfig) -> f64 {
    config.bend_m + NOISE_SIGMAS * point.surface.variance_m2.sqrt()
}

fn is_straight(points: &[Point], config: &DetectorConfig) -> bool {
    Line::fit(points, config.roughness_m).is_none_or(|line| {
        let mut points = points.iter();
        points.all(|point| line.behind(point).abs() <= tolerance_m(point, config))
    })
}

/// The deepest point behind the hull of a front, if it is a corner.
fn inner_corner(points: &[Point], hull: &[usize], config: &DetectorConfig) -> Option<usize> {
    let mut deepest = None;
    let mut most = 1.0;
    for edge in hull.windows(2) {
        let from = points[edge[0]].at;
        let along = points[edge[1]].at - from;
        let length = along.norm();
        for place in edge[0] + 1..edge[1] {
            let behind_m = along.perp(&(points[place].at - from)) / length;
            let least_m = CORNER_SHARE * config.bend_m;
            // Most points lie too near the string even without noise, whose root takes time.
            if behind_m <= most * least_m {
                continue;
            }
            let noise_m = NOISE_SIGMAS * points[place].surface.variance_m2.sqrt();
            let share = behind_m / (least_m + noise_m);
            if share > most {
                (most, deepest) = (share, Some(place));
            }
        }
    }
    deepest
}

/// Where a contour is cut: at the point farthest from the chord of its ends, unless it is straight.
fn bend(points: &[Point], range: &Range<usize>, config: &DetectorConfig) -> Option<usize> {
    if range.len() < 4 || is_straight(&points[range.clone()], config) {
        return None;
    }
    let from = points[range.start].at;
    let chord = points[range.end - 1].at - from;
    let length = chord.norm();
    let off = |place: usize| {
        let d = points[place].at - from;
        (chord.perp(&d) / length).abs() / tolerance_m(&points[place], config)
    };
    (range.start + 1..range.end - 1)
        .map(|place| (off(place), place))
        .filter(|(off, _)| off.is_finite())
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, place)| place)
}
