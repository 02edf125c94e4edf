//! What an image tells about a box: the places of its sides, those that it shows.

use alula_messages::{Cut, Detection, Footprint};
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Number of sides of a box.
pub(super) const FACES: usize = 6;

/// A point of a round thing this near to the ray that touches it, as a share of its radius, says no
/// more of where the thing is than one at that distance.
const LEAST_OFFSET: f64 = 0.05;

/// Places of the sides of a detected box along its own axes, in the order x low, x high, y low,
/// y high, z low, z high.
///
/// A side at `e_i . c -+ s_i / 2` is what is seen of centre `c` and length `s_i`; a box that the
/// image cuts off has sides that it does not show, and centre and length are then not measured.
#[derive(Clone, Debug)]
pub(super) struct Faces {
    /// Heading of the box's x axis, rad.
    pub yaw_rad: f64,
    /// The box's axes, world.
    pub axes: [Vector3<f64>; 3],
    /// Places of the sides, m.
    pub places: SVector<f64, FACES>,
    /// Their covariance, m^2.
    pub covariance: SMatrix<f64, FACES, FACES>,
    /// Which of them the image shows. One that it does not show is at least as far out.
    pub shown: [bool; FACES],
    /// The side that faces away from the camera, of the axis that lies closest to the line of
    /// sight; of a flat piece the one behind its surface.
    back: usize,
    /// What is known of a round thing of which this is one side.
    flank: Option<Flank>,
}

/// One side of something round that the image cuts off on the other: the ray that touches it, and a
/// point of its surface. Horizontal, world.
#[derive(Clone, Copy, Debug)]
struct Flank {
    /// Unit, along the ray.
    along: Vector2<f64>,
    /// Unit, across the ray to the side on which the thing is.
    inward: Vector2<f64>,
    /// Where the ray is, m along `inward`.
    ray_m: f64,
    point: Vector2<f64>,
    ray_variance_m2: f64,
    point_variance_m2: f64,
}

/// -1 for the lower side of an axis, +1 for the upper one.
pub(super) fn side_sign(face: usize) -> f64 {
    if face.is_multiple_of(2) { -1.0 } else { 1.0 }
}

impl Faces {
    /// Sides of a detection seen from `camera_world`, with the sides that the image cuts off or
    /// that something nearer hides.
    pub fn new(
        detection: &Detection,
        camera_world: &Vector3<f64>,
        hidden: Cut,
        shape_noise_m: f64,
    ) -> Self {
        let axes = box_axes(detection.yaw_rad);
        let mut places = SVector::zeros();
        for face in 0..FACES {
            let axis = face / 2;
            places[face] = axes[axis].dot(&detection.centre_world)
                + side_sign(face) * 0.5 * detection.size_m[axis];
        }
        let shown = shown_faces(detection, &axes, camera_world, hidden);
        let back = back_face(detection, &axes, camera_world);
        let mut faces = Self {
            yaw_rad: detection.yaw_rad,
            axes,
            places,
            covariance: face_covariance(detection, &axes, &shown, back, shape_noise_m),
            shown,
            back,
            flank: None,
        };
        faces.flank = Flank::new(detection, camera_world, &faces);
        faces
    }

    /// The sides of something round with this radius and standard deviation of it, m, of which this
    /// is one side; `None` if it is not, and the sides are what they are.
    ///
    /// A circle of radius `r` that touches the ray and goes through a point at `w` from the ray has
    /// its centre `sqrt(r^2 - (r - w)^2)` behind the point.
    pub fn of_round(&self, radius_m: f64, sigma_m: f64) -> Option<Self> {
        let flank = self.flank?;
        let (low, high) = (LEAST_OFFSET * radius_m, (2.0 - LEAST_OFFSET) * radius_m);
        let offset_m = flank.inward.dot(&flank.point) - flank.ray_m;
        if !(radius_m > 0.0 && offset_m < high) {
            return None;
        }
        let offset_m = offset_m.max(low);
        let behind_m = (radius_m.powi(2) - (radius_m - offset_m).powi(2)).sqrt();
        let by_offset = (radius_m - offset_m) / behind_m;
        let by_radius = offset_m / behind_m - 1.0;
        let yaw_rad = flank.along.y.atan2(flank.along.x);
        let mut faces = Self {
            yaw_rad,
            axes: box_axes(yaw_rad),
            back: 1,
            flank: None,
            ..self.clone()
        };
        let lateral = faces.axes[1].xy();
        let (edge, unseen) = if flank.inward.dot(&lateral) > 0.0 {
            (2, 3)
        } else {
            (3, 2)
        };
        let front_m = flank.along.dot(&flank.point) + behind_m - radius_m;
        faces.places[0] = front_m;
        faces.places[1] = front_m;
        faces.places[edge] = lateral.dot(&flank.inward) * flank.ray_m;
        faces.places[unseen] = lateral.dot(&flank.point);
        faces.shown[..4].copy_from_slice(&[true, false, edge == 2, edge == 3]);
        let of_front = flank.point_variance_m2
            + by_offset.powi(2) * flank.ray_variance_m2
            + (by_radius * sigma_m).powi(2);
        let of_ray = flank.ray_variance_m2;
        for (face, variance) in [of_front, of_front, of_ray, of_ray].into_iter().enumerate() {
            faces.covariance.row_mut(face).fill(0.0);
            faces.covariance.column_mut(face).fill(0.0);
            faces.covariance[(face, face)] = variance;
        }
        Some(faces)
    }

    /// The box stands for the surface of something that is not flat: what lies behind is unknown.
    pub fn open_back(&mut self) {
        self.shown[self.back] = false;
    }

    /// Length along an axis, m.
    pub fn length_m(&self, axis: usize) -> f64 {
        self.places[2 * axis + 1] - self.places[2 * axis]
    }

    /// Trace of the horizontal covariance of the middle between the sides, m^2.
    pub fn centre_variance_m2(&self) -> f64 {
        let p = &self.covariance;
        let of_axis = |low: usize| p[(low, low)] + p[(low + 1, low + 1)] + 2.0 * p[(low, low + 1)];
        0.25 * (of_axis(0) + of_axis(2))
    }

    /// Extends the box to hold the other one, in the axes of the first.
    pub fn unite(&mut self, other: &Detection) {
        self.flank = None;
        let other_axes = box_axes(other.yaw_rad);
        for face in 0..FACES {
            let axis = &self.axes[face / 2];
            let reach: f64 = (0..3)
                .map(|i| 0.5 * other.size_m[i] * axis.dot(&other_axes[i]).abs())
                .sum();
            let sign = side_sign(face);
            let place = axis.dot(&other.centre_world) + sign * reach;
            if sign * (place - self.places[face]) > 0.0 {
                self.places[face] = place;
            }
        }
    }
}

impl Flank {
    /// The side of a compact thing that is seen where the other one is not.
    fn new(detection: &Detection, camera_world: &Vector3<f64>, faces: &Faces) -> Option<Self> {
        let camera = camera_world.xy();
        let centre = detection.centre_world.xy();
        let lateral = 1 - faces.back / 2;
        let (low, high) = (faces.shown[2 * lateral], faces.shown[2 * lateral + 1]);
        if low == high {
            return None;
        }
        let edge = 2 * lateral + usize::from(high);
        let front = faces.back ^ 1;
        let outward = faces.axes[lateral].xy() * side_sign(edge);
        let ahead = faces.axes[faces.back / 2].xy() * side_sign(faces.back);
        let half_width = outward * (0.5 * detection.size_m[lateral]);
        let face = centre - ahead * (0.5 * detection.size_m[faces.back / 2]);
        let (touched, point) = match detection.footprint {
            Footprint::Flat => (face + half_width, face - half_width),
            Footprint::Round => (centre + tangent(&(centre - camera), &half_width), face),
        };
        let along = (touched - camera).try_normalize(1e-6)?;
        let left = Vector2::new(-along.y, along.x);
        let inward = if left.dot(&(point - camera)) > 0.0 {
            left
        } else {
            -left
        };
        Some(Self {
            along,
            inward,
            ray_m: inward.dot(&camera),
            point,
            ray_variance_m2: faces.covariance[(edge, edge)],
            point_variance_m2: faces.covariance[(front, front)],
        })
    }
}

/// Where the ray from a point at `-sight` touches a circle around the origin, on the side of a
/// radius across the line of sight.
fn tangent(sight: &Vector2<f64>, radius: &Vector2<f64>) -> Vector2<f64> {
    let sine_squared = (radius.norm_squared() / sight.norm_squared()).min(1.0);
    radius * (1.0 - sine_squared).sqrt() - sight * sine_squared
}

/// Axes of an upright box, world.
pub(super) fn box_axes(yaw_rad: f64) -> [Vector3<f64>; 3] {
    let (sin, cos) = yaw_rad.sin_cos();
    [
        Vector3::new(cos, sin, 0.0),
        Vector3::new(-sin, cos, 0.0),
        Vector3::z(),
    ]
}

/// Covariance of the sides: of centre and length, which are independent, through
/// `e_i . c -+ s_i / 2`, and of the shape.
fn face_covariance(
    detection: &Detection,
    axes: &[Vector3<f64>; 3],
    shown: &[bool; FACES],
    back: usize,
    shape_noise_m: f64,
) -> SMatrix<f64, FACES, FACES> {
    let axes = Matrix3::from_columns(axes);
    let centre = axes.transpose() * detection.centre_covariance * axes;
    let mut covariance = SMatrix::<f64, FACES, FACES>::zeros();
    for a in 0..FACES {
        for b in 0..FACES {
            covariance[(a, b)] = centre[(a / 2, b / 2)];
            if a / 2 == b / 2 {
                let quarter = 0.25 * detection.size_variance_m2[a / 2];
                covariance[(a, b)] += side_sign(a) * side_sign(b) * quarter;
            }
        }
    }
    for axis in 0..3 {
        if shown[2 * axis] != shown[2 * axis + 1] {
            let variance = single_face_variance(detection, &centre, axis);
            for face in [2 * axis, 2 * axis + 1] {
                covariance.row_mut(face).fill(0.0);
                covariance.column_mut(face).fill(0.0);
                covariance[(face, face)] = variance;
            }
        }
    }
    for face in 0..FACES {
        covariance[(face, face)] += shape_noise_m * shape_noise_m;
    }
    if detection.footprint == Footprint::Round {
        let front = back ^ 1;
        if shown[front] && !shown[back] {
            covariance[(front, front)] += partial_front_m(detection, front / 2).powi(2);
        }
        add_steep_sides(&mut covariance, detection, shown, back);
    }
    covariance
}

/// The sides of a round thing close by are too steep for the image: what is seen is too narrow and
/// too shallow, on both sides alike, so that the lengths err and the middle does not.
fn add_steep_sides(
    covariance: &mut SMatrix<f64, FACES, FACES>,
    detection: &Detection,
    shown: &[bool; FACES],
    back: usize,
) {
    /// From here on all of a person is seen, m.
    const FAR_M: f64 = 0.8;
    /// How much each side loses on the way from there.
    const LOSS: f64 = 0.3;
    let loss_m = LOSS * (FAR_M - detection.depth_m[0]).max(0.0);
    let low = 2 * (1 - back / 2);
    if shown[low] && shown[low + 1] {
        for (a, b, sign) in [(0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)] {
            covariance[(low + a, low + b)] += sign * loss_m * loss_m;
        }
    }
    if shown[back] {
        covariance[(back, back)] += 4.0 * loss_m * loss_m;
    }
}

/// Standard deviation of the place of a front that is seen in part, m: its nearest point may lie in
/// the part that is not seen, and the front then comes nearer while more of it comes into view.
fn partial_front_m(detection: &Detection, depth_axis: usize) -> f64 {
    /// Of this width the nearest point is seen.
    const HALF_BODY_M: f64 = 0.35;
    /// How far a front recedes over its half width.
    const SLOPE: f64 = 0.6;
    let width_m = detection.size_m[1 - depth_axis];
    SLOPE * (HALF_BODY_M - width_m).max(0.0)
}

/// Variance of the one side that is seen along an axis.
///
/// Centre and length of a cut box err with the side that is not seen. Where the sides err
/// independently, `Var c - Var s / 4` is what they share, as the vehicle's attitude; and where the
/// centre is put behind a seen front by half a guessed length, it is the variance of the front.
/// To it comes how finely the image divides the side's place.
fn single_face_variance(detection: &Detection, centre: &Matrix3<f64>, axis: usize) -> f64 {
    const LEAST_SHARE: f64 = 0.05;
    let (own, length) = (centre[(axis, axis)], detection.size_variance_m2[axis]);
    let shared = (own - 0.25 * length).max(LEAST_SHARE * own);
    let window = &detection.window;
    let pixels = match axis {
        2 => window.bottom.saturating_sub(window.top),
        _ => window.right.saturating_sub(window.left),
    };
    let pitch_m = detection.size_m[axis] / (f64::from(pixels) + 1.0);
    shared + (pitch_m * pitch_m).min(0.5 * length)
}

/// The side that faces away from the camera.
fn back_face(
    detection: &Detection,
    axes: &[Vector3<f64>; 3],
    camera_world: &Vector3<f64>,
) -> usize {
    let sight = detection.centre_world - camera_world;
    let axis = match detection.footprint {
        Footprint::Flat => 1,
        Footprint::Round => usize::from(axes[1].dot(&sight).abs() > axes[0].dot(&sight).abs()),
    };
    2 * axis + usize::from(axes[axis].dot(&sight) >= 0.0)
}

/// Which sides the image shows.
fn shown_faces(
    detection: &Detection,
    axes: &[Vector3<f64>; 3],
    camera_world: &Vector3<f64>,
    hidden: Cut,
) -> [bool; FACES] {
    let mut shown = match detection.footprint {
        Footprint::Flat => shown_ends(detection, &axes[0], camera_world, hidden),
        Footprint::Round => shown_sides(detection, axes, camera_world, hidden),
    };
    shown[4] = !(detection.cut.bottom || hidden.bottom);
    shown[5] = !(detection.cut.top || hidden.top);
    shown
}

/// The ends of a piece of a wall, which may lie along the line of sight: the one that appears
/// further left is the one that the left border cuts off.
fn shown_ends(
    detection: &Detection,
    along: &Vector3<f64>,
    camera_world: &Vector3<f64>,
    hidden: Cut,
) -> [bool; FACES] {
    let half = along * (0.5 * detection.size_m.x);
    let low = (detection.centre_world - half - camera_world).xy();
    let high = (detection.centre_world + half - camera_world).xy();
    let upper_is_left = usize::from(low.perp(&high) >= 0.0);
    let cut = detection.cut;
    let mut shown = [true; FACES];
    shown[upper_is_left] = !(cut.left || hidden.left);
    shown[1 - upper_is_left] = !(cut.right || hidden.right);
    shown
}

/// The sides of a compact thing. The lateral axis is the one across the line of sight. The back of
/// a round thing is guessed from its width, so that it is unknown whenever the width is.
fn shown_sides(
    detection: &Detection,
    axes: &[Vector3<f64>; 3],
    camera_world: &Vector3<f64>,
    hidden: Cut,
) -> [bool; FACES] {
    let sight = detection.centre_world - camera_world;
    let left = Vector3::new(-sight.y, sight.x, 0.0);
    let lateral = usize::from(axes[1].dot(&left).abs() >= axes[0].dot(&left).abs());
    let depth = 1 - lateral;
    let upper_is_left = usize::from(axes[lateral].dot(&left) >= 0.0);
    let upper_is_back = usize::from(axes[depth].dot(&sight) >= 0.0);
    let cut = detection.cut;
    let mut shown = [true; FACES];
    shown[2 * lateral + upper_is_left] = !(cut.left || hidden.left);
    shown[2 * lateral + 1 - upper_is_left] = !(cut.right || hidden.right);
    let whole = shown[2 * lateral] && shown[2 * lateral + 1];
    shown[2 * depth + upper_is_back] = whole;
    shown
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_messages::PixelBox;

    const CAMERA: Vector3<f64> = Vector3::new(0.3, -0.2, 1.2);

    /// The flat piece between the ray that touches a circle and a point of its front, as a detector
    /// sees it whose image ends there, on the left.
    fn flank(centre: &Vector2<f64>, radius_m: f64, seen_share: f64) -> Detection {
        let sight = centre - CAMERA.xy();
        let (distance, bearing) = (sight.norm(), sight.y.atan2(sight.x));
        let half = (radius_m / distance).asin();
        let point = |share: f64| {
            let angle = (1.0 - share) * half;
            let range = distance * angle.cos()
                - (radius_m.powi(2) - (distance * angle.sin()).powi(2))
                    .max(0.0)
                    .sqrt();
            let heading = bearing - angle;
            CAMERA.xy() + Vector2::new(heading.cos(), heading.sin()) * range
        };
        let (touched, last) = (point(0.0), point(seen_share));
        let along = last - touched;
        let middle = 0.5 * (touched + last);
        Detection {
            sensor: 0,
            centre_world: Vector3::new(middle.x, middle.y, 1.0),
            centre_covariance: Matrix3::identity() * 1e-4,
            yaw_rad: along.y.atan2(along.x),
            size_m: Vector3::new(along.norm(), 0.0, 1.6),
            size_variance_m2: Vector3::new(0.09, 1e-4, 1e-4),
            footprint: Footprint::Flat,
            cut: Cut {
                left: true,
                ..Cut::default()
            },
            depth_m: [distance - radius_m, distance],
            pixels: 500,
            window: PixelBox {
                left: 0,
                right: 60,
                top: 10,
                bottom: 100,
            },
        }
    }

    #[test]
    fn the_flank_of_a_circle_shows_where_its_front_and_its_side_are() {
        let (centre, radius_m) = (Vector2::new(1.1, 0.4), 0.38);
        for seen_share in [0.3, 0.6, 0.9] {
            let detection = flank(&centre, radius_m, seen_share);
            let seen = Faces::new(&detection, &CAMERA, Cut::default(), 0.01);
            let faces = seen.of_round(radius_m, 0.01).unwrap();
            let shown: Vec<usize> = (0..4).filter(|&face| faces.shown[face]).collect();
            assert_eq!(shown.len(), 2, "{:?}", faces.shown);
            for face in shown {
                let axis = faces.axes[face / 2].xy();
                let truth = axis.dot(&centre) + side_sign(face) * radius_m;
                let error = (faces.places[face] - truth).abs();
                assert!(error < 1e-9, "side {face}: {error}");
            }
        }
    }

    #[test]
    fn a_thing_that_is_seen_whole_or_not_at_all_has_no_flank() {
        let mut detection = flank(&Vector2::new(1.5, 0.0), 0.3, 0.5);
        detection.cut.right = true;
        let both = Faces::new(&detection, &CAMERA, Cut::default(), 0.01);
        assert!(both.of_round(0.3, 0.01).is_none());
        detection.cut = Cut::default();
        let whole = Faces::new(&detection, &CAMERA, Cut::default(), 0.01);
        assert!(whole.of_round(0.3, 0.01).is_none());
    }
}
