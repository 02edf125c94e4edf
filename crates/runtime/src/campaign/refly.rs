//! Flying one row of a campaign again, with a recording of everything.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use super::Campaign;
use super::row::{guarded, row_of};
use crate::flight::{self, Flight, Progress, RecordTo};
use crate::{RunError, make_folder};

/// A flight that was flown again.
#[derive(Clone, Debug)]
pub struct Refly {
    /// The flight; none if it fails without figures, as its row then says.
    pub flight: Option<Flight>,
    /// Where it was recorded.
    pub folder: PathBuf,
    /// Where it differs from the row.
    pub differences: Vec<Difference>,
}

/// A figure that is not what the row says.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Name of the figure.
    pub column: String,
    /// What the row says.
    pub row: Value,
    /// What the flight says.
    pub reflown: Value,
}

/// Folder of a flight that was flown again.
pub fn flight_folder(campaign: &Path, seed: u64) -> PathBuf {
    campaign.join(format!("seed-{seed}"))
}

impl Campaign {
    /// Flies the flight of a row again, recorded in full, and compares it with the row.
    ///
    /// # Errors
    /// When there is no such row, or the recording cannot be written.
    pub fn refly(&self, seed: u64, watch: &mut dyn FnMut(&Progress)) -> Result<Refly, RunError> {
        let rows = self.rows()?;
        let row = rows.get(&seed).ok_or_else(|| RunError::Input {
            what: self.folder.display().to_string(),
            finding: format!("seed {seed} has not been flown"),
            remedy: format!(
                "Its {} flights have seeds from {}",
                self.facts.runs, self.facts.first_seed
            ),
        })?;
        let folder = flight_folder(&self.folder, seed);
        make_folder(&folder)?;
        let record_to = RecordTo::File(folder.join("flight.mcap"));
        let flown = guarded(|| flight::fly(&self.scenario, seed, &record_to, watch));
        let reflown = row_of(&self.scenario, seed, &flown);
        let value = |row: &super::Row, column: &str| {
            row.values().get(column).cloned().unwrap_or(Value::Null)
        };
        let differences = row
            .differences(&reflown)
            .into_iter()
            .map(|column| Difference {
                column: column.to_owned(),
                row: value(row, column),
                reflown: value(&reflown, column),
            })
            .collect();
        Ok(Refly {
            flight: flown.ok(),
            folder,
            differences,
        })
    }
}
