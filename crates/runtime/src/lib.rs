//! The only place with clocks and files: it reads scenarios, flies them against a simulated
//! vehicle, replays recordings and runs estimators over real flights.

pub mod belief;
pub mod campaign;
pub mod check;
pub mod config;
mod csv;
pub mod encounters;
pub mod estimate;
mod failure;
pub mod flight;
pub mod flight_log;
pub mod flights;
pub mod mission;
pub mod replay;
pub mod scenario;
mod scene;
pub mod study;
pub mod timing;

use std::path::{Path, PathBuf};

use alula_messages::VehicleError;
use alula_parameters::ParameterError;
use alula_record::RecordError;
use alula_sim::world::WorldError;

pub use config::ConfigError;
pub use scenario::Scenario;

/// Version of alula, as it stands in recordings.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Why something could not be run: bad input, each with what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A configuration is not allowed.
    #[error(transparent)]
    Config(Box<ConfigError>),
    /// A parameter is not allowed.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// A world cannot be.
    #[error(transparent)]
    World(Box<WorldError>),
    /// The world of a scenario cannot be, or the mission is not possible in it.
    #[error("{file}: {error}")]
    Scenario {
        /// Where the scenario came from.
        file: String,
        /// What is wrong.
        error: Box<WorldError>,
    },
    /// A recording or log cannot be read or written.
    #[error(transparent)]
    Record(Box<RecordError>),
    /// The vehicle does not answer.
    #[error(transparent)]
    Vehicle(#[from] VehicleError),
    /// A file cannot be read.
    #[error("{}: cannot be read: {source}; check the name and its permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file cannot be written.
    #[error(
        "{}: cannot be written: {source}; check the folder, its permissions and the free space",
        path.display()
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The input is not what the command needs.
    #[error("{what}: {finding}. {remedy}")]
    Input {
        /// The file or argument.
        what: String,
        /// What is wrong with it.
        finding: String,
        /// What to do.
        remedy: String,
    },
}

impl From<ConfigError> for RunError {
    fn from(error: ConfigError) -> Self {
        Self::Config(Box::new(error))
    }
}

impl From<WorldError> for RunError {
    fn from(error: WorldError) -> Self {
        Self::World(Box::new(error))
    }
}

impl From<RecordError> for RunError {
    fn from(error: RecordError) -> Self {
        Self::Record(Box::new(error))
    }
}

/// Writes a file.
///
/// # Errors
/// When it cannot be written.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), RunError> {
    std::fs::write(path, bytes).map_err(|source| RunError::Write {
        path: path.to_path_buf(),
        source,
    })
}

/// Makes a folder and those above it.
///
/// # Errors
/// When it cannot be made.
pub fn make_folder(path: &Path) -> Result<(), RunError> {
    std::fs::create_dir_all(path).map_err(|source| RunError::Write {
        path: path.to_path_buf(),
        source,
    })
}
