//! Which way round the obstacles that stand still: the predictive planner is told where to go by
//! the shortest path over a grid around the vehicle, because its own horizon is short and its
//! optimum is a local one.
//!
//! The way is planned at one height. Cells nearer to an obstacle than the vehicle's radius are
//! closed; nearness beyond that costs. Space that was never seen counts as open: how fast to fly
//! into it is decided elsewhere.

mod grid;
mod search;

use alula_messages::{Footprint, Obstacle};
use alula_parameters::{ParameterError, Parameters, parameters};
use nalgebra::{Vector2, Vector3};

use grid::Grid;
use search::Search;

parameters! {
    /// How the way round obstacles is found.
    pub struct RouteConfig {
        /// Width of a cell, m.
        pub cell_m: f64 = 0.2, within(0.05, 1.0);
        /// Cells along each side of the grid, which is centred on the vehicle.
        pub cells: usize = 96, within(16.0, 512.0);
        /// Radius of the vehicle with the distance that it keeps in any case, m.
        pub radius_m: f64 = 0.45, within(0.05, 5.0);
        /// Distance from there on up to which nearness still costs, m.
        pub comfort_m: f64 = 0.5, within(0.0, 5.0);
        /// Cost of a metre at the closest allowed distance, in metres of free way.
        pub nearness_cost: f64 = 3.0, within(0.0, 100.0);
        /// Share of the cost of a metre that is left near the last way: keeps a choice of side.
        pub loyalty: f64 = 0.8, within(0.1, 1.0);
        /// Distance to the point on the way that is aimed at, m.
        pub lookahead_m: f64 = 4.0, within(0.5, 50.0);
    }
}

/// Where a way ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RouteEnd {
    /// At the goal.
    Goal,
    /// At the edge of the grid, on the way to a goal outside it.
    Edge,
    /// Before this obstacle, which closes the goal or the only way.
    Closed {
        /// Number of the obstacle.
        obstacle: u32,
        /// Whether the goal itself lies in it.
        at_goal: bool,
    },
}

/// A way to the goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Route {
    /// The farthest point that the way allows to fly to in a straight line, within the lookahead,
    /// world, m.
    pub target_world: Vector3<f64>,
    /// Length of the way to the goal, m; from its end on as the crow flies.
    pub length_m: f64,
    /// Where it ends.
    pub end: RouteEnd,
}

/// Finds ways; keeps the last one.
#[derive(Clone, Debug)]
pub struct RoutePlanner {
    config: RouteConfig,
    grid: Grid,
    search: Search,
    /// The last way, world, m.
    way: Vec<Vector2<f64>>,
}

impl RoutePlanner {
    /// A planner without a way.
    ///
    /// # Errors
    /// When a parameter is outside its range.
    pub fn new(config: &RouteConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        let count = config.cells * config.cells;
        Ok(Self {
            grid: Grid::new(config.cells, config.cell_m),
            search: Search::new(count),
            way: Vec::with_capacity(count),
            config: config.clone(),
        })
    }

    /// Forgets the last way.
    pub fn reset(&mut self) {
        self.way.clear();
    }

    /// The last way, world, m, from the vehicle on.
    pub fn way(&self) -> &[Vector2<f64>] {
        &self.way
    }

    /// The way from a place to a goal past the obstacles that `stands` accepts.
    pub fn route(
        &mut self,
        from_world: &Vector3<f64>,
        goal_world: &Vector3<f64>,
        obstacles: &[Obstacle],
        stands: impl Fn(&Obstacle) -> bool,
    ) -> Route {
        self.grid.clear(from_world.xy());
        let heights = [from_world.z, goal_world.z];
        for (i, obstacle) in obstacles.iter().enumerate() {
            if is_finite(obstacle)
                && stands(obstacle)
                && meets_height(obstacle, heights, self.config.radius_m)
            {
                self.grid.paint(i, obstacle, &self.config);
            }
        }
        self.grid.favour(&self.way, 2.0 * self.config.cell_m);
        let goal_inside = self.grid.clamp(from_world.xy(), goal_world.xy());
        self.search
            .find(&self.grid, &self.config, from_world.xy(), goal_inside);
        self.search.way_to(&self.grid, &mut self.way);
        self.judge(from_world, goal_world, goal_inside, obstacles)
    }

    /// Cuts the way where it is closed and picks the point to aim at.
    fn judge(
        &mut self,
        from_world: &Vector3<f64>,
        goal_world: &Vector3<f64>,
        goal_inside: Vector2<f64>,
        obstacles: &[Obstacle],
    ) -> Route {
        let at_edge = (goal_inside - goal_world.xy()).norm() > self.config.cell_m;
        let mut end = if at_edge {
            RouteEnd::Edge
        } else {
            RouteEnd::Goal
        };
        if let Some((length, index)) = self.first_closed() {
            let obstacle = obstacles.get(index).map_or(0, |o| o.id);
            let (goal_clearance, _) = self.grid.clearance(goal_inside);
            let at_goal = !at_edge && goal_clearance < 0.0;
            end = RouteEnd::Closed { obstacle, at_goal };
            self.way.truncate(length);
        } else if !at_edge && let Some(last) = self.way.last_mut() {
            *last = goal_world.xy();
        }
        let target = self.aim(from_world.xy());
        let last = self.way.last().copied().unwrap_or(from_world.xy());
        let is_goal = (target - goal_world.xy()).norm() < 1e-6;
        let share = if is_goal {
            1.0
        } else {
            share_of_way(from_world, goal_world, &target)
        };
        Route {
            target_world: Vector3::new(
                target.x,
                target.y,
                from_world.z + share * (goal_world.z - from_world.z),
            ),
            length_m: length(&self.way) + (goal_world.xy() - last).norm(),
            end,
        }
    }

    /// The number of points of the way before it is closed, and the obstacle that closes it. A way
    /// may begin closed: it then leads out.
    fn first_closed(&self) -> Option<(usize, usize)> {
        let mut left = false;
        for (i, point) in self.way.iter().enumerate() {
            let (clearance_m, obstacle) = self.grid.clearance(*point);
            if clearance_m >= 0.0 {
                left = true;
            } else if left {
                return Some((i, obstacle));
            }
        }
        let (_, obstacle) = self.grid.clearance(*self.way.last()?);
        (!left && self.way.len() > 1).then_some((1, obstacle))
    }

    /// The way pulled straight: the point of it that is farthest along and in open sight, no
    /// farther away than the lookahead.
    fn aim(&self, from: Vector2<f64>) -> Vector2<f64> {
        let in_sight = self.way.iter().rev().find(|p| self.grid.is_open(from, **p));
        let mut aim = in_sight.copied().unwrap_or(from);
        // A way that begins closed has no open line; its next points lead out.
        if (aim - from).norm() < self.config.cell_m {
            let next = 3.min(self.way.len().saturating_sub(1));
            aim = self.way.get(next).copied().unwrap_or(aim);
        }
        let line = aim - from;
        from + line * (self.config.lookahead_m / line.norm().max(1e-9)).min(1.0)
    }
}

/// Part of the way to the goal that is done at the target, as the crow flies.
fn share_of_way(from: &Vector3<f64>, goal: &Vector3<f64>, target: &Vector2<f64>) -> f64 {
    let whole = (goal.xy() - from.xy()).norm();
    let done = (target - from.xy()).norm();
    if whole > 1e-6 {
        (done / whole).clamp(0.0, 1.0)
    } else {
        1.0
    }
}

fn length(way: &[Vector2<f64>]) -> f64 {
    way.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
}

fn is_finite(obstacle: &Obstacle) -> bool {
    let numbers = [obstacle.centre_world, obstacle.size_m];
    numbers.iter().flatten().all(|x| x.is_finite()) && obstacle.yaw_rad.is_finite()
}

/// Whether an obstacle reaches into the heights between which the vehicle flies.
fn meets_height(obstacle: &Obstacle, heights: [f64; 2], radius_m: f64) -> bool {
    let half = 0.5 * obstacle.size_m.z;
    let (bottom, top) = (
        obstacle.centre_world.z - half,
        obstacle.centre_world.z + half,
    );
    let low = heights[0].min(heights[1]) - radius_m;
    let high = heights[0].max(heights[1]) + radius_m;
    top > low && bottom < high
}

/// Horizontal distance from a point to an obstacle grown by `radius_m`, m; negative inside. For
/// ellipses it is an estimate that is exact on the surface.
fn clearance(obstacle: &Obstacle, point: &Vector2<f64>, radius_m: f64) -> f64 {
    let offset = point - obstacle.centre_world.xy();
    let (sin, cos) = obstacle.yaw_rad.sin_cos();
    let along = cos * offset.x + sin * offset.y;
    let across = -sin * offset.x + cos * offset.y;
    let (half_length, half_width) = (0.5 * obstacle.size_m.x, 0.5 * obstacle.size_m.y);
    match obstacle.footprint {
        Footprint::Flat => {
            let beyond = (along.abs() - half_length).max(0.0);
            beyond.hypot(across) - half_width - radius_m
        }
        Footprint::Round => {
            let (a, b) = (half_length + radius_m, half_width + radius_m);
            ((along / a).hypot(across / b) - 1.0) * a.min(b)
        }
    }
}

#[cfg(test)]
mod tests;
