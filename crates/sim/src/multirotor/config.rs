//! Physical facts of a multirotor.

use alula_control::autopilot::AutopilotConfig;
use alula_control::mixer::{AirframeFacts, Layout};
use alula_geometry::GRAVITY_M_S2;
use alula_parameters::{ParameterError, Parameters, facts};

use super::contact;

facts! {
    /// A quadrotor's body: a rigid body with four rotors and feet. There are no defaults.
    pub struct MultirotorConfig {
        /// Mass with all that is carried, kg.
        pub mass_kg: f64, above(0.0);
        /// Principal moments of inertia about the body's axes, kg m^2.
        pub inertia_kg_m2: [f64; 3], above(0.0);
        /// Distance from the centre of mass to each rotor's axis, m.
        pub arm_length_m: f64, above(0.0);
        /// Where the rotors are: `plus` or `x`.
        pub layout: Layout, any();
        /// Drag torque per thrust of a rotor, m.
        pub thrust_to_torque_m: f64, above(0.0);
        /// Time constant of a rotor's thrust, s.
        pub rotor_time_constant_s: f64, within(0.002, 1.0);
        /// Greatest thrust of one rotor, N.
        pub max_thrust_per_rotor_n: f64, above(0.0);
        /// Drag per speed and mass along the heading, to its left and upwards, 1/s: A_x and A_y of
        /// document L, equation A-7.
        pub drag_per_s: [f64; 3], within(0.0, 10.0);
        /// Drag per squared speed, N s^2/m^2: half of air density times drag area. None if left out.
        pub quadratic_drag_n_s2_m2: Option<f64>, within(0.0, 10.0);
        /// Radius of the sphere around the centre of mass that holds the vehicle, m.
        pub radius_m: f64, above(0.0);
        /// Height of the centre of mass above the feet, m.
        pub landing_gear_height_m: f64, above(0.0);
        /// Horizontal distance from the centre of mass to each of four feet, m.
        pub landing_gear_radius_m: f64, above(0.0);
    }
}

facts! {
    /// A vehicle: its body and its autopilot.
    pub struct VehicleModel {
        /// The body.
        pub airframe: MultirotorConfig, nested();
        /// The autopilot; defaults where left out.
        #[serde(default)]
        pub autopilot: AutopilotConfig, nested();
    }
}

impl MultirotorConfig {
    /// Checks every fact and that they agree with one another.
    ///
    /// # Errors
    /// The first fact that is out of its range, or that no rigid body that flies can have.
    pub fn check(&self) -> Result<(), ParameterError> {
        self.validate()?;
        let [x, y, z] = self.inertia_kg_m2;
        if x > y + z || y > x + z || z > x + y {
            return Err(ParameterError::new(
                "inertia_kg_m2",
                format!("[{x}, {y}, {z}]"),
                "moments of which none exceeds the sum of the others",
            ));
        }
        if 4.0 * self.max_thrust_per_rotor_n <= self.mass_kg * GRAVITY_M_S2 {
            return Err(ParameterError::new(
                "max_thrust_per_rotor_n",
                self.max_thrust_per_rotor_n,
                format!("above {} to lift the mass", self.hover_thrust_per_rotor_n()),
            ));
        }
        Ok(())
    }

    /// What the autopilot of this vehicle knows of it.
    pub fn airframe_facts(&self) -> AirframeFacts {
        AirframeFacts {
            mass_kg: self.mass_kg,
            inertia_kg_m2: self.inertia_kg_m2,
            arm_length_m: self.arm_length_m,
            layout: self.layout,
            thrust_to_torque_m: self.thrust_to_torque_m,
            max_thrust_per_rotor_n: self.max_thrust_per_rotor_n,
        }
    }

    /// Thrust of each rotor in a level hover, N.
    pub fn hover_thrust_per_rotor_n(&self) -> f64 {
        0.25 * self.mass_kg * GRAVITY_M_S2
    }

    /// Height of the centre of mass above the ground on which the vehicle stands at rest, m: that
    /// of the landing gear less what the ground yields under the weight.
    pub fn standing_height_m(&self) -> f64 {
        self.landing_gear_height_m - contact::STATIC_YIELD_M
    }
}
