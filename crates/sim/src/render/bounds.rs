//! Which pixels a piece of surface covers.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::patch::{row_form, row_quadratic};

/// Rays d of a piece: all of these linear forms of d are non-negative.
pub(super) type HalfSpaces = [Vector3<f64>];

/// A closed interval of the x or y of rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Interval {
    pub low: f64,
    pub high: f64,
}

impl Interval {
    pub const ALL: Self = Self {
        low: f64::NEG_INFINITY,
        high: f64::INFINITY,
    };
    const NONE: Self = Self {
        low: f64::INFINITY,
        high: f64::NEG_INFINITY,
    };

    /// The x of a row within all half-spaces.
    pub fn within(half_spaces: &HalfSpaces, y: f64) -> Self {
        let mut interval = Self::ALL;
        for form in half_spaces {
            let (slope, start) = row_form(form, y);
            let edge = -start / slope;
            if slope > 0.0 {
                interval.low = interval.low.max(edge);
            } else if slope < 0.0 {
                interval.high = interval.high.min(edge);
            } else if start < 0.0 {
                return Self::NONE;
            }
        }
        interval
    }

    /// The x of a row with d' F d >= 0, in two pieces.
    pub fn where_not_negative(form: &Matrix3<f64>, y: f64) -> [Self; 2] {
        let (a, b, c) = row_quadratic(form, y);
        not_negative(a, 0.5 * b, c)
    }

    /// Indices below `count` of the pixels whose coordinate (index - c) / f lies in the interval.
    pub fn indices(self, f: f64, c: f64, count: usize) -> Range<usize> {
        let first = (self.low * f + c).ceil().max(0.0);
        let last = (self.high * f + c).floor().min(count as f64 - 1.0);
        if first <= last {
            first as usize..last as usize + 1
        } else {
            0..0
        }
    }
}

/// The x with a x^2 + 2 b x + c >= 0, in two pieces.
fn not_negative(a: f64, b: f64, c: f64) -> [Interval; 2] {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        let piece = if c >= 0.0 {
            Interval::ALL
        } else {
            Interval::NONE
        };
        return [piece, Interval::NONE];
    }
    let q = -(b + b.signum() * discriminant.sqrt());
    let (one, other) = (q / a, c / q);
    let (low, high) = (one.min(other), one.max(other));
    if !low.is_finite() || !high.is_finite() {
        return [linear_not_negative(b, c), Interval::NONE];
    }
    if a < 0.0 {
        return [Interval { low, high }, Interval::NONE];
    }
    [
        Interval {
            low: f64::NEG_INFINITY,
            high: low,
        },
        Interval {
            low: high,
            high: f64::INFINITY,
        },
    ]
}

/// The x with 2 b x + c >= 0.
fn linear_not_negative(b: f64, c: f64) -> Interval {
    Interval::within(&[Vector3::new(2.0 * b, 0.0, c)], 0.0)
}

/// The y of a body's silhouette d' F d = 0, in two pieces: where the quadratic in x has roots.
pub(super) fn silhouette_rows(form: &Matrix3<f64>) -> [Interval; 2] {
    let f = |i, j| form[(i, j)];
    if f(0, 0) >= 0.0 {
        return [Interval::ALL, Interval::NONE];
    }
    not_negative(
        f(0, 1) * f(0, 1) - f(0, 0) * f(1, 1),
        f(0, 1) * f(0, 2) - f(0, 0) * f(1, 2),
        f(0, 2) * f(0, 2) - f(0, 0) * f(2, 2),
    )
}

/// The y over which a polygon extends; all if a corner lies behind the camera.
pub(super) fn polygon_rows(corners: &[Vector3<f64>]) -> Interval {
    let mut ys = Interval::NONE;
    for corner in corners {
        if corner.z <= 0.0 {
            return Interval::ALL;
        }
        let y = corner.y / corner.z;
        ys.low = ys.low.min(y);
        ys.high = ys.high.max(y);
    }
    ys
}

/// Half-spaces that contain all rays to the side of a cylinder; `None` from inside it.
///
/// `axis` is the point of the axis at the camera's height, `low` and `high` are the heights of the
/// ends over the camera, along `up`. Two of the half-spaces touch the cylinder along its length. The
/// part that turns to the camera is between rho - r and rho - r^2 / rho away, along the horizontal
/// direction to the axis, so that height over this distance is bounded by that of the ends.
pub(super) fn of_cylinder_side(
    axis: &Vector3<f64>,
    up: &Vector3<f64>,
    radius_m: f64,
    (low, high): (f64, f64),
) -> Option<[Vector3<f64>; 4]> {
    let distance = axis.norm();
    if distance <= radius_m {
        return None;
    }
    let sine = radius_m / distance;
    let cosine = (1.0 - sine * sine).sqrt();
    let towards = axis / distance;
    let across = up.cross(&towards);
    let (near, far) = (distance - radius_m, distance - radius_m * sine);
    let most = high / if high > 0.0 { near } else { far };
    let least = low / if low > 0.0 { far } else { near };
    let free = towards * sine;
    Some([
        free + across * cosine,
        free - across * cosine,
        if high.is_finite() {
            towards * most - up
        } else {
            free
        },
        if low.is_finite() {
            up - towards * least
        } else {
            free
        },
    ])
}
