//! The second stage: a linear Kalman filter for velocity, height and, on the ground, the bias of the
//! accelerometer (document O, equations 2.65 to 2.70).

use alula_geometry::{gravity_world, so3};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// First row of the velocity.
pub const VELOCITY: usize = 0;
/// Row of the height.
pub const HEIGHT: usize = 3;
/// First row of the accelerometer's bias.
pub const BIAS: usize = 4;

/// Covariance of velocity (world, m/s), height (m) and accelerometer bias (body, m/s^2).
pub type Covariance = SMatrix<f64, 7, 7>;

/// Greatest standard deviations of velocity (m/s), height (m) and bias (m/s^2): beyond them the
/// numbers mean nothing.
const GREATEST_SIGMA: [f64; 7] = [1e2, 1e2, 1e2, 1e4, 5.0, 5.0, 5.0];

/// What becomes of the bias when a measurement is fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Biases {
    /// On the ground it is part of the state (document O, equation 2.70).
    Estimated,
    /// In flight it stays as it was at lift-off (2.65), but its uncertainty still counts: a
    /// Schmidt-Kalman filter.
    Frozen,
}

/// An inertial reading seen from an attitude.
#[derive(Clone, Copy, Debug)]
pub struct Push {
    /// Rotation `world_from_body` in the middle of the interval.
    pub rotation: Matrix3<f64>,
    /// Specific force, body frame, bias included, m/s^2.
    pub force: Vector3<f64>,
    /// Density of the white noise of the acceleration, m/s^2/sqrt(Hz).
    pub noise: f64,
    /// Standard deviation of the tilt, rad.
    pub tilt_sigma_rad: f64,
    /// Time for which that error has acted unseen, s.
    pub unseen_s: f64,
}

/// A measurement of `M` numbers that is linear in the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen<const M: usize> {
    /// Measurement less prediction.
    pub innovation: SVector<f64, M>,
    /// Derivative of the prediction with respect to the state.
    pub jacobian: SMatrix<f64, M, 7>,
    /// Variances of the measurement's noise.
    pub variance: SVector<f64, M>,
}

/// What came of an attempt to fuse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome<const M: usize> {
    /// Variances of the innovation.
    pub innovation_variance: SVector<f64, M>,
    /// Squared Mahalanobis distance.
    pub mahalanobis_squared: f64,
    /// The correction of velocity and height; `None` if the gate refused.
    pub correction: Option<SVector<f64, 7>>,
}

/// State and covariance.
#[derive(Clone, Debug, PartialEq)]
pub struct VelocityFilter {
    /// Velocity of the body's origin, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Height of the body's origin above the ground, m.
    pub height_m: f64,
    /// Bias of the accelerometer, body frame, m/s^2.
    pub accelerometer_bias: Vector3<f64>,
    /// Covariance of all of it.
    pub covariance: Covariance,
}

impl VelocityFilter {
    /// At rest at a height, with the standard deviations of velocity, height and bias.
    pub fn at_rest(height_m: f64, sigma: [f64; 3]) -> Self {
        let diagonal = SVector::<f64, 7>::from_fn(|i, _| match i {
            0..HEIGHT => sigma[0] * sigma[0],
            HEIGHT => sigma[1] * sigma[1],
            _ => sigma[2] * sigma[2],
        });
        Self {
            velocity_world: Vector3::zeros(),
            height_m,
            accelerometer_bias: Vector3::zeros(),
            covariance: Covariance::from_diagonal(&diagonal),
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.velocity_world.iter().all(|x| x.is_finite())
            && self.height_m.is_finite()
            && self.accelerometer_bias.iter().all(|x| x.is_finite())
            && self.covariance.iter().all(|x| x.is_finite())
    }

    /// Acceleration of the body's origin, world frame, m/s^2.
    pub fn acceleration_world(&self, push: &Push) -> Vector3<f64> {
        push.rotation * (push.force - self.accelerometer_bias) + gravity_world()
    }

    /// Lets `dt_s` pass. With a = R (f - b) + g: h <- h + v_z dt + a_z dt^2 / 2, v <- v + a dt
    /// (document O, equations 2.66 and 2.70b with the bias in the row of the velocity).
    pub fn propagate(&mut self, push: &Push, bias_walk: f64, dt_s: f64) {
        let acceleration = self.acceleration_world(push);
        self.height_m += (self.velocity_world.z + 0.5 * acceleration.z * dt_s) * dt_s;
        self.velocity_world += acceleration * dt_s;

        let mut f = Covariance::identity();
        f.fixed_view_mut::<3, 3>(VELOCITY, BIAS)
            .copy_from(&(push.rotation * -dt_s));
        f[(HEIGHT, VELOCITY + 2)] = dt_s;
        self.covariance = f * self.covariance * f.transpose();
        self.add_noise(push, bias_walk, dt_s);
        self.bound();
    }

    /// White noise, and the error of attitude: a constant tilt error `e` makes an error of
    /// acceleration of [R f]x e. Its variance in velocity grows as (s t)^2 with the time t for
    /// which it is not seen, whose derivative is 2 s^2 t.
    fn add_noise(&mut self, push: &Push, bias_walk: f64, dt_s: f64) {
        let lever = so3::skew(&(push.rotation * push.force)) * push.tilt_sigma_rad;
        let white = Matrix3::from_diagonal_element(push.noise * push.noise * dt_s);
        let unseen = lever * lever.transpose() * (2.0 * push.unseen_s * dt_s);
        let mut target = self.covariance.fixed_view_mut::<3, 3>(VELOCITY, VELOCITY);
        target += white + unseen;
        for i in BIAS..BIAS + 3 {
            self.covariance[(i, i)] += bias_walk * bias_walk * dt_s;
        }
    }

    /// Corrects the state if the innovation passes the gate, a quantile of chi-square.
    pub fn fuse<const M: usize>(
        &mut self,
        seen: &Seen<M>,
        gate: f64,
        biases: Biases,
    ) -> Outcome<M> {
        let p_ht = self.covariance * seen.jacobian.transpose();
        let noise = SMatrix::<f64, M, M>::from_diagonal(&seen.variance);
        let z = seen.jacobian * p_ht + noise;
        let mut outcome = Outcome {
            innovation_variance: z.diagonal(),
            mahalanobis_squared: f64::INFINITY,
            correction: None,
        };
        let Some(z_inverse) = z.try_inverse() else {
            return outcome;
        };
        outcome.mahalanobis_squared =
            (seen.innovation.transpose() * z_inverse * seen.innovation)[0];
        if outcome.mahalanobis_squared.is_nan() || outcome.mahalanobis_squared > gate {
            return outcome;
        }
        let mut gain = p_ht * z_inverse;
        if biases == Biases::Frozen {
            gain.fixed_rows_mut::<3>(BIAS).fill(0.0);
        }
        // The Joseph form holds for any gain.
        let left = Covariance::identity() - gain * seen.jacobian;
        self.covariance =
            left * self.covariance * left.transpose() + gain * noise * gain.transpose();
        self.bound();
        outcome.correction = Some(self.correct(&(gain * seen.innovation)));
        outcome
    }

    fn correct(&mut self, correction: &SVector<f64, 7>) -> SVector<f64, 7> {
        self.velocity_world += correction.fixed_rows::<3>(VELOCITY);
        self.height_m += correction[HEIGHT];
        self.accelerometer_bias += correction.fixed_rows::<3>(BIAS);
        *correction
    }

    /// Adds independent uncertainty of velocity (m/s, each axis) and height (m).
    pub fn inflate(&mut self, velocity_sigma: f64, height_sigma: f64) {
        for i in VELOCITY..HEIGHT {
            self.covariance[(i, i)] += velocity_sigma * velocity_sigma;
        }
        self.covariance[(HEIGHT, HEIGHT)] += height_sigma * height_sigma;
    }

    /// Makes the covariance symmetric and its variances not too large; scaling a row with its
    /// column keeps it positive definite.
    fn bound(&mut self) {
        let p = &mut self.covariance;
        *p = (*p + p.transpose()) * 0.5;
        for (i, greatest) in GREATEST_SIGMA.into_iter().enumerate() {
            if p[(i, i)] > greatest * greatest {
                let scale = greatest / p[(i, i)].sqrt();
                p.row_mut(i).scale_mut(scale);
                p.column_mut(i).scale_mut(scale);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::GRAVITY_M_S2;

    fn push() -> Push {
        Push {
            rotation: so3::from_roll_pitch_yaw(0.1, -0.2, 0.7)
                .to_rotation_matrix()
                .into_inner(),
            force: Vector3::new(0.3, -0.2, 10.0),
            noise: 0.1,
            tilt_sigma_rad: 0.0,
            unseen_s: 0.0,
        }
    }

    fn filter() -> VelocityFilter {
        VelocityFilter::at_rest(1.0, [0.1, 0.2, 0.05])
    }

    /// The model is linear: a step of any size gives the exact derivative, but for rounding.
    #[test]
    fn transition_meets_differences() {
        const DT_S: f64 = 0.01;
        let quiet = Push {
            noise: 0.0,
            ..push()
        };
        let end = |change: &SVector<f64, 7>| {
            let mut moved = filter();
            moved.correct(change);
            moved.propagate(&quiet, 0.0, DT_S);
            let mut state = SVector::<f64, 7>::zeros();
            state
                .fixed_rows_mut::<3>(VELOCITY)
                .copy_from(&moved.velocity_world);
            state[HEIGHT] = moved.height_m;
            state
                .fixed_rows_mut::<3>(BIAS)
                .copy_from(&moved.accelerometer_bias);
            state
        };
        let mut f = Covariance::zeros();
        for i in 0..7 {
            let mut change = SVector::<f64, 7>::zeros();
            change[i] = 0.5;
            f.set_column(i, &(end(&change) - end(&-change)));
        }
        let before = filter();
        let mut after = before.clone();
        after.propagate(&quiet, 0.0, DT_S);
        let expected = f * before.covariance * f.transpose();
        // The part of the bias in the height, R dt^2 / 2, is left out as in the source: 5e-5 here.
        assert!((expected - after.covariance).amax() < 5e-7);
    }

    #[test]
    fn a_tilt_that_is_not_seen_makes_velocity_uncertain_in_proportion_to_time() {
        let mut filter = VelocityFilter::at_rest(1.0, [1e-9, 1e-9, 0.0]);
        let steps = 1000;
        for i in 0..steps {
            let push = Push {
                rotation: Matrix3::identity(),
                force: Vector3::z() * GRAVITY_M_S2,
                noise: 0.0,
                tilt_sigma_rad: 0.01,
                unseen_s: 0.004 * (f64::from(i) + 0.5),
            };
            filter.propagate(&push, 0.0, 0.004);
        }
        let sigma = filter.covariance[(0, 0)].sqrt();
        assert!((sigma - GRAVITY_M_S2 * 0.01 * 4.0).abs() < 1e-6, "{sigma}");
        assert!(filter.covariance[(2, 2)].sqrt() < 1e-6);
    }

    fn still() -> Seen<3> {
        let mut jacobian = SMatrix::<f64, 3, 7>::zeros();
        jacobian
            .fixed_columns_mut::<3>(VELOCITY)
            .fill_with_identity();
        Seen {
            innovation: Vector3::new(0.1, -0.05, 0.02),
            jacobian,
            variance: Vector3::repeat(1e-4),
        }
    }

    /// After a step of time velocity and bias are correlated, so only the choice keeps the bias.
    #[test]
    fn a_frozen_bias_stays_and_still_counts() {
        let mut frozen = filter();
        frozen.propagate(&push(), 0.0, 0.5);
        let mut estimated = frozen.clone();
        let before = frozen.clone();
        assert!(
            frozen
                .fuse(&still(), 1e9, Biases::Frozen)
                .correction
                .is_some()
        );
        estimated.fuse(&still(), 1e9, Biases::Estimated);
        assert_eq!(frozen.accelerometer_bias, before.accelerometer_bias);
        assert_ne!(estimated.accelerometer_bias, before.accelerometer_bias);
        let bias_variance =
            |f: &VelocityFilter| f.covariance.fixed_view::<3, 3>(BIAS, BIAS).trace();
        assert!((bias_variance(&frozen) - bias_variance(&before)).abs() < 1e-15);
        assert!(bias_variance(&estimated) < bias_variance(&before));
    }

    #[test]
    fn what_the_gate_refuses_changes_nothing() {
        let mut filter = filter();
        let before = filter.clone();
        let nan = Seen {
            innovation: Vector3::repeat(f64::NAN),
            ..still()
        };
        for seen in [still(), nan] {
            assert!(
                filter
                    .fuse(&seen, 1e-9, Biases::Estimated)
                    .correction
                    .is_none()
            );
            assert_eq!(filter, before);
        }
    }
}
