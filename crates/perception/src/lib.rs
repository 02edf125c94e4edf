//! Depth images to obstacles (document L, chapter 5): boxes by the U-depth map, tracks with
//! velocities, and how far the view is free.

mod contour;

pub use contour::{Contour, Ray, RayEnd};
