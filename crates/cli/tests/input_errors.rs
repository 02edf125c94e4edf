//! Bad input ends with exit code 2 and one message that names file, place, finding and remedy.

// Helpers fail as tests do, and print what they measure.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

/// A scenario that flies.
const GOOD: &str = include_str!("../../../scenarios/first-flight.toml");

fn alula(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_alula"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// The message of a refusal, which is all that is printed.
fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = alula(folder, arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    println!("$ alula {}\n{message}", arguments.join(" "));
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(output.stdout.is_empty(), "{:?}", output.stdout);
    assert!(message.starts_with("alula: "), "{message}");
    assert_eq!(message.matches("alula: ").count(), 1, "{message}");
    message
}

fn check_refusal(folder: &Path, arguments: &[&str], parts: &[&str]) {
    let message = refusal(folder, arguments);
    for part in parts {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}

/// A folder with `bad.toml`, the good scenario with one piece of text replaced.
fn with_scenario(from: &str, to: &str) -> TempDir {
    assert!(GOOD.contains(from), "{from}");
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("bad.toml"), GOOD.replacen(from, to, 1)).unwrap();
    folder
}

/// Line (from 1) of the good scenario that begins with `start`.
fn line_of(start: &str) -> usize {
    1 + GOOD.lines().position(|l| l.starts_with(start)).unwrap()
}

/// Refusal of a scenario, by every command that reads one.
fn check_scenario(from: &str, to: &str, parts: &[&str]) {
    let folder = with_scenario(from, to);
    check_refusal(folder.path(), &["check", "bad.toml"], parts);
    check_refusal(folder.path(), &["fly", "bad.toml", "--no-record"], parts);
}

#[test]
fn an_unknown_key_is_refused_with_its_line_and_the_nearest_name() {
    let line = format!("line {}", line_of("take_off_height_m"));
    check_scenario(
        "take_off_height_m",
        "takeoff_height_m",
        &[
            "bad.toml",
            &line,
            "`takeoff_height_m`",
            "did you mean `take_off_height_m`",
        ],
    );
}

#[test]
fn an_unknown_table_is_refused() {
    check_scenario(
        "[stack.modes]",
        "[stack.moods]",
        &["bad.toml", "`moods`", "`modes`"],
    );
}

#[test]
fn a_value_out_of_range_is_refused_with_its_line_and_the_range() {
    let place = format!("bad.toml:{}", line_of("max_speed_m_s"));
    check_scenario(
        "max_speed_m_s = 2.0",
        "max_speed_m_s = -2.0",
        &[
            &place,
            "`stack.guide.limits.max_speed_m_s` is -2",
            "allowed is ",
        ],
    );
}

#[test]
fn a_wrong_unit_suffix_is_answered_with_the_right_one() {
    let line = format!("line {}", line_of("max_speed_m_s"));
    check_scenario(
        "max_speed_m_s = 2.0",
        "max_speed_km_h = 7.2",
        &[
            "bad.toml",
            &line,
            "`max_speed_km_h`",
            "did you mean `max_speed_m_s`",
            "unit",
        ],
    );
}

#[test]
fn a_value_of_the_wrong_type_is_refused_with_its_line() {
    let line = format!("line {}", line_of("mass_factor"));
    check_scenario(
        "mass_factor = 1.04",
        "mass_factor = \"heavy\"",
        &["bad.toml", &line, "heavy"],
    );
}

#[test]
fn a_missing_fact_is_named() {
    check_scenario(
        "mass_kg = 2.064\n",
        "",
        &["bad.toml", "stack.body", "`mass_kg`"],
    );
}

#[test]
fn text_that_is_not_toml_is_refused_with_its_line() {
    let line = format!("line {}", line_of("mass_factor"));
    check_scenario(
        "mass_factor = 1.04",
        "mass_factor 1.04",
        &["bad.toml", &line],
    );
}

#[test]
fn an_unknown_preset_is_answered_with_the_list() {
    let place = format!("bad.toml:{}", line_of("preset"));
    check_scenario(
        "preset = \"quad_x500\"",
        "preset = \"quad_x5000\"",
        &[
            &place,
            "`simulation.preset` is quad_x5000",
            "bebop2, pelican, quad_x500",
        ],
    );
}

#[test]
fn an_unknown_estimator_is_answered_with_the_list() {
    let place = format!("bad.toml:{}", line_of("estimator"));
    check_scenario(
        "estimator = \"flow-odometry\"",
        "estimator = \"gps\"",
        &[
            &place,
            "`stack.estimation.estimator` is gps",
            "flow-odometry, pose-imu",
        ],
    );
}

#[test]
fn a_waypoint_inside_a_wall_is_refused_with_its_number() {
    check_scenario(
        "[3.5, 6.2, 1.5]",
        "[3.5, 8.5, 1.5]",
        &[
            "bad.toml",
            "waypoint 7",
            "(3.50, 8.50, 1.50)",
            "inside",
            "move it or the obstacle",
        ],
    );
}

#[test]
fn an_obstacle_on_the_pad_is_refused() {
    check_scenario(
        "centre_m = [1.5, -3.0, 0.5]",
        "centre_m = [0.0, 0.2, 0.5]",
        &["bad.toml", "the start", "move it or the obstacle"],
    );
}

#[test]
fn a_missing_scenario_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["check", "fly"] {
        check_refusal(
            folder.path(),
            &[command, "nowhere.toml"],
            &["nowhere.toml", "cannot be read", "check the name"],
        );
    }
}

#[test]
fn bad_overrides_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |argument: &str, parts: &[&str]| {
        check_refusal(
            folder.path(),
            &["fly", "--no-record", "--set", argument],
            parts,
        );
    };
    refused("mass", &["--set mass", "expected key=value"]);
    refused(
        "mission.waypoints_m[99].x=1",
        &["--set mission.waypoints_m[99].x=1", "no element 99"],
    );
    refused(
        "stack.guide.limits.max_speed_m_s=99",
        &[
            "--set",
            "`stack.guide.limits.max_speed_m_s` is 99",
            "allowed is ",
        ],
    );
    refused(
        "simulation.mass=2",
        &["--set", "`mass = 2`", "unknown field `mass`", "mass_factor"],
    );
    refused(
        "name.first=1",
        &["--set name.first=1", "`name` is not a table"],
    );
}

#[test]
fn an_unknown_option_or_command_ends_with_code_2() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        &["fly", "--sed", "7"][..],
        &["flyy"],
        &["fly", "--seed", "x"],
    ] {
        let output = alula(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(output.stdout.is_empty());
        assert!(!output.stderr.is_empty());
    }
}

#[test]
fn a_malformed_line_of_tracks_is_named_with_file_line_and_scenario() {
    let tracks = "[[world.tracks]]\nfile = \"walk.csv\"\n\n# Walks beside";
    let folder = with_scenario("# Walks beside", tracks);
    let csv = "t_s,id,x_m,y_m\n0.0,1,2.0,-9.0\n0.4,1,two,-9.0\n";
    fs::write(folder.path().join("walk.csv"), csv).unwrap();
    let parts = ["walk.csv:3", "`two`", "expected a finite number"];
    check_refusal(folder.path(), &["check", "walk.csv"], &parts);
    check_refusal(folder.path(), &["check", "bad.toml"], &parts);
    check_refusal(
        folder.path(),
        &["fly", "bad.toml", "--no-record"],
        &[&parts[..], &["bad.toml"]].concat(),
    );
}

#[test]
fn a_missing_file_of_tracks_is_named() {
    let tracks = "[[world.tracks]]\nfile = \"walk.csv\"\n\n# Walks beside";
    check_scenario(
        "# Walks beside",
        tracks,
        &["bad.toml", "`world.tracks[0].file`", "walk.csv"],
    );
}

#[test]
fn a_file_that_is_no_mcap_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("bad.mcap"), GOOD).unwrap();
    for command in ["check", "replay", "estimate"] {
        check_refusal(
            folder.path(),
            &[command, "bad.mcap"],
            &["bad.mcap", "not an MCAP file", "give a recording"],
        );
    }
}

#[test]
fn a_missing_recording_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["check", "replay", "estimate"] {
        check_refusal(
            folder.path(),
            &[command, "nowhere.mcap"],
            &["nowhere.mcap", "does not exist", "alula fly --out"],
        );
    }
    check_refusal(
        folder.path(),
        &["estimate", "nowhere"],
        &["nowhere", "no such file", "Name a EuRoC folder"],
    );
}

#[test]
fn a_file_of_an_unknown_kind_is_answered_with_the_kinds() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("notes.doc"), "x").unwrap();
    check_refusal(
        folder.path(),
        &["check", "notes.doc"],
        &["notes.doc", ".toml", ".mcap"],
    );
    check_refusal(
        folder.path(),
        &["estimate", "notes.doc"],
        &["notes.doc", "EuRoC", ".mcap"],
    );
}

#[test]
fn a_folder_without_flights_gives_no_report() {
    let folder = tempfile::tempdir().unwrap();
    check_refusal(
        folder.path(),
        &["report", "."],
        &["flight.mcap", "alula fly --out"],
    );
    check_refusal(
        folder.path(),
        &["report", "nowhere"],
        &["nowhere", "check the name"],
    );
}

const SENSOR_YAML: &str = "%YAML:1.0
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.6968e-04
gyroscope_random_walk: 1.9393e-05
accelerometer_noise_density: 2.0000e-3
accelerometer_random_walk: 3.0000e-3
";

/// A vehicle that stands for a second, in the layout of EuRoC.
fn euroc() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut imu = "#timestamp [ns],w,w,w,a,a,a\n".to_owned();
    let mut truth = "#timestamp, p, q, v, b_w, b_a\n".to_owned();
    for i in 0..200_u64 {
        let t_ns = 1_000_000_000 + 5_000_000 * i;
        imu += &format!("{t_ns},0.0,0.0,0.0,9.80665,0.0,0.0\n");
        truth += &format!("{t_ns},0,0,1,0.70710678,0,-0.70710678,0,0,0,0,0,0,0,0,0,0\n");
    }
    for (name, text) in [
        ("imu0/data.csv", imu.as_str()),
        ("imu0/sensor.yaml", SENSOR_YAML),
        ("state_groundtruth_estimate0/data.csv", truth.as_str()),
    ] {
        let path = inside(&folder, name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    folder
}

fn inside(folder: &TempDir, name: &str) -> PathBuf {
    folder.path().join("mav0").join(name)
}

/// Refusal of a EuRoC folder, by every command that reads one.
fn check_euroc(folder: &TempDir, parts: &[&str]) {
    for command in ["check", "estimate"] {
        check_refusal(folder.path(), &[command, "."], parts);
    }
}

#[test]
fn the_made_euroc_folder_is_good() {
    let output = alula(euroc().path(), &["check", "."]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}

#[test]
fn a_euroc_folder_without_truth_is_refused() {
    let folder = euroc();
    fs::remove_dir_all(inside(&folder, "state_groundtruth_estimate0")).unwrap();
    check_euroc(
        &folder,
        &[
            "without truth",
            "state_groundtruth_estimate0",
            "does not exist",
            "give a sequence with truth",
        ],
    );
}

#[test]
fn time_that_goes_backwards_is_refused_with_both_lines() {
    let folder = euroc();
    let path = inside(&folder, "imu0/data.csv");
    let text = fs::read_to_string(&path).unwrap();
    // Line 101 is sample 99, at 1.495 s.
    fs::write(&path, text.replacen("\n1495000000,", "\n1395000000,", 1)).unwrap();
    check_euroc(
        &folder,
        &[
            "data.csv`, line 101",
            "1395000000 ns is before 1490000000 ns of line 100",
            "sort the file by time",
        ],
    );
}

#[test]
fn a_malformed_line_of_inertial_data_is_refused_with_its_line() {
    let folder = euroc();
    let path = inside(&folder, "imu0/data.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(
        &path,
        text.replacen("\n1495000000,0.0", "\n1495000000,fast", 1),
    )
    .unwrap();
    check_euroc(&folder, &["imu0/data.csv`, line 101", "`fast`"]);
}

#[test]
fn a_description_without_noise_is_refused_with_its_key() {
    let folder = euroc();
    let text = SENSOR_YAML.replace("gyroscope_noise_density", "gyroscope_noise");
    fs::write(inside(&folder, "imu0/sensor.yaml"), text).unwrap();
    check_euroc(
        &folder,
        &["sensor.yaml", "`gyroscope_noise_density`", "it is missing"],
    );
}

#[test]
fn bad_options_of_an_estimation_are_refused() {
    let folder = euroc();
    let refused = |options: &[&str], parts: &[&str]| {
        check_refusal(
            folder.path(),
            &[&["estimate", "."], options].concat(),
            parts,
        );
    };
    refused(&["--estimator", "gps"], &["gps", "flow-odometry, pose-imu"]);
    refused(
        &["--set", "parameters.pose_imu.position_sigma_m=-1"],
        &["`parameters.pose_imu.position_sigma_m` is -1", "allowed is"],
    );
    refused(&["--pose-rate-hz=-1"], &["rate_hz", "-1", "allowed is"]);
    refused(&["--pose-loss", "2"], &["loss_share", "2", "allowed is"]);
    refused(&["--truth", "nowhere.tum"], &["nowhere.tum"]);
}

/// The beginning of a recording: it is read up to the break, and the break is told.
#[test]
fn a_truncated_recording_is_read_up_to_the_break() {
    let folder = tempfile::tempdir().unwrap();
    let fly = [
        "fly",
        concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../scenarios/first-flight.toml"
        ),
        "--json",
        "--out",
        "f",
        "--set",
        "mission.waypoints_m=[[1.0, 0.0, 1.3]]",
        "--set",
        "simulation.sensors.depth.model.rate_hz=1.0",
    ];
    assert_eq!(alula(folder.path(), &fly).status.code(), Some(0));
    let path = folder.path().join("f/flight.mcap");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
    for command in ["check", "replay"] {
        let output = alula(folder.path(), &[command, "f/flight.mcap"]);
        let text = String::from_utf8(output.stdout).unwrap();
        println!("{text}");
        assert_eq!(output.status.code(), Some(0), "{text}");
        for part in ["not whole: truncated at byte", "read up to t = "] {
            assert!(text.contains(part), "{text}");
        }
    }
    fs::write(&path, &bytes[..100]).unwrap();
    for command in ["check", "replay"] {
        check_refusal(
            folder.path(),
            &[command, "f/flight.mcap"],
            &["flight.mcap", "no readable record", "give a recording"],
        );
    }
}
