//! A quadrotor as a rigid body: rotors with lag, drag, gravity, wind and ground contact.
//!
//! Integrated with a fixed step of [`STEP_S`] by the classical Runge-Kutta method. See
//! `docs/derivations/multirotor.md`.

mod config;
mod contact;
mod dynamics;
mod presets;

use alula_geometry::{Pose, Timestamp};
use alula_parameters::ParameterError;
use nalgebra::{Vector3, Vector4};

use crate::Truth;
pub use config::{MultirotorConfig, VehicleModel};
use contact::Contact;
use dynamics::{Dynamics, Flow, Inputs};
pub use dynamics::{MultirotorState, Wrench};
pub use presets::{PRESET_NAMES, preset};

/// Length of a step, s.
pub const STEP_S: f64 = 1e-3;

/// A simulated quadrotor.
#[derive(Clone, Debug)]
pub struct Multirotor {
    config: MultirotorConfig,
    dynamics: Dynamics,
    contact: Contact,
    state: MultirotorState,
    acceleration_world: Vector3<f64>,
    angular_acceleration_body: Vector3<f64>,
}

impl Multirotor {
    /// A vehicle at rest at a pose, rotors still. Standing on the ground means a level pose at
    /// [`MultirotorConfig::standing_height_m`].
    ///
    /// # Errors
    /// When a fact is out of its range or no rigid body that flies can have it.
    pub fn new(config: MultirotorConfig, world_from_body: Pose) -> Result<Self, ParameterError> {
        config.check()?;
        Ok(Self {
            dynamics: Dynamics::new(&config),
            contact: Contact::new(&config),
            config,
            state: MultirotorState {
                world_from_body,
                velocity_world: Vector3::zeros(),
                angular_rate_body: Vector3::zeros(),
                rotor_thrusts_n: [0.0; 4],
            },
            acceleration_world: Vector3::zeros(),
            angular_acceleration_body: Vector3::zeros(),
        })
    }

    /// One step of [`STEP_S`] with constant inputs.
    ///
    /// `rotor_thrust_commands_n` are limited to what the rotors can give; one that is not a number
    /// stops its rotor. `air_velocity_world` is the wind, m/s. The ground under the vehicle is
    /// level at `ground_height_m`.
    pub fn step(
        &mut self,
        rotor_thrust_commands_n: &[f64; 4],
        air_velocity_world: &Vector3<f64>,
        external: &Wrench,
        ground_height_m: f64,
    ) {
        let inputs = Inputs {
            rotor_commands_n: Vector4::from(*rotor_thrust_commands_n)
                .map(|c| self.config.producible_n(c)),
            air_velocity_world: *air_velocity_world,
            external: *external,
            ground_height_m,
        };
        self.advance(&inputs, STEP_S);
    }

    fn advance(&mut self, inputs: &Inputs, step_s: f64) {
        let before = Flow::from_state(&self.state);
        let after = self
            .dynamics
            .advance(&before, inputs, &self.contact, step_s);
        self.state = after.to_state();
        self.settle(inputs);
    }

    /// Moves the feet's anchors and evaluates the accelerations at the present state.
    fn settle(&mut self, inputs: &Inputs) {
        let now = Flow::from_state(&self.state);
        let height_m = self.state.world_from_body.translation.z - inputs.ground_height_m;
        if self.contact.is_near(height_m) {
            let rotation = *self
                .state
                .world_from_body
                .rotation
                .to_rotation_matrix()
                .matrix();
            let rate_world = rotation * self.state.angular_rate_body;
            self.contact
                .move_anchors(&now.motion(&rotation, &rate_world), inputs.ground_height_m);
        } else {
            self.contact.lift();
        }
        (self.acceleration_world, self.angular_acceleration_body) =
            self.dynamics.accelerations(&now, inputs, &self.contact);
    }

    /// State of motion.
    pub fn state(&self) -> &MultirotorState {
        &self.state
    }

    /// Puts the vehicle into a state of motion, for example to start in the air; accelerations are
    /// zero until the next step.
    pub fn set_state(&mut self, state: MultirotorState) {
        self.state = state;
        self.contact.lift();
        self.acceleration_world = Vector3::zeros();
        self.angular_acceleration_body = Vector3::zeros();
    }

    /// Physical facts.
    pub fn config(&self) -> &MultirotorConfig {
        &self.config
    }

    /// Acceleration at the end of the last step, world frame, gravity included, m/s^2.
    pub fn acceleration_world(&self) -> Vector3<f64> {
        self.acceleration_world
    }

    /// Angular acceleration at the end of the last step, body frame, rad/s^2.
    pub fn angular_acceleration_body(&self) -> Vector3<f64> {
        self.angular_acceleration_body
    }

    /// Whether a foot touches the ground.
    pub fn on_ground(&self) -> bool {
        self.contact.feet_touch()
    }

    /// Sum of the rotors' thrusts as a share of the greatest possible.
    pub fn thrust_fraction(&self) -> f64 {
        let sum: f64 = self.state.rotor_thrusts_n.iter().sum();
        sum / (4.0 * self.config.max_thrust_per_rotor_n)
    }

    /// The motion as the truth at `time`.
    pub fn truth(&self, time: Timestamp) -> Truth {
        Truth {
            time,
            world_from_body: self.state.world_from_body,
            velocity_world: self.state.velocity_world,
            acceleration_world: self.acceleration_world,
            angular_rate_body: self.state.angular_rate_body,
            angular_acceleration_body: self.angular_acceleration_body,
            on_ground: self.on_ground(),
        }
    }
}

impl MultirotorConfig {
    /// The part of a commanded rotor thrust that the rotor can produce, N.
    fn producible_n(&self, command_n: f64) -> f64 {
        if command_n.is_nan() {
            return 0.0;
        }
        command_n.clamp(0.0, self.max_thrust_per_rotor_n)
    }
}

#[cfg(test)]
mod closed_loop_tests;
#[cfg(test)]
mod tests;
