//! Reading a folder of depth images and poses, and finding its vertical.

// Helpers of tests may fail like tests do.
#![allow(clippy::unwrap_used)]

use std::fs::{self, File};
use std::path::Path;

use alula_geometry::{PinholeCamera, Pose, Timestamp, so3};
use alula_messages::DepthImage;
use alula_record::seven_scenes::{self, Frame};
use nalgebra::{Translation3, Vector3};

const POSE: &str = "1 0 0 0.5\n0 0 -1 1\n0 1 0 2\n0 0 0 1\n";

fn write_png(path: &Path, depth: png::BitDepth, bytes: &[u8]) {
    let mut encoder = png::Encoder::new(File::create(path).unwrap(), 2, 2);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(bytes).unwrap();
}

fn folder(pose: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("frame-000000.depth.png");
    write_png(
        &image,
        png::BitDepth::Sixteen,
        &[0, 1, 1, 0, 255, 255, 0, 0],
    );
    fs::write(folder.path().join("frame-000000.pose.txt"), pose).unwrap();
    folder
}

fn error(folder: &tempfile::TempDir) -> String {
    let frame = seven_scenes::open(folder.path()).unwrap().next().unwrap();
    frame.unwrap_err().to_string()
}

#[test]
fn a_frame_is_its_depths_and_its_pose() {
    let folder = folder(POSE);
    let mut frames = seven_scenes::open(folder.path()).unwrap();
    let frame = frames.next().unwrap().unwrap();
    assert_eq!(frame.image.depth_mm, [1, 256, 65535, 0]);
    let seen = frame.world_from_camera * nalgebra::Point3::new(0.0, 0.0, 1.0);
    assert!((seen.coords - Vector3::new(0.5, 0.0, 2.0)).norm() < 1e-12);
    assert!(frames.next().is_none());
}

#[test]
fn what_is_wrong_is_said_with_file_and_place() {
    let empty = tempfile::tempdir().unwrap();
    let message = seven_scenes::open(empty.path()).unwrap_err().to_string();
    assert!(message.contains("holds no depth images"), "{message}");
    let message = error(&folder("1 0 0 0\n0 1 0\n"));
    assert!(
        message.contains("pose.txt`, line 2: 3 columns instead of 4"),
        "{message}"
    );
    let message = error(&folder("2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"));
    assert!(message.contains("no rotation"), "{message}");
    let shallow = folder(POSE);
    let image = shallow.path().join("frame-000000.depth.png");
    write_png(&image, png::BitDepth::Eight, &[1, 2, 3, 4]);
    let message = error(&shallow);
    assert!(message.contains("one channel of 16 bits"), "{message}");
}

/// A camera 1.5 m above a floor, looking down by some angles in a world with y down.
fn above_floor(down_deg: f64) -> Frame {
    let camera = PinholeCamera::from_field_of_view(160, 120, 1.0, 0.8);
    // Turning about the camera's x axis by a negative angle lowers the view.
    let rotation = so3::exp(&Vector3::new(-down_deg.to_radians(), 0.0, 0.0));
    let mut depth_mm = Vec::new();
    for v in 0..120 {
        for u in 0..160 {
            let ray = rotation * camera.ray(f64::from(u), f64::from(v));
            let depth_m = if ray.y > 0.2 { 1.5 / ray.y } else { 0.0 };
            depth_mm.push((depth_m * 1000.0).round() as u16);
        }
    }
    Frame {
        image: DepthImage {
            time: Timestamp::ZERO,
            sensor: 0,
            camera,
            body_from_camera: Pose::identity(),
            depth_mm,
        },
        world_from_camera: Pose::from_parts(Translation3::identity(), rotation),
    }
}

#[test]
fn the_vertical_is_that_of_the_floor() {
    // All look down more than the world is tilted: the mean of their own verticals is 25 degrees off.
    let frames = [20.0, 25.0, 30.0].map(above_floor);
    let upright = seven_scenes::upright(&frames).unwrap();
    let up = upright.upright_from_world * -Vector3::y();
    // Whole millimetres over normals of some centimetres.
    assert!(up.angle(&Vector3::z()) < 0.5_f64.to_radians());
    assert!((upright.floor_height_m + 1.5).abs() < 0.02);
}
