//! Recordings replay to the same bits; what was changed, cut or broken is named.

// Helpers fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use std::fs;
use std::path::{Path, PathBuf};

use alula_record::RecordError;
use alula_runtime::RunError;
use alula_runtime::replay::{Difference, ReplayReport, read_flight, replay};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use support::{SHORT, first_flight, recorded};
use tempfile::TempDir;

/// A short recorded flight.
struct Recorded {
    folder: TempDir,
    path: PathBuf,
}

impl Recorded {
    fn new(seed: u64) -> Self {
        Self::with(&SHORT, seed)
    }

    fn with(overrides: &[&str], seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (_, path) = recorded(&first_flight(overrides), seed, folder.path());
        Self { folder, path }
    }

    fn bytes(&self) -> Vec<u8> {
        fs::read(&self.path).unwrap()
    }

    fn copy(&self, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join("copy.mcap");
        fs::write(&path, bytes).unwrap();
        path
    }

    fn replay(&self, overrides: &[&str]) -> ReplayReport {
        let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
        replay(&self.path, &overrides).unwrap()
    }

    fn first_difference(&self, change: &str) -> Difference {
        let report = self.replay(&[change]);
        report
            .first_difference
            .unwrap_or_else(|| panic!("{change} makes no difference"))
    }
}

fn error(path: &Path) -> RecordError {
    match replay(path, &[]) {
        Err(RunError::Record(error)) => *error,
        other => panic!("{other:?}"),
    }
}

#[test]
fn recorded_flights_replay_without_difference() {
    for seed in 1..=3 {
        let folder = tempfile::tempdir().unwrap();
        let (flight, path) = recorded(&first_flight(&[]), seed, folder.path());
        let report = replay(&path, &[]).unwrap();
        assert_eq!(report.first_difference, None, "seed {seed}");
        assert_eq!(report.damage, Vec::<String>::new());
        assert_eq!(report.seed, seed);
        // One step a control period of 4 ms.
        let expected = (flight.summary.duration_s / 0.004).round() as usize;
        assert!(report.steps.abs_diff(expected) <= 1, "{report:?}");
    }
}

#[test]
fn a_flight_with_the_true_state_replays_too() {
    let mut overrides = SHORT.to_vec();
    overrides.push("simulation.state=truth");
    assert_eq!(
        Recorded::with(&overrides, 1).replay(&[]).first_difference,
        None
    );
}

#[test]
fn a_flight_that_the_guard_ended_replays_too() {
    let mut overrides = SHORT.to_vec();
    overrides.push("stack.guard.fence.max_m=[1.0, 12.0, 6.0]");
    assert_eq!(
        Recorded::with(&overrides, 1).replay(&[]).first_difference,
        None
    );
}

#[test]
fn a_drawn_recording_tells_the_same_story_as_the_flight() {
    let folder = tempfile::tempdir().unwrap();
    let (flight, path) = recorded(&first_flight(&SHORT), 2, folder.path());
    let read = read_flight(&path).unwrap();
    assert_eq!(format!("{:?}", read.log), format!("{:?}", flight.log));
    assert_eq!(read.damage, Vec::<String>::new());
}

#[test]
fn a_changed_controller_shows_in_the_command_it_asks_for() {
    let difference = Recorded::new(1).first_difference("stack.control.yaw_gain_1_s=1.0");
    assert_eq!(difference.field, "requested command");
    assert_ne!(difference.recorded, difference.replayed);
}

#[test]
fn a_changed_estimator_shows_in_the_estimate() {
    let change = "stack.estimation.parameters.flow_odometry.flow_sigma_rad_s=0.03";
    let difference = Recorded::new(1).first_difference(change);
    assert!(difference.field.starts_with("estimate"), "{difference:?}");
}

#[test]
fn a_changed_speed_limit_shows_in_the_reference() {
    let difference = Recorded::new(1).first_difference("stack.guide.limits.max_speed_m_s=1.0");
    assert_eq!(difference.field, "reference");
}

#[test]
fn a_changed_fence_shows_in_the_guard() {
    let change = "stack.guard.fence.max_m=[1.0, 12.0, 6.0]";
    let difference = Recorded::new(1).first_difference(change);
    assert_eq!(difference.field, "guard");
}

#[test]
fn a_changed_byte_of_the_configuration_is_found() {
    let recording = Recorded::new(1);
    let mut bytes = recording.bytes();
    let key = b"max_thrust_n = 34.2";
    let at = bytes.windows(key.len()).position(|w| w == key).unwrap();
    bytes[at + key.len() - 1] = b'3';
    let error = error(&recording.copy(&bytes));
    assert!(
        matches!(error, RecordError::ConfigChanged { .. }),
        "{error}"
    );
    let message = error.to_string();
    for part in ["copy.mcap", "configuration", "changed", "unchanged copy"] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn a_truncated_recording_replays_up_to_the_break_and_says_where() {
    let recording = Recorded::new(1);
    let bytes = recording.bytes();
    let whole = recording.replay(&[]);
    let path = recording.copy(&bytes[..bytes.len() / 2]);
    let report = replay(&path, &[]).unwrap();
    assert_eq!(report.first_difference, None);
    assert!(0 < report.steps && report.steps < whole.steps, "{report:?}");
    let [damage] = report.damage.as_slice() else {
        panic!("{report:?}");
    };
    assert!(damage.starts_with("truncated at byte "), "{damage}");
    assert!(damage.contains("read up to t = "), "{damage}");
}

/// What a kill in the middle of writing leaves: any part of the file from its start.
#[test]
fn a_recording_cut_anywhere_replays_or_says_that_its_header_is_missing() {
    let recording = Recorded::new(1);
    let bytes = recording.bytes();
    let mut random = Pcg64::seed_from_u64(1);
    let early = (0..20).map(|_| random.random_range(0..4096)).collect();
    let anywhere = (0..20)
        .map(|_| random.random_range(0..bytes.len()))
        .collect();
    let cuts: [Vec<usize>; 2] = [early, anywhere];
    let mut replayed = 0;
    for length in cuts.concat() {
        let path = recording.copy(&bytes[..length]);
        match replay(&path, &[]) {
            Ok(report) => {
                assert_eq!(report.first_difference, None, "cut at {length}");
                assert_eq!(report.damage.len(), 1, "cut at {length}: {report:?}");
                replayed += 1;
            }
            Err(RunError::Record(error)) => {
                let no_start = matches!(
                    *error,
                    RecordError::NoHeader { .. } | RecordError::NotMcap { .. }
                );
                assert!(no_start, "cut at {length}: {error}");
                assert!(error.to_string().contains("copy.mcap"), "{error}");
                assert!(length < 16384, "cut at {length}: {error}");
            }
            Err(other) => panic!("cut at {length}: {other}"),
        }
    }
    assert!(replayed >= 15, "{replayed}");
}
