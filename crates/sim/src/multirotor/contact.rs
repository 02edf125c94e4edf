//! Contact with level ground: springs and dampers with friction under feet and arms.
//!
//! The ground yields like a spring with damping along its normal. Along the ground each touching
//! point is held by a spring to an anchor, which lets it rest without creeping; a force beyond the
//! friction cone drags the anchor along.

use alula_geometry::GRAVITY_M_S2;
use nalgebra::{Matrix3, Vector2, Vector3};

use super::config::MultirotorConfig;

/// Natural frequency of the vehicle standing on its feet, rad/s: far below what a step of 1 ms can
/// resolve, and stiff enough to yield by 1 mm only.
const FREQUENCY_RAD_S: f64 = 100.0;
/// Damping ratio of the vehicle standing on its feet.
const DAMPING_RATIO: f64 = 0.7;
/// Friction coefficient, rubber on floor.
const FRICTION: f64 = 0.7;
/// How far the ground yields under the weight of the vehicle at rest, m: g / omega^2.
pub(super) const STATIC_YIELD_M: f64 = GRAVITY_M_S2 / (FREQUENCY_RAD_S * FREQUENCY_RAD_S);

const FEET: usize = 4;
const POINTS: usize = 8;

/// Force and torque of the ground on the vehicle.
#[derive(Clone, Copy, Debug)]
pub(super) struct GroundForce {
    pub force_world: Vector3<f64>,
    pub torque_world: Vector3<f64>,
}

/// The motion of the body as far as contact needs it.
pub(super) struct Motion<'a> {
    pub position_world: &'a Vector3<f64>,
    pub velocity_world: &'a Vector3<f64>,
    pub world_from_body: &'a Matrix3<f64>,
    pub angular_rate_world: &'a Vector3<f64>,
}

/// Feet, then arm ends, with the anchors of those that touch.
#[derive(Clone, Debug)]
pub(super) struct Contact {
    points_body: [Vector3<f64>; POINTS],
    anchors_world: [Option<Vector2<f64>>; POINTS],
    reach_m: f64,
    stiffness_n_m: f64,
    damping_n_s_m: f64,
}

impl Contact {
    pub(super) fn new(config: &MultirotorConfig) -> Self {
        let mut points_body = [Vector3::zeros(); POINTS];
        let diagonal = std::f64::consts::FRAC_1_SQRT_2 * config.landing_gear_radius_m;
        let signs = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
        let arms = config.layout.rotor_directions();
        for i in 0..FEET {
            points_body[i] = Vector3::new(
                diagonal * signs[i].0,
                diagonal * signs[i].1,
                -config.landing_gear_height_m,
            );
            points_body[FEET + i] = Vector3::new(arms[i][0], arms[i][1], 0.0) * config.arm_length_m;
        }
        let per_foot = config.mass_kg / FEET as f64;
        Self {
            points_body,
            anchors_world: [None; POINTS],
            reach_m: points_body.iter().map(Vector3::norm).fold(0.0, f64::max),
            stiffness_n_m: per_foot * FREQUENCY_RAD_S * FREQUENCY_RAD_S,
            damping_n_s_m: per_foot * 2.0 * DAMPING_RATIO * FREQUENCY_RAD_S,
        }
    }

    /// Whether any point may touch the ground with the centre of mass at this height above it.
    pub(super) fn is_near(&self, height_m: f64) -> bool {
        height_m < self.reach_m
    }

    /// Force and torque about the centre of mass.
    pub(super) fn force(&self, motion: &Motion, ground_height_m: f64) -> GroundForce {
        let mut sum = GroundForce {
            force_world: Vector3::zeros(),
            torque_world: Vector3::zeros(),
        };
        for i in 0..POINTS {
            let arm = motion.world_from_body * self.points_body[i];
            let point = motion.position_world + arm;
            let depth_m = ground_height_m - point.z;
            if depth_m <= 0.0 {
                continue;
            }
            let velocity = motion.velocity_world + motion.angular_rate_world.cross(&arm);
            let force = self.point_force(i, &point, &velocity, depth_m);
            sum.force_world += force;
            sum.torque_world += arm.cross(&force);
        }
        sum
    }

    /// The ground pushes and never pulls; along it, spring and damper within the friction cone.
    fn point_force(
        &self,
        i: usize,
        point: &Vector3<f64>,
        velocity: &Vector3<f64>,
        depth_m: f64,
    ) -> Vector3<f64> {
        let normal = (self.stiffness_n_m * depth_m - self.damping_n_s_m * velocity.z).max(0.0);
        let stretch = self.anchors_world[i].map_or(Vector2::zeros(), |a| point.xy() - a);
        let wanted = -(stretch * self.stiffness_n_m + velocity.xy() * self.damping_n_s_m);
        let tangential = shortened(wanted, FRICTION * normal);
        Vector3::new(tangential.x, tangential.y, normal)
    }

    /// Sets, drags and lifts anchors after a step.
    pub(super) fn move_anchors(&mut self, motion: &Motion, ground_height_m: f64) {
        for i in 0..POINTS {
            let point = motion.position_world + motion.world_from_body * self.points_body[i];
            let depth_m = ground_height_m - point.z;
            self.anchors_world[i] = (depth_m > 0.0).then(|| {
                let anchor = self.anchors_world[i].unwrap_or(point.xy());
                let limit_m = FRICTION * depth_m;
                point.xy() - shortened(point.xy() - anchor, limit_m)
            });
        }
    }

    /// Lets go of everything, far from the ground.
    pub(super) fn lift(&mut self) {
        self.anchors_world = [None; POINTS];
    }

    /// Whether a foot touches.
    pub(super) fn feet_touch(&self) -> bool {
        self.anchors_world[..FEET].iter().any(Option::is_some)
    }
}

/// The vector itself, or in its direction the length `limit` if it is longer.
fn shortened(v: Vector2<f64>, limit: f64) -> Vector2<f64> {
    let length = v.norm();
    if length > limit {
        v * (limit / length)
    } else {
        v
    }
}
