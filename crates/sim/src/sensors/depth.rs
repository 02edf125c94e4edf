//! Depth camera: the rendered scene with the errors of stereo matching.

use std::sync::Arc;

use alula_geometry::{PinholeCamera, Pose, Timestamp};
use alula_messages::{DepthImage, Mount};
use alula_parameters::{facts, parameters};

use super::channel::Channel;
use super::failure::FailureConfig;
use super::noise::Noise;
use super::step::Step;
use crate::render::DepthRenderer;

parameters! {
    /// Errors and limits of a stereo depth camera; the defaults are those of the Intel RealSense
    /// D435i of document L (section 3-1-1, chapter 5).
    pub struct DepthModel {
        /// Images per second.
        pub rate_hz: f64 = 30.0, within(1.0, 90.0);
        /// Time from exposure to arrival, s.
        pub latency_s: f64 = 0.03, within(0.0, 1.0);
        /// Columns of the image.
        pub width_px: u32 = 424, within(16.0, 1280.0);
        /// Rows of the image.
        pub height_px: u32 = 240, within(16.0, 800.0);
        /// Full horizontal opening angle, degrees.
        pub horizontal_fov_deg: f64 = 87.0, within(10.0, 150.0);
        /// Full vertical opening angle, degrees.
        pub vertical_fov_deg: f64 = 58.0, within(10.0, 150.0);
        /// Least depth it can measure, m.
        pub min_m: f64 = 0.2, within(0.01, 5.0);
        /// Greatest depth it can measure, m.
        pub max_m: f64 = 10.0, within(0.5, 65.0);
        /// Distance between the two imagers, m (D435i: 50 mm).
        pub baseline_m: f64 = 0.05, within(0.01, 1.0);
        /// Standard deviation of the matched disparity, pixels. A depth `z` then has the standard
        /// deviation `a z^2` with `a = noise / (focal length * baseline)`: 0.0072 per metre with
        /// the defaults, so 2.9 cm at 2 m, within the 2 % that the maker states there.
        pub disparity_noise_px: f64 = 0.08, within(0.0, 5.0);
        /// Constant error of the disparity, pixels: the error of its calibration.
        pub disparity_bias_px: f64 = 0.0, within(-5.0, 5.0);
        /// Step of the disparity between neighbouring pixels above which neither is matched, px.
        pub edge_disparity_px: f64 = 1.0, above(0.0);
        /// Failures.
        pub failures: Vec<FailureConfig> = Vec::new(), nested();
    }
}

facts! {
    /// A depth camera on a vehicle.
    pub struct DepthSetup {
        /// Calibrated pose in the body.
        pub mount: Mount, nested();
        /// Errors and limits.
        #[serde(default)]
        pub model: DepthModel, nested();
    }
}

impl DepthModel {
    /// Projection of the camera.
    pub fn camera(&self) -> PinholeCamera {
        PinholeCamera::from_field_of_view(
            self.width_px,
            self.height_px,
            self.horizontal_fov_deg.to_radians(),
            self.vertical_fov_deg.to_radians(),
        )
    }

    /// Growth of the noise: the standard deviation of a depth `z` is this (1/m) times `z^2`, to
    /// first order in the error of the disparity.
    pub fn noise_per_m(&self) -> f64 {
        self.disparity_noise_px / (self.camera().fx_px * self.baseline_m)
    }
}

/// The errors of stereo matching, applied to a true depth image.
#[derive(Clone, Debug)]
struct StereoErrors {
    width: usize,
    min_m: f32,
    max_m: f32,
    /// Focal length times baseline: disparity = this / depth, px m.
    disparity_px_m: f32,
    edge_px: f32,
    noise_px: f32,
    bias_px: f32,
    /// Disparities of the image, px; 0 where nothing is.
    disparity_px: Vec<f32>,
    /// Errors of the disparities, px.
    error_px: Vec<f32>,
}

impl StereoErrors {
    fn new(model: &DepthModel) -> Self {
        let camera = model.camera();
        let pixels = model.width_px as usize * model.height_px as usize;
        Self {
            width: model.width_px as usize,
            min_m: model.min_m as f32,
            max_m: model.max_m as f32,
            disparity_px_m: (camera.fx_px * model.baseline_m) as f32,
            edge_px: model.edge_disparity_px as f32,
            noise_px: model.disparity_noise_px as f32,
            bias_px: model.disparity_bias_px as f32,
            disparity_px: vec![0.0; pixels],
            error_px: vec![0.0; pixels],
        }
    }

    /// Fills `measured_mm` with what stereo matching makes of `true_m`.
    fn apply(&mut self, true_m: &[f32], noise: &mut Noise, measured_mm: &mut [u16]) {
        // Drawing first leaves the arithmetic to the vector unit.
        for error_px in &mut self.error_px {
            *error_px = self.bias_px + self.noise_px * noise.fast_normal();
        }
        for (disparity_px, depth_m) in self.disparity_px.iter_mut().zip(true_m) {
            *disparity_px = self.disparity_px_m / depth_m;
        }
        let disparities = self.disparity_px.iter().zip(&self.error_px);
        for ((disparity_px, error_px), depth_mm) in disparities.zip(measured_mm.iter_mut()) {
            let measured_m = self.disparity_px_m / (disparity_px + error_px);
            let in_range = measured_m >= self.min_m && measured_m <= self.max_m;
            let reading_m = if in_range { measured_m } else { 0.0 };
            *depth_mm = (reading_m * 1000.0 + 0.5) as u16;
        }
        self.cut_edges(measured_mm);
        self.cut_hidden(measured_mm);
    }

    /// Removes both sides of every step of the disparity: no window matches across it.
    fn cut_edges(&self, measured_mm: &mut [u16]) {
        let (disparity, width) = (&self.disparity_px, self.width);
        for (row, line) in disparity.chunks_exact(width).enumerate() {
            for (column, pair) in line.windows(2).enumerate() {
                if (pair[0] - pair[1]).abs() > self.edge_px {
                    measured_mm[row * width + column] = 0;
                    measured_mm[row * width + column + 1] = 0;
                }
            }
        }
        for (upper, (above, below)) in disparity.iter().zip(&disparity[width..]).enumerate() {
            if (above - below).abs() > self.edge_px {
                measured_mm[upper] = 0;
                measured_mm[upper + width] = 0;
            }
        }
    }

    /// Removes what the right imager does not see. A pixel `u` with disparity `d` lies at `u - d`
    /// in the right image; it is hidden if something that lies further right in the left image
    /// lies further left there. The tolerance keeps surfaces that are seen at a grazing angle.
    fn cut_hidden(&self, measured_mm: &mut [u16]) {
        let lines = self.disparity_px.chunks_exact(self.width);
        for (line, depths) in lines.zip(measured_mm.chunks_exact_mut(self.width)) {
            let mut leftmost_px = f32::INFINITY;
            for column in (0..self.width).rev() {
                let right_px = column as f32 - line[column];
                if right_px > leftmost_px + self.edge_px {
                    depths[column] = 0;
                }
                leftmost_px = leftmost_px.min(right_px);
            }
        }
    }
}

/// The simulated sensor.
pub(super) struct Depth {
    sensor: u8,
    camera: PinholeCamera,
    body_from_camera: Pose,
    renderer: DepthRenderer,
    errors: StereoErrors,
    channel: Channel<Arc<DepthImage>>,
    noise: Noise,
    /// Images that are used again once nobody else holds them.
    pool: Vec<Arc<DepthImage>>,
}

impl Depth {
    /// The camera with number `sensor` of a vehicle.
    pub(super) fn new(setup: &DepthSetup, sensor: u8, flight_seed: u64) -> Self {
        let model = &setup.model;
        let name = match sensor {
            0 => "depth".to_owned(),
            number => format!("depth-{number}"),
        };
        Self {
            sensor,
            camera: model.camera(),
            body_from_camera: setup.mount.body_from_sensor(),
            renderer: DepthRenderer::new(model.camera()),
            errors: StereoErrors::new(model),
            channel: Channel::new(
                model.rate_hz,
                model.latency_s,
                &model.failures,
                flight_seed,
                &name,
            ),
            noise: Noise::new(flight_seed, &name),
            pool: Vec::new(),
        }
    }

    pub(super) fn advance(&mut self, step: &Step) {
        while self.channel.due() <= step.to.time {
            let image = self.expose(step, self.channel.due());
            self.channel.send(image);
        }
    }

    pub(super) fn deliver(&mut self, now: Timestamp, received: &mut Vec<Arc<DepthImage>>) {
        self.channel.deliver(now, received);
    }

    fn expose(&mut self, step: &Step, time: Timestamp) -> Arc<DepthImage> {
        let world_from_camera = step.pose_at(time) * self.body_from_camera;
        let mut image = self.blank(time);
        let true_m = self.renderer.render(step.world, time, &world_from_camera);
        let measured_mm = &mut Arc::make_mut(&mut image).depth_mm;
        self.errors.apply(true_m, &mut self.noise, measured_mm);
        self.pool.push(image.clone());
        image
    }

    /// An image of the right size that nobody else holds.
    fn blank(&mut self, time: Timestamp) -> Arc<DepthImage> {
        let free = self
            .pool
            .iter()
            .position(|image| Arc::strong_count(image) == 1);
        let mut image = match free {
            Some(index) => self.pool.swap_remove(index),
            None => Arc::new(DepthImage {
                time,
                sensor: self.sensor,
                camera: self.camera,
                body_from_camera: self.body_from_camera,
                depth_mm: vec![0; self.errors.disparity_px.len()],
            }),
        };
        Arc::make_mut(&mut image).time = time;
        image
    }
}

#[cfg(test)]
mod tests {
    use super::super::noise::mean_and_variance;
    use super::*;

    /// What the errors make of an image whose depth is a function of the column.
    fn measured(model: &DepthModel, depth_m: impl Fn(usize) -> f32) -> Vec<u16> {
        let (width, height) = (model.width_px as usize, model.height_px as usize);
        let true_m: Vec<f32> = (0..width * height).map(|i| depth_m(i % width)).collect();
        let mut measured_mm = vec![0; true_m.len()];
        let mut noise = Noise::new(1, "depth");
        StereoErrors::new(model).apply(&true_m, &mut noise, &mut measured_mm);
        measured_mm
    }

    fn noiseless() -> DepthModel {
        DepthModel {
            disparity_noise_px: 0.0,
            ..DepthModel::default()
        }
    }

    #[test]
    fn noise_grows_with_the_square_of_depth() {
        let model = DepthModel::default();
        for depth_m in [0.5, 1.0, 2.0, 4.0] {
            let image = measured(&model, |_| depth_m as f32);
            let values: Vec<f64> = image.iter().map(|&mm| f64::from(mm) / 1000.0).collect();
            let (_, variance) = mean_and_variance(&values);
            // Rounding to millimetres adds 1/12 mm^2. The standard error of the sigma of 100000
            // pixels is 0.2 %; terms of second order in the disparity add up to 1.5 % at 4 m.
            let sigma_m = (variance - 1e-6 / 12.0).sqrt();
            let expected_m = model.noise_per_m() * depth_m * depth_m;
            assert!(
                (sigma_m / expected_m - 1.0).abs() < 0.02,
                "{sigma_m} {expected_m}"
            );
        }
    }

    #[test]
    fn without_noise_depth_is_rounded_to_the_millimetre() {
        assert!(
            measured(&noiseless(), |_| 1.2344)
                .iter()
                .all(|&mm| mm == 1234)
        );
    }

    #[test]
    fn surfaces_out_of_range_give_no_return() {
        for depth_m in [0.19, 10.1, 50.0, f32::INFINITY] {
            assert!(
                measured(&noiseless(), |_| depth_m)
                    .iter()
                    .all(|&mm| mm == 0)
            );
        }
        // With noise as well: ten metres more are seven sigmas of disparity.
        let far = measured(&DepthModel::default(), |_| 20.0);
        assert!(far.iter().all(|&mm| mm == 0));
    }

    #[test]
    fn the_right_imager_does_not_see_a_strip_left_of_a_near_thing() {
        let model = noiseless();
        let line = &measured(&model, |u| if u >= 200 { 1.0 } else { 4.0 })[..424];
        // Disparities differ by f b (1/1 - 1/4) = 8.4 pixels; 1 pixel is tolerated.
        let f_b = (model.camera().fx_px * model.baseline_m) as f32;
        let strip_px = (f_b * 0.75 - 1.0) as usize;
        let holes: Vec<usize> = (0..424).filter(|&u| line[u] == 0).collect();
        assert_eq!(holes[0], 200 - strip_px);
        assert_eq!(holes[holes.len() - 1], 200);
        assert_eq!(holes.len(), strip_px + 1);
    }

    #[test]
    fn to_the_right_of_a_near_thing_only_the_edge_is_lost() {
        let line = &measured(&noiseless(), |u| if u < 200 { 1.0 } else { 4.0 })[..424];
        let holes: Vec<usize> = (0..424).filter(|&u| line[u] == 0).collect();
        assert_eq!(holes, [199, 200]);
    }

    #[test]
    fn images_are_used_again_once_they_are_free() {
        let mount = Mount::at([0.0; 3], alula_messages::Looking::Forward);
        let setup = DepthSetup {
            mount,
            model: DepthModel::default(),
        };
        let mut depth = Depth::new(&setup, 0, 1);
        let first = depth.blank(Timestamp::ZERO);
        let address = Arc::as_ptr(&first);
        depth.pool.push(first.clone());
        assert_ne!(Arc::as_ptr(&depth.blank(Timestamp::ZERO)), address);
        drop(first);
        assert_eq!(Arc::as_ptr(&depth.blank(Timestamp::ZERO)), address);
    }
}
