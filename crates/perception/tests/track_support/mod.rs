//! A camera that sees upright cylinders and walls from above, and the detections that a detector
//! would make of them: sides to a column, a noisy front, and a depth that is guessed.

#![allow(dead_code)]

use std::f64::consts::FRAC_PI_2;

use alula_geometry::Timestamp;
use alula_messages::{Cut, Detection, Footprint, Obstacle, PixelBox};
use alula_perception::{Contour, Ray, RayEnd};
use nalgebra::{Matrix3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

pub const RATE_HZ: f64 = 30.0;
const COLUMNS: usize = 424;
/// Half of 87 degrees, as of common stereo cameras.
const HALF_VIEW_RAD: f64 = 0.76;
const RAYS: usize = 96;
const MAX_RANGE_M: f64 = 8.0;
/// Depth noise of a stereo camera, 1/m.
const NOISE_PER_M: f64 = 0.005;
/// Standard deviation of a guessed half depth, m.
const GUESS_M: f64 = 0.03;
/// What a detector reports of a side beyond the border, m.
const UNSEEN_M: f64 = 0.3;

#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    pub place: Vector2<f64>,
    pub radius_m: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct Wall {
    pub from: Vector2<f64>,
    pub to: Vector2<f64>,
}

#[derive(Clone, Debug)]
pub struct Camera {
    pub place: Vector2<f64>,
    pub yaw_rad: f64,
}

pub fn cylinder(x: f64, y: f64) -> Cylinder {
    Cylinder {
        place: Vector2::new(x, y),
        radius_m: 0.25,
    }
}

pub fn at_origin() -> Camera {
    Camera {
        place: Vector2::zeros(),
        yaw_rad: 0.0,
    }
}

pub fn random(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// A draw of the standard normal distribution (Box and Muller).
pub fn normal(random: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

pub fn stamp(image: usize) -> Timestamp {
    Timestamp::from_s(image as f64 / RATE_HZ)
}

impl Camera {
    pub fn position(&self) -> Vector3<f64> {
        Vector3::new(self.place.x, self.place.y, 1.2)
    }

    fn tan_of_column(&self, column: f64) -> f64 {
        HALF_VIEW_RAD.tan() * (2.0 * column / COLUMNS as f64 - 1.0)
    }

    fn column_of_tan(&self, tan: f64) -> f64 {
        0.5 * COLUMNS as f64 * (tan / HALF_VIEW_RAD.tan() + 1.0)
    }

    /// To the right, and ahead.
    fn axes(&self) -> (Vector2<f64>, Vector2<f64>) {
        let (sin, cos) = self.yaw_rad.sin_cos();
        (Vector2::new(sin, -cos), Vector2::new(cos, sin))
    }

    fn ray(&self, tan: f64) -> Vector2<f64> {
        let (right, ahead) = self.axes();
        (ahead + right * tan).normalize()
    }
}

fn range_to_cylinder(from: Vector2<f64>, ray: Vector2<f64>, thing: &Cylinder) -> f64 {
    let to = thing.place - from;
    let (along, across) = (to.dot(&ray), to.perp(&ray));
    let chord = thing.radius_m.powi(2) - across * across;
    if along <= 0.0 || chord < 0.0 {
        f64::INFINITY
    } else {
        along - chord.sqrt()
    }
}

fn range_to_wall(from: Vector2<f64>, ray: Vector2<f64>, wall: &Wall) -> f64 {
    let (way, to) = (wall.to - wall.from, wall.from - from);
    let range = to.perp(&way) / ray.perp(&way);
    let share = to.perp(&ray) / ray.perp(&way);
    if range > 0.0 && (0.0..=1.0).contains(&share) {
        range
    } else {
        f64::INFINITY
    }
}

fn nearest(camera: &Camera, tan: f64, things: &[Cylinder], walls: &[Wall]) -> (f64, Option<usize>) {
    let ray = camera.ray(tan);
    let of_walls = walls
        .iter()
        .map(|wall| range_to_wall(camera.place, ray, wall))
        .fold(f64::INFINITY, f64::min);
    let mut best = (of_walls, None);
    for (i, thing) in things.iter().enumerate() {
        let range = range_to_cylinder(camera.place, ray, thing);
        if range < best.0 {
            best = (range, Some(i));
        }
    }
    best
}

pub fn contour(camera: &Camera, time: Timestamp, things: &[Cylinder], walls: &[Wall]) -> Contour {
    let ray = |i: usize| {
        let tan = camera.tan_of_column((i as f64 + 0.5) * COLUMNS as f64 / RAYS as f64);
        let (range_m, _) = nearest(camera, tan, things, walls);
        let is_hit = range_m <= MAX_RANGE_M;
        Ray {
            heading_rad: camera.yaw_rad - tan.atan(),
            range_m: range_m.min(MAX_RANGE_M),
            end: if is_hit { RayEnd::Hit } else { RayEnd::Free },
        }
    };
    Contour {
        time,
        sensor: 0,
        camera_world: camera.position(),
        rays: (0..RAYS).map(ray).collect(),
    }
}

/// Detections of all cylinders of which the image shows something.
pub fn detections(
    camera: &Camera,
    things: &[Cylinder],
    walls: &[Wall],
    random: &mut Pcg64,
) -> Vec<Detection> {
    let owner: Vec<Option<usize>> = (0..COLUMNS)
        .map(|c| nearest(camera, camera.tan_of_column(c as f64 + 0.5), things, walls).1)
        .collect();
    (0..things.len())
        .filter_map(|i| {
            let first = owner.iter().position(|&o| o == Some(i))?;
            let last = owner.iter().rposition(|&o| o == Some(i))?;
            (last >= first + 4).then(|| detection(camera, &things[i], first, last, random))
        })
        .collect()
}

/// The box of the columns `first` to `last` of a cylinder: across the line of sight to the middle
/// of what is seen.
fn detection(
    camera: &Camera,
    thing: &Cylinder,
    first: usize,
    last: usize,
    random: &mut Pcg64,
) -> Detection {
    let tans = [first as f64, last as f64 + 1.0].map(|c| camera.tan_of_column(c));
    let angle = 0.5 * (tans[0].atan() + tans[1].atan());
    let (right, ahead) = camera.axes();
    let sight = right * angle.sin() + ahead * angle.cos();
    let across = right * angle.cos() - ahead * angle.sin();
    let to = thing.place - camera.place;
    let seen_depth = to.dot(&sight);
    // Half the seen width, as of a circle that touches the outer rays.
    let half_angle = 0.5 * (tans[1].atan() - tans[0].atan());
    // Of what is seen, the surface in the middle.
    let distance = range_to_cylinder(camera.place, sight, thing);
    let half = (distance * half_angle.sin() / (1.0 - half_angle.sin())).max(0.01);
    let pitch = seen_depth
        / camera
            .column_of_tan(1.0)
            .mul_add(1.0, -0.5 * COLUMNS as f64);
    let cut = Cut {
        left: first < 2,
        right: last + 3 > COLUMNS,
        top: false,
        bottom: false,
    };
    let end = |is_cut: bool| pitch * pitch / 3.0 + if is_cut { UNSEEN_M * UNSEEN_M } else { 0.0 };
    let ends = end(cut.left) + end(cut.right);
    let (front_sigma, guess_sigma) = (0.01 + NOISE_PER_M * distance * distance, GUESS_M);
    let side = pitch / 3_f64.sqrt();
    let (left_error, right_error) = (side * normal(random), side * normal(random));
    let depth_error = front_sigma.hypot(guess_sigma) * normal(random);
    let half_depth = (half + guess_sigma * normal(random)).max(0.02);
    let whole = !cut.left && !cut.right;
    // A box that is cut has its centre behind the seen front.
    let centre_depth = if whole {
        distance + half + depth_error
    } else {
        distance + half_depth + front_sigma * normal(random)
    };
    let centre = camera.place + sight * centre_depth + across * (0.5 * (left_error + right_error));
    let axes = Matrix3::from_columns(&[
        Vector3::new(across.x, across.y, 0.0),
        Vector3::new(sight.x, sight.y, 0.0),
        Vector3::z(),
    ]);
    let depth_variance = front_sigma.powi(2) + guess_sigma.powi(2);
    let variance = Vector3::new(0.25 * ends, depth_variance, 0.02_f64.powi(2));
    Detection {
        sensor: 0,
        centre_world: Vector3::new(centre.x, centre.y, 0.9 + 0.02 * normal(random)),
        yaw_rad: camera.yaw_rad - angle,
        size_m: Vector3::new(
            (2.0 * half + right_error - left_error).max(0.02),
            2.0 * half_depth,
            1.8 + 0.04 * normal(random),
        ),
        footprint: Footprint::Round,
        centre_covariance: axes * Matrix3::from_diagonal(&variance) * axes.transpose(),
        size_variance_m2: Vector3::new(ends, 4.0 * guess_sigma.powi(2), 0.04_f64.powi(2)),
        cut,
        window: PixelBox {
            left: first as u16,
            right: last as u16,
            top: 20,
            bottom: 220,
        },
        depth_m: [distance, distance + half],
        pixels: 50 * (last - first + 1) as u32,
    }
    .turned_right()
}

trait TurnedRight {
    fn turned_right(self) -> Self;
}

impl TurnedRight for Detection {
    /// The x axis is to the right of the line of sight.
    fn turned_right(mut self) -> Self {
        self.yaw_rad -= FRAC_PI_2;
        self
    }
}

/// The obstacle nearest to a place, within 1 m.
pub fn find<'a>(obstacles: &'a [Obstacle], place: &Vector2<f64>) -> Option<&'a Obstacle> {
    let distance = |o: &Obstacle| (o.centre_world.xy() - place).norm();
    obstacles
        .iter()
        .filter(|o| distance(o) < 1.0)
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Place and velocity on a closed path through corners after a walk of `length_m`.
pub fn on_loop(
    corners: &[Vector2<f64>],
    speed_m_s: f64,
    time_s: f64,
) -> (Vector2<f64>, Vector2<f64>) {
    let edges: Vec<_> = (0..corners.len())
        .map(|i| (corners[i], corners[(i + 1) % corners.len()]))
        .collect();
    let total: f64 = edges.iter().map(|(a, b)| (b - a).norm()).sum();
    let mut left = (speed_m_s * time_s).rem_euclid(total);
    for (a, b) in &edges {
        let length = (b - a).norm();
        if left <= length {
            let direction = (b - a) / length;
            return (a + direction * left, direction * speed_m_s);
        }
        left -= length;
    }
    (corners[0], Vector2::zeros())
}
