//! What the cascade tells the world: a full state whose covariance admits what is not estimated.

use alula_geometry::{GRAVITY_M_S2, Pose};
use alula_messages::{ErrorCovariance, error_index};
use nalgebra::{Matrix3, Translation3, Vector2, Vector3};

use super::Cascade;
use super::kalman::{BIAS, HEIGHT, Push, VELOCITY, VelocityFilter};

use error_index::{ACCELEROMETER_BIAS, GYROSCOPE_BIAS, ORIENTATION, POSITION};

/// Horizontal position by dead reckoning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    position: Vector2<f64>,
    sigma_m: f64,
}

impl Default for Drift {
    fn default() -> Self {
        Self::at(Vector2::zeros(), 0.0)
    }
}

impl Drift {
    /// At a place with a standard deviation on each axis, m.
    pub fn at(position: Vector2<f64>, sigma_m: f64) -> Self {
        Self { position, sigma_m }
    }

    /// Integrates velocity over `dt_s`. How its error and that of the heading are correlated in time
    /// is not known; the standard deviation grows as if they never changed sign, which is the most
    /// it can.
    pub fn pass(&mut self, filter: &VelocityFilter, yaw_sigma_rad: f64, dt_s: f64) {
        let velocity = filter.velocity_world.xy();
        let p = &filter.covariance;
        let velocity_sigma = p[(VELOCITY, VELOCITY)]
            .max(p[(VELOCITY + 1, VELOCITY + 1)])
            .max(0.0)
            .sqrt();
        self.position += velocity * dt_s;
        self.sigma_m += (velocity_sigma + velocity.norm() * yaw_sigma_rad) * dt_s;
    }
}

impl Push {
    /// Of a vehicle that stands level.
    pub fn level() -> Self {
        Self {
            rotation: Matrix3::identity(),
            force: Vector3::z() * GRAVITY_M_S2,
            noise: 0.0,
            tilt_sigma_rad: 0.0,
            unseen_s: 0.0,
        }
    }
}

impl Cascade {
    /// Brings the published state up to date.
    pub(super) fn publish(&mut self) {
        self.state.phase = self.phase;
        let Some(latest) = self.past.latest().filter(|_| self.running) else {
            return;
        };
        self.state.time = latest.time;
        self.state.health = self.health();
        let place = self.drift.position;
        let position = Vector3::new(place.x, place.y, self.velocity.height_m);
        let attitude = *self.attitude.world_from_body();
        self.state.world_from_body = Pose::from_parts(Translation3::from(position), attitude);
        self.state.velocity_world = self.velocity.velocity_world;
        self.state.gyroscope_bias = *self.attitude.gyroscope_bias();
        self.state.angular_rate_body = latest.angular_rate - self.state.gyroscope_bias;
        self.state.acceleration_world = self.velocity.acceleration_world(&self.push);
        self.state.accelerometer_bias = self.velocity.accelerometer_bias;
        self.state.covariance = self.covariance();
    }

    /// Independent sources, each with its effect: the Kalman filter's own covariance, tilt, heading
    /// (which turns the horizontal velocity as well), the gyroscope's bias, and the drift of position.
    fn covariance(&self) -> ErrorCovariance {
        let mut p = ErrorCovariance::zeros();
        let q = &self.velocity.covariance;
        // Rows of the state for each row of the Kalman filter.
        let row = |i: usize| match i {
            HEIGHT => POSITION + 2,
            _ if i >= BIAS => ACCELEROMETER_BIAS + i - BIAS,
            _ => error_index::VELOCITY + i,
        };
        for i in 0..7 {
            for j in 0..7 {
                p[(row(i), row(j))] = q[(i, j)];
            }
        }
        for i in POSITION..POSITION + 2 {
            p[(i, i)] = self.drift.sigma_m * self.drift.sigma_m;
        }
        let gyroscope = self.attitude.gyroscope_bias_sigma_rad_s();
        for i in GYROSCOPE_BIAS..GYROSCOPE_BIAS + 3 {
            p[(i, i)] = gyroscope * gyroscope;
        }
        self.add_attitude(&mut p);
        p
    }

    fn add_attitude(&self, p: &mut ErrorCovariance) {
        let up = self.attitude.world_from_body().inverse() * Vector3::z();
        let upright = up * up.transpose();
        let level = Matrix3::identity() - upright;
        let tilt = self.attitude.tilt_sigma_rad().powi(2);
        let yaw = self.attitude.yaw_sigma_rad().powi(2);
        p.fixed_view_mut::<3, 3>(ORIENTATION, ORIENTATION)
            .copy_from(&(level * tilt + upright * yaw));
        // The bias was found as seen from an attitude that is wrong by the tilt error.
        let mut bias = p.fixed_view_mut::<3, 3>(ACCELEROMETER_BIAS, ACCELEROMETER_BIAS);
        bias += level * (tilt * GRAVITY_M_S2 * GRAVITY_M_S2);
        // A heading error `e` turns the velocity by e3 x v e and the body by `up` e.
        let turned = Vector3::z().cross(&self.velocity.velocity_world);
        let cross = turned * up.transpose() * yaw;
        let mut velocity = p.fixed_view_mut::<3, 3>(error_index::VELOCITY, error_index::VELOCITY);
        velocity += turned * turned.transpose() * yaw;
        p.fixed_view_mut::<3, 3>(error_index::VELOCITY, ORIENTATION)
            .copy_from(&cross);
        p.fixed_view_mut::<3, 3>(ORIENTATION, error_index::VELOCITY)
            .copy_from(&cross.transpose());
    }
}
