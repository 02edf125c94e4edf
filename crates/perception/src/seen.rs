//! What has been seen to be free, so that the vehicle need not fly into what it never saw.

use std::ops::ControlFlow;

use alula_geometry::Timestamp;
use alula_parameters::{ParameterError, Parameters, parameters};
use nalgebra::{Vector2, Vector3};

use crate::contour::is_too_late;
use crate::{Contour, RayEnd};

parameters! {
    /// Parameters of [`SeenSpace`].
    pub struct SeenSpaceConfig {
        /// Edge of a cell, m.
        pub cell_m: f64 = 0.25, within(0.02, 5.0);
        /// Edge of the square that is remembered, with the vehicle in its middle, m.
        pub extent_m: f64 = 16.0, within(1.0, 200.0);
        /// What was seen longer ago than this counts as unseen, s.
        pub max_age_s: f64 = 10.0, within(0.1, 10000.0);
    }
}

/// Most cells along the edge of the square.
const MAX_CELLS: f64 = 1024.0;

/// A time before all others.
const NEVER: i64 = i64::MIN;

/// Coordinates beyond this are nonsense, m.
const MAX_COORDINATE_M: f64 = 1e7;

/// When a cell was last seen to be free, and to be occupied, ns.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    free: i64,
    occupied: i64,
}

const UNSEEN: Cell = Cell {
    free: NEVER,
    occupied: NEVER,
};

/// Column and row of a cell of the endless grid.
type Index = [i64; 2];

/// A square of cells, fixed in the world, that moves with the vehicle: seen from above, where it
/// is known to be free.
///
/// Cells are stored in a ring in both directions, so that moving the square clears only the cells
/// that enter it. A cell is free if a ray of a contour went all the way through it not too long
/// ago and nothing was met in it since. Allocates nothing after construction.
#[derive(Clone, Debug)]
pub struct SeenSpace {
    cell_m: f64,
    max_age_ns: i64,
    cells_per_edge: i64,
    cells: Vec<Cell>,
    /// Cell at the lower corner of the square.
    corner: Index,
    /// Where that cell is stored in the ring.
    ring: Index,
    /// Where the grid's origin is in the world, m.
    origin_world: Vector2<f64>,
    now: Timestamp,
}

impl SeenSpace {
    /// A square of which nothing was seen.
    ///
    /// # Errors
    /// A parameter outside its range; more than 1024 cells along the edge.
    pub fn new(config: &SeenSpaceConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        let cells_per_edge = (config.extent_m / config.cell_m).ceil();
        if cells_per_edge > MAX_CELLS {
            let allowed = format!("at least extent_m / {MAX_CELLS}");
            return Err(ParameterError::new("cell_m", config.cell_m, allowed));
        }
        let cells_per_edge = cells_per_edge as i64;
        Ok(Self {
            cell_m: config.cell_m,
            max_age_ns: alula_geometry::TimeDelta::from_s(config.max_age_s).as_ns(),
            cells_per_edge,
            cells: vec![UNSEEN; (cells_per_edge * cells_per_edge) as usize],
            corner: [0; 2],
            ring: [0; 2],
            origin_world: Vector2::zeros(),
            now: Timestamp::from_ns(NEVER),
        })
    }

    /// Takes in the free view of one image. An image older than the last one by more than
    /// [`MOST_LATE_S`](crate::MOST_LATE_S), or from nowhere, changes nothing.
    pub fn update(&mut self, contour: &Contour) {
        if self.is_late(contour.time) || !is_place(&contour.camera_world) {
            return;
        }
        self.now = self.now.max(contour.time);
        self.centre_on(&contour.camera_world);
        self.mark_free(contour);
        self.mark_hits(contour);
    }

    /// Marks as free the cells whose centre lies within `radius_m` of a place where the vehicle
    /// is, and the cell in which it is.
    pub fn mark_here(&mut self, position_world: &Vector3<f64>, radius_m: f64, time: Timestamp) {
        if self.is_late(time) || !is_place(position_world) || radius_m.is_nan() {
            return;
        }
        self.now = self.now.max(time);
        self.centre_on(position_world);
        let here = self.in_cells(position_world);
        let own = [here.x.floor() as i64, here.y.floor() as i64];
        let radius = (radius_m / self.cell_m).clamp(0.0, self.cells_per_edge as f64);
        let reach = radius.ceil() as i64;
        for x in own[0] - reach..=own[0] + reach {
            for y in own[1] - reach..=own[1] + reach {
                let centre = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
                if [x, y] == own || (centre - here).norm() <= radius {
                    self.set([x, y], |cell| {
                        cell.free = cell.free.max(time.as_ns());
                        cell.occupied = NEVER;
                    });
                }
            }
        }
    }

    fn is_late(&self, time: Timestamp) -> bool {
        let is_set = self.now != Timestamp::from_ns(NEVER);
        is_too_late(time, is_set.then_some(self.now))
    }

    /// Whether the cell of a point was seen to be free lately. Height is left out of account.
    pub fn is_free(&self, point_world: &Vector3<f64>) -> bool {
        if !is_place(point_world) {
            return false;
        }
        let here = self.in_cells(point_world);
        self.is_free_cell([here.x.floor() as i64, here.y.floor() as i64])
    }

    /// Forgets everything, the time as well.
    pub fn clear(&mut self) {
        self.cells.fill(UNSEEN);
        self.now = Timestamp::from_ns(NEVER);
    }

    /// All cells that a ray passes through from side to side.
    fn mark_free(&mut self, contour: &Contour) {
        let start = self.in_cells(&contour.camera_world);
        let time = contour.time.as_ns();
        for ray in &contour.rays {
            let Some(end) = self.end_of(start, ray.heading_rad, ray.range_m, ray.end) else {
                continue;
            };
            let range = (end - start).norm();
            let _: ControlFlow<()> = cells_between(start, end, |index, _, exit| {
                if exit <= range {
                    self.set(index, |cell| cell.free = cell.free.max(time));
                }
                ControlFlow::Continue(())
            });
        }
    }

    /// After all free cells: a cell that one ray passes and in which another ends is occupied.
    fn mark_hits(&mut self, contour: &Contour) {
        let start = self.in_cells(&contour.camera_world);
        let reach = self.cells_per_edge as f64;
        for ray in contour.rays.iter().filter(|ray| ray.end == RayEnd::Hit) {
            let range = ray.range_m / self.cell_m;
            if range >= 0.0 && range <= reach && ray.heading_rad.is_finite() {
                let hit = start + direction(ray.heading_rad) * range;
                let index = [hit.x.floor() as i64, hit.y.floor() as i64];
                let time = contour.time.as_ns();
                self.set(index, |cell| cell.occupied = cell.occupied.max(time));
            }
        }
    }

    /// End of a ray, within the square; none for one that says nothing.
    fn end_of(
        &self,
        start: Vector2<f64>,
        heading_rad: f64,
        range_m: f64,
        end: RayEnd,
    ) -> Option<Vector2<f64>> {
        let says_something = end != RayEnd::Unknown && heading_rad.is_finite() && range_m > 0.0;
        says_something.then(|| {
            // Beyond the corners of the square there is nothing to mark.
            let range = (range_m / self.cell_m).min(0.75 * self.cells_per_edge as f64);
            start + direction(heading_rad) * range
        })
    }

    fn in_cells(&self, point_world: &Vector3<f64>) -> Vector2<f64> {
        (point_world.xy() - self.origin_world) / self.cell_m
    }

    /// Moves the square so that a point lies in its middle; cells that enter it are unseen.
    fn centre_on(&mut self, point_world: &Vector3<f64>) {
        let here = self.in_cells(point_world);
        let half = self.cells_per_edge / 2;
        let corner = [here.x.floor() as i64 - half, here.y.floor() as i64 - half];
        for axis in 0..2 {
            let steps = corner[axis] - self.corner[axis];
            let entering = steps.abs().min(self.cells_per_edge);
            let first = if steps > 0 {
                self.corner[axis] + steps + self.cells_per_edge - entering
            } else {
                corner[axis]
            };
            self.corner[axis] = corner[axis];
            self.ring[axis] = corner[axis].rem_euclid(self.cells_per_edge);
            for line in first..first + entering {
                self.clear_line(axis, line);
            }
        }
    }

    /// Clears the column (axis 0) or row (axis 1) of the ring that a line of cells is stored in.
    fn clear_line(&mut self, axis: usize, line: i64) {
        let n = self.cells_per_edge;
        let line = line.rem_euclid(n);
        for other in 0..n {
            let (x, y) = if axis == 0 {
                (line, other)
            } else {
                (other, line)
            };
            self.cells[(y * n + x) as usize] = UNSEEN;
        }
    }

    /// Where a cell is stored, if it is in the square.
    fn slot(&self, index: Index) -> Option<usize> {
        let n = self.cells_per_edge;
        let [x, y] = [0, 1].map(|axis| {
            let step = index[axis] - self.corner[axis];
            if !(0..n).contains(&step) {
                return None;
            }
            let place = self.ring[axis] + step;
            Some(if place >= n { place - n } else { place })
        });
        Some((y? * n + x?) as usize)
    }

    fn set(&mut self, index: Index, change: impl FnOnce(&mut Cell)) {
        if let Some(slot) = self.slot(index) {
            change(&mut self.cells[slot]);
        }
    }

    fn is_free_cell(&self, index: Index) -> bool {
        let oldest = self.now.as_ns().saturating_sub(self.max_age_ns);
        self.slot(index).is_some_and(|slot| {
            let cell = self.cells[slot];
            cell.free != NEVER && cell.free >= oldest && cell.free > cell.occupied
        })
    }
}

fn is_place(point: &Vector3<f64>) -> bool {
    point.xy().iter().all(|x| x.abs() <= MAX_COORDINATE_M)
}

fn direction(heading_rad: f64) -> Vector2<f64> {
    Vector2::new(heading_rad.cos(), heading_rad.sin())
}

/// Visits the cells on the way from `a` to `b` (in cells) in order, with the distances at which
/// the way enters and leaves each (Amanatides and Woo, Eurographics 1987).
fn cells_between<B>(
    a: Vector2<f64>,
    b: Vector2<f64>,
    mut visit: impl FnMut(Index, f64, f64) -> ControlFlow<B>,
) -> ControlFlow<B> {
    let way = b - a;
    let length = way.norm();
    let mut index = [a.x.floor() as i64, a.y.floor() as i64];
    let mut step = [0_i64; 2];
    // Distance at which the next cell begins, and between the borders of cells, along each axis.
    let mut next = [f64::INFINITY; 2];
    let mut between = [f64::INFINITY; 2];
    for axis in 0..2 {
        if way[axis] != 0.0 {
            let up = way[axis] > 0.0;
            step[axis] = if up { 1 } else { -1 };
            let border = index[axis] as f64 + if up { 1.0 } else { 0.0 };
            between[axis] = length / way[axis].abs();
            next[axis] = (border - a[axis]).abs() * between[axis];
        }
    }
    let mut entry = 0.0;
    loop {
        let axis = usize::from(next[1] < next[0]);
        let exit = next[axis];
        visit(index, entry, exit)?;
        // Also ends a way of no length, whose next border is at infinity.
        if exit >= length || !exit.is_finite() {
            return ControlFlow::Continue(());
        }
        index[axis] += step[axis];
        next[axis] += between[axis];
        entry = exit;
    }
}
