//! Limits of the guard, for flights of about 2 m/s indoors, and the facts it needs.

use alula_parameters::{ParameterError, facts, parameters};

facts! {
    /// What the guard must know of the vehicle.
    pub struct GuardVehicle {
        /// Mass, kg.
        pub mass_kg: f64, within(0.01, 100.0);
        /// Greatest collective thrust, N.
        pub max_thrust_n: f64, within(0.1, 10000.0);
    }
}

parameters! {
    /// Limits and fallbacks of the guard.
    pub struct GuardConfig {
        /// Where the vehicle may be.
        pub fence: FenceConfig = FenceConfig::default(), nested();
        /// How it may move.
        pub motion: MotionLimits = MotionLimits::default(), nested();
        /// What is expected of the estimate.
        pub estimate: EstimateLimits = EstimateLimits::default(), nested();
        /// What is expected of the sensors.
        pub sensors: SensorLimits = SensorLimits::default(), nested();
        /// What may be commanded.
        pub command: CommandLimits = CommandLimits::default(), nested();
        /// The descent that the guard flies itself.
        pub descent: DescentConfig = DescentConfig::default(), nested();
        /// A hold is released when its causes have been absent for this long, s.
        pub release_s: f64 = 1.0, within(0.0, 60.0);
        /// The flight modes must obey within this time, or the next graver fallback follows, s.
        pub obey_s: f64 = 1.0, within(0.05, 10.0);
        /// A landing that the guard asked for must end within this time, s.
        pub landing_limit_s: f64 = 60.0, within(1.0, 600.0);
    }
}

parameters! {
    /// Where the vehicle may be.
    pub struct FenceConfig {
        /// Least x, y and z of the permitted box, world, m.
        pub min_m: [f64; 3] = [-50.0, -50.0, -5.0], within(-10000.0, 10000.0);
        /// Greatest x, y and z of the permitted box, world, m.
        pub max_m: [f64; 3] = [50.0, 50.0, 50.0], within(-10000.0, 10000.0);
        /// Greatest height above the place of take-off, and above what the ranger sees, m.
        pub ceiling_m: f64 = 20.0, within(0.5, 1000.0);
        /// Deceleration that the look-ahead counts on, m/s^2.
        pub braking_m_s2: f64 = 2.0, within(0.1, 20.0);
        /// A vehicle that is outside for this long lands, s.
        pub outside_s: f64 = 2.0, within(0.0, 60.0);
    }
}

parameters! {
    /// How the vehicle may move.
    pub struct MotionLimits {
        /// Greatest estimated speed, m/s.
        pub speed_m_s: f64 = 4.0, within(0.1, 50.0);
        /// Hold after exceeding it for this long, s.
        pub speed_hold_s: f64 = 0.2, within(0.0, 10.0);
        /// Land after exceeding it for this long, s.
        pub speed_land_s: f64 = 2.0, within(0.0, 60.0);
        /// Greatest estimated tilt, degrees.
        pub tilt_deg: f64 = 45.0, within(5.0, 85.0);
        /// Greatest tilt by the guard's own attitude, which is coarser, degrees.
        pub raw_tilt_deg: f64 = 60.0, within(5.0, 90.0);
        /// Hold after exceeding either tilt for this long, s.
        pub tilt_hold_s: f64 = 0.2, within(0.0, 10.0);
        /// Descend after exceeding either tilt for this long, s.
        pub tilt_descend_s: f64 = 1.0, within(0.0, 10.0);
        /// From this tilt on the vehicle tumbles, degrees.
        pub tumble_deg: f64 = 100.0, within(90.0, 179.0);
        /// Motors are cut after tumbling for this long, s.
        pub tumble_s: f64 = 0.3, within(0.05, 5.0);
    }
}

parameters! {
    /// What is expected of the estimate.
    pub struct EstimateLimits {
        /// Greatest age of the estimate, s.
        pub stale_s: f64 = 0.1, within(0.01, 2.0);
        /// Time without corrections of velocity that counts as flow lost, and of height that
        /// counts as range lost, s.
        pub degraded_s: f64 = 2.0, within(0.1, 60.0);
        /// Descend when in a landing neither velocity nor height has been corrected, and no range
        /// has arrived, for this long, s.
        pub blind_landing_s: f64 = 0.6, within(0.0, 10.0);
        /// Greatest standard deviation of a horizontal coordinate of the position, m. Odometry
        /// drifts without bound, so this limits the length of a flight as well.
        pub position_sigma_m: f64 = 10.0, within(0.1, 10000.0);
        /// Greatest standard deviation of the height, m.
        pub height_sigma_m: f64 = 1.0, within(0.05, 100.0);
        /// Greatest standard deviation of a component of the velocity, m/s.
        pub velocity_sigma_m_s: f64 = 1.0, within(0.05, 20.0);
        /// Greatest standard deviation of roll and pitch, degrees.
        pub attitude_sigma_deg: f64 = 10.0, within(0.5, 60.0);
        /// Land after one of these was exceeded for this long, s.
        pub sigma_s: f64 = 1.0, within(0.0, 60.0);
        /// Greatest difference between the estimated height and the range, m.
        pub height_gap_m: f64 = 0.7, within(0.05, 50.0);
        /// Land after that difference lasted this long, s.
        pub height_gap_s: f64 = 1.5, within(0.0, 60.0);
        /// Greatest difference between the estimated vertical speed and that of range and
        /// specific force, m/s.
        pub climb_gap_m_s: f64 = 1.0, within(0.05, 20.0);
        /// Greatest difference between the estimated horizontal velocity and flow times range, m/s.
        pub flow_gap_m_s: f64 = 1.0, within(0.05, 20.0);
        /// Land after one of these differences lasted this long, s.
        pub velocity_gap_s: f64 = 1.0, within(0.0, 60.0);
        /// Greatest angle between the estimated vertical and the guard's own, degrees.
        pub vertical_gap_deg: f64 = 30.0, within(2.0, 90.0);
        /// Descend after that angle lasted this long, s.
        pub vertical_gap_s: f64 = 0.5, within(0.0, 10.0);
        /// A contradiction that lasts this much longer than its landing makes a descent, s.
        pub distrust_s: f64 = 3.0, within(0.1, 60.0);
    }
}

parameters! {
    /// What is expected of the sensors.
    pub struct SensorLimits {
        /// Descend after this long without usable inertial data, s.
        pub imu_lost_s: f64 = 0.1, within(0.01, 2.0);
        /// Greatest specific force that is believed, m/s^2: the range of common sensors, 16 g.
        pub specific_force_m_s2: f64 = 160.0, within(20.0, 1000.0);
        /// Greatest angular rate that is believed, rad/s: the range of common sensors, 2000 deg/s.
        pub angular_rate_rad_s: f64 = 35.0, within(1.0, 100.0);
        /// A specific force that differs by more from the sample before has jumped, m/s^2.
        pub imu_jump_m_s2: f64 = 10.0, within(1.0, 1000.0);
        /// Greatest share of samples that jump, over a tenth of a second, with which inertial data
        /// are still believed.
        pub imu_jump_share: f64 = 0.4, within(0.05, 1.0);
        /// Least quality of a flow sample that counts.
        pub flow_quality: f64 = 0.3, within(0.0, 1.0);
        /// Height below which no flow is expected, m.
        pub flow_min_height_m: f64 = 0.5, within(0.0, 10.0);
        /// Hold after this long without flow, s.
        pub flow_hold_s: f64 = 1.0, within(0.05, 60.0);
        /// Land after this long without flow, s.
        pub flow_land_s: f64 = 3.0, within(0.05, 60.0);
        /// Descend after this long without flow: dead reckoning has drifted away by then, s.
        pub flow_descend_s: f64 = 10.0, within(0.05, 120.0);
        /// Hold after this long without a depth image that shows anything, s; only where the
        /// vehicle avoids what it sees.
        pub depth_hold_s: f64 = 1.0, within(0.05, 60.0);
        /// Land after this long without one, s.
        pub depth_land_s: f64 = 5.0, within(0.05, 120.0);
        /// Land after this long without a valid range, s.
        pub range_lost_s: f64 = 1.0, within(0.05, 60.0);
        /// Land after all rangers have repeated one reading to the last bit for this long, s.
        pub range_stuck_s: f64 = 1.0, within(0.05, 60.0);
        /// Least height above what the ranger sees while hovering and flying, m.
        pub range_low_m: f64 = 0.25, within(0.0, 10.0);
        /// Hold after being lower for this long, s.
        pub range_low_hold_s: f64 = 0.3, within(0.0, 10.0);
        /// Land after being lower for this long, s.
        pub range_low_land_s: f64 = 2.0, within(0.0, 60.0);
    }
}

parameters! {
    /// What may be commanded.
    pub struct CommandLimits {
        /// Greatest roll and pitch, degrees.
        pub tilt_deg: f64 = 50.0, within(1.0, 80.0);
        /// Greatest yaw rate, rad/s.
        pub yaw_rate_rad_s: f64 = 4.0, within(0.1, 20.0);
        /// Greatest climb and descent rate, m/s.
        pub climb_rate_m_s: f64 = 4.0, within(0.1, 20.0);
        /// Greatest torque about each axis, N m.
        pub torque_nm: f64 = 10.0, within(0.001, 1000.0);
        /// Descend after this long with commands that are not valid, s. Not one of them passes.
        pub invalid_descend_s: f64 = 0.3, within(0.0, 10.0);
    }
}

parameters! {
    /// The descent that the guard flies itself: level, slow, without the estimate.
    pub struct DescentConfig {
        /// Speed of descent, m/s.
        pub speed_m_s: f64 = 0.5, within(0.05, 3.0);
        /// Acceleration per error of the vertical speed, 1/s.
        pub gain_hz: f64 = 2.0, within(0.1, 10.0);
        /// Greatest correction of the vertical acceleration, m/s^2.
        pub correction_m_s2: f64 = 1.5, within(0.1, 4.0);
        /// Thrust as a share of hovering when there are no inertial data.
        pub blind_share: f64 = 0.97, within(0.7, 1.0);
        /// The vertical speed is forgotten with this time constant when there is no range, s.
        pub forget_s: f64 = 3.0, within(0.5, 60.0);
        /// The ground is suspected when it seems to carry this share of the weight.
        pub suspect_support: f64 = 0.08, within(0.01, 0.5);
        /// The motors are cut when it carries this share.
        pub cut_support: f64 = 0.35, within(0.1, 0.9);
        /// ... for this long, s.
        pub cut_s: f64 = 0.2, within(0.02, 5.0);
        /// While the ground is suspected, thrust falls by this much, m/s^2 per s.
        pub probe_m_s3: f64 = 2.0, within(0.1, 10.0);
        /// The range above its value before take-off that means the ground, m.
        pub near_ground_m: f64 = 0.1, within(0.02, 1.0);
        /// The motors are cut after being that near for this long, s.
        pub near_ground_s: f64 = 1.5, within(0.1, 10.0);
        /// The motors are cut at the end of this time in any case, s.
        pub limit_s: f64 = 60.0, within(1.0, 600.0);
        /// How it begins.
        pub brake: BrakeConfig = BrakeConfig::default(), nested();
    }
}

parameters! {
    /// The brake with which the guard's own descent begins when the velocity was known until then.
    pub struct BrakeConfig {
        /// Tilt against the velocity, degrees; zero stays level.
        pub tilt_deg: f64 = 15.0, within(0.0, 30.0);
        /// Greatest age of the velocity, s.
        pub max_age_s: f64 = 0.3, within(0.0, 1.0);
        /// Time after which the attitude has followed a command, s.
        pub lag_s: f64 = 0.1, within(0.0, 1.0);
        /// Least speed that is braked, m/s.
        pub min_speed_m_s: f64 = 0.3, within(0.05, 5.0);
        /// Longest time of braking, s.
        pub max_duration_s: f64 = 1.5, within(0.0, 5.0);
        /// Greatest standard deviation of a horizontal component of the velocity, m/s.
        pub sigma_m_s: f64 = 0.4, within(0.01, 2.0);
        /// Greatest difference between the velocity and flow times range, m/s.
        pub flow_gap_m_s: f64 = 0.5, within(0.05, 5.0);
    }
}

impl GuardConfig {
    /// The fence has an inside.
    pub(crate) fn validate_order(&self) -> Result<(), ParameterError> {
        for axis in 0..3 {
            let (min, max) = (self.fence.min_m[axis], self.fence.max_m[axis]);
            if min >= max {
                let key = format!("fence.min_m[{axis}]");
                let allowed = format!("below `fence.max_m[{axis}]`, which is {max}");
                return Err(ParameterError::new(key, min, allowed));
            }
        }
        Ok(())
    }
}
