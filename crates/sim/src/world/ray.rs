//! Where a ray first crosses a surface. Rays start at their origin and reach any distance above 0;
//! one that starts inside a body finds the surface from within.

use alula_geometry::Pose;
use nalgebra::{Point3, Vector3};

/// A half-line with unit direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub origin: Point3<f64>,
    pub direction: Vector3<f64>,
}

/// Where a ray crosses a surface, with a unit normal of either sign.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crossing {
    pub distance_m: f64,
    pub normal: Vector3<f64>,
}

impl Ray {
    /// The point at a distance along the ray.
    pub fn at(&self, distance_m: f64) -> Point3<f64> {
        self.origin + self.direction * distance_m
    }

    /// The same ray in the frame of a body.
    fn seen_from(&self, world_from_body: &Pose) -> Self {
        Self {
            origin: world_from_body.inverse_transform_point(&self.origin),
            direction: world_from_body.inverse_transform_vector(&self.direction),
        }
    }
}

/// The nearer of two crossings.
fn nearer(a: Option<Crossing>, b: Option<Crossing>) -> Option<Crossing> {
    match (a, b) {
        (Some(a), Some(b)) if b.distance_m < a.distance_m => Some(b),
        (None, b) => b,
        (a, _) => a,
    }
}

/// Real roots of a t^2 + 2 b t + c, the lesser first, without cancellation.
fn roots(a: f64, b: f64, c: f64) -> Option<(f64, f64)> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 || a == 0.0 {
        return None;
    }
    let q = -(b + b.signum() * discriminant.sqrt());
    let (one, other) = (q / a, if q == 0.0 { 0.0 } else { c / q });
    Some((one.min(other), one.max(other)))
}

/// Crossing of the horizontal plane at `height_m`.
pub(crate) fn horizontal_plane(ray: &Ray, height_m: f64) -> Option<Crossing> {
    let distance_m = (height_m - ray.origin.z) / ray.direction.z;
    (distance_m > 0.0 && distance_m.is_finite()).then(|| Crossing {
        distance_m,
        normal: Vector3::z(),
    })
}

/// Crossing of an ellipsoid whose axes are those of the body frame.
///
/// In coordinates divided by the semi-axes it is the unit ball.
pub(crate) fn ellipsoid(
    ray: &Ray,
    world_from_body: &Pose,
    semi: &Vector3<f64>,
) -> Option<Crossing> {
    let local = ray.seen_from(world_from_body);
    let o = local.origin.coords.component_div(semi);
    let d = local.direction.component_div(semi);
    let (near, far) = roots(d.norm_squared(), o.dot(&d), o.norm_squared() - 1.0)?;
    let distance_m = if near > 0.0 { near } else { far };
    (distance_m > 0.0).then(|| {
        let gradient = (o + d * distance_m).component_div(semi);
        Crossing {
            distance_m,
            normal: (world_from_body.rotation * gradient).normalize(),
        }
    })
}

/// Crossing of a ball.
pub(crate) fn sphere(ray: &Ray, centre: &Point3<f64>, radius_m: f64) -> Option<Crossing> {
    let pose = Pose::translation(centre.x, centre.y, centre.z);
    ellipsoid(ray, &pose, &Vector3::repeat(radius_m))
}

/// Crossing of a box about the origin of its frame (slab test).
pub(crate) fn cuboid(ray: &Ray, world_from_box: &Pose, half: &Vector3<f64>) -> Option<Crossing> {
    let local = ray.seen_from(world_from_box);
    let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
    for axis in 0..3 {
        let (o, d) = (local.origin[axis], local.direction[axis]);
        if d == 0.0 {
            if o.abs() > half[axis] {
                return None;
            }
            continue;
        }
        let middle = -o / d;
        let reach = half[axis] / d.abs();
        if middle - reach > enter.0 {
            enter = (middle - reach, axis);
        }
        if middle + reach < leave.0 {
            leave = (middle + reach, axis);
        }
    }
    if enter.0 > leave.0 || leave.0 <= 0.0 {
        return None;
    }
    let (distance_m, axis) = if enter.0 > 0.0 { enter } else { leave };
    let mut normal = Vector3::zeros();
    normal[axis] = 1.0;
    Some(Crossing {
        distance_m,
        normal: world_from_box.rotation * normal,
    })
}

/// Crossing of a vertical cylinder; `bottom_m` and `top_m` may be infinite.
pub(crate) fn cylinder(
    ray: &Ray,
    centre_m: [f64; 2],
    radius_m: f64,
    bottom_m: f64,
    top_m: f64,
) -> Option<Crossing> {
    let o = ray.origin.xy().coords - nalgebra::Vector2::from(centre_m);
    let d = ray.direction.xy();
    let side = |distance_m: f64| {
        let z = ray.at(distance_m).z;
        (distance_m > 0.0 && z >= bottom_m && z <= top_m).then(|| {
            let outward = (o + d * distance_m) / radius_m;
            Crossing {
                distance_m,
                normal: Vector3::new(outward.x, outward.y, 0.0),
            }
        })
    };
    let cap = |height_m: f64| {
        horizontal_plane(ray, height_m)
            .filter(|hit| (o + d * hit.distance_m).norm_squared() <= radius_m * radius_m)
    };
    let lateral = roots(
        d.norm_squared(),
        o.dot(&d),
        o.norm_squared() - radius_m * radius_m,
    )
    .and_then(|(near, far)| side(near).or_else(|| side(far)));
    nearer(lateral, nearer(cap(bottom_m), cap(top_m)))
}

/// Crossing of a triangle (Moeller and Trumbore), from either side.
pub(crate) fn triangle(ray: &Ray, corners: &[Point3<f64>; 3]) -> Option<Crossing> {
    let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
    let p = ray.direction.cross(&e2);
    let determinant = e1.dot(&p);
    if determinant == 0.0 {
        return None;
    }
    let s = ray.origin - corners[0];
    let u = s.dot(&p) / determinant;
    let q = s.cross(&e1);
    let v = ray.direction.dot(&q) / determinant;
    let distance_m = e2.dot(&q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance_m > 0.0).then(|| Crossing {
        distance_m,
        normal: e1.cross(&e2).normalize(),
    })
}
