//! The error-state Kalman filter: nominal state, covariance of its error, propagation and fusion.
//!
//! Local orientation error, zeroth-order backward quaternion integration (Q0B) and first-order
//! transition (F1) of document S, sections 2.5 and 2.6. Derivation:
//! `docs/derivations/error-state-kalman-filter.md`.

use alula_geometry::{gravity_world, so3};
use alula_messages::{ErrorCovariance, error_index};
use alula_parameters::parameters;
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use error_index::{ACCELEROMETER_BIAS, GYROSCOPE_BIAS, ORIENTATION, POSITION, VELOCITY};

/// The error state in the order of [`error_index`].
pub type ErrorVector = SVector<f64, 15>;

/// Longest single step of integration, s: longer intervals are cut into equal steps.
///
/// F1 leaves out terms of the size (rate * dt)^2 / 2: below 0.5 % up to 10 rad/s.
const LONGEST_STEP_S: f64 = 0.01;

/// Least standard deviations that the covariance may reach: m, m/s, rad, m/s^2, rad/s.
///
/// Far below what any of the sensors can resolve; they keep the covariance invertible.
const LEAST_SIGMA: [f64; 5] = [1e-5, 1e-5, 1e-6, 1e-6, 1e-7];

/// Greatest standard deviations that the covariance may reach, in the same order.
///
/// Beyond them the linearisation means nothing, whatever the number is.
const GREATEST_SIGMA: [f64; 5] = [1e4, 1e2, 2.0, 5.0, 1.0];

parameters! {
    /// Noise of the inertial unit as the filter assumes it, including the vibration of the
    /// propellers, which dominates what the unit's own data sheet promises (document S, 2.10.2).
    pub struct ImuNoise {
        /// White noise of the accelerometer, m/s^2/sqrt(Hz). 0.4 m/s^2 at 100 Hz (S, table 2.4).
        pub accelerometer_noise_m_s2_sqrt_hz: f64 = 0.04, within(1e-5, 10.0);
        /// White noise of the gyroscope, rad/s/sqrt(Hz). 0.005 rad/s at 100 Hz (S, table 2.4).
        pub gyroscope_noise_rad_s_sqrt_hz: f64 = 5e-4, within(1e-7, 1.0);
        /// Random walk of the accelerometer bias, m/s^3/sqrt(Hz). Three times L, table A-1.
        pub accelerometer_bias_walk_m_s3_sqrt_hz: f64 = 1e-3, within(0.0, 1.0);
        /// Random walk of the gyroscope bias, rad/s^2/sqrt(Hz). Three times L, table A-1.
        pub gyroscope_bias_walk_rad_s2_sqrt_hz: f64 = 1e-5, within(0.0, 1.0);
    }
}

/// What the inertial unit says about an interval of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialInput {
    /// Specific force, body frame, m/s^2, bias included.
    pub specific_force: Vector3<f64>,
    /// Angular rate, body frame, rad/s, bias included.
    pub angular_rate: Vector3<f64>,
    /// Factor on the standard deviation of the white noise: 1, or more for invented samples.
    pub noise_scale: f64,
}

/// The nominal state (document S, equation 2.1b).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nominal {
    /// Position of the body's origin, world frame, m.
    pub position_world: Vector3<f64>,
    /// Its velocity, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Orientation.
    pub world_from_body: UnitQuaternion<f64>,
    /// Accelerometer bias, body frame, m/s^2.
    pub accelerometer_bias: Vector3<f64>,
    /// Gyroscope bias, body frame, rad/s.
    pub gyroscope_bias: Vector3<f64>,
}

impl Default for Nominal {
    fn default() -> Self {
        Self {
            position_world: Vector3::zeros(),
            velocity_world: Vector3::zeros(),
            world_from_body: UnitQuaternion::identity(),
            accelerometer_bias: Vector3::zeros(),
            gyroscope_bias: Vector3::zeros(),
        }
    }
}

impl Nominal {
    /// The composition of nominal state and error (document S, equations 2.2, 2.3b).
    pub fn plus(&self, error: &ErrorVector) -> Self {
        let part = |row| error.fixed_rows::<3>(row).into_owned();
        Self {
            position_world: self.position_world + part(POSITION),
            velocity_world: self.velocity_world + part(VELOCITY),
            world_from_body: renormalised(self.world_from_body * so3::exp(&part(ORIENTATION))),
            accelerometer_bias: self.accelerometer_bias + part(ACCELEROMETER_BIAS),
            gyroscope_bias: self.gyroscope_bias + part(GYROSCOPE_BIAS),
        }
    }

    /// The error that composed with `self` gives `other`.
    pub fn error_to(&self, other: &Self) -> ErrorVector {
        let turn = so3::log(&(self.world_from_body.inverse() * other.world_from_body));
        let mut error = ErrorVector::zeros();
        let mut set = |row, part: Vector3<f64>| error.fixed_rows_mut::<3>(row).copy_from(&part);
        set(POSITION, other.position_world - self.position_world);
        set(VELOCITY, other.velocity_world - self.velocity_world);
        set(ORIENTATION, turn);
        set(
            ACCELEROMETER_BIAS,
            other.accelerometer_bias - self.accelerometer_bias,
        );
        set(GYROSCOPE_BIAS, other.gyroscope_bias - self.gyroscope_bias);
        error
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let vectors = [
            self.position_world,
            self.velocity_world,
            self.accelerometer_bias,
            self.gyroscope_bias,
        ];
        vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
            && self.world_from_body.coords.iter().all(|x| x.is_finite())
    }

    /// Acceleration of the body's origin under `input`, world frame, m/s^2.
    pub fn acceleration_world(&self, input: &InertialInput) -> Vector3<f64> {
        self.world_from_body * (input.specific_force - self.accelerometer_bias) + gravity_world()
    }
}

/// One step of a unit quaternion towards length 1: exact to rounding after each composition.
fn renormalised(q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let factor = 1.5 - 0.5 * q.coords.norm_squared();
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::from(q.coords * factor))
}

/// A measurement of `M` numbers seen from the present nominal state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linearised<const M: usize> {
    /// Measurement less prediction (document S, equation 2.53a).
    pub innovation: SVector<f64, M>,
    /// Derivative of the prediction with respect to the error state.
    pub jacobian: SMatrix<f64, M, 15>,
    /// Variances of the measurement's noise.
    pub variance: SVector<f64, M>,
}

/// What came of an attempt to fuse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome<const M: usize> {
    /// Variances of the innovation.
    pub innovation_variance: SVector<f64, M>,
    /// Squared Mahalanobis distance of the innovation (document S, equation 2.54).
    pub mahalanobis_squared: f64,
    /// Whether the innovation was within the gate and the state corrected.
    pub accepted: bool,
}

/// Nominal state and covariance of its error.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    /// The best estimate.
    pub nominal: Nominal,
    /// Covariance of the error of [`Self::nominal`].
    pub covariance: ErrorCovariance,
}

impl Filter {
    /// A filter from a state and independent standard deviations, one for each kind of error:
    /// position (m), velocity (m/s), orientation (rad), accelerometer bias, gyroscope bias.
    pub fn new(nominal: Nominal, sigma: [Vector3<f64>; 5]) -> Self {
        let diagonal = ErrorVector::from_fn(|i, _| sigma[i / 3][i % 3].powi(2));
        Self {
            nominal,
            covariance: ErrorCovariance::from_diagonal(&diagonal),
        }
    }

    /// Whether every number of state and variances is finite.
    pub fn is_finite(&self) -> bool {
        self.nominal.is_finite() && self.covariance.iter().all(|x| x.is_finite())
    }

    /// Lets `duration_s` pass under a constant `input`.
    pub fn propagate(&mut self, input: &InertialInput, duration_s: f64, noise: &ImuNoise) {
        if duration_s <= 0.0 {
            return;
        }
        let steps = (duration_s / LONGEST_STEP_S - 1e-6).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(input, duration_s / steps, noise);
        }
        self.bound_covariance();
    }

    /// One step of document S, equations 2.34, 2.35f, 2.35g and 2.50b.
    fn step(&mut self, input: &InertialInput, dt_s: f64, noise: &ImuNoise) {
        let force = input.specific_force - self.nominal.accelerometer_bias;
        let rate = input.angular_rate - self.nominal.gyroscope_bias;
        let half_turn = so3::exp(&(rate * (0.5 * dt_s)));
        let middle = self.nominal.world_from_body * half_turn;
        let rotation = middle.to_rotation_matrix().into_inner();

        self.advance_covariance(&rotation, &force, &rate, dt_s);
        self.add_process_noise(input.noise_scale, dt_s, noise);

        let acceleration = rotation * force + gravity_world();
        let nominal = &mut self.nominal;
        nominal.position_world +=
            nominal.velocity_world * dt_s + acceleration * (0.5 * dt_s * dt_s);
        nominal.velocity_world += acceleration * dt_s;
        nominal.world_from_body = renormalised(middle * half_turn);
    }

    /// `P <- F P F^T`, one block row and one block column at a time: of the 25 blocks of F only
    /// five beside the identity are not zero.
    fn advance_covariance(
        &mut self,
        rotation: &Matrix3<f64>,
        force: &Vector3<f64>,
        rate: &Vector3<f64>,
        dt_s: f64,
    ) {
        let velocity_from_turn = rotation * so3::skew(force) * -dt_s;
        let velocity_from_bias = rotation * -dt_s;
        let turn_from_turn = so3::skew(rate) * -dt_s;

        let p = &self.covariance;
        let mut fp = *p;
        let rows = |row| p.fixed_rows::<3>(row);
        let mut target = fp.fixed_rows_mut::<3>(POSITION);
        target += rows(VELOCITY) * dt_s;
        let mut target = fp.fixed_rows_mut::<3>(VELOCITY);
        target +=
            velocity_from_turn * rows(ORIENTATION) + velocity_from_bias * rows(ACCELEROMETER_BIAS);
        let mut target = fp.fixed_rows_mut::<3>(ORIENTATION);
        target += turn_from_turn * rows(ORIENTATION) - rows(GYROSCOPE_BIAS) * dt_s;

        let mut fpf = fp;
        let columns = |column| fp.fixed_columns::<3>(column);
        let mut target = fpf.fixed_columns_mut::<3>(POSITION);
        target += columns(VELOCITY) * dt_s;
        let mut target = fpf.fixed_columns_mut::<3>(VELOCITY);
        target += columns(ORIENTATION) * velocity_from_turn.transpose()
            + columns(ACCELEROMETER_BIAS) * velocity_from_bias.transpose();
        let mut target = fpf.fixed_columns_mut::<3>(ORIENTATION);
        target +=
            columns(ORIENTATION) * turn_from_turn.transpose() - columns(GYROSCOPE_BIAS) * dt_s;
        self.covariance = fpf;
    }

    /// Variances of the impulses (document S, equation 2.36), from densities: variance grows
    /// with time, not with its square.
    fn add_process_noise(&mut self, scale: f64, dt_s: f64, noise: &ImuNoise) {
        let parts = [
            (VELOCITY, noise.accelerometer_noise_m_s2_sqrt_hz * scale),
            (ORIENTATION, noise.gyroscope_noise_rad_s_sqrt_hz * scale),
            (
                ACCELEROMETER_BIAS,
                noise.accelerometer_bias_walk_m_s3_sqrt_hz,
            ),
            (GYROSCOPE_BIAS, noise.gyroscope_bias_walk_rad_s2_sqrt_hz),
        ];
        for (row, density) in parts {
            for i in row..row + 3 {
                self.covariance[(i, i)] += density * density * dt_s;
            }
        }
    }

    /// Corrects the state if the innovation passes the gate (document S, 2.53-2.61).
    ///
    /// `gate` is a quantile of chi-square with `M` degrees of freedom.
    pub fn fuse<const M: usize>(&mut self, seen: &Linearised<M>, gate: f64) -> Outcome<M> {
        let p_ht = self.covariance * seen.jacobian.transpose();
        let noise = SMatrix::<f64, M, M>::from_diagonal(&seen.variance);
        let z = seen.jacobian * p_ht + noise;
        let mut outcome = Outcome {
            innovation_variance: z.diagonal(),
            mahalanobis_squared: f64::INFINITY,
            accepted: false,
        };
        let Some(z_inverse) = z.try_inverse() else {
            return outcome;
        };
        outcome.mahalanobis_squared =
            (seen.innovation.transpose() * z_inverse * seen.innovation)[0];
        outcome.accepted = outcome.mahalanobis_squared <= gate;
        if outcome.accepted {
            let gain = p_ht * z_inverse;
            self.joseph(&gain, &p_ht, &seen.jacobian, &noise);
            self.inject(&(gain * seen.innovation));
        }
        outcome
    }

    /// `P <- (I - K H) P (I - K H)^T + K N K^T` in an order that needs no 15x15 product.
    fn joseph<const M: usize>(
        &mut self,
        gain: &SMatrix<f64, 15, M>,
        p_ht: &SMatrix<f64, 15, M>,
        jacobian: &SMatrix<f64, M, 15>,
        noise: &SMatrix<f64, M, M>,
    ) {
        let left = self.covariance - gain * p_ht.transpose();
        let left_ht = left * jacobian.transpose();
        self.covariance = left + (gain * noise - left_ht) * gain.transpose();
    }

    /// Moves the observed error into the nominal state and expresses the remaining error there:
    /// the rows and columns of the orientation turn by the right Jacobian, I - [error/2]x to first
    /// order (document S, equations 2.57b, 2.61).
    fn inject(&mut self, error: &ErrorVector) {
        self.nominal = self.nominal.plus(error);
        let turn = error.fixed_rows::<3>(ORIENTATION).into_owned();
        let reset = so3::right_jacobian(&turn);
        let rows = reset * self.covariance.fixed_rows::<3>(ORIENTATION);
        self.covariance
            .fixed_rows_mut::<3>(ORIENTATION)
            .copy_from(&rows);
        let columns = self.covariance.fixed_columns::<3>(ORIENTATION) * reset.transpose();
        self.covariance
            .fixed_columns_mut::<3>(ORIENTATION)
            .copy_from(&columns);
        self.bound_covariance();
    }

    /// Adds independent uncertainty, given as standard deviations.
    pub fn inflate(&mut self, sigma: &ErrorVector) {
        for i in 0..15 {
            self.covariance[(i, i)] += sigma[i] * sigma[i];
        }
        self.bound_covariance();
    }

    /// Makes the covariance symmetric and keeps its variances between bounds. Scaling a row with
    /// its column, or adding to the diagonal, keeps it positive definite.
    fn bound_covariance(&mut self) {
        let p = &mut self.covariance;
        for i in 0..15 {
            for j in 0..i {
                let mean = 0.5 * (p[(i, j)] + p[(j, i)]);
                p[(i, j)] = mean;
                p[(j, i)] = mean;
            }
        }
        for i in 0..15 {
            let least = LEAST_SIGMA[i / 3].powi(2);
            let greatest = GREATEST_SIGMA[i / 3].powi(2);
            if p[(i, i)] < least {
                p[(i, i)] = least;
            } else if p[(i, i)] > greatest {
                let scale = (greatest / p[(i, i)]).sqrt();
                p.row_mut(i).scale_mut(scale);
                p.column_mut(i).scale_mut(scale);
            }
        }
    }
}

#[cfg(test)]
#[path = "eskf_tests.rs"]
mod tests;
