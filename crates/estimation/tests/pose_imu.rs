//! The fusion of inertial data and external poses on a synthetic flight, and when data fail.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use alula_estimation::{Estimator, PoseImu, PoseImuConfig, PoseSensorConfig};
use alula_geometry::{Pose, TimeDelta, Timestamp, so3};
use alula_messages::{EstimateHealth, PoseSample, Rejection, SensorBatch, error_index};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use support::Flight;

fn pose_at(flight: &Flight, time: Timestamp) -> PoseSample {
    let truth = flight.truth(time.as_s());
    PoseSample {
        time,
        sensor: 0,
        world_from_body: Pose::from_parts(
            Translation3::from(truth.position_world),
            truth.world_from_body,
        ),
    }
}

/// Flies 20 s with exact poses at 10 Hz that arrive `delay_s` late.
fn fly(delay_s: f64, mut spoil: impl FnMut(f64, &mut SensorBatch)) -> (PoseImu, f64) {
    let mut flight = Flight::new(21, 40.0);
    let mut estimator = PoseImu::new(&PoseImuConfig::default()).unwrap();
    let mut batch = SensorBatch::default();
    for i in 1.. {
        let t = flight.step(&mut batch);
        if t > 20.0 {
            break;
        }
        let time = batch.now - TimeDelta::from_s(delay_s);
        if i % 25 == 0 && time > Timestamp::ZERO {
            batch.poses.push(pose_at(&flight, time));
        }
        spoil(t, &mut batch);
        estimator.update(&batch, flight.mode(t));
    }
    let truth = flight.truth(estimator.state().time.as_s());
    let error = (estimator.state().position_world() - truth.position_world).norm();
    (estimator, error)
}

#[test]
fn a_delay_costs_next_to_nothing() {
    let (_, in_time) = fly(0.0, |_, _| {});
    let (_, late) = fly(0.2, |_, _| {});
    println!("error in time {in_time:.4} m, 0.2 s late {late:.4} m");
    assert!(in_time.max(late) < 0.03, "{in_time} {late}");
}

#[test]
fn poses_that_cannot_be_are_refused() {
    let (estimator, error) = fly(0.1, |t, batch| {
        if t > 10.0 && t < 10.4 {
            for pose in &mut batch.poses {
                pose.world_from_body.translation.vector = Vector3::repeat(f64::NAN);
            }
        }
        if t > 11.0 && t < 11.4 {
            for pose in &mut batch.poses {
                pose.world_from_body.translation.vector.x += 5.0;
            }
        }
        if t > 12.0 && t < 12.4 {
            for pose in &mut batch.poses {
                let broken = nalgebra::Quaternion::new(0.0, 0.0, 0.0, 0.0);
                pose.world_from_body.rotation = UnitQuaternion::new_unchecked(broken);
            }
        }
    });
    assert_eq!(estimator.state().health, EstimateHealth::Good);
    assert!(error < 0.03, "{error}");
}

/// A motion capture that was set up anew: refused for a second, then believed.
#[test]
fn a_lasting_shift_of_the_poses_is_believed_in_the_end() {
    let (estimator, error) = fly(0.1, |t, batch| {
        if t > 10.0 {
            for pose in &mut batch.poses {
                pose.world_from_body.translation.vector.x += 2.0;
            }
        }
    });
    assert_eq!(estimator.state().health, EstimateHealth::Good);
    assert!((error - 2.0).abs() < 0.05, "{error}");
}

#[test]
fn after_inertial_silence_the_next_pose_starts_it_anew() {
    let mut failed = false;
    let (estimator, error) = fly(0.1, |t, batch| {
        if t > 10.0 && t < 11.0 {
            batch.imu.clear();
            failed = true;
        }
    });
    assert!(failed);
    assert_eq!(estimator.state().health, EstimateHealth::Good);
    assert!(error < 0.05, "{error}");
}

/// Two pose sensors at the places of document O, equation 2.64.
fn two_sensors() -> Vec<PoseSensorConfig> {
    let sensor = |position_m, roll_pitch_yaw_rad: [f64; 3]| PoseSensorConfig {
        position_m,
        roll_pitch_yaw_deg: roll_pitch_yaw_rad.map(f64::to_degrees),
        ..PoseSensorConfig::default()
    };
    vec![
        sensor([0.03, -0.07, 0.1], [0.2, -0.1, 0.3]),
        sensor([-0.05, 0.08, 0.1], [-0.1, 0.2, -0.3]),
    ]
}

/// What sensor number `sensor` reads at `time`.
fn pose_of(flight: &Flight, sensor: u8, time: Timestamp) -> PoseSample {
    let config = &two_sensors()[usize::from(sensor)];
    let [roll, pitch, yaw] = config.roll_pitch_yaw_deg.map(f64::to_radians);
    let body_from_sensor = Pose::from_parts(
        Translation3::from(Vector3::from(config.position_m)),
        so3::from_roll_pitch_yaw(roll, pitch, yaw),
    );
    PoseSample {
        sensor,
        world_from_body: pose_at(flight, time).world_from_body * body_from_sensor,
        ..pose_at(flight, time)
    }
}

/// Flies 10 s with two exact pose sensors at 10 Hz, both measuring at the same times and heard
/// `late_s` later. Gives the greatest error of position over its standard deviation.
fn fly_with_two(late_s: [f64; 2]) -> (PoseImu, f64) {
    let mut flight = Flight::new(22, 40.0);
    let config = PoseImuConfig {
        sensors: two_sensors(),
        ..PoseImuConfig::default()
    };
    let mut estimator = PoseImu::new(&config).unwrap();
    let mut batch = SensorBatch::default();
    let mut waiting: Vec<(Timestamp, PoseSample)> = Vec::new();
    for i in 1..2500 {
        let t = flight.step(&mut batch);
        if i % 25 == 0 && i < 2400 {
            for (sensor, late_s) in [0, 1].into_iter().zip(late_s) {
                let heard = batch.now + TimeDelta::from_s(late_s);
                waiting.push((heard, pose_of(&flight, sensor, batch.now)));
            }
        }
        let now = batch.now;
        batch
            .poses
            .extend(waiting.iter().filter(|w| w.0 <= now).map(|w| w.1));
        waiting.retain(|w| w.0 > now);
        estimator.update(&batch, flight.mode(t));
    }
    let state = estimator.state();
    let truth = flight.truth(state.time.as_s());
    let error = state.position_world() - truth.position_world;
    let ratio = error
        .component_div(&state.sigma(error_index::POSITION))
        .amax();
    (estimator, ratio)
}

/// Half a second after the last poses, within four standard deviations.
#[test]
fn two_sensors_at_their_places_say_the_same() {
    let (estimator, ratio) = fly_with_two([0.1, 0.1]);
    assert!(ratio < 4.0, "{ratio}");
    assert_eq!(estimator.unobserved(), Default::default());
}

/// The same poses in three orders of arrival: the result is the same to the bit. The first pose
/// starts the filter, so it is the same in all.
#[test]
fn the_order_in_which_two_sensors_are_heard_does_not_matter() {
    let (first, _) = fly_with_two([0.1, 0.2]);
    for late_s in [[0.1, 0.13], [0.1, 0.3]] {
        let (other, _) = fly_with_two(late_s);
        assert_eq!(first.state(), other.state());
    }
}

#[test]
fn a_pose_of_a_sensor_that_nobody_knows_is_refused() {
    let mut flight = Flight::new(23, 40.0);
    let mut estimator = PoseImu::new(&PoseImuConfig::default()).unwrap();
    let mut batch = SensorBatch::default();
    flight.step(&mut batch);
    batch.poses.push(PoseSample {
        sensor: 1,
        ..pose_at(&flight, batch.now)
    });
    estimator.update(&batch, flight.mode(0.0));
    let fusion = estimator.fusions().last().unwrap();
    assert_eq!(fusion.rejection, Some(Rejection::Invalid));
}
