//! Volumes that the vehicle's centre must keep out of, and the chance that it does not.

use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Added to the squared distance from an ellipsoid's centre, so that it can be differentiated
/// there; it moves the surface by less than a thousandth of a millimetre per metre.
const SOFTENING: f64 = 1e-6;
/// Below this squared distance the direction away from the centre is a fixed one.
const CENTRE: f64 = 1e-12;
/// Added to variances, m^2, so that their root can be differentiated.
const LEAST_VARIANCE: f64 = 1e-12;

/// The smooth body that stands for an obstacle's box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hull {
    /// An ellipsoid around the upright elliptic cylinder that fills the box.
    #[default]
    Cylinder,
    /// The smallest ellipsoid around the box (document L, equation 5-6): semi-axes of
    /// `sqrt(3)/2` times its sizes.
    Box,
}

impl Hull {
    /// Semi-axes (m) of the ellipsoid around a box of full sizes `size_m`.
    ///
    /// A cylinder with semi-axes `a` and half height `h` lies in the ellipsoid with horizontal
    /// semi-axes `s a` and vertical `h / sqrt(1 - 1/s^2)`, for any `s = widening` above 1.
    pub fn semi_axes_m(self, size_m: &Vector3<f64>, widening: f64) -> Vector3<f64> {
        match self {
            Self::Cylinder => {
                let upright = 1.0 / (1.0 - 1.0 / (widening * widening)).sqrt();
                0.5 * size_m.component_mul(&Vector3::new(widening, widening, upright))
            }
            Self::Box => 0.75_f64.sqrt() * size_m,
        }
    }
}

/// Semi-axes of an ellipsoid around the Minkowski sum of an ellipsoid with semi-axes `axes_m` and
/// a sphere.
///
/// `b_i^2 = (1 + 1/p) a_i^2 + (1 + p) r^2` contains the sum for every `p > 0`. The `p` used makes
/// the horizontal section smallest (by the sum of its squared semi-axes); for round ones it is
/// exactly `a + r`.
pub fn sum_with_sphere(axes_m: &Vector3<f64>, radius_m: f64) -> Vector3<f64> {
    let horizontal = (0.5 * (axes_m.x * axes_m.x + axes_m.y * axes_m.y)).sqrt();
    if horizontal <= 0.0 || radius_m <= 0.0 {
        return axes_m.add_scalar(radius_m);
    }
    let p = horizontal / radius_m;
    axes_m.map(|a| ((1.0 + 1.0 / p) * a * a + (1.0 + p) * radius_m * radius_m).sqrt())
}

/// The volume, vehicle's size included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Volume {
    /// An ellipsoid.
    Ellipsoid {
        /// Maps the vector from the centre (world, m) to a space in which it is the unit ball.
        unit_from_world: Matrix3<f64>,
        /// Length by which distances in that space are multiplied, m.
        scale_m: f64,
    },
    /// A thin upright wall without end upwards and downwards.
    Wall {
        /// Unit vector along it.
        along: Vector2<f64>,
        /// Half its length, m.
        half_length_m: f64,
        /// Distance that the vehicle's centre keeps from its middle plane, m.
        standoff_m: f64,
        /// Side on which the vehicle is: 1 to the left of `along`, -1 to the right, 0 beyond an
        /// end, from where both sides can be reached.
        side: f64,
    },
    /// Everything below (`up = 1`) or above (`up = -1`) a height.
    Level {
        /// Direction in which free space lies.
        up: f64,
        /// Distance that the vehicle's centre keeps from the centre's height, m.
        standoff_m: f64,
    },
}

impl Volume {
    /// An upright ellipsoid with these semi-axes (m, vehicle included), turned by `yaw_rad`.
    /// Distances are in metres along its shorter horizontal axis.
    pub fn ellipsoid(axes_m: &Vector3<f64>, yaw_rad: f64) -> Self {
        let box_from_world = Rotation3::from_axis_angle(&Vector3::z_axis(), -yaw_rad);
        Self::Ellipsoid {
            unit_from_world: Matrix3::from_diagonal(&axes_m.map(|a| 1.0 / a))
                * box_from_world.matrix(),
            scale_m: axes_m.x.min(axes_m.y),
        }
    }
}

/// A distance with its gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// The distance, m; negative inside.
    pub value: f64,
    /// Gradient with respect to the position of the vehicle.
    pub gradient: Vector3<f64>,
}

/// A volume at one point of the horizon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keepout {
    /// Centre of the obstacle, world, m.
    pub centre: Vector3<f64>,
    /// Covariance of the vector from it to the vehicle, world, m^2.
    pub covariance: Matrix3<f64>,
    /// Its volume.
    pub volume: Volume,
}

/// Unit normal in a space where the volume is simple, and what follows from it.
struct Facet {
    /// Distance from the volume, m.
    distance_m: f64,
    /// Normal carried back to the world: the derivative of the distance.
    gradient: Vector3<f64>,
    /// Derivative of `gradient`, a symmetric matrix, 1/m.
    bend: Bend,
}

/// How the gradient turns with the position. Only its product with a vector is formed.
enum Bend {
    /// Not at all.
    None,
    /// `scale W' (I - n n') W / reach`.
    Ellipsoid {
        unit_from_world: Matrix3<f64>,
        normal: Vector3<f64>,
        scale_m: f64,
        reach: f64,
    },
    /// Around an upright edge: `(I - n n') / reach` in the horizontal plane.
    Corner { normal: Vector3<f64>, reach_m: f64 },
}

impl Bend {
    fn times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::None => Vector3::zeros(),
            Self::Ellipsoid {
                unit_from_world,
                normal,
                scale_m,
                reach,
            } => {
                let turned = unit_from_world * v;
                let across = turned - normal * normal.dot(&turned);
                unit_from_world.tr_mul(&across) * (scale_m / reach)
            }
            Self::Corner { normal, reach_m } => {
                let level = Vector3::new(v.x, v.y, 0.0);
                (level - normal * normal.dot(&level)) / *reach_m
            }
        }
    }
}

impl Keepout {
    /// Distance from the volume without regard to uncertainty.
    pub fn distance(&self, position: &Vector3<f64>) -> Clearance {
        let facet = self.facet(position);
        Clearance {
            value: facet.distance_m,
            gradient: facet.gradient,
        }
    }

    /// Distance from the volume less the margin for uncertainty. Where it is not negative, the
    /// chance to be in the volume is at most that of a standard normal variable to exceed
    /// `quantile` (document L, equation 6-15).
    ///
    /// The volume lies behind the plane through its surface with normal `n`, hence
    /// `n' q - 1 - quantile sqrt(n' S n) >= 0` suffices; `q` and `S` are the vector from the
    /// centre and its covariance in the space where the volume is the unit ball, `n = q/|q|`.
    /// The derivative includes that of `n`.
    pub fn chance(&self, position: &Vector3<f64>, quantile: f64) -> Clearance {
        let facet = self.facet(position);
        let spread = self.covariance * facet.gradient;
        let sigma = (facet.gradient.dot(&spread) + LEAST_VARIANCE).sqrt();
        Clearance {
            value: facet.distance_m - quantile * sigma,
            gradient: facet.gradient - facet.bend.times(&spread) * (quantile / sigma),
        }
    }

    /// The value of [`Self::chance`] alone.
    pub fn chance_value(&self, position: &Vector3<f64>, quantile: f64) -> f64 {
        let facet = self.facet(position);
        let variance = facet.gradient.dot(&(self.covariance * facet.gradient));
        facet.distance_m - quantile * (variance + LEAST_VARIANCE).sqrt()
    }

    /// Distance (m) from the centre to the volume's border along a horizontal unit vector, as seen
    /// from afar; `None` for what has no border there.
    pub fn level_reach_m(&self, along: &Vector2<f64>) -> Option<f64> {
        let direction = Vector3::new(along.x, along.y, 0.0);
        match &self.volume {
            // Greatest n'x over |W x| <= 1 is |W'^-1 n|.
            Volume::Ellipsoid {
                unit_from_world, ..
            } => Some(unit_from_world.try_inverse()?.tr_mul(&direction).norm()),
            Volume::Wall {
                along: wall,
                half_length_m,
                standoff_m,
                ..
            } => Some(wall.dot(along).abs() * half_length_m + standoff_m),
            Volume::Level { .. } => None,
        }
    }

    fn facet(&self, position: &Vector3<f64>) -> Facet {
        let from_centre = position - self.centre;
        match &self.volume {
            Volume::Ellipsoid {
                unit_from_world,
                scale_m,
            } => ellipsoid_facet(unit_from_world, *scale_m, &from_centre),
            Volume::Wall {
                along,
                half_length_m,
                standoff_m,
                side,
            } => wall_facet(along, *half_length_m, *standoff_m, *side, &from_centre),
            Volume::Level { up, standoff_m } => Facet {
                distance_m: up * from_centre.z - standoff_m,
                gradient: Vector3::new(0.0, 0.0, *up),
                bend: Bend::None,
            },
        }
    }
}

fn ellipsoid_facet(
    unit_from_world: &Matrix3<f64>,
    scale_m: f64,
    from_centre: &Vector3<f64>,
) -> Facet {
    let q = unit_from_world * from_centre;
    let squared = q.norm_squared();
    let reach = (squared + SOFTENING).sqrt();
    // At the very centre any direction leads out; the first horizontal axis is the shorter way.
    let normal = if squared < CENTRE {
        Vector3::x()
    } else {
        q / reach
    };
    Facet {
        distance_m: scale_m * (reach - 1.0),
        gradient: unit_from_world.tr_mul(&normal) * scale_m,
        bend: Bend::Ellipsoid {
            unit_from_world: *unit_from_world,
            normal,
            scale_m,
            reach,
        },
    }
}

fn wall_facet(
    along: &Vector2<f64>,
    half_length_m: f64,
    standoff_m: f64,
    side: f64,
    from_centre: &Vector3<f64>,
) -> Facet {
    let level = from_centre.xy();
    let left = Vector2::new(-along.y, along.x);
    let (s, t) = (along.dot(&level), left.dot(&level));
    let beyond = s.abs() - half_length_m;
    if beyond > 0.0 {
        let arm = along * (beyond * s.signum()) + left * t;
        let reach_m = arm.norm();
        let normal = Vector3::new(arm.x / reach_m, arm.y / reach_m, 0.0);
        return Facet {
            distance_m: reach_m - standoff_m,
            gradient: normal,
            bend: Bend::Corner { normal, reach_m },
        };
    }
    let sign = if side != 0.0 {
        side
    } else {
        1.0_f64.copysign(t)
    };
    Facet {
        distance_m: sign * t - standoff_m,
        gradient: Vector3::new(left.x * sign, left.y * sign, 0.0),
        bend: Bend::None,
    }
}
