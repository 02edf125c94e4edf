//! Depth sequences in the folder layout of the 7-Scenes dataset (Shotton et al., "Scene coordinate
//! regression forests for camera relocalization in RGB-D images", 2013): `frame-NNNNNN.depth.png`
//! with millimetres in 16 bits, and `frame-NNNNNN.pose.txt` with the camera's pose.
//!
//! The world of these poses is that of the first camera, not one with z up: [`upright`] finds the
//! vertical and the floor.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use alula_geometry::{PinholeCamera, Pose, Timestamp};
use alula_messages::DepthImage;
use nalgebra::{Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::RecordError;
use crate::text::{Separator, TextFile};

/// The Kinect records thirty images a second.
const FRAME_NS: i64 = 33_333_333;
/// Largest departure of `R R^T` from the identity that fusion and rounding explain.
const ROTATION_TOLERANCE: f64 = 1e-2;
const POSE_LAYOUT: &str = "a pose is four lines of four numbers, camera to world";
const IMAGE_LAYOUT: &str = "a depth image is a PNG with one channel of 16 bits";

/// A depth image and where it was taken from.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The image; its body is the camera itself.
    pub image: DepthImage,
    /// Pose of the camera's optical frame in the world of the recording.
    pub world_from_camera: Pose,
}

/// The frames of a folder, in order. Each is read when it is asked for.
#[derive(Clone, Debug)]
pub struct Frames {
    stems: std::vec::IntoIter<PathBuf>,
    number: i64,
}

/// The frames in a folder.
///
/// # Errors
/// When the folder cannot be read or holds no frames.
pub fn open(folder: impl AsRef<Path>) -> Result<Frames, RecordError> {
    let folder = folder.as_ref();
    let mut stems = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(RecordError::read(folder))? {
        let path = entry.map_err(RecordError::read(folder))?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        let stem = name.and_then(|name| name.strip_suffix(".depth.png"));
        stems.extend(stem.map(|stem| folder.join(stem)));
    }
    if stems.is_empty() {
        return Err(RecordError::Empty {
            path: folder.to_owned(),
            what: "depth images",
            remedy: "give a folder of 7-Scenes with `frame-000000.depth.png` and the like",
        });
    }
    stems.sort();
    Ok(Frames {
        stems: stems.into_iter(),
        number: 0,
    })
}

impl Iterator for Frames {
    type Item = Result<Frame, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        let stem = self.stems.next()?;
        let time = Timestamp::from_ns(self.number * FRAME_NS);
        self.number += 1;
        Some(read_frame(&stem, time))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.stems.size_hint()
    }
}

fn read_frame(stem: &Path, time: Timestamp) -> Result<Frame, RecordError> {
    let (width_px, height_px, depth_mm) = read_depth(&stem.with_extension("depth.png"))?;
    let scale = f64::from(width_px) / 640.0;
    let image = DepthImage {
        time,
        sensor: 0,
        // The Kinect as the dataset describes it.
        camera: PinholeCamera {
            width_px,
            height_px,
            fx_px: 585.0 * scale,
            fy_px: 585.0 * scale,
            cx_px: 320.0 * scale,
            cy_px: 240.0 * scale,
        },
        body_from_camera: Pose::identity(),
        depth_mm,
    };
    let world_from_camera = read_pose(&stem.with_extension("pose.txt"))?;
    Ok(Frame {
        image,
        world_from_camera,
    })
}

fn read_depth(path: &Path) -> Result<(u32, u32, Vec<u16>), RecordError> {
    let image_error = |finding: String| RecordError::Image {
        path: path.to_owned(),
        finding,
        remedy: IMAGE_LAYOUT,
    };
    let file = File::open(path).map_err(RecordError::read(path))?;
    let mut reader = png::Decoder::new(BufReader::new(file))
        .read_info()
        .map_err(|error| image_error(error.to_string()))?;
    let kind = reader.output_color_type();
    if kind != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        return Err(image_error(format!("it has {kind:?}")));
    }
    let bytes = reader
        .output_buffer_size()
        .ok_or_else(|| image_error("it is too large".to_owned()))?;
    let mut buffer = vec![0; bytes];
    let info = reader
        .next_frame(&mut buffer)
        .map_err(|error| image_error(error.to_string()))?;
    let pairs = buffer[..info.buffer_size()].chunks_exact(2);
    let depth_mm = pairs.map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
    Ok((info.width, info.height, depth_mm))
}

fn read_pose(path: &Path) -> Result<Pose, RecordError> {
    let file = TextFile::read(path)?;
    let mut rows = [[0.0; 4]; 4];
    let mut lines = file.data_lines();
    for row in &mut rows {
        let Some(line) = lines.next() else {
            return Err(RecordError::Empty {
                path: path.to_owned(),
                what: "whole pose",
                remedy: POSE_LAYOUT,
            });
        };
        let columns = line.columns(Separator::Space, 4, POSE_LAYOUT)?;
        *row = line.numbers(&columns, 1)?;
    }
    let r = Matrix3::from_fn(|i, j| rows[i][j]);
    let t = Vector3::from_fn(|i, _| rows[i][3]);
    rotation(&r)
        .map(|rotation| Pose::from_parts(Translation3::from(t), rotation))
        .ok_or_else(|| RecordError::Malformed {
            path: path.to_owned(),
            line: 1,
            finding: "the first three columns are no rotation".to_owned(),
            remedy: POSE_LAYOUT,
        })
}

/// The rotation nearest to a matrix that fusion and rounding have made slightly oblique.
fn rotation(r: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let error = (r * r.transpose() - Matrix3::identity()).norm();
    let is_rotation = error < ROTATION_TOLERANCE && r.determinant() > 0.0;
    is_rotation.then(|| UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(r)))
}

/// The vertical and the floor of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Upright {
    /// Rotation into a world with z up.
    pub upright_from_world: UnitQuaternion<f64>,
    /// Height of the floor in that world, m.
    pub floor_height_m: f64,
}

impl Upright {
    /// Pose of the camera in the world with z up.
    pub fn pose(&self, world_from_camera: &Pose) -> Pose {
        Pose::from_parts(Translation3::identity(), self.upright_from_world) * world_from_camera
    }
}

/// Columns and rows from one sampled normal to the next, and the reach of its differences.
const SAMPLE_PX: usize = 16;
const REACH_PX: usize = 6;
/// Normals further than this from the present vertical do not count, in the successive rounds.
const ROUNDS_DEG: [f64; 6] = [40.0, 30.0, 20.0, 12.0, 8.0, 5.0];
/// Layer of heights, m, and the share of the fullest layer that the lowest one needs to be a floor.
const LAYER_M: f64 = 0.03;
const FLOOR_SHARE: f64 = 0.25;

/// Finds the vertical from the surfaces of all `frames`, which are mostly horizontal or upright in a
/// building: the mean of the normals near the camera's own upward axis, then of those near that
/// mean, and so on. The floor is the lowest well filled layer of level surface.
///
/// `None` where too little level surface is seen.
pub fn upright<'a>(frames: impl IntoIterator<Item = &'a Frame>) -> Option<Upright> {
    let mut surfaces = Vec::new();
    let mut up = Vector3::zeros();
    for frame in frames {
        up -= frame.world_from_camera.rotation * Vector3::y();
        sample_surfaces(frame, &mut surfaces);
    }
    up = up.try_normalize(0.1)?;
    for limit_deg in ROUNDS_DEG {
        let least = limit_deg.to_radians().cos();
        let near = surfaces
            .iter()
            .filter(|(_, normal)| normal.dot(&up) > least);
        up = near
            .map(|(_, normal)| normal)
            .sum::<Vector3<f64>>()
            .try_normalize(10.0)?;
    }
    let upright_from_world = UnitQuaternion::rotation_between(&up, &Vector3::z())?;
    let least = ROUNDS_DEG[5].to_radians().cos();
    let level = surfaces
        .iter()
        .filter(|(_, normal)| normal.dot(&up) > least);
    let floor_height_m = lowest_layer(level.map(|(point, _)| up.dot(&point.coords)))?;
    Some(Upright {
        upright_from_world,
        floor_height_m,
    })
}

/// Points of a frame with their unit normals towards the camera, world.
fn sample_surfaces(frame: &Frame, surfaces: &mut Vec<(Point3<f64>, Vector3<f64>)>) {
    let camera = &frame.image.camera;
    let (width, height) = (camera.width_px as usize, camera.height_px as usize);
    let point = |u: usize, v: usize| {
        let mm = frame.image.depth_mm[v * width + u];
        let depth_m = f64::from(mm) * 1e-3;
        (mm != 0 && depth_m < 4.0).then(|| camera.unproject(u as f64, v as f64, depth_m))
    };
    for v in (REACH_PX..height.saturating_sub(REACH_PX)).step_by(SAMPLE_PX) {
        for u in (REACH_PX..width.saturating_sub(REACH_PX)).step_by(SAMPLE_PX) {
            let ends = [
                point(u - REACH_PX, v),
                point(u + REACH_PX, v),
                point(u, v - REACH_PX),
                point(u, v + REACH_PX),
                point(u, v),
            ];
            let [
                Some(left),
                Some(right),
                Some(above),
                Some(below),
                Some(here),
            ] = ends
            else {
                continue;
            };
            let normal = (below - above).cross(&(right - left)).try_normalize(0.0);
            let Some(normal) = normal else { continue };
            let facing = if normal.dot(&here.coords) > 0.0 {
                -normal
            } else {
                normal
            };
            let pose = &frame.world_from_camera;
            surfaces.push((pose * here, pose.rotation * facing));
        }
    }
}

/// Middle of the lowest layer that holds a fair share of what the fullest holds.
fn lowest_layer(heights_m: impl Iterator<Item = f64>) -> Option<f64> {
    let mut layers = std::collections::BTreeMap::<i64, (usize, f64)>::new();
    for height_m in heights_m {
        let layer = layers
            .entry((height_m / LAYER_M).round() as i64)
            .or_default();
        *layer = (layer.0 + 1, layer.1 + height_m);
    }
    let most = layers.values().map(|(count, _)| *count).max()?;
    let enough = |count: usize| count as f64 >= FLOOR_SHARE * most as f64;
    let floor = layers.values().find(|(count, _)| enough(*count))?;
    Some(floor.1 / floor.0 as f64)
}
