//! A scenario with every default filled in and every file it needs, independent of where it came
//! from.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::config::ConfigText;
use crate::scenario::with_variables;
use crate::{RunError, Scenario};

/// Folder of the files that a frozen scenario names, beside its own.
const FILES: &str = "files";

/// Hexadecimal digits of a file's digest in its name.
const NAME_DIGITS: usize = 16;

/// A scenario that is its own description: two of them fly alike if their texts are equal.
#[derive(Clone, Debug)]
pub struct FrozenScenario {
    /// Name of the scenario.
    pub name: String,
    /// The resolved scenario; the files it names are called by their content.
    pub text: String,
    /// SHA-256 of the text, hexadecimal.
    pub digest: String,
    /// The files, by name, relative to the scenario's folder.
    pub files: BTreeMap<String, Vec<u8>>,
    /// The scenario as it was loaded, which reads its files where they were.
    pub scenario: Scenario,
}

impl FrozenScenario {
    /// Freezes a scenario file, or the built-in scenario, with overrides.
    pub fn load(path: Option<&Path>, overrides: &[String]) -> Result<Self, RunError> {
        let scenario = Scenario::load(path, overrides)?;
        let folder = path.and_then(Path::parent).unwrap_or(Path::new(""));
        let mut files = BTreeMap::new();
        let text = freeze_files(scenario.resolved_text()?, folder, &mut files)?;
        Ok(Self {
            name: scenario.config().name.clone(),
            digest: digest(text.as_bytes()),
            text,
            files,
            scenario,
        })
    }
}

/// SHA-256, hexadecimal.
pub fn digest(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The text of a scenario with its files collected and renamed.
fn freeze_files(
    text: String,
    folder: &Path,
    files: &mut BTreeMap<String, Vec<u8>>,
) -> Result<String, RunError> {
    let unreadable = |e: toml::de::Error| RunError::Input {
        what: "the resolved scenario".into(),
        finding: e.message().to_owned(),
        remedy: "Check the scenario: alula check FILE".into(),
    };
    let mut root: toml::Table = toml::from_str(&text).map_err(unreadable)?;
    if let Some(world) = root.get_mut("world") {
        collect(world, folder, files)?;
    }
    if files.is_empty() {
        return Ok(text);
    }
    let renamed = ConfigText {
        file: "the resolved scenario".into(),
        text: root.to_string(),
    };
    // Once through its type, so that keys stand in the order of their declaration.
    Ok(Scenario::parse(renamed, folder.to_path_buf())?.resolved_text()?)
}

/// Collects the files of all keys `file`, and renames them by their content.
fn collect(
    value: &mut toml::Value,
    folder: &Path,
    files: &mut BTreeMap<String, Vec<u8>>,
) -> Result<(), RunError> {
    match value {
        toml::Value::Array(items) => items
            .iter_mut()
            .try_for_each(|item| collect(item, folder, files)),
        toml::Value::Table(table) => table.iter_mut().try_for_each(|(key, item)| match item {
            toml::Value::String(name) if key == "file" && !name.is_empty() => {
                *name = collect_file(name, folder, files)?;
                Ok(())
            }
            _ => collect(item, folder, files),
        }),
        _ => Ok(()),
    }
}

fn collect_file(
    name: &str,
    folder: &Path,
    files: &mut BTreeMap<String, Vec<u8>>,
) -> Result<String, RunError> {
    let full_name = with_variables(name).map_err(|reason| RunError::Input {
        what: format!("the scenario's file `{name}`"),
        finding: reason,
        remedy: "It is copied into the campaign's folder".into(),
    })?;
    let path = folder.join(&full_name);
    let bytes = fs::read(&path).map_err(|source| RunError::Read { path, source })?;
    let frozen = frozen_name(&full_name, &digest(&bytes)[..NAME_DIGITS]);
    files.insert(frozen.clone(), bytes);
    Ok(frozen)
}

/// The name of a file by its content; the name of a frozen file stays.
fn frozen_name(name: &str, digits: &str) -> String {
    let base = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let base = base
        .strip_prefix(digits)
        .map_or(base, |rest| rest.trim_start_matches('-'));
    format!("{FILES}/{digits}-{base}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const MESH: &str =
        "world.obstacles=[{kind=\"mesh\", file=\"shapes/a.obj\", position_m=[6.0, 6.0, 0.0]}]";

    fn frozen(folder: &Path, file: &str) -> FrozenScenario {
        let overrides = [MESH.replace("shapes/a.obj", file)];
        let path = folder.join("scenario.toml");
        fs::write(
            &path,
            include_str!("../../../../scenarios/first-flight.toml"),
        )
        .unwrap();
        FrozenScenario::load(Some(&path), &overrides).unwrap()
    }

    #[test]
    fn a_file_counts_by_its_content_wherever_it_lies() {
        let folder = tempfile::tempdir().unwrap();
        for (at, content) in [("x", "v 0 0 0"), ("y", "v 0 0 0"), ("z", "v 1 0 0")] {
            fs::create_dir(folder.path().join(at)).unwrap();
            fs::write(folder.path().join(at).join("a.obj"), content).unwrap();
        }
        let [x, y, z] = ["x/a.obj", "y/a.obj", "z/a.obj"].map(|f| frozen(folder.path(), f));
        assert_eq!((&x.text, &x.digest), (&y.text, &y.digest));
        assert_ne!(x.digest, z.digest);
        assert_eq!(x.files.values().next().unwrap(), b"v 0 0 0");
    }

    #[test]
    fn freezing_again_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.obj"), "v 0 0 0").unwrap();
        let once = frozen(folder.path(), "a.obj");
        for (name, bytes) in &once.files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        let path = folder.path().join("frozen.toml");
        fs::write(&path, &once.text).unwrap();
        let again = FrozenScenario::load(Some(&path), &[]).unwrap();
        assert_eq!(once.text, again.text);
        assert_eq!(once.files, again.files);
    }

    #[test]
    fn the_digest_is_sha_256() {
        // FIPS 180-2, appendix B.1.
        assert_eq!(
            digest(b"abc"),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
    }
}
