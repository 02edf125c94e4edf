//! State of one track: position, velocity and lengths of the box; and how it goes on unseen.

use std::f64::consts::{FRAC_PI_2, PI};

use alula_geometry::Timestamp;
use alula_messages::{Footprint, Obstacle, ObstacleMotion, Sight};
use nalgebra::{Cholesky, SMatrix, SVector, Vector2, Vector3};

use super::config::TrackModelConfig;
use super::update::TurnSum;

/// Position, velocity, lengths.
pub(super) const STATES: usize = 9;
pub(super) const POSITION: usize = 0;
pub(super) const VELOCITY: usize = 3;
pub(super) const SIZE: usize = 6;

/// A length cannot be estimated below this, m.
pub(super) const MIN_SIZE_M: f64 = 0.02;

/// One followed obstacle.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub id: u32,
    pub footprint: Footprint,
    /// Position and velocity (world), lengths along the box's axes.
    pub mean: SVector<f64, STATES>,
    pub covariance: SMatrix<f64, STATES, STATES>,
    pub yaw_rad: f64,
    pub motion: ObstacleMotion,
    /// Time for which the velocity has counted as zero, s.
    pub standing_s: f64,
    pub turn: TurnSum,
    pub sight: Sight,
    pub last_seen: Timestamp,
    pub images: u32,
    /// Images in sequence without detection though the view is free beyond.
    pub misses: u32,
    /// Time without detection though it should be seen, s.
    pub missed_s: f64,
}

impl Track {
    pub fn position(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(POSITION).into()
    }

    pub fn velocity(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(VELOCITY).into()
    }

    pub fn size(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(SIZE).into()
    }

    pub fn shift(&mut self, by_world: &Vector3<f64>) {
        let moved = self.position() + by_world;
        self.mean.fixed_rows_mut::<3>(POSITION).copy_from(&moved);
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

    /// Moves the state on by `dt_s`: constant velocity with white acceleration while the obstacle
    /// may move, rest for standing ones that are not seen.
    pub fn predict(&mut self, dt_s: f64, model: &TrackModelConfig) {
        let at_rest = self.motion == ObstacleMotion::Static && self.sight != Sight::Seen;
        if self.footprint == Footprint::Flat || at_rest {
            self.rest(dt_s, model);
        } else {
            self.move_on(dt_s, model);
        }
    }

    fn move_on(&mut self, dt_s: f64, model: &TrackModelConfig) {
        let p = &mut self.covariance;
        let velocity: Vector3<f64> = self.mean.fixed_rows::<3>(VELOCITY).into();
        let position = self.mean.fixed_rows::<3>(POSITION) + velocity * dt_s;
        self.mean.fixed_rows_mut::<3>(POSITION).copy_from(&position);
        // F P F^T with F = I + dt in the block (position, velocity), rows first.
        for row in 0..3 {
            for column in 0..STATES {
                p[(POSITION + row, column)] += dt_s * p[(VELOCITY + row, column)];
            }
        }
        for column in 0..3 {
            for row in 0..STATES {
                p[(row, POSITION + column)] += dt_s * p[(row, VELOCITY + column)];
            }
        }
        self.add_process_noise(dt_s, model);
        self.symmetrise();
        self.bound_velocity(model);
    }

    /// White acceleration of density q: q [dt^3/3, dt^2/2; dt^2/2, dt] of position and velocity.
    fn add_process_noise(&mut self, dt_s: f64, model: &TrackModelConfig) {
        let horizontal = match (self.motion, self.sight) {
            (ObstacleMotion::Static, _) => model.static_acceleration_noise_m_s2_sqrt_hz,
            (_, Sight::Seen) => model.steady_acceleration_noise_m_s2_sqrt_hz,
            _ => model.acceleration_noise_m_s2_sqrt_hz,
        };
        let vertical = model.vertical_acceleration_noise_m_s2_sqrt_hz;
        let p = &mut self.covariance;
        for (i, noise) in [horizontal, horizontal, vertical].into_iter().enumerate() {
            let density = noise * noise;
            let cross = density * dt_s * dt_s / 2.0;
            p[(POSITION + i, POSITION + i)] += density * dt_s.powi(3) / 3.0;
            p[(POSITION + i, VELOCITY + i)] += cross;
            p[(VELOCITY + i, POSITION + i)] += cross;
            p[(VELOCITY + i, VELOCITY + i)] += density * dt_s;
        }
        if self.sight == Sight::Seen {
            let variance = model.size_noise_m_sqrt_s.powi(2) * dt_s;
            for i in 0..3 {
                p[(SIZE + i, SIZE + i)] += variance;
            }
        }
    }

    /// A standing obstacle stays where it is; only the odometry under it drifts.
    fn rest(&mut self, dt_s: f64, model: &TrackModelConfig) {
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

    /// Which of the track's lengths lies along each axis of a box, and how far the track must
    /// turn to be aligned with it (to a quarter turn), rad.
    pub fn alignment(&self, yaw_rad: f64) -> ([usize; 3], f64) {
        let turn = yaw_rad - self.yaw_rad;
        let quarters = (turn / FRAC_PI_2).round();
        let rest = turn - quarters * FRAC_PI_2;
        let odd = quarters.rem_euclid(2.0) != 0.0;
        (if odd { [1, 0, 2] } else { [0, 1, 2] }, rest)
    }

    pub fn mark_seen(&mut self, time: Timestamp) {
        self.sight = Sight::Seen;
        self.last_seen = time;
        self.images = self.images.saturating_add(1);
        self.misses = 0;
        self.missed_s = 0.0;
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

    /// Half the extent of the footprint along a horizontal direction of length one, m: of the
    /// ellipse in the box.
    pub fn reach_m(&self, direction: &Vector2<f64>) -> f64 {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let along = direction.x * cos + direction.y * sin;
        let across = direction.y * cos - direction.x * sin;
        0.5 * (self.mean[SIZE] * along).hypot(self.mean[SIZE + 1] * across)
    }

    /// Whether a point lies within the box, widened by a margin, seen from above.
    pub fn covers(&self, point: &Vector3<f64>, margin_m: f64) -> bool {
        covers(
            &self.position(),
            self.yaw_rad,
            &self.size(),
            point,
            margin_m,
        )
    }

    /// What others see of the track.
    pub fn obstacle(&self, time: Timestamp) -> Obstacle {
        let stands = self.motion == ObstacleMotion::Static;
        let size_variance = Vector3::from_fn(|i, _| self.covariance[(SIZE + i, SIZE + i)]);
        Obstacle {
            id: self.id,
            time,
            centre_world: self.position(),
            velocity_world: if stands {
                Vector3::zeros()
            } else {
                self.velocity()
            },
            covariance: self.covariance.fixed_view::<6, 6>(0, 0).into(),
            yaw_rad: self.yaw_rad,
            size_m: self.size(),
            size_variance_m2: size_variance,
            footprint: self.footprint,
            motion: self.motion,
            sight: self.sight,
            last_seen: self.last_seen,
            images: self.images,
        }
    }
}

/// Whether a point lies within a box, widened by a margin, seen from above.
pub(super) fn covers(
    centre: &Vector3<f64>,
    yaw_rad: f64,
    size: &Vector3<f64>,
    point: &Vector3<f64>,
    margin_m: f64,
) -> bool {
    let (sin, cos) = yaw_rad.sin_cos();
    let offset = point - centre;
    let along = offset.x * cos + offset.y * sin;
    let across = offset.y * cos - offset.x * sin;
    along.abs() <= 0.5 * size.x + margin_m && across.abs() <= 0.5 * size.y + margin_m
}

/// Angle in (-pi, pi], rad.
pub(super) fn wrap(angle: f64) -> f64 {
    let turned = angle.rem_euclid(2.0 * PI);
    if turned > PI {
        turned - 2.0 * PI
    } else {
        turned
    }
}

/// Greater and smaller eigenvalue of [a, b; b, c], and the eigenvector of the greater one.
fn eigen_of_symmetric(a: f64, b: f64, c: f64) -> (f64, f64, Vector2<f64>) {
    let (middle, half) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
    let angle = 0.5 * (2.0 * b).atan2(a - c);
    let axis = Vector2::new(angle.cos(), angle.sin());
    (middle + half, middle - half, axis)
}
