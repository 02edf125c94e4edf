//! A track from its first detection.

use alula_geometry::Timestamp;
use alula_messages::{Footprint, ObstacleMotion, Sight};
use nalgebra::{Matrix3, SMatrix, Vector3};

use super::config::TrackModelConfig;
use super::faces::{FACES, Faces};
use super::followed::Track;
use super::kalman::{MIN_SIZE_M, POSITION, SIZE, State};

impl Track {
    /// A track from one detection. A hidden side lies so that the length is at least that of the
    /// model's cut objects; the centre errs with the length, and their covariance says so.
    pub fn new(
        id: u32,
        time: Timestamp,
        footprint: Footprint,
        faces: &Faces,
        model: &TrackModelConfig,
    ) -> Self {
        let mut track = Self {
            id,
            footprint,
            state: State::zero(),
            turns: None,
            yaw_rad: faces.yaw_rad,
            motion: ObstacleMotion::Undecided,
            standing_s: 0.0,
            sight: Sight::Seen,
            sensor: 0,
            last_seen: time,
            images: 1,
            misses: 0,
            missed_s: 0.0,
        };
        let state = &mut track.state;
        let mut centre = SMatrix::<f64, 3, 6>::zeros();
        let mut variance = Vector3::zeros();
        for axis in 0..3 {
            let start = start_of_axis(faces, axis, footprint, model);
            let row = faces.axes[axis] * start.centre;
            let position = state.position() + row;
            state.set_position(&position);
            state.mean[SIZE + axis] = start.length;
            centre.row_mut(axis).copy_from(&start.centre_from_faces);
            variance[axis] = start.unseen_variance;
            let cross = faces.axes[axis] * start.centre_length_covariance;
            for i in 0..3 {
                state.covariance[(POSITION + i, SIZE + axis)] = cross[i];
                state.covariance[(SIZE + axis, POSITION + i)] = cross[i];
            }
            state.covariance[(SIZE + axis, SIZE + axis)] = start.length_variance;
        }
        let rotation = Matrix3::from_columns(&faces.axes);
        let in_box =
            centre * faces.covariance * centre.transpose() + Matrix3::from_diagonal(&variance);
        let position = rotation * in_box * rotation.transpose();
        state
            .covariance
            .fixed_view_mut::<3, 3>(POSITION, POSITION)
            .copy_from(&position);
        if footprint == Footprint::Round {
            state.open_velocity(model.max_velocity_sigma_m_s, model);
        } else {
            track.motion = ObstacleMotion::Static;
        }
        state.symmetrise();
        track
    }
}

/// Centre and length along one axis, as one image shows them.
struct AxisStart {
    centre: f64,
    length: f64,
    length_variance: f64,
    /// Row that makes the centre from the sides.
    centre_from_faces: SMatrix<f64, 1, FACES>,
    /// Variance of the centre that the sides do not have.
    unseen_variance: f64,
    centre_length_covariance: f64,
}

fn start_of_axis(
    faces: &Faces,
    axis: usize,
    footprint: Footprint,
    model: &TrackModelConfig,
) -> AxisStart {
    let (low, high) = (2 * axis, 2 * axis + 1);
    let p = &faces.covariance;
    let seen_length = faces.length_m(axis);
    let prior = if axis < 2 && footprint == Footprint::Round {
        model.cut_width_m
    } else {
        0.0
    };
    let length = seen_length.max(prior).max(MIN_SIZE_M);
    let variance = model.cut_sigma_m.powi(2);
    let mut row = SMatrix::<f64, 1, FACES>::zeros();
    let middle = 0.5 * (faces.places[low] + faces.places[high]);
    match (faces.shown[low], faces.shown[high]) {
        (true, true) => {
            row[low] = 0.5;
            row[high] = 0.5;
            AxisStart {
                centre: middle,
                length: seen_length.max(MIN_SIZE_M),
                length_variance: p[(low, low)] + p[(high, high)] - 2.0 * p[(low, high)],
                centre_from_faces: row,
                unseen_variance: 0.0,
                centre_length_covariance: 0.5 * (p[(high, high)] - p[(low, low)]),
            }
        }
        (false, false) => {
            row[low] = 0.5;
            row[high] = 0.5;
            AxisStart {
                centre: middle,
                length,
                length_variance: variance,
                centre_from_faces: row,
                unseen_variance: 0.25 * variance,
                centre_length_covariance: 0.0,
            }
        }
        (low_shown, _) => {
            let (shown, sign) = if low_shown { (low, 1.0) } else { (high, -1.0) };
            row[shown] = 1.0;
            AxisStart {
                centre: faces.places[shown] + sign * 0.5 * length,
                length,
                length_variance: variance,
                centre_from_faces: row,
                unseen_variance: 0.25 * variance,
                centre_length_covariance: sign * 0.5 * variance,
            }
        }
    }
}
