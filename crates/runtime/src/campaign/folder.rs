//! The folder of a campaign: what it holds, and when it is refused.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::frozen::{FrozenScenario, digest};
use crate::scenario::read_text;
use crate::{RunError, Scenario, make_folder, write_file};

/// What identifies the campaign.
pub const FACTS: &str = "campaign.toml";
/// The resolved scenario.
pub const SCENARIO: &str = "scenario.toml";
/// The table of all flights, by seed.
pub const TABLE: &str = "flights.csv";
/// The figures of the campaign.
pub const SUMMARY: &str = "summary.json";

/// What identifies a campaign.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Facts {
    /// Name of the scenario.
    pub scenario: String,
    /// SHA-256 of the resolved scenario beside it.
    pub digest: String,
    /// Seed of the first flight; the others count up.
    pub first_seed: u64,
    /// Number of flights.
    pub runs: u64,
    /// Version of the program that flies it.
    pub version: String,
}

impl Facts {
    /// Refuses seeds that files and tools cannot hold.
    pub(super) fn check_seeds(&self) -> Result<(), RunError> {
        let last = self.first_seed.checked_add(self.runs);
        if self.runs > 0 && last.is_some_and(|last| i64::try_from(last).is_ok()) {
            return Ok(());
        }
        Err(RunError::Input {
            what: format!("{} seeds from {}", self.runs, self.first_seed),
            finding: "at least one flight is needed, and seeds must fit 63 bits".into(),
            remedy: "Change --runs or --first-seed".into(),
        })
    }

    /// Refuses what cannot be continued: other seeds, fewer flights, another program.
    pub(super) fn check_request(
        &self,
        folder: &Path,
        runs: Option<u64>,
        first_seed: Option<u64>,
    ) -> Result<(), RunError> {
        let own = (self.first_seed, self.runs);
        let finding = if first_seed.is_some_and(|seed| seed != own.0) {
            format!("holds a campaign whose first seed is {}", own.0)
        } else if runs.is_some_and(|runs| runs < own.1) {
            format!("holds a campaign of {} flights, which cannot shrink", own.1)
        } else if self.version != crate::VERSION {
            let (old, new) = (&self.version, crate::VERSION);
            format!("holds flights of alula {old}, and this is {new}: they may fly differently")
        } else {
            return Ok(());
        };
        Err(other_campaign(folder, finding))
    }
}

fn other_campaign(folder: &Path, finding: String) -> RunError {
    RunError::Input {
        what: folder.display().to_string(),
        finding,
        remedy: "Name another folder: --out DIR".into(),
    }
}

/// Whether a folder holds a campaign.
pub fn is_campaign(folder: &Path) -> bool {
    folder.join(FACTS).is_file()
}

/// The campaign that a folder holds.
pub fn read(folder: &Path) -> Result<(Facts, Scenario), RunError> {
    if !is_campaign(folder) {
        return Err(RunError::Input {
            what: folder.display().to_string(),
            finding: format!("holds no campaign: there is no {FACTS}"),
            remedy: "Fly one first: alula campaign --runs N --out DIR".into(),
        });
    }
    let path = folder.join(FACTS);
    let facts: Facts = toml::from_str(&read_text(&path)?).map_err(|error| RunError::Input {
        what: path.display().to_string(),
        finding: error.message().to_owned(),
        remedy: "The program writes this file; begin again in another folder: --out DIR".into(),
    })?;
    let path = folder.join(SCENARIO);
    if digest(read_text(&path)?.as_bytes()) != facts.digest {
        return Err(RunError::Input {
            what: path.display().to_string(),
            finding: format!(
                "is not the scenario of the flights: its digest is not that in {FACTS}"
            ),
            remedy: "Restore it, or fly the changed scenario into another folder: --out DIR".into(),
        });
    }
    Ok((facts, Scenario::load(Some(&path), &[])?))
}

/// Writes what identifies a campaign, its facts last: they make the folder a campaign.
pub fn write(folder: &Path, facts: &Facts, scenario: &FrozenScenario) -> Result<(), RunError> {
    for (name, bytes) in &scenario.files {
        let path = folder.join(name);
        make_folder(path.parent().unwrap_or(folder))?;
        write_whole(&path, bytes)?;
    }
    write_whole(&folder.join(SCENARIO), scenario.text.as_bytes())?;
    write_facts(folder, facts)
}

/// Writes the facts.
pub fn write_facts(folder: &Path, facts: &Facts) -> Result<(), RunError> {
    let text = crate::config::resolved_text(facts)?;
    write_whole(&folder.join(FACTS), text.as_bytes())
}

/// Writes a file so that others find the old one or the new one, and never a part.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RunError> {
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(format!(".{}.tmp", std::process::id()));
    let temporary = PathBuf::from(temporary);
    write_file(&temporary, bytes)?;
    fs::rename(&temporary, path).map_err(|source| RunError::Write {
        path: path.to_path_buf(),
        source,
    })
}

/// Refuses a scenario other than the folder's, and names the first key that differs.
pub fn check_same_scenario(folder: &Path, wanted: &FrozenScenario) -> Result<(), RunError> {
    let held = read_text(&folder.join(SCENARIO))?;
    if held == wanted.text {
        return Ok(());
    }
    let tables = (toml::from_str(&held), toml::from_str(&wanted.text));
    let difference = match tables {
        (Ok(held), Ok(wanted)) => first_difference(
            &toml::Value::Table(held),
            &toml::Value::Table(wanted),
            String::new(),
        ),
        _ => None,
    };
    let what = difference.map_or(String::new(), |(key, held, wanted)| {
        format!(": `{key}` was {held} and is now {wanted}")
    });
    let finding = format!("holds a campaign of another scenario{what}");
    Err(other_campaign(folder, finding))
}

/// Key and both values of the first difference.
fn first_difference(
    held: &toml::Value,
    wanted: &toml::Value,
    key: String,
) -> Option<(String, String, String)> {
    use toml::Value::{Array, Table};
    if held == wanted {
        return None;
    }
    let inner = match (held, wanted) {
        (Table(held), Table(wanted)) => held.keys().chain(wanted.keys()).find_map(|name| {
            let dot = if key.is_empty() { "" } else { "." };
            let key = format!("{key}{dot}{name}");
            match (held.get(name), wanted.get(name)) {
                (Some(held), Some(wanted)) => first_difference(held, wanted, key),
                (held, wanted) => Some((key, brief(held), brief(wanted))),
            }
        }),
        (Array(held), Array(wanted)) if held.len() == wanted.len() => held
            .iter()
            .zip(wanted)
            .enumerate()
            .find_map(|(i, (held, wanted))| first_difference(held, wanted, format!("{key}[{i}]"))),
        _ => None,
    };
    inner.or_else(|| Some((key, brief(Some(held)), brief(Some(wanted)))))
}

/// A value in few words.
fn brief(value: Option<&toml::Value>) -> String {
    match value {
        None => "absent".to_owned(),
        Some(toml::Value::Table(_)) => "a table".to_owned(),
        Some(toml::Value::Array(items)) if items.len() > 4 => {
            format!("a list of {}", items.len())
        }
        Some(value) => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(held: &str, wanted: &str, expected: Option<[&str; 3]>) {
        let [held, wanted] = [held, wanted].map(|t| toml::Value::Table(toml::from_str(t).unwrap()));
        let found = first_difference(&held, &wanted, String::new());
        let expected = expected.map(|[a, b, c]| (a.into(), b.into(), c.into()));
        assert_eq!(found, expected);
    }

    #[test]
    fn the_first_difference_is_named_with_both_values() {
        check("a = 1\n[b]\nc = 2", "a = 1\n[b]\nc = 2", None);
        check("[b]\nc = 2.5", "[b]\nc = 3.0", Some(["b.c", "2.5", "3.0"]));
        check("a = 1\n[b]", "a = 1", Some(["b", "a table", "absent"]));
        check("a = [1, 2]", "a = [1, 3]", Some(["a[1]", "2", "3"]));
        check("a = [1]", "a = [1, 3]", Some(["a", "[1]", "[1, 3]"]));
    }

    #[test]
    fn a_campaign_may_grow_but_neither_shrink_nor_shift() {
        let facts = Facts {
            scenario: "s".into(),
            digest: "d".into(),
            first_seed: 5,
            runs: 10,
            version: crate::VERSION.into(),
        };
        let check = |runs, seed| facts.check_request(Path::new("f"), runs, seed);
        assert!(check(Some(11), Some(5)).is_ok());
        assert!(check(None, None).is_ok());
        let message = check(Some(9), None).unwrap_err().to_string();
        assert!(message.contains("10 flights"), "{message}");
        let message = check(Some(10), Some(1)).unwrap_err().to_string();
        assert!(message.contains("first seed is 5"), "{message}");
        let old = Facts {
            version: "0.0.1".into(),
            ..facts.clone()
        };
        assert!(old.check_request(Path::new("f"), None, None).is_err());
    }
}
