//! The fusion of inertial data and external poses on a synthetic flight, and when data fail.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use alula_estimation::{Estimator, PoseImu, PoseImuConfig};
use alula_geometry::{Pose, TimeDelta, Timestamp};
use alula_messages::{EstimateHealth, PoseSample, SensorBatch};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use support::Flight;

fn pose_at(flight: &Flight, time: Timestamp) -> PoseSample {
    let truth = flight.truth(time.as_s());
    PoseSample {
        time,
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
