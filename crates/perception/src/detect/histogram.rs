//! The U-depth map: how many pixels of each column of the level view lie in each bin of depth, and
//! between which elevations.

use alula_messages::{Cut, DepthImage};
use nalgebra::Vector3;

use super::level::{LEAST_AHEAD, Level};
use super::{DetectorConfig, fit, refill};

/// Parts of a bin in which depths are summed.
const PARTS: u32 = 64;
/// Bins of depth that make one of the coarse rows in which seen floor is kept.
const FLOOR_BINS: usize = 8;
/// Step of the horizon among the 65536 of an elevation's tangent.
const HORIZON: f32 = 32768.0;
/// Standard deviations of the noise, at the greatest depth, that the map reaches beyond it.
const BEYOND_SIGMAS: f64 = 3.0;
/// More rows than this are not read: the sums of a cell hold 16 bits.
const MOST_ROWS: u32 = 900;
/// Pixels of a column that make seen floor or distance: single ones may be wrong.
const SEEN_PIXELS: u16 = 2;
/// Adding this to a number of 0 to 2^22 leaves its nearest integer in the low bits.
const ROUNDER: f32 = 8_388_608.0;
const ROUNDER_BITS: u32 = 0x7f_ffff;

pub(super) const LEFT: u8 = 1;
pub(super) const RIGHT: u8 = 2;
pub(super) const TOP: u8 = 4;
pub(super) const BOTTOM: u8 = 8;

/// The sides that `flags` name.
pub(super) fn cut(flags: u8) -> Cut {
    Cut {
        left: flags & LEFT != 0,
        right: flags & RIGHT != 0,
        top: flags & TOP != 0,
        bottom: flags & BOTTOM != 0,
    }
}

/// The histogram of depths of each column of an image's level view.
#[derive(Clone, Copy, Debug)]
pub struct UDepth<'a> {
    /// Columns of the map, from left to right.
    pub columns: usize,
    /// Bins of depth, from near to far.
    pub bins: usize,
    /// Width of a bin, m.
    pub bin_m: f64,
    stride: usize,
    counts: &'a [u16],
}

impl UDepth<'_> {
    /// Pixels of a column in a bin; none outside the map.
    pub fn count(&self, bin: usize, column: usize) -> u16 {
        if bin >= self.bins || column >= self.columns {
            return 0;
        }
        self.counts[bin * self.stride + column]
    }

    /// Pixels of all columns in a bin; empty outside the map.
    pub fn row(&self, bin: usize) -> &[u16] {
        if bin >= self.bins {
            return &[];
        }
        &self.counts[bin * self.stride..][..self.columns]
    }
}

/// What a cell of the map holds. All parts grow from zero.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(8))]
struct Cell {
    /// Pixels in the lower half; in the upper one the sum of the parts of a bin by which their
    /// depths exceed the bin's lower border. One addition counts both.
    pixels_parts: u32,
    /// Highest elevation.
    up: u16,
    /// Lowest elevation.
    down: u16,
}

impl Cell {
    fn pixels(self) -> u16 {
        self.pixels_parts as u16
    }

    fn parts(self) -> u16 {
        (self.pixels_parts >> 16) as u16
    }
}

/// A surface in one column of the map.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Support {
    pub count: u32,
    /// Mean depth and its standard deviation within the column, m.
    pub depth_m: f64,
    pub spread_m: f64,
    /// Tangents of the elevations of its upper and lower end.
    pub up_tan: f64,
    pub down_tan: f64,
    /// Sides of the image that it touches.
    pub flags: u8,
}

/// Of each column the row of the farthest thing, and of the farthest floor among its own rows from
/// 1 on, that are seen; 0 for none.
#[derive(Clone, Debug, Default)]
struct Farthest {
    things: Vec<u16>,
    floors: Vec<u16>,
}

/// The map and what is needed to fill it.
#[derive(Clone, Debug, Default)]
pub(super) struct Histogram {
    bin_m: f64,
    bins: usize,
    /// Columns, and columns in memory.
    columns: usize,
    stride: usize,
    /// Steps of elevation per unit of its tangent.
    tan_steps: f32,
    /// Of `bins` rows of depth, one of things beyond, and coarse rows of seen floor. The first bin
    /// holds the pixels without return as well.
    map: Vec<Cell>,
    borders: Vec<u8>,
    /// Pixels of the cells.
    counts: Vec<u16>,
    farthest: Farthest,
    /// Depths, m, of the pixels of one row of the image, 0 for nothing.
    depths: Vec<f32>,
    /// Cell, and elevation and part of a bin, of the pixels of one row of the image.
    cells: Vec<u32>,
    values: Vec<u32>,
    /// Rows of the image from one that is read to the next.
    pub row_stride: u32,
}

/// Constants of one image's projection. Rays are scaled so that x over z counts columns and y over
/// z steps of elevation; depths count parts of a bin.
#[derive(Clone, Copy)]
struct Projection {
    ray_step: Vector3<f32>,
    first_column: f32,
    last_column: f32,
    last_part: f32,
    floor: f32,
    floor_slope: f32,
    stride: f32,
    floor_row: u32,
}

impl Histogram {
    pub fn new(config: &DetectorConfig) -> Self {
        let sigma_m = config.noise().sigma_m(config.max_depth_m);
        let reach_m = config.max_depth_m + BEYOND_SIGMAS * sigma_m;
        Self {
            bin_m: config.bin_m,
            bins: (reach_m / config.bin_m).ceil() as usize,
            ..Self::default()
        }
    }

    pub fn view(&self) -> UDepth<'_> {
        UDepth {
            columns: self.columns,
            bins: self.bins,
            bin_m: self.bin_m,
            stride: self.stride,
            counts: &self.counts,
        }
    }

    /// Counts the pixels of an image.
    pub fn fill(&mut self, image: &DepthImage, level: &Level, config: &DetectorConfig) {
        self.clear(level);
        let width = image.camera.width_px as usize;
        self.depths.resize(width, 0.0);
        self.cells.resize(width, 0);
        self.values.resize(width, 0);
        let camera = &image.camera;
        self.row_stride = config.row_stride.max(camera.height_px.div_ceil(MOST_ROWS));
        let projection = self.projection(level, config);
        let border = (config.border_px as usize).min(width);
        let lines = image.depth_mm.chunks_exact(width).enumerate();
        for (v, line) in lines.step_by(self.row_stride as usize) {
            let ray = level.level_from_camera * camera.ray(0.0, v as f64);
            self.project(line, self.scaled(ray, level).cast(), &projection);
            self.count();
            self.mark_border(0..border, LEFT);
            self.mark_border(width - border..width, RIGHT);
            if v < border {
                self.mark_border(0..width, TOP);
            }
            if v + border >= camera.height_px as usize {
                self.mark_border(0..width, BOTTOM);
            }
        }
        self.settle();
    }

    fn floor_rows(&self) -> usize {
        self.bins / FLOOR_BINS + 1
    }

    fn clear(&mut self, level: &Level) {
        self.columns = level.columns;
        self.stride = level.columns.next_multiple_of(8);
        self.tan_steps = (f64::from(HORIZON - 2.0) / level.steepest_tan) as f32;
        let cells = (self.bins + 1 + self.floor_rows()) * self.stride;
        let most_stride = level.most_columns.next_multiple_of(8);
        let most = (self.bins + 1 + self.floor_rows()) * most_stride;
        refill(&mut self.map, cells, most);
        refill(&mut self.borders, cells, most);
        fit(&mut self.counts, cells, most);
        for numbers in [&mut self.farthest.things, &mut self.farthest.floors] {
            refill(numbers, self.stride, most_stride);
        }
    }

    fn projection(&self, level: &Level, config: &DetectorConfig) -> Projection {
        let (floor_m, floor_slope) = floor_line(level, config);
        let step = self.scaled(
            level.level_from_camera.column(0) / level.camera.fx_px,
            level,
        );
        let tan_steps = f64::from(self.tan_steps);
        Projection {
            ray_step: step.cast(),
            first_column: (level.first_tan * level.columns_per_tan) as f32,
            last_column: (self.columns - 1) as f32,
            last_part: (self.bins as u32 * PARTS) as f32,
            floor: (floor_m * tan_steps * f64::from(PARTS) / self.bin_m) as f32,
            floor_slope: (floor_slope * tan_steps) as f32,
            stride: self.stride as f32,
            floor_row: self.bins as u32 + 1,
        }
    }

    /// A ray in the units of [`Projection`].
    fn scaled(&self, ray: Vector3<f64>, level: &Level) -> Vector3<f64> {
        let scales = Vector3::new(level.columns_per_tan, f64::from(self.tan_steps), 1.0);
        ray.component_mul(&scales)
    }

    /// Finds the cells of a row of the image that begins with a ray.
    fn project(&mut self, line: &[u16], ray: Vector3<f32>, projection: &Projection) {
        let parts_per_mm = (1e-3 * f64::from(PARTS) / self.bin_m) as f32;
        for (depth, mm) in self.depths.iter_mut().zip(line) {
            let valid = if *mm == u16::MAX { 0 } else { *mm };
            *depth = f32::from(valid) * parts_per_mm;
        }
        projection.cells(ray, &self.depths, &mut self.cells, &mut self.values);
    }

    fn count(&mut self) {
        for (&cell, &value) in self.cells.iter().zip(&self.values) {
            let cell = &mut self.map[cell as usize];
            let elevation = (value >> 16) as u16;
            cell.pixels_parts = cell.pixels_parts.wrapping_add((value << 16) + 1);
            cell.up = cell.up.max(u16::MAX - elevation);
            cell.down = cell.down.max(elevation);
        }
    }

    /// Reads off the whole map, once, what is asked of its rows.
    fn settle(&mut self) {
        let rows = self.map.chunks_exact(self.stride);
        let counts = self.counts.chunks_exact_mut(self.stride);
        for (row, (cells, counts)) in rows.zip(counts).enumerate() {
            let (numbers, number) = if row <= self.bins {
                (&mut self.farthest.things, row)
            } else {
                (&mut self.farthest.floors, row - self.bins)
            };
            settle_row(cells, counts, numbers, number as u16);
        }
    }

    fn mark_border(&mut self, columns: std::ops::Range<usize>, flag: u8) {
        for &cell in &self.cells[columns] {
            self.borders[cell as usize] |= flag;
        }
    }

    /// What a column holds in a range of bins.
    pub fn support(&self, column: usize, first: usize, last: usize) -> Support {
        let mut all = Cell::default();
        let (mut count, mut sum, mut squares, mut flags) = (0, 0.0, 0.0, 0);
        for bin in first..=last {
            let place = bin * self.stride + column;
            let cell = self.map[place];
            // An empty cell adds nothing, which costs less than to guess which ones are.
            let pixels = cell.pixels();
            let mean = f64::from(cell.parts()) / f64::from(pixels.max(1));
            let inner = (mean + 0.5) / f64::from(PARTS);
            // Depths in bins, from the first, so that the squares keep their digits.
            let depth = (bin - first) as f64 + inner;
            count += u32::from(pixels);
            sum += f64::from(pixels) * depth;
            squares += f64::from(pixels) * depth * depth;
            all.up = all.up.max(cell.up);
            all.down = all.down.max(cell.down);
            flags |= self.borders[place];
        }
        let mean = sum / f64::from(count.max(1));
        let variance = (squares / f64::from(count.max(1)) - mean * mean).max(0.0);
        let tan = |elevation: u16| f64::from((HORIZON - f32::from(elevation)) / self.tan_steps);
        Support {
            count,
            depth_m: (first as f64 + mean) * self.bin_m,
            spread_m: variance.sqrt() * self.bin_m,
            up_tan: tan(u16::MAX - all.up),
            down_tan: tan(all.down),
            flags,
        }
    }

    /// Depth, m, up to which a column is seen: of the farthest floor or thing; infinite where
    /// something lies beyond the map, `None` where nothing came back.
    pub fn seen_m(&self, column: usize) -> Option<f64> {
        let thing = usize::from(self.farthest.things[column]);
        if thing == self.bins {
            return Some(f64::INFINITY);
        }
        let coarse_m = FLOOR_BINS as f64 * self.bin_m;
        let floor = self.farthest.floors[column].checked_sub(1);
        let floor_m = floor.map(|row| f64::from(row) * coarse_m);
        let nearest = floor_m
            .map_or(1, |floor_m| (floor_m / self.bin_m) as usize)
            .max(1);
        let thing_m = (thing >= nearest).then_some(thing as f64 * self.bin_m);
        thing_m.or(floor_m)
    }
}

/// Copies the pixels of a row, and sets its number where it holds enough; the first row, of what has
/// no return, has the number of nothing seen. A function of its own, as [`Projection::cells`].
#[inline(never)]
fn settle_row(cells: &[Cell], counts: &mut [u16], numbers: &mut [u16], number: u16) {
    for ((cell, count), held) in cells.iter().zip(counts).zip(numbers) {
        let pixels = cell.pixels();
        *count = pixels;
        *held = if pixels >= SEEN_PIXELS { number } else { *held };
    }
}

impl Projection {
    /// Cells and values of the pixels of a row. A function of its own, whose arguments are known
    /// not to overlap: only then does the vector unit do several pixels at a time.
    #[inline(never)]
    fn cells(self, ray: Vector3<f32>, depths: &[f32], cells: &mut [u32], values: &mut [u32]) {
        let (x, y, z) = (ray.x, ray.y, ray.z);
        let (dx, dy, dz) = (self.ray_step.x, self.ray_step.y, self.ray_step.z);
        let out = cells.iter_mut().zip(values);
        for (u, (depth, (cell, value))) in depths.iter().zip(out).enumerate() {
            let u = u as i32 as f32;
            (*cell, *value) = self.cell((x + dx * u, y + dy * u, z + dz * u), *depth);
        }
    }

    /// Cell of a pixel, and its elevation and part of a bin. All numbers are of one width, as the
    /// vector unit has them. Nothing, depth 0, falls into the first bin, and what is beyond the map
    /// into the row after the last.
    #[inline(always)]
    fn cell(&self, (x, y, z): (f32, f32, f32), depth: f32) -> (u32, u32) {
        let depth = if z < LEAST_AHEAD as f32 { 0.0 } else { depth };
        let ahead = at_least(z, LEAST_AHEAD as f32);
        let inverse = 1.0 / ahead;
        let level = ahead * depth;
        let is_floor = y * depth > self.floor - self.floor_slope * level;
        let part = bits(at_most(at_least(level - 0.5, 0.0), self.last_part));
        let bin = part / PARTS;
        let floor = self.floor_row + bin / FLOOR_BINS as u32;
        let row = if is_floor { floor } else { bin };
        let column = at_most(
            at_least(x * inverse - self.first_column, 0.0),
            self.last_column,
        );
        // Whole numbers below 2^24 are exact, and have a fast product.
        let cell = bits(row as i32 as f32 * self.stride + whole(column));
        let value = (bits(y * inverse + HORIZON) << 16) | (part % PARTS);
        (cell, value)
    }
}

/// Offset, m, and slope with depth of the line below which a return is the floor: the height of the
/// camera less the margin, which grows with depth by noise (a pixel of the floor slides along its
/// ray by `a z^2`, hence down by `height a z`) and attitude.
fn floor_line(level: &Level, config: &DetectorConfig) -> (f64, f64) {
    let Some(height_m) = level.above_floor_m else {
        return (f64::from(f32::MAX), 0.0);
    };
    let noise = height_m.abs() * config.noise_per_m;
    let slope = config.floor_sigmas * noise.hypot(level.orientation_sigma_rad);
    (height_m - config.floor_margin_m, slope)
}

/// Height above the floor, m, below which a return at a depth is taken for it.
pub(super) fn floor_margin_m(depth_m: f64, level: &Level, config: &DetectorConfig) -> f64 {
    let (_, slope) = floor_line(level, config);
    config.floor_margin_m + slope * depth_m
}

/// Nearest integer of a number of 0 to 2^22, by the layout of floating point numbers: conversions
/// that check their range are not done by the vector unit.
#[inline(always)]
fn bits(value: f32) -> u32 {
    (value + ROUNDER).to_bits() & ROUNDER_BITS
}

/// Nearest whole number of a number of 0 to 2^22.
#[inline(always)]
fn whole(value: f32) -> f32 {
    (value + ROUNDER) - ROUNDER
}

#[inline(always)]
fn at_least(value: f32, low: f32) -> f32 {
    if value > low { value } else { low }
}

#[inline(always)]
fn at_most(value: f32, high: f32) -> f32 {
    if value < high { value } else { high }
}
