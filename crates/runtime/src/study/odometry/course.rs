//! Smooth true motions of a multirotor.

use std::f64::consts::TAU;

use alula_geometry::{gravity_world, so3};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector2, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Step of the differences that give velocity, acceleration and rate, s. Of places up to 500 m they
/// leave 1e-7 m/s^2 of rounding.
const DIFFERENCE_S: f64 = 2e-3;

/// Mean height above the ground, m.
const HEIGHT_M: f64 = 1.5;

/// Greatest amplitudes of swinging along, across and up, m, and of the heading, rad.
const SWINGS: [f64; 4] = [0.5, 0.5, 0.3, 0.3];

/// Periods of swinging, s.
const PERIODS_S: [f64; 2] = [8.0, 25.0];

/// What a flight does on the whole; swings forward and back, left and right, up and down and of the
/// heading come on top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A straight line in a random direction (document S, table 2.2).
    Line,
    /// A circle of random radius, round and round.
    Loops,
}

/// The true motion at one time.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// Position, world frame, m.
    pub position_world: Vector3<f64>,
    /// Velocity, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Acceleration, world frame, m/s^2.
    pub acceleration_world: Vector3<f64>,
    /// Orientation.
    pub world_from_body: UnitQuaternion<f64>,
    /// Angular rate, body frame, rad/s.
    pub angular_rate: Vector3<f64>,
}

/// A flight of given length and duration, at rest at both ends but for its swings.
#[derive(Clone, Debug)]
pub struct Course {
    shape: Shape,
    length_m: f64,
    duration_s: f64,
    heading_rad: f64,
    radius_m: f64,
    swings: [Swing; 4],
}

#[derive(Clone, Copy, Debug)]
struct Swing {
    amplitude: f64,
    rate_rad_s: f64,
    phase_rad: f64,
}

impl Swing {
    fn at(&self, t: f64) -> f64 {
        self.amplitude * (self.rate_rad_s * t + self.phase_rad).sin()
    }
}

impl Course {
    /// A random course.
    pub fn new(shape: Shape, length_m: f64, duration_s: f64, random: &mut Pcg64) -> Self {
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        Self {
            shape,
            length_m,
            duration_s,
            heading_rad: between(0.0, TAU),
            radius_m: between(3.0, 6.0),
            swings: SWINGS.map(|greatest| Swing {
                amplitude: between(0.5, 1.0) * greatest,
                rate_rad_s: TAU / between(PERIODS_S[0], PERIODS_S[1]),
                phase_rad: between(0.0, TAU),
            }),
        }
    }

    fn position(&self, t: f64) -> Vector3<f64> {
        let way_m = self.length_m * smooth(t / self.duration_s);
        let on_course = match self.shape {
            Shape::Line => Vector2::new(way_m, 0.0),
            Shape::Loops => {
                let (sine, cosine) = (way_m / self.radius_m).sin_cos();
                Vector2::new(sine, 1.0 - cosine) * self.radius_m
            }
        };
        let swing = |i: usize| self.swings[i].at(t);
        let level = on_course + Vector2::new(swing(0), swing(1));
        let (sine, cosine) = self.heading_rad.sin_cos();
        Vector3::new(
            cosine * level.x - sine * level.y,
            sine * level.x + cosine * level.y,
            HEIGHT_M + swing(2),
        )
    }

    /// The motion at `t`, s after the start: the thrust gives the acceleration.
    pub fn truth(&self, t: f64) -> Truth {
        const H: f64 = DIFFERENCE_S;
        let places = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|k| self.position(t + k * H));
        let acceleration = |i: usize| (places[i + 1] - places[i] * 2.0 + places[i - 1]) / (H * H);
        let attitude = |i: usize| {
            let yaw_rad = self.swings[3].at(t + (i as f64 - 2.0) * H);
            upright(&(acceleration(i) - gravity_world()), yaw_rad)
        };
        Truth {
            position_world: places[2],
            velocity_world: (places[3] - places[1]) / (2.0 * H),
            acceleration_world: acceleration(2),
            world_from_body: attitude(2),
            angular_rate: so3::log(&(attitude(1).inverse() * attitude(3))) / (2.0 * H),
        }
    }
}

/// From 0 at 0 to 1 at 1, at rest up to the second derivative at both ends.
fn smooth(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

/// The attitude whose z axis is along `thrust` and whose heading is `yaw_rad`.
fn upright(thrust: &Vector3<f64>, yaw_rad: f64) -> UnitQuaternion<f64> {
    let up = thrust.normalize();
    let forward = Vector3::new(yaw_rad.cos(), yaw_rad.sin(), 0.0);
    let left = up.cross(&forward).normalize();
    let axes = Matrix3::from_columns(&[left.cross(&up), left, up]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    fn course(shape: Shape) -> Course {
        Course::new(shape, 500.0, 600.0, &mut Pcg64::seed_from_u64(1))
    }

    /// Integrals over 10 s by steps of 10 ms, with the midpoint rule: of order dt^2 times the third
    /// derivatives, 0.1 here.
    #[test]
    fn velocity_acceleration_and_rate_are_the_derivatives() {
        for shape in [Shape::Line, Shape::Loops] {
            let course = course(shape);
            let start = course.truth(100.0);
            let (mut p, mut v, mut q) = (
                start.position_world,
                start.velocity_world,
                start.world_from_body,
            );
            for i in 0..1000 {
                let middle = course.truth(100.0 + 0.01 * (f64::from(i) + 0.5));
                p += middle.velocity_world * 0.01;
                v += middle.acceleration_world * 0.01;
                q *= so3::exp(&(middle.angular_rate * 0.01));
            }
            let end = course.truth(110.0);
            assert!((p - end.position_world).norm() < 1e-4);
            assert!((v - end.velocity_world).norm() < 1e-4);
            assert!(q.angle_to(&end.world_from_body) < 1e-4);
        }
    }

    #[test]
    fn a_line_of_500_m_ends_500_m_away_and_loops_end_near() {
        let distance = |shape| {
            let course = course(shape);
            (course.truth(600.0).position_world - course.truth(0.0).position_world).norm()
        };
        // Twice the swings, along and across.
        assert!((distance(Shape::Line) - 500.0).abs() < 2.0);
        assert!(distance(Shape::Loops) < 12.0 + 2.0);
    }
}
