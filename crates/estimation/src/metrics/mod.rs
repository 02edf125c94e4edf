//! How good an estimate was: errors of trajectories and consistency of covariances.
//!
//! Trajectory errors are defined as the `evo` tool computes them, which document L, section 4-1-1,
//! intends (its printed sums are read as in the literature). Derivation:
//! `docs/derivations/trajectory-metrics.md`. These functions are for reports: they allocate.

mod align;
mod association;
mod consistency;
mod errors;

pub use align::{Alignment, Similarity, align};
pub use association::{Trajectory, associate};
pub use consistency::{AneesBand, anees_band, nees, nees_of};
pub use errors::{
    Pairing, RelativeErrors, Statistics, absolute_rotation_errors, absolute_translation_errors,
    relative_errors, scale_error, statistics,
};

/// Why there is no figure.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MetricsError {
    /// No poses of the two trajectories have nearly the same time.
    #[error(
        "the trajectories have no poses in common: no time stamps differ by less than {max_difference_s} s"
    )]
    NothingInCommon {
        /// The greatest difference that was allowed, s.
        max_difference_s: f64,
    },
    /// The trajectories do not have the same number of poses.
    #[error("the trajectories have {reference} and {estimate} poses; associate them first")]
    DifferentLengths {
        /// Poses of the reference.
        reference: usize,
        /// Poses of the estimate.
        estimate: usize,
    },
    /// The points lie on a line or in a point: their rotation is not determined.
    #[error("the trajectory does not determine a rotation: its points lie on a line")]
    Degenerate,
    /// Too few poses for this figure.
    #[error("{found} poses are too few, {needed} are needed")]
    TooFew {
        /// Poses there are.
        found: usize,
        /// Poses needed.
        needed: usize,
    },
}
