//! Estimates against the truth.

use alula_estimation::eskf::ErrorVector;
use alula_estimation::metrics::{
    self, Alignment, Pairing, absolute_rotation_errors, absolute_translation_errors,
    relative_errors, statistics,
};
use alula_geometry::{Pose, TimeDelta, Timestamp, so3};
use alula_messages::error_index::{ORIENTATION, VELOCITY};
use alula_messages::{EstimateHealth, NavState};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::TrueMotion;

/// Estimate and truth belong together when their times differ by less than this, s.
const MAX_TIME_DIFFERENCE_S: f64 = 0.01;

/// Pieces over which the scale error is averaged (document L, section 4-1-1).
const SCALE_PIECES: usize = 10;

/// Rate at which paths are measured: at that of inertial data, noise would count as motion. Document
/// L's cameras gave 15 poses a second.
const SCALE_RATE_HZ: f64 = 10.0;

/// How the estimate is moved onto the truth before position errors are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlignTo {
    /// Not at all: both are in the same world frame.
    None,
    /// So that the first poses agree.
    Origin,
    /// Position and heading, which odometry cannot observe.
    PositionYaw,
    /// Position and rotation.
    Rigid,
    /// Position, rotation and scale.
    Similarity,
}

impl AlignTo {
    /// What suits an estimator: odometry chooses its own frame, poses come in the world's.
    pub fn natural_for(estimator: &str) -> Self {
        if estimator == "pose-imu" {
            Self::None
        } else {
            Self::PositionYaw
        }
    }

    fn alignment(self) -> Alignment {
        match self {
            Self::None => Alignment::None,
            Self::Origin => Alignment::Origin,
            Self::PositionYaw => Alignment::PositionYaw,
            Self::Rigid => Alignment::Rigid,
            Self::Similarity => Alignment::Similarity,
        }
    }
}

/// Errors of an estimated trajectory, as the `evo` tool defines them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Errors {
    /// How the estimate was aligned.
    pub alignment: AlignTo,
    /// Pairs of estimate and truth.
    pub pairs: usize,
    /// Root mean square position error after alignment, m.
    pub ate_rmse_m: f64,
    /// The greatest position error after alignment, m.
    pub ate_max_m: f64,
    /// Duration of the pieces for the relative error, s.
    pub rpe_delta_s: f64,
    /// Root mean square relative position error, m.
    pub rpe_rmse_m: f64,
    /// Mean over pieces of how much too long the estimated path is, as a share.
    pub scale_error: f64,
    /// Root mean square angle between estimated and true orientation, degrees.
    pub orientation_rmse_deg: f64,
    /// Root mean square velocity error, m/s; absent where the true velocity is not known.
    pub velocity_rmse_m_s: Option<f64>,
    /// Position error at the end, after alignment, m.
    pub final_error_m: f64,
    /// Mean normalised squared error of the velocity: 3 for a filter that knows its error; absent
    /// where the true velocity is not known.
    pub nees_velocity: Option<f64>,
    /// The same of roll and pitch: 2 for a filter that knows its error.
    pub nees_tilt: Option<f64>,
}

/// Whether a state means anything.
pub fn is_usable(state: &NavState) -> bool {
    let known = !matches!(
        state.health,
        EstimateHealth::Initialising | EstimateHealth::Failed
    );
    known && state.is_finite()
}

/// How far the position moved beyond what the mean of the velocities explains, m.
pub fn jump_m(before: &NavState, after: &NavState) -> f64 {
    let dt_s = after.time.seconds_since(before.time);
    let explained = 0.5 * (before.velocity_world + after.velocity_world) * dt_s;
    (after.position_world() - before.position_world() - explained).norm()
}

/// Errors of the estimates. States and truth are in order of time.
///
/// # Errors
/// In words, when the two cannot be compared.
pub fn judge(
    states: &[NavState],
    truth: &[TrueMotion],
    align: AlignTo,
    rpe_delta_s: f64,
) -> Result<Errors, String> {
    if truth.is_empty() {
        return Err("the truth is not known".into());
    }
    let pairs = pair(states, truth);
    let estimate: Vec<_> = pairs.iter().map(|(s, _)| s.world_from_body).collect();
    let reference: Vec<_> = pairs.iter().map(|(_, t)| t.world_from_body).collect();
    let times: Vec<_> = pairs.iter().map(|(_, t)| t.time).collect();
    let in_words = |error: metrics::MetricsError| error.to_string();
    let similarity = metrics::align(&reference, &estimate, align.alignment()).map_err(in_words)?;
    let aligned: Vec<_> = estimate.iter().map(|pose| similarity.apply(pose)).collect();
    let absolute = absolute_translation_errors(&reference, &aligned).map_err(in_words)?;
    let rotation = absolute_rotation_errors(&reference, &aligned).map_err(in_words)?;
    let pairing = Pairing::Seconds(rpe_delta_s);
    let relative = relative_errors(&times, &reference, &aligned, pairing).map_err(in_words)?;
    let scale = scale_error(&times, &reference, &aligned).map_err(in_words)?;
    let rmse = |errors: &[f64]| statistics(errors).map_or(f64::NAN, |s| s.rmse);
    Ok(Errors {
        alignment: align,
        pairs: pairs.len(),
        ate_rmse_m: rmse(&absolute),
        ate_max_m: absolute.iter().copied().fold(0.0, f64::max),
        rpe_delta_s,
        rpe_rmse_m: rmse(&relative.translation_m),
        scale_error: scale,
        orientation_rmse_deg: rmse(&rotation).to_degrees(),
        velocity_rmse_m_s: velocity_rmse(&pairs, |v| {
            similarity.reference_from_estimate.rotation * v
        }),
        final_error_m: absolute.last().copied().unwrap_or(f64::NAN),
        nees_velocity: mean_nees(&pairs, &similarity, [VELOCITY, VELOCITY + 1, VELOCITY + 2]),
        nees_tilt: mean_nees(&pairs, &similarity, [ORIENTATION, ORIENTATION + 1]),
    })
}

/// Scale error over poses thinned to [`SCALE_RATE_HZ`].
fn scale_error(
    times: &[Timestamp],
    reference: &[Pose],
    aligned: &[Pose],
) -> Result<f64, metrics::MetricsError> {
    let mut next = times.first().copied().unwrap_or_default();
    let mut thinned = (Vec::new(), Vec::new());
    for (i, time) in times.iter().enumerate() {
        if *time >= next {
            next = *time + TimeDelta::from_hz(SCALE_RATE_HZ);
            thinned.0.push(reference[i]);
            thinned.1.push(aligned[i]);
        }
    }
    let pieces = SCALE_PIECES.min(thinned.0.len().saturating_sub(1)).max(1);
    metrics::scale_error(&thinned.0, &thinned.1, pieces)
}

fn velocity_rmse(
    pairs: &[(&NavState, &TrueMotion)],
    into_reference: impl Fn(Vector3<f64>) -> Vector3<f64>,
) -> Option<f64> {
    let errors: Option<Vec<f64>> = pairs
        .iter()
        .map(|(state, truth)| {
            let velocity = truth.velocity_world?;
            Some((into_reference(state.velocity_world) - velocity).norm())
        })
        .collect();
    statistics(&errors?).map(|s| s.rmse)
}

/// Mean normalised squared error of some rows of the error state, with the truth brought into the
/// frame of the estimate. Without true velocity there is none.
fn mean_nees<const N: usize>(
    pairs: &[(&NavState, &TrueMotion)],
    similarity: &metrics::Similarity,
    rows: [usize; N],
) -> Option<f64> {
    let estimate_from_reference = similarity.reference_from_estimate.inverse();
    let values: Option<Vec<f64>> = pairs
        .iter()
        .map(|(state, truth)| {
            let pose = estimate_from_reference * truth.world_from_body;
            let velocity = estimate_from_reference.rotation * truth.velocity_world?;
            let mut error = ErrorVector::zeros();
            error
                .fixed_rows_mut::<3>(VELOCITY)
                .copy_from(&(velocity - state.velocity_world));
            let turned = so3::log(&(state.world_from_body.rotation.inverse() * pose.rotation));
            error.fixed_rows_mut::<3>(ORIENTATION).copy_from(&turned);
            metrics::nees_of(&error, &state.covariance, rows)
        })
        .collect();
    statistics(&values?).map(|s| s.mean)
}

/// Each true instant with the state nearest to it in time.
fn pair<'a>(
    states: &'a [NavState],
    truth: &'a [TrueMotion],
) -> Vec<(&'a NavState, &'a TrueMotion)> {
    truth
        .iter()
        .filter_map(|truth| {
            let after = states.partition_point(|s| s.time < truth.time);
            let near = states[after.saturating_sub(1)..(after + 1).min(states.len())].iter();
            let state = near.min_by_key(|s| (s.time - truth.time).as_ns().abs())?;
            let close = state.time.seconds_since(truth.time).abs() < MAX_TIME_DIFFERENCE_S;
            close.then_some((state, truth))
        })
        .collect()
}
