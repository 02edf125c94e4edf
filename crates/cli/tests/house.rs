//! The rules of the house that a compiler does not check: see ARCHITECTURE.md.

// Helpers of tests may fail like tests do.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Layer of every crate, lowest first. A crate may use only crates of lower layers.
const LAYERS: [(u32, &[&str]); 6] = [
    (0, &["geometry", "parameters", "optim"]),
    (1, &["messages"]),
    (
        2,
        &["estimation", "perception", "planning", "control", "safety"],
    ),
    (3, &["stack", "sim", "record"]),
    (4, &["runtime"]),
    (5, &["cli"]),
];

/// What must not appear in the source of layers 0 to 3.
const OUTSIDE_WORLD: [&str; 7] = [
    "std::fs",
    "std::net",
    "std::thread",
    "std::process",
    "std::env",
    "Instant::now",
    "SystemTime",
];

fn crates_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap()
        .to_path_buf()
}

fn layers() -> BTreeMap<String, u32> {
    LAYERS
        .iter()
        .flat_map(|(layer, names)| names.iter().map(|name| (format!("alula-{name}"), *layer)))
        .collect()
}

fn crate_names() -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(crates_folder())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// Our own crates that `name` uses outside its tests.
fn own_dependencies(name: &str) -> Vec<String> {
    let manifest = fs::read_to_string(crates_folder().join(name).join("Cargo.toml")).unwrap();
    manifest
        .split("\n[")
        .filter(|table| table.starts_with("dependencies]"))
        .flat_map(str::lines)
        .filter_map(|line| line.split(['.', ' ', '=']).next())
        .filter(|key| key.starts_with("alula-"))
        .map(str::to_owned)
        .collect()
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn every_crate_has_a_layer() {
    let known = layers();
    for name in crate_names() {
        assert!(
            known.contains_key(&format!("alula-{name}")),
            "`{name}` has no layer"
        );
    }
}

#[test]
fn crates_use_only_lower_layers() {
    let known = layers();
    for name in crate_names() {
        let own = known[&format!("alula-{name}")];
        for used in own_dependencies(&name) {
            assert!(known[&used] < own, "`{name}` (layer {own}) uses `{used}`");
        }
    }
}

#[test]
fn nothing_below_the_runtime_touches_the_outside_world() {
    let known = layers();
    for name in crate_names() {
        // Recordings are files: `record` opens those it is given, and nothing else.
        if known[&format!("alula-{name}")] >= 4 || name == "record" {
            continue;
        }
        for path in sources(&crates_folder().join(&name).join("src")) {
            let text = fs::read_to_string(&path).unwrap();
            let code = text.split("#[cfg(test)]").next().unwrap();
            for word in OUTSIDE_WORLD {
                assert!(!code.contains(word), "{} uses {word}", path.display());
            }
        }
    }
}

#[test]
fn frames_of_aviation_stay_in_the_link() {
    for name in crate_names().iter().filter(|n| *n != "link") {
        for path in sources(&crates_folder().join(name).join("src")) {
            let text = fs::read_to_string(&path).unwrap();
            let found = text.lines().find(|line| {
                let code = line.split("//").next().unwrap_or("");
                code.contains("_ned") || code.contains("_frd")
            });
            assert!(
                found.is_none(),
                "{}: {}",
                path.display(),
                found.unwrap_or_default()
            );
        }
    }
}
