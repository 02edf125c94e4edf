//! What a detection tells about a track: innovation, and the Kalman update.

use std::borrow::Cow;

use alula_geometry::Timestamp;
use alula_messages::Footprint;
use nalgebra::{Cholesky, SMatrix, SVector};

use super::Gates;
use super::config::TrackModelConfig;
use super::faces::{FACES, Faces, side_sign};
use super::followed::Track;
use super::kalman::{MIN_SIZE_M, POSITION, SIZE, STATES, State};
use super::turns::WAYS;

/// The radius of a track is known to this standard deviation, m.
const KNOWN_RADIUS_M: f64 = 0.06;

/// The sides of a detection that are compared with a track. Those that are not have no row: they
/// differ by zero, their row of the Jacobian is zero, and their variance is one.
struct Sides<'a> {
    faces: &'a Faces,
    compared: [bool; FACES],
    jacobian: SMatrix<f64, FACES, STATES>,
    noise: SMatrix<f64, FACES, FACES>,
}

/// How a detection differs from what is predicted, side by side.
pub(super) struct Innovation {
    /// Number of sides that are compared.
    pub degrees: usize,
    /// Squared Mahalanobis distance.
    pub distance: f64,
    /// Logarithm of the innovation's determinant over that of the measurement: how vague the
    /// prediction is.
    pub log_vagueness: f64,
}

impl<'a> Sides<'a> {
    /// A side that the image cuts off is compared if it is further out than the track predicts: so
    /// much at least was seen.
    fn new(track: &Track, faces: &'a Faces) -> Self {
        let (length_of_axis, _) = track.alignment(faces.yaw_rad);
        let mut sides = Self {
            faces,
            compared: [false; FACES],
            jacobian: SMatrix::zeros(),
            noise: SMatrix::identity(),
        };
        for face in 0..FACES {
            let (axis, sign) = (&faces.axes[face / 2], side_sign(face));
            for i in 0..3 {
                sides.jacobian[(face, POSITION + i)] = axis[i];
            }
            sides.jacobian[(face, SIZE + length_of_axis[face / 2])] = 0.5 * sign;
            let further = sign * (faces.places[face] - sides.predicted(face, &track.state));
            sides.compared[face] = faces.shown[face] || further > 0.0;
            if !sides.compared[face] {
                sides.jacobian.row_mut(face).fill(0.0);
            }
        }
        for a in (0..FACES).filter(|&a| sides.compared[a]) {
            for b in (0..FACES).filter(|&b| sides.compared[b]) {
                sides.noise[(a, b)] = faces.covariance[(a, b)];
            }
        }
        sides
    }

    fn predicted(&self, face: usize, state: &State) -> f64 {
        (self.jacobian.row(face) * state.mean)[0]
    }

    fn difference(&self, state: &State) -> SVector<f64, FACES> {
        SVector::from_fn(|face, _| {
            if self.compared[face] {
                self.faces.places[face] - self.predicted(face, state)
            } else {
                0.0
            }
        })
    }

    fn innovation(&self, state: &State) -> Option<Innovation> {
        let cross = self.jacobian * state.covariance;
        let factor = Cholesky::new(cross * self.jacobian.transpose() + self.noise)?;
        let noise_factor = Cholesky::new(self.noise)?;
        let difference = self.difference(state);
        let distance = difference.dot(&factor.solve(&difference));
        let log_vagueness = log_determinant(&factor) - log_determinant(&noise_factor);
        (distance.is_finite() && log_vagueness.is_finite()).then_some(Innovation {
            degrees: self.compared.iter().filter(|&&c| c).count(),
            distance,
            log_vagueness,
        })
    }

    /// Kalman update of a state in Joseph's form; the logarithm of the likelihood, up to what is
    /// the same for all states.
    fn correct(&self, state: &mut State) -> Option<f64> {
        let cross = state.covariance * self.jacobian.transpose();
        let factor = Cholesky::new(self.jacobian * cross + self.noise)?;
        let difference = self.difference(state);
        let log_likelihood =
            -0.5 * (difference.dot(&factor.solve(&difference)) + log_determinant(&factor));
        let gain = factor.solve(&cross.transpose()).transpose();
        state.mean += gain * difference;
        let left = SMatrix::<f64, STATES, STATES>::identity() - gain * self.jacobian;
        state.covariance =
            left * state.covariance * left.transpose() + gain * self.noise * gain.transpose();
        state.symmetrise();
        for i in 0..3 {
            state.mean[SIZE + i] = state.mean[SIZE + i].max(MIN_SIZE_M);
        }
        Some(log_likelihood)
    }
}

impl Track {
    /// Compares the sides of a detection with the prediction.
    pub fn innovation(&self, faces: &Faces) -> Option<Innovation> {
        Sides::new(self, &self.as_round(faces)).innovation(&self.state)
    }

    /// The sides of a detection, of a round track whose size is known read from its flank.
    fn as_round<'a>(&self, faces: &'a Faces) -> Cow<'a, Faces> {
        let size = self.size();
        let variance = |i: usize| self.state.covariance[(SIZE + i, SIZE + i)];
        let sigma_m = 0.5 * variance(0).max(variance(1)).max(0.0).sqrt();
        let is_known = self.footprint == Footprint::Round && sigma_m < KNOWN_RADIUS_M;
        let of_round = is_known.then(|| faces.of_round(0.25 * (size.x + size.y), sigma_m));
        of_round.flatten().map_or(Cow::Borrowed(faces), Cow::Owned)
    }

    /// Takes in a detection. Beyond the gate the measurement's noise is raised until the difference
    /// would pass: a strange shape moves the track little.
    pub fn update(
        &mut self,
        time: Timestamp,
        faces: &Faces,
        gates: &Gates,
        model: &TrackModelConfig,
    ) {
        let faces = &self.as_round(faces);
        let mut sides = Sides::new(self, faces);
        let Some(innovation) = sides.innovation(&self.state) else {
            return;
        };
        let gate = gates.of_sides[innovation.degrees].max(1e-9);
        sides.noise *= (innovation.distance / gate).max(1.0);
        if self.correct(&sides).is_none() {
            return;
        }
        self.align(faces.yaw_rad);
        self.state.bound_velocity(model);
        self.mark_seen(time);
    }

    fn correct(&mut self, sides: &Sides<'_>) -> Option<()> {
        let Some(turns) = &mut self.turns else {
            return sides.correct(&mut self.state).map(|_| ());
        };
        let mut log_likelihoods = [0.0; WAYS];
        for (state, log) in turns.states_mut().iter_mut().zip(&mut log_likelihoods) {
            *log = sides.correct(state)?;
        }
        turns.weigh(&log_likelihoods);
        self.state = turns.mean();
        Some(())
    }
}

fn log_determinant(factor: &Cholesky<f64, nalgebra::Const<FACES>>) -> f64 {
    let l = factor.l_dirty();
    2.0 * (0..FACES).map(|i| l[(i, i)].ln()).sum::<f64>()
}
