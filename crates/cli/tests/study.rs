//! Studies as their users and scripts meet them: the list, the files, the keys, the exit codes.

// Helpers fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn study(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_alula"))
        .arg("study")
        .args(arguments)
        .current_dir(folder)
        .env_remove("ALULA_DATA")
        .output()
        .unwrap()
}

fn printed_json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{output:?}"))
}

/// The message of a refusal.
fn refusal(arguments: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let output = study(folder.path(), arguments);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn without_a_name_the_studies_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let output = study(folder.path(), &["--json"]);
    assert_eq!(output.status.code(), Some(0));
    let list = printed_json(&output);
    let studies = list["studies"].as_array().unwrap();
    assert!(!studies.is_empty());
    let text = study(folder.path(), &[]).stdout;
    let text = String::from_utf8(text).unwrap();
    for study in studies {
        for key in ["study", "source", "about"] {
            let words = study[key].as_str().unwrap();
            assert!(text.contains(words), "{key} `{words}` is not in: {text}");
        }
    }
}

#[test]
fn a_study_leaves_its_rows_its_figures_and_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["chance-constraint", "--runs", "300", "--json"];
    let output = study(folder.path(), &arguments);
    let json = printed_json(&output);
    assert_eq!(json["study"], "chance-constraint");
    assert!(json["source"].as_str().unwrap().contains("document L"));
    assert_eq!(json["runs"], 300);
    let rows = json["rows"].as_array().unwrap();
    for row in rows {
        assert!(row["touch_probability"].is_number(), "{row}");
        assert!(row["theirs"]["touch_probability"].is_number(), "{row}");
    }
    let met = json["met"].as_bool().unwrap();
    assert_eq!(output.status.code(), Some(if met { 0 } else { 1 }));

    let out = folder.path().join("out/study-chance-constraint");
    let file = fs::read(out.join("summary.json")).unwrap();
    assert_eq!(serde_json::from_slice::<Value>(&file).unwrap(), json);
    let table = fs::read_to_string(out.join("rows.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + rows.len());
    assert!(table.starts_with("delta,"), "{table}");
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("<svg"));
}

#[test]
fn figures_depend_on_the_seed_and_not_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let rows = |options: [&str; 4]| {
        let arguments = [
            &["chance-constraint", "--runs", "600", "--json"],
            &options[..],
        ]
        .concat();
        printed_json(&study(folder.path(), &arguments))["rows"].clone()
    };
    let one = rows(["--seed", "1", "--jobs", "1"]);
    assert_eq!(one, rows(["--seed", "1", "--jobs", "3"]));
    assert_ne!(one, rows(["--seed", "2", "--jobs", "1"]));
}

#[test]
fn an_unknown_name_is_refused_with_those_that_there_are() {
    let message = refusal(&["obstacle-tracing"]);
    for part in ["obstacle-tracing", "obstacle-tracking", "chance-constraint"] {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}

#[test]
fn a_study_without_its_data_says_how_to_get_them() {
    let message = refusal(&["depth-office"]);
    for part in ["kinect_office", "ALULA_DATA", "7-Scenes"] {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}
