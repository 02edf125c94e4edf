//! Merging: the parts of a campaign that were flown in different folders become one.

use std::path::{Path, PathBuf};

use super::frozen::FrozenScenario;
use super::rows_file::{RowsFile, insert};
use super::{Campaign, Shard, folder};
use crate::{RunError, make_folder};

/// Adds the flights of `folders` to those in `into`, which need not exist yet.
///
/// # Errors
/// When a folder holds no campaign or another one, or flights of one seed differ.
pub fn merge(folders: &[PathBuf], into: &Path) -> Result<Campaign, RunError> {
    let mut parts = Vec::new();
    if folder::is_campaign(into) {
        parts.push(Campaign::open(into)?);
    }
    for folder in folders {
        parts.push(Campaign::open(folder)?);
    }
    let Some(first) = parts.first() else {
        return Err(RunError::Input {
            what: into.display().to_string(),
            finding: "nothing to merge".into(),
            remedy: "Name the folders: --merge DIR...".into(),
        });
    };
    for part in &parts {
        check_same(first, part)?;
    }
    let mut facts = first.facts.clone();
    facts.runs = parts
        .iter()
        .map(|p| p.facts.runs)
        .max()
        .unwrap_or(facts.runs);
    let mut rows = first.rows()?;
    for part in &parts[1..] {
        for row in part.rows()?.into_values() {
            insert(&mut rows, row)?;
        }
    }
    make_folder(into)?;
    let scenario = first.folder.join(folder::SCENARIO);
    folder::write(into, &facts, &FrozenScenario::load(Some(&scenario), &[])?)?;
    let mut file = RowsFile::open(into, Shard::WHOLE)?;
    let merged = Campaign::open(into)?;
    let held = merged.rows()?;
    for row in rows.values().filter(|row| !held.contains_key(&row.seed())) {
        file.append(row)?;
    }
    Ok(merged)
}

fn check_same(first: &Campaign, part: &Campaign) -> Result<(), RunError> {
    let scenario = FrozenScenario::load(Some(&part.folder.join(folder::SCENARIO)), &[])?;
    folder::check_same_scenario(&first.folder, &scenario)?;
    let (one, other) = (&first.facts, &part.facts);
    let finding = if one.first_seed != other.first_seed {
        format!(
            "its first seed is {}, not {}",
            other.first_seed, one.first_seed
        )
    } else if one.version != other.version {
        format!(
            "it was flown by alula {}, not {}",
            other.version, one.version
        )
    } else {
        return Ok(());
    };
    Err(RunError::Input {
        what: part.folder.display().to_string(),
        finding,
        remedy: "Merge parts of one campaign only".into(),
    })
}
