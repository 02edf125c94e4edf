//! The cascade velocity estimator on the manoeuvres of document O, section 2.5.3.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod support;

use alula_estimation::{Cascade, CascadeConfig, Estimator};
use alula_messages::{EstimateHealth, FlightMode, NavState, SensorBatch, error_index};
use nalgebra::{Vector2, Vector3};
use support::{Flight, LEGS_LAND_S, STAND_HEIGHT_M, TAKE_OFF_S, Truth, UP_S, calibration};

fn estimator() -> Cascade {
    let mut config = CascadeConfig::default();
    config.alignment.start_position_m = [0.0, 0.0, STAND_HEIGHT_M];
    Cascade::new(&config, &calibration()).unwrap()
}

/// Flies and shows each state from the alignment on beside the truth.
fn fly(
    mut flight: Flight,
    mut spoil: impl FnMut(f64, &mut SensorBatch),
    mut look: impl FnMut(f64, &NavState, &Truth),
) -> Cascade {
    let mut estimator = estimator();
    let mut batch = SensorBatch::default();
    loop {
        let t = flight.step(&mut batch);
        if t > LEGS_LAND_S + 1.0 {
            return estimator;
        }
        spoil(t, &mut batch);
        estimator.update(&batch, flight.mode(t));
        let state = estimator.state();
        if state.health != EstimateHealth::Initialising {
            look(t, state, &flight.truth(state.time.as_s()));
        }
    }
}

/// Root of the mean of squares.
#[derive(Default)]
struct Rms {
    squares: Vector3<f64>,
    count: f64,
}

impl Rms {
    fn add(&mut self, error: Vector3<f64>) {
        self.squares += error.component_mul(&error);
        self.count += 1.0;
    }

    fn get(&self) -> Vector3<f64> {
        (self.squares / self.count).map(f64::sqrt)
    }
}

#[test]
fn velocity_is_better_than_a_tenth_of_a_metre_per_second() {
    for seed in 0..10 {
        let (mut velocity, mut height) = (Rms::default(), Rms::default());
        fly(
            Flight::legs(seed),
            |_, _| {},
            |_, state, truth| {
                velocity.add(state.velocity_world - truth.velocity_world);
                let error = state.position_world() - truth.position_world;
                height.add(Vector3::new(0.0, 0.0, error.z));
            },
        );
        let (v, h) = (velocity.get(), height.get().z);
        println!(
            "seed {seed}: velocity {:.3} {:.3} {:.3} m/s, height {h:.3} m",
            v.x, v.y, v.z
        );
        assert!(v.max() < 0.1, "seed {seed}: {v}");
        assert!(h < 0.05, "seed {seed}: {h}");
    }
}

/// In flight, over many seeds and ten times a second, the squared error of each part over its
/// variance is on average not above 1, and not so far below that the claim says nothing.
#[test]
fn the_claimed_covariance_is_honest() {
    let mut ratios = [0.0; 4];
    let mut count = 0.0;
    for seed in 0..20 {
        let mut samples = 0;
        fly(
            Flight::legs(seed),
            |_, _| {},
            |t, state, truth| {
                if !(UP_S..LEGS_LAND_S - 1.0).contains(&t) || (t * 250.0).round() % 25.0 != 0.0 {
                    return;
                }
                samples += 1;
                let velocity = state.velocity_world - truth.velocity_world;
                let position = state.position_world() - truth.position_world;
                let turn = alula_geometry::so3::log(
                    &(state.world_from_body.rotation.inverse() * truth.world_from_body),
                );
                let over = |error: &[f64], row: usize| {
                    let sum: f64 = error
                        .iter()
                        .enumerate()
                        .map(|(i, e)| e * e / state.covariance[(row + i, row + i)])
                        .sum();
                    sum / error.len() as f64
                };
                ratios[0] += over(velocity.as_slice(), error_index::VELOCITY);
                ratios[1] += over(&[position.z], error_index::POSITION + 2);
                ratios[2] += over(turn.as_slice(), error_index::ORIENTATION);
                ratios[3] += over(position.xy().as_slice(), error_index::POSITION);
            },
        );
        count += f64::from(samples);
    }
    let ratios = ratios.map(|r| r / count);
    println!("velocity, height, orientation, position: {ratios:.2?}");
    assert!(ratios.iter().all(|r| *r < 1.0), "{ratios:?}");
    assert!(ratios[0] > 0.1 && ratios[1] > 0.1, "{ratios:?}");
}

#[test]
fn the_bias_changes_on_the_ground_alone() {
    let mut at_lift_off = None;
    let mut flight = Flight::legs(3);
    flight.walk = [0.0; 2];
    let vertical = flight.accelerometer_bias().z;
    fly(
        flight,
        |_, _| {},
        |t, state, _| {
            if (TAKE_OFF_S..LEGS_LAND_S).contains(&t) {
                let bias = *at_lift_off.get_or_insert(state.accelerometer_bias);
                assert_eq!(state.accelerometer_bias, bias);
            }
        },
    );
    // At rest the accelerometer's scale looks like a bias. Two seconds on the ground leave 0.02.
    let expected = vertical + 0.0098 * alula_geometry::GRAVITY_M_S2;
    let found = at_lift_off.unwrap().z;
    assert!((found - expected).abs() < 0.03, "{found} {expected}");
}

#[test]
fn late_measurements_cost_little() {
    let mut waiting: Vec<(f64, SensorBatch)> = Vec::new();
    let mut velocity = Rms::default();
    fly(
        Flight::legs(5),
        |t, batch| {
            let late = SensorBatch {
                flow: std::mem::take(&mut batch.flow),
                infrared: std::mem::take(&mut batch.infrared),
                ..SensorBatch::default()
            };
            waiting.push((t, late));
            while waiting.first().is_some_and(|(since, _)| t - since > 0.15) {
                let (_, late) = waiting.remove(0);
                batch.flow.extend(late.flow);
                batch.infrared.extend(late.infrared);
            }
        },
        |_, state, truth| velocity.add(state.velocity_world - truth.velocity_world),
    );
    let v = velocity.get();
    println!("0.15 s late: {:.3} {:.3} {:.3} m/s", v.x, v.y, v.z);
    assert!(v.max() < 0.1, "{v}");
}

#[test]
fn without_flow_the_claimed_velocity_error_grows_and_the_health_says_so() {
    let mut worst: f64 = 0.0;
    let mut degraded = false;
    fly(
        Flight::legs(7),
        |t, batch| {
            if (12.0..16.0).contains(&t) {
                batch.flow.clear();
            }
        },
        |t, state, truth| {
            let error: Vector2<f64> = (state.velocity_world - truth.velocity_world).xy();
            let sigma = state.sigma(error_index::VELOCITY);
            if (12.0..16.0).contains(&t) {
                worst = worst.max(error.norm() / sigma.x.hypot(sigma.y));
                degraded |= matches!(state.health, EstimateHealth::Degraded { .. });
            } else if t > 16.5 && t < LEGS_LAND_S - 2.0 {
                assert_eq!(state.health, EstimateHealth::Good);
                assert!(error.norm() < 0.3, "at {t}: {error}");
            }
        },
    );
    assert!(degraded);
    assert!(worst < 3.0, "{worst}");
}

#[test]
fn after_inertial_silence_it_says_so_and_starts_anew_on_the_ground() {
    let mut failed = false;
    let mut cascade = fly(
        Flight::legs(8),
        |t, batch| {
            if (12.0..13.0).contains(&t) {
                batch.imu.clear();
            }
        },
        |t, state, _| {
            if t > 12.3 && t < LEGS_LAND_S {
                failed = state.health == EstimateHealth::Failed;
                assert!(failed, "at {t}");
            }
        },
    );
    assert!(failed);
    let mut flight = Flight::legs(9);
    let mut batch = SensorBatch::default();
    while flight.step(&mut batch) < TAKE_OFF_S - 0.5 {
        let shift = alula_geometry::TimeDelta::from_s(LEGS_LAND_S + 2.0);
        batch.now += shift;
        for sample in &mut batch.imu {
            sample.time += shift;
        }
        cascade.update(&batch, FlightMode::Disarmed);
    }
    assert_eq!(cascade.state().health, EstimateHealth::Good);
}
