//! EuRoC folders: a made one with all that can be wrong, and the real one.

// Helpers fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use std::path::{Path, PathBuf};

use alula_record::RecordError;
use alula_record::euroc::{Folder, Warning};

const SENSOR: &str = "%YAML:1.0\n# T_BS: no\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0.0, -1.0, 0.0, 0.1,\n\
    1.0, 0.0, 0.0, 0.2,\n 0.0, 0.0, 1.0, 0.3,\n 0.0, 0.0, 0.0, 1.0]\nrate_hz: 200\n\
    gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]\n\
    gyroscope_random_walk: 1.9393e-05\naccelerometer_noise_density: 2.0000e-3\n\
    accelerometer_random_walk: 3.0000e-3\n";
const IMU: &str = "#timestamp [ns],w,w,w,a,a,a\n100,1,2,3,4,5,6\n200,1.5,2,3,4,5,6\n";
const TRUTH: &str = "#timestamp\n100,1,2,3,1,0,0,0,4,5,6,7,8,9,10,11,12\n";

struct Made {
    folder: tempfile::TempDir,
}

impl Made {
    fn new() -> Self {
        let made = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        made.put("imu0/data.csv", IMU);
        made.put("imu0/sensor.yaml", SENSOR);
        made.put("state_groundtruth_estimate0/data.csv", TRUTH);
        made
    }

    fn with(file: &str, text: &str) -> Self {
        let made = Self::new();
        made.put(file, text);
        made
    }

    fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join("mav0").join(file)
    }

    fn put(&self, file: &str, text: &str) {
        let path = self.path(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn open(&self) -> Folder {
        Folder::open(self.folder.path()).unwrap()
    }
}

fn check_message<T: std::fmt::Debug>(result: Result<T, RecordError>, parts: &[&str]) {
    let message = result.unwrap_err().to_string();
    for part in parts {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}

fn check_imu(text: &str, parts: &[&str]) {
    check_message(Made::with("imu0/data.csv", text).open().imu(), parts);
}

#[test]
fn columns_are_what_the_format_says() {
    let made = Made::new();
    let imu = made.open().imu().unwrap();
    assert!(imu.warnings.is_empty());
    assert_eq!(imu.samples[1].time.as_ns(), 200);
    assert_eq!(imu.samples[1].angular_rate.x, 1.5);
    assert_eq!(imu.samples[1].specific_force.z, 6.0);
    let truth = made.open().truth().unwrap().samples[0];
    assert_eq!(truth.world_from_imu.translation.z, 3.0);
    assert_eq!(truth.velocity_world.x, 4.0);
    assert_eq!(truth.gyroscope_bias.y, 8.0);
    assert_eq!(truth.accelerometer_bias.z, 12.0);
}

#[test]
fn the_sensor_description_is_read() {
    let facts = Made::new().open().imu_facts().unwrap();
    assert_eq!(facts.rate_hz, 200.0);
    assert_eq!(facts.gyroscope_noise_rad_s_sqrt_hz, 1.6968e-4);
    assert_eq!(facts.gyroscope_random_walk_rad_s2_sqrt_hz, 1.9393e-5);
    assert_eq!(facts.accelerometer_noise_m_s2_sqrt_hz, 2e-3);
    assert_eq!(facts.accelerometer_random_walk_m_s3_sqrt_hz, 3e-3);
    assert_eq!(facts.body_from_imu.translation.y, 0.2);
    let x = facts.body_from_imu.rotation * nalgebra::Vector3::x();
    assert!((x - nalgebra::Vector3::y()).norm() < 1e-12);
}

#[test]
fn the_folder_may_be_mav0_or_contain_it() {
    let made = Made::new();
    assert!(Folder::open(made.path("")).unwrap().imu().is_ok());
    let empty = tempfile::tempdir().unwrap();
    check_message(Folder::open(empty.path()), &["imu0", "contains `mav0`"]);
}

#[test]
fn a_missing_file_is_named_with_its_remedy() {
    let made = Made::new();
    std::fs::remove_file(made.path("state_groundtruth_estimate0/data.csv")).unwrap();
    check_message(
        made.open().truth(),
        &[
            "EuRoC folder without truth",
            "state_groundtruth_estimate0",
            "does not exist; give",
        ],
    );
    std::fs::remove_file(made.path("imu0/sensor.yaml")).unwrap();
    check_message(made.open().imu_facts(), &["sensor.yaml", "copy"]);
}

#[test]
fn malformed_lines_are_named_with_their_finding() {
    check_imu(
        "100,1,2,3,4,5,6\n200,1,2\n",
        &["data.csv", "line 2", "3 columns instead of 7"],
    );
    check_imu("#\n100,1,2,x,4,5,6\n", &["line 2", "column 4 is `x`"]);
    check_imu("#\n100,1,2,inf,4,5,6\n", &["line 2", "column 4 is `inf`"]);
    check_imu("1e2,1,2,3,4,5,6\n", &["line 1", "nanoseconds"]);
    check_imu("#timestamp\n", &["holds no IMU samples"]);
    let truth = TRUTH.replace("1,0,0,0", "1,1,0,0");
    let made = Made::with("state_groundtruth_estimate0/data.csv", &truth);
    check_message(made.open().truth(), &["line 2", "quaternion"]);
}

#[test]
fn bytes_that_are_not_text_are_named_with_their_line() {
    let made = Made::new();
    std::fs::write(made.path("imu0/data.csv"), b"#\n100,1,2,3,4,5,6\n2\xff0,").unwrap();
    check_message(made.open().imu(), &["line 3", "not text"]);
}

#[test]
fn times_that_go_backwards_are_named_with_both_lines() {
    let text = "#\n100,1,2,3,4,5,6\n300,1,2,3,4,5,6\n200,1,2,3,4,5,6\n";
    check_imu(text, &["line 4", "200 ns", "300 ns", "line 3", "sort"]);
}

#[test]
fn duplicates_are_left_out_and_reported() {
    let made = Made::with(
        "imu0/data.csv",
        "#\n100,1,2,3,4,5,6\n100,9,9,9,9,9,9\n200,1,2,3,4,5,6\n",
    );
    let imu = made.open().imu().unwrap();
    assert_eq!(imu.samples.len(), 2);
    assert_eq!(imu.samples[0].angular_rate.x, 1.0);
    let [
        warning @ Warning::Duplicate {
            line: 3,
            kept_line: 2,
            ..
        },
    ] = imu.warnings.as_slice()
    else {
        panic!("{:?}", imu.warnings);
    };
    assert!(warning.to_string().contains("line 3"), "{warning}");
}

#[test]
fn a_file_that_breaks_off_is_read_up_to_the_break() {
    for cut in [1, 3, 8] {
        let made = Made::with("imu0/data.csv", &IMU[..IMU.len() - cut]);
        let imu = made.open().imu().unwrap();
        assert_eq!(imu.samples.len(), 1);
        assert!(matches!(
            imu.warnings[..],
            [Warning::CutOff { line: 3, .. }]
        ));
    }
}

#[test]
fn a_bad_sensor_description_is_named_with_its_key() {
    let check = |from: &str, to: &str, parts: &[&str]| {
        let text = SENSOR.replace(from, to);
        assert_ne!(text, SENSOR);
        check_message(
            Made::with("imu0/sensor.yaml", &text).open().imu_facts(),
            parts,
        );
    };
    check("rate_hz", "rate", &["sensor.yaml", "`rate_hz`", "missing"]);
    check("rate_hz: 200", "rate_hz: fast", &["`rate_hz`", "`fast`"]);
    check(
        "2.0000e-3",
        "-1",
        &["`accelerometer_noise_density`", "`-1`"],
    );
    check(
        "0.0, -1.0, 0.0, 0.1",
        "0.0, 1.0, 0.0, 0.1",
        &["`T_BS`", "rotation"],
    );
    check("0.0, -1.0, 0.0, 0.1,", "", &["`T_BS`", "12 numbers"]);
}

/// The folder with real recordings, if it is there.
fn real_data() -> Option<PathBuf> {
    let folder = std::env::var_os("ALULA_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: ALULA_DATA does not name a folder with real recordings");
    }
    folder
}

fn real_flight(data: &Path) -> Folder {
    Folder::open(data.join("euroc_v1_01")).unwrap()
}

#[test]
fn the_real_flight_has_all_its_inertial_samples() {
    let Some(data) = real_data() else { return };
    let imu = real_flight(&data).imu().unwrap();
    assert!(imu.warnings.is_empty());
    assert_eq!(imu.samples.len(), 29_120);
    let (first, last) = (imu.samples[0], imu.samples[imu.samples.len() - 1]);
    // Samples at 200 Hz.
    assert!((last.time.seconds_since(first.time) - 145.595).abs() < 1e-3);
    // The first line of the file.
    assert_eq!(first.time.as_ns(), 1_403_715_273_262_142_976);
    assert_eq!(first.angular_rate.y, 0.017453292519943295);
    assert_eq!(first.specific_force.x, 9.0874956666666655);
}

#[test]
fn the_real_flight_has_its_truth() {
    let Some(data) = real_data() else { return };
    let truth = real_flight(&data).truth().unwrap();
    // The second line of the file.
    let sample = truth.samples[1];
    assert_eq!(sample.time.as_ns(), 1_403_715_273_312_143_104);
    assert_eq!(sample.world_from_imu.translation.y, 2.18348);
    assert_eq!(sample.velocity_world.z, -0.00147218);
    assert_eq!(sample.gyroscope_bias.z, 0.0770299);
    assert_eq!(sample.accelerometer_bias.x, -0.0180079);
    // Six digits of a quaternion.
    assert!((sample.world_from_imu.rotation.i + 0.824253).abs() < 1e-5);
    let facts = real_flight(&data).imu_facts().unwrap();
    assert_eq!(facts.rate_hz, 200.0);
    assert_eq!(facts.body_from_imu, alula_geometry::Pose::identity());
}
