//! Shapes of things that stand still.

use std::sync::Arc;

use alula_geometry::Pose;
use nalgebra::{Point3, Vector3};

use super::ray::{self, Crossing, Ray};
use super::{Material, Mesh, distance};

/// A shape with its place in the world.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A box, which may be a wall.
    Box {
        /// Frame at the centre with axes along the edges.
        world_from_box: Pose,
        /// Half lengths of the edges, m.
        half_size_m: Vector3<f64>,
    },
    /// A vertical cylinder.
    Cylinder {
        /// Place of the axis, world frame, m.
        centre_m: [f64; 2],
        /// Radius, m.
        radius_m: f64,
        /// Height of the lower end, m; minus infinity if there is none.
        bottom_m: f64,
        /// Height of the upper end, m; infinity if there is none.
        top_m: f64,
    },
    /// A ball.
    Sphere {
        /// Centre, world frame.
        centre_world: Point3<f64>,
        /// Radius, m.
        radius_m: f64,
    },
    /// Triangles.
    Mesh(Arc<Mesh>),
}

/// A thing that stands still.
#[derive(Clone, Debug)]
pub struct Obstacle {
    /// What a person calls it, for example `box 2`.
    pub name: String,
    /// Its shape and place.
    pub shape: Shape,
    /// Its surface.
    pub material: Material,
    /// A ball round it, for culling: centre and radius, world frame, m; the radius may be infinite.
    pub(crate) ball: (Point3<f64>, f64),
}

impl Obstacle {
    /// A thing of this shape.
    pub(super) fn new(name: String, shape: Shape, material: Material) -> Self {
        let ball = shape.bounding_ball();
        Self {
            name,
            shape,
            material,
            ball,
        }
    }
}

impl Shape {
    /// First crossing of a ray, if it is nearer than `max_m`.
    pub(super) fn cast(&self, ray: &Ray, max_m: f64) -> Option<Crossing> {
        let crossing = match self {
            Self::Box {
                world_from_box,
                half_size_m,
            } => ray::cuboid(ray, world_from_box, half_size_m),
            Self::Cylinder {
                centre_m,
                radius_m,
                bottom_m,
                top_m,
            } => ray::cylinder(ray, *centre_m, *radius_m, *bottom_m, *top_m),
            Self::Sphere {
                centre_world,
                radius_m,
            } => ray::sphere(ray, centre_world, *radius_m),
            Self::Mesh(mesh) => mesh.cast(ray, max_m),
        };
        crossing.filter(|c| c.distance_m < max_m)
    }

    /// Signed distance from a point, m, negative inside. Of distances beyond `limit_m` only this
    /// much is promised: the value is not below the limit.
    pub(super) fn distance(&self, point: &Point3<f64>, limit_m: f64) -> f64 {
        match self {
            Self::Box {
                world_from_box,
                half_size_m,
            } => distance::cuboid(&world_from_box.inverse_transform_point(point), half_size_m),
            Self::Cylinder {
                centre_m,
                radius_m,
                bottom_m,
                top_m,
            } => distance::cylinder(point, *centre_m, *radius_m, *bottom_m, *top_m),
            Self::Sphere {
                centre_world,
                radius_m,
            } => (point - centre_world).norm() - radius_m,
            Self::Mesh(mesh) => mesh.distance(point, limit_m),
        }
    }

    /// A ball that contains the shape.
    fn bounding_ball(&self) -> (Point3<f64>, f64) {
        match self {
            Self::Box {
                world_from_box,
                half_size_m,
            } => (world_from_box.translation.vector.into(), half_size_m.norm()),
            Self::Cylinder {
                centre_m: [x, y],
                radius_m,
                bottom_m,
                top_m,
            } => {
                let half = 0.5 * (top_m - bottom_m);
                let middle = if half.is_finite() {
                    bottom_m + half
                } else {
                    0.0
                };
                (Point3::new(*x, *y, middle), half.hypot(*radius_m))
            }
            Self::Sphere {
                centre_world,
                radius_m,
            } => (*centre_world, *radius_m),
            Self::Mesh(mesh) => {
                let (low, high) = mesh.bounds();
                (nalgebra::center(&low, &high), 0.5 * (high - low).norm())
            }
        }
    }
}
