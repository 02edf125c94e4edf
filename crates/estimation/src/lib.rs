//! Filters, odometry, consistency and trajectory metrics.
//!
//! [`FlowOdometry`] estimates motion from inertial data, raw flow and range; [`PoseImu`] from
//! inertial data and external poses. Both share the error-state Kalman filter of [`eskf`] and the
//! rewinding [`history`]. [`Cascade`] estimates velocity and height in two small stages, of which the
//! first is the [`complementary`] attitude filter. All are an [`Estimator`] and say what they did
//! with each measurement as [`alula_messages::Fusion`]. [`metrics`] judges trajectories and
//! consistency.

pub mod alignment;
mod cascade;
pub mod complementary;
pub mod eskf;
mod estimator;
mod flow_odometry;
pub mod history;
pub mod imu;
mod inertial_core;
pub mod measurement;
pub mod metrics;
mod outliers;
mod pose_imu;
mod pose_sensor;
mod watch;

pub use cascade::{Cascade, CascadeConfig, Ranger};
pub use estimator::{BuildError, ESTIMATOR_NAMES, Estimator, EstimatorConfig, by_name};
pub use flow_odometry::{
    FlowCalibration, FlowOdometry, FlowOdometryConfig, GroundConfig, SensorSet, SonarConfig,
};
pub use outliers::OutlierConfig;
pub use pose_imu::{PoseImu, PoseImuConfig};
pub use pose_sensor::PoseSensorConfig;
