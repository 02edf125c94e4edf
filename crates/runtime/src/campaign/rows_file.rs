//! Files of rows: one JSON object a line, appended whole when a flight is over.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use super::{Row, Shard};
use crate::RunError;

/// A file of rows that this process alone appends to.
#[derive(Debug)]
pub struct RowsFile {
    path: PathBuf,
    file: File,
}

impl RowsFile {
    /// Opens the file of a shard and removes the line that a killed process left unfinished.
    pub fn open(folder: &Path, shard: Shard) -> Result<Self, RunError> {
        let path = folder.join(shard.file_name());
        let write_error = |source| RunError::Write {
            path: path.clone(),
            source,
        };
        let mut file = OpenOptions::new()
            .create(true)
            .read(true)
            .append(true)
            .open(&path)
            .map_err(write_error)?;
        // Where the file system knows no locks, a flight may be flown twice, which does no harm.
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            return Err(RunError::Input {
                what: path.display().to_string(),
                finding: "another process is flying into it".into(),
                remedy: "Wait for its end, or fly another part: --shard I/K".into(),
            });
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(write_error)?;
        let whole = whole_lines(&bytes).len();
        if whole < bytes.len() {
            file.set_len(whole as u64).map_err(write_error)?;
        }
        Ok(Self { path, file })
    }

    /// Appends a row in one write: a kill before or after leaves whole lines.
    pub fn append(&mut self, row: &Row) -> Result<(), RunError> {
        self.file
            .write_all(&row.to_line())
            .map_err(|source| RunError::Write {
                path: self.path.clone(),
                source,
            })
    }
}

/// The rows of all files of a folder, by seed.
pub fn read_all(folder: &Path) -> Result<BTreeMap<u64, Row>, RunError> {
    let mut rows = BTreeMap::new();
    for path in row_files(folder)? {
        let bytes = fs::read(&path).map_err(|source| RunError::Read {
            path: path.clone(),
            source,
        })?;
        for (number, line) in whole_lines(&bytes)
            .split_inclusive(|b| *b == b'\n')
            .enumerate()
        {
            let row = Row::parse(line).map_err(|error| RunError::Input {
                what: format!("{}:{}", path.display(), number + 1),
                finding: format!("is not a row: {error}"),
                remedy: "Delete the line: its flight will be flown again".into(),
            })?;
            insert(&mut rows, row)?;
        }
    }
    Ok(rows)
}

/// Adds a row; a second one of the same flight must be the same.
pub fn insert(rows: &mut BTreeMap<u64, Row>, row: Row) -> Result<(), RunError> {
    match rows.entry(row.seed()) {
        Entry::Vacant(place) => {
            place.insert(row);
        }
        Entry::Occupied(held) => {
            if let Some(column) = held.get().differences(&row).first() {
                return Err(RunError::Input {
                    what: format!("seed {}", row.seed()),
                    finding: format!("was flown twice, and `{column}` differs"),
                    remedy: "Fly all parts with the same program on machines of the same kind"
                        .into(),
                });
            }
        }
    }
    Ok(())
}

fn row_files(folder: &Path) -> Result<Vec<PathBuf>, RunError> {
    let read_error = |source| RunError::Read {
        path: folder.to_path_buf(),
        source,
    };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(read_error)? {
        let entry = entry.map_err(read_error)?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with("rows") && name.ends_with(".jsonl") {
            found.push(entry.path());
        }
    }
    found.sort();
    Ok(found)
}

/// All up to the last end of a line: what follows is being written, or was cut off.
fn whole_lines(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().rposition(|byte| *byte == b'\n');
    &bytes[..end.map_or(0, |end| end + 1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: &str = "{\"seed\":1,\"x\":1.0}\n";
    const TWO: &str = "{\"seed\":2,\"x\":2.0}\n";

    fn with_rows(text: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("rows.jsonl"), text).unwrap();
        folder
    }

    fn message(text: &str) -> String {
        let folder = with_rows(text);
        read_all(folder.path()).unwrap_err().to_string()
    }

    #[test]
    fn an_unfinished_line_is_ignored_and_then_removed() {
        let folder = with_rows(&format!("{ONE}{}", &TWO[..9]));
        assert_eq!(read_all(folder.path()).unwrap().len(), 1);
        let mut file = RowsFile::open(folder.path(), Shard::WHOLE).unwrap();
        file.append(&Row::parse(TWO.as_bytes()).unwrap()).unwrap();
        let text = fs::read_to_string(folder.path().join("rows.jsonl")).unwrap();
        assert_eq!(text, format!("{ONE}{TWO}"));
    }

    #[test]
    fn a_file_belongs_to_one_process() {
        let folder = with_rows(ONE);
        let _held = RowsFile::open(folder.path(), Shard::WHOLE).unwrap();
        let error = RowsFile::open(folder.path(), Shard::WHOLE).unwrap_err();
        assert!(error.to_string().contains("another process"), "{error}");
        assert!(RowsFile::open(folder.path(), "0/2".parse().unwrap()).is_ok());
    }

    #[test]
    fn a_damaged_line_is_named() {
        let found = message(&format!("{ONE}nonsense\n{TWO}"));
        assert!(found.contains("rows.jsonl:2"), "{found}");
    }

    #[test]
    fn rows_of_one_seed_must_agree() {
        let found = message(&format!("{ONE}{}", ONE.replace("1.0", "1.5")));
        assert!(found.contains("seed 1") && found.contains("`x`"), "{found}");
        assert_eq!(
            read_all(with_rows(&format!("{ONE}{ONE}")).path())
                .unwrap()
                .len(),
            1
        );
    }
}
