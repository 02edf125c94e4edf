//! The modified Thompson tau test for readings that do not belong to the others (document S,
//! section 2.10.2).

use std::collections::VecDeque;
use std::f64::consts::PI;

use alula_parameters::parameters;

parameters! {
    /// The test and its memory.
    pub struct OutlierConfig {
        /// Readings that are compared.
        pub window: usize = 15, within(4.0, 200.0);
        /// Share of good readings that are called outliers, in both tails together.
        pub significance: f64 = 0.01, within(1e-6, 0.5);
        /// Standard deviation below which the readings of the window are not taken to agree, m:
        /// that of the noise.
        pub least_sigma_m: f64 = 0.05, within(1e-4, 10.0);
    }
}

/// Judges each reading against the last good ones.
///
/// Of `n` readings with mean `m` and sample deviation `s` one is an outlier if it is farther from
/// `m` than `tau s`, `tau = t (n - 1) / (sqrt(n) sqrt(n - 2 + t^2))`, `t` being the quantile of
/// Student's distribution with `n - 2` degrees of freedom. The readings are residuals of a
/// prediction, so that motion is no outlier. Outliers do not enter the window; when it would be
/// full of them, they are the rule, and the test starts anew.
#[derive(Clone, Debug)]
pub struct OutlierTest {
    config: OutlierConfig,
    tau: f64,
    window: VecDeque<f64>,
    outliers_in_a_row: usize,
}

impl OutlierTest {
    /// A test that has seen nothing.
    pub fn new(config: &OutlierConfig) -> Self {
        Self {
            tau: thompson_tau(config.window, config.significance),
            window: VecDeque::with_capacity(config.window),
            outliers_in_a_row: 0,
            config: config.clone(),
        }
    }

    /// Forgets all readings.
    pub fn clear(&mut self) {
        self.window.clear();
        self.outliers_in_a_row = 0;
    }

    /// Takes a reading, m; whether it is an outlier. Nothing is one until the window is full.
    pub fn is_outlier(&mut self, reading_m: f64) -> bool {
        let outlier = self.window.len() + 1 >= self.config.window && self.is_far(reading_m);
        if outlier {
            self.outliers_in_a_row += 1;
            if self.outliers_in_a_row == self.config.window {
                self.clear();
            }
            return true;
        }
        self.outliers_in_a_row = 0;
        if self.window.len() + 1 == self.config.window {
            self.window.pop_front();
        }
        self.window.push_back(reading_m);
        false
    }

    /// Whether a reading is farther from the mean than the test allows, itself counted in.
    fn is_far(&self, reading_m: f64) -> bool {
        let readings = || self.window.iter().copied().chain([reading_m]);
        let n = self.window.len() as f64 + 1.0;
        let mean = readings().sum::<f64>() / n;
        let squares: f64 = readings().map(|x| (x - mean) * (x - mean)).sum();
        let sigma = (squares / (n - 1.0)).sqrt().max(self.config.least_sigma_m);
        (reading_m - mean).abs() > self.tau * sigma
    }
}

/// The factor of the test for a window of `n` readings.
fn thompson_tau(n: usize, significance: f64) -> f64 {
    let t = student_quantile(1.0 - 0.5 * significance, n - 2);
    let n = n as f64;
    t * (n - 1.0) / (n.sqrt() * (n - 2.0 + t * t).sqrt())
}

/// Quantile above the median of Student's distribution, to the last bit.
fn student_quantile(probability: f64, degrees: usize) -> f64 {
    let (mut low, mut high) = (0.0, 1e9);
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if student_cdf(middle, degrees) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// Student's distribution for whole degrees of freedom: a finite sum in the angle
/// atan(t / sqrt(degrees)), with cosines to even powers for even degrees and to odd powers for odd
/// ones (Zelen and Severo in Abramowitz and Stegun, 26.7.3 and 26.7.4).
fn student_cdf(t: f64, degrees: usize) -> f64 {
    let angle = (t / (degrees as f64).sqrt()).atan();
    let (sine, cosine) = angle.sin_cos();
    let even = degrees.is_multiple_of(2);
    let mut term = if even { 1.0 } else { cosine };
    let mut sum = if degrees == 1 { 0.0 } else { term };
    let mut power = if even { 2 } else { 3 };
    while power + 1 < degrees {
        term *= cosine * cosine * (power - 1) as f64 / power as f64;
        sum += term;
        power += 2;
    }
    let within = if even {
        sine * sum
    } else {
        2.0 / PI * (angle + sine * sum)
    };
    0.5 + 0.5 * within
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    /// Printed tables of Student's distribution, to their last digit.
    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (probability, degrees, expected) in [
            (0.975, 1, 12.706),
            (0.975, 2, 4.303),
            (0.975, 3, 3.182),
            (0.975, 8, 2.306),
            (0.995, 13, 3.012),
            (0.95, 30, 1.697),
        ] {
            let found = student_quantile(probability, degrees);
            assert!((found - expected).abs() < 6e-4, "{degrees}: {found}");
        }
    }

    /// The published table of tau for a significance of 0.05.
    #[test]
    fn tau_is_that_of_the_table() {
        for (n, expected) in [(3, 1.1511), (4, 1.4250), (10, 1.7984)] {
            let found = thompson_tau(n, 0.05);
            assert!((found - expected).abs() < 6e-5, "{n}: {found}");
        }
    }

    fn noise(sigma: f64, seed: u64) -> impl FnMut() -> f64 {
        let mut rng = Pcg64::seed_from_u64(seed);
        move || {
            let drawn: f64 = StandardNormal.sample(&mut rng);
            sigma * drawn
        }
    }

    /// More than the significance, because a window without what was refused looks narrower than the
    /// readings are, but not twice as many.
    #[test]
    fn it_refuses_little_more_than_the_significance_of_good_readings() {
        let config = OutlierConfig {
            least_sigma_m: 1e-4,
            ..OutlierConfig::default()
        };
        let mut test = OutlierTest::new(&config);
        let mut draw = noise(0.05, 1);
        let refused = (0..100_000).filter(|_| test.is_outlier(draw())).count();
        assert!((1000..2000).contains(&refused), "{refused}");
    }

    #[test]
    fn a_jump_is_an_outlier_until_it_lasts() {
        let mut test = OutlierTest::new(&OutlierConfig::default());
        let mut draw = noise(0.02, 2);
        for _ in 0..30 {
            assert!(!test.is_outlier(draw()));
        }
        assert!(test.is_outlier(0.8 + draw()));
        assert!(!test.is_outlier(draw()));
        let lasting: Vec<bool> = (0..30).map(|_| test.is_outlier(0.8 + draw())).collect();
        assert!(lasting[..15].iter().all(|outlier| *outlier));
        assert!(lasting[15..].iter().all(|outlier| !*outlier));
    }
}
