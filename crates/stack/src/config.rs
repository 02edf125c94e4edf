//! What the vehicle believes about itself, and the parameters of every part of the stack.

use alula_control::geometric::{BodyFacts, GeometricConfig};
use alula_control::modes::FlightModesConfig;
use alula_estimation::{BuildError, Estimator, EstimatorConfig, FlowCalibration, by_name};
use alula_parameters::{ParameterError, Parameters, facts, parameters};
use alula_safety::{GuardConfig, GuardVehicle};

use crate::avoidance::AvoidanceConfig;
use crate::guide::GuideConfig;

facts! {
    /// Physical facts about the vehicle, as far as they are known on board.
    pub struct BodyConfig {
        /// Mass with everything it carries, kg.
        pub mass_kg: f64, within(0.05, 50.0);
        /// Moments of inertia about the body's axes, kg m^2.
        pub inertia_kg_m2: [f64; 3], above(0.0);
        /// Greatest collective thrust, N.
        pub max_thrust_n: f64, above(0.0);
    }
}

parameters! {
    /// The choice of estimator and the parameters of all of them.
    pub struct EstimationConfig {
        /// Which estimator runs; `alula estimate --help` lists them.
        pub estimator: String = String::from("flow-odometry"), any();
        /// Where the downward sensors are, for flow odometry.
        pub calibration: Option<FlowCalibration> = None, nested();
        /// Parameters of each estimator.
        pub parameters: EstimatorConfig = EstimatorConfig::default(), nested();
    }
}

facts! {
    /// Configuration of a stack.
    pub struct StackConfig {
        /// Physical facts.
        pub body: BodyConfig, nested();
        /// Sensor data to state.
        pub estimation: EstimationConfig, nested();
        /// Flight modes.
        pub modes: FlightModesConfig, nested();
        /// From modes to references.
        pub guide: GuideConfig, nested();
        /// From references to commands.
        pub control: GeometricConfig, nested();
        /// Flight among obstacles; without it the vehicle flies blind through its waypoints.
        pub avoidance: Option<AvoidanceConfig>, nested();
        /// The guard.
        pub guard: GuardConfig, nested();
    }
}

impl BodyConfig {
    pub(crate) fn for_control(&self) -> BodyFacts {
        BodyFacts {
            mass_kg: self.mass_kg,
            inertia_kg_m2: self.inertia_kg_m2,
        }
    }

    pub(crate) fn for_guard(&self) -> GuardVehicle {
        GuardVehicle {
            mass_kg: self.mass_kg,
            max_thrust_n: self.max_thrust_n,
        }
    }
}

impl EstimationConfig {
    /// The chosen estimator.
    ///
    /// # Errors
    /// When its name is unknown, its calibration is missing or a parameter is not allowed.
    pub fn build(&self) -> Result<Box<dyn Estimator>, ParameterError> {
        self.validate()?;
        by_name(&self.estimator, &self.parameters, self.calibration.as_ref()).map_err(|error| {
            match error {
                BuildError::Parameter(error) => error.under("parameters"),
                BuildError::UnknownName { name } => ParameterError::new(
                    "estimator",
                    name,
                    format!("one of {}", alula_estimation::ESTIMATOR_NAMES.join(", ")),
                ),
                BuildError::NoCalibration { name } => ParameterError::new(
                    "calibration",
                    "missing",
                    format!("the mounts of flow camera and ranger, which `{name}` needs"),
                ),
            }
        })
    }
}
