//! Configuration and calibration of the flow odometry.

use alula_messages::Mount;
use alula_parameters::{facts, parameters};
use serde::{Deserialize, Serialize};

use crate::alignment::AlignmentConfig;
use crate::eskf::{ImuNoise, Variant};
use crate::imu::ImuLimits;
use crate::outliers::OutlierConfig;

/// What corrects the inertial data in flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorSet {
    /// Raw flow, and an infrared ranger that looks where the flow camera does (document S,
    /// sections 2.4.3 and 2.4.4).
    #[default]
    FlowAndInfrared,
    /// Velocity in metres, from flow and sonar, and the sonar's height (document S, section
    /// 2.4.2).
    VelocityAndSonar,
}

parameters! {
    /// Velocity in metres and height from a flow camera with a sonar beside it, as the PX4Flow is:
    /// the sonar's mount is that of the flow camera.
    pub struct SonarConfig {
        /// Standard deviation of the height, m (document S, table 2.3).
        pub height_sigma_m: f64 = 0.05, within(1e-4, 1.0);
        /// Standard deviation of the velocity on an axis, m/s (document S, table 2.3).
        pub velocity_sigma_m_s: f64 = 0.1, within(1e-4, 10.0);
        /// Age from which a height is too old to make a velocity of flow, s.
        pub max_age_s: f64 = 0.2, within(0.01, 5.0);
        /// Heights that do not belong to the others.
        pub outliers: OutlierConfig = OutlierConfig::default(), nested();
    }
}

facts! {
    /// Where the downward sensors are.
    pub struct FlowCalibration {
        /// Flow camera.
        pub flow_camera: Mount, nested();
        /// Infrared or laser ranger.
        pub infrared: Mount, nested();
    }
}

parameters! {
    /// Standing on the ground (document S, section 2.10.2, phase A).
    pub struct GroundConfig {
        /// Rate at which standing still is fused, Hz.
        pub rate_hz: f64 = 50.0, within(1.0, 500.0);
        /// Standard deviation of the zero velocity, m/s.
        pub velocity_sigma_m_s: f64 = 0.01, within(1e-4, 1.0);
        /// Standard deviation of the zero angular rate, rad/s.
        pub angular_rate_sigma_rad_s: f64 = 0.01, within(1e-5, 1.0);
        /// Standard deviation of the place before the first flight, m.
        pub position_sigma_m: f64 = 0.02, within(1e-4, 1.0);
        /// Standard deviation of the heading before the first flight, rad.
        pub yaw_sigma_rad: f64 = 0.01, within(1e-5, 1.0);
    }
}

parameters! {
    /// Odometry from inertial data, flow and range (document S, sections 2.3 to 2.7).
    pub struct FlowOdometryConfig {
        /// Which of the filters of document S, table 2.1.
        pub variant: Variant = Variant::default(), any();
        /// What corrects the inertial data in flight.
        pub sensors: SensorSet = SensorSet::default(), any();
        /// Velocity in metres and sonar, if they do.
        pub sonar: SonarConfig = SonarConfig::default(), nested();
        /// Noise of the inertial unit.
        pub imu_noise: ImuNoise = ImuNoise::default(), nested();
        /// Plausibility of the inertial unit.
        pub imu_limits: ImuLimits = ImuLimits::default(), nested();
        /// Start on the ground.
        pub alignment: AlignmentConfig = AlignmentConfig::default(), nested();
        /// Standing on the ground.
        pub ground: GroundConfig = GroundConfig::default(), nested();
        /// Inertial samples that are kept for measurements that come late.
        pub history_samples: usize = 250, within(10.0, 5000.0);
        /// Share of good measurements that pass the gate. Document S has 0.95, which throws away
        /// one good measurement in twenty and makes the filter believe itself too much.
        pub gate_probability: f64 = 0.999, within(0.5, 0.999_999);
        /// Standard deviation of flow on an axis, rad/s: 10 pixels per second (S, table 2.4) over
        /// the 667 pixels of the PX4Flow's focal length.
        pub flow_sigma_rad_s: f64 = 0.015, within(1e-4, 1.0);
        /// Least quality of a flow sample.
        pub flow_min_quality: f64 = 0.2, within(0.0, 1.0);
        /// Distance along the optical axis below which flow is not trusted, m (S, 2.10.2).
        pub flow_min_distance_m: f64 = 0.3, within(0.0, 5.0);
        /// Standard deviation of range, m (S, table 2.4).
        pub range_sigma_m: f64 = 0.02, within(1e-4, 1.0);
        /// Time for which a sensor may repeat a reading to the last bit before it counts as
        /// stuck, s. Longer for rangers with coarse steps.
        pub stuck_after_s: f64 = 0.3, within(0.01, 60.0);
        /// Time without velocity or height measurements before the estimate is degraded, s.
        pub degraded_after_s: f64 = 0.5, within(0.05, 60.0);
        /// The same while taking off and landing, where the downward sensors are blind, s.
        pub degraded_after_near_ground_s: f64 = 3.0, within(0.05, 60.0);
        /// Time for which the gate may refuse a sensor in flight before the filter admits that it
        /// may itself be wrong, s.
        pub recovery_after_s: f64 = 1.0, within(0.1, 60.0);
        /// Standard deviation of velocity that it then adds on each axis, m/s.
        pub recovery_velocity_sigma_m_s: f64 = 0.5, within(0.01, 10.0);
        /// Standard deviation of height that it then adds, m.
        pub recovery_height_sigma_m: f64 = 0.5, within(0.01, 10.0);
    }
}
