use super::*;
use crate::mixer::Layout;

const MASS_KG: f64 = 1.5;
const MAX_N: f64 = 8.0;

fn facts() -> AirframeFacts {
    AirframeFacts {
        mass_kg: MASS_KG,
        inertia_kg_m2: [0.02, 0.02, 0.04],
        arm_length_m: 0.25,
        layout: Layout::X,
        thrust_to_torque_m: 0.016,
        max_thrust_per_rotor_n: MAX_N,
    }
}

fn autopilot() -> Autopilot {
    Autopilot::new(&AutopilotConfig::default(), &facts()).unwrap()
}

fn first(command: Command) -> [f64; 4] {
    autopilot().update(&command, &AutopilotState::default(), 1e-3)
}

fn climb(climb_rate_m_s: f64) -> Command {
    Command::TiltClimb {
        roll_rad: 0.0,
        pitch_rad: 0.0,
        yaw_rate_rad_s: 0.0,
        climb_rate_m_s,
    }
}

#[test]
fn disarmed_rotors_stand_still() {
    assert_eq!(first(Command::Disarm), [0.0; 4]);
}

#[test]
fn idle_thrust_is_small_and_equal() {
    assert_eq!(first(Command::Idle), [0.03 * MAX_N; 4]);
}

#[test]
fn level_hover_shares_the_weight() {
    for f in first(climb(0.0)) {
        assert!((f - MASS_KG * GRAVITY_M_S2 / 4.0).abs() < 1e-12);
    }
}

#[test]
fn thrust_and_torque_pass_to_the_mixer_alone() {
    let torque_body_nm = Vector3::new(0.3, -0.2, 0.01);
    let mixed = Mixer::new(&facts()).unwrap().mix(12.0, &torque_body_nm);
    let command = Command::ThrustTorque {
        thrust_n: 12.0,
        torque_body_nm,
    };
    assert_eq!(first(command), mixed.rotor_thrusts_n);
}

#[test]
fn positive_pitch_loads_the_rear_rotors() {
    let f = first(Command::AttitudeThrust {
        roll_rad: 0.0,
        pitch_rad: 0.1,
        yaw_rate_rad_s: 0.0,
        thrust_n: 15.0,
    });
    assert!(f[1] > f[0] && f[2] > f[3]);
}

#[test]
fn a_command_that_is_not_finite_becomes_a_level_descent() {
    let broken = Command::AttitudeThrust {
        roll_rad: f64::NAN,
        pitch_rad: 0.0,
        yaw_rate_rad_s: 0.0,
        thrust_n: f64::INFINITY,
    };
    assert_eq!(first(broken), first(climb(-0.5)));
}

#[test]
fn a_state_that_is_not_finite_gives_finite_thrusts() {
    let sensed = AutopilotState {
        roll_rad: f64::NAN,
        ..AutopilotState::default()
    };
    for f in autopilot().update(&climb(0.0), &sensed, f64::NAN) {
        assert!((0.0..=MAX_N).contains(&f));
    }
}

#[test]
fn excessive_tilt_is_shortened_in_its_direction() {
    let tilt = autopilot().limited(3.0, 4.0, 0.0);
    let limit = 40_f64.to_radians();
    assert!((tilt.roll_rad - 0.6 * limit).abs() < 1e-15);
    assert!((tilt.pitch_rad - 0.8 * limit).abs() < 1e-15);
}

#[test]
fn rotors_stop_pushing_when_upside_down() {
    let mut autopilot = autopilot();
    let sensed = AutopilotState {
        roll_rad: std::f64::consts::PI,
        ..AutopilotState::default()
    };
    assert_eq!(autopilot.climb_thrust(1.0, &sensed, 1e-3), 0.0);
}

#[test]
fn euler_rates_are_the_rates_of_the_angles() {
    // Differences of the angles of a body that turns at a constant rate for a short time.
    let (roll, pitch) = (0.4, -0.3);
    let rate_body = Vector3::new(0.5, -0.7, 0.9);
    let start = alula_geometry::so3::from_roll_pitch_yaw(roll, pitch, 1.0);
    let h = 1e-6;
    let angles = |t: f64| {
        let turned = start * alula_geometry::so3::exp(&(rate_body * t));
        let (r, p, y) = alula_geometry::so3::to_roll_pitch_yaw(&turned);
        Vector3::new(r, p, y)
    };
    let differences = (angles(h) - angles(-h)) / (2.0 * h);
    assert!((euler_rates(roll, pitch, &rate_body) - differences).norm() < 1e-9);
}

#[test]
fn body_rates_undo_euler_rates() {
    let rate_body = Vector3::new(0.5, -0.7, 0.9);
    let rates = euler_rates(0.4, -0.3, &rate_body);
    assert!((body_rates(0.4, -0.3, &rates) - rate_body).norm() < 1e-15);
}

#[test]
fn a_loop_that_was_released_starts_again_from_the_measurement() {
    let mut autopilot = autopilot();
    let rolled = AutopilotState {
        roll_rad: 0.2,
        ..AutopilotState::default()
    };
    let keep = Command::AttitudeThrust {
        roll_rad: 0.2,
        pitch_rad: 0.0,
        yaw_rate_rad_s: 0.0,
        thrust_n: 15.0,
    };
    autopilot.update(&climb(0.0), &AutopilotState::default(), 1e-3);
    autopilot.update(&Command::Idle, &rolled, 1e-3);
    // Measurement, command and reference agree: nothing is left to correct.
    for f in autopilot.update(&keep, &rolled, 1e-3) {
        assert!((f - 15.0 / 4.0).abs() < 1e-12);
    }
}
