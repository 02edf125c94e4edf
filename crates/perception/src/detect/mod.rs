//! Boxes around the things in a depth image, by its U-depth map (document L, section 5-1-3; the
//! derivation is in `docs/derivations/u-depth.md`).

mod boxes;
mod chains;
mod columns;
mod config;
mod fit;
mod free;
mod histogram;
mod level;
mod reduce;
mod shape;
mod split;

use alula_geometry::Pose;
use alula_messages::{DepthImage, Detection};
use alula_parameters::{ParameterError, Parameters};
use nalgebra::Matrix3;

use crate::Contour;
use boxes::Boxes;
use chains::Chains;
use columns::Columns;
pub use config::{DepthNoise, DetectorConfig};
use histogram::Histogram;
pub use histogram::UDepth;
use level::Level;
pub use reduce::reduce;

/// Empties a list and takes the memory that it needs at most, once.
fn empty<T>(values: &mut Vec<T>, most: usize) {
    values.clear();
    values.reserve(most);
}

/// Fills a list with zeros, and takes the memory that it needs at most, once.
fn refill<T: Clone + Default>(values: &mut Vec<T>, length: usize, most: usize) {
    empty(values, most);
    values.resize(length, T::default());
}

/// Gives a list its length, for values that are set before they are read, and takes the memory that
/// it needs at most, once.
fn fit<T: Clone + Default>(values: &mut Vec<T>, length: usize, most: usize) {
    if values.capacity() < most {
        empty(values, most);
    }
    values.resize(length, T::default());
}

/// From where an image was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Pose of the vehicle at the time of exposure.
    pub world_from_body: Pose,
    /// Covariance of its orientation, rotation vector in the body frame, rad^2.
    pub orientation_covariance: Matrix3<f64>,
    /// Height of the floor in the world, m, if it is known.
    pub floor_height_m: Option<f64>,
}

/// Finds boxes in depth images.
#[derive(Clone, Debug)]
pub struct Detector {
    config: DetectorConfig,
    map: Histogram,
    columns: Columns,
    chains: Chains,
    boxes: Boxes,
    detections: Vec<Detection>,
    contour: Contour,
}

impl Detector {
    /// A detector.
    ///
    /// # Errors
    /// When a parameter is out of its range.
    pub fn new(config: &DetectorConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        Ok(Self {
            config: config.clone(),
            map: Histogram::new(config),
            columns: Columns::default(),
            chains: Chains::default(),
            boxes: Boxes::default(),
            detections: Vec::new(),
            contour: Contour::default(),
        })
    }

    /// The things in an image. Nothing where the size of the image is not that of its camera, where
    /// the view is not finite, or where the camera looks straight up or down.
    ///
    /// Memory is taken with the first image of a size, and kept.
    pub fn detect(&mut self, image: &DepthImage, view: &View) -> &[Detection] {
        self.detections.clear();
        let config = &self.config;
        let Some(level) = Level::new(image, view) else {
            self.contour.time = image.time;
            self.contour.sensor = image.sensor;
            self.contour.rays.clear();
            return &self.detections;
        };
        empty(&mut self.detections, level.most_columns);
        self.map.fill(image, &level, config);
        self.columns.find(&self.map, &level, config);
        self.chains.link(&self.columns, &level, config);
        self.boxes
            .make(&self.chains, &level, config, &mut self.detections);
        let contour = &mut self.contour;
        free::look(contour, image, &self.map, &self.columns, &level, config);
        &self.detections
    }

    /// How far the view of the last image is free; no rays if it could not be used.
    pub fn contour(&self) -> &Contour {
        &self.contour
    }

    /// The histogram of the last image: for pictures.
    pub fn u_depth(&self) -> UDepth<'_> {
        self.map.view()
    }
}
