use super::*;
use crate::multirotor::preset;
use crate::world::WorldConfig;

/// A world from the text of its table in a scenario.
fn world(toml_text: &str) -> Arc<World> {
    let config: WorldConfig = toml::from_str(toml_text).unwrap();
    Arc::new(World::new(&config, 1, &|_| Err("no files".into())).unwrap())
}

fn setup() -> VehicleSetup {
    VehicleSetup::new(preset("bebop2").unwrap())
}

/// A vehicle without depth camera, which most tests do not need.
fn blind(setup: VehicleSetup) -> VehicleSetup {
    VehicleSetup {
        sensors: SensorSuiteConfig {
            depth: None,
            ..setup.sensors
        },
        ..setup
    }
}

fn vehicle(world: &Arc<World>, setup: &VehicleSetup, seed: u64) -> SimulatedVehicle {
    SimulatedVehicle::new(world.clone(), setup, seed).unwrap()
}

/// Flies for `duration_s`, with the command that `pilot` finds from the truth, and returns all
/// that was sensed.
fn fly(
    vehicle: &mut SimulatedVehicle,
    duration_s: f64,
    pilot: impl Fn(&Truth) -> Command,
) -> Vec<SensorBatch> {
    let end = vehicle.truth().time + TimeDelta::from_s(duration_s);
    let mut batches = Vec::new();
    while vehicle.truth().time < end {
        let mut batch = SensorBatch::default();
        assert!(vehicle.sense(&mut batch).unwrap());
        let command = pilot(vehicle.truth());
        vehicle.command(&command).unwrap();
        batches.push(batch);
    }
    batches
}

/// Towards a point: tilt from position and velocity, climb rate from height.
fn towards(goal_world: Vector3<f64>) -> impl Fn(&Truth) -> Command {
    move |truth| {
        let error = goal_world - truth.position_world();
        let wanted = error * 0.8 - truth.velocity_world * 1.2;
        Command::TiltClimb {
            roll_rad: (-wanted.y / 9.8).clamp(-0.3, 0.3),
            pitch_rad: (wanted.x / 9.8).clamp(-0.3, 0.3),
            yaw_rate_rad_s: 0.0,
            climb_rate_m_s: error.z.clamp(-1.0, 1.0),
        }
    }
}

fn tilt(pitch_rad: f64, climb_rate_m_s: f64) -> Command {
    Command::TiltClimb {
        roll_rad: 0.0,
        pitch_rad,
        yaw_rate_rad_s: 0.0,
        climb_rate_m_s,
    }
}

#[test]
fn it_stands_still_on_the_ground_with_motors_off_and_idle() {
    for command in [Command::Disarm, Command::Idle] {
        let mut vehicle = vehicle(&world(""), &blind(setup()), 1);
        let start = *vehicle.truth();
        let batches = fly(&mut vehicle, 3.0, |_| command);
        let shift = vehicle.truth().position_world() - start.position_world();
        assert!(shift.norm() < 1e-3, "{shift}");
        assert!(vehicle.truth().on_ground && vehicle.collision().is_none());
        let reported = batches
            .iter()
            .rev()
            .find_map(|b| b.autopilot.last())
            .unwrap();
        assert_eq!(reported.armed, command == Command::Idle);
    }
}

#[test]
fn it_climbs_to_a_height_and_holds_it() {
    let mut vehicle = vehicle(&world(""), &blind(setup()), 1);
    let goal_world = Vector3::new(0.0, 0.0, 2.0);
    let batches = fly(&mut vehicle, 15.0, towards(goal_world));
    // The autopilot's own errors: 0.02 m/s of climb rate and 0.3 degrees of tilt over the gains of
    // the pilot, 4 sigmas.
    let error = vehicle.truth().position_world() - goal_world;
    assert!(error.z.abs() < 4.0 * 0.02, "{error}");
    assert!(
        error.xy().norm() < 4.0 * 9.8 * 0.3_f64.to_radians() / 0.8,
        "{error}"
    );
    let infrared = batches
        .iter()
        .rev()
        .find_map(|b| b.infrared.last())
        .unwrap();
    assert!((infrared.range_m - 2.0).abs() < 0.3);
    assert!(vehicle.collision().is_none());
}

#[test]
fn a_control_period_takes_its_time_and_brings_its_samples() {
    let mut vehicle = vehicle(&world(""), &blind(setup()), 1);
    for (index, batch) in fly(&mut vehicle, 0.2, |_| Command::Idle).iter().enumerate() {
        assert_eq!(
            batch.now,
            Timestamp::from_ns(4_000_000 * (index as i64 + 1))
        );
        assert_eq!(batch.imu.len(), 1);
        assert_eq!(batch.imu[0].time, batch.now);
    }
    assert_eq!(vehicle.control_period(), TimeDelta::from_ns(4_000_000));
}

#[test]
fn a_period_of_a_broken_millisecond_is_refused() {
    let mut setup = setup();
    setup.link.control_rate_hz = 300.0;
    let error = SimulatedVehicle::new(world(""), &setup, 1).err().unwrap();
    assert_eq!(error.key, "link.control_rate_hz");
}

#[test]
fn wrong_parameters_are_refused_with_their_whole_key() {
    let mut setup = setup();
    setup.sensors.imu.rate_hz = 1.0;
    let error = SimulatedVehicle::new(world(""), &setup, 1).err().unwrap();
    assert_eq!(error.key, "sensors.imu.rate_hz");
}

#[test]
fn commands_take_effect_after_their_latency() {
    let rotors_start = |latency_s: f64| {
        let mut setup = blind(setup());
        setup.link.command_latency_s = latency_s;
        let mut vehicle = vehicle(&world(""), &setup, 1);
        vehicle.command(&Command::Idle).unwrap();
        let mut batch = SensorBatch::default();
        while vehicle.motors().thrust_fraction == 0.0 {
            vehicle.sense(&mut batch).unwrap();
        }
        vehicle.truth().time
    };
    assert_eq!(rotors_start(0.0), Timestamp::from_s(0.004));
    assert_eq!(rotors_start(0.1), Timestamp::from_s(0.104));
}

#[test]
fn the_same_seed_repeats_a_flight_to_the_bit() {
    let world =
        world("obstacles = [{ kind = \"cylinder\", centre_m = [4.0, 1.0], radius_m = 0.3 }]");
    let mut setup = setup();
    setup.wind.gust_sigma_m_s = [0.5; 3];
    let run = |seed| {
        let mut vehicle = vehicle(&world, &setup, seed);
        let batches = fly(&mut vehicle, 2.0, towards(Vector3::new(1.0, 0.0, 1.5)));
        (*vehicle.truth(), batches)
    };
    let (first, again, other) = (run(3), run(3), run(4));
    assert!(first == again);
    assert_ne!(first.0.world_from_body, other.0.world_from_body);
    let images: usize = first.1.iter().map(|batch| batch.depth.len()).sum();
    // 30 Hz for 2 s, the last one on its way.
    assert_eq!(images, 59);
}

#[test]
fn clearance_is_measured_from_the_surface_of_the_vehicle() {
    let world =
        world("obstacles = [{ kind = \"cylinder\", centre_m = [3.0, 4.0], radius_m = 0.5 }]");
    let clearance = vehicle(&world, &setup(), 1).clearance().unwrap();
    assert!((clearance.distance_m - (5.0 - 0.5 - 0.245)).abs() < 1e-9);
}

#[test]
fn touching_an_obstacle_is_a_collision_that_stays() {
    let world =
        world("obstacles = [{ kind = \"cylinder\", centre_m = [4.0, 0.0], radius_m = 0.3 }]");
    let mut vehicle = vehicle(&world, &blind(setup()), 1);
    fly(&mut vehicle, 12.0, towards(Vector3::new(8.0, 0.0, 1.5)));
    let Some(Collision::Contact { time, what, .. }) = vehicle.collision() else {
        panic!("{:?}", vehicle.collision());
    };
    assert_eq!(what, "cylinder 1");
    assert!(*time < vehicle.truth().time);
}

#[test]
fn falling_from_a_height_is_a_hard_landing_and_settling_is_not() {
    for (height_m, expected) in [(0.02, false), (1.0, true)] {
        let mut setup = blind(setup());
        setup.start.position_m[2] = height_m;
        let mut vehicle = vehicle(&world(""), &setup, 1);
        fly(&mut vehicle, 1.0, |_| Command::Disarm);
        let hard = matches!(vehicle.collision(), Some(Collision::HardLanding { speed_m_s, .. })
            // v^2 = 2 g h.
            if (speed_m_s - (2.0 * 9.80665 * height_m).sqrt()).abs() < 0.1);
        assert_eq!(hard, expected, "{:?}", vehicle.collision());
    }
}

#[test]
fn rolling_over_at_the_ground_is_a_rotor_strike() {
    let mut setup = blind(setup());
    setup.start.position_m[2] = 0.3;
    let mut vehicle = vehicle(&world(""), &setup, 1);
    let roll_over = Command::ThrustTorque {
        thrust_n: 6.0,
        torque_body_nm: Vector3::new(0.3, 0.0, 0.0),
    };
    fly(&mut vehicle, 1.0, |_| roll_over);
    let collision = vehicle.collision();
    assert!(
        matches!(collision, Some(Collision::RotorStrike { .. })),
        "{collision:?}"
    );
}

#[test]
fn a_pitched_vehicle_flies_forward() {
    let mut setup = blind(setup());
    setup.start.yaw_deg = 90.0;
    let mut vehicle = vehicle(&world(""), &setup, 1);
    fly(&mut vehicle, 2.0, |_| tilt(0.0, 1.0));
    fly(&mut vehicle, 2.0, |_| tilt(0.1, 0.0));
    let velocity_world = vehicle.truth().velocity_world;
    assert!(
        velocity_world.y > 1.0 && velocity_world.x.abs() < 0.3,
        "{velocity_world}"
    );
}

#[test]
fn people_step_over_a_vehicle_that_stands_on_the_ground() {
    let world =
        world("[[people]]\nwaypoints_m = [[-1.0, 0.0], [3.0, 0.0]]\nsemi_axes_m = [0.4, 0.4, 0.9]");
    let mut vehicle = vehicle(&world, &blind(setup()), 1);
    let mut nearest_m = f64::INFINITY;
    for _ in 0..250 {
        fly(&mut vehicle, 0.004, |_| Command::Disarm);
        nearest_m = nearest_m.min(vehicle.clearance().unwrap().distance_m);
    }
    assert!(nearest_m < 0.0, "{nearest_m}");
    assert_eq!(vehicle.collision(), None);
}

#[test]
fn a_person_who_walks_into_a_flying_vehicle_is_a_collision() {
    let world = world("[[people]]\nwaypoints_m = [[8.0, 0.0], [-8.0, 0.0]]");
    let mut vehicle = vehicle(&world, &blind(setup()), 1);
    fly(&mut vehicle, 8.0, towards(Vector3::new(0.0, 0.0, 1.2)));
    assert!(matches!(
        vehicle.collision(),
        Some(Collision::Contact { thing: ThingId::Person(0), what, .. }) if what == "person 1"
    ));
}
