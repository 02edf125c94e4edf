//! Signed distances from a point to surfaces: negative inside.

use nalgebra::{Point3, Vector2, Vector3};

/// Distance to a box about the origin with the given half edges.
pub(crate) fn cuboid(point: &Point3<f64>, half: &Vector3<f64>) -> f64 {
    outside_or_in(&(point.coords.abs() - half))
}

/// Distance to a vertical cylinder; `bottom_m` and `top_m` may be infinite.
pub(crate) fn cylinder(
    point: &Point3<f64>,
    centre_m: [f64; 2],
    radius_m: f64,
    bottom_m: f64,
    top_m: f64,
) -> f64 {
    let radial = (point.xy().coords - Vector2::from(centre_m)).norm() - radius_m;
    let vertical = (bottom_m - point.z).max(point.z - top_m);
    outside_or_in(&Vector2::new(radial, vertical))
}

/// Distance from the excesses over pairs of orthogonal faces.
fn outside_or_in<const N: usize>(excess: &nalgebra::SVector<f64, N>) -> f64 {
    let greatest = excess.max();
    if greatest <= 0.0 {
        return greatest;
    }
    excess.map(|e| e.max(0.0)).norm()
}

/// Distance to an ellipsoid about the origin, axes along those of the frame.
///
/// The foot x of the point y has y - x parallel to the gradient: x_i = a_i^2 y_i / (t + a_i^2), with
/// t the greatest root of g(t) = sum (a_i y_i / (t + a_i^2))^2 - 1 (Eberly, "Distance from a point
/// to an ellipse, an ellipsoid, or a hyperellipsoid", section 3). See the derivation page for the
/// iteration and for points on a plane of symmetry.
pub(crate) fn ellipsoid(point: &Point3<f64>, semi: &Vector3<f64>) -> f64 {
    let y = point.coords.abs();
    let inside = y.component_div(semi).norm_squared() < 1.0;
    let least = semi.min();
    // Denominators t + a_i^2 are s + gap_i with s = t + min a^2 above 0: no cancellation.
    let gap = semi.map(|a| (a - least) * (a + least));
    let s = greatest_root(&semi.component_mul(&y), &gap);
    let mut foot = Vector3::from_fn(|i, _| {
        let denominator = s + gap[i];
        if denominator > 0.0 {
            semi[i] * semi[i] * y[i] / denominator
        } else {
            0.0
        }
    });
    if s == 0.0 {
        complete_on_symmetry_plane(&mut foot, semi, &gap);
    }
    let distance = (y - foot).norm();
    if inside { -distance } else { distance }
}

/// Greatest root of g(s) = sum (n_i / (s + gap_i))^2 - 1 for s > 0, or 0 if there is none.
///
/// g falls and is convex: from a start with g >= 0, Newton's steps lead up to the root and never
/// beyond it. One term alone reaches 1 at n_i - gap_i.
fn greatest_root(n: &Vector3<f64>, gap: &Vector3<f64>) -> f64 {
    const STEPS: usize = 100;
    let mut s = (n - gap).max().max(0.0);
    for _ in 0..STEPS {
        let (mut g, mut slope) = (-1.0, 0.0);
        // A term with n = 0 is no pole, not even where its denominator vanishes.
        for i in (0..3).filter(|&i| n[i] > 0.0) {
            let denominator = s + gap[i];
            let term = (n[i] / denominator).powi(2);
            g += term;
            slope += 2.0 * term / denominator;
        }
        let next = s + g / slope;
        if next <= s || !next.is_finite() {
            break;
        }
        s = next;
    }
    s
}

/// With s = 0 the shortest axis is free: the foot leaves the plane of symmetry until it lies on the
/// surface.
fn complete_on_symmetry_plane(foot: &mut Vector3<f64>, semi: &Vector3<f64>, gap: &Vector3<f64>) {
    let rest = 1.0 - foot.component_div(semi).norm_squared();
    for i in 0..3 {
        if gap[i] == 0.0 {
            foot[i] += semi[i] * rest.max(0.0).sqrt();
            return;
        }
    }
}

/// Point of a triangle nearest to a point (Ericson, Real-Time Collision Detection, 5.1.5).
pub(crate) fn nearest_on_triangle(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> Point3<f64> {
    let (ab, ac) = (b - a, c - a);
    let ap = p - a;
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    a + ab * (vb / sum) + ac * (vc / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Distance to the nearest point of a grid on the surface, refined about its best point. The grid
    /// lies on tangent planes of the unit sphere, which have no poles.
    fn brute_force(y: &Point3<f64>, semi: &Vector3<f64>) -> f64 {
        let distance = |direction: &Vector3<f64>| (direction.component_mul(semi) - y.coords).norm();
        let mut best = (0..6)
            .map(|i| Vector3::ith(i / 2, if i % 2 == 0 { 1.0 } else { -1.0 }))
            .map(|side| nearest_on_grid(&side, 1.0, 40, distance))
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap();
        let mut span = 0.1;
        // Until the cells are 8e-8 rad: the distance errs by the square over the curvature.
        for _ in 0..18 {
            best = nearest_on_grid(&best, span, 10, distance);
            span *= 0.5;
        }
        distance(&best)
    }

    /// The direction with the least distance on the tangent plane at `centre`.
    fn nearest_on_grid(
        centre: &Vector3<f64>,
        span: f64,
        cells: i32,
        distance: impl Fn(&Vector3<f64>) -> f64,
    ) -> Vector3<f64> {
        let across = centre.cross(&Vector3::ith(centre.iamin(), 1.0)).normalize();
        let along = centre.cross(&across);
        let step = span / f64::from(cells);
        let range = || (-cells..=cells).map(|i| f64::from(i) * step);
        range()
            .flat_map(|u| range().map(move |v| (u, v)))
            .map(|(u, v)| (centre + across * u + along * v).normalize())
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn ellipsoid_distance_is_that_of_the_nearest_surface_point(
            a in 0.2..2.0_f64, b in 0.2..2.0_f64, c in 0.2..2.0_f64,
            p in [-3.0..3.0_f64, -3.0..3.0_f64, -3.0..3.0_f64],
        ) {
            let semi = Vector3::new(a, b, c);
            let y = Point3::from(p);
            // Where two feet compete the first grid may choose the farther one, by their difference.
            prop_assert!((ellipsoid(&y, &semi).abs() - brute_force(&y, &semi)).abs() < 1e-6);
        }

        #[test]
        fn ellipsoid_distance_is_exact_along_normals(
            lat in -1.5..1.5_f64, lon in -3.0..3.0_f64, out in 0.0..5.0_f64,
        ) {
            let semi = Vector3::new(0.4, 0.4, 0.9);
            let foot = Vector3::new(lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin())
                .component_mul(&semi);
            let normal = foot.component_div(&semi).component_div(&semi).normalize();
            let found = ellipsoid(&Point3::from(foot + normal * out), &semi);
            prop_assert!((found.abs() - out).abs() < 1e-12);
        }
    }

    #[test]
    fn points_on_planes_of_symmetry_have_their_distance() {
        let semi = Vector3::new(0.4, 0.4, 0.9);
        for (point, expected) in [
            (Point3::origin(), -0.4),
            (Point3::new(0.0, 0.0, 0.9), 0.0),
            (Point3::new(0.0, 0.0, 2.0), 1.1),
            (Point3::new(1.0, 0.0, 0.0), 0.6),
            // Foot height z c^2 / (c^2 - a^2), its radius from the equation of the surface.
            (Point3::new(0.0, 0.0, 0.3), {
                let foot_z: f64 = 0.3 * 0.81 / 0.65;
                let foot_r = 0.4 * (1.0 - (foot_z / 0.9).powi(2)).sqrt();
                -(foot_r.powi(2) + (foot_z - 0.3).powi(2)).sqrt()
            }),
        ] {
            assert!(
                (ellipsoid(&point, &semi) - expected).abs() < 1e-12,
                "{point}"
            );
        }
        let flat = Vector3::new(1.0, 1.0, 0.1);
        assert!(
            (ellipsoid(&Point3::new(0.2, 0.1, 0.0), &flat)
                + brute_force(&Point3::new(0.2, 0.1, 0.0), &flat))
            .abs()
                < 1e-6
        );
        assert!(
            (ellipsoid(&Point3::new(0.3, 0.0, 0.0), &Vector3::repeat(1.0)) + 0.7).abs() < 1e-12
        );
    }

    proptest! {
        #[test]
        fn no_point_of_a_triangle_is_nearer(
            p in [-2.0..2.0_f64, -2.0..2.0_f64, -2.0..2.0_f64],
            u in 0.0..1.0_f64, v in 0.0..1.0_f64,
        ) {
            let corners = [Point3::new(0.0, 0.0, 0.0), Point3::new(1.0, 0.2, 0.0), Point3::new(0.1, 0.9, 0.4)];
            let p = Point3::from(p);
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let other = corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v;
            let nearest = nearest_on_triangle(&p, &corners);
            prop_assert!((nearest - p).norm() <= (other - p).norm() + 1e-12);
        }
    }
}
