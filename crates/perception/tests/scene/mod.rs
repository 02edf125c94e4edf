//! Depth images of a few primitives by ray casting, and the noise of a stereo camera.

#![allow(dead_code)]

use alula_geometry::{PinholeCamera, Pose, Timestamp, so3};
use alula_messages::{DepthImage, Looking, Mount};
use alula_perception::View;
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// Growth of the noise with the square of depth, 1/m.
pub const NOISE_PER_M: f64 = 0.0072;

/// Something that a ray may hit.
#[derive(Clone, Copy, Debug)]
pub enum Thing {
    /// A box with vertical sides.
    Block {
        centre: Vector3<f64>,
        size: Vector3<f64>,
        yaw_rad: f64,
    },
    /// An upright cylinder between two heights.
    Post {
        centre: Vector2<f64>,
        radius_m: f64,
        from_m: f64,
        to_m: f64,
    },
    /// An upright body of rotation, `radius_m` at its widest, at the height of its centre.
    Ellipsoid {
        centre: Vector3<f64>,
        radius_m: f64,
        half_height_m: f64,
    },
    /// The level floor.
    Floor { height_m: f64 },
}

impl Thing {
    pub fn block(centre: [f64; 3], size: [f64; 3], yaw_rad: f64) -> Self {
        Self::Block {
            centre: centre.into(),
            size: size.into(),
            yaw_rad,
        }
    }

    pub fn post(x: f64, y: f64, radius_m: f64, from_m: f64, to_m: f64) -> Self {
        Self::Post {
            centre: Vector2::new(x, y),
            radius_m,
            from_m,
            to_m,
        }
    }

    /// A person: shoulders, and a head that is narrower.
    pub fn person(x: f64, y: f64) -> [Self; 2] {
        [
            Self::post(x, y, 0.22, 0.0, 1.5),
            Self::post(x, y, 0.1, 1.5, 1.75),
        ]
    }

    /// Length along a ray to the first hit.
    fn hit(&self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<f64> {
        match self {
            Self::Floor { height_m } => {
                let t = (height_m - from.z) / along.z;
                (t > 0.0).then_some(t)
            }
            Self::Block {
                centre,
                size,
                yaw_rad,
            } => {
                let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, -yaw_rad);
                hit_box(&(turn * (from - centre)), &(turn * along), &(size / 2.0))
            }
            Self::Post {
                centre,
                radius_m,
                from_m,
                to_m,
            } => hit_post(from, along, centre, *radius_m, [*from_m, *to_m]),
            Self::Ellipsoid {
                centre,
                radius_m,
                half_height_m,
            } => {
                let axes = Vector3::new(*radius_m, *radius_m, *half_height_m);
                let (p, d) = (
                    (from - centre).component_div(&axes),
                    along.component_div(&axes),
                );
                let (a, b, c) = (d.dot(&d), d.dot(&p), p.dot(&p) - 1.0);
                let root = b * b - a * c;
                let t = (root >= 0.0).then(|| (-b - root.sqrt()) / a);
                t.filter(|t| *t > 0.0)
            }
        }
    }
}

fn hit_box(from: &Vector3<f64>, along: &Vector3<f64>, half: &Vector3<f64>) -> Option<f64> {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let a = (-half[axis] - from[axis]) / along[axis];
        let b = (half[axis] - from[axis]) / along[axis];
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter > 0.0 && enter <= leave).then_some(enter)
}

fn hit_post(
    from: &Vector3<f64>,
    along: &Vector3<f64>,
    centre: &Vector2<f64>,
    radius_m: f64,
    [low, high]: [f64; 2],
) -> Option<f64> {
    let (d, p) = (along.xy(), from.xy() - centre);
    let (a, b, c) = (d.dot(&d), d.dot(&p), p.dot(&p) - radius_m * radius_m);
    let root = b * b - a * c;
    let within = |z: f64| z >= low && z <= high;
    let side = (root >= 0.0).then(|| (-b - root.sqrt()) / a);
    let side = side.filter(|t| *t > 0.0 && within(from.z + t * along.z));
    let ends = [low, high].map(|z| {
        let t = (z - from.z) / along.z;
        (t > 0.0 && (p + d * t).norm() <= radius_m).then_some(t)
    });
    [side, ends[0], ends[1]]
        .into_iter()
        .flatten()
        .reduce(f64::min)
}

/// The D435i of document L.
pub fn camera() -> PinholeCamera {
    PinholeCamera::from_field_of_view(424, 240, 87_f64.to_radians(), 58_f64.to_radians())
}

/// A view from a height above the floor at the origin, looking along x.
pub fn view(height_m: f64, roll_deg: f64, pitch_deg: f64, yaw_deg: f64) -> View {
    let [roll, pitch, yaw] = [roll_deg, pitch_deg, yaw_deg].map(f64::to_radians);
    View {
        world_from_body: Isometry3::from_parts(
            Translation3::new(0.0, 0.0, height_m),
            so3::from_roll_pitch_yaw(roll, pitch, yaw),
        ),
        orientation_covariance: Matrix3::zeros(),
        floor_height_m: Some(0.0),
    }
}

pub fn body_from_camera() -> Pose {
    Mount::at([0.0; 3], Looking::Forward).body_from_sensor()
}

/// The image without noise.
pub fn render(camera: PinholeCamera, view: &View, things: &[Thing]) -> DepthImage {
    let body_from_camera = body_from_camera();
    let world_from_camera = view.world_from_body * body_from_camera;
    let from = world_from_camera.translation.vector;
    let mut depth_mm = Vec::new();
    for v in 0..camera.height_px {
        for u in 0..camera.width_px {
            let ray = camera.ray(f64::from(u), f64::from(v));
            let along = world_from_camera.rotation * ray;
            let hits = things.iter().filter_map(|thing| thing.hit(&from, &along));
            let depth_m = hits.fold(f64::INFINITY, f64::min);
            let mm = if depth_m < 10.0 {
                depth_m * 1000.0
            } else {
                0.0
            };
            depth_mm.push(mm.round() as u16);
        }
    }
    DepthImage {
        time: Timestamp::ZERO,
        sensor: 0,
        camera,
        body_from_camera,
        depth_mm,
    }
}

/// A generator for a test.
pub fn generator(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// The image with noise of the standard deviation `a z^2` on each pixel.
pub fn noisy(image: &DepthImage, random: &mut Pcg64) -> DepthImage {
    let mut noisy = image.clone();
    for mm in noisy.depth_mm.iter_mut().filter(|mm| **mm > 0) {
        let depth_m = f64::from(*mm) * 1e-3;
        let error: f64 = StandardNormal.sample(random);
        let measured_m = depth_m + NOISE_PER_M * depth_m * depth_m * error;
        *mm = (measured_m * 1000.0).round().clamp(1.0, 65534.0) as u16;
    }
    noisy
}

/// A room with a person, a table and two walls: what an image usually holds.
pub fn room() -> Vec<Thing> {
    let mut things = vec![
        Thing::Floor { height_m: 0.0 },
        Thing::block([4.6, 0.0, 1.5], [0.1, 8.0, 3.0], 0.0),
        Thing::block([2.5, 2.2, 1.5], [6.0, 0.1, 3.0], 0.0),
        Thing::block([3.0, -1.6, 0.4], [0.8, 1.4, 0.8], 0.3),
        Thing::post(2.2, -0.9, 0.15, 0.0, 2.5),
    ];
    things.extend(Thing::person(2.6, 0.3));
    things.extend(Thing::person(3.5, 1.2));
    things
}
