//! Initial alignment while the vehicle stands still: gravity gives roll and pitch, the mean angular
//! rate is the gyroscope's bias.

use alula_geometry::{GRAVITY_M_S2, Timestamp, so3};
use alula_messages::{ErrorCovariance, ImuSample, error_index};
use alula_parameters::parameters;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::eskf::{Filter, Nominal, Variant};

parameters! {
    /// When the vehicle counts as standing still, and what is known before the first sample.
    pub struct AlignmentConfig {
        /// Time over which the readings are averaged, s.
        pub duration_s: f64 = 1.0, within(0.1, 30.0);
        /// Greatest standard deviation of the specific force on an axis, m/s^2.
        pub max_specific_force_sigma_m_s2: f64 = 0.8, within(1e-3, 10.0);
        /// Greatest standard deviation of the angular rate on an axis, rad/s.
        pub max_angular_rate_sigma_rad_s: f64 = 0.05, within(1e-4, 1.0);
        /// Greatest difference of the mean specific force from gravity, m/s^2.
        pub max_gravity_error_m_s2: f64 = 0.8, within(0.01, 5.0);
        /// Greatest mean angular rate that can be a bias, rad/s.
        pub max_gyroscope_bias_rad_s: f64 = 0.2, within(1e-3, 1.0);
        /// Standard deviation of the accelerometer's bias before any flight, m/s^2. Covers errors
        /// of scale too; document S, table 2.4, has 0.02.
        pub accelerometer_bias_sigma_m_s2: f64 = 0.05, within(1e-4, 5.0);
        /// Standard deviation of the gyroscope's bias that averaging leaves, rad/s.
        pub gyroscope_bias_sigma_rad_s: f64 = 0.002, within(1e-6, 0.5);
        /// Position of the body's origin at the start, world frame, m; z is its height above the
        /// ground.
        pub start_position_m: [f64; 3] = [0.0; 3], within(-1e5, 1e5);
        /// Heading at the start, degrees.
        pub start_yaw_deg: f64 = 0.0, within(-360.0, 360.0);
        /// Standard deviation of the horizontal position at the start, m. The frame of the world
        /// is defined there.
        pub start_position_sigma_m: f64 = 0.005, within(1e-5, 10.0);
        /// Standard deviation of the height at the start, m (document S, table 2.4).
        pub start_height_sigma_m: f64 = 0.05, within(1e-4, 10.0);
        /// Standard deviation of the heading at the start, degrees. The frame of the world is
        /// defined there.
        pub start_yaw_sigma_deg: f64 = 0.05, within(1e-4, 180.0);
    }
}

impl AlignmentConfig {
    /// Heading at the start, rad.
    pub fn start_yaw_rad(&self) -> f64 {
        self.start_yaw_deg.to_radians()
    }
}

/// Sums of samples since the vehicle was last seen moving.
#[derive(Clone, Debug)]
pub struct Alignment {
    config: AlignmentConfig,
    since: Option<Timestamp>,
    count: f64,
    force: [Vector3<f64>; 2],
    rate: [Vector3<f64>; 2],
}

impl Alignment {
    /// An alignment that has seen nothing.
    pub fn new(config: AlignmentConfig) -> Self {
        Self {
            config,
            since: None,
            count: 0.0,
            force: [Vector3::zeros(); 2],
            rate: [Vector3::zeros(); 2],
        }
    }

    /// Forgets all samples.
    pub fn reset(&mut self) {
        *self = Self::new(self.config.clone());
    }

    /// Takes a sample; when the vehicle stood still long enough, the filter to start from.
    ///
    /// `position_world` and `yaw_rad` are where it stands.
    pub fn add(
        &mut self,
        sample: &ImuSample,
        position_world: &Vector3<f64>,
        yaw_rad: f64,
    ) -> Option<Filter> {
        let since = *self.since.get_or_insert(sample.time);
        self.count += 1.0;
        accumulate(&mut self.force, &sample.specific_force);
        accumulate(&mut self.rate, &sample.angular_rate);
        if sample.time.seconds_since(since) < self.config.duration_s {
            return None;
        }
        let (force, force_sigma) = statistics(&self.force, self.count);
        let (rate, rate_sigma) = statistics(&self.rate, self.count);
        self.reset();
        let still = force_sigma <= self.config.max_specific_force_sigma_m_s2
            && rate_sigma <= self.config.max_angular_rate_sigma_rad_s
            && (force.norm() - GRAVITY_M_S2).abs() <= self.config.max_gravity_error_m_s2
            && rate.amax() <= self.config.max_gyroscope_bias_rad_s;
        still.then(|| self.filter(&force, rate, *position_world, yaw_rad))
    }

    fn filter(
        &self,
        force: &Vector3<f64>,
        gyroscope_bias: Vector3<f64>,
        position_world: Vector3<f64>,
        yaw_rad: f64,
    ) -> Filter {
        let config = &self.config;
        let nominal = Nominal {
            position_world,
            world_from_body: level(force, yaw_rad),
            gyroscope_bias,
            ..Nominal::default()
        };
        let place = config.start_position_sigma_m;
        let filter = Filter::new(
            nominal,
            [
                Vector3::new(place, place, config.start_height_sigma_m),
                Vector3::repeat(0.01),
                Vector3::zeros(),
                Vector3::repeat(config.accelerometer_bias_sigma_m_s2),
                Vector3::repeat(config.gyroscope_bias_sigma_rad_s),
            ],
        );
        let mut covariance = filter.covariance();
        let up = force.normalize();
        correlate_tilt(&mut covariance, &up, config.accelerometer_bias_sigma_m_s2);
        let yaw_sigma = config.start_yaw_sigma_deg.to_radians();
        let heading = up * up.transpose() * (yaw_sigma * yaw_sigma);
        let mut target =
            covariance.fixed_view_mut::<3, 3>(error_index::ORIENTATION, error_index::ORIENTATION);
        target += heading;
        Filter::with_covariance(nominal, &covariance, Variant::default())
    }
}

/// The tilt is wrong exactly as far as the bias is: with the mean reading d = g R^T e3 + b, where
/// u = d / |d|, an accelerometer bias error `e` makes an orientation error of u x e / g.
fn correlate_tilt(p: &mut ErrorCovariance, up: &Vector3<f64>, bias_sigma: f64) {
    const TILT: usize = error_index::ORIENTATION;
    const BIAS: usize = error_index::ACCELEROMETER_BIAS;
    let from_bias: Matrix3<f64> = so3::skew(up) / GRAVITY_M_S2;
    let cross = from_bias * (bias_sigma * bias_sigma);
    p.fixed_view_mut::<3, 3>(TILT, TILT)
        .copy_from(&(cross * from_bias.transpose()));
    p.fixed_view_mut::<3, 3>(TILT, BIAS).copy_from(&cross);
    p.fixed_view_mut::<3, 3>(BIAS, TILT)
        .copy_from(&cross.transpose());
}

/// The orientation with the given heading in which `force` points up.
fn level(force: &Vector3<f64>, yaw_rad: f64) -> UnitQuaternion<f64> {
    let roll = force.y.atan2(force.z);
    let pitch = (-force.x).atan2(force.y.hypot(force.z));
    so3::from_roll_pitch_yaw(roll, pitch, yaw_rad)
}

fn accumulate(sums: &mut [Vector3<f64>; 2], value: &Vector3<f64>) {
    sums[0] += value;
    sums[1] += value.component_mul(value);
}

/// Mean, and the greatest standard deviation of an axis.
fn statistics(sums: &[Vector3<f64>; 2], count: f64) -> (Vector3<f64>, f64) {
    let mean = sums[0] / count;
    let variance = sums[1] / count - mean.component_mul(&mean);
    (mean, variance.max().max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn still(world_from_body: UnitQuaternion<f64>, bias: Vector3<f64>) -> Filter {
        let mut alignment = Alignment::new(AlignmentConfig::default());
        let mut sample = ImuSample {
            time: Timestamp::ZERO,
            specific_force: world_from_body.inverse() * Vector3::z() * GRAVITY_M_S2 + bias,
            angular_rate: Vector3::new(0.01, -0.02, 0.03),
        };
        loop {
            if let Some(filter) = alignment.add(&sample, &Vector3::zeros(), 0.5) {
                return filter;
            }
            sample.time += alula_geometry::TimeDelta::from_hz(250.0);
        }
    }

    #[test]
    fn a_tilted_stand_is_found() {
        let truth = so3::from_roll_pitch_yaw(0.1, -0.2, 0.5);
        let found = still(truth, Vector3::zeros()).nominal;
        assert!(found.world_from_body.angle_to(&truth) < 1e-12);
        assert!((found.gyroscope_bias - Vector3::new(0.01, -0.02, 0.03)).norm() < 1e-12);
    }

    /// The claimed relation between bias and tilt against the alignment itself; second order in a
    /// bias of a milli-g leaves 1e-6 rad.
    #[test]
    fn a_bias_makes_the_tilt_error_that_the_covariance_claims() {
        let truth = so3::from_roll_pitch_yaw(0.1, -0.2, 0.5);
        let bias = Vector3::new(0.006, -0.008, 0.005);
        let filter = still(truth, bias);
        let tilt = so3::log(&(filter.nominal.world_from_body.inverse() * truth));
        let covariance = filter.covariance();
        let cross = covariance.fixed_view::<3, 3>(6, 9);
        let claimed = cross * bias
            / AlignmentConfig::default()
                .accelerometer_bias_sigma_m_s2
                .powi(2);
        // Heading is given, not found: compare what is level.
        let up = truth.inverse() * Vector3::z();
        let difference = tilt - claimed;
        assert!((difference - up * up.dot(&difference)).norm() < 1e-6);
    }

    #[test]
    fn a_shaken_vehicle_is_not_aligned() {
        let mut alignment = Alignment::new(AlignmentConfig::default());
        for i in 0..1000 {
            let sample = ImuSample {
                time: Timestamp::from_s(0.004 * f64::from(i)),
                specific_force: Vector3::new(if i % 2 == 0 { 2.0 } else { -2.0 }, 0.0, 9.8),
                angular_rate: Vector3::zeros(),
            };
            assert!(alignment.add(&sample, &Vector3::zeros(), 0.0).is_none());
        }
    }
}
