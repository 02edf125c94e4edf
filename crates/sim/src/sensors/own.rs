//! The autopilot's own sense of motion, good enough to hold an attitude and no better.

use alula_control::autopilot::AutopilotState;
use alula_geometry::so3;
use alula_parameters::parameters;
use nalgebra::Vector3;

use super::noise::{GaussMarkov, Noise};
use crate::Truth;

parameters! {
    /// Errors of what the autopilot senses.
    pub struct AutopilotSensing {
        /// Standard deviation of the attitude error about each axis, degrees.
        pub attitude_error_deg: f64 = 0.3, within(0.0, 20.0);
        /// Time in which the attitude error changes, s.
        pub attitude_time_constant_s: f64 = 10.0, above(0.0);
        /// White noise of the angular rate on each axis in every step of 1 ms, rad/s.
        pub rate_noise_rad_s: f64 = 0.005, within(0.0, 1.0);
        /// Standard deviation of the climb rate's error, m/s.
        pub climb_rate_error_m_s: f64 = 0.02, within(0.0, 5.0);
        /// Time in which the climb rate's error changes, s.
        pub climb_rate_time_constant_s: f64 = 5.0, above(0.0);
    }
}

/// What the autopilot knows of the motion.
#[derive(Clone, Debug)]
pub(crate) struct OwnSense {
    noise: Noise,
    rate_noise_rad_s: f64,
    attitude_error: GaussMarkov,
    climb_rate_error: GaussMarkov,
}

impl OwnSense {
    pub(crate) fn new(config: &AutopilotSensing, flight_seed: u64) -> Self {
        let mut noise = Noise::new(flight_seed, "autopilot");
        let sigma_rad = config.attitude_error_deg.to_radians();
        let (tilt_s, climb_s) = (
            config.attitude_time_constant_s,
            config.climb_rate_time_constant_s,
        );
        Self {
            rate_noise_rad_s: config.rate_noise_rad_s,
            attitude_error: GaussMarkov::new(sigma_rad, tilt_s, &mut noise),
            climb_rate_error: GaussMarkov::new(config.climb_rate_error_m_s, climb_s, &mut noise),
            noise,
        }
    }

    /// The motion as sensed `dt_s` after the last call.
    pub(crate) fn sense(&mut self, truth: &Truth, dt_s: f64) -> AutopilotState {
        let error_rad: Vector3<f64> = self.attitude_error.update(dt_s, &mut self.noise);
        let sensed = truth.world_from_body.rotation * so3::exp(&error_rad);
        let (roll_rad, pitch_rad, _) = so3::to_roll_pitch_yaw(&sensed);
        let climb_rate_error_m_s = self.climb_rate_error.update(dt_s, &mut self.noise).z;
        AutopilotState {
            roll_rad,
            pitch_rad,
            angular_rate_body: truth.angular_rate_body
                + self.noise.normal_vector() * self.rate_noise_rad_s,
            climb_rate_m_s: truth.velocity_world.z + climb_rate_error_m_s,
        }
    }
}
