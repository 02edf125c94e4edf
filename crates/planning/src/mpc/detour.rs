//! The way round an obstacle that stands between the vehicle and its target.
//!
//! Within its horizon the program cannot tell that going sideways pays: a vehicle that faces an
//! obstacle squarely stands still before it, at a stationary point. When a plan comes to a halt
//! before an obstacle that blocks the straight way, the plans after it aim past the obstacle, on
//! one side, until the straight way is free.

use nalgebra::{Vector2, Vector3};

use super::keepout::Keepout;

/// Free space beside the volume at the point to pass, m.
const GAP_M: f64 = 0.3;
/// Obstacles wider than this are left to the planner of routes, m.
const MAX_REACH_M: f64 = 3.0;
/// The way to the point to pass counts as longer by this for every other obstacle on the point, m.
const OCCUPIED_M: f64 = 5.0;
/// Places at which a straight way is held against an obstacle.
const SAMPLES: usize = 16;

/// A point to pass before the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Via {
    /// World, m.
    pub point: Vector3<f64>,
    /// Horizontal direction of the way; the point is passed when this component of it is.
    pub along: Vector3<f64>,
}

/// The obstacle that is passed, and on which side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Detour {
    /// Number of the obstacle.
    pub obstacle: u32,
    /// 1: the vehicle passes on the left of the straight way; -1: on the right.
    pub side: f64,
    /// Plans that came to a halt on it so far.
    pub halts: u32,
}

/// After so many plans that come to a halt on the way round, the other side is tried.
const PATIENCE: u32 = 20;

impl Detour {
    /// Counts a plan on the way round, which comes to a halt or does not.
    pub fn count(&mut self, halts: bool) {
        self.halts = if halts { self.halts + 1 } else { 0 };
        if self.halts > PATIENCE {
            self.side = -self.side;
            self.halts = 0;
        }
    }
}

/// Least clearance of a straight way from an obstacle, m.
pub(super) fn straight_clearance_m(
    keepout: &Keepout,
    quantile: f64,
    from: &Vector3<f64>,
    to: &Vector3<f64>,
) -> f64 {
    (1..=SAMPLES)
        .map(|i| {
            let point = from + (to - from) * (i as f64 / SAMPLES as f64);
            keepout.chance_value(&point, quantile)
        })
        .fold(f64::INFINITY, f64::min)
}

/// The point to pass beside an obstacle.
pub(super) fn via(
    keepout: &Keepout,
    side: f64,
    from: &Vector3<f64>,
    target: &Vector3<f64>,
) -> Option<Via> {
    let along = (target.xy() - from.xy()).try_normalize(1e-6)?;
    let left = Vector2::new(-along.y, along.x) * side;
    let reach_m = keepout.level_reach_m(&left)?;
    if reach_m > MAX_REACH_M {
        return None;
    }
    let beside = keepout.centre.xy() + left * (reach_m + GAP_M);
    Some(Via {
        point: Vector3::new(beside.x, beside.y, target.z),
        along: Vector3::new(along.x, along.y, 0.0),
    })
}

/// The side on which an obstacle is better passed: the shorter way past points that are free; the
/// left one if they are equal.
pub(super) fn better_side(
    blocking: &Keepout,
    all: &[Keepout],
    quantile: f64,
    from: &Vector3<f64>,
    target: &Vector3<f64>,
) -> Option<f64> {
    let length_m = |side: f64| {
        let via = via(blocking, side, from, target)?;
        let occupied = all
            .iter()
            .filter(|k| k.chance_value(&via.point, quantile) < 0.0)
            .count();
        let way_m = (via.point - from).norm() + (target - via.point).norm();
        Some(way_m + OCCUPIED_M * occupied as f64)
    };
    match (length_m(1.0), length_m(-1.0)) {
        (Some(left), Some(right)) => Some(if left <= right + 1e-6 { 1.0 } else { -1.0 }),
        _ => None,
    }
}
