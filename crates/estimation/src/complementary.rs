//! The complementary attitude filter (document O, section 2.3): the gyroscope for what is quick,
//! gravity for what is slow. Derivation: `docs/derivations/complementary-filter.md`.

use alula_geometry::{GRAVITY_M_S2, so3};
use alula_parameters::{ParameterError, Parameters, parameters};
use nalgebra::{UnitQuaternion, Vector3};

/// Longest single step of integration, s; longer intervals are cut into equal steps.
const LONGEST_STEP_S: f64 = 0.02;

/// Greatest standard deviation of tilt and heading that is reported, rad: beyond it nothing is
/// known.
const GREATEST_SIGMA_RAD: f64 = 2.0;

parameters! {
    /// Gains, gate and honesty of the complementary attitude filter.
    pub struct ComplementaryConfig {
        /// Share of the tilt error that is removed per second, 1/s. Low, because a multirotor that
        /// speeds up feels its own thrust, which points along its mast whatever the tilt.
        pub tilt_gain_per_s: f64 = 0.1, within(0.0, 20.0);
        /// Change of the gyroscope's bias per tilt error, 1/s^2. A quarter of the square of
        /// `tilt_gain_per_s` is critical damping.
        pub bias_gain_per_s2: f64 = 0.0025, within(0.0, 10.0);
        /// Time over which the specific force is averaged before it is believed, s.
        pub force_time_constant_s: f64 = 0.2, within(0.0, 10.0);
        /// Difference of the norm of the averaged specific force from that at rest at which gravity
        /// is no longer believed, m/s^2; the weight falls smoothly to zero there.
        pub norm_gate_m_s2: f64 = 0.3, within(0.01, 10.0);
        /// Time over which readings at rest are averaged, s (document O, section 2.5.2: 2 s).
        pub rest_time_constant_s: f64 = 2.0, within(0.1, 60.0);
        /// Greatest difference of an angular rate at rest from the bias, rad/s.
        pub rest_rate_rad_s: f64 = 0.05, within(1e-4, 1.0);
        /// Greatest bias of the gyroscope on an axis, rad/s.
        pub max_gyroscope_bias_rad_s: f64 = 0.2, within(1e-3, 1.0);
        /// White noise of the gyroscope, rad/s/sqrt(Hz).
        pub gyroscope_noise_rad_s_sqrt_hz: f64 = 5e-4, within(1e-7, 1.0);
        /// Standard deviation of the error of the gyroscope's bias, rad/s.
        pub gyroscope_bias_sigma_rad_s: f64 = 5e-4, within(1e-7, 0.5);
        /// Standard deviation of what makes the averaged specific force point away from up: bias
        /// and scale of the accelerometer, and accelerations that last, m/s^2.
        pub force_sigma_m_s2: f64 = 0.06, within(1e-4, 10.0);
    }
}

/// Roll, pitch, a heading that drifts, and the bias of the gyroscope.
#[derive(Clone, Debug, PartialEq)]
pub struct Complementary {
    config: ComplementaryConfig,
    world_from_body: UnitQuaternion<f64>,
    gyroscope_bias: Vector3<f64>,
    /// Averaged specific force, world frame, m/s^2.
    force_world: Vector3<f64>,
    /// Norm of the specific force at rest, m/s^2.
    rest_norm_m_s2: f64,
    /// How far gravity was believed in the last step, 0 to 1.
    weight: f64,
    tilt: Uncertainty,
    yaw: Uncertainty,
}

/// Standard deviation in two parts: what adds up (a bias) and what averages out (noise), rad.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Uncertainty {
    systematic: f64,
    noise_variance: f64,
}

impl Uncertainty {
    fn new(sigma: f64) -> Self {
        Self {
            systematic: sigma,
            noise_variance: 0.0,
        }
    }

    fn sigma_rad(&self) -> f64 {
        self.systematic
            .hypot(self.noise_variance.sqrt())
            .min(GREATEST_SIGMA_RAD)
    }

    /// A first-order filter that forgets with `gain`: the parts follow
    /// s' = drift + gain (reference - s) and v' = density^2 - 2 gain v.
    fn pass(&mut self, drift: f64, density: f64, gain: f64, reference: f64, dt_s: f64) {
        self.systematic += (drift + gain * (reference - self.systematic)) * dt_s;
        self.noise_variance += (density * density - 2.0 * gain * self.noise_variance) * dt_s;
        self.systematic = self.systematic.clamp(0.0, GREATEST_SIGMA_RAD);
        self.noise_variance = self.noise_variance.clamp(0.0, GREATEST_SIGMA_RAD.powi(2));
    }
}

impl Complementary {
    /// A filter that starts from a known attitude and gyroscope bias (rad/s).
    ///
    /// # Errors
    /// The first parameter that is not allowed.
    pub fn new(
        config: &ComplementaryConfig,
        world_from_body: UnitQuaternion<f64>,
        gyroscope_bias: Vector3<f64>,
    ) -> Result<Self, ParameterError> {
        config.validate()?;
        let mut filter = Self {
            config: config.clone(),
            world_from_body,
            gyroscope_bias,
            force_world: Vector3::zeros(),
            rest_norm_m_s2: GRAVITY_M_S2,
            weight: 0.0,
            tilt: Uncertainty::new(0.0),
            yaw: Uncertainty::new(0.0),
        };
        filter.restart(world_from_body, gyroscope_bias, 0.0);
        Ok(filter)
    }

    /// Starts again from an attitude that gravity gave, a gyroscope bias (rad/s) and the standard
    /// deviation of the heading.
    pub fn restart(
        &mut self,
        world_from_body: UnitQuaternion<f64>,
        gyroscope_bias: Vector3<f64>,
        yaw_sigma_rad: f64,
    ) {
        self.world_from_body = world_from_body;
        self.gyroscope_bias = gyroscope_bias;
        self.rest_norm_m_s2 = GRAVITY_M_S2;
        self.force_world = Vector3::z() * GRAVITY_M_S2;
        self.weight = 1.0;
        self.tilt = Uncertainty::new(self.config.force_sigma_m_s2 / GRAVITY_M_S2);
        self.yaw = Uncertainty::new(yaw_sigma_rad);
    }

    /// The attitude.
    pub fn world_from_body(&self) -> &UnitQuaternion<f64> {
        &self.world_from_body
    }

    /// Bias of the gyroscope, body frame, rad/s.
    pub fn gyroscope_bias(&self) -> &Vector3<f64> {
        &self.gyroscope_bias
    }

    /// How far gravity was believed in the last step: 1 fully, 0 not at all.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Standard deviation of roll and pitch, rad.
    pub fn tilt_sigma_rad(&self) -> f64 {
        self.tilt.sigma_rad()
    }

    /// Standard deviation of the heading, rad. It only grows: nothing observes it.
    pub fn yaw_sigma_rad(&self) -> f64 {
        self.yaw.sigma_rad()
    }

    /// Standard deviation of the gyroscope's bias on each axis, rad/s.
    pub fn gyroscope_bias_sigma_rad_s(&self) -> f64 {
        self.config.gyroscope_bias_sigma_rad_s
    }

    /// Takes a reading that held for `dt_s`: specific force (m/s^2) and angular rate (rad/s), body
    /// frame. Readings that are not finite change nothing; who feeds the filter judges them.
    pub fn update(&mut self, force: &Vector3<f64>, rate: &Vector3<f64>, dt_s: f64) {
        let finite = force.iter().chain(rate.iter()).all(|x| x.is_finite());
        if !finite || dt_s.is_nan() || dt_s <= 0.0 {
            return;
        }
        let steps = (dt_s / LONGEST_STEP_S - 1e-6).ceil().clamp(1.0, 1000.0);
        for _ in 0..steps as usize {
            self.step(force, rate, dt_s / steps);
        }
    }

    /// One step of the explicit complementary filter with bias: with e = u x R^T e3 between the
    /// direction of the averaged force and the estimated up,
    /// R <- R exp((rate - bias + k w e) dt), bias <- bias - k_b w e dt.
    fn step(&mut self, force: &Vector3<f64>, rate: &Vector3<f64>, dt_s: f64) {
        let config = &self.config;
        let smoothing = dt_s / (dt_s + config.force_time_constant_s);
        self.force_world += (self.world_from_body * force - self.force_world) * smoothing;
        let norm = self.force_world.norm();
        self.weight = believed(norm - self.rest_norm_m_s2, config.norm_gate_m_s2);

        let error_world = if norm > 0.0 {
            self.force_world.cross(&Vector3::z()) / norm
        } else {
            Vector3::zeros()
        };
        let error = self.world_from_body.inverse() * error_world * self.weight;
        let turn = rate - self.gyroscope_bias + error * config.tilt_gain_per_s;
        let limit = config.max_gyroscope_bias_rad_s;
        let bias = self.gyroscope_bias - error * (config.bias_gain_per_s2 * dt_s);
        self.gyroscope_bias = bias.map(|x| x.clamp(-limit, limit));
        self.world_from_body = renormalised(self.world_from_body * so3::exp(&(turn * dt_s)));
        self.pass_time(dt_s);
    }

    fn pass_time(&mut self, dt_s: f64) {
        let config = &self.config;
        let drift = config.gyroscope_bias_sigma_rad_s;
        let density = config.gyroscope_noise_rad_s_sqrt_hz;
        let gain = config.tilt_gain_per_s * self.weight;
        let reference = config.force_sigma_m_s2 / GRAVITY_M_S2;
        self.tilt.pass(drift, density, gain, reference, dt_s);
        self.yaw.pass(drift, density, 0.0, 0.0, dt_s);
    }

    /// As [`Self::update`], for a vehicle that stands still with its motors off: what the gyroscope
    /// reads is its bias, and the norm of the specific force is that of gravity as the
    /// accelerometer scales it.
    pub fn rest(&mut self, force: &Vector3<f64>, rate: &Vector3<f64>, dt_s: f64) {
        let yaw = self.yaw;
        self.update(force, rate, dt_s);
        let moved = rate - self.gyroscope_bias;
        // A NaN is not below the limit.
        if !(moved.amax() < self.config.rest_rate_rad_s && force.norm().is_finite()) {
            return;
        }
        // The heading of what stands still is not lost.
        self.yaw = yaw;
        let share = dt_s.max(0.0) / (dt_s.max(0.0) + self.config.rest_time_constant_s);
        self.gyroscope_bias += moved * share;
        self.rest_norm_m_s2 += (force.norm() - self.rest_norm_m_s2) * share;
    }
}

/// Smoothly from 1 where the norm is that of gravity to 0 where it differs by the gate.
fn believed(difference: f64, gate: f64) -> f64 {
    (1.0 - (difference / gate).powi(2)).max(0.0)
}

/// One step towards length 1: exact to rounding after each composition.
fn renormalised(q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let factor = 1.5 - 0.5 * q.coords.norm_squared();
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::from(q.coords * factor))
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::gravity_world;

    const DT_S: f64 = 0.004;

    fn filter(config: &ComplementaryConfig, start: UnitQuaternion<f64>) -> Complementary {
        Complementary::new(config, start, Vector3::zeros()).unwrap()
    }

    /// The specific force of a vehicle that does not accelerate.
    fn gravity_in(world_from_body: &UnitQuaternion<f64>) -> Vector3<f64> {
        world_from_body.inverse() * -gravity_world()
    }

    #[test]
    fn turning_alone_is_integrated_exactly() {
        let config = ComplementaryConfig {
            tilt_gain_per_s: 0.0,
            bias_gain_per_s2: 0.0,
            ..ComplementaryConfig::default()
        };
        let rate = Vector3::new(0.5, -0.3, 0.8);
        let mut filter = filter(&config, UnitQuaternion::identity());
        for _ in 0..500 {
            filter.update(&Vector3::z(), &rate, DT_S);
        }
        let exact = so3::exp(&(rate * 2.0));
        assert!(filter.world_from_body().angle_to(&exact) < 1e-12);
    }

    /// Without a bias the tilt error falls as exp(-k t) (first order in the error, 0.1 rad here,
    /// and in the averaging of the force).
    #[test]
    fn a_tilt_error_decays_with_the_gain() {
        let config = ComplementaryConfig {
            tilt_gain_per_s: 0.5,
            bias_gain_per_s2: 0.0,
            force_time_constant_s: 0.0,
            ..ComplementaryConfig::default()
        };
        let truth = so3::from_roll_pitch_yaw(0.1, -0.05, 0.0);
        let mut filter = filter(&config, truth * so3::exp(&Vector3::new(0.1, 0.0, 0.0)));
        for _ in 0..500 {
            filter.update(&gravity_in(&truth), &Vector3::zeros(), DT_S);
        }
        let left = filter.world_from_body().angle_to(&truth) / 0.1;
        assert!((left - (-1.0_f64).exp()).abs() < 0.01, "{left}");
    }

    #[test]
    fn the_biases_about_level_axes_are_found() {
        let truth = so3::from_roll_pitch_yaw(0.05, 0.1, 1.0);
        let bias = Vector3::new(0.01, -0.02, 0.0);
        let up = truth.inverse() * Vector3::z();
        let level_bias = bias - up * up.dot(&bias);
        let mut filter = filter(&ComplementaryConfig::default(), truth);
        for _ in 0..60_000 {
            filter.update(&gravity_in(&truth), &level_bias, DT_S);
        }
        assert!((filter.gyroscope_bias() - level_bias).norm() < 1e-4);
        let found = filter.world_from_body().inverse() * Vector3::z();
        assert!((found - up).norm() < 1e-3);
    }

    #[test]
    fn at_rest_all_three_biases_are_found() {
        let bias = Vector3::new(0.01, -0.02, 0.03);
        let mut filter = filter(&ComplementaryConfig::default(), UnitQuaternion::identity());
        for _ in 0..5_000 {
            filter.rest(&(Vector3::z() * 9.9), &bias, DT_S);
        }
        // Ten time constants.
        assert!((filter.gyroscope_bias() - bias).norm() < 1e-4);
        assert!((filter.rest_norm_m_s2 - 9.9).abs() < 1e-3);
    }

    #[test]
    fn a_force_of_another_norm_than_gravity_is_not_believed() {
        let mut filter = filter(&ComplementaryConfig::default(), UnitQuaternion::identity());
        for _ in 0..500 {
            filter.update(&Vector3::new(4.0, 0.0, 9.8), &Vector3::zeros(), DT_S);
        }
        assert_eq!(filter.weight(), 0.0);
        // What it believed before the average had passed the gate.
        assert!(so3::tilt_rad(filter.world_from_body()) < 0.002);
    }

    #[test]
    fn numbers_that_are_not_finite_change_nothing() {
        let mut filter = filter(&ComplementaryConfig::default(), UnitQuaternion::identity());
        let before = filter.clone();
        let nan = Vector3::repeat(f64::NAN);
        filter.update(&nan, &Vector3::zeros(), DT_S);
        filter.update(&Vector3::z(), &nan, DT_S);
        filter.update(&Vector3::z(), &Vector3::zeros(), f64::NAN);
        filter.rest(&nan, &nan, DT_S);
        assert_eq!(filter, before);
    }

    #[test]
    fn without_gravity_the_uncertainty_grows_and_with_it_it_settles() {
        let config = ComplementaryConfig::default();
        let mut filter = filter(&config, UnitQuaternion::identity());
        let sigma_after = |filter: &mut Complementary, force: f64| {
            for _ in 0..50_000 {
                filter.update(&(Vector3::z() * force), &Vector3::zeros(), DT_S);
            }
            filter.tilt_sigma_rad()
        };
        let settled = sigma_after(&mut filter, GRAVITY_M_S2);
        // Bias over gain and direction of the force, in the limit.
        let limit = config.gyroscope_bias_sigma_rad_s / config.tilt_gain_per_s
            + config.force_sigma_m_s2 / GRAVITY_M_S2;
        assert!((settled / limit - 1.0).abs() < 0.01, "{settled} {limit}");
        // 200 s of the bias alone.
        assert!(sigma_after(&mut filter, 20.0) > settled + 0.09);
    }
}
