//! Pieces of walls: they stand, and along the wall their ends say nothing.
//!
//! A wall is cut into pieces at other places in every image. A piece is therefore followed across
//! its surface only (a Kalman filter of one number, and a mean of the heading); along the surface
//! the newest piece replaces what it covers, and what the image cuts off or hides stays as it was.

use alula_geometry::Timestamp;
use alula_messages::{Detection, Footprint, ObstacleMotion};
use nalgebra::{Vector2, Vector3};

use super::config::{FlatConfig, TrackModelConfig};
use super::faces::Faces;
use super::followed::Track;
use super::kalman::{POSITION, SIZE};

/// A stretch along an axis, m.
#[derive(Clone, Copy)]
struct Span {
    low: f64,
    high: f64,
}

impl Span {
    fn length(self) -> f64 {
        self.high - self.low
    }

    fn overlap(self, other: Self) -> f64 {
        (self.high.min(other.high) - self.low.max(other.low)).max(0.0)
    }
}

/// A detected piece as a frame: origin at its centre, first axis along it.
struct Frame {
    yaw_rad: f64,
    origin: Vector2<f64>,
    along: Vector2<f64>,
    normal: Vector2<f64>,
}

impl Frame {
    fn at(origin: Vector3<f64>, yaw_rad: f64) -> Self {
        let along = Vector2::new(yaw_rad.cos(), yaw_rad.sin());
        Self {
            yaw_rad,
            origin: origin.xy(),
            along,
            normal: Vector2::new(-along.y, along.x),
        }
    }

    fn span_of(&self, track: &Track) -> Span {
        let centre = self.along.dot(&(track.position().xy() - self.origin));
        let (sin, cos) = track.yaw_rad.sin_cos();
        let half = 0.5 * track.size().x * self.along.dot(&Vector2::new(cos, sin)).abs();
        Span {
            low: centre - half,
            high: centre + half,
        }
    }
}

fn span_of_detection(detection: &Detection) -> Span {
    Span {
        low: -0.5 * detection.size_m.x,
        high: 0.5 * detection.size_m.x,
    }
}

/// Angle between two lines, in (-pi/2, pi/2], rad.
fn turn_between_lines(from_rad: f64, to_rad: f64) -> f64 {
    let turn = to_rad - from_rad;
    turn - std::f64::consts::PI * (turn / std::f64::consts::PI).round()
}

/// Squared Mahalanobis distance across the surface, if the pieces lie in one surface and overlap;
/// and the length in which they overlap, m.
fn match_across(
    track: &Track,
    detection: &Detection,
    config: &FlatConfig,
    gate: f64,
) -> Option<(f64, f64)> {
    let turn = turn_between_lines(track.yaw_rad, detection.yaw_rad);
    if turn.abs() > config.max_angle_deg.to_radians() {
        return None;
    }
    let frame = Frame::at(detection.centre_world, detection.yaw_rad);
    // A turned piece is further off at its ends: measured in the middle of the overlap.
    let (piece, seen) = (frame.span_of(track), span_of_detection(detection));
    let middle = 0.5 * (piece.low.max(seen.low) + piece.high.min(seen.high));
    let centre = track.position().xy() - frame.origin;
    let slope = turn.tan();
    let offset = frame.normal.dot(&centre) - slope * (middle - frame.along.dot(&centre));
    let distance = offset * offset / offset_variance(track, detection, &frame.normal);
    let near = offset.abs() <= config.max_offset_m || distance <= gate;
    let overlap = piece.overlap(seen);
    (near && overlap > 0.0).then_some((distance, overlap))
}

fn offset_variance(track: &Track, detection: &Detection, normal: &Vector2<f64>) -> f64 {
    let block = detection.centre_covariance.fixed_view::<2, 2>(0, 0);
    let measured = normal.dot(&(block * normal)).max(0.0);
    (track.state.position_sigma_along_m(normal).powi(2) + measured).max(1e-9)
}

/// Cost of a pair of flat track and flat detection: how far apart across the surface, and how
/// much of the shorter one lies apart; infinite if they do not match.
pub(super) fn cost(track: &Track, detection: &Detection, config: &FlatConfig, gate: f64) -> f64 {
    let shorter = track.size().x.min(detection.size_m.x).max(1e-6);
    match match_across(track, detection, config, gate) {
        Some((distance, overlap)) if overlap >= config.min_overlap * shorter => {
            let longer = track.size().x.max(detection.size_m.x).max(1e-6);
            0.5 * distance.min(gate) + 10.0 * (1.0 - overlap / longer)
        }
        _ => f64::INFINITY,
    }
}

/// Length of a flat track that a detection covers, m.
pub(super) fn covered_m(
    track: &Track,
    detection: &Detection,
    config: &FlatConfig,
    gate: f64,
) -> f64 {
    match_across(track, detection, config, gate).map_or(0.0, |(_, overlap)| overlap)
}

/// Moves a flat track to the piece that was just seen.
pub(super) fn update(
    track: &mut Track,
    time: Timestamp,
    detection: &Detection,
    faces: &Faces,
    config: &FlatConfig,
    model: &TrackModelConfig,
) {
    let turn = turn_between_lines(track.yaw_rad, detection.yaw_rad);
    let weight = 1.0 / f64::from(config.yaw_images.min(track.images + 1));
    let yaw = track.yaw_rad + weight * turn;
    let frame = Frame::at(detection.centre_world, yaw);
    let span = joined_span(&frame, track, detection, faces, config);
    let height = joined_height(track, faces);
    // Across: filtered, between the track's centre and the detection's. With the weight
    // w = R / (P + R) of the prediction, the variance becomes w P.
    let before = track.position().xy() - frame.origin;
    let variance = track.state.position_sigma_along_m(&frame.normal).powi(2);
    let prior_weight =
        (1.0 - variance / offset_variance(track, detection, &frame.normal)).clamp(0.0, 1.0);
    let across = frame.normal.dot(&before) * prior_weight;
    let middle =
        frame.origin + frame.along * (0.5 * (span.low + span.high)) + frame.normal * across;
    let mut next = Track::new(track.id, time, Footprint::Flat, faces, model);
    next.state.mean[POSITION] = middle.x;
    next.state.mean[POSITION + 1] = middle.y;
    next.state.mean[POSITION + 2] = 0.5 * (height.low + height.high);
    next.state.mean[SIZE] = span.length();
    next.state.mean[SIZE + 2] = height.length();
    scale_across(&mut next, &frame.normal, variance * prior_weight);
    next.yaw_rad = yaw;
    next.images = track.images;
    next.motion = ObstacleMotion::Static;
    *track = next;
    track.mark_seen(time);
}

/// Gives the position the variance `variance` across the surface, by a congruence.
fn scale_across(track: &mut Track, normal: &Vector2<f64>, variance: f64) {
    let now = track.state.position_sigma_along_m(normal).powi(2);
    if now <= 1e-12 {
        return;
    }
    let change = (variance / now).sqrt() - 1.0;
    let mut factor = nalgebra::Matrix3::identity();
    for i in 0..2 {
        for j in 0..2 {
            factor[(i, j)] += change * normal[i] * normal[j];
        }
    }
    let covariance = &mut track.state.covariance;
    let rows = factor * covariance.fixed_rows::<3>(POSITION);
    covariance.fixed_rows_mut::<3>(POSITION).copy_from(&rows);
    let columns = covariance.fixed_columns::<3>(POSITION) * factor.transpose();
    covariance
        .fixed_columns_mut::<3>(POSITION)
        .copy_from(&columns);
    track.state.symmetrise();
}

/// The seen stretch, and beyond an end that the image does not show what was there before.
fn joined_span(
    frame: &Frame,
    track: &Track,
    detection: &Detection,
    faces: &Faces,
    config: &FlatConfig,
) -> Span {
    let (piece, mut span) = (frame.span_of(track), span_of_detection(detection));
    // A line has no direction: track and detection may point opposite ways.
    let flipped = usize::from((faces.yaw_rad - frame.yaw_rad).cos() < 0.0);
    let room = (config.max_length_m - span.length()).max(0.0);
    if !faces.shown[flipped] {
        span.low = piece.low.clamp(span.low - room, span.low);
    }
    let room = (config.max_length_m - span.length()).max(0.0);
    if !faces.shown[1 - flipped] {
        span.high = piece.high.clamp(span.high, span.high + room);
    }
    span
}

fn joined_height(track: &Track, faces: &Faces) -> Span {
    let half = 0.5 * track.size().z;
    let mut span = Span {
        low: faces.places[4],
        high: faces.places[5],
    };
    if !faces.shown[4] {
        span.low = span.low.min(track.position().z - half);
    }
    if !faces.shown[5] {
        span.high = span.high.max(track.position().z + half);
    }
    span
}
