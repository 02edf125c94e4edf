//! The Kalman filter of document S, sections 2.5 to 2.7: nominal state, covariance of its error,
//! propagation and fusion, in each of the variants of its table 2.1.
//!
//! The default is the error-state filter with local orientation error, zeroth-order backward
//! quaternion integration (Q0B) and first-order transition (F1). Derivation:
//! `docs/derivations/error-state-kalman-filter.md`.

mod bounds;
mod heading;
mod nominal;
mod orientation;
mod transition;
mod variant;

pub use heading::Seen;
pub use nominal::{ErrorVector, InertialInput, Nominal};
pub use variant::{FilterKind, QuaternionIntegration, Truncation, Variant};

use alula_geometry::{gravity_world, so3};
use alula_messages::{ErrorCovariance, error_index};
use alula_parameters::parameters;
use nalgebra::{SMatrix, SVector, Vector3};

use nominal::renormalised;
use transition::TransitionMatrix;

/// Rows of the parts of the filter's own coordinates: those of [`error_index`], with room for four
/// coordinates of orientation.
mod index {
    pub const POSITION: usize = 0;
    pub const VELOCITY: usize = 3;
    pub const ORIENTATION: usize = 6;
    pub const ACCELEROMETER_BIAS: usize = 10;
    pub const GYROSCOPE_BIAS: usize = 13;
}

/// The same parts as [`index`] and [`error_index`] number them, but for orientation.
const PARTS: [(usize, usize); 4] = [
    (index::POSITION, error_index::POSITION),
    (index::VELOCITY, error_index::VELOCITY),
    (index::ACCELEROMETER_BIAS, error_index::ACCELEROMETER_BIAS),
    (index::GYROSCOPE_BIAS, error_index::GYROSCOPE_BIAS),
];

/// Longest single step of integration, s: longer intervals are cut into equal steps.
///
/// F1 leaves out terms of the size (rate * dt)^2 / 2: below 0.5 % up to 10 rad/s.
const LONGEST_STEP_S: f64 = 0.01;

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

/// A measurement of `M` numbers seen from the present nominal state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linearised<const M: usize> {
    /// Measurement less prediction (document S, equation 2.53a).
    pub innovation: SVector<f64, M>,
    /// Derivative of the prediction with respect to the error state.
    pub jacobian: SMatrix<f64, M, 15>,
    /// Variances of the measurement's noise.
    pub variance: SVector<f64, M>,
    /// Whether it tells the heading.
    pub from: Seen,
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

/// Covariance in the coordinates of the filter.
type Covariance = SMatrix<f64, 16, 16>;

/// Nominal state and covariance of its error.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    /// The best estimate.
    pub nominal: Nominal,
    /// Covariance of the error of [`Self::nominal`] in the coordinates of the variant.
    covariance: Covariance,
    variant: Variant,
}

impl Filter {
    /// The default variant from a state and independent standard deviations, one for each kind of
    /// error: position (m), velocity (m/s), orientation (rad, body), accelerometer bias, gyroscope
    /// bias.
    pub fn new(nominal: Nominal, sigma: [Vector3<f64>; 5]) -> Self {
        let diagonal = ErrorVector::from_fn(|i, _| sigma[i / 3][i % 3].powi(2));
        let covariance = ErrorCovariance::from_diagonal(&diagonal);
        Self::with_covariance(nominal, &covariance, Variant::default())
    }

    /// A filter from a state and the covariance of its error, orientation error local.
    pub fn with_covariance(
        nominal: Nominal,
        covariance: &ErrorCovariance,
        variant: Variant,
    ) -> Self {
        let from_error = from_error(variant.filter, &nominal);
        Self {
            nominal,
            covariance: from_error * covariance * from_error.transpose(),
            variant,
        }
    }

    /// The same knowledge as another variant keeps it.
    pub fn in_variant(&self, variant: Variant) -> Self {
        Self::with_covariance(self.nominal, &self.covariance(), variant)
    }

    /// Which filter this is.
    pub fn variant(&self) -> Variant {
        self.variant
    }

    /// Covariance of the error of [`Self::nominal`], orientation error local, whatever the variant.
    pub fn covariance(&self) -> ErrorCovariance {
        let local_from_coordinates = self
            .variant
            .filter
            .local_from_coordinates(&self.nominal.world_from_body);
        let mut rows = SMatrix::<f64, 15, 16>::zeros();
        for (own, error) in PARTS {
            rows.fixed_rows_mut::<3>(error)
                .copy_from(&self.covariance.fixed_rows::<3>(own));
        }
        rows.fixed_rows_mut::<3>(error_index::ORIENTATION)
            .copy_from(
                &(local_from_coordinates * self.covariance.fixed_rows::<4>(index::ORIENTATION)),
            );
        let mut covariance = ErrorCovariance::zeros();
        for (own, error) in PARTS {
            covariance
                .fixed_columns_mut::<3>(error)
                .copy_from(&rows.fixed_columns::<3>(own));
        }
        covariance
            .fixed_columns_mut::<3>(error_index::ORIENTATION)
            .copy_from(
                &(rows.fixed_columns::<4>(index::ORIENTATION) * local_from_coordinates.transpose()),
            );
        covariance
    }

    /// Variances of the velocity, world frame, (m/s)^2.
    pub fn velocity_variance(&self) -> Vector3<f64> {
        self.covariance
            .diagonal()
            .fixed_rows::<3>(index::VELOCITY)
            .into_owned()
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

    /// One step of document S, equations 2.34 and 2.50 or 2.72.
    fn step(&mut self, input: &InertialInput, dt_s: f64, noise: &ImuNoise) {
        let Variant {
            filter,
            integration,
            transition,
        } = self.variant;
        let force = input.specific_force - self.nominal.accelerometer_bias;
        let rate = input.rate(integration, &self.nominal.gyroscope_bias);
        let half_turn = so3::exp(&(rate * (0.5 * dt_s)));
        let middle = self.nominal.world_from_body * half_turn;

        let motion = filter.motion(&middle, &force, &rate);
        self.covariance = TransitionMatrix::new(&motion, dt_s, transition).around(&self.covariance);

        let acceleration = gravity_world() - motion.velocity_from_bias * force;
        let nominal = &mut self.nominal;
        nominal.position_world +=
            nominal.velocity_world * dt_s + acceleration * (0.5 * dt_s * dt_s);
        nominal.velocity_world += acceleration * dt_s;
        nominal.world_from_body = renormalised(middle * half_turn);
        self.add_process_noise(input.noise_scale, dt_s, noise);
    }

    /// Variances of the impulses (document S, equation 2.36), from densities: variance grows
    /// with time, not with its square.
    fn add_process_noise(&mut self, scale: f64, dt_s: f64, noise: &ImuNoise) {
        let variance = |density: f64| density * density * dt_s;
        let mut add = |row, variance| {
            for i in row..row + 3 {
                self.covariance[(i, i)] += variance;
            }
        };
        let force = variance(noise.accelerometer_noise_m_s2_sqrt_hz * scale);
        let force_walk = variance(noise.accelerometer_bias_walk_m_s3_sqrt_hz);
        let rate_walk = variance(noise.gyroscope_bias_walk_rad_s2_sqrt_hz);
        add(index::VELOCITY, force);
        add(index::ACCELEROMETER_BIAS, force_walk);
        add(index::GYROSCOPE_BIAS, rate_walk);
        let turn = variance(noise.gyroscope_noise_rad_s_sqrt_hz * scale);
        self.add_turn(&Vector3::repeat(turn));
    }

    /// Adds variances of a rotation in the body.
    fn add_turn(&mut self, variance: &Vector3<f64>) {
        let coordinates_from_local = self
            .variant
            .filter
            .coordinates_from_local(&self.nominal.world_from_body);
        let mut scaled = coordinates_from_local;
        for (mut column, variance) in scaled.column_iter_mut().zip(variance) {
            column *= *variance;
        }
        let mut target = self
            .covariance
            .fixed_view_mut::<4, 4>(index::ORIENTATION, index::ORIENTATION);
        target += scaled * coordinates_from_local.transpose();
    }

    /// Corrects the state if the innovation passes the gate (document S, 2.53-2.61, 2.79-2.82).
    ///
    /// `gate` is a quantile of chi-square with `M` degrees of freedom.
    pub fn fuse<const M: usize>(&mut self, seen: &Linearised<M>, gate: f64) -> Outcome<M> {
        let jacobian = self.in_own_coordinates(&seen.jacobian);
        let p_ht = self.covariance * jacobian.transpose();
        let noise = SMatrix::<f64, M, M>::from_diagonal(&seen.variance);
        let z = jacobian * p_ht + noise;
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
            self.joseph(&gain, &p_ht, &jacobian, &noise);
            self.inject(&(gain * seen.innovation), seen.from);
        }
        outcome
    }

    /// A derivative with respect to the error state as one with respect to the coordinates.
    fn in_own_coordinates<const M: usize>(
        &self,
        jacobian: &SMatrix<f64, M, 15>,
    ) -> SMatrix<f64, M, 16> {
        let local_from_coordinates = self
            .variant
            .filter
            .local_from_coordinates(&self.nominal.world_from_body);
        let mut own = SMatrix::<f64, M, 16>::zeros();
        for (row, error) in PARTS {
            own.fixed_columns_mut::<3>(row)
                .copy_from(&jacobian.fixed_columns::<3>(error));
        }
        own.fixed_columns_mut::<4>(index::ORIENTATION).copy_from(
            &(jacobian.fixed_columns::<3>(error_index::ORIENTATION) * local_from_coordinates),
        );
        own
    }

    /// `P <- (I - K H) P (I - K H)^T + K N K^T` in an order that needs no 16x16 product.
    ///
    /// Document S, equation 2.56, with the noise N, not the innovation covariance, at the end.
    fn joseph<const M: usize>(
        &mut self,
        gain: &SMatrix<f64, 16, M>,
        p_ht: &SMatrix<f64, 16, M>,
        jacobian: &SMatrix<f64, M, 16>,
        noise: &SMatrix<f64, M, M>,
    ) {
        let left = self.covariance - gain * p_ht.transpose();
        let left_ht = left * jacobian.transpose();
        self.covariance = left + (gain * noise - left_ht) * gain.transpose();
    }

    /// Moves the observed error into the nominal state and expresses the remaining error there:
    /// rows and columns of the orientation, not its block alone as in document S, equations 2.59b
    /// and 2.80a.
    fn inject(&mut self, correction: &SVector<f64, 16>, from: Seen) {
        let part = |row| correction.fixed_rows::<3>(row).into_owned();
        let turn = correction.fixed_rows::<4>(index::ORIENTATION).into_owned();
        let nominal = &mut self.nominal;
        nominal.position_world += part(index::POSITION);
        nominal.velocity_world += part(index::VELOCITY);
        nominal.accelerometer_bias += part(index::ACCELEROMETER_BIAS);
        nominal.gyroscope_bias += part(index::GYROSCOPE_BIAS);
        let (orientation, reset) = self.variant.filter.correct(&nominal.world_from_body, &turn);
        nominal.world_from_body = orientation;
        let rows = reset * self.covariance.fixed_rows::<4>(index::ORIENTATION);
        self.covariance
            .fixed_rows_mut::<4>(index::ORIENTATION)
            .copy_from(&rows);
        let columns = self.covariance.fixed_columns::<4>(index::ORIENTATION) * reset.transpose();
        self.covariance
            .fixed_columns_mut::<4>(index::ORIENTATION)
            .copy_from(&columns);
        if from == Seen::FromBody {
            heading::turn_along(
                &mut self.covariance,
                self.variant.filter,
                &orientation,
                correction,
            );
        }
        self.bound_covariance();
    }

    /// Adds independent uncertainty, given as standard deviations of the error state.
    pub fn inflate(&mut self, sigma: &ErrorVector) {
        for (own, error) in PARTS {
            for i in 0..3 {
                self.covariance[(own + i, own + i)] += sigma[error + i].powi(2);
            }
        }
        let turn = sigma.fixed_rows::<3>(error_index::ORIENTATION);
        self.add_turn(&turn.component_mul(&turn));
        self.bound_covariance();
    }

    fn bound_covariance(&mut self) {
        bounds::bound(&mut self.covariance, self.variant.filter);
    }
}

/// Coordinates of an error state whose orientation error is local.
fn from_error(filter: FilterKind, nominal: &Nominal) -> SMatrix<f64, 16, 15> {
    let mut from_error = SMatrix::<f64, 16, 15>::zeros();
    for (own, error) in PARTS {
        from_error
            .fixed_view_mut::<3, 3>(own, error)
            .fill_with_identity();
    }
    from_error
        .fixed_view_mut::<4, 3>(index::ORIENTATION, error_index::ORIENTATION)
        .copy_from(&filter.coordinates_from_local(&nominal.world_from_body));
    from_error
}

#[cfg(test)]
mod tests;
