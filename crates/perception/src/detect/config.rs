//! Parameters of the detector.

use alula_parameters::parameters;

parameters! {
    /// How boxes are found in a depth image (document L, section 5-1-3).
    pub struct DetectorConfig {
        /// Width of a bin of the histogram of depths, m (L: 5 cm).
        pub bin_m: f64 = 0.05, within(0.01, 0.5);
        /// Greatest depth at which a thing is reported, m (L: 5 m).
        pub max_depth_m: f64 = 5.0, within(0.5, 20.0);
        /// Least height of a surface that is a point of interest, m: `T_h` of L, equation 5-1.
        pub min_height_m: f64 = 0.2, within(0.01, 2.0);
        /// Least width of a thing, m: `T_w` of L, equation 5-2.
        pub min_width_m: f64 = 0.08, within(0.01, 2.0);
        /// Growth `a` of the noise of the sensor, 1/m: a depth `z` has the standard deviation
        /// `a z^2`. The default is that of a stereo camera with 50 mm between its imagers and 0.08
        /// pixels of error at 424 columns.
        pub noise_per_m: f64 = 0.0072, within(0.0, 0.1);
        /// Every how many rows of the image one is read.
        pub row_stride: u32 = 2, within(1.0, 16.0);
        /// Height above the floor, m, up to which returns are taken for the floor, beside what
        /// noise and attitude explain.
        pub floor_margin_m: f64 = 0.08, within(0.0, 1.0);
        /// Standard deviations of noise and attitude that the margin of the floor adds.
        pub floor_sigmas: f64 = 3.0, within(0.0, 10.0);
        /// Step in depth, m, that one surface may make between neighbouring columns, beside its
        /// noise and its slope.
        pub step_m: f64 = 0.12, within(0.01, 1.0);
        /// Gap, m, that is bridged within a thing.
        pub gap_m: f64 = 0.08, within(0.0, 1.0);
        /// Greatest length and width of a compact thing, m; longer ones are cut into pieces.
        pub max_box_m: f64 = 1.1, within(0.2, 5.0);
        /// Greatest length of a piece of a long surface, m.
        pub piece_m: f64 = 0.8, within(0.1, 5.0);
        /// Distance from a line, m, beside the noise, at which a long surface is bent.
        pub bend_m: f64 = 0.08, within(0.01, 1.0);
        /// Thickness of a flat piece, m: what is behind its face is not seen.
        pub thickness_m: f64 = 0.1, within(0.01, 1.0);
        /// Depth of an arc as a share of its width above which a front is round.
        pub round_share: f64 = 0.1, within(0.0, 0.5);
        /// Pixels at the border of the image within which a thing is cut off.
        pub border_px: u32 = 4, within(1.0, 64.0);
        /// Standard deviation of what lies beyond a border, m.
        pub unseen_m: f64 = 0.3, within(0.0, 3.0);
        /// Standard deviation of the surface of a thing about its model, m.
        pub roughness_m: f64 = 0.02, within(0.001, 0.5);
        /// Directions of the free view.
        pub rays: u32 = 96, within(8.0, 512.0);
        /// Least height above the floor that counts for the free view, m.
        pub free_from_m: f64 = 0.3, within(0.0, 5.0);
        /// Greatest height above the floor that counts for the free view, m.
        pub free_to_m: f64 = 2.2, within(0.1, 50.0);
        /// Height above and below the camera that counts for the free view where the floor is not
        /// known, m.
        pub free_about_m: f64 = 0.8, within(0.1, 10.0);
    }
}

/// Noise of a depth sensor that matches two images: the standard deviation of a depth `z` is
/// `a z^2` (paper of document L, section III-A).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthNoise {
    /// `a`, 1/m.
    pub per_m: f64,
}

impl DepthNoise {
    /// Standard deviation of a depth, m.
    pub fn sigma_m(&self, depth_m: f64) -> f64 {
        self.per_m * depth_m * depth_m
    }

    /// Variance of a depth, m^2.
    pub fn variance_m2(&self, depth_m: f64) -> f64 {
        self.sigma_m(depth_m) * self.sigma_m(depth_m)
    }
}

impl DetectorConfig {
    /// Noise of the sensor.
    pub fn noise(&self) -> DepthNoise {
        DepthNoise {
            per_m: self.noise_per_m,
        }
    }
}
