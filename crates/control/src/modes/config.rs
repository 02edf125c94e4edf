//! Limits of the flight modes.

use alula_parameters::{ParameterError, parameters};

parameters! {
    /// Limits of the flight modes; the guard has its own, wider ones.
    pub struct FlightModesConfig {
        /// Greatest tilt at which the motors may be started, degrees.
        pub arm_tilt_deg: f64 = 10.0, within(1.0, 45.0);
        /// Greatest estimated speed at which the motors may be started, m/s.
        pub arm_speed_m_s: f64 = 0.3, within(0.01, 2.0);
        /// Greatest angular rate at which the motors may be started, rad/s.
        pub arm_rate_rad_s: f64 = 0.3, within(0.01, 2.0);
        /// An armed vehicle that does not take off is disarmed after this time, s.
        pub armed_timeout_s: f64 = 15.0, within(1.0, 300.0);
        /// A take-off that has not arrived after this time becomes a landing, s.
        pub take_off_timeout_s: f64 = 30.0, within(2.0, 300.0);
        /// Least height of take-off, of waypoints and for hovering, above the take-off point, m.
        pub min_height_m: f64 = 0.4, within(0.1, 5.0);
        /// Greatest height of take-off and of waypoints above the take-off point, m.
        pub max_height_m: f64 = 15.0, within(0.5, 500.0);
        /// Greatest distance of a waypoint from the world's origin along x and along y, m.
        pub max_distance_m: f64 = 45.0, within(1.0, 10000.0);
        /// The take-off ends within this distance of its height, m.
        pub height_tolerance_m: f64 = 0.15, within(0.01, 1.0);
        /// ... and at most at this vertical speed, m/s.
        pub settled_m_s: f64 = 0.3, within(0.01, 2.0);
        /// Recognition of the touchdown.
        pub touchdown: TouchdownConfig = TouchdownConfig::default(), nested();
    }
}

parameters! {
    /// Recognition of the touchdown from the share of the weight that the ground carries.
    pub struct TouchdownConfig {
        /// Time constant of the thrust that hovering takes, s.
        pub hover_time_constant_s: f64 = 1.0, within(0.1, 30.0);
        /// Time constant of the share of the weight that the ground carries, s.
        pub support_time_constant_s: f64 = 0.1, within(0.01, 1.0);
        /// A range up to this much above its value before take-off means the ground, m.
        pub near_ground_m: f64 = 0.1, within(0.02, 1.0);
        /// Greatest vertical speed of a vehicle that stands, by an estimate that is good, m/s.
        pub speed_m_s: f64 = 0.3, within(0.02, 2.0);
        /// Share of the weight on the ground when the range agrees.
        pub near_support: f64 = 0.2, within(0.1, 0.9);
        /// ... and for how long, s.
        pub near_dwell_s: f64 = 0.4, within(0.1, 10.0);
        /// Share of the weight on the ground when there is no range.
        pub blind_support: f64 = 0.3, within(0.1, 0.9);
        /// ... and for how long, s.
        pub blind_dwell_s: f64 = 1.0, within(0.1, 10.0);
        /// Share of the weight on the ground when the range says otherwise (it may be stuck).
        pub contradicted_support: f64 = 0.5, within(0.1, 0.9);
        /// ... and for how long, s.
        pub contradicted_dwell_s: f64 = 2.0, within(0.1, 10.0);
        /// Greatest acceleration of a killed vehicle that lies still, m/s^2; a falling one has 9.8.
        pub still_acceleration_m_s2: f64 = 2.0, within(0.2, 8.0);
        /// Greatest angular rate of a killed vehicle that lies still, rad/s.
        pub still_rate_rad_s: f64 = 0.5, within(0.05, 5.0);
        /// Time for which it must lie still before it may be disarmed, s.
        pub still_dwell_s: f64 = 1.0, within(0.1, 10.0);
    }
}

impl FlightModesConfig {
    /// The least height lies below the greatest.
    pub(super) fn validate_order(&self) -> Result<(), ParameterError> {
        if self.min_height_m < self.max_height_m {
            return Ok(());
        }
        Err(ParameterError::new(
            "min_height_m",
            self.min_height_m,
            format!("below `max_height_m`, which is {}", self.max_height_m),
        ))
    }
}
