//! Points of interest (document L, equation 5-1): surfaces that stand in one column of the map.

use super::histogram::{Histogram, Support};
use super::level::Level;
use super::{DetectorConfig, fit, refill};

/// Half width of the window in which counts are summed, in standard deviations of the noise: it
/// holds 87 % of a surface.
const WINDOW_SIGMAS: f64 = 1.5;
/// Fewer pixels than this are no surface.
const FEWEST_PIXELS: f64 = 3.0;
/// No surface must fill more of the image's height than this.
const LARGEST_SHARE: f64 = 0.25;
/// Surfaces that are kept in a column, nearest first.
pub(super) const MOST_SURFACES: usize = 8;

/// A surface in one column.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Surface {
    pub column: usize,
    pub support: Support,
    /// Variance of its mean depth, m^2.
    pub variance_m2: f64,
}

/// Finds the surfaces of all columns.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    /// Half width of the window of each bin, bins.
    windows: Vec<usize>,
    /// Least count in the window of each bin.
    thresholds: Vec<u16>,
    /// Sums of the columns in the present window.
    sums: Vec<u16>,
    /// Whether the columns' sums reached the threshold in the bin before, and do in this one.
    before: Vec<u8>,
    present: Vec<u8>,
    /// First bin of each column's open run.
    starts: Vec<u16>,
    /// `MOST_SURFACES` places for each column.
    surfaces: Vec<Surface>,
    found: Vec<u8>,
}

impl Columns {
    /// The surfaces of a column, nearest first.
    pub fn of(&self, column: usize) -> &[Surface] {
        let from = column * MOST_SURFACES;
        &self.surfaces[from..from + usize::from(self.found[column])]
    }

    pub fn len(&self) -> usize {
        self.found.len()
    }

    /// Finds the surfaces of a map.
    pub fn find(&mut self, map: &Histogram, level: &Level, config: &DetectorConfig) {
        self.prepare(map, level, config);
        let bins = map.view().bins;
        // The first bin holds the pixels without return.
        let (mut low, mut high) = (1, 1);
        for bin in 1..bins {
            let window = self.windows[bin];
            while high < bins && high <= bin + window {
                add(&mut self.sums, map.view().row(high));
                high += 1;
            }
            while low + window < bin {
                subtract(&mut self.sums, map.view().row(low));
                low += 1;
            }
            self.compare(self.thresholds[bin]);
            self.follow_runs(bin, map, config);
            std::mem::swap(&mut self.before, &mut self.present);
        }
        self.present.fill(0);
        self.follow_runs(bins, map, config);
    }

    fn prepare(&mut self, map: &Histogram, level: &Level, config: &DetectorConfig) {
        let view = map.view();
        let rows = f64::from(level.camera.height_px) / f64::from(map.row_stride);
        let most = (LARGEST_SHARE * rows).max(FEWEST_PIXELS);
        self.windows.clear();
        self.thresholds.clear();
        for bin in 0..view.bins {
            let depth_m = (bin as f64 + 0.5) * view.bin_m;
            let sigma_m = config.noise().sigma_m(depth_m);
            // The borders of the window move only forwards if it grows by a bin at most.
            let grown = self.windows.last().map_or(0, |before| before + 1);
            let window = (WINDOW_SIGMAS * sigma_m / view.bin_m).ceil() as usize;
            self.windows.push(window.min(grown));
            let pixels = level.camera.fy_px * config.min_height_m / depth_m;
            let threshold = pixels / f64::from(map.row_stride);
            self.thresholds
                .push(threshold.clamp(FEWEST_PIXELS, most) as u16);
        }
        let padded = view.columns.next_multiple_of(8);
        let most = level.most_columns.next_multiple_of(8);
        refill(&mut self.sums, padded, most);
        refill(&mut self.before, padded, most);
        refill(&mut self.present, padded, most);
        refill(&mut self.starts, padded, most);
        refill(&mut self.found, view.columns, most);
        let places = view.columns * MOST_SURFACES;
        fit(&mut self.surfaces, places, most * MOST_SURFACES);
    }

    fn compare(&mut self, threshold: u16) {
        for (flag, sum) in self.present.iter_mut().zip(&self.sums) {
            *flag = u8::from(*sum >= threshold);
        }
    }

    /// Opens and closes the runs of the columns whose flag changes at `bin`.
    fn follow_runs(&mut self, bin: usize, map: &Histogram, config: &DetectorConfig) {
        for block in (0..self.present.len()).step_by(8) {
            let mut changed = eight(&self.present, block) ^ eight(&self.before, block);
            while changed != 0 {
                let column = block + changed.trailing_zeros() as usize / 8;
                changed &= changed - 1;
                if self.present[column] == 1 {
                    self.starts[column] = bin as u16;
                } else {
                    self.close(column, bin, map, config);
                }
            }
        }
    }

    /// Keeps the surface of a run that ended before `bin`.
    fn close(&mut self, column: usize, bin: usize, map: &Histogram, config: &DetectorConfig) {
        let found = usize::from(self.found[column]);
        if found == MOST_SURFACES {
            return;
        }
        // A weak surface reaches the threshold only where most of its window is; half a window more
        // on each side finds the rest of it.
        let start = usize::from(self.starts[column]);
        let first = (start - (self.windows[start] / 2).min(start)).max(1);
        let last = (bin - 1 + self.windows[bin - 1] / 2).min(self.windows.len() - 1);
        let support = map.support(column, first, last);
        if support.count == 0 {
            return;
        }
        let noise_m2 = config.noise().variance_m2(support.depth_m);
        let rounding_m2 = config.bin_m * config.bin_m / (12.0 * 64.0 * 64.0);
        self.surfaces[column * MOST_SURFACES + found] = Surface {
            column,
            support,
            variance_m2: (noise_m2 / f64::from(support.count)) + rounding_m2,
        };
        self.found[column] += 1;
    }
}

/// Eight flags of 0 or 1 as one number, the first in its lowest byte.
fn eight(flags: &[u8], from: usize) -> u64 {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&flags[from..from + 8]);
    u64::from_le_bytes(bytes)
}

fn add(sums: &mut [u16], row: &[u16]) {
    for (sum, count) in sums.iter_mut().zip(row) {
        *sum = sum.wrapping_add(*count);
    }
}

fn subtract(sums: &mut [u16], row: &[u16]) {
    for (sum, count) in sums.iter_mut().zip(row) {
        *sum = sum.wrapping_sub(*count);
    }
}
