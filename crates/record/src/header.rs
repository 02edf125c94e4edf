//! What a recording says about its flight before the first sample.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::records::Metadata;
use sha2::{Digest, Sha256};

use crate::RecordError;

/// Name of the metadata record that holds the header.
pub(crate) const NAME: &str = "alula.flight";

/// What the flight was: with the samples, all that is needed to fly it again.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// The resolved configuration.
    pub config_toml: String,
    /// Name of the scenario.
    pub scenario_name: String,
    /// Seed of the flight.
    pub seed: u64,
    /// Version of the program that flew.
    pub version: String,
}

impl Header {
    /// SHA-256 over all fields, each preceded by its length, as hexadecimal digits.
    fn digest(&self) -> String {
        let seed = self.seed.to_string();
        let mut hash = Sha256::new();
        for field in [&self.config_toml, &self.scenario_name, &seed, &self.version] {
            hash.update((field.len() as u64).to_le_bytes());
            hash.update(field.as_bytes());
        }
        let digits = hash.finalize();
        digits.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// The header as a metadata record, with its digest.
    pub(crate) fn to_metadata(&self) -> Metadata {
        let entries = [
            ("config_toml", self.config_toml.clone()),
            ("scenario_name", self.scenario_name.clone()),
            ("seed", self.seed.to_string()),
            ("version", self.version.clone()),
            ("sha256", self.digest()),
        ];
        Metadata {
            name: NAME.to_owned(),
            metadata: entries.map(|(key, value)| (key.to_owned(), value)).into(),
        }
    }

    /// The header in a metadata record, without a check of its digest.
    pub(crate) fn from_metadata(metadata: &Metadata, path: &Path) -> Result<Self, RecordError> {
        let no_header = |finding: String| RecordError::NoHeader {
            path: path.to_owned(),
            finding,
        };
        if metadata.name != NAME {
            return Err(no_header(format!("found `{}`", metadata.name)));
        }
        let take = |key| take(&metadata.metadata, key).map_err(no_header);
        let seed = take("seed")?;
        Ok(Self {
            config_toml: take("config_toml")?,
            scenario_name: take("scenario_name")?,
            seed: seed
                .parse()
                .map_err(|_| no_header(format!("its seed `{seed}` is not a number")))?,
            version: take("version")?,
        })
    }

    /// Checks the digest in a metadata record.
    pub(crate) fn verify(&self, metadata: &Metadata, path: &Path) -> Result<(), RecordError> {
        let recorded = metadata.metadata.get("sha256").cloned();
        let recorded = recorded.unwrap_or_else(|| "none".to_owned());
        let computed = self.digest();
        if recorded == computed {
            return Ok(());
        }
        Err(RecordError::ConfigChanged {
            path: path.to_owned(),
            recorded,
            computed,
        })
    }
}

fn take(entries: &BTreeMap<String, String>, key: &str) -> Result<String, String> {
    entries
        .get(key)
        .cloned()
        .ok_or_else(|| format!("it lacks `{key}`"))
}
