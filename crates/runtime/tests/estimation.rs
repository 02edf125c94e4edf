//! Estimators over recorded flights: real ones, where the data are at hand, and our own.
//!
//! `ALULA_DATA` names the folder that holds the real data, see `docs/`.

// Helpers fail as tests do, and print what they measure.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use std::env;
use std::path::{Path, PathBuf};

use alula_estimation::eskf::{Truncation, Variant};
use alula_messages::error_index::GYROSCOPE_BIAS;
use alula_messages::{EstimateHealth, NavState};
use alula_record::euroc::Folder;
use alula_record::{Event, Recording};
use alula_runtime::RunError;
use alula_runtime::estimate::{Estimation, Job, PoseFeed, estimate};
use nalgebra::Vector3;
use support::{SHORT, first_flight, recorded};

fn job(log: &Path, estimator: &str) -> Job {
    Job {
        log: log.to_owned(),
        estimator: Some(estimator.to_owned()),
        truth: None,
        poses: PoseFeed {
            rate_hz: Some(10.0),
            delay_s: 0.1,
            ..PoseFeed::default()
        },
        align: None,
        rpe_delta_s: 0.5,
        seed: 1,
        overrides: Vec::new(),
    }
}

/// The real flight, if it is at hand.
fn real_flight() -> Option<PathBuf> {
    let folder = env::var_os("ALULA_DATA").map(|data| PathBuf::from(data).join("euroc_v1_01"));
    if folder.is_none() {
        println!("skipped: ALULA_DATA does not name the folder of the real data");
    }
    folder
}

fn notes(estimation: &Estimation) -> String {
    estimation.report.notes.join("\n")
}

/// Acceptance: 3 cm and 1 degree, in the frame of the motion capture, without alignment.
#[test]
fn poses_at_10_hz_and_late_give_a_real_flight_to_3_cm_and_1_degree() {
    let Some(log) = real_flight() else { return };
    let report = estimate(&job(&log, "pose-imu")).unwrap().report;
    let errors = report.errors.unwrap();
    println!(
        "pose-imu: ATE {:.4} m, orientation {:.3} deg, jump {:.4} m, completed {:.4}",
        errors.ate_rmse_m,
        errors.orientation_rmse_deg,
        report.max_jump_m,
        report.completed_fraction
    );
    assert!(errors.ate_rmse_m <= 0.03, "{errors:?}");
    assert!(errors.orientation_rmse_deg <= 1.0, "{errors:?}");
    assert!(report.completed_fraction > 0.99);
}

/// Acceptance: a loss of 0.5 s leaves no jump above 10 cm.
#[test]
fn half_a_second_without_poses_leaves_no_jump_above_10_cm() {
    let Some(log) = real_flight() else { return };
    for start_s in [25.0, 60.0, 95.0, 125.0] {
        let mut job = job(&log, "pose-imu");
        job.poses.outages_s = vec![[start_s, 0.5]];
        let report = estimate(&job).unwrap().report;
        println!(
            "outage at {start_s} s: jump {:.4} m, ATE {:.4} m",
            report.max_jump_m,
            report.errors.unwrap().ate_rmse_m
        );
        assert!(report.max_jump_m <= 0.10, "{start_s} s: {report:?}");
    }
}

#[test]
fn flow_odometry_completes_a_real_flight_and_says_what_was_made_from_the_truth() {
    let Some(log) = real_flight() else { return };
    let estimation = estimate(&job(&log, "flow-odometry")).unwrap();
    let report = &estimation.report;
    println!(
        "flow-odometry: ATE {:.4} m, completed {:.4}",
        report.errors.unwrap().ate_rmse_m,
        report.completed_fraction
    );
    assert!(report.completed_fraction >= 0.95);
    let notes = notes(&estimation);
    assert!(
        notes.contains("flow and range were made from the truth"),
        "{notes}"
    );
}

/// The estimated bias of the gyroscope at the end less the true one, in standard deviations.
fn final_gyroscope_bias_in_sigmas(log: &Path, estimation: &Estimation) -> Vector3<f64> {
    let truth = Folder::open(log).unwrap().truth().unwrap().samples;
    let imu_from_body =
        truth[0].world_from_imu.rotation.inverse() * estimation.truth[0].world_from_body.rotation;
    let bias = imu_from_body.inverse() * truth.last().unwrap().gyroscope_bias;
    let state = estimation.states.last().unwrap();
    (state.gyroscope_bias - bias).component_div(&state.sigma(GYROSCOPE_BIAS))
}

fn check_on_a_real_flight(log: &Path, variant: Variant, sensors: &str) {
    let text = |value: serde_json::Value| value.as_str().unwrap().to_owned();
    let key = "parameters.flow_odometry";
    let mut job = job(log, "flow-odometry");
    job.overrides = vec![
        format!("{key}.sensors=\"{sensors}\""),
        format!(
            "{key}.variant.filter=\"{}\"",
            text(serde_json::to_value(variant.filter).unwrap())
        ),
        format!(
            "{key}.variant.integration=\"{}\"",
            text(serde_json::to_value(variant.integration).unwrap())
        ),
        format!(
            "{key}.variant.transition=\"{}\"",
            text(serde_json::to_value(variant.transition).unwrap())
        ),
    ];
    let estimation = estimate(&job).unwrap();
    let errors = estimation.report.errors.unwrap();
    let bias = final_gyroscope_bias_in_sigmas(log, &estimation);
    println!(
        "{variant:16} {sensors}: NEES velocity {:.2}, tilt {:.2}; bias off by {:.1} {:.1} {:.1} sigma; \
         ATE {:.3} m, velocity {:.3} m/s",
        errors.nees_velocity.unwrap(),
        errors.nees_tilt.unwrap(),
        bias.x,
        bias.y,
        bias.z,
        errors.ate_rmse_m,
        errors.velocity_rmse_m_s.unwrap(),
    );
    assert!(estimation.report.completed_fraction >= 0.95, "{variant}");
    assert!(bias.amax() <= 3.0, "{variant} {sensors}: {bias}");
    // Well below the 0.5 m/s of the flight.
    assert!(errors.velocity_rmse_m_s.unwrap() < 0.1, "{variant}");
}

/// Acceptance: the whole flight, and biases of the gyroscope within three standard deviations.
#[test]
fn every_variant_completes_a_real_flight_and_finds_the_bias_of_the_gyroscope() {
    let Some(log) = real_flight() else { return };
    for variant in Variant::all() {
        check_on_a_real_flight(&log, variant, "flow-and-infrared");
    }
    // The sensors meet the kinds of filter; integration and transition are those of above.
    for variant in Variant::all().filter(|v| v.transition == Truncation::F3) {
        check_on_a_real_flight(&log, variant, "velocity-and-sonar");
    }
}

fn is_usable(state: &NavState) -> bool {
    !matches!(
        state.health,
        EstimateHealth::Initialising | EstimateHealth::Failed
    )
}

/// The estimates that the stack had in flight.
fn flown_states(path: &Path) -> Vec<NavState> {
    Recording::open(path)
        .unwrap()
        .filter_map(|event| match event.unwrap() {
            Event::Output(output) if is_usable(&output.state) => Some(output.state),
            _ => None,
        })
        .collect()
}

#[test]
fn an_estimator_over_a_recording_says_what_it_said_in_flight() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = recorded(&first_flight(&SHORT), 1, folder.path());
    let estimation = estimate(&job(&path, "flow-odometry")).unwrap();
    let flown = flown_states(&path);
    assert!(flown.len() > 1000);
    assert_eq!(estimation.states.len(), flown.len());
    let difference = estimation
        .states
        .iter()
        .zip(&flown)
        .position(|(a, b)| a != b);
    assert_eq!(difference, None, "first state that differs");
}

#[test]
fn another_estimator_over_a_recording_gets_poses_from_its_truth() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = recorded(&first_flight(&SHORT), 1, folder.path());
    let estimation = estimate(&job(&path, "pose-imu")).unwrap();
    let errors = estimation.report.errors.unwrap();
    assert!(notes(&estimation).contains("made from the recorded truth"));
    // As over the real flight.
    assert!(errors.ate_rmse_m <= 0.03, "{errors:?}");
}

#[test]
fn an_estimator_over_a_cut_recording_says_that_it_is_cut() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = recorded(&first_flight(&SHORT), 1, folder.path());
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let estimation = estimate(&job(&path, "flow-odometry")).unwrap();
    assert!(estimation.report.samples > 100);
    assert!(notes(&estimation).contains("truncated at byte"));
}

#[test]
fn an_unknown_estimator_is_answered_with_the_list() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = recorded(&first_flight(&SHORT), 1, folder.path());
    let error: RunError = estimate(&job(&path, "gps")).unwrap_err();
    assert!(
        error.to_string().contains("flow-odometry, pose-imu"),
        "{error}"
    );
}
