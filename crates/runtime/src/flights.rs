//! Many flights: the figures that each left in its folder.

use std::fs;
use std::path::Path;

use serde::Deserialize;

use crate::RunError;
use crate::scenario::read_text;

/// One flight as a row of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightRow {
    /// Seed.
    pub seed: u64,
    /// How it ended.
    pub outcome: String,
    /// Simulated time, s.
    pub duration_s: f64,
    /// True length of the path, m.
    pub path_length_m: f64,
    /// True horizontal distance from the take-off point at the end, m.
    pub landing_distance_m: f64,
    /// Error of the position estimate, RMSE, m.
    pub position_rmse_m: f64,
    /// Error of the velocity estimate, RMSE, m/s.
    pub velocity_rmse_m_s: f64,
    /// Least true distance to the nearest thing, m.
    pub min_clearance_m: Option<f64>,
    /// Simulated over real time.
    pub real_time_factor: f64,
}

/// The part of a summary file that makes a row.
#[derive(Deserialize)]
struct SummaryFile {
    seed: u64,
    outcome: String,
    duration_s: f64,
    path_length_m: f64,
    landing_distance_m: f64,
    min_clearance_m: Option<f64>,
    real_time_factor: f64,
    estimation: Errors,
}

#[derive(Deserialize)]
struct Errors {
    position_rmse_m: f64,
    velocity_rmse_m_s: f64,
}

/// The flights in the folders below a folder, by seed.
///
/// # Errors
/// When there is none, or a summary cannot be read.
pub fn read_rows(folder: &Path) -> Result<Vec<FlightRow>, RunError> {
    let read_error = |source| RunError::Read {
        path: folder.to_path_buf(),
        source,
    };
    let mut rows = Vec::new();
    for entry in fs::read_dir(folder).map_err(read_error)? {
        let file = entry.map_err(read_error)?.path().join("summary.json");
        if file.is_file() {
            rows.push(read_row(&file)?);
        }
    }
    if rows.is_empty() {
        return Err(RunError::Input {
            what: folder.display().to_string(),
            finding: "holds neither flight.mcap nor folders with summary.json".into(),
            remedy: "Fly first: alula fly --out DIR".into(),
        });
    }
    rows.sort_by_key(|row| row.seed);
    Ok(rows)
}

fn read_row(file: &Path) -> Result<FlightRow, RunError> {
    let summary: SummaryFile =
        serde_json::from_str(&read_text(file)?).map_err(|error| RunError::Input {
            what: file.display().to_string(),
            finding: error.to_string(),
            remedy: "Fly again to write it anew".into(),
        })?;
    Ok(FlightRow {
        seed: summary.seed,
        outcome: summary.outcome,
        duration_s: summary.duration_s,
        path_length_m: summary.path_length_m,
        landing_distance_m: summary.landing_distance_m,
        position_rmse_m: summary.estimation.position_rmse_m,
        velocity_rmse_m_s: summary.estimation.velocity_rmse_m_s,
        min_clearance_m: summary.min_clearance_m,
        real_time_factor: summary.real_time_factor,
    })
}
