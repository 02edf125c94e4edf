//! Vehicles with known facts, and autopilots tuned for them.

use alula_control::autopilot::{AutopilotConfig, ClimbConfig, TiltConfig, YawRateConfig};
use alula_control::mixer::Layout;

use super::config::{MultirotorConfig, VehicleModel};

/// Names of the vehicles that [`preset`] knows.
pub const PRESET_NAMES: [&str; 3] = ["bebop2", "pelican", "quad_x500"];

/// The vehicle of this name, if there is one.
pub fn preset(name: &str) -> Option<VehicleModel> {
    match name {
        "bebop2" => Some(bebop2()),
        "pelican" => Some(pelican()),
        "quad_x500" => Some(quad_x500()),
        _ => None,
    }
}

/// Rotors of the RotorS and PX4 models follow a speed command with 12.5 ms upwards and 25 ms
/// downwards; near a working point thrust follows like speed, so the mean is taken.
const ROTORS_TIME_CONSTANT_S: f64 = 0.018_75;

/// Parrot Bebop 2 with the computer and depth camera of document L, chapter 3.
///
/// Rotors and bare inertia: RotorS, `rotors_description/urdf/bebop2.xacro` (0.503 kg;
/// 1.805e-3, 1.764e-3, 3.328e-3 kg m^2; 8.549e-6 N s^2 at up to 838 rad/s; moment constant
/// 0.016 m).
fn bebop2() -> VehicleModel {
    VehicleModel {
        airframe: MultirotorConfig {
            // Document L, equation 3-2: 0.5 kg of vehicle and 0.3 kg of payload.
            mass_kg: 0.8,
            // Bare vehicle plus the payload as a box of 0.10 x 0.09 x 0.05 m at the centre.
            inertia_kg_m2: [2.07e-3, 2.08e-3, 3.78e-3],
            // Document L, section 3-1-3: frame size 290 mm, from rotor to rotor.
            arm_length_m: 0.145,
            layout: Layout::X,
            thrust_to_torque_m: 0.016,
            rotor_time_constant_s: ROTORS_TIME_CONSTANT_S,
            // 8.54858e-6 N s^2 times (838 rad/s)^2.
            max_thrust_per_rotor_n: 6.003,
            // Document L, table A-3. Nothing is said of vertical drag.
            drag_per_s: [0.1840, 0.2007, 0.0],
            quadratic_drag_n_s2_m2: None,
            // Arm plus the rotor's radius of 0.1 m (RotorS).
            radius_m: 0.245,
            // Half of the body's height of 0.09 m (RotorS).
            landing_gear_height_m: 0.045,
            // Feet under the rotors' arms, 0.02 m further in.
            landing_gear_radius_m: 0.125,
        },
        autopilot: bebop2_autopilot(),
    }
}

/// Responses tuned so that first-order models fitted to roll, pitch and climb steps have the gains
/// and time constants of document L, table A-3: the time constants are those of the table less
/// what smoothing and rotor lag add.
fn bebop2_autopilot() -> AutopilotConfig {
    let tilt = TiltConfig {
        response_time_constant_s: 0.2297,
        response_smoothing_s: 0.01,
        ..TiltConfig::default()
    };
    AutopilotConfig {
        roll: TiltConfig {
            response_gain: 1.0181,
            ..tilt.clone()
        },
        pitch: TiltConfig {
            response_gain: 1.0167,
            ..tilt
        },
        yaw_rate: YawRateConfig {
            response_time_constant_s: 0.05,
            response_smoothing_s: 0.02,
            proportional_s: 12.0,
            ..YawRateConfig::default()
        },
        climb: ClimbConfig {
            response_gain: 1.2270,
            response_time_constant_s: 0.3253,
            response_smoothing_s: 0.01,
            ..ClimbConfig::default()
        },
        ..AutopilotConfig::default()
    }
}

/// AscTec Pelican as RotorS models it (`rotors_description/urdf/pelican.xacro`): body 1.0 kg with
/// 0.01, 0.01, 0.02 kg m^2, and four rotors of 0.01 kg at 0.21 m, 0.05 m above the centre.
fn pelican() -> VehicleModel {
    VehicleModel {
        airframe: MultirotorConfig {
            mass_kg: 1.04,
            // With the rotors as points: two at 0.21 m from each horizontal axis, four from z.
            inertia_kg_m2: [0.01098, 0.01098, 0.02176],
            arm_length_m: 0.21,
            layout: Layout::Plus,
            thrust_to_torque_m: 0.016,
            rotor_time_constant_s: ROTORS_TIME_CONSTANT_S,
            // 9.9865e-6 N s^2 times (838 rad/s)^2.
            max_thrust_per_rotor_n: 7.013,
            // Rotor drag 8.06428e-5 kg at the hover speed of 505 rad/s, four rotors, per mass;
            // rotors give none along their axis.
            drag_per_s: [0.157, 0.157, 0.0],
            quadratic_drag_n_s2_m2: None,
            // Arm plus the rotor's radius of 0.128 m.
            radius_m: 0.338,
            // Half of the body's height of 0.2 m.
            landing_gear_height_m: 0.1,
            // The model has no legs; feet between hub and rotors.
            landing_gear_radius_m: 0.15,
        },
        autopilot: AutopilotConfig::default(),
    }
}

/// Holybro X500 V2 as PX4 models it for Gazebo (`models/x500_base/model.sdf`,
/// `models/x500/model.sdf`): body 2.0 kg with 0.02167, 0.02167, 0.04 kg m^2, and four rotors of
/// 0.01608 kg at (0.174, 0.174, 0.06) m.
fn quad_x500() -> VehicleModel {
    VehicleModel {
        airframe: MultirotorConfig {
            mass_kg: 2.064,
            // With the rotors as points.
            inertia_kg_m2: [0.02384, 0.02384, 0.04389],
            // 0.174 m times the square root of two.
            arm_length_m: 0.2461,
            layout: Layout::X,
            thrust_to_torque_m: 0.016,
            rotor_time_constant_s: ROTORS_TIME_CONSTANT_S,
            // 8.54858e-6 N s^2 times (1000 rad/s)^2.
            max_thrust_per_rotor_n: 8.549,
            // Rotor drag 8.06428e-5 kg at the hover speed of 769 rad/s, four rotors, per mass;
            // rotors give none along their axis.
            drag_per_s: [0.120, 0.120, 0.0],
            quadratic_drag_n_s2_m2: None,
            // Arm plus half of the propeller's 13 inches.
            radius_m: 0.411,
            // The skids' collision boxes: centre at -0.2195 m, 0.015 m thick.
            landing_gear_height_m: 0.227,
            // Ends of the skids at (0.125, 0.132) m.
            landing_gear_radius_m: 0.182,
        },
        autopilot: AutopilotConfig::default(),
    }
}
