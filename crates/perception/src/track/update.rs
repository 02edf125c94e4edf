//! What a detection tells about a track: innovation, turns, and the Kalman update.

use alula_geometry::Timestamp;
use alula_messages::ObstacleMotion;
use nalgebra::{Cholesky, Matrix2, SMatrix, SVector, Vector2};

use super::Gates;
use super::config::TrackModelConfig;
use super::faces::{FACES, Faces, side_sign};
use super::kalman::{MIN_SIZE_M, POSITION, SIZE, STATES, Track, VELOCITY, wrap};

/// Recent corrections of the horizontal velocity, fading.
///
/// The corrections `K nu` of a filter that is right are independent, with covariance `K S K^T`; a
/// turn makes them point the same way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TurnSum {
    sum: Vector2<f64>,
    covariance: Matrix2<f64>,
}

impl TurnSum {
    fn add(&mut self, kept: f64, step: &Correction) {
        let of_velocity = step.gain.fixed_rows::<2>(VELOCITY) * step.innovation.difference;
        self.sum = self.sum * kept + of_velocity;
        self.covariance = self.covariance * (kept * kept) + step.velocity_covariance;
    }

    /// Squared Mahalanobis distance from zero; chi-square of two degrees without a turn.
    fn test(&self) -> f64 {
        let factor = Cholesky::new(self.covariance);
        factor.map_or(0.0, |factor| self.sum.dot(&factor.solve(&self.sum)))
    }
}

/// How a detection differs from what a track predicts, side by side. Sides that the image does
/// not show have no row: innovation and row are zero, variance is one.
pub(super) struct Innovation {
    difference: SVector<f64, FACES>,
    jacobian: SMatrix<f64, FACES, STATES>,
    noise: SMatrix<f64, FACES, FACES>,
    /// Number of sides that are compared.
    pub degrees: usize,
    /// Squared Mahalanobis distance.
    pub distance: f64,
    /// Logarithm of the innovation's determinant over that of the measurement: how vague the
    /// prediction is.
    pub log_vagueness: f64,
}

/// What a detection changes.
struct Correction {
    innovation: Innovation,
    gain: SMatrix<f64, STATES, FACES>,
    /// Covariance of the correction of the horizontal velocity, m^2/s^2.
    velocity_covariance: Matrix2<f64>,
}

impl Track {
    /// Compares the sides of a detection with the prediction. A side that the image cuts off is
    /// compared if it is further out than predicted: so much at least was seen.
    pub fn innovation(&self, faces: &Faces) -> Option<Innovation> {
        let (length_of_axis, _) = self.alignment(faces.yaw_rad);
        let position = self.position();
        let mut difference = SVector::<f64, FACES>::zeros();
        let mut jacobian = SMatrix::<f64, FACES, STATES>::zeros();
        let mut compared = [false; FACES];
        for face in 0..FACES {
            let (axis, sign) = (&faces.axes[face / 2], side_sign(face));
            let length = SIZE + length_of_axis[face / 2];
            let predicted = axis.dot(&position) + sign * 0.5 * self.mean[length];
            let further = faces.places[face] - predicted;
            compared[face] = faces.shown[face] || sign * further > 0.0;
            if compared[face] {
                difference[face] = further;
                for i in 0..3 {
                    jacobian[(face, POSITION + i)] = axis[i];
                }
                jacobian[(face, length)] = sign * 0.5;
            }
        }
        let mut noise = SMatrix::<f64, FACES, FACES>::identity();
        for a in (0..FACES).filter(|&a| compared[a]) {
            for b in (0..FACES).filter(|&b| compared[b]) {
                noise[(a, b)] = faces.covariance[(a, b)];
            }
        }
        let noise_factor = Cholesky::new(noise)?;
        let total = jacobian * self.covariance * jacobian.transpose() + noise;
        let factor = Cholesky::new(total)?;
        let distance = difference.dot(&factor.solve(&difference));
        let log_vagueness = log_determinant(&factor) - log_determinant(&noise_factor);
        (distance.is_finite() && log_vagueness.is_finite()).then_some(Innovation {
            difference,
            jacobian,
            noise,
            degrees: compared.iter().filter(|&&c| c).count(),
            distance,
            log_vagueness,
        })
    }

    /// Kalman update in Joseph's form, by a detection that may reveal a turn.
    pub fn update(
        &mut self,
        time: Timestamp,
        faces: &Faces,
        gates: &Gates,
        model: &TrackModelConfig,
    ) {
        let Some(mut step) = self.correction(faces, gates) else {
            return;
        };
        let kept = (-time.seconds_since(self.last_seen) / model.turn_memory_s).exp();
        self.turn.add(kept, &step);
        // A box that the image cuts off changes its shape in ways that look like turns.
        let is_whole = faces.shown[..4].iter().all(|&shown| shown);
        if is_whole && self.motion != ObstacleMotion::Static && self.turn.test() > gates.turn {
            self.turn = TurnSum::default();
            self.open_turn(model);
            match self.correction(faces, gates) {
                Some(again) => step = again,
                None => return,
            }
        }
        self.mean += step.gain * step.innovation.difference;
        let left =
            SMatrix::<f64, STATES, STATES>::identity() - step.gain * step.innovation.jacobian;
        self.covariance = left * self.covariance * left.transpose()
            + step.gain * step.innovation.noise * step.gain.transpose();
        self.symmetrise();
        for i in 0..3 {
            self.mean[SIZE + i] = self.mean[SIZE + i].max(MIN_SIZE_M);
        }
        let (_, turn) = self.alignment(faces.yaw_rad);
        self.yaw_rad = wrap(self.yaw_rad + turn);
        self.bound_velocity(model);
        self.mark_seen(time);
    }

    /// What a detection would change. Beyond the gate the measurement's noise is raised until the
    /// difference would pass: a strange shape moves the track little.
    fn correction(&self, faces: &Faces, gates: &Gates) -> Option<Correction> {
        let mut innovation = self.innovation(faces)?;
        let gate = gates.of_sides[innovation.degrees].max(1e-9);
        innovation.noise *= (innovation.distance / gate).max(1.0);
        let cross = self.covariance * innovation.jacobian.transpose();
        let factor = Cholesky::new(innovation.jacobian * cross + innovation.noise)?;
        let gain = factor.solve(&cross.transpose()).transpose();
        Some(Correction {
            velocity_covariance: gain.fixed_rows::<2>(VELOCITY)
                * cross.fixed_rows::<2>(VELOCITY).transpose(),
            innovation,
            gain,
        })
    }

    /// The velocity jumped `turn_delay_s` ago, by a normal draw in each direction: adds
    /// `s^2 [d^2, d; d, 1]` to the covariance of position and velocity.
    fn open_turn(&mut self, model: &TrackModelConfig) {
        let (variance, delay_s) = (model.turn_sigma_m_s.powi(2), model.turn_delay_s);
        let p = &mut self.covariance;
        for i in 0..2 {
            p[(POSITION + i, POSITION + i)] += variance * delay_s * delay_s;
            p[(POSITION + i, VELOCITY + i)] += variance * delay_s;
            p[(VELOCITY + i, POSITION + i)] += variance * delay_s;
            p[(VELOCITY + i, VELOCITY + i)] += variance;
        }
    }
}

fn log_determinant(factor: &Cholesky<f64, nalgebra::Const<FACES>>) -> f64 {
    let l = factor.l_dirty();
    2.0 * (0..FACES).map(|i| l[(i, i)].ln()).sum::<f64>()
}
