//! The Kalman filter of one motion: position, velocity and lengths of a box with their covariance.

use alula_messages::{ObstacleMotion, Sight};
use nalgebra::{Cholesky, Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::config::TrackModelConfig;

/// Position, velocity, lengths.
pub(super) const STATES: usize = 9;
pub(super) const POSITION: usize = 0;
pub(super) const VELOCITY: usize = 3;
pub(super) const SIZE: usize = 6;

/// A length cannot be estimated below this, m.
pub(super) const MIN_SIZE_M: f64 = 0.02;

/// How an obstacle moves over one image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// Rate at which the velocity turns, counter-clockwise seen from above, rad/s.
    pub turn_rate_rad_s: f64,
    /// Square roots of the spectral densities of the acceleration and of the lengths' rates,
    /// m/s^2 and m/s per sqrt Hz.
    pub horizontal_noise: f64,
    pub vertical_noise: f64,
    pub size_noise: f64,
}

impl Motion {
    /// Straight on, as what is known of an obstacle suggests.
    pub fn straight(motion: ObstacleMotion, sight: Sight, model: &TrackModelConfig) -> Self {
        let is_seen = sight == Sight::Seen;
        let horizontal_noise = match motion {
            ObstacleMotion::Static => model.static_acceleration_noise_m_s2_sqrt_hz,
            _ if is_seen => model.steady_acceleration_noise_m_s2_sqrt_hz,
            _ => model.acceleration_noise_m_s2_sqrt_hz,
        };
        Self {
            turn_rate_rad_s: 0.0,
            horizontal_noise,
            vertical_noise: model.vertical_acceleration_noise_m_s2_sqrt_hz,
            size_noise: if is_seen {
                model.size_noise_m_sqrt_s
            } else {
                0.0
            },
        }
    }

    /// Integral of the velocity's rotation over `dt_s`, and the rotation.
    fn over(&self, dt_s: f64) -> (Matrix3<f64>, Matrix3<f64>) {
        let (rate, angle) = (self.turn_rate_rad_s, self.turn_rate_rad_s * dt_s);
        if angle.abs() < 1e-9 {
            return (Matrix3::identity() * dt_s, Matrix3::identity());
        }
        let (sin, cos) = angle.sin_cos();
        let turned = |a: f64, b: f64, up: f64| Matrix3::new(a, -b, 0.0, b, a, 0.0, 0.0, 0.0, up);
        let travelled = turned(sin / rate, (1.0 - cos) / rate, dt_s);
        (travelled, turned(cos, sin, 1.0))
    }
}

/// What is believed of an obstacle.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    /// Position and velocity (world), lengths along the box's axes.
    pub mean: SVector<f64, STATES>,
    pub covariance: SMatrix<f64, STATES, STATES>,
}

impl State {
    pub fn zero() -> Self {
        Self {
            mean: SVector::zeros(),
            covariance: SMatrix::zeros(),
        }
    }

    pub fn position(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(POSITION).into()
    }

    pub fn velocity(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(VELOCITY).into()
    }

    pub fn size(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(SIZE).into()
    }

    pub fn is_finite(&self) -> bool {
        self.mean
            .iter()
            .chain(&self.covariance)
            .all(|x| x.is_finite())
    }

    pub fn set_position(&mut self, position: &Vector3<f64>) {
        self.mean.fixed_rows_mut::<3>(POSITION).copy_from(position);
    }

    /// Takes the lengths of another state over, independent of position and velocity.
    pub fn take_lengths(&mut self, other: &Self) {
        for i in SIZE..STATES {
            self.mean[i] = other.mean[i];
            for j in 0..STATES {
                let known = if j < SIZE {
                    0.0
                } else {
                    other.covariance[(i, j)]
                };
                self.covariance[(i, j)] = known;
                self.covariance[(j, i)] = known;
            }
        }
    }

    pub fn shift(&mut self, by_world: &Vector3<f64>) {
        let moved = self.position() + by_world;
        self.set_position(&moved);
    }

    /// Adds variance of the velocity.
    pub fn open_velocity(&mut self, sigma_m_s: f64, model: &TrackModelConfig) {
        for (i, sigma) in [sigma_m_s, sigma_m_s, model.max_vertical_velocity_sigma_m_s]
            .into_iter()
            .enumerate()
        {
            self.covariance[(VELOCITY + i, VELOCITY + i)] += sigma * sigma;
        }
        self.bound_velocity(model);
    }

    /// Moves the state on by `dt_s` at a constant rate of turn with white acceleration.
    pub fn move_on(&mut self, dt_s: f64, motion: &Motion, model: &TrackModelConfig) {
        let (travelled, turned) = motion.over(dt_s);
        let velocity = self.velocity();
        let position = self.position() + travelled * velocity;
        self.set_position(&position);
        self.mean
            .fixed_rows_mut::<3>(VELOCITY)
            .copy_from(&(turned * velocity));
        // F P F^T with F = I but [I, travelled; 0, turned] of position and velocity, rows first.
        let p = &mut self.covariance;
        let of_velocity: SMatrix<f64, 3, STATES> = p.fixed_rows::<3>(VELOCITY).into();
        let mut rows = p.fixed_rows_mut::<3>(POSITION);
        rows += travelled * of_velocity;
        p.fixed_rows_mut::<3>(VELOCITY)
            .copy_from(&(turned * of_velocity));
        let of_velocity: SMatrix<f64, STATES, 3> = p.fixed_columns::<3>(VELOCITY).into();
        let mut columns = p.fixed_columns_mut::<3>(POSITION);
        columns += of_velocity * travelled.transpose();
        p.fixed_columns_mut::<3>(VELOCITY)
            .copy_from(&(of_velocity * turned.transpose()));
        self.add_process_noise(dt_s, motion);
        self.symmetrise();
        self.bound_velocity(model);
    }

    /// White acceleration of density q: q [dt^3/3, dt^2/2; dt^2/2, dt] of position and velocity.
    fn add_process_noise(&mut self, dt_s: f64, motion: &Motion) {
        let p = &mut self.covariance;
        let horizontal = motion.horizontal_noise;
        let noises = [horizontal, horizontal, motion.vertical_noise];
        for (i, noise) in noises.into_iter().enumerate() {
            let density = noise * noise;
            let cross = density * dt_s * dt_s / 2.0;
            p[(POSITION + i, POSITION + i)] += density * dt_s.powi(3) / 3.0;
            p[(POSITION + i, VELOCITY + i)] += cross;
            p[(VELOCITY + i, POSITION + i)] += cross;
            p[(VELOCITY + i, VELOCITY + i)] += density * dt_s;
            p[(SIZE + i, SIZE + i)] += motion.size_noise.powi(2) * dt_s;
        }
    }

    /// A standing obstacle stays where it is; only the odometry under it drifts.
    pub fn rest(&mut self, dt_s: f64, model: &TrackModelConfig) {
        let drift = model.static_drift_m_sqrt_s.powi(2) * dt_s;
        for i in 0..3 {
            self.mean[VELOCITY + i] = 0.0;
            for j in 0..STATES {
                if !(VELOCITY..SIZE).contains(&j) {
                    self.covariance[(VELOCITY + i, j)] = 0.0;
                    self.covariance[(j, VELOCITY + i)] = 0.0;
                }
            }
        }
        for i in 0..2 {
            self.covariance[(POSITION + i, POSITION + i)] += drift;
        }
    }

    /// Bounds the velocity's variance in every horizontal direction, and the vertical one.
    ///
    /// P <- M P M with M the identity but for the velocity, where it is
    /// V diag(min(1, bound / sigma_i)) V^T of the eigenvectors V of the horizontal covariance: a
    /// congruence, so that P stays positive semidefinite and the cross terms shrink along.
    pub fn bound_velocity(&mut self, model: &TrackModelConfig) {
        let bound = model.max_velocity_sigma_m_s.powi(2);
        let vertical_bound = model.max_vertical_velocity_sigma_m_s.powi(2);
        let block = self.covariance.fixed_view::<2, 2>(VELOCITY, VELOCITY);
        let (major, minor, axis) = eigen_of_symmetric(block[(0, 0)], block[(0, 1)], block[(1, 1)]);
        let vertical = self.covariance[(VELOCITY + 2, VELOCITY + 2)];
        if major <= bound && vertical <= vertical_bound {
            return;
        }
        let shrink = |variance: f64, bound: f64| (bound / variance.max(bound)).sqrt();
        let (along, across) = (shrink(major, bound), shrink(minor, bound));
        let mut factor = SMatrix::<f64, 3, 3>::identity() * across;
        for i in 0..2 {
            for j in 0..2 {
                factor[(i, j)] += (along - across) * axis[i] * axis[j];
            }
        }
        factor[(2, 2)] = shrink(vertical, vertical_bound);
        let rows = factor * self.covariance.fixed_rows::<3>(VELOCITY);
        self.covariance
            .fixed_rows_mut::<3>(VELOCITY)
            .copy_from(&rows);
        let columns = self.covariance.fixed_columns::<3>(VELOCITY) * factor;
        self.covariance
            .fixed_columns_mut::<3>(VELOCITY)
            .copy_from(&columns);
        self.symmetrise();
    }

    pub fn symmetrise(&mut self) {
        for i in 0..STATES {
            for j in 0..i {
                let mean = 0.5 * (self.covariance[(i, j)] + self.covariance[(j, i)]);
                self.covariance[(i, j)] = mean;
                self.covariance[(j, i)] = mean;
            }
        }
    }

    /// Trace of the horizontal covariance of the position, m^2.
    pub fn position_variance_m2(&self) -> f64 {
        self.covariance[(POSITION, POSITION)] + self.covariance[(POSITION + 1, POSITION + 1)]
    }

    /// Greatest standard deviation of the position in a horizontal direction, m.
    pub fn position_sigma_m(&self) -> f64 {
        let p = &self.covariance;
        let (major, ..) = eigen_of_symmetric(p[(0, 0)], p[(0, 1)], p[(1, 1)]);
        major.max(0.0).sqrt()
    }

    /// Standard deviation of the position along a horizontal direction of length one, m.
    pub fn position_sigma_along_m(&self, direction: &Vector2<f64>) -> f64 {
        let block = self.covariance.fixed_view::<2, 2>(POSITION, POSITION);
        direction.dot(&(block * direction)).max(0.0).sqrt()
    }

    /// Squared Mahalanobis distance of the horizontal velocity from zero.
    pub fn velocity_test(&self) -> f64 {
        let block = self.covariance.fixed_view::<2, 2>(VELOCITY, VELOCITY);
        let velocity = self.velocity().xy();
        let solved = Cholesky::new(block.into_owned()).map(|factor| factor.solve(&velocity));
        solved.map_or(0.0, |solved| velocity.dot(&solved))
    }
}

/// Greater and smaller eigenvalue of [a, b; b, c], and the eigenvector of the greater one.
fn eigen_of_symmetric(a: f64, b: f64, c: f64) -> (f64, f64, Vector2<f64>) {
    let (middle, half) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
    let angle = 0.5 * (2.0 * b).atan2(a - c);
    let axis = Vector2::new(angle.cos(), angle.sin());
    (middle + half, middle - half, axis)
}
