//! Depth images to obstacles (document L, chapter 5): boxes by the U-depth map, tracks with
//! velocities, and how far the view is free.

mod contour;
pub mod detect;
mod seen;
mod track;

pub use contour::{Contour, MOST_LATE_S, Ray, RayEnd};
pub use detect::{DepthNoise, Detector, DetectorConfig, UDepth, View};
pub use seen::{SeenSpace, SeenSpaceConfig};
pub use track::{
    FlatConfig, MotionTestConfig, TrackLifeConfig, TrackModelConfig, Tracker, TrackerConfig,
};
