use alula_geometry::{GRAVITY_M_S2, so3};
use nalgebra::{Translation3, UnitQuaternion};

use super::*;

const NO_GROUND_M: f64 = -1e9;

fn config(name: &str) -> MultirotorConfig {
    preset(name).unwrap().airframe
}

/// Without drag, so that only forces under test act.
fn in_vacuum(name: &str) -> MultirotorConfig {
    MultirotorConfig {
        drag_per_s: [0.0; 3],
        ..config(name)
    }
}

fn pose(height_m: f64, rotation: UnitQuaternion<f64>) -> Pose {
    Pose::from_parts(Translation3::new(0.0, 0.0, height_m), rotation)
}

fn at(config: MultirotorConfig, height_m: f64) -> Multirotor {
    Multirotor::new(config, pose(height_m, UnitQuaternion::identity())).unwrap()
}

fn inputs(commands: [f64; 4], external: Wrench) -> Inputs {
    Inputs {
        rotor_commands_n: Vector4::from(commands),
        air_velocity_world: Vector3::zeros(),
        external,
        ground_height_m: NO_GROUND_M,
    }
}

/// Flies for a time with constant commands over ground at height zero.
fn fly(vehicle: &mut Multirotor, commands: [f64; 4], duration_s: f64) {
    for _ in 0..(duration_s / STEP_S).round() as usize {
        vehicle.step(&commands, &Vector3::zeros(), &Wrench::default(), 0.0);
    }
}

#[test]
fn free_fall_is_uniformly_accelerated() {
    let mut vehicle = at(in_vacuum("pelican"), 100.0);
    fly(&mut vehicle, [0.0; 4], 2.0);
    let state = vehicle.state();
    assert!((state.velocity_world.z + 2.0 * GRAVITY_M_S2).abs() < 1e-10);
    assert!((state.world_from_body.translation.z - (100.0 - 2.0 * GRAVITY_M_S2)).abs() < 1e-10);
    assert_eq!(
        vehicle.truth(Timestamp::ZERO).specific_force_body().norm(),
        0.0
    );
}

#[test]
fn energy_and_angular_momentum_stay_without_forces() {
    let config = MultirotorConfig {
        inertia_kg_m2: [0.01, 0.015, 0.02],
        ..in_vacuum("pelican")
    };
    let inertia = Vector3::from(config.inertia_kg_m2);
    let weight = Wrench {
        force_world: Vector3::z() * config.mass_kg * GRAVITY_M_S2,
        torque_body: Vector3::zeros(),
    };
    let mut vehicle = at(config, 0.0);
    vehicle.set_state(MultirotorState {
        velocity_world: Vector3::new(1.0, 2.0, 3.0),
        angular_rate_body: Vector3::new(2.0, 3.0, -1.0),
        ..*vehicle.state()
    });
    let momentum = |v: &Multirotor| {
        let s = v.state();
        s.world_from_body.rotation * inertia.component_mul(&s.angular_rate_body)
    };
    let energy = |v: &Multirotor| {
        let s = v.state();
        s.angular_rate_body
            .dot(&inertia.component_mul(&s.angular_rate_body))
            + v.config().mass_kg * s.velocity_world.norm_squared()
    };
    let (momentum_before, energy_before) = (momentum(&vehicle), energy(&vehicle));
    for _ in 0..10_000 {
        vehicle.advance(&inputs([0.0; 4], weight), STEP_S);
    }
    // Over 10^4 steps with |omega| h = 4e-3: the step's error is about (4e-3)^5 / 120 each.
    assert!((momentum(&vehicle) - momentum_before).norm() < 1e-9 * momentum_before.norm());
    assert!((energy(&vehicle) - energy_before).abs() < 1e-9 * energy_before);
}

/// Final position and attitude of a smooth flight of 0.8 s in steps of `step_s`.
fn smooth_flight(step_s: f64) -> (Vector3<f64>, UnitQuaternion<f64>) {
    let mut vehicle = at(config("quad_x500"), 0.0);
    vehicle.set_state(MultirotorState {
        velocity_world: Vector3::new(3.0, -2.0, 1.0),
        angular_rate_body: Vector3::new(1.0, 2.0, -1.0),
        rotor_thrusts_n: [4.0, 5.0, 4.5, 5.5],
        ..*vehicle.state()
    });
    let inputs = inputs([5.2, 5.0, 5.1, 4.9], Wrench::default());
    for _ in 0..(0.8 / step_s).round() as usize {
        vehicle.advance(&inputs, step_s);
    }
    let pose = vehicle.state().world_from_body;
    (pose.translation.vector, pose.rotation)
}

#[test]
fn halving_the_step_divides_the_error_by_sixteen() {
    let exact = smooth_flight(0.000_5);
    let error = |step_s: f64| {
        let end = smooth_flight(step_s);
        (
            (end.0 - exact.0).norm(),
            so3::log(&(exact.1.inverse() * end.1)).norm(),
        )
    };
    let (coarse, fine) = (error(0.008), error(0.004));
    // Fourth order: 2^4 but for terms of the next order, a factor 1 + O(h / time constant).
    for ratio in [coarse.0 / fine.0, coarse.1 / fine.1] {
        assert!((12.0..24.0).contains(&ratio), "{ratio}");
    }
}

#[test]
fn hover_thrust_balances_the_weight() {
    for name in PRESET_NAMES {
        let mut vehicle = at(config(name), 10.0);
        let hover = vehicle.config().hover_thrust_per_rotor_n();
        vehicle.set_state(MultirotorState {
            rotor_thrusts_n: [hover; 4],
            ..*vehicle.state()
        });
        fly(&mut vehicle, [hover; 4], 1.0);
        assert!(vehicle.state().velocity_world.norm() < 1e-12);
    }
}

#[test]
fn thrust_follows_a_command_with_the_rotors_time_constant() {
    let mut vehicle = at(config("pelican"), 10.0);
    let tau = vehicle.config().rotor_time_constant_s;
    fly(&mut vehicle, [2.0; 4], 0.05);
    let expected = 2.0 * (1.0 - (-0.05 / tau).exp());
    // The step's error is (h / tau)^5 / 120 = 4e-9 each.
    assert!((vehicle.state().rotor_thrusts_n[0] - expected).abs() < 1e-6);
}

#[test]
fn commands_beyond_the_rotors_are_cut() {
    let mut vehicle = at(config("pelican"), 10.0);
    let max = vehicle.config().max_thrust_per_rotor_n;
    fly(&mut vehicle, [1e9, -1.0, f64::NAN, f64::INFINITY], 0.5);
    let f = vehicle.state().rotor_thrusts_n;
    // After 27 time constants nothing but rounding is left.
    assert!((f[0] - max).abs() < 1e-9 && (f[3] - max).abs() < 1e-9);
    assert_eq!((f[1], f[2]), (0.0, 0.0));
}

#[test]
fn quadratic_drag_gives_the_terminal_speed() {
    let config = MultirotorConfig {
        quadratic_drag_n_s2_m2: Some(0.05),
        ..in_vacuum("pelican")
    };
    let terminal = (config.mass_kg * GRAVITY_M_S2 / 0.05).sqrt();
    let mut vehicle = at(config, 1000.0);
    fly(&mut vehicle, [0.0; 4], 20.0);
    // The approach is tanh(g t / v): 1 - 2 exp(-2 g t / v) with g t / v = 13.7.
    assert!((vehicle.state().velocity_world.z + terminal).abs() < 1e-9);
}

#[test]
fn linear_drag_carries_the_vehicle_along_with_the_wind() {
    // Along heading and its left the speed approaches the wind as 1 - exp(-A t), at any yaw.
    let config = config("bebop2");
    let [forward, left, _] = config.drag_per_s;
    let weight = Wrench {
        force_world: Vector3::z() * config.mass_kg * GRAVITY_M_S2,
        torque_body: Vector3::zeros(),
    };
    let yaw = so3::from_roll_pitch_yaw(0.0, 0.0, 0.7);
    let mut vehicle = Multirotor::new(config, pose(0.0, yaw)).unwrap();
    let wind = yaw * Vector3::new(2.0, 3.0, 0.0);
    let mut inputs = inputs([0.0; 4], weight);
    inputs.air_velocity_world = wind;
    for _ in 0..5000 {
        vehicle.advance(&inputs, STEP_S);
    }
    let speed = yaw.inverse() * vehicle.state().velocity_world;
    assert!((speed.x - 2.0 * (1.0 - (-5.0 * forward).exp())).abs() < 1e-9);
    assert!((speed.y - 3.0 * (1.0 - (-5.0 * left).exp())).abs() < 1e-9);
}

#[test]
fn accelerations_are_the_derivatives_of_the_velocities() {
    let mut vehicle = at(config("bebop2"), 10.0);
    let commands = [2.0, 2.2, 1.9, 2.1];
    fly(&mut vehicle, commands, 0.2);
    let before = *vehicle.state();
    fly(&mut vehicle, commands, STEP_S);
    let linear = vehicle.acceleration_world();
    let angular = vehicle.angular_acceleration_body();
    fly(&mut vehicle, commands, STEP_S);
    let after = *vehicle.state();
    let h = 2.0 * STEP_S;
    // Central differences: remainder v''' h^2 / 6 with time constants above 18 ms.
    let difference = (after.velocity_world - before.velocity_world) / h;
    assert!((difference - linear).norm() < 1e-3 * linear.norm());
    let difference = (after.angular_rate_body - before.angular_rate_body) / h;
    assert!((difference - angular).norm() < 1e-3 * angular.norm());
}

#[test]
fn it_rests_on_the_ground_for_a_minute_without_creeping() {
    for name in PRESET_NAMES {
        let config = config(name);
        let height = config.standing_height_m();
        let idle = 0.03 * config.max_thrust_per_rotor_n;
        let mut vehicle = at(config, height);
        let wind = Vector3::new(4.0, -3.0, 0.0);
        let settle = |vehicle: &mut Multirotor, steps: usize| {
            for _ in 0..steps {
                vehicle.step(&[idle; 4], &wind, &Wrench::default(), 0.0);
            }
            vehicle.state().world_from_body
        };
        let first = settle(&mut vehicle, 1000);
        let last = settle(&mut vehicle, 60_000);
        // What is left after the first second has died away as exp(-70 t).
        assert!((last.translation.vector - first.translation.vector).norm() < 1e-9);
        assert!(last.rotation.angle_to(&first.rotation) < 1e-6);
        assert!(vehicle.on_ground());
        assert!(so3::tilt_rad(&last.rotation) < 0.02);
    }
}

#[test]
fn a_vehicle_put_down_at_its_standing_height_does_not_move() {
    let config = config("bebop2");
    let height = config.standing_height_m();
    let mut vehicle = at(config, height);
    fly(&mut vehicle, [0.0; 4], 1.0);
    assert!((vehicle.state().world_from_body.translation.z - height).abs() < 1e-12);
    assert!(vehicle.acceleration_world().norm() < 1e-9);
}

#[test]
fn landing_at_half_a_metre_per_second_stays_upright() {
    for name in PRESET_NAMES {
        let config = config(name);
        let start = config.landing_gear_height_m + 0.01;
        let mut vehicle = Multirotor::new(
            config,
            pose(start, so3::from_roll_pitch_yaw(0.05, -0.03, 1.0)),
        )
        .unwrap();
        vehicle.set_state(MultirotorState {
            velocity_world: Vector3::new(0.2, 0.1, -0.5),
            ..*vehicle.state()
        });
        let mut highest: f64 = 0.0;
        for _ in 0..2000 {
            fly(&mut vehicle, [0.0; 4], STEP_S);
            highest = highest.max(vehicle.state().world_from_body.translation.z);
        }
        let state = vehicle.state();
        assert!(vehicle.on_ground());
        assert!(
            so3::tilt_rad(&state.world_from_body.rotation) < 1e-3,
            "{name}"
        );
        assert!(state.velocity_world.norm() < 1e-6);
        // It never rises above where it came from by more than the drop's own energy allows.
        assert!(highest < start + 0.5 * 0.5 / (2.0 * GRAVITY_M_S2));
    }
}

#[test]
fn full_thrust_lifts_off() {
    let config = config("quad_x500");
    let height = config.standing_height_m();
    let mut vehicle = at(config, height);
    let max = vehicle.config().max_thrust_per_rotor_n;
    fly(&mut vehicle, [max; 4], 1.0);
    assert!(!vehicle.on_ground() && vehicle.state().world_from_body.translation.z > 2.0);
}

#[test]
fn upside_down_it_comes_to_lie_on_its_arms() {
    let mut vehicle = Multirotor::new(
        config("pelican"),
        pose(
            0.3,
            so3::from_roll_pitch_yaw(std::f64::consts::PI, 0.05, 0.0),
        ),
    )
    .unwrap();
    fly(&mut vehicle, [0.0; 4], 3.0);
    let state = vehicle.state();
    assert!(state.velocity_world.norm() < 1e-6 && state.world_from_body.translation.z > -0.01);
}

#[test]
fn an_external_wrench_accelerates_mass_and_inertia() {
    let config = in_vacuum("pelican");
    let (mass, inertia) = (config.mass_kg, config.inertia_kg_m2);
    let mut vehicle = at(config, 0.0);
    let wrench = Wrench {
        force_world: Vector3::new(1.0, 2.0, mass * GRAVITY_M_S2),
        torque_body: Vector3::new(0.0, 0.0, 0.01),
    };
    vehicle.advance(&inputs([0.0; 4], wrench), STEP_S);
    let expected = Vector3::new(1.0, 2.0, 0.0) / mass;
    assert!((vehicle.acceleration_world() - expected).norm() < 1e-12);
    assert!((vehicle.angular_acceleration_body().z - 0.01 / inertia[2]).abs() < 1e-12);
}

#[test]
fn a_vehicle_survives_its_file() {
    for name in PRESET_NAMES {
        let model = preset(name).unwrap();
        let text = toml::to_string(&model).unwrap();
        assert_eq!(toml::from_str::<VehicleModel>(&text).unwrap(), model);
    }
}

#[test]
fn impossible_bodies_are_refused() {
    let refuse =
        |config: MultirotorConfig| Multirotor::new(config, Pose::identity()).unwrap_err().key;
    let flat = MultirotorConfig {
        inertia_kg_m2: [0.01, 0.01, 0.03],
        ..config("pelican")
    };
    assert_eq!(refuse(flat), "inertia_kg_m2");
    let heavy = MultirotorConfig {
        mass_kg: 10.0,
        ..config("pelican")
    };
    assert_eq!(refuse(heavy), "max_thrust_per_rotor_n");
}

#[test]
fn presets_are_valid_and_named() {
    for name in PRESET_NAMES {
        assert_eq!(config(name).check(), Ok(()));
    }
    assert!(preset("albatross").is_none());
}
