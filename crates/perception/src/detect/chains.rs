//! Chains of surfaces through neighbouring columns: the contiguous lines of document L, equation
//! 5-2, followed in depth.

use std::ops::Range;

use nalgebra::Vector2;

use super::columns::{Columns, MOST_SURFACES, Surface};
use super::level::Level;
use super::{DetectorConfig, empty};

/// Steepest slope of a surface, depth over width: a wall seen at 11 degrees.
const STEEPEST: f64 = 5.0;
/// Standard deviations of the difference of two depths that one surface may show.
const NOISE_SIGMAS: f64 = 3.0;
const NONE: u32 = u32::MAX;

/// A point of the contour seen from above: the surface in one column.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    /// Right and ahead of the camera in the level view, m.
    pub at: Vector2<f64>,
    /// Heights of its ends above the camera, m.
    pub up_m: f64,
    pub down_m: f64,
    /// Standard deviation of depth in the column beyond the noise, m.
    pub excess_m: f64,
    pub surface: Surface,
}

/// Links surfaces into chains.
#[derive(Clone, Debug, Default)]
pub(super) struct Chains {
    /// Next surface of the chain, by place in the columns' memory.
    nodes: Vec<Node>,
    /// Nodes with which a chain ends so far.
    open: Vec<u32>,
    /// Points of all chains, each from left to right.
    pub points: Vec<Point>,
    pub chains: Vec<Range<usize>>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    surface: Surface,
    /// Columns to the farthest one that may continue it.
    reach: usize,
    next: u32,
    is_head: bool,
}

impl Chains {
    pub fn link(&mut self, columns: &Columns, level: &Level, config: &DetectorConfig) {
        let most = level.most_columns * MOST_SURFACES;
        empty(&mut self.nodes, most);
        empty(&mut self.open, most);
        empty(&mut self.points, most);
        empty(&mut self.chains, most);
        for column in 0..columns.len() {
            let first = self.nodes.len();
            self.nodes
                .extend(columns.of(column).iter().map(|surface| Node {
                    surface: *surface,
                    reach: reach(surface, level, config),
                    next: NONE,
                    is_head: true,
                }));
            self.link_column(first, level, config);
            self.drop_ended(column);
            self.open.extend(first as u32..self.nodes.len() as u32);
        }
        self.collect(level, config);
    }

    /// Links the nodes of a column to open ends, those closest in depth first.
    fn link_column(&mut self, first: usize, level: &Level, config: &DetectorConfig) {
        loop {
            let mut best: Option<(f64, usize, usize)> = None;
            for node in (first..self.nodes.len()).filter(|node| self.nodes[*node].is_head) {
                for (place, end) in self.open.iter().enumerate() {
                    let end = &self.nodes[*end as usize];
                    let Some(step_m) = step(end, &self.nodes[node].surface, level, config) else {
                        continue;
                    };
                    if best.is_none_or(|(least_m, ..)| step_m < least_m) {
                        best = Some((step_m, place, node));
                    }
                }
            }
            let Some((_, place, node)) = best else {
                return;
            };
            let end = self.open.swap_remove(place) as usize;
            self.nodes[end].next = node as u32;
            self.nodes[node].is_head = false;
        }
    }

    /// Drops open ends from which no gap reaches the next column.
    fn drop_ended(&mut self, column: usize) {
        let nodes = &self.nodes;
        self.open.retain(|end| {
            let node = &nodes[*end as usize];
            column < node.surface.column + node.reach
        });
    }

    fn collect(&mut self, level: &Level, config: &DetectorConfig) {
        for head in (0..self.nodes.len()).filter(|node| self.nodes[*node].is_head) {
            let from = self.points.len();
            let mut node = head as u32;
            while node != NONE {
                let Node { surface, next, .. } = self.nodes[node as usize];
                self.points.push(point(surface, level, config));
                node = next;
            }
            self.chains.push(from..self.points.len());
        }
    }
}

/// Columns from a surface to the farthest one that may continue it.
fn reach(surface: &Surface, level: &Level, config: &DetectorConfig) -> usize {
    let gap = config.gap_m * level.columns_per_tan / surface.support.depth_m.max(config.bin_m);
    1 + (gap as usize).min(level.columns / 8)
}

/// Difference of depth, m, of two surfaces of neighbouring columns that may be one; `None` where
/// they may not.
fn step(left: &Node, right: &Surface, level: &Level, config: &DetectorConfig) -> Option<f64> {
    let (reach, left) = (left.reach, &left.surface);
    let columns = right.column - left.column;
    if columns > reach {
        return None;
    }
    let width_m = columns as f64 * left.support.depth_m / level.columns_per_tan;
    let noise_m = || NOISE_SIGMAS * (left.variance_m2 + right.variance_m2).sqrt();
    let step_m = (right.support.depth_m - left.support.depth_m).abs();
    let slope_m = config.step_m + STEEPEST * width_m;
    // Most steps are small enough without the noise, whose root takes time.
    (step_m <= slope_m || step_m <= slope_m + noise_m()).then_some(step_m)
}

fn point(surface: Surface, level: &Level, config: &DetectorConfig) -> Point {
    let support = &surface.support;
    let depth_m = support.depth_m;
    let noise_m2 = config.noise().variance_m2(depth_m);
    // What noise explains of the variance of so many pixels, at two standard deviations.
    let chance = 1.0 + 2.0 * (2.0 / f64::from(support.count)).sqrt();
    // Of a pixel half is above its middle.
    let half = 0.5 / level.camera.fy_px;
    Point {
        at: Vector2::new(level.tan(surface.column), 1.0) * depth_m,
        up_m: (support.up_tan + half) * depth_m,
        down_m: (support.down_tan - half) * depth_m,
        excess_m: (support.spread_m.powi(2) - noise_m2 * chance)
            .max(0.0)
            .sqrt(),
        surface,
    }
}
