//! Configuration of the cascade velocity estimator.

use alula_parameters::parameters;
use serde::{Deserialize, Serialize};

use crate::alignment::AlignmentConfig;
use crate::complementary::ComplementaryConfig;
use crate::eskf::ImuNoise;
use crate::imu::ImuLimits;

/// Which ranger says how far the ground is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ranger {
    /// The infrared or laser ranger, at its own mount.
    #[default]
    Infrared,
    /// The echo sonar that is built into the flow camera, at the camera's mount (document O,
    /// section 2.5.1).
    Sonar,
}

parameters! {
    /// Velocity and height from inertial data, raw flow and range (document O, section 2.5).
    pub struct CascadeConfig {
        /// Noise of the inertial unit.
        pub imu_noise: ImuNoise = ImuNoise::default(), nested();
        /// Plausibility of the inertial unit.
        pub imu_limits: ImuLimits = ImuLimits::default(), nested();
        /// Start on the ground.
        pub alignment: AlignmentConfig = AlignmentConfig::default(), nested();
        /// The first stage: attitude.
        pub attitude: ComplementaryConfig = ComplementaryConfig::default(), nested();
        /// Which ranger is used.
        pub ranger: Ranger = Ranger::Infrared, any();
        /// Inertial samples that are kept for measurements that come late.
        pub history_samples: usize = 100, within(10.0, 5000.0);
        /// Share of good measurements that pass the gate.
        pub gate_probability: f64 = 0.999, within(0.5, 0.999_999);
        /// Noise of the acceleration beside that of the inertial unit, for errors of attitude that
        /// change as the vehicle tilts, m/s^2/sqrt(Hz).
        pub acceleration_noise_m_s2_sqrt_hz: f64 = 0.1, within(0.0, 10.0);
        /// Rate at which standing still is fused on the ground, Hz.
        pub ground_rate_hz: f64 = 50.0, within(1.0, 500.0);
        /// Standard deviation of the zero velocity on the ground, m/s.
        pub ground_velocity_sigma_m_s: f64 = 0.01, within(1e-4, 1.0);
        /// Standard deviation of flow on an axis, rad/s (document S, table 2.4).
        pub flow_sigma_rad_s: f64 = 0.015, within(1e-4, 1.0);
        /// Least quality of a flow sample.
        pub flow_min_quality: f64 = 0.2, within(0.0, 1.0);
        /// Distance along the optical axis below which flow is not trusted, m.
        pub flow_min_distance_m: f64 = 0.3, within(0.0, 5.0);
        /// Standard deviation of range, m (document S, table 2.4).
        pub range_sigma_m: f64 = 0.02, within(1e-4, 1.0);
        /// Time for which a sensor may repeat a reading to the last bit before it counts as
        /// stuck, s.
        pub stuck_after_s: f64 = 0.3, within(0.01, 60.0);
        /// Time without velocity or height measurements before the estimate is degraded, s.
        pub degraded_after_s: f64 = 0.5, within(0.05, 60.0);
        /// The same while taking off and landing, where the downward sensors are blind, s.
        pub degraded_after_near_ground_s: f64 = 3.0, within(0.05, 60.0);
        /// Time for which the gate may refuse a sensor before the filter admits that it may itself
        /// be wrong, s.
        pub recovery_after_s: f64 = 1.0, within(0.1, 60.0);
        /// Standard deviation of velocity that it then adds on each axis, m/s.
        pub recovery_velocity_sigma_m_s: f64 = 0.5, within(0.01, 10.0);
        /// Standard deviation of height that it then adds, m.
        pub recovery_height_sigma_m: f64 = 0.5, within(0.01, 10.0);
    }
}
