//! The geometric tracking controller of document S, section 2.9.2, after Lee (2013) and Mellinger
//! and Kumar (2011), derived for a z-up world and a forward-left-up body.
//!
//! The page `docs/derivations/geometric-control.md` gives the equations and the differences from
//! the source.

mod attitude;
mod output;
mod position;
#[cfg(test)]
mod tests;

use alula_geometry::so3;
use alula_messages::{NavState, Reference};
use alula_parameters::{ParameterError, Parameters, facts, parameters};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use attitude::DesiredAttitude;
pub use output::{GeometricOutput, GeometricStatus};
use position::PositionLoop;

facts! {
    /// What the controller knows of the vehicle.
    pub struct BodyFacts {
        /// Mass, kg.
        pub mass_kg: f64, within(0.01, 100.0);
        /// Principal moments of inertia about the body's axes, kg m^2.
        pub inertia_kg_m2: [f64; 3], within(1e-7, 100.0);
    }
}

parameters! {
    /// Gains and limits of the geometric controller. Gains are natural frequencies and damping
    /// ratios per axis, so that they do not depend on mass and inertia.
    pub struct GeometricConfig {
        /// Natural frequency of the position error, world axes, rad/s.
        pub position_frequency_rad_s: [f64; 3] = [2.5, 2.5, 3.0], within(0.1, 20.0);
        /// Damping ratio of the position error, world axes.
        pub position_damping: [f64; 3] = [0.85, 0.85, 0.9], within(0.1, 3.0);
        /// Gain of the integral of the position error, world axes, 1/s^3. The position loop is
        /// stable while this is below frequency^3 * 2 * damping (Routh).
        pub integral_gain_1_s3: [f64; 3] = [2.0, 2.0, 3.0], within(0.0, 1000.0);
        /// Greatest acceleration that the integral may ask for, per axis, m/s^2.
        pub max_integral_m_s2: f64 = 3.0, within(0.0, 10.0);
        /// Position error beyond which the integral rests, m: there a transient is under way, not
        /// a steady error.
        pub integral_zone_m: f64 = 0.5, within(0.0, 100.0);
        /// Length to which the position error is shortened, m; bounds the speed of the return.
        pub max_position_error_m: f64 = 1.5, within(0.05, 100.0);
        /// Natural frequency of the attitude error, body axes, rad/s.
        pub attitude_frequency_rad_s: [f64; 3] = [14.0, 14.0, 5.0], within(0.1, 100.0);
        /// Damping ratio of the attitude error, body axes.
        pub attitude_damping: [f64; 3] = [0.8, 0.8, 0.9], within(0.1, 3.0);
        /// Greatest desired angular rate that is fed forward, rad/s.
        pub max_angular_rate_rad_s: f64 = 6.0, within(0.1, 50.0);
        /// Greatest desired angular acceleration that is fed forward, rad/s^2.
        pub max_angular_acceleration_rad_s2: f64 = 60.0, within(0.0, 1000.0);
        /// Greatest desired tilt, degrees.
        pub max_tilt_deg: f64 = 35.0, within(1.0, 75.0);
        /// Greatest thrust as a share of the weight.
        pub max_thrust_to_weight: f64 = 1.8, within(1.05, 10.0);
        /// Least vertical thrust as a share of the weight. Above zero the desired thrust always
        /// points up, so that free fall leaves the attitude defined.
        pub min_thrust_to_weight: f64 = 0.2, within(0.01, 0.95);
        /// Gain from yaw error to yaw rate of the attitude and thrust command, 1/s.
        pub yaw_gain_1_s: f64 = 2.0, within(0.0, 20.0);
        /// Greatest yaw rate of the attitude and thrust command, rad/s.
        pub max_yaw_rate_rad_s: f64 = 2.6, within(0.01, 10.0);
        /// Time by which the tilt of the attitude and thrust command runs ahead along its
        /// predicted course, s: the delay of the autopilot's attitude loop.
        pub attitude_lead_s: f64 = 0.0, within(0.0, 0.5);
    }
}

impl GeometricConfig {
    /// Gain of the position error, 1/s^2.
    pub fn position_gain_1_s2(&self) -> Vector3<f64> {
        Vector3::from(self.position_frequency_rad_s).map(|w| w * w)
    }

    /// Gain of the velocity error, 1/s.
    pub fn velocity_gain_1_s(&self) -> Vector3<f64> {
        2.0 * Vector3::from(self.position_frequency_rad_s)
            .component_mul(&Vector3::from(self.position_damping))
    }

    /// Gain of the attitude error, 1/s^2.
    pub fn attitude_gain_1_s2(&self) -> Vector3<f64> {
        Vector3::from(self.attitude_frequency_rad_s).map(|w| w * w)
    }

    /// Gain of the angular rate error, 1/s.
    pub fn rate_gain_1_s(&self) -> Vector3<f64> {
        2.0 * Vector3::from(self.attitude_frequency_rad_s)
            .component_mul(&Vector3::from(self.attitude_damping))
    }

    /// The cubic s^3 + kv s^2 + kp s + ki is stable for ki < kp kv.
    fn check_integral(&self) -> Result<(), ParameterError> {
        let limit = self
            .position_gain_1_s2()
            .component_mul(&self.velocity_gain_1_s());
        for axis in 0..3 {
            if self.integral_gain_1_s3[axis] >= limit[axis] {
                return Err(ParameterError::new(
                    format!("integral_gain_1_s3[{axis}]"),
                    self.integral_gain_1_s3[axis],
                    format!("below {} (frequency^3 * 2 * damping)", limit[axis]),
                ));
            }
        }
        Ok(())
    }
}

/// Tracks a [`Reference`] with thrust and torque, or with attitude and thrust.
#[derive(Clone, Debug)]
pub struct GeometricController {
    config: GeometricConfig,
    mass_kg: f64,
    inertia_kg_m2: Vector3<f64>,
    position: PositionLoop,
}

impl GeometricController {
    /// A controller for a vehicle.
    ///
    /// # Errors
    /// The first parameter that is not allowed.
    pub fn new(config: &GeometricConfig, body: &BodyFacts) -> Result<Self, ParameterError> {
        config.validate()?;
        config.check_integral()?;
        body.validate()?;
        Ok(Self {
            config: config.clone(),
            mass_kg: body.mass_kg,
            inertia_kg_m2: Vector3::from(body.inertia_kg_m2),
            position: PositionLoop::new(config),
        })
    }

    /// Clears the integral of the position error.
    pub fn reset(&mut self) {
        self.position.reset();
    }

    /// Acceleration that the integral asks for, world, m/s^2: minus the steady disturbance.
    pub fn integral_world(&self) -> Vector3<f64> {
        self.position.integral_world()
    }

    /// One step of length `dt_s` towards `reference`.
    ///
    /// Input that is not finite gives level hover thrust without torque and leaves the integral.
    pub fn update(
        &mut self,
        state: &NavState,
        reference: &Reference,
        dt_s: f64,
    ) -> GeometricOutput {
        if !(state.is_finite() && reference.is_finite() && dt_s.is_finite() && dt_s >= 0.0) {
            return GeometricOutput::level_hover(self.mass_kg, state);
        }
        let world_from_body = state
            .world_from_body
            .rotation
            .to_rotation_matrix()
            .into_inner();
        let force = self
            .position
            .update(state, &world_from_body, reference, dt_s);
        let desired = DesiredAttitude::new(&force, reference).limited(&self.config);
        let torque_body_nm = self.torque(&world_from_body, &state.angular_rate_body, &desired);
        let (roll_rad, pitch_rad) = self.tilt_for_present_yaw(state, &desired);
        let output = GeometricOutput {
            thrust_n: self.mass_kg * force.thrust_m_s2,
            torque_body_nm,
            world_from_body_desired: desired.rotation(),
            angular_rate_desired_body: desired.angular_rate,
            angular_acceleration_desired_body: desired.angular_acceleration,
            position_error_world: state.position_world() - reference.position_world,
            velocity_error_world: state.velocity_world - reference.velocity_world,
            roll_rad,
            pitch_rad,
            yaw_rate_rad_s: self.yaw_rate(state, reference),
            status: force.status,
        };
        // Numbers near the end of the range of f64 are finite and their squares are not.
        if output.is_finite() {
            output
        } else {
            GeometricOutput::level_hover(self.mass_kg, state)
        }
    }

    /// Document S, equation (2.85b) with gains normalised by the inertia:
    /// tau = I (-k_R e_R - k_w e_w + Q dw_c - w x Q w_c) + w x I w, Q = R^T R_c.
    fn torque(
        &self,
        world_from_body: &Matrix3<f64>,
        rate: &Vector3<f64>,
        desired: &DesiredAttitude,
    ) -> Vector3<f64> {
        let body_from_desired = world_from_body.transpose() * desired.world_from_desired;
        let error = 0.5 * so3::unskew(&(body_from_desired.transpose() - body_from_desired));
        let rate_desired = body_from_desired * desired.angular_rate;
        let acceleration = body_from_desired * desired.angular_acceleration
            - rate.cross(&rate_desired)
            - self.config.attitude_gain_1_s2().component_mul(&error)
            - self
                .config
                .rate_gain_1_s()
                .component_mul(&(rate - rate_desired));
        self.inertia_kg_m2.component_mul(&acceleration)
            + rate.cross(&self.inertia_kg_m2.component_mul(rate))
    }

    /// Roll and pitch (rad) that point the thrust where it is wanted while the yaw is what it is.
    fn tilt_for_present_yaw(&self, state: &NavState, desired: &DesiredAttitude) -> (f64, f64) {
        let ahead = so3::exp(&(desired.angular_rate * self.config.attitude_lead_s));
        let thrust_axis_world = desired.world_from_desired * (ahead * Vector3::z());
        let axis = limit_tilt(&thrust_axis_world, self.config.max_tilt_deg.to_radians());
        let yaw = so3::yaw_rad(&state.world_from_body.rotation);
        // R_y(pitch) R_x(roll) e_3 = [sin p cos r, -sin r, cos p cos r]
        let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw) * axis;
        (
            -heading.y.clamp(-1.0, 1.0).asin(),
            heading.x.atan2(heading.z),
        )
    }

    fn yaw_rate(&self, state: &NavState, reference: &Reference) -> f64 {
        let yaw = so3::yaw_rad(&state.world_from_body.rotation);
        let error = so3::wrap_angle(reference.yaw_rad - yaw);
        let limit = self.config.max_yaw_rate_rad_s;
        (reference.yaw_rate_rad_s + self.config.yaw_gain_1_s * error).clamp(-limit, limit)
    }
}

/// A unit vector brought within `max_tilt_rad` of the vertical.
fn limit_tilt(axis: &Vector3<f64>, max_tilt_rad: f64) -> Vector3<f64> {
    let horizontal = axis.xy().norm();
    if horizontal.atan2(axis.z) <= max_tilt_rad {
        return *axis;
    }
    let scale = max_tilt_rad.sin() / horizontal;
    Vector3::new(axis.x * scale, axis.y * scale, max_tilt_rad.cos())
}
