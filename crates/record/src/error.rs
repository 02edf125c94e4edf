//! What can be wrong with a file: each message names the file, the place, the finding and a remedy.

use std::path::{Path, PathBuf};

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The operating system refused to read.
    #[error("`{path}` cannot be read: {source}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The operating system refused to write.
    #[error(
        "`{path}` cannot be written: {source}; check the folder, its permissions and the free space",
        path = path.display()
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The container could not take a record.
    #[error("`{path}` cannot be written any further: {source}", path = path.display())]
    Container {
        /// The file.
        path: PathBuf,
        /// What the container said.
        source: Box<mcap::McapError>,
    },
    /// A file that should be there is not.
    #[error("{what}: `{path}` does not exist; {remedy}", path = path.display())]
    Missing {
        /// What lacks it.
        what: &'static str,
        /// The file that is missing.
        path: PathBuf,
        /// What to do.
        remedy: &'static str,
    },
    /// The file is not an MCAP file.
    #[error(
        "`{path}` is not an MCAP file (its first bytes are not the format's); give a recording of \
         `alula fly`",
        path = path.display()
    )]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// The MCAP file is no recording of a flight.
    #[error(
        "`{path}` has no readable record `alula.flight` at its start: {finding}; give a recording \
         of `alula fly`",
        path = path.display()
    )]
    NoHeader {
        /// The file.
        path: PathBuf,
        /// What was found in its place.
        finding: String,
    },
    /// The header is not the one that the flight was recorded with.
    #[error(
        "`{path}`: the configuration in the recording was changed after the flight (digest \
         {recorded} is recorded, {computed} is that of the present header); use an unchanged copy",
        path = path.display()
    )]
    ConfigChanged {
        /// The file.
        path: PathBuf,
        /// Digest that the flight recorded.
        recorded: String,
        /// Digest of the header as it is now.
        computed: String,
    },
    /// A line cannot be understood.
    #[error("`{path}`, line {line}: {finding}; {remedy}", path = path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What was found.
        finding: String,
        /// What to do.
        remedy: &'static str,
    },
    /// An image cannot be understood.
    #[error("`{path}` is not a depth image: {finding}; {remedy}", path = path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What was found.
        finding: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A key of a file is missing or cannot be understood.
    #[error("`{path}`, key `{key}`: {finding}; {remedy}", path = path.display())]
    Key {
        /// The file.
        path: PathBuf,
        /// The key.
        key: &'static str,
        /// What was found.
        finding: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Time goes backwards.
    #[error(
        "`{path}`, line {line}: time {time_ns} ns is before {earlier_ns} ns of line \
         {earlier_line}; sort the file by time or cut it at the jump",
        path = path.display()
    )]
    Backwards {
        /// The file.
        path: PathBuf,
        /// The line that is too early, counted from 1.
        line: usize,
        /// Its time.
        time_ns: i64,
        /// The line before it that is later.
        earlier_line: usize,
        /// Its time.
        earlier_ns: i64,
    },
    /// No data in the file.
    #[error("`{path}` holds no {what}; {remedy}", path = path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
        /// What to do.
        remedy: &'static str,
    },
}

impl RecordError {
    /// The error of reading `path`.
    pub(crate) fn read(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Read {
            path: path.to_owned(),
            source,
        }
    }

    /// The error of writing `path`.
    pub(crate) fn write(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Write {
            path: path.to_owned(),
            source,
        }
    }

    /// The error of the container at `path`; a refusal of the operating system stays one.
    pub(crate) fn container(path: &Path) -> impl FnOnce(mcap::McapError) -> Self {
        move |source| match source {
            mcap::McapError::Io(source) => Self::Write {
                path: path.to_owned(),
                source,
            },
            source => Self::Container {
                path: path.to_owned(),
                source: Box::new(source),
            },
        }
    }
}
