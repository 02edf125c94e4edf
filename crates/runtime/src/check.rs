//! Validation of files.

use std::path::Path;

use alula_record::{Recording, euroc, tum};
use alula_sim::world::{TrackConfig, World, WorldConfig};

use crate::scenario::read_text;
use crate::{RunError, Scenario};

/// What a good file holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Kind and size in a phrase.
    pub what: String,
    /// More lines; oddities that do not prevent its use among them.
    pub details: Vec<String>,
}

/// Validates a file or folder by its kind.
///
/// # Errors
/// When it cannot be used, with place, finding and remedy.
pub fn check(path: &Path, overrides: &[String]) -> Result<Finding, RunError> {
    if path.is_dir() {
        return check_euroc(path);
    }
    match path.extension().and_then(|e| e.to_str()) {
        Some("toml") => check_scenario(path, overrides),
        Some("mcap") => check_recording(path),
        Some("tum" | "txt") => check_trajectory(path),
        Some("csv") => check_csv(path),
        _ => Err(RunError::Input {
            what: path.display().to_string(),
            finding: "not a kind of file that alula reads".into(),
            remedy: "Kinds are .toml, .mcap, .tum, .txt, .csv and EuRoC folders".into(),
        }),
    }
}

fn check_scenario(path: &Path, overrides: &[String]) -> Result<Finding, RunError> {
    let scenario = Scenario::load(Some(path), overrides)?;
    let world = scenario.build_world(1)?;
    let config = scenario.config();
    Ok(Finding {
        what: format!(
            "scenario `{}`: {} waypoints, {} obstacles",
            config.name,
            config.mission.waypoints_m.len(),
            world.obstacles().len()
        ),
        details: Vec::new(),
    })
}

fn check_recording(path: &Path) -> Result<Finding, RunError> {
    let summary = Recording::open(path)?.summary()?;
    let mut details: Vec<String> = summary
        .topics
        .iter()
        .map(|(name, topic)| format!("{name}: {} messages", topic.messages))
        .collect();
    details.extend(
        summary
            .damage
            .iter()
            .map(|damage| format!("not whole: {damage}")),
    );
    Ok(Finding {
        what: format!(
            "recording of `{}` (seed {}), {:.1} s, alula {}",
            summary.header.scenario_name,
            summary.header.seed,
            summary.duration_s(),
            summary.header.version
        ),
        details,
    })
}

fn check_trajectory(path: &Path) -> Result<Finding, RunError> {
    let poses = tum::read(path)?;
    Ok(Finding {
        what: format!("trajectory of {} poses", poses.len()),
        details: Vec::new(),
    })
}

fn check_csv(path: &Path) -> Result<Finding, RunError> {
    let name = path.display().to_string();
    let text = read_text(path)?;
    let tracks = vec![TrackConfig {
        file: name,
        ..TrackConfig::default()
    }];
    let config = WorldConfig {
        tracks,
        ..WorldConfig::default()
    };
    World::new(&config, 0, &|_| Ok(text.clone().into_bytes()))?;
    let rows = text.lines().count().saturating_sub(1);
    Ok(Finding {
        what: format!("tracks of people, {rows} places"),
        details: Vec::new(),
    })
}

fn check_euroc(path: &Path) -> Result<Finding, RunError> {
    let folder = euroc::Folder::open(path)?;
    let (imu, truth) = (folder.imu()?, folder.truth()?);
    folder.imu_facts()?;
    let warnings = imu.warnings.iter().chain(&truth.warnings);
    Ok(Finding {
        what: format!(
            "EuRoC folder: {} inertial samples, {} true poses",
            imu.samples.len(),
            truth.samples.len()
        ),
        details: warnings.map(ToString::to_string).collect(),
    })
}
