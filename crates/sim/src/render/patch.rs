//! Pieces of surface as a camera sees them: inverse depth over the pixels of a row.
//!
//! A pixel's ray is d = (x, y, 1) in the optical frame; the point at depth s is s d. All is written
//! in inverse depth w = 1 / s: on a plane it is linear in d, on a quadric it is linear plus the root
//! of a quadratic form, and the nearest surface has the greatest w.

use nalgebra::{Matrix3, Point3, Vector3};

/// A flat piece: w = normal . d.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Normal over the distance of the plane from the camera along it, 1/m.
    pub inverse_depth: Vector3<f64>,
}

/// A curved piece: w = linear . d + sqrt(d' form d), the crossing nearest in front.
///
/// The quadric (p - c)' Q (p - c) = 1 gives C w^2 - 2 (Q c . d) w + d' Q d = 0 with C = c' Q c - 1,
/// so linear = Q c / C and form = linear linear' - Q / C. From outside (C > 0) the greater root is
/// the entry; from inside (C < 0) it is the only positive one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quadric {
    pub linear: Vector3<f64>,
    pub form: Matrix3<f64>,
}

impl Plane {
    /// The plane through a point with a normal, both in the optical frame; `None` if the camera
    /// lies in it.
    pub fn through(point: &Point3<f64>, normal: &Vector3<f64>) -> Option<Self> {
        let inverse_depth = normal / normal.dot(&point.coords);
        inverse_depth
            .iter()
            .all(|x| x.is_finite())
            .then_some(Self { inverse_depth })
    }

    /// Draws a row's columns: pixels keep the greater w.
    pub fn draw(&self, y: f64, xs: &[f64], pixels: &mut [f32]) {
        let (slope, start) = row_form(&self.inverse_depth, y);
        for (pixel, x) in pixels.iter_mut().zip(xs) {
            let w = (start + slope * x) as f32;
            *pixel = if w > *pixel { w } else { *pixel };
        }
    }
}

impl Quadric {
    /// The quadric with this centre and matrix, in the optical frame; `None` if the camera lies on
    /// it.
    pub fn new(centre: &Vector3<f64>, matrix: &Matrix3<f64>) -> Option<Self> {
        let constant = centre.dot(&(matrix * centre)) - 1.0;
        let linear = matrix * centre / constant;
        let form = linear * linear.transpose() - matrix / constant;
        form.iter()
            .all(|x| x.is_finite())
            .then_some(Self { linear, form })
    }

    /// Draws a row's columns. Where the ray misses, the root is NaN and no pixel takes it.
    pub fn draw(&self, y: f64, xs: &[f64], pixels: &mut [f32]) {
        let (slope, start) = row_form(&self.linear, y);
        let (a, b, c) = row_quadratic(&self.form, y);
        for (pixel, x) in pixels.iter_mut().zip(xs) {
            let w = (start + slope * x + ((a * x + b) * x + c).sqrt()) as f32;
            *pixel = if w > *pixel { w } else { *pixel };
        }
    }

    /// Draws a row's columns where the hit lies between two heights over the camera, along `up`:
    /// low <= up . d / w <= high.
    pub fn draw_between(
        &self,
        (up, low, high): (&Vector3<f64>, f64, f64),
        y: f64,
        xs: &[f64],
        pixels: &mut [f32],
    ) {
        let (slope, start) = row_form(&self.linear, y);
        let (a, b, c) = row_quadratic(&self.form, y);
        let (rise, rise_start) = row_form(up, y);
        for (pixel, x) in pixels.iter_mut().zip(xs) {
            let w = start + slope * x + ((a * x + b) * x + c).sqrt();
            let height = rise_start + rise * x;
            let within = (height >= low * w) & (height <= high * w);
            let w = if within { w as f32 } else { 0.0 };
            *pixel = if w > *pixel { w } else { *pixel };
        }
    }
}

/// A linear form of d along a row, as slope and value at x = 0.
pub(super) fn row_form(form: &Vector3<f64>, y: f64) -> (f64, f64) {
    (form.x, form.y * y + form.z)
}

/// d' F d along a row as a x^2 + b x + c.
pub(super) fn row_quadratic(form: &Matrix3<f64>, y: f64) -> (f64, f64, f64) {
    let b = 2.0 * (form[(0, 1)] * y + form[(0, 2)]);
    let c = (form[(1, 1)] * y + 2.0 * form[(1, 2)]) * y + form[(2, 2)];
    (form[(0, 0)], b, c)
}
