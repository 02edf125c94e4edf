//! The fusion of inertial data and poses on a real flight: EuRoC V1_01_easy, whose folder is
//! `euroc_v1_01` under the folder that the environment variable `ALULA_DATA` names.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use std::path::{Path, PathBuf};

use alula_estimation::{Estimator, PoseImu, PoseImuConfig};
use alula_geometry::{Pose, TimeDelta, Timestamp};
use alula_messages::{EstimateHealth, FlightMode, ImuSample, PoseSample, SensorBatch};
use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};

struct Recording {
    imu: Vec<ImuSample>,
    truth: Vec<(Timestamp, Pose)>,
}

fn recording() -> Option<Recording> {
    let Some(folder) = std::env::var_os("ALULA_DATA").map(PathBuf::from) else {
        println!("skipped: ALULA_DATA is not set");
        return None;
    };
    let folder = folder.join("euroc_v1_01").join("mav0");
    let vector = |row: &[f64], i: usize| Vector3::new(row[i], row[i + 1], row[i + 2]);
    let imu = rows(&folder.join("imu0").join("data.csv"), |time, row| {
        ImuSample {
            time,
            specific_force: vector(row, 3),
            angular_rate: vector(row, 0),
        }
    });
    let truth = rows(
        &folder.join("state_groundtruth_estimate0").join("data.csv"),
        |time, row| {
            let q = Quaternion::new(row[3], row[4], row[5], row[6]);
            let position = Translation3::from(vector(row, 0));
            (
                time,
                Pose::from_parts(position, UnitQuaternion::from_quaternion(q)),
            )
        },
    );
    Some(Recording { imu, truth })
}

fn rows<T>(path: &Path, read: impl Fn(Timestamp, &[f64]) -> T) -> Vec<T> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text
        .lines()
        .filter(|line| !line.starts_with('#') && !line.is_empty());
    lines
        .map(|line| {
            let (time, values) = line.split_once(',').unwrap();
            let values: Vec<f64> = values
                .split(',')
                .map(|v| v.trim().parse().unwrap())
                .collect();
            read(Timestamp::from_ns(time.parse().unwrap()), &values)
        })
        .collect()
}

#[derive(Default)]
struct Judged {
    position_rmse_m: f64,
    orientation_rmse_deg: f64,
    worst_position_m: f64,
    /// Greatest change of the estimate between two inertial samples beyond what velocity explains.
    worst_jump_m: f64,
    degraded: bool,
}

/// Every second pose of the truth (10 Hz) arrives 0.1 s late, except where `lost` says so; the
/// estimate of each moment is judged as it was known then, against all of the truth.
fn judge(recording: &Recording, lost: impl Fn(f64) -> bool) -> Judged {
    let mut estimator = PoseImu::new(&PoseImuConfig::default()).unwrap();
    let delay = TimeDelta::from_s(0.1);
    let start = recording.imu[0].time;
    let mut arriving = recording.truth.iter().step_by(2).peekable();
    let mut truth = recording.truth.iter().peekable();
    let mut batch = SensorBatch::default();
    let mut judged = Judged::default();
    let mut count = 0.0;
    let end = recording.truth[recording.truth.len() - 1].0;
    let mut last: Option<(Timestamp, Vector3<f64>, Vector3<f64>)> = None;
    for imu in &recording.imu {
        batch.clear();
        batch.now = imu.time;
        batch.imu.push(*imu);
        while let Some((time, pose)) = arriving.next_if(|p| p.0 + delay <= imu.time) {
            if !lost(time.seconds_since(start)) {
                batch.poses.push(PoseSample {
                    time: *time,
                    sensor: 0,
                    world_from_body: *pose,
                });
            }
        }
        estimator.update(&batch, FlightMode::Flying);
        let state = estimator.state();
        // The first pose arrives after 0.1 s; the inertial data outlast the truth.
        let settled = imu.time.seconds_since(start) > 0.15 && imu.time <= end + delay;
        if settled {
            judged.degraded |= state.health != EstimateHealth::Good;
            if let Some((time, position, velocity)) = last {
                let expected = position + velocity * state.time.seconds_since(time);
                let jump = (state.position_world() - expected).norm();
                judged.worst_jump_m = judged.worst_jump_m.max(jump);
            }
            last = Some((state.time, state.position_world(), state.velocity_world));
        }
        // Stamps of truth and inertial data are on one grid, up to 200 ns of rounding.
        let rounding = TimeDelta::from_ns(1000);
        while let Some((time, pose)) = truth.next_if(|p| p.0 <= imu.time + rounding) {
            if settled && (*time - imu.time).as_ns().abs() < 1000 {
                let error = state.world_from_body.inverse() * pose;
                let distance_m = error.translation.vector.norm();
                judged.position_rmse_m += distance_m * distance_m;
                judged.worst_position_m = judged.worst_position_m.max(distance_m);
                judged.orientation_rmse_deg += error.rotation.angle().to_degrees().powi(2);
                count += 1.0;
            }
        }
    }
    assert!(count > 2500.0, "only {count} poses of the truth were met");
    judged.position_rmse_m = (judged.position_rmse_m / count).sqrt();
    judged.orientation_rmse_deg = (judged.orientation_rmse_deg / count).sqrt();
    judged
}

#[test]
fn late_and_rare_poses_give_three_centimetres_and_one_degree() {
    let Some(recording) = recording() else { return };
    let judged = judge(&recording, |_| false);
    println!(
        "position {:.4} m (worst {:.4}), orientation {:.3} deg, greatest correction {:.4} m",
        judged.position_rmse_m,
        judged.worst_position_m,
        judged.orientation_rmse_deg,
        judged.worst_jump_m
    );
    assert!(judged.position_rmse_m <= 0.03);
    assert!(judged.orientation_rmse_deg <= 1.0);
    assert!(!judged.degraded);
}

#[test]
fn half_a_second_without_poses_leaves_no_jump_above_ten_centimetres() {
    let Some(recording) = recording() else { return };
    // A loss every ten seconds, so that all kinds of motion meet one.
    let judged = judge(&recording, |t| t > 5.0 && t % 10.0 < 0.5);
    println!(
        "with losses: position {:.4} m (worst {:.4}), orientation {:.3} deg, greatest correction {:.4} m",
        judged.position_rmse_m,
        judged.worst_position_m,
        judged.orientation_rmse_deg,
        judged.worst_jump_m
    );
    assert!(judged.worst_jump_m <= 0.1);
    assert!(judged.worst_position_m <= 0.2);
}
