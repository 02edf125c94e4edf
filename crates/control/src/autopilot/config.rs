//! Parameters of the autopilot.

use alula_parameters::parameters;

use super::response::Response;
use crate::pid::PidGains;

parameters! {
    /// Response and gains of roll or pitch. The output is an angular acceleration.
    pub struct TiltConfig {
        /// Tilt per commanded tilt.
        pub response_gain: f64 = 1.0, within(0.5, 2.0);
        /// Time constant of the wanted response, s.
        pub response_time_constant_s: f64 = 0.05, within(0.005, 5.0);
        /// Time constant that smooths the command, s.
        pub response_smoothing_s: f64 = 0.03, within(0.002, 1.0);
        /// Angular acceleration per error of the angle, 1/s^2.
        pub proportional_s2: f64 = 160.0, within(0.0, 5000.0);
        /// Angular acceleration per integral of the error, 1/s^3.
        pub integral_s3: f64 = 100.0, within(0.0, 20000.0);
        /// Angular acceleration per error of the angular rate, 1/s.
        pub derivative_s: f64 = 22.0, within(0.0, 500.0);
        /// Greatest share of the integral, rad/s^2.
        pub integral_limit_rad_s2: f64 = 20.0, within(0.0, 1000.0);
        /// Greatest output, rad/s^2.
        pub output_limit_rad_s2: f64 = 150.0, within(0.0, 5000.0);
    }
}

parameters! {
    /// Response and gains of the yaw rate. The output is an angular acceleration.
    pub struct YawRateConfig {
        /// Yaw rate per commanded yaw rate.
        pub response_gain: f64 = 1.0, within(0.5, 2.0);
        /// Time constant of the wanted response, s.
        pub response_time_constant_s: f64 = 0.2, within(0.005, 5.0);
        /// Time constant that smooths the command, s.
        pub response_smoothing_s: f64 = 0.05, within(0.002, 1.0);
        /// Angular acceleration per error of the rate, 1/s.
        pub proportional_s: f64 = 8.0, within(0.0, 500.0);
        /// Angular acceleration per integral of the error, 1/s^2.
        pub integral_s2: f64 = 4.0, within(0.0, 5000.0);
        /// Greatest share of the integral, rad/s^2.
        pub integral_limit_rad_s2: f64 = 2.0, within(0.0, 1000.0);
        /// Greatest output, rad/s^2.
        pub output_limit_rad_s2: f64 = 50.0, within(0.0, 5000.0);
    }
}

parameters! {
    /// Response and gains of the climb rate. The output is an acceleration.
    pub struct ClimbConfig {
        /// Climb rate per commanded climb rate.
        pub response_gain: f64 = 1.0, within(0.5, 2.0);
        /// Time constant of the wanted response, s.
        pub response_time_constant_s: f64 = 0.25, within(0.005, 5.0);
        /// Time constant that smooths the command, s.
        pub response_smoothing_s: f64 = 0.05, within(0.002, 1.0);
        /// Acceleration per error of the climb rate, 1/s.
        pub proportional_s: f64 = 5.0, within(0.0, 100.0);
        /// Acceleration per integral of the error, 1/s^2.
        pub integral_s2: f64 = 3.0, within(0.0, 500.0);
        /// Greatest share of the integral, m/s^2.
        pub integral_limit_m_s2: f64 = 4.0, within(0.0, 50.0);
        /// Greatest output, m/s^2.
        pub output_limit_m_s2: f64 = 8.0, within(0.0, 50.0);
    }
}

parameters! {
    /// Parameters of an [`Autopilot`](super::Autopilot). The defaults suit a vehicle whose rotors
    /// lag by about 20 ms.
    pub struct AutopilotConfig {
        /// Roll.
        pub roll: TiltConfig = TiltConfig::default(), nested();
        /// Pitch.
        pub pitch: TiltConfig = TiltConfig::default(), nested();
        /// Yaw rate.
        pub yaw_rate: YawRateConfig = YawRateConfig::default(), nested();
        /// Climb rate.
        pub climb: ClimbConfig = ClimbConfig::default(), nested();
        /// Greatest tilt that is obeyed, deg; a greater one is shortened to it.
        pub max_tilt_deg: f64 = 40.0, within(1.0, 70.0);
        /// Greatest yaw rate that is obeyed, deg/s.
        pub max_yaw_rate_deg_s: f64 = 200.0, within(1.0, 1000.0);
        /// Greatest climb or descent rate that is obeyed, m/s.
        pub max_climb_rate_m_s: f64 = 4.0, within(0.1, 30.0);
        /// Thrust of an idling rotor as a share of its greatest.
        pub idle_thrust_share: f64 = 0.03, within(0.0, 0.2);
        /// Rate of the level descent that replaces a command that is not finite, m/s.
        pub last_resort_descent_m_s: f64 = 0.5, within(0.0, 5.0);
    }
}

impl TiltConfig {
    pub(super) fn response(&self) -> Response {
        Response::new(
            self.response_gain,
            self.response_time_constant_s,
            self.response_smoothing_s,
        )
    }

    pub(super) fn gains(&self) -> PidGains {
        PidGains {
            proportional: self.proportional_s2,
            integral: self.integral_s3,
            derivative: self.derivative_s,
            integral_limit: self.integral_limit_rad_s2,
            output_limit: self.output_limit_rad_s2,
        }
    }
}

impl YawRateConfig {
    pub(super) fn response(&self) -> Response {
        Response::new(
            self.response_gain,
            self.response_time_constant_s,
            self.response_smoothing_s,
        )
    }

    pub(super) fn gains(&self) -> PidGains {
        PidGains {
            proportional: self.proportional_s,
            integral: self.integral_s2,
            derivative: 0.0,
            integral_limit: self.integral_limit_rad_s2,
            output_limit: self.output_limit_rad_s2,
        }
    }
}

impl ClimbConfig {
    pub(super) fn response(&self) -> Response {
        Response::new(
            self.response_gain,
            self.response_time_constant_s,
            self.response_smoothing_s,
        )
    }

    pub(super) fn gains(&self) -> PidGains {
        PidGains {
            proportional: self.proportional_s,
            integral: self.integral_s2,
            derivative: 0.0,
            integral_limit: self.integral_limit_m_s2,
            output_limit: self.output_limit_m_s2,
        }
    }
}
