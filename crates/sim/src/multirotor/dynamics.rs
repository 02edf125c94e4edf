//! Equations of motion (document S, equation 2.83, z up) with rotor lag, drag and ground, and the
//! fourth-order Runge-Kutta step.

use alula_control::mixer::YAW_TORQUE_SIGNS;
use alula_geometry::{GRAVITY_M_S2, Pose};
use nalgebra::{Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3, Vector4};

use super::config::MultirotorConfig;
use super::contact::{Contact, Motion};

/// State of motion of a multirotor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MultirotorState {
    /// Pose of the body in the world; its origin is the centre of mass.
    pub world_from_body: Pose,
    /// Velocity, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Angular rate, body frame, rad/s.
    pub angular_rate_body: Vector3<f64>,
    /// Thrust of each rotor, N.
    pub rotor_thrusts_n: [f64; 4],
}

/// Force and torque from outside, beside gravity, air and ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force on the centre of mass, world frame, N.
    pub force_world: Vector3<f64>,
    /// Torque about the centre of mass, body frame, N m.
    pub torque_body: Vector3<f64>,
}

/// What acts on the vehicle during a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inputs {
    pub rotor_commands_n: Vector4<f64>,
    pub air_velocity_world: Vector3<f64>,
    pub external: Wrench,
    pub ground_height_m: f64,
}

/// The state as the integrator sees it; the quaternion is not kept normal within a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flow {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    attitude: Quaternion<f64>,
    rate: Vector3<f64>,
    thrusts: Vector4<f64>,
}

impl Flow {
    pub(super) fn from_state(state: &MultirotorState) -> Self {
        Self {
            position: state.world_from_body.translation.vector,
            velocity: state.velocity_world,
            attitude: state.world_from_body.rotation.into_inner(),
            rate: state.angular_rate_body,
            thrusts: Vector4::from(state.rotor_thrusts_n),
        }
    }

    pub(super) fn to_state(self) -> MultirotorState {
        MultirotorState {
            world_from_body: Pose::from_parts(
                Translation3::from(self.position),
                UnitQuaternion::new_normalize(self.attitude),
            ),
            velocity_world: self.velocity,
            angular_rate_body: self.rate,
            rotor_thrusts_n: self.thrusts.into(),
        }
    }

    fn plus(&self, slope: &Flow, h: f64) -> Self {
        Self {
            position: self.position + slope.position * h,
            velocity: self.velocity + slope.velocity * h,
            attitude: self.attitude + slope.attitude * h,
            rate: self.rate + slope.rate * h,
            thrusts: self.thrusts + slope.thrusts * h,
        }
    }
}

/// Constants of the equations of motion.
#[derive(Clone, Debug)]
pub(super) struct Dynamics {
    mass_kg: f64,
    inertia: Vector3<f64>,
    rotor_positions_m: [[f64; 2]; 4],
    thrust_to_torque_m: f64,
    rotor_time_constant_s: f64,
    drag_per_s: Vector3<f64>,
    quadratic_drag_per_m: f64,
}

impl Dynamics {
    pub(super) fn new(config: &MultirotorConfig) -> Self {
        let arm = config.arm_length_m;
        Self {
            mass_kg: config.mass_kg,
            inertia: Vector3::from(config.inertia_kg_m2),
            rotor_positions_m: config.layout.rotor_directions().map(|d| d.map(|c| c * arm)),
            thrust_to_torque_m: config.thrust_to_torque_m,
            rotor_time_constant_s: config.rotor_time_constant_s,
            drag_per_s: Vector3::from(config.drag_per_s),
            quadratic_drag_per_m: config.quadratic_drag_n_s2_m2.unwrap_or(0.0) / config.mass_kg,
        }
    }

    /// The state `h` seconds later: one classical Runge-Kutta step.
    pub(super) fn advance(&self, x: &Flow, inputs: &Inputs, contact: &Contact, h: f64) -> Flow {
        let k1 = self.slope(x, inputs, contact);
        let k2 = self.slope(&x.plus(&k1, 0.5 * h), inputs, contact);
        let k3 = self.slope(&x.plus(&k2, 0.5 * h), inputs, contact);
        let k4 = self.slope(&x.plus(&k3, h), inputs, contact);
        x.plus(&k1, h / 6.0)
            .plus(&k2, h / 3.0)
            .plus(&k3, h / 3.0)
            .plus(&k4, h / 6.0)
    }

    /// Acceleration (world, m/s^2) and angular acceleration (body, rad/s^2).
    pub(super) fn accelerations(
        &self,
        x: &Flow,
        inputs: &Inputs,
        contact: &Contact,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let slope = self.slope(x, inputs, contact);
        (slope.velocity, slope.rate)
    }

    /// Time derivative of the state.
    fn slope(&self, x: &Flow, inputs: &Inputs, contact: &Contact) -> Flow {
        let rotation = UnitQuaternion::new_unchecked(x.attitude)
            .to_rotation_matrix()
            .into_inner();
        let (thrust_n, rotor_torque) = self.rotor_wrench(&x.thrusts);
        let mut force = rotation.column(2) * thrust_n + inputs.external.force_world;
        let mut torque = rotor_torque + inputs.external.torque_body;
        if contact.is_near(x.position.z - inputs.ground_height_m) {
            let ground = contact.force(
                &x.motion(&rotation, &(rotation * x.rate)),
                inputs.ground_height_m,
            );
            force += ground.force_world;
            torque += rotation.tr_mul(&ground.torque_world);
        }
        let drag = self.drag(&rotation, &(x.velocity - inputs.air_velocity_world));
        let momentum = self.inertia.component_mul(&x.rate);
        Flow {
            position: x.velocity,
            velocity: force / self.mass_kg - drag - Vector3::z() * GRAVITY_M_S2,
            attitude: x.attitude * Quaternion::from_imag(x.rate * 0.5),
            rate: (torque - x.rate.cross(&momentum)).component_div(&self.inertia),
            thrusts: (inputs.rotor_commands_n - x.thrusts) / self.rotor_time_constant_s,
        }
    }

    /// Collective thrust (N) and torque (body, N m) of the rotors: r x f e_z and the drag torques.
    fn rotor_wrench(&self, thrusts: &Vector4<f64>) -> (f64, Vector3<f64>) {
        let mut torque = Vector3::zeros();
        for i in 0..4 {
            let [x, y] = self.rotor_positions_m[i];
            torque.x += y * thrusts[i];
            torque.y -= x * thrusts[i];
            torque.z += self.thrust_to_torque_m * YAW_TORQUE_SIGNS[i] * thrusts[i];
        }
        (thrusts.sum(), torque)
    }

    /// Deceleration by air (world, m/s^2): linear along the axes of the heading, and quadratic.
    fn drag(&self, rotation: &Matrix3<f64>, through_air: &Vector3<f64>) -> Vector3<f64> {
        let heading = rotation.column(0).xy();
        let length = heading.norm();
        // With the nose straight up there is no heading, and any will do.
        let (c, s) = if length > 1e-9 {
            (heading.x / length, heading.y / length)
        } else {
            (1.0, 0.0)
        };
        let forward = self.drag_per_s.x * (c * through_air.x + s * through_air.y);
        let left = self.drag_per_s.y * (c * through_air.y - s * through_air.x);
        let up = self.drag_per_s.z * through_air.z;
        Vector3::new(c * forward - s * left, s * forward + c * left, up)
            + through_air * (self.quadratic_drag_per_m * through_air.norm())
    }
}

impl Flow {
    /// The motion as contact sees it.
    pub(super) fn motion<'a>(
        &'a self,
        rotation: &'a Matrix3<f64>,
        angular_rate_world: &'a Vector3<f64>,
    ) -> Motion<'a> {
        Motion {
            position_world: &self.position,
            velocity_world: &self.velocity,
            world_from_body: rotation,
            angular_rate_world,
        }
    }
}
