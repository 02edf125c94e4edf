//! Time that a simulated second takes: the budget without depth camera is 20 ms (50 times real
//! time), with 30 depth images a second among 100 obstacles 200 ms (5 times real time).

// A benchmark of a vehicle that cannot be built should stop, and it prints its budgets.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::sync::Arc;

use alula_geometry::Pose;
use alula_messages::{Command, SensorBatch, Vehicle};
use alula_sim::multirotor::{Multirotor, Wrench, preset};
use alula_sim::sensors::SensorSuiteConfig;
use alula_sim::world::World;
use alula_sim::{SimulatedVehicle, VehicleSetup};
use divan::Bencher;
use nalgebra::Vector3;

#[path = "../src/world/samples.rs"]
mod samples;

fn main() {
    println!("budgets of a simulated second: 20 ms without depth camera, 200 ms with it;");
    println!("see docs/budgets.md");
    divan::main();
}

/// Body, rotors and drag in the air for 1 ms.
#[divan::bench(sample_count = 2000, sample_size = 50)]
fn plant_step(bencher: Bencher) {
    let airframe = preset("quad_x500").unwrap().airframe;
    let hover_n = airframe.mass_kg * 9.80665 / 4.0;
    let above_ground = Pose::translation(0.0, 0.0, 100.0);
    let mut multirotor = Multirotor::new(airframe, above_ground).unwrap();
    let air_velocity_world = Vector3::new(1.0, 0.5, 0.0);
    bencher.bench_local(|| {
        multirotor.step(&[hover_n; 4], &air_velocity_world, &Wrench::default(), 0.0);
    });
}

#[divan::bench(sample_count = 100, sample_size = 1)]
fn second_without_depth(bencher: Bencher) {
    let sensors = SensorSuiteConfig {
        depth: None,
        ..SensorSuiteConfig::small_multirotor()
    };
    second(bencher, sensors);
}

#[divan::bench(sample_count = 50, sample_size = 1)]
fn second_with_depth_at_30_hz(bencher: Bencher) {
    second(bencher, SensorSuiteConfig::small_multirotor());
}

/// One second in the air among 100 obstacles and three people, commanded at 250 Hz.
fn second(bencher: Bencher, sensors: SensorSuiteConfig) {
    let mut vehicle = airborne(sensors);
    let mut batch = SensorBatch::default();
    bencher.bench_local(|| {
        for _ in 0..250 {
            vehicle.sense(&mut batch).unwrap();
            vehicle.command(&hover(&vehicle)).unwrap();
        }
    });
    assert!(vehicle.collision().is_none());
}

fn airborne(sensors: SensorSuiteConfig) -> SimulatedVehicle {
    let config = toml::from_str(&samples::mixed_world(1, 100)).unwrap();
    let world = World::new(&config, 1, &samples::assets).unwrap();
    let setup = VehicleSetup {
        sensors,
        ..VehicleSetup::new(preset("quad_x500").unwrap())
    };
    let mut vehicle = SimulatedVehicle::new(Arc::new(world), &setup, 1).unwrap();
    let mut batch = SensorBatch::default();
    for _ in 0..5 * 250 {
        vehicle.sense(&mut batch).unwrap();
        vehicle.command(&hover(&vehicle)).unwrap();
    }
    vehicle
}

/// Towards 1.5 m above the start, from the truth.
fn hover(vehicle: &SimulatedVehicle) -> Command {
    let truth = vehicle.truth();
    let error = Vector3::new(0.0, 0.0, 1.5) - truth.position_world();
    let wanted = error * 0.8 - truth.velocity_world * 1.2;
    Command::TiltClimb {
        roll_rad: (-wanted.y / 9.8).clamp(-0.3, 0.3),
        pitch_rad: (wanted.x / 9.8).clamp(-0.3, 0.3),
        yaw_rate_rad_s: 0.0,
        climb_rate_m_s: error.z.clamp(-1.0, 1.0),
    }
}
