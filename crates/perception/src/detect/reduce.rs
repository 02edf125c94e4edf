//! Images of half the size.

use alula_messages::DepthImage;

/// Depths of the same surface as the nearest of four: within one part in this many.
const SAME: u16 = 16;

/// Halves an image: each pixel is the mean of those of its four that lie on the nearest surface,
/// so that thin things in the foreground stay and noise falls without moving surfaces nearer.
///
/// An odd last row or column is left out. `into` keeps its memory.
pub fn reduce(image: &DepthImage, into: &mut DepthImage) {
    let (width, height) = (
        image.camera.width_px as usize,
        image.camera.height_px as usize,
    );
    let camera = &mut into.camera;
    *camera = image.camera;
    (camera.width_px, camera.height_px) = (width as u32 / 2, height as u32 / 2);
    (camera.fx_px, camera.fy_px) = (0.5 * camera.fx_px, 0.5 * camera.fy_px);
    // The middle of the first pixel is half a pixel right of and below that of the old one.
    (camera.cx_px, camera.cy_px) = (0.5 * (camera.cx_px - 0.5), 0.5 * (camera.cy_px - 0.5));
    into.time = image.time;
    into.body_from_camera = image.body_from_camera;
    into.depth_mm.clear();
    if width < 2 || image.depth_mm.len() != width * height {
        return;
    }
    into.depth_mm.resize((width / 2) * (height / 2), 0);
    let rows = into.depth_mm.chunks_exact_mut(width / 2);
    for (pair, row) in image.depth_mm.chunks_exact(2 * width).zip(rows) {
        let (upper, lower) = pair.split_at(width);
        halve(upper, lower, row);
    }
}

/// Halves a pair of rows. A function of its own, whose arguments are known not to overlap, on
/// numbers of 16 bits: the vector unit does eight pixels at a time.
#[inline(never)]
fn halve(upper: &[u16], lower: &[u16], row: &mut [u16]) {
    let blocks = upper.chunks_exact(2).zip(lower.chunks_exact(2));
    for ((a, b), depth_mm) in blocks.zip(row) {
        *depth_mm = nearest([a[0], a[1], b[0], b[1]]);
    }
}

/// Mean of the depths near the least one; 0 if none is valid. Nothing valid wraps to the largest
/// number and stays out.
#[inline(always)]
fn nearest(depths_mm: [u16; 4]) -> u16 {
    let keys = depths_mm.map(|mm| if mm == 0 { u16::MAX } else { mm });
    let least = keys[0].min(keys[1]).min(keys[2].min(keys[3]));
    let limit = least.saturating_add(least / SAME).min(u16::MAX - 1);
    // The depths beyond the least, of which there are three at most, have sums of 16 bits.
    let (mut beyond, mut number): (u16, u16) = (0, 0);
    for key in keys {
        let is_same = key <= limit;
        beyond += if is_same { key - least } else { 0 };
        number += u16::from(is_same);
    }
    // Twelve has all numbers of 1 to 4 as divisors, and a division by a constant is a product.
    let twelfths = match number {
        2 => 6,
        3 => 4,
        _ => 3,
    };
    let mean = least + (beyond * twelfths + 6) / 12;
    if least == u16::MAX { 0 } else { mean }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::{PinholeCamera, Pose, Timestamp};

    fn image(depth_mm: Vec<u16>) -> DepthImage {
        DepthImage {
            time: Timestamp::ZERO,
            sensor: 0,
            camera: PinholeCamera::from_field_of_view(4, 2, 1.0, 0.6),
            body_from_camera: Pose::identity(),
            depth_mm,
        }
    }

    #[test]
    fn a_pixel_is_the_mean_of_the_nearest_surface_of_its_four() {
        let image = image(vec![1000, 0, 0, 0, 1010, 3000, u16::MAX, 0]);
        let mut half = image.clone();
        reduce(&image, &mut half);
        assert_eq!(half.depth_mm, [1005, 0]);
    }

    #[test]
    fn the_halved_camera_sees_along_the_same_rays() {
        let image = image(vec![1000; 8]);
        let mut half = image.clone();
        reduce(&image, &mut half);
        // The middle of the first four pixels is the middle of the first one of half the size.
        let apart = image.camera.ray(0.5, 0.5) - half.camera.ray(0.0, 0.0);
        assert!(apart.norm() < 1e-12);
        let apart = image.camera.ray(2.5, 0.5) - half.camera.ray(1.0, 0.0);
        assert!(apart.norm() < 1e-12);
    }
}
