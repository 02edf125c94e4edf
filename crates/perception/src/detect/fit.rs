//! Lines and arcs through the points of a contour, by weighted least squares.

use nalgebra::{Matrix2, Vector2};

use super::chains::Point;

/// Prior standard deviation of the depth of an arc's ellipse, as a share of its half width: seen
/// from one side, a thing is taken for round (document L, section 5-1-4).
const ROUNDNESS: f64 = 0.15;
/// Standard deviation of the depth of the ellipse that fits a front best from that of the thing, as
/// a share of its half width.
const LIKENESS: f64 = 0.2;
/// Least and greatest half depth of an ellipse, as shares of its half width.
const FLATTEST: f64 = 0.3;
const DEEPEST: f64 = 1.5;
/// The distance of an ellipse changes its tangents, which change its half width: this settles.
const ROUNDS: usize = 3;

/// The foremost depth of a surface that bulges in height lies this many of its standard deviations
/// before its mean: `z = c h^2` with `h` from -1 to 1 has the mean `c / 3` and the standard
/// deviation `c sqrt(4 / 45)`.
const BULGE_SIGMAS: f64 = 1.118;

/// The widest section of a thing is what its outermost rays touch, and where it is foremost: a point
/// of it (right, ahead), m.
fn foremost(point: &Point) -> Vector2<f64> {
    let depth_m = point.at.y.max(1e-3);
    point.at * (1.0 - BULGE_SIGMAS * point.excess_m / depth_m).max(0.5)
}

/// A straight piece of contour, seen from above: (right, ahead) of the camera in the level view, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub centre: Vector2<f64>,
    /// Unit, to the right; ahead if it points neither way.
    pub direction: Vector2<f64>,
    /// Variance of the position across the line at its centre, m^2.
    pub variance_m2: f64,
    /// Variance of its direction, rad^2.
    pub angle_variance_rad2: f64,
    /// Mean square of the distances of the points that noise does not explain, m^2.
    pub excess_m2: f64,
}

impl Line {
    /// Principal axis of points, each weighted with its variance and that of the surface's
    /// roughness. `None` for no points.
    pub fn fit(points: &[Point], roughness_m: f64) -> Option<Self> {
        let weight = |point: &Point| 1.0 / (point.surface.variance_m2 + roughness_m * roughness_m);
        let total: f64 = points.iter().map(weight).sum();
        if total <= 0.0 {
            return None;
        }
        let centre: Vector2<f64> = points
            .iter()
            .map(|p| p.at * weight(p))
            .sum::<Vector2<f64>>()
            / total;
        let mut moment = Matrix2::zeros();
        for point in points {
            let d = point.at - centre;
            moment += d * d.transpose() * weight(point);
        }
        let direction = principal_axis(&moment);
        let along = direction.dot(&(moment * direction));
        let across = (moment.trace() - along).max(0.0) / total;
        let explained = points.len() as f64 / total;
        let line = Self {
            centre,
            direction,
            variance_m2: 1.0 / total,
            angle_variance_rad2: 1.0 / along.max(1e-9),
            excess_m2: (across - explained).max(0.0),
        };
        Some(line)
    }

    /// Unit normal, away from the camera.
    pub fn away(&self) -> Vector2<f64> {
        let normal = Vector2::new(-self.direction.y, self.direction.x);
        if normal.dot(&self.centre) < 0.0 {
            -normal
        } else {
            normal
        }
    }

    /// Position of a point along the line from its centre, m.
    pub fn along(&self, point: &Point) -> f64 {
        (point.at - self.centre).dot(&self.direction)
    }

    /// Distance of a point behind the line, m; negative before it.
    pub fn behind(&self, point: &Point) -> f64 {
        (point.at - self.centre).dot(&self.away())
    }

    /// Least and greatest position of points along the line, m.
    pub fn range(&self, points: &[Point]) -> (f64, f64) {
        points
            .iter()
            .map(|point| self.along(point))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), s| {
                (low.min(s), high.max(s))
            })
    }

    /// Depth of the arc that the points make behind their chord, m: `behind = c0 + c1 s + c2 s^2`
    /// with half length `h` gives `c2 h^2`. Negative for a hollow front.
    pub fn sagitta_m(&self, points: &[Point]) -> f64 {
        let (low, high) = self.range(points);
        let half = 0.5 * (high - low);
        if points.len() < 4 || half <= 0.0 {
            return 0.0;
        }
        let middle = 0.5 * (high + low);
        let mut normal = nalgebra::Matrix3::zeros();
        let mut right = nalgebra::Vector3::zeros();
        for point in points {
            let s = (self.along(point) - middle) / half;
            let row = nalgebra::Vector3::new(1.0, s, s * s);
            normal += row * row.transpose();
            right += row * self.behind(point);
        }
        normal.cholesky().map_or(0.0, |c| c.solve(&right).z)
    }
}

/// Unit eigenvector of the larger eigenvalue, to the right; ahead if it points neither way.
fn principal_axis(moment: &Matrix2<f64>) -> Vector2<f64> {
    let angle = 0.5 * (2.0 * moment[(0, 1)]).atan2(moment[(0, 0)] - moment[(1, 1)]);
    let axis = Vector2::new(angle.cos(), angle.sin());
    if axis.x < 0.0 { -axis } else { axis }
}

/// An ellipse whose front is seen; one axis lies in the line of sight to its middle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arc {
    /// Unit, along the line of sight (right, ahead).
    pub sight: Vector2<f64>,
    /// Distance of its centre from the camera, m.
    pub distance_m: f64,
    /// Half of its size across and along the line of sight, m.
    pub half_width_m: f64,
    pub half_depth_m: f64,
    /// Covariance of distance and half depth, m^2.
    pub covariance: Matrix2<f64>,
}

impl Arc {
    /// The ellipse between the outermost rays of `points`, `half_column` (tangent) further out.
    ///
    /// With `s` across and `t` along the line of sight, `t = D - B sqrt(1 - (s / A)^2)`. Rays touch
    /// a circle at the half opening angle `beta`, so that `A = D sin beta`; with `A` held, `D` and
    /// `B` are linear, and `B = A` is a measurement like the others.
    pub fn fit(points: &[Point], half_column: f64, roughness_m: f64) -> Option<Self> {
        let tan = |point: &Point| point.at.x / point.at.y;
        let low = points.iter().map(tan).fold(f64::INFINITY, f64::min) - half_column;
        let high = points.iter().map(tan).fold(f64::NEG_INFINITY, f64::max) + half_column;
        let (from, to) = (low.atan(), high.atan());
        if points.is_empty() || to <= from {
            return None;
        }
        let middle = 0.5 * (from + to);
        let sine = (0.5 * (to - from)).sin();
        let sight = Vector2::new(middle.sin(), middle.cos());
        let mut arc = Self {
            sight,
            distance_m: points.iter().map(|p| foremost(p).dot(&sight)).sum::<f64>()
                / points.len() as f64,
            half_width_m: 0.0,
            half_depth_m: 0.0,
            covariance: Matrix2::zeros(),
        };
        for _ in 0..ROUNDS {
            arc.half_width_m = arc.distance_m * sine;
            arc.solve(points, roughness_m)?;
        }
        Some(arc)
    }

    /// Least squares for distance and half depth with the half width held.
    fn solve(&mut self, points: &[Point], roughness_m: f64) -> Option<()> {
        let mut information = Matrix2::zeros();
        let mut right = Vector2::zeros();
        let mut mean = (0.0, 0.0, 0.0);
        for point in points {
            let weight = 1.0 / (point.surface.variance_m2 + roughness_m * roughness_m);
            let front = foremost(point);
            let bulge = self.bulge(&front);
            let row = Vector2::new(1.0, -bulge);
            information += row * row.transpose() * weight;
            right += row * (weight * front.dot(&self.sight));
            mean.0 += weight;
            mean.1 += weight * bulge;
            mean.2 += weight * front.dot(&self.sight);
        }
        // A front that is the same everywhere says nothing of the half depth.
        information[(1, 1)] += 1e-6 * mean.0;
        let seen = information.try_inverse()?;
        let bulge = mean.1 / mean.0;
        // Things are no ellipses: another half depth, with the mean of the front where it is seen.
        let shape = Vector2::new(bulge, 1.0) * (LIKENESS * self.half_width_m);
        let seen_m = seen * right;
        let covariance = seen + shape * shape.transpose();
        let prior_m2 = (ROUNDNESS * self.half_width_m).powi(2);
        let gain = covariance.column(1) / (covariance[(1, 1)] + prior_m2);
        self.covariance = covariance - gain * covariance.row(1);
        let half = seen_m[1] + gain[1] * (self.half_width_m - seen_m[1]);
        self.half_depth_m = half.clamp(FLATTEST * self.half_width_m, DEEPEST * self.half_width_m);
        // The mean of the front stays where it is seen when the half depth is limited.
        self.distance_m = (mean.2 + mean.1 * self.half_depth_m) / mean.0;
        Some(())
    }

    fn bulge(&self, at: &Vector2<f64>) -> f64 {
        let across = at.x * self.sight.y - at.y * self.sight.x;
        (1.0 - (across / self.half_width_m).powi(2)).max(0.0).sqrt()
    }

    /// Mean square of the points' distances from the ellipse that noise does not explain, m^2.
    pub fn excess_m2(&self, points: &[Point], roughness_m: f64) -> f64 {
        let sum: f64 = points
            .iter()
            .map(|point| {
                let front = foremost(point);
                let expected_m = self.distance_m - self.half_depth_m * self.bulge(&front);
                let error = front.dot(&self.sight) - expected_m;
                error * error - point.surface.variance_m2 - roughness_m * roughness_m
            })
            .sum();
        (sum / points.len() as f64).max(0.0)
    }
}
