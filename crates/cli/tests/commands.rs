//! The program as its users and their scripts meet it: names, flags, keys, files, exit codes.

// Helpers fail as tests do, and print what they measure.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

/// A scenario that flies blind and fast.
const FIRST_FLIGHT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../scenarios/first-flight.toml"
);

/// A mission of a few metres, with few depth images.
const SHORT: [&str; 7] = [
    FIRST_FLIGHT,
    "--set",
    "mission.waypoints_m=[[1.0, 0.0, 1.3]]",
    "--set",
    "mission.hover_s=0.2",
    "--set",
    "simulation.sensors.depth.model.rate_hz=1.0",
];

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_alula"));
    command.args(arguments).current_dir(folder);
    command
}

fn alula(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().unwrap()
}

/// What a command prints that ends with exit code 0.
fn printed(folder: &Path, arguments: &[&str]) -> String {
    let output = alula(folder, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

fn printed_json(folder: &Path, arguments: &[&str]) -> Value {
    serde_json::from_str(&printed(folder, arguments)).unwrap()
}

/// Flies the short mission into a folder.
fn fly_short(folder: &Path, out: &str, seed: &str) -> String {
    let options = ["fly", "--out", out, "--seed", seed];
    printed(folder, &[&options[..], &SHORT].concat())
}

fn assert_number(object: &Value, pointer: &str) {
    let value = object.pointer(pointer);
    assert!(value.is_some_and(Value::is_number), "{pointer}: {value:?}");
}

#[test]
fn a_flight_prints_one_json_object_with_the_promised_keys() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["fly", "--json", "--no-record", "--seed", "7"];
    let summary = printed_json(folder.path(), &[&options[..], &SHORT].concat());
    assert_eq!(summary["outcome"], "reached");
    assert_eq!(summary["collisions"], 0);
    assert_eq!(summary["seed"], 7);
    assert_eq!(summary["version"], env!("CARGO_PKG_VERSION"));
    for pointer in [
        "/duration_s",
        "/path_length_m",
        "/max_speed_m_s",
        "/min_clearance_m",
        "/real_time_factor",
        "/estimation/position_rmse_m",
        "/estimation/velocity_rmse_m_s",
    ] {
        assert_number(&summary, pointer);
    }
    let timing = summary["timing_ms"].as_object().unwrap();
    for component in ["estimation", "guidance", "control", "guard", "simulation"] {
        assert!(timing.contains_key(component), "{timing:?}");
    }
    for component in timing.keys() {
        for figure in ["mean", "p50", "p75", "p99", "max"] {
            assert_number(&summary, &format!("/timing_ms/{component}/{figure}"));
        }
    }
}

#[test]
fn a_flight_without_record_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    printed(
        folder.path(),
        &[&["fly", "--no-record"][..], &SHORT].concat(),
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_flight_that_fails_ends_with_code_1_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let fails = |change: &str, outcome: &str| {
        let options = ["fly", "--json", "--no-record", "--set", change];
        let output = alula(folder.path(), &[&options[..], &SHORT].concat());
        assert_eq!(output.status.code(), Some(1), "{change}: {output:?}");
        let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(summary["outcome"], outcome, "{summary}");
        assert!(!summary["reason"].as_str().unwrap().is_empty());
    };
    fails("simulation.time_limit_s=5", "timeout");
    // The way leads through the fence, at which the guard holds and then lands.
    fails("stack.guard.fence.max_m=[0.5, 12.0, 6.0]", "aborted");
}

#[test]
fn a_collision_ends_with_code_1() {
    let folder = tempfile::tempdir().unwrap();
    // Straight through the cylinder at (2.5, 3.2).
    let output = alula(
        folder.path(),
        &[
            "fly",
            FIRST_FLIGHT,
            "--json",
            "--no-record",
            "--set",
            "mission.waypoints_m=[[5.0, 6.4, 1.3]]",
        ],
    );
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["outcome"], "collision");
    assert_eq!(summary["collisions"], 1);
}

#[test]
fn a_flight_leaves_recording_report_picture_and_figures() {
    let folder = tempfile::tempdir().unwrap();
    let text = fly_short(folder.path(), "out dir/a", "1");
    let out = folder.path().join("out dir/a");
    for name in ["flight.mcap", "report.html", "report.png"] {
        assert!(text.contains(name), "{name} is not named in: {text}");
    }
    check_report(&out);
    let summary: Value =
        serde_json::from_slice(&fs::read(out.join("summary.json")).unwrap()).unwrap();
    assert_eq!(summary["outcome"], "reached");
    assert!(
        fs::read(out.join("flight.mcap"))
            .unwrap()
            .starts_with(b"\x89MCAP0\r\n")
    );
}

/// Report and picture are there and are what their names say; the page needs nothing else.
fn check_report(out: &Path) {
    let png = fs::read(out.join("report.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG\r\n\x1a\n"));
    let html = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(html.contains("<svg") && html.contains("</html>"));
    for reference in ["src=\"http", "href=\"http", "<link", "@import"] {
        assert!(!html.contains(reference), "{reference}");
    }
}

#[test]
fn a_report_is_drawn_again_from_the_recording_alone() {
    let folder = tempfile::tempdir().unwrap();
    fly_short(folder.path(), "a", "1");
    let out = folder.path().join("a");
    for name in ["report.html", "report.png", "summary.json"] {
        fs::remove_file(out.join(name)).unwrap();
    }
    let text = printed(folder.path(), &["report", "a"]);
    assert!(text.contains("report.html"), "{text}");
    check_report(&out);
}

#[test]
fn a_report_on_many_flights_has_a_row_for_each() {
    let folder = tempfile::tempdir().unwrap();
    for seed in ["11", "12", "13"] {
        fly_short(folder.path(), &format!("many/{seed}"), seed);
    }
    printed(folder.path(), &["report", "many"]);
    let html = fs::read_to_string(folder.path().join("many/report.html")).unwrap();
    for part in [
        "seed 11",
        "seed 12",
        "seed 13",
        "3 of 3",
        "landing distance",
    ] {
        assert!(html.contains(part), "{part}");
    }
}

#[test]
fn replay_ends_with_0_without_and_with_1_with_a_difference() {
    let folder = tempfile::tempdir().unwrap();
    fly_short(folder.path(), "a", "1");
    let text = printed(folder.path(), &["replay", "a/flight.mcap"]);
    assert!(text.contains("no difference in"), "{text}");
    let changed = [
        "replay",
        "a/flight.mcap",
        "--set",
        "stack.control.yaw_gain_1_s=1.0",
    ];
    let output = alula(folder.path(), &changed);
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8(output.stdout).unwrap();
    for part in [
        "first difference at",
        "requested command",
        "recorded:",
        "replayed:",
    ] {
        assert!(text.contains(part), "{text}");
    }
    let output = alula(folder.path(), &[&changed[..], &["--json"]].concat());
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["first_difference"]["field"], "requested command");
}

#[test]
fn an_estimation_prints_one_json_object_with_the_promised_keys() {
    let folder = tempfile::tempdir().unwrap();
    fly_short(folder.path(), "a", "1");
    for estimator in ["flow-odometry", "pose-imu"] {
        let options = [
            "estimate",
            "a/flight.mcap",
            "--json",
            "--out",
            "e",
            "--estimator",
        ];
        let report = printed_json(folder.path(), &[&options[..], &[estimator]].concat());
        assert_eq!(report["estimator"], estimator);
        for pointer in [
            "/samples",
            "/completed_fraction",
            "/ate_rmse_m",
            "/rpe_rmse_m",
            "/scale_error",
            "/orientation_rmse_deg",
            "/velocity_rmse_m_s",
            "/final_error_m",
            "/timing_ms/p50",
            "/timing_ms/max",
        ] {
            assert_number(&report, pointer);
        }
    }
    for name in ["estimate.tum", "truth.tum"] {
        let text = printed(folder.path(), &["check", &format!("e/{name}")]);
        assert!(text.contains("trajectory of"), "{text}");
    }
}

#[test]
fn every_kind_of_file_is_checked() {
    let folder = tempfile::tempdir().unwrap();
    fly_short(folder.path(), "a", "1");
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/first-flight.toml");
    fs::copy(scenario, folder.path().join("first.toml")).unwrap();
    fs::write(
        folder.path().join("walk.csv"),
        "t_s,id,x_m,y_m\n0.0,1,2.0,3.0\n1.0,1,2.0,4.0\n",
    )
    .unwrap();
    fs::write(
        folder.path().join("path.tum"),
        "0.0 0 0 0 0 0 0 1\n0.1 1 0 0 0 0 0 1\n",
    )
    .unwrap();
    let files = ["first.toml", "a/flight.mcap", "walk.csv", "path.tum"];
    let text = printed(folder.path(), &[&["check"][..], &files].concat());
    for part in [
        "first.toml: scenario `first-flight`: 10 waypoints",
        "a/flight.mcap: recording of `first-flight` (seed 1)",
        "walk.csv: tracks of people, 2 places",
        "path.tum: trajectory of 2 poses",
    ] {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    assert!(!text.contains("not whole"), "{text}");
}

#[test]
fn every_command_explains_itself() {
    let folder = tempfile::tempdir().unwrap();
    let overview = printed(folder.path(), &["--help"]);
    for name in ["fly", "replay", "estimate", "check", "report"] {
        assert!(overview.contains(&format!("\n  {name} ")), "{overview}");
        let text = printed(folder.path(), &[name, "--help"]);
        assert!(text.contains("Usage: alula"), "{text}");
        assert!(text.len() > 200, "{text}");
    }
    assert!(printed(folder.path(), &["--version"]).contains(env!("CARGO_PKG_VERSION")));
}

/// The override that the help shows.
#[test]
fn the_override_in_the_help_is_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let help = printed(folder.path(), &["--help"]);
    let example = "simulation.wind.mean_m_s=[2,0,0]";
    assert!(help.contains(example), "{help}");
    let options = ["fly", "--no-record", "--seed", "7", "--set", example];
    printed(folder.path(), &[&options[..], &SHORT].concat());
}

/// A recording that is being written has whole chunks when it is longer than this, bytes.
const WELL_UNDER_WAY: u64 = 3_000_000;

/// The program is killed with SIGKILL, which it cannot answer, in the middle of a long flight.
#[test]
fn a_killed_flight_leaves_a_recording_up_to_its_last_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let mut flight = command(
        folder.path(),
        &[
            "fly",
            FIRST_FLIGHT,
            "--json",
            "--out",
            "a",
            "--set",
            "mission.hover_s=600",
            "--set",
            "simulation.time_limit_s=7200",
        ],
    )
    .stdout(Stdio::null())
    .spawn()
    .unwrap();
    let file = folder.path().join("a/flight.mcap");
    let patience = Instant::now() + Duration::from_secs(60);
    while fs::metadata(&file).map_or(0, |m| m.len()) < WELL_UNDER_WAY {
        assert!(Instant::now() < patience, "the recording does not grow");
        assert_eq!(flight.try_wait().unwrap(), None, "the flight is over");
        std::thread::yield_now();
    }
    flight.kill().unwrap();
    assert_eq!(flight.wait().unwrap().code(), None);

    let text = printed(folder.path(), &["check", "a/flight.mcap"]);
    println!("{text}");
    assert!(text.contains("not whole: truncated at byte"), "{text}");
    assert!(text.contains("read up to t = "), "{text}");
    let text = printed(folder.path(), &["replay", "a/flight.mcap"]);
    assert!(text.contains("no difference in"), "{text}");
    printed(folder.path(), &["report", "a"]);
    check_report(&folder.path().join("a"));
}
