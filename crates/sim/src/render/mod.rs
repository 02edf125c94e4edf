//! Depth images of a world: each surface is projected and drawn analytically into a depth buffer.
//! See `docs/derivations/depth-rendering.md`.

mod bounds;
mod patch;

use std::ops::Range;

use alula_geometry::{PinholeCamera, Pose, Timestamp};
use nalgebra::{Matrix3, Point3, Vector3};

use crate::world::{Mesh, PersonState, Shape, World};
use bounds::{HalfSpaces, Interval};
use patch::{Plane, Quadric};

/// Draws part of a row: its y, the x of its pixels, and the pixels.
trait DrawRow: Fn(f64, &[f64], &mut [f32]) {}

impl<F: Fn(f64, &[f64], &mut [f32])> DrawRow for F {}

/// Renders depth images of one camera; keeps its buffers, so that frames allocate nothing.
#[derive(Clone, Debug)]
pub struct DepthRenderer {
    camera: PinholeCamera,
    /// x of the rays of each column and y of those of each row, at z = 1.
    column_x: Vec<f64>,
    row_y: Vec<f64>,
    /// The image's outline: its corner pixels' rays.
    corners: [Vector3<f64>; 4],
    /// Inward normals of the planes through the camera and the image's sides.
    sides: [Vector3<f64>; 4],
    /// Inverse depth while drawing, depth when done.
    pixels: Vec<f32>,
    /// Corners of the mesh that is being drawn.
    scratch: Vec<Vector3<f64>>,
}

impl DepthRenderer {
    /// A renderer for one camera.
    pub fn new(camera: PinholeCamera) -> Self {
        let column_x: Vec<f64> = (0..camera.width_px)
            .map(|u| camera.ray(f64::from(u), 0.0).x)
            .collect();
        let row_y: Vec<f64> = (0..camera.height_px)
            .map(|v| camera.ray(0.0, f64::from(v)).y)
            .collect();
        let (right, bottom) = (
            f64::from(camera.width_px) - 1.0,
            f64::from(camera.height_px) - 1.0,
        );
        let corners = [(0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)]
            .map(|(u, v)| camera.ray(u, v));
        let sides = [0, 1, 2, 3].map(|i| corners[i].cross(&corners[(i + 1) % 4]).normalize());
        let pixels = vec![0.0; column_x.len() * row_y.len()];
        Self {
            camera,
            column_x,
            row_y,
            corners,
            sides,
            pixels,
            scratch: Vec::new(),
        }
    }

    /// The camera.
    pub fn camera(&self) -> &PinholeCamera {
        &self.camera
    }

    /// Depth along the optical axis at each pixel's centre, m, rows from the top; infinite where
    /// there is nothing.
    ///
    /// `world_from_camera` is the pose of the optical frame. A camera inside a thing sees that
    /// thing's surface from within, as a ray does.
    pub fn render(&mut self, world: &World, time: Timestamp, world_from_camera: &Pose) -> &[f32] {
        self.pixels.fill(0.0);
        let camera_from_world = world_from_camera.inverse();
        self.draw_ground(world, &camera_from_world);
        for obstacle in world.obstacles() {
            let (centre, radius_m) = obstacle.ball;
            if self.sees_ball(&(camera_from_world * centre), radius_m) {
                self.draw_shape(&obstacle.shape, &camera_from_world);
            }
        }
        for person in world.people_at(time) {
            self.draw_person(&person, &camera_from_world);
        }
        for pixel in &mut self.pixels {
            *pixel = 1.0 / *pixel;
        }
        &self.pixels
    }

    /// Whether any pixel's ray may meet a ball.
    fn sees_ball(&self, centre: &Point3<f64>, radius_m: f64) -> bool {
        let outside = |side: &Vector3<f64>| side.dot(&centre.coords) < -radius_m;
        centre.z > -radius_m && !self.sides.iter().any(outside)
    }

    fn draw_ground(&mut self, world: &World, camera_from_world: &Pose) {
        let up = camera_from_world * Vector3::z();
        let point = camera_from_world * Point3::new(0.0, 0.0, world.ground_height_m());
        if let Some(plane) = Plane::through(&point, &up) {
            let in_front = [plane.inverse_depth];
            self.draw_convex(&in_front, Interval::ALL, |y, xs, pixels| {
                plane.draw(y, xs, pixels);
            });
        }
    }

    fn draw_shape(&mut self, shape: &Shape, camera_from_world: &Pose) {
        match shape {
            Shape::Box {
                world_from_box,
                half_size_m,
            } => self.draw_box(&(camera_from_world * world_from_box), half_size_m),
            Shape::Cylinder {
                centre_m: [x, y],
                radius_m,
                bottom_m,
                top_m,
            } => {
                let eye_m = camera_from_world.inverse().translation.z;
                let axis = camera_from_world * Point3::new(*x, *y, eye_m);
                let up = camera_from_world * Vector3::z();
                let heights = (bottom_m - eye_m, top_m - eye_m);
                self.draw_cylinder(&axis.coords, &up, *radius_m, heights);
            }
            Shape::Sphere {
                centre_world,
                radius_m,
            } => {
                let matrix = Matrix3::identity() / (radius_m * radius_m);
                self.draw_ellipsoid(&(camera_from_world * centre_world).coords, &matrix);
            }
            Shape::Mesh(mesh) => self.draw_mesh(mesh, camera_from_world),
        }
    }

    fn draw_person(&mut self, person: &PersonState, camera_from_world: &Pose) {
        let pose = camera_from_world * person.world_from_person();
        let centre = Point3::from(pose.translation.vector);
        if !self.sees_ball(&centre, person.semi_axes_m.max()) {
            return;
        }
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let inverse_squares = person.semi_axes_m.map(|a| 1.0 / (a * a));
        let matrix = rotation * Matrix3::from_diagonal(&inverse_squares) * rotation.transpose();
        self.draw_ellipsoid(&centre.coords, &matrix);
    }

    /// The faces of a box that turn to the camera; all of them from inside.
    fn draw_box(&mut self, camera_from_box: &Pose, half: &Vector3<f64>) {
        let eye = camera_from_box.inverse().translation.vector;
        let inside = (0..3).all(|axis| eye[axis].abs() <= half[axis]);
        let edges = camera_from_box.rotation.to_rotation_matrix().into_inner()
            * Matrix3::from_diagonal(half);
        let centre = camera_from_box.translation.vector;
        for axis in 0..3 {
            let (b, c) = (edges.column((axis + 1) % 3), edges.column((axis + 2) % 3));
            for side in [-1.0, 1.0] {
                if !inside && eye[axis] * side <= half[axis] {
                    continue;
                }
                let middle = centre + edges.column(axis) * side;
                self.draw_polygon(&[
                    middle - b - c,
                    middle + b - c,
                    middle + b + c,
                    middle - b + c,
                ]);
            }
        }
    }

    fn draw_mesh(&mut self, mesh: &Mesh, camera_from_world: &Pose) {
        let mut corners = std::mem::take(&mut self.scratch);
        corners.clear();
        corners.extend(
            mesh.triangles()
                .iter()
                .flatten()
                .map(|corner| (camera_from_world * corner).coords),
        );
        for triangle in corners.as_chunks::<3>().0 {
            self.draw_polygon(triangle);
        }
        self.scratch = corners;
    }

    /// A flat convex polygon, from either side.
    ///
    /// The ray d meets it in front if d lies on the same side of all planes through the camera and
    /// an edge: (p_i x p_i+1) . d has the sign of n . p_0 for all i.
    fn draw_polygon<const N: usize>(&mut self, corners: &[Vector3<f64>; N]) {
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let volume = normal.dot(&corners[0]);
        let Some(plane) = Plane::through(&Point3::from(corners[0]), &normal) else {
            return;
        };
        let half_spaces: [Vector3<f64>; N] =
            std::array::from_fn(|i| corners[i].cross(&corners[(i + 1) % N]) * volume.signum());
        let ys = bounds::polygon_rows(corners);
        self.draw_convex(&half_spaces, ys, |y, xs, pixels| plane.draw(y, xs, pixels));
    }

    /// An ellipsoid with its centre and the matrix of its quadric.
    fn draw_ellipsoid(&mut self, centre: &Vector3<f64>, matrix: &Matrix3<f64>) {
        if let Some(quadric) = Quadric::new(centre, matrix) {
            self.draw_conic(&quadric.form, |y, xs, pixels| quadric.draw(y, xs, pixels));
        }
    }

    /// A cylinder about `axis` (its point at the camera's height) along `up`, between two heights
    /// over the camera.
    fn draw_cylinder(
        &mut self,
        axis: &Vector3<f64>,
        up: &Vector3<f64>,
        radius_m: f64,
        (low, high): (f64, f64),
    ) {
        self.draw_side(axis, up, radius_m, (low, high));
        for height in [low, high] {
            // An end is seen from beyond it; from within the cylinder both are.
            let beyond = (height == low) == (height > 0.0);
            if height.is_finite() && (beyond || axis.norm() < radius_m) {
                self.draw_disc(&(axis + up * height), up, radius_m);
            }
        }
    }

    /// The curved side of a cylinder.
    fn draw_side(
        &mut self,
        axis: &Vector3<f64>,
        up: &Vector3<f64>,
        radius_m: f64,
        (low, high): (f64, f64),
    ) {
        let matrix = (Matrix3::identity() - up * up.transpose()) / (radius_m * radius_m);
        let Some(quadric) = Quadric::new(axis, &matrix) else {
            return;
        };
        let bounds = bounds::of_cylinder_side(axis, up, radius_m, (low, high));
        let half_spaces: &HalfSpaces = bounds.as_ref().map_or(&[], |b| b);
        if low.is_infinite() && high.is_infinite() {
            self.draw_convex(half_spaces, Interval::ALL, |y, xs, pixels| {
                quadric.draw(y, xs, pixels);
            });
        } else {
            self.draw_convex(half_spaces, Interval::ALL, |y, xs, pixels| {
                quadric.draw_between((up, low, high), y, xs, pixels);
            });
        }
    }

    /// A flat disc with its centre and normal.
    ///
    /// With w = n . d / h the hit lies within the radius if |d - c w|^2 <= r^2 w^2.
    fn draw_disc(&mut self, centre: &Vector3<f64>, normal: &Vector3<f64>, radius_m: f64) {
        let Some(plane) = Plane::through(&Point3::from(*centre), normal) else {
            return;
        };
        let w = plane.inverse_depth;
        let excess = radius_m * radius_m - centre.norm_squared();
        let form = w * w.transpose() * excess - Matrix3::identity()
            + centre * w.transpose()
            + w * centre.transpose();
        self.draw_conic(&form, |y, xs, pixels| plane.draw(y, xs, pixels));
    }

    /// Draws the pixels within all half-spaces, in rows of `ys`.
    fn draw_convex(&mut self, half_spaces: &HalfSpaces, ys: Interval, draw: impl DrawRow) {
        let outside = |form: &Vector3<f64>| self.corners.iter().all(|c| form.dot(c) < 0.0);
        if half_spaces.iter().any(outside) {
            return;
        }
        for row in self.rows(ys) {
            self.draw_row(row, Interval::within(half_spaces, self.row_y[row]), &draw);
        }
    }

    /// Draws the pixels with d' F d >= 0.
    fn draw_conic(&mut self, form: &Matrix3<f64>, draw: impl DrawRow) {
        for ys in bounds::silhouette_rows(form) {
            for row in self.rows(ys) {
                for piece in Interval::where_not_negative(form, self.row_y[row]) {
                    self.draw_row(row, piece, &draw);
                }
            }
        }
    }

    /// Draws the pixels of a row in an interval of x.
    fn draw_row(&mut self, row: usize, xs: Interval, draw: &impl DrawRow) {
        let columns = xs.indices(self.camera.fx_px, self.camera.cx_px, self.column_x.len());
        if columns.is_empty() {
            return;
        }
        let start = row * self.column_x.len();
        let pixels = &mut self.pixels[start + columns.start..start + columns.end];
        draw(self.row_y[row], &self.column_x[columns], pixels);
    }

    /// Rows whose centres lie in an interval of y.
    fn rows(&self, ys: Interval) -> Range<usize> {
        ys.indices(self.camera.fy_px, self.camera.cy_px, self.row_y.len())
    }
}

#[cfg(test)]
mod tests;
