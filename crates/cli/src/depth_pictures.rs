//! Depth images and U-depth maps as pictures in false colours.

use alula_messages::{DepthImage, Detection, error_index};
use alula_perception::{Detector, DetectorConfig, Ray, UDepth, View};
use alula_runtime::belief::Moment;
use nalgebra::{UnitQuaternion, Vector3};

use crate::plot::{BLANK, Colour, Picture, PictureBox, false_colour};

/// The last colour stands for this depth, m.
const FAR_M: f64 = 8.0;

/// How images were looked at.
#[derive(Clone, Debug, Default)]
pub struct Eye {
    /// The detector.
    pub detector: DetectorConfig,
    /// Height of the floor that it was told, world, m.
    pub floor_height_m: Option<f64>,
}

/// A depth image with the boxes that were seen in it.
pub fn depth_picture(image: &DepthImage, detections: &[Detection]) -> Picture {
    let colour = |mm: &u16| match mm {
        0 => BLANK,
        // Near is bright.
        mm => false_colour(1.0 - f64::from(*mm) * 1e-3 / FAR_M),
    };
    let own = detections.iter().filter(|d| d.sensor == image.sensor);
    Picture {
        title: "depth image with the boxes found in it".to_owned(),
        columns: image.camera.width_px as usize,
        pixels: image.depth_mm.iter().map(colour).collect(),
        aspect: None,
        boxes: own.map(window).collect(),
        scale: [format!("{FAR_M:.0} m and beyond"), "0 m".to_owned()],
    }
}

fn window(detection: &Detection) -> PictureBox {
    let window = &detection.window;
    PictureBox {
        left: f64::from(window.left),
        top: f64::from(window.top),
        // The last column and row belong to the window.
        right: f64::from(window.right) + 1.0,
        bottom: f64::from(window.bottom) + 1.0,
        label: format!("{:.1} m", detection.depth_m[0]),
        colour: Colour::Vermillion,
    }
}

/// The U-depth map of a moment's image, the farthest bins on top, with the extents of the boxes in
/// breadth and depth.
pub fn u_depth_picture(image: &DepthImage, moment: &Moment, eye: &Eye) -> Picture {
    let title = "U-depth map with the extents of the boxes".to_owned();
    let empty = Picture {
        title: title.clone(),
        aspect: Some(aspect(image)),
        ..Picture::default()
    };
    let Ok(mut detector) = Detector::new(&eye.detector) else {
        return empty;
    };
    look(&mut detector, image, moment, eye);
    let map = detector.u_depth();
    let Some(columns) = Columns::new(image, moment, &detector) else {
        return empty;
    };
    // Bright from the number of pixels on that makes a point of interest at half the range.
    let full = f64::from(image.camera.height_px) * 0.5;
    let colour = |count: &u16| match count {
        0 => BLANK,
        count => false_colour((1.0 + f64::from(*count)).ln() / (1.0 + full).ln()),
    };
    // The nearest bin holds the pixels without a return.
    let nothing = vec![0; map.columns];
    let row = |bin: usize| if bin == 0 { &nothing } else { map.row(bin) };
    let rows = (0..map.bins).rev().flat_map(row);
    Picture {
        title,
        columns: map.columns,
        pixels: rows.map(colour).collect(),
        aspect: Some(aspect(image)),
        boxes: moment
            .detections
            .iter()
            .map(|d| extent(d, image, &map, &columns))
            .collect(),
        scale: [
            "1 pixel a column".to_owned(),
            format!(
                "{full:.0} pixels; {:.1} m high",
                map.bin_m * map.bins as f64
            ),
        ],
    }
}

/// Looks at an image as the vehicle did at that moment.
fn look(detector: &mut Detector, image: &DepthImage, moment: &Moment, eye: &Eye) {
    let orientation = error_index::ORIENTATION;
    let covariance = moment
        .state
        .covariance
        .fixed_view::<3, 3>(orientation, orientation);
    let view = View {
        world_from_body: moment.state.world_from_body,
        orientation_covariance: covariance.into_owned(),
        floor_height_m: eye.floor_height_m,
    };
    detector.detect(image, &view);
}

fn aspect(image: &DepthImage) -> f64 {
    f64::from(image.camera.height_px) / f64::from(image.camera.width_px.max(1))
}

/// Columns of a map by direction: the rays of the contour are as wide as each other in columns, so
/// two of them tell where all tangents lie.
struct Columns {
    /// Heading of the camera, rad.
    axis_rad: f64,
    world_from_camera: UnitQuaternion<f64>,
    /// Tangent of a direction and its column, twice.
    known: [(f64, f64); 2],
}

impl Columns {
    fn new(image: &DepthImage, moment: &Moment, detector: &Detector) -> Option<Self> {
        let world_from_body = moment.state.world_from_body.rotation;
        let world_from_camera = world_from_body * image.body_from_camera.rotation;
        let axis_rad = heading_rad(&(world_from_camera * Vector3::z()));
        let rays = &detector.contour().rays;
        let (count, columns) = (rays.len(), detector.u_depth().columns);
        let (first, last) = (rays.first()?, rays.last()?);
        let middle = |ray: usize| {
            let border = |ray: usize| ray * columns / count;
            0.5 * (border(ray) + border(ray + 1)) as f64
        };
        let tan = |ray: &Ray| (axis_rad - ray.heading_rad).tan();
        (count > 1).then(|| Self {
            axis_rad,
            world_from_camera,
            known: [(tan(first), middle(0)), (tan(last), middle(count - 1))],
        })
    }

    /// Column of the map in which a pixel at half the height of the image lies.
    fn of(&self, column_px: f64, image: &DepthImage) -> f64 {
        let camera = &image.camera;
        let row_px = 0.5 * f64::from(camera.height_px);
        let ray = Vector3::new(
            (column_px - camera.cx_px) / camera.fx_px,
            (row_px - camera.cy_px) / camera.fy_px,
            1.0,
        );
        let tan = (self.axis_rad - heading_rad(&(self.world_from_camera * ray))).tan();
        let [(tan_a, column_a), (tan_b, column_b)] = self.known;
        column_a + (tan - tan_a) / (tan_b - tan_a) * (column_b - column_a)
    }
}

fn heading_rad(direction: &Vector3<f64>) -> f64 {
    direction.y.atan2(direction.x)
}

/// A box in the map.
fn extent(
    detection: &Detection,
    image: &DepthImage,
    map: &UDepth,
    columns: &Columns,
) -> PictureBox {
    let row = |depth_m: f64| map.bins as f64 - depth_m / map.bin_m;
    PictureBox {
        left: columns.of(f64::from(detection.window.left), image),
        // The last column belongs to the window.
        right: columns.of(f64::from(detection.window.right) + 1.0, image),
        top: row(detection.depth_m[1]) - 1.0,
        bottom: row(detection.depth_m[0]) + 1.0,
        label: String::new(),
        colour: Colour::Vermillion,
    }
}

#[cfg(test)]
mod tests {
    use alula_geometry::{PinholeCamera, Pose, Timestamp, so3};
    use alula_messages::{Looking, Mount, NavState};
    use std::sync::Arc;

    use super::*;

    /// The columns of the map that the seen thing fills, and the extent that is drawn of it, for a
    /// vehicle that is turned and tilted: roll, pitch, yaw, rad. The thing fills the columns 20 to
    /// 35 of an image without a view of the floor.
    fn found_and_drawn(attitude: [f64; 3]) -> ([f64; 2], [f64; 2]) {
        let camera = PinholeCamera::from_field_of_view(64, 40, 1.2, 0.1);
        let thing = |i: usize| (20..36).contains(&(i % 64));
        let image = DepthImage {
            time: Timestamp::ZERO,
            sensor: 0,
            camera,
            body_from_camera: Mount::at([0.1, 0.0, 0.0], Looking::Forward).body_from_sensor(),
            depth_mm: (0..64 * 40)
                .map(|i| if thing(i) { 1500 } else { 0 })
                .collect(),
        };
        let [roll, pitch, yaw] = attitude;
        let rotation = so3::exp(&(Vector3::z() * yaw))
            * so3::exp(&(Vector3::y() * pitch))
            * so3::exp(&(Vector3::x() * roll));
        let moment = Moment {
            t_s: 0.0,
            time: Timestamp::ZERO,
            distance_m: 1.0,
            world_from_body: Pose::identity(),
            state: NavState {
                world_from_body: Pose::from_parts(Vector3::z().into(), rotation),
                ..NavState::default()
            },
            image: Some(Arc::new(image.clone())),
            detections: Vec::new(),
            obstacles: Vec::new(),
            plan: None,
        };
        let (mut detector, eye) = (
            Detector::new(&DetectorConfig::default()).unwrap(),
            Eye::default(),
        );
        look(&mut detector, &image, &moment, &eye);
        let map = detector.u_depth();
        let filled = |c: &usize| (1..map.bins).any(|bin| map.count(bin, *c) > 0);
        let found: Vec<usize> = (0..map.columns).filter(filled).collect();
        let columns = Columns::new(&image, &moment, &detector).unwrap();
        (
            [found[0] as f64, found[found.len() - 1] as f64 + 1.0],
            [20.0, 36.0].map(|px| columns.of(px, &image)),
        )
    }

    fn check(attitude: [f64; 3]) {
        let (found, drawn) = found_and_drawn(attitude);
        for (found, drawn) in found.iter().zip(drawn) {
            // Pixels fall into whole columns, and over the height of the narrow image the tilt
            // moves them by less than one more.
            assert!((found - drawn).abs() <= 2.0, "{found:?} {drawn:?}");
        }
    }

    #[test]
    fn the_extent_of_a_box_is_where_the_map_has_its_pixels() {
        check([0.0, 0.0, 0.0]);
        check([0.0, 0.0, 2.0]);
    }

    #[test]
    fn the_extent_follows_the_tilt_of_the_vehicle() {
        check([0.0, 0.2, 0.3]);
        check([0.15, 0.1, -1.0]);
    }
}
