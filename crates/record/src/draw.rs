//! Things, frames and images in the schemas of Foxglove.

use alula_geometry::{Pose, Timestamp};
use alula_messages::{DepthImage, MAX_DEPTH_CAMERAS};
use foxglove::messages as fox;
use nalgebra::{Point3, Vector3};

pub(crate) const WORLD: &str = "world";
/// Frames of the depth cameras.
const DEPTH_CAMERAS: [&str; MAX_DEPTH_CAMERAS] = [
    "depth_camera",
    "depth_camera_1",
    "depth_camera_2",
    "depth_camera_3",
];

/// Frame of the depth camera with a number below [`MAX_DEPTH_CAMERAS`]; 0 looks ahead.
pub fn depth_camera_frame(sensor: u8) -> &'static str {
    DEPTH_CAMERAS[usize::from(sensor) % MAX_DEPTH_CAMERAS]
}

const THING: fox::Color = colour(0.55, 0.60, 0.66, 0.9);
const PERSON: fox::Color = colour(0.90, 0.45, 0.15, 0.9);

/// A thing that stands still, as it is drawn.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneShape {
    /// A box.
    Box {
        /// Pose of its centre; its sides lie along the axes.
        world_from_box: Pose,
        /// Full sizes along its axes, m.
        size_m: Vector3<f64>,
    },
    /// An upright or lying cylinder.
    Cylinder {
        /// Pose of its centre; its axis is z.
        world_from_cylinder: Pose,
        /// Radius, m.
        radius_m: f64,
        /// Full height, m; an endless cylinder is drawn as high as the world.
        height_m: f64,
    },
    /// A sphere.
    Sphere {
        /// Its centre in the world.
        centre_world: Point3<f64>,
        /// Radius, m.
        radius_m: f64,
    },
    /// Triangles.
    Triangles {
        /// Corners in the world, three for each triangle.
        corners_world: Vec<Point3<f64>>,
    },
}

/// A person as an ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Person {
    /// Number that stays with the person.
    pub id: u32,
    /// Pose of the ellipsoid's centre.
    pub world_from_person: Pose,
    /// Semi-axes along the axes of the ellipsoid, m.
    pub semi_axes_m: Vector3<f64>,
}

pub(crate) fn transform(
    now: Timestamp,
    parent: &str,
    child: &str,
    parent_from_child: &Pose,
) -> fox::FrameTransform {
    let pose = fox_pose(parent_from_child);
    fox::FrameTransform {
        timestamp: stamp(now),
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: pose.position,
        rotation: pose.orientation,
    }
}

pub(crate) fn raw_image(image: &DepthImage) -> fox::RawImage {
    let bytes: Vec<u8> = image
        .depth_mm
        .iter()
        .flat_map(|d| d.to_le_bytes())
        .collect();
    fox::RawImage {
        timestamp: stamp(image.time),
        frame_id: depth_camera_frame(image.sensor).to_owned(),
        width: image.camera.width_px,
        height: image.camera.height_px,
        encoding: "16UC1".to_owned(),
        step: 2 * image.camera.width_px,
        data: bytes.into(),
    }
}

pub(crate) fn calibration(image: &DepthImage) -> fox::CameraCalibration {
    let c = &image.camera;
    let (fx, fy, cx, cy) = (c.fx_px, c.fy_px, c.cx_px, c.cy_px);
    fox::CameraCalibration {
        timestamp: stamp(image.time),
        frame_id: depth_camera_frame(image.sensor).to_owned(),
        width: c.width_px,
        height: c.height_px,
        distortion_model: String::new(),
        d: Vec::new(),
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

pub(crate) fn entity(time: Timestamp, id: String) -> fox::SceneEntity {
    fox::SceneEntity {
        timestamp: stamp(time),
        frame_id: WORLD.to_owned(),
        id,
        ..fox::SceneEntity::default()
    }
}

pub(crate) fn draw(entity: &mut fox::SceneEntity, shape: &SceneShape) {
    match shape {
        SceneShape::Box {
            world_from_box,
            size_m,
        } => entity.cubes.push(fox::CubePrimitive {
            pose: Some(fox_pose(world_from_box)),
            size: Some(fox_vector(size_m)),
            color: Some(THING),
        }),
        SceneShape::Cylinder {
            world_from_cylinder,
            radius_m,
            height_m,
        } => entity.cylinders.push(fox::CylinderPrimitive {
            pose: Some(fox_pose(world_from_cylinder)),
            size: Some(fox_vector(&Vector3::new(
                2.0 * radius_m,
                2.0 * radius_m,
                *height_m,
            ))),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: Some(THING),
        }),
        SceneShape::Sphere {
            centre_world,
            radius_m,
        } => entity.spheres.push(fox::SpherePrimitive {
            pose: Some(fox_pose(&Pose::from(centre_world.coords))),
            size: Some(fox_vector(&Vector3::repeat(2.0 * radius_m))),
            color: Some(THING),
        }),
        SceneShape::Triangles { corners_world } => {
            entity.triangles.push(fox::TriangleListPrimitive {
                pose: Some(fox_pose(&Pose::identity())),
                points: corners_world.iter().map(fox_point).collect(),
                color: Some(THING),
                ..fox::TriangleListPrimitive::default()
            });
        }
    }
}

pub(crate) fn person(time: Timestamp, person: &Person) -> fox::SceneEntity {
    let mut entity = entity(time, format!("person {}", person.id));
    entity.spheres.push(fox::SpherePrimitive {
        pose: Some(fox_pose(&person.world_from_person)),
        size: Some(fox_vector(&(2.0 * person.semi_axes_m))),
        color: Some(PERSON),
    });
    entity
}

pub(crate) const fn colour(r: f64, g: f64, b: f64, a: f64) -> fox::Color {
    fox::Color { r, g, b, a }
}

pub(crate) fn fox_vector(v: &Vector3<f64>) -> fox::Vector3 {
    fox::Vector3 {
        x: v.x,
        y: v.y,
        z: v.z,
    }
}

pub(crate) fn fox_point(p: &Point3<f64>) -> fox::Point3 {
    fox::Point3 {
        x: p.x,
        y: p.y,
        z: p.z,
    }
}

pub(crate) fn fox_pose(pose: &Pose) -> fox::Pose {
    let q = &pose.rotation;
    fox::Pose {
        position: Some(fox_vector(&pose.translation.vector)),
        orientation: Some(fox::Quaternion {
            x: q.i,
            y: q.j,
            z: q.k,
            w: q.w,
        }),
    }
}

/// The time in the schema of Foxglove; `None` beyond what it can say.
pub(crate) fn stamp(time: Timestamp) -> Option<fox::Timestamp> {
    const NS: u64 = 1_000_000_000;
    let ns = u64::try_from(time.as_ns()).ok()?;
    let seconds = u32::try_from(ns / NS).ok()?;
    Some(fox::Timestamp::new(seconds, (ns % NS) as u32))
}
