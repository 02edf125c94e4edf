//! Wind: a mean, random gusts and scripted pulses.

use alula_parameters::{ParameterError, Parameters, facts, parameters};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

facts! {
    /// One gust of the shape v (1 - cos(2 pi t / T)) / 2.
    pub struct GustPulse {
        /// Time at which it begins, s.
        pub start_s: f64, within(0.0, 1e6);
        /// Its length T, s.
        pub duration_s: f64, within(0.01, 1e4);
        /// Its greatest velocity v, world frame, m/s, reached in the middle.
        pub velocity_m_s: [f64; 3], within(-50.0, 50.0);
    }
}

parameters! {
    /// Wind at the vehicle; none by default.
    pub struct WindConfig {
        /// Mean velocity, world frame, m/s.
        pub mean_m_s: [f64; 3] = [0.0; 3], within(-30.0, 30.0);
        /// Standard deviation of the random gusts along each world axis, m/s.
        pub gust_sigma_m_s: [f64; 3] = [0.0; 3], within(0.0, 20.0);
        /// Correlation time of the random gusts, s: in the Dryden model, scale length over airspeed.
        pub gust_correlation_time_s: f64 = 2.0, within(0.01, 1000.0);
        /// Scripted gusts; they add up.
        pub pulses: Vec<GustPulse> = Vec::new(), nested();
    }
}

/// Wind over time, the same for the same seed.
#[derive(Clone, Debug)]
pub struct Wind {
    config: WindConfig,
    generator: Pcg64,
    time_s: f64,
    gust: Vector3<f64>,
}

impl Wind {
    /// Wind from time zero on; the random gusts begin with a draw from their distribution.
    ///
    /// # Errors
    /// When a parameter is out of its range.
    pub fn new(config: WindConfig, seed: u64) -> Result<Self, ParameterError> {
        config.validate()?;
        let mut wind = Self {
            config,
            generator: Pcg64::seed_from_u64(seed),
            time_s: 0.0,
            gust: Vector3::zeros(),
        };
        wind.gust = wind.draw();
        Ok(wind)
    }

    /// Velocity of the air (world, m/s) now; then `dt_s` seconds pass.
    pub fn velocity_world(&mut self, dt_s: f64) -> Vector3<f64> {
        let mut velocity = Vector3::from(self.config.mean_m_s) + self.gust;
        for pulse in &self.config.pulses {
            velocity += pulse.velocity_at(self.time_s);
        }
        self.pass(dt_s);
        velocity
    }

    /// A Gauss-Markov step, exact for any length: g <- a g + sqrt(1 - a^2) sigma n with
    /// a = exp(-dt / T).
    fn pass(&mut self, dt_s: f64) {
        self.time_s += dt_s;
        if self.config.gust_sigma_m_s == [0.0; 3] {
            return;
        }
        let a = (-dt_s / self.config.gust_correlation_time_s).exp();
        self.gust = self.gust * a + self.draw() * (1.0 - a * a).sqrt();
    }

    fn draw(&mut self) -> Vector3<f64> {
        let sigma = self.config.gust_sigma_m_s;
        Vector3::from(sigma.map(|s| {
            let normal: f64 = StandardNormal.sample(&mut self.generator);
            s * normal
        }))
    }
}

impl GustPulse {
    fn velocity_at(&self, time_s: f64) -> Vector3<f64> {
        let phase = (time_s - self.start_s) / self.duration_s;
        if !(0.0..=1.0).contains(&phase) {
            return Vector3::zeros();
        }
        Vector3::from(self.velocity_m_s) * (0.5 - 0.5 * (std::f64::consts::TAU * phase).cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gusts() -> WindConfig {
        WindConfig {
            mean_m_s: [3.0, 0.0, 0.0],
            gust_sigma_m_s: [1.0, 2.0, 0.5],
            gust_correlation_time_s: 2.0,
            pulses: Vec::new(),
        }
    }

    /// `n` samples at intervals of `dt_s`.
    fn samples(dt_s: f64, n: usize) -> Vec<Vector3<f64>> {
        let mut wind = Wind::new(gusts(), 7).unwrap();
        (0..n).map(|_| wind.velocity_world(dt_s)).collect()
    }

    #[test]
    fn there_is_no_wind_by_default() {
        let mut wind = Wind::new(WindConfig::default(), 1).unwrap();
        assert!((0..1000).all(|_| wind.velocity_world(1e-3) == Vector3::zeros()));
    }

    #[test]
    fn gusts_have_their_mean_and_standard_deviation() {
        // Samples 5 correlation times apart are nearly independent: the standard errors of mean
        // and standard deviation are sigma / sqrt(n) and sigma / sqrt(2 n); five of them.
        let n = 20_000;
        let samples = samples(10.0, n);
        let mean = samples.iter().sum::<Vector3<f64>>() / n as f64;
        for (axis, sigma) in gusts().gust_sigma_m_s.into_iter().enumerate() {
            let variance = samples
                .iter()
                .map(|v| (v[axis] - mean[axis]).powi(2))
                .sum::<f64>()
                / n as f64;
            let tolerance = 5.0 * sigma / (n as f64).sqrt();
            assert!((mean[axis] - gusts().mean_m_s[axis]).abs() < tolerance);
            assert!((variance.sqrt() - sigma).abs() < tolerance);
        }
    }

    #[test]
    fn gusts_forget_with_their_correlation_time() {
        // After half a correlation time the correlation is exp(-1/2). With samples that close,
        // n of them count as about n / 4 independent ones; five standard errors.
        let n = 100_000;
        let samples = samples(1.0, n);
        let (mut product, mut square) = (0.0, 0.0);
        for pair in samples.windows(2) {
            product += pair[0].y * pair[1].y;
            square += pair[0].y * pair[0].y;
        }
        let tolerance = 5.0 / (n as f64 / 4.0).sqrt();
        assert!((product / square - (-0.5_f64).exp()).abs() < tolerance);
    }

    #[test]
    fn the_same_seed_gives_the_same_wind() {
        assert_eq!(samples(1e-3, 1000), samples(1e-3, 1000));
    }

    #[test]
    fn a_pulse_peaks_in_its_middle_and_is_still_outside() {
        let config = WindConfig {
            pulses: vec![GustPulse {
                start_s: 1.0,
                duration_s: 2.0,
                velocity_m_s: [0.0, 6.0, 0.0],
            }],
            ..WindConfig::default()
        };
        let mut wind = Wind::new(config, 1).unwrap();
        let at: Vec<f64> = (0..8).map(|_| wind.velocity_world(0.5).y).collect();
        for (found, expected) in at.iter().zip([0.0, 0.0, 0.0, 3.0, 6.0, 3.0, 0.0, 0.0]) {
            assert!((found - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_pulse_in_a_file_needs_all_its_keys() {
        let text = "[[pulses]]\nstart_s = 1.0\nduration_s = 2.0";
        assert!(toml::from_str::<WindConfig>(text).is_err());
    }
}
