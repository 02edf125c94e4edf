//! What all estimators have in common, and their list.

use alula_messages::{FlightMode, Fusion, NavState, SensorBatch, Unobserved};
use alula_parameters::{ParameterError, parameters};

use crate::{
    Cascade, CascadeConfig, FlowCalibration, FlowOdometry, FlowOdometryConfig, PoseImu,
    PoseImuConfig,
};

/// Estimates the vehicle's motion from what its sensors say.
pub trait Estimator {
    /// Takes all that arrived since the last call. `mode` is the mode of flight at that time.
    fn update(&mut self, batch: &SensorBatch, mode: FlightMode);

    /// The present estimate, at the time of the last inertial sample.
    fn state(&self) -> &NavState;

    /// What became of each measurement in the last [`Self::update`].
    fn fusions(&self) -> &[Fusion];

    /// What of the present state the sensors say nothing about.
    fn unobserved(&self) -> Unobserved;
}

/// Correlation of accelerometer bias and tilt from which one cannot be told from the other: knowing
/// one would take away 72 % of the other's variance. Hovering makes 0.88 to 0.97, curves with 15
/// degrees of tilt 0.4 to 0.8.
pub(crate) const TIED: f64 = 0.85;

/// Names that [`by_name`] knows.
pub const ESTIMATOR_NAMES: [&str; 3] = ["flow-odometry", "pose-imu", "cascade"];

parameters! {
    /// Configuration of all estimators; each reads its own table.
    pub struct EstimatorConfig {
        /// Inertial data, flow and range.
        pub flow_odometry: FlowOdometryConfig = FlowOdometryConfig::default(), nested();
        /// Inertial data and external poses.
        pub pose_imu: PoseImuConfig = PoseImuConfig::default(), nested();
        /// Inertial data, flow and range, in two stages.
        pub cascade: CascadeConfig = CascadeConfig::default(), nested();
    }
}

/// Why there is no such estimator.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// No estimator has this name.
    #[error("there is no estimator `{name}`; there are: {}", ESTIMATOR_NAMES.join(", "))]
    UnknownName {
        /// The name asked for.
        name: String,
    },
    /// It needs to know where its flow camera and its ranger are.
    #[error("the estimator `{name}` needs the calibrated mounts of flow camera and ranger")]
    NoCalibration {
        /// Its name.
        name: String,
    },
    /// A parameter is not allowed.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
}

/// The estimator with one of the [`ESTIMATOR_NAMES`].
///
/// # Errors
/// If the name is unknown, a parameter is not allowed, or the calibration is missing.
pub fn by_name(
    name: &str,
    config: &EstimatorConfig,
    calibration: Option<&FlowCalibration>,
) -> Result<Box<dyn Estimator>, BuildError> {
    let mounts = || {
        calibration.ok_or(BuildError::NoCalibration {
            name: name.to_owned(),
        })
    };
    match name {
        "flow-odometry" => Ok(Box::new(FlowOdometry::new(
            &config.flow_odometry,
            mounts()?,
        )?)),
        "cascade" => Ok(Box::new(Cascade::new(&config.cascade, mounts()?)?)),
        "pose-imu" => Ok(Box::new(PoseImu::new(&config.pose_imu)?)),
        _ => Err(BuildError::UnknownName {
            name: name.to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_messages::{Looking, Mount};

    #[test]
    fn every_listed_name_can_be_built() {
        let calibration = FlowCalibration {
            flow_camera: Mount::at([0.0; 3], Looking::Down),
            infrared: Mount::at([0.0; 3], Looking::Down),
        };
        for name in ESTIMATOR_NAMES {
            assert!(by_name(name, &EstimatorConfig::default(), Some(&calibration)).is_ok());
        }
    }

    #[test]
    fn an_unknown_name_is_answered_with_the_list() {
        let error = by_name("gps", &EstimatorConfig::default(), None)
            .err()
            .unwrap();
        assert!(error.to_string().contains("flow-odometry, pose-imu"));
    }
}
