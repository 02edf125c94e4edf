//! From position and velocity errors to the desired force per mass, with its first and second
//! derivatives.

use alula_geometry::GRAVITY_M_S2;
use alula_messages::{NavState, Reference};
use nalgebra::{Matrix3, Vector3};

use super::{GeometricConfig, GeometricStatus};

/// Desired force per mass: the acceleration that the rotors have to give, gravity included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SpecificForce {
    /// World, m/s^2.
    pub force: Vector3<f64>,
    /// World, m/s^3.
    pub rate: Vector3<f64>,
    /// World, m/s^4.
    pub acceleration: Vector3<f64>,
    /// Its part along the body's z axis, within the limits, m/s^2.
    pub thrust_m_s2: f64,
    pub status: GeometricStatus,
}

/// The outer loop with its integral.
#[derive(Clone, Debug)]
pub(super) struct PositionLoop {
    position_gain: Vector3<f64>,
    velocity_gain: Vector3<f64>,
    integral_gain: Vector3<f64>,
    max_integral: f64,
    integral_zone: f64,
    max_error: f64,
    tan_max_tilt: f64,
    min_force: f64,
    max_force: f64,
    /// Acceleration, m/s^2.
    integral: Vector3<f64>,
}

impl PositionLoop {
    pub(super) fn new(config: &GeometricConfig) -> Self {
        Self {
            position_gain: config.position_gain_1_s2(),
            velocity_gain: config.velocity_gain_1_s(),
            integral_gain: Vector3::from(config.integral_gain_1_s3),
            max_integral: config.max_integral_m_s2,
            integral_zone: config.integral_zone_m,
            max_error: config.max_position_error_m,
            tan_max_tilt: config.max_tilt_deg.to_radians().tan(),
            min_force: config.min_thrust_to_weight * GRAVITY_M_S2,
            max_force: config.max_thrust_to_weight * GRAVITY_M_S2,
            integral: Vector3::zeros(),
        }
    }

    pub(super) fn reset(&mut self) {
        self.integral.fill(0.0);
    }

    pub(super) fn integral_world(&self) -> Vector3<f64> {
        self.integral
    }

    pub(super) fn update(
        &mut self,
        state: &NavState,
        world_from_body: &Matrix3<f64>,
        reference: &Reference,
        dt_s: f64,
    ) -> SpecificForce {
        let error = state.position_world() - reference.position_world;
        let wanted = self.unlimited(state, world_from_body, reference, &error);
        let limited = self.limit(wanted, world_from_body);
        self.integrate(&error, limited.status, dt_s);
        limited
    }

    /// A = a_d + g e_3 - k_p e_p - k_v e_v + i, and its derivatives with the acceleration and jerk
    /// that the model gives for this force at the present attitude. The integral stands for the
    /// disturbance, so that it does not count as acceleration.
    fn unlimited(
        &self,
        state: &NavState,
        world_from_body: &Matrix3<f64>,
        reference: &Reference,
        error: &Vector3<f64>,
    ) -> SpecificForce {
        let (kp, kv) = (&self.position_gain, &self.velocity_gain);
        let shortened = shorten(error, self.max_error);
        // A shortened error hardly changes along its own direction.
        let kp_rate = if shortened == *error {
            *kp
        } else {
            Vector3::zeros()
        };
        let velocity_error = state.velocity_world - reference.velocity_world;
        let up = Vector3::z() * GRAVITY_M_S2;
        let force = reference.acceleration_world + up + self.integral
            - kp.component_mul(&shortened)
            - kv.component_mul(&velocity_error);

        let axis = world_from_body.column(2).into_owned();
        let along = self.along(&force, &axis);
        let thrust = along.clamp(self.min_force, self.max_force);
        let model_acceleration = axis * thrust - up - self.integral;
        let acceleration_error = model_acceleration - reference.acceleration_world;
        let integral_rate = self.integral_rate(error);
        let rate = reference.jerk_world + integral_rate
            - kp_rate.component_mul(&velocity_error)
            - kv.component_mul(&acceleration_error);

        let axis_rate = world_from_body * state.angular_rate_body.cross(&Vector3::z());
        let thrust_rate = if thrust == along {
            rate.dot(&axis) + force.dot(&axis_rate)
        } else {
            0.0
        };
        let model_jerk = axis * thrust_rate + axis_rate * thrust - integral_rate;
        let jerk_error = model_jerk - reference.jerk_world;
        let acceleration = reference.snap_world
            + self.integral_acceleration(error, &velocity_error)
            - kp_rate.component_mul(&acceleration_error)
            - kv.component_mul(&jerk_error);
        SpecificForce {
            force,
            rate,
            acceleration,
            thrust_m_s2: thrust,
            status: GeometricStatus::Tracking,
        }
    }

    /// Thrust that carries the vertical part of a force at the present attitude, and no less than the
    /// part of the force along the body's axis: while the attitude still follows, height comes
    /// first. Document S, equation (2.85a), has the part along the axis alone, which lets a vehicle
    /// with a slow attitude loop sink when it turns its tilt round.
    fn along(&self, force: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
        const LEAST_COSINE: f64 = 0.5;
        let carrying = force.z / axis.z.max(LEAST_COSINE);
        force.dot(axis).max(carrying)
    }

    /// Brings the force within the limits of thrust and tilt; what it carries of the weight comes
    /// first, the horizontal part gets what is left. A limited force counts as constant.
    fn limit(&self, wanted: SpecificForce, world_from_body: &Matrix3<f64>) -> SpecificForce {
        let vertical = wanted.force.z.clamp(self.min_force, self.max_force);
        let by_tilt = vertical * self.tan_max_tilt;
        let by_thrust = (self.max_force.powi(2) - vertical.powi(2)).max(0.0).sqrt();
        let allowed = by_tilt.min(by_thrust);
        let horizontal = wanted.force.xy().norm();
        if vertical == wanted.force.z && horizontal <= allowed {
            return wanted;
        }
        let share = if horizontal > allowed {
            allowed / horizontal
        } else {
            1.0
        };
        let force = Vector3::new(wanted.force.x * share, wanted.force.y * share, vertical);
        SpecificForce {
            force,
            rate: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            thrust_m_s2: self
                .along(&force, &world_from_body.column(2).into_owned())
                .clamp(self.min_force, self.max_force),
            status: GeometricStatus::Limited,
        }
    }

    /// The integral moves against the error, and rests where the error is that of a transient.
    fn integral_rate(&self, error: &Vector3<f64>) -> Vector3<f64> {
        if error.norm() > self.integral_zone {
            return Vector3::zeros();
        }
        -self.integral_gain.component_mul(error)
    }

    fn integral_acceleration(
        &self,
        error: &Vector3<f64>,
        velocity_error: &Vector3<f64>,
    ) -> Vector3<f64> {
        if error.norm() > self.integral_zone {
            return Vector3::zeros();
        }
        -self.integral_gain.component_mul(velocity_error)
    }

    /// Lee (2013): the integral is saturated; it also rests while a limit is met.
    fn integrate(&mut self, error: &Vector3<f64>, status: GeometricStatus, dt_s: f64) {
        if status != GeometricStatus::Tracking {
            return;
        }
        self.integral += self.integral_rate(error) * dt_s;
        let limit = self.max_integral;
        self.integral.apply(|i| *i = i.clamp(-limit, limit));
    }
}

fn shorten(v: &Vector3<f64>, length: f64) -> Vector3<f64> {
    let norm = v.norm();
    if norm > length {
        v * (length / norm)
    } else {
        *v
    }
}
