//! A* over the cells of a grid.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::Vector2;

use super::RouteConfig;
use super::grid::Grid;

/// No cell.
const NONE: u32 = u32::MAX;

/// A cell to be looked at, cheapest first; equal costs by index, so that ways are reproducible.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Open {
    estimate: f32,
    index: u32,
}

impl Eq for Open {}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .estimate
            .total_cmp(&self.estimate)
            .then(other.index.cmp(&self.index))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The memory of a search.
#[derive(Clone, Debug)]
pub(super) struct Search {
    cost: Vec<f32>,
    before: Vec<u32>,
    open: BinaryHeap<Open>,
    end: u32,
}

impl Search {
    pub fn new(cells: usize) -> Self {
        Self {
            cost: vec![f32::INFINITY; cells],
            before: vec![NONE; cells],
            // Every cell enters at most once from each of its neighbours.
            open: BinaryHeap::with_capacity(8 * cells),
            end: NONE,
        }
    }

    /// Finds the cheapest way between two places of the grid.
    pub fn find(
        &mut self,
        grid: &Grid,
        config: &RouteConfig,
        from: Vector2<f64>,
        to: Vector2<f64>,
    ) {
        self.cost.fill(f32::INFINITY);
        self.before.fill(NONE);
        self.open.clear();
        let (start, end) = (grid.index(from) as u32, grid.index(to) as u32);
        self.end = end;
        self.cost[start as usize] = 0.0;
        self.open.push(Open {
            estimate: 0.0,
            index: start,
        });
        while let Some(open) = self.open.pop() {
            if open.index == end {
                return;
            }
            self.expand(grid, config, open, end);
        }
    }

    fn expand(&mut self, grid: &Grid, config: &RouteConfig, open: Open, end: u32) {
        let side = grid.side() as i64;
        let (row, column) = (i64::from(open.index) / side, i64::from(open.index) % side);
        let here = self.cost[open.index as usize];
        if open.estimate > here + distance(grid, config, open.index, end) + 1e-3 {
            // A cheaper way to this cell has been looked at already.
            return;
        }
        let cost_here = grid.cost(open.index as usize, config);
        for (dy, dx) in NEIGHBOURS {
            let (y, x) = (row + dy, column + dx);
            if !(0..side).contains(&y) || !(0..side).contains(&x) {
                continue;
            }
            let index = (y * side + x) as u32;
            let step = grid.cell_m() as f32 * if dy * dx == 0 { 1.0 } else { DIAGONAL };
            let cost = here + 0.5 * step * (cost_here + grid.cost(index as usize, config));
            if cost < self.cost[index as usize] {
                self.cost[index as usize] = cost;
                self.before[index as usize] = open.index;
                let estimate = cost + distance(grid, config, index, end);
                self.open.push(Open { estimate, index });
            }
        }
    }

    /// Writes the way that was found, from its start on.
    pub fn way_to(&self, grid: &Grid, way: &mut Vec<Vector2<f64>>) {
        way.clear();
        let mut index = self.end;
        while index != NONE && way.len() < self.before.len() {
            way.push(grid.centre(index as usize));
            index = self.before[index as usize];
        }
        way.reverse();
    }
}

const DIAGONAL: f32 = std::f32::consts::SQRT_2;

const NEIGHBOURS: [(i64, i64); 8] = [
    (-1, -1),
    (-1, 0),
    (-1, 1),
    (0, -1),
    (0, 1),
    (1, -1),
    (1, 0),
    (1, 1),
];

/// Length of the shortest way over an open grid at the least cost of a metre: never more than the
/// true cost, so that the first way found is the cheapest.
fn distance(grid: &Grid, config: &RouteConfig, from: u32, to: u32) -> f32 {
    let side = grid.side() as u32;
    let dx = (from % side).abs_diff(to % side) as f32;
    let dy = (from / side).abs_diff(to / side) as f32;
    let (more, less) = (dx.max(dy), dx.min(dy));
    (more - less + DIAGONAL * less) * grid.cell_m() as f32 * config.loyalty as f32
}
