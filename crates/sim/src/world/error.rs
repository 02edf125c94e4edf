//! Why a world cannot be.

use alula_parameters::ParameterError;
use nalgebra::Point3;

/// A world, or a place in it, that is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WorldError {
    /// A value outside its declared range.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// Values that are allowed one by one but make no thing together.
    #[error("`{key}`: {finding}; {remedy}")]
    Degenerate {
        /// Dotted path of the table.
        key: String,
        /// What was found.
        finding: String,
        /// What to do about it.
        remedy: String,
    },
    /// A generator that cannot meet its own demands.
    #[error("`{key}` cannot be generated: {finding}; {remedy}")]
    Impossible {
        /// Dotted path of the table.
        key: String,
        /// What was found.
        finding: String,
        /// What to do about it.
        remedy: String,
    },
    /// A file that a world refers to cannot be had.
    #[error("`{key}`: cannot read `{file}`: {reason}")]
    Unreadable {
        /// Dotted path of the key that names the file.
        key: String,
        /// The file as the key names it.
        file: String,
        /// What the reader said.
        reason: String,
    },
    /// A mesh file without a usable mesh.
    #[error("{file}: {finding}; {remedy} (named by `{key}`)")]
    Mesh {
        /// Dotted path of the key that names the file.
        key: String,
        /// The file as the key names it.
        file: String,
        /// What was found.
        finding: String,
        /// What to do about it.
        remedy: String,
    },
    /// A file of tracks with a bad line.
    #[error("{file}:{line}: {finding}; {remedy} (named by `{key}`)")]
    Track {
        /// Dotted path of the key that names the file.
        key: String,
        /// The file as the key names it.
        file: String,
        /// Line in the file, from 1.
        line: u64,
        /// What was found.
        finding: String,
        /// What is expected.
        remedy: String,
    },
    /// A place that must be free lies in something.
    #[error("{what} at {} lies {relation} `{thing}`; move it or the obstacle", show(.point))]
    Occupied {
        /// What should be there, for example `waypoint 3`.
        what: String,
        /// The place, world frame.
        point: Point3<f64>,
        /// `inside`, `below`, or the distance that is too short.
        relation: String,
        /// The thing that is there already.
        thing: String,
    },
}

/// Coordinates as a person reads them.
fn show(point: &Point3<f64>) -> String {
    format!("({:.2}, {:.2}, {:.2}) m", point.x, point.y, point.z)
}

impl WorldError {
    /// A [`WorldError::Degenerate`].
    pub(super) fn degenerate(key: &str, finding: impl Into<String>, remedy: &str) -> Self {
        Self::Degenerate {
            key: key.into(),
            finding: finding.into(),
            remedy: remedy.into(),
        }
    }

    /// A [`WorldError::Impossible`].
    pub(super) fn impossible(key: &str, finding: impl Into<String>, remedy: &str) -> Self {
        Self::Impossible {
            key: key.into(),
            finding: finding.into(),
            remedy: remedy.into(),
        }
    }
}
