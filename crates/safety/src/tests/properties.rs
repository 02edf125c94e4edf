//! The guard only makes a command safer, whatever it is fed.

use alula_geometry::{Timestamp, so3};
use alula_messages::{
    AutopilotStatus, Command, EstimateHealth, FlightMode, FlowSample, ImuSample, NavState,
    RangeSample, SensorBatch,
};
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;

use super::bench::HOVER_N;
use crate::{BrakeConfig, Guard, GuardConfig, GuardInput, GuardVehicle};

/// Numbers of all kinds, from sensible to not numbers.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -2.0..2.0,
        2 => -100.0..100.0,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(-1e300),
    ]
}

fn vector() -> impl Strategy<Value = Vector3<f64>> {
    [number(), number(), number()].prop_map(Vector3::from)
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        Just(Command::Disarm),
        Just(Command::Idle),
        (number(), number(), number(), 0.0..40.0).prop_map(|(roll, pitch, yaw_rate, thrust)| {
            Command::AttitudeThrust {
                roll_rad: roll,
                pitch_rad: pitch,
                yaw_rate_rad_s: yaw_rate,
                thrust_n: thrust,
            }
        }),
        (number(), number(), number(), number()).prop_map(|(roll, pitch, yaw_rate, climb)| {
            Command::TiltClimb {
                roll_rad: roll,
                pitch_rad: pitch,
                yaw_rate_rad_s: yaw_rate,
                climb_rate_m_s: climb,
            }
        }),
        (number(), vector()).prop_map(|(thrust_n, torque_body_nm)| Command::ThrustTorque {
            thrust_n,
            torque_body_nm,
        }),
    ]
}

fn mode() -> impl Strategy<Value = FlightMode> {
    prop::sample::select(FlightMode::ALL.to_vec())
}

fn state() -> impl Strategy<Value = NavState> {
    let health = prop::sample::select(vec![
        EstimateHealth::Good,
        EstimateHealth::Failed,
        EstimateHealth::Degraded {
            since_velocity_s: f64::NAN,
            since_height_s: 1.0,
        },
    ]);
    (vector(), vector(), vector(), number(), health).prop_map(
        |(position, velocity, rotation, variance, health)| {
            let mut state = NavState {
                velocity_world: velocity,
                health,
                ..NavState::default()
            };
            state.world_from_body.translation.vector = position;
            state.world_from_body.rotation = so3::exp(&rotation);
            state.covariance[(4, 4)] = variance;
            state
        },
    )
}

/// A step of up to 0.2 s, sometimes backwards, with one sample of everything.
fn step() -> impl Strategy<Value = (SensorBatch, NavState, FlightMode, Command)> {
    let samples = (vector(), vector(), number(), number(), number());
    (-20_i64..200, samples, state(), mode(), command()).prop_map(
        |(milliseconds, (force, rate, range_m, quality, thrust), mut state, mode, requested)| {
            let time = Timestamp::from_ns(milliseconds * 1_000_000);
            let mut batch = SensorBatch {
                now: time,
                ..SensorBatch::default()
            };
            batch.imu.push(ImuSample {
                time,
                specific_force: force * 5.0,
                angular_rate: rate,
            });
            batch.flow.push(FlowSample {
                time,
                interval_s: 0.01,
                flow_rad_s: Vector2::new(range_m, quality),
                quality,
            });
            batch.infrared.push(RangeSample {
                time,
                range_m,
                min_m: 0.05,
                max_m: 30.0,
            });
            batch.autopilot.push(AutopilotStatus {
                time,
                armed: true,
                thrust_fraction: thrust,
            });
            state.time = time;
            (batch, state, mode, requested)
        },
    )
}

fn guard() -> Guard {
    let vehicle = GuardVehicle {
        mass_kg: 1.2,
        max_thrust_n: 2.5 * HOVER_N,
    };
    Guard::new(&GuardConfig::default(), &vehicle).unwrap()
}

/// The request itself, motors off, or a descent that tilts no more than a brake does, with less than
/// twice the hovering thrust.
fn is_safe(command: &Command, requested: &Command) -> bool {
    let turns_motors = |c: &Command| !matches!(c, Command::Disarm | Command::Idle);
    if turns_motors(command) && !turns_motors(requested) {
        return false;
    }
    match *command {
        Command::Disarm => true,
        Command::Idle => *requested != Command::Disarm,
        _ if command == requested => command.is_finite(),
        Command::AttitudeThrust {
            roll_rad,
            pitch_rad,
            yaw_rate_rad_s,
            thrust_n,
        } => {
            brakes_at_most(roll_rad, pitch_rad)
                && yaw_rate_rad_s == 0.0
                && (0.0..2.0 * HOVER_N).contains(&thrust_n)
        }
        Command::TiltClimb {
            roll_rad,
            pitch_rad,
            yaw_rate_rad_s,
            climb_rate_m_s,
        } => brakes_at_most(roll_rad, pitch_rad) && yaw_rate_rad_s == 0.0 && climb_rate_m_s < 0.0,
        Command::ThrustTorque { .. } => false,
    }
}

fn brakes_at_most(roll_rad: f64, pitch_rad: f64) -> bool {
    let up = so3::from_roll_pitch_yaw(roll_rad, pitch_rad, 0.0) * Vector3::z();
    let limit_deg = BrakeConfig::default().tilt_deg;
    up.angle(&Vector3::z()).to_degrees() <= limit_deg + 1e-9
}

/// Tilt, rates and thrust of a command that passes lie within the limits.
fn is_within_limits(command: &Command) -> bool {
    let tilt_rad = 50.0_f64.to_radians();
    match *command {
        Command::Disarm | Command::Idle => true,
        Command::AttitudeThrust {
            roll_rad,
            pitch_rad,
            yaw_rate_rad_s,
            thrust_n,
        } => {
            roll_rad.abs() <= tilt_rad
                && pitch_rad.abs() <= tilt_rad
                && yaw_rate_rad_s.abs() <= 4.0
                && (0.0..=2.5 * HOVER_N * 1.000_001).contains(&thrust_n)
        }
        Command::TiltClimb {
            roll_rad,
            pitch_rad,
            climb_rate_m_s,
            ..
        } => {
            roll_rad.abs() <= tilt_rad && pitch_rad.abs() <= tilt_rad && climb_rate_m_s.abs() <= 4.0
        }
        Command::ThrustTorque {
            thrust_n,
            torque_body_nm,
        } => (0.0..=2.5 * HOVER_N * 1.000_001).contains(&thrust_n) && torque_body_nm.amax() <= 10.0,
    }
}

proptest! {
    #[test]
    fn the_guard_only_makes_a_command_safer(steps in prop::collection::vec(step(), 1..60)) {
        let mut guard = guard();
        let mut offset_ns = 0;
        for (mut batch, mut state, mode, requested) in steps {
            // Each step begins where the one before ended.
            let delta = batch.now.as_ns();
            offset_ns += delta;
            let now = Timestamp::from_ns(offset_ns);
            batch.now = now;
            state.time = now;
            batch.imu.iter_mut().for_each(|s| s.time = now);
            batch.flow.iter_mut().for_each(|s| s.time = now);
            batch.infrared.iter_mut().for_each(|s| s.time = now);
            batch.autopilot.iter_mut().for_each(|s| s.time = now);
            let input = GuardInput { batch: &batch, state: &state, mode, requested: &requested };
            guard.update(&input);
            let command = guard.command();
            prop_assert!(is_safe(&command, &requested), "{requested:?} -> {command:?}");
            prop_assert!(is_within_limits(&command), "{command:?}");
            let on_ground = matches!(mode, FlightMode::Disarmed | FlightMode::Killed);
            prop_assert!(!on_ground || command == Command::Disarm);
        }
    }
}
