//! Campaigns as their users and their job schedulers meet them: rows, resuming, sharding, merging.

// Helpers fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use serde_json::Value;
use tempfile::TempDir;

/// The scenario that flies blind through waypoints.
const FIRST_FLIGHT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../scenarios/first-flight.toml"
);

/// A mission of a metre, without images.
const SHORT: [&str; 6] = [
    "--set",
    "mission.waypoints_m=[[1.0, 0.0, 1.3]]",
    "--set",
    "mission.hover_s=0.2",
    "--set",
    "simulation.sensors.depth=",
];

type Rows = BTreeMap<u64, BTreeMap<String, Value>>;

fn alula(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_alula"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Runs a campaign of the short mission; it must end with the code.
fn fly_short(folder: &Path, options: &[&str], code: i32) -> Output {
    let arguments = [&["campaign", FIRST_FLIGHT], options, &SHORT].concat();
    let output = alula(folder, &arguments);
    assert_eq!(output.status.code(), Some(code), "{options:?}: {output:?}");
    output
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What is said when a command is refused.
fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = alula(folder, arguments);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(output.stdout.is_empty(), "{output:?}");
    String::from_utf8(output.stderr).unwrap()
}

fn rows_text(campaign: &Path) -> String {
    fs::read_to_string(campaign.join("rows.jsonl")).unwrap()
}

/// All that does not depend on the machine, by seed.
fn rows(campaign: &Path) -> Rows {
    let mut found = Rows::new();
    for line in rows_text(campaign).lines() {
        let mut row: BTreeMap<String, Value> = serde_json::from_str(line).unwrap();
        row.retain(|key, _| !key.starts_with("timing_ms.") && key != "real_time_factor");
        let seed = row["seed"].as_u64().unwrap();
        assert!(found.insert(seed, row).is_none(), "seed {seed} twice");
    }
    found
}

/// A campaign of the seeds 11 to 16, flown once for all tests of this file.
fn six_flights() -> &'static Path {
    static FLOWN: OnceLock<PathBuf> = OnceLock::new();
    FLOWN.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("six-flights");
        // What an earlier run of the tests left.
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        let options = [
            "--runs",
            "6",
            "--first-seed",
            "11",
            "--jobs",
            "2",
            "--out",
            "c",
        ];
        fly_short(&folder, &options, 0);
        folder
    })
}

/// A copy of it to work on: the folder that holds it as `c`.
fn copy_of_six_flights() -> TempDir {
    let copy = tempfile::tempdir().unwrap();
    fs::create_dir(copy.path().join("c")).unwrap();
    for entry in fs::read_dir(six_flights().join("c")).unwrap() {
        let from = entry.unwrap().path();
        fs::copy(&from, copy.path().join("c").join(from.file_name().unwrap())).unwrap();
    }
    copy
}

#[test]
fn a_campaign_prints_one_json_object_with_the_promised_keys() {
    let copy = copy_of_six_flights();
    let summary = json(&fly_short(copy.path(), &["--json", "--out", "c"], 0));
    assert_eq!(summary["runs"], 6);
    assert_eq!(summary["reached"], 6);
    assert_eq!(summary["collisions"], 0);
    assert_eq!(summary["success_rate"], 1.0);
    // Clopper and Pearson without a failure: 0.025^(1/6).
    let low = summary["success_rate_ci95"][0].as_f64().unwrap();
    assert!((low - 0.025_f64.powf(1.0 / 6.0)).abs() < 1e-9, "{low}");
    assert_eq!(summary["success_rate_ci95"][1], 1.0);
    assert_eq!(summary["failures"], serde_json::json!({}));
    assert_eq!(summary["first_seed"], 11);
    assert_eq!(summary["scenario"], "first-flight");
    assert_eq!(summary["version"], env!("CARGO_PKG_VERSION"));
    for pointer in [
        "/min_clearance_m/min",
        "/min_clearance_m/p01",
        "/min_clearance_m/p50",
        "/timing_ms/control/mean",
        "/timing_ms/control/p99",
        "/timing_ms/control/max",
    ] {
        assert!(summary.pointer(pointer).unwrap().is_number(), "{pointer}");
    }
}

#[test]
fn the_table_has_one_line_a_flight_in_the_order_of_seeds() {
    let table = fs::read_to_string(six_flights().join("c/flights.csv")).unwrap();
    let mut lines = table.lines();
    assert!(lines.next().unwrap().starts_with("seed,outcome,failure,"));
    let seeds: Vec<&str> = lines.map(|line| line.split(',').next().unwrap()).collect();
    assert_eq!(seeds, ["11", "12", "13", "14", "15", "16"]);
}

#[test]
fn rows_do_not_depend_on_the_number_of_jobs() {
    let folder = tempfile::tempdir().unwrap();
    let options = [
        "--runs",
        "6",
        "--first-seed",
        "11",
        "--jobs",
        "1",
        "--out",
        "one",
    ];
    fly_short(folder.path(), &options, 0);
    let one = rows(&folder.path().join("one"));
    assert_eq!(one.len(), 6);
    assert_eq!(one, rows(&six_flights().join("c")));
}

#[test]
fn a_killed_campaign_goes_on_without_losing_or_repeating_a_flight() {
    let copy = copy_of_six_flights();
    let campaign = copy.path().join("c");
    let text = rows_text(&campaign);
    let whole: usize = text.split_inclusive('\n').take(3).map(str::len).sum();
    fs::write(campaign.join("rows.jsonl"), &text[..whole + 40]).unwrap();
    // Nothing but the folder is needed.
    let output = alula(copy.path(), &["campaign", "--out", "c"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(rows_text(&campaign).starts_with(&text[..whole]));
    assert_eq!(rows(&campaign), rows(&six_flights().join("c")));
}

#[test]
fn a_campaign_that_is_over_flies_nothing() {
    let copy = copy_of_six_flights();
    let before = rows_text(&copy.path().join("c"));
    fly_short(copy.path(), &["--runs", "6", "--out", "c"], 0);
    assert_eq!(rows_text(&copy.path().join("c")), before);
}

#[test]
fn a_campaign_grows_by_further_seeds() {
    let copy = copy_of_six_flights();
    let before = rows_text(&copy.path().join("c"));
    fly_short(copy.path(), &["--runs", "7", "--out", "c"], 0);
    let after = rows_text(&copy.path().join("c"));
    let added: Value = serde_json::from_str(after.strip_prefix(&before).unwrap()).unwrap();
    assert_eq!(added["seed"], 17);
}

#[test]
fn merged_shards_are_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    for (shard, out) in [("0/2", "even"), ("1/2", "odd")] {
        let options = [
            "--runs",
            "6",
            "--first-seed",
            "11",
            "--shard",
            shard,
            "--out",
            out,
        ];
        fly_short(folder.path(), &options, 0);
    }
    let arguments = [
        "campaign", "--merge", "even", "odd", "--out", "all", "--json",
    ];
    let output = alula(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(json(&output)["runs"], 6);
    assert_eq!(
        rows(&folder.path().join("all")),
        rows(&six_flights().join("c"))
    );
}

#[test]
fn shards_may_share_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let options = [
        "--runs",
        "3",
        "--first-seed",
        "11",
        "--json",
        "--out",
        "all",
        "--shard",
    ];
    let part = |shard| {
        json(&fly_short(
            folder.path(),
            &[&options[..], &[shard]].concat(),
            0,
        ))
    };
    assert_eq!(part("0/2")["missing"], 1);
    assert_eq!(part("1/2")["missing"], 0);
    let table = fs::read_to_string(folder.path().join("all/flights.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 3);
}

#[test]
fn parts_of_different_campaigns_do_not_merge() {
    let copy = copy_of_six_flights();
    fly_short(copy.path(), &["--runs", "1", "--out", "other"], 0);
    let message = refusal(
        copy.path(),
        &["campaign", "--merge", "c", "other", "--out", "all"],
    );
    assert!(
        message.contains("other: its first seed is 1, not 11"),
        "{message}"
    );
    assert!(!copy.path().join("all").exists());
}

#[test]
fn a_row_flies_again_the_same_with_a_recording() {
    let copy = copy_of_six_flights();
    let arguments = ["campaign", "--refly", "13", "--out", "c", "--json"];
    let output = alula(copy.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(json(&output)["same"], true);
    for file in ["flight.mcap", "report.html", "report.png", "summary.json"] {
        let path = copy.path().join("c/seed-13").join(file);
        assert!(path.is_file(), "{}", path.display());
    }
}

#[test]
fn a_row_that_is_not_the_flight_is_found_out() {
    let copy = copy_of_six_flights();
    let path = copy.path().join("c/rows.jsonl");
    let text = rows_text(&copy.path().join("c"));
    fs::write(path, text.replace("\"duration_s\":", "\"duration_s\":1")).unwrap();
    let output = alula(
        copy.path(),
        &["campaign", "--refly", "13", "--out", "c", "--json"],
    );
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let differences = json(&output)["differences"].clone();
    assert_eq!(differences.as_array().unwrap().len(), 1, "{differences}");
    assert_eq!(differences[0]["column"], "duration_s");
}

#[test]
fn failures_are_counted_and_end_with_code_1() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["--runs", "2", "--json", "--out", "c"];
    let late = ["--set", "simulation.time_limit_s=2"];
    let summary = json(&fly_short(
        folder.path(),
        &[&options[..], &late].concat(),
        1,
    ));
    assert_eq!(
        (&summary["runs"], &summary["reached"]),
        (&2.into(), &0.into())
    );
    let failures = summary["failures"].as_object().unwrap();
    assert_eq!(failures.values().filter_map(Value::as_u64).sum::<u64>(), 2);
}

#[test]
fn another_campaign_in_the_folder_is_refused() {
    let copy = copy_of_six_flights();
    let check = |options: &[&str], part: &str| {
        let start = ["campaign", FIRST_FLIGHT, "--out", "c"];
        let arguments = [&start[..], options, &SHORT].concat();
        let message = refusal(copy.path(), &arguments);
        assert!(message.contains(part), "`{part}` is not in: {message}");
        assert!(message.contains("--out DIR"), "{message}");
    };
    check(
        &["--set", "simulation.mass_factor=1.1"],
        "`simulation.mass_factor` was 1.04 and is now 1.1",
    );
    check(&["--first-seed", "1"], "first seed is 11");
    check(&["--runs", "5"], "6 flights, which cannot shrink");
}

#[test]
fn what_cannot_be_flown_is_refused_before_a_folder_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let in_the_box = ["--set", "mission.waypoints_m=[[5.0, 0.0, 0.6]]"];
    let options = ["campaign", FIRST_FLIGHT, "--runs", "3", "--out", "c"];
    let message = refusal(folder.path(), &[&options[..], &in_the_box].concat());
    assert!(message.contains("waypoint 1"), "{message}");
    let message = refusal(folder.path(), &["campaign", "--out", "c"]);
    assert!(message.contains("--runs N"), "{message}");
    let message = refusal(folder.path(), &["campaign", "--refly", "1", "--out", "c"]);
    assert!(message.contains("holds no campaign"), "{message}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_scenario_changed_by_hand_is_refused() {
    let copy = copy_of_six_flights();
    let path = copy.path().join("c/scenario.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(
        &path,
        text.replace("mass_factor = 1.04", "mass_factor = 1.0"),
    )
    .unwrap();
    let message = refusal(copy.path(), &["campaign", "--out", "c"]);
    assert!(message.contains("scenario.toml"), "{message}");
}
