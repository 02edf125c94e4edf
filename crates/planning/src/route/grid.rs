//! The cells around the vehicle and how near each is to an obstacle.

use alula_messages::Obstacle;
use nalgebra::Vector2;

use super::{RouteConfig, clearance};

/// Clearance of a cell far from everything, m.
const FAR_M: f32 = 1e3;

/// One cell.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// Distance from the vehicle's surface to the nearest obstacle if it were here, m.
    clearance_m: f32,
    /// Index of that obstacle.
    obstacle: u16,
    /// Whether the last way led by.
    favoured: bool,
}

const OPEN: Cell = Cell {
    clearance_m: FAR_M,
    obstacle: u16::MAX,
    favoured: false,
};

/// A square of cells centred on the vehicle.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    cells: Vec<Cell>,
    side: usize,
    cell_m: f64,
    /// Corner with the least coordinates, world, m.
    corner: Vector2<f64>,
}

impl Grid {
    pub fn new(side: usize, cell_m: f64) -> Self {
        Self {
            cells: vec![OPEN; side * side],
            side,
            cell_m,
            corner: Vector2::zeros(),
        }
    }

    pub fn side(&self) -> usize {
        self.side
    }

    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Opens all cells and centres them on a place.
    pub fn clear(&mut self, centre: Vector2<f64>) {
        self.cells.fill(OPEN);
        // Cells stay where they are in the world while the vehicle moves: a way does not jitter.
        let half = 0.5 * self.cell_m * self.side as f64;
        self.corner = centre.map(|c| ((c - half) / self.cell_m).floor() * self.cell_m);
    }

    fn index_1d(&self, offset_m: f64) -> usize {
        let cell = (offset_m / self.cell_m).floor();
        // The cast saturates; not-a-number gives the first cell.
        (cell as usize).min(self.side - 1)
    }

    pub fn index(&self, point: Vector2<f64>) -> usize {
        let offset = point - self.corner;
        self.index_1d(offset.y) * self.side + self.index_1d(offset.x)
    }

    pub fn centre(&self, index: usize) -> Vector2<f64> {
        let (row, column) = (index / self.side, index % self.side);
        self.corner + Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * self.cell_m
    }

    /// Lowers the clearance of all cells near an obstacle.
    pub fn paint(&mut self, number: usize, obstacle: &Obstacle, config: &RouteConfig) {
        let half = 0.5 * obstacle.size_m.xy().norm();
        let reach = half + config.radius_m + config.comfort_m;
        let centre = obstacle.centre_world.xy() - self.corner;
        let far = self.cell_m * self.side as f64;
        let outside = |c: f64| !(c + reach >= 0.0 && c - reach <= far);
        if outside(centre.x) || outside(centre.y) {
            return;
        }
        let [columns, rows] =
            [centre.x, centre.y].map(|c| self.index_1d(c - reach)..=self.index_1d(c + reach));
        for row in rows {
            for column in columns.clone() {
                let index = row * self.side + column;
                let found = clearance(obstacle, &self.centre(index), config.radius_m) as f32;
                if found < self.cells[index].clearance_m {
                    self.cells[index].clearance_m = found;
                    self.cells[index].obstacle = number as u16;
                }
            }
        }
    }

    /// Marks the cells within `reach_m` of a way.
    pub fn favour(&mut self, way: &[Vector2<f64>], reach_m: f64) {
        let steps = (reach_m / self.cell_m).round() as i32;
        let last = self.side as i32 - 1;
        for point in way {
            let offset = (point - self.corner) / self.cell_m;
            let (x, y) = (offset.x.floor() as i32, offset.y.floor() as i32);
            for row in (y - steps).max(0)..=(y + steps).min(last) {
                for column in (x - steps).max(0)..=(x + steps).min(last) {
                    self.cells[row as usize * self.side + column as usize].favoured = true;
                }
            }
        }
    }

    /// The point on the line to a goal that still lies in the grid: the goal if it does.
    pub fn clamp(&self, from: Vector2<f64>, goal: Vector2<f64>) -> Vector2<f64> {
        let line = goal - from;
        let low = self.corner + Vector2::repeat(self.cell_m);
        let high = self.corner + Vector2::repeat(self.cell_m * (self.side as f64 - 1.0));
        let mut share: f64 = 1.0;
        for i in 0..2 {
            if goal[i] < low[i] {
                share = share.min((low[i] - from[i]) / line[i]);
            } else if goal[i] > high[i] {
                share = share.min((high[i] - from[i]) / line[i]);
            }
        }
        from + line * share.clamp(0.0, 1.0)
    }

    /// Clearance of the cell at a place, m, and the index of the nearest obstacle.
    pub fn clearance(&self, point: Vector2<f64>) -> (f64, usize) {
        let cell = &self.cells[self.index(point)];
        (f64::from(cell.clearance_m), usize::from(cell.obstacle))
    }

    /// Cost of a metre through a cell.
    pub fn cost(&self, index: usize, config: &RouteConfig) -> f32 {
        /// A closed metre costs as much as this many open ones: no way round is as long.
        const CLOSED: f32 = 1000.0;
        let cell = &self.cells[index];
        if cell.clearance_m < 0.0 {
            return CLOSED * (1.0 - cell.clearance_m);
        }
        let comfort = config.comfort_m as f32;
        let lack = ((comfort - cell.clearance_m) / comfort.max(1e-3)).max(0.0);
        let cost = 1.0 + config.nearness_cost as f32 * lack * lack;
        if cell.favoured {
            cost * config.loyalty as f32
        } else {
            cost
        }
    }

    /// Whether the straight line between two points stays in open cells.
    pub fn is_open(&self, from: Vector2<f64>, to: Vector2<f64>) -> bool {
        let line = to - from;
        let steps = (2.0 * line.norm() / self.cell_m).ceil().max(1.0);
        (0..=steps as usize).all(|i| {
            let point = from + line * (i as f64 / steps);
            self.clearance(point).0 >= 0.0
        })
    }
}
