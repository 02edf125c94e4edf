//! Seeded sources of noise. Every source has its own generator, so that switching one sensor on or
//! off changes no other.

use nalgebra::Vector3;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// The seed of the part called `name` in a flight with seed `flight_seed`.
///
/// FNV-1a over the name, mixed with the flight's seed by the finaliser of SplitMix64: neighbouring
/// flight seeds give unrelated sequences.
pub(crate) fn derive_seed(flight_seed: u64, name: &str) -> u64 {
    let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    split_mix(hash ^ split_mix(flight_seed))
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood 2014).
fn split_mix(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A generator of random numbers with the distributions that sensors need.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    generator: Pcg64,
}

impl Noise {
    /// The source for the part called `name` in a flight with seed `flight_seed`.
    pub(crate) fn new(flight_seed: u64, name: &str) -> Self {
        let seed = derive_seed(flight_seed, name);
        let state = (u128::from(seed) << 64) | u128::from(split_mix(seed));
        Self {
            generator: Pcg64::new(state, u128::from(split_mix(!seed))),
        }
    }

    /// A draw from the standard normal distribution.
    pub(crate) fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.generator)
    }

    /// Three independent standard normal draws.
    pub(crate) fn normal_vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// A number in 0..1.
    pub(crate) fn uniform(&mut self) -> f64 {
        // The 53 bits of a mantissa.
        (self.generator.next_u64() >> 11) as f64 * (0.5_f64).powi(53)
    }

    /// Whether something with this probability happens.
    pub(crate) fn happens(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// A direction, uniform on the sphere.
    pub(crate) fn direction(&mut self) -> Vector3<f64> {
        let z = 2.0 * self.uniform() - 1.0;
        let azimuth_rad = std::f64::consts::TAU * self.uniform();
        let r = (1.0 - z * z).sqrt();
        Vector3::new(r * azimuth_rad.cos(), r * azimuth_rad.sin(), z)
    }

    /// A nearly normal draw for bulk use: mean 0, variance 1, within 3.5 standard deviations.
    ///
    /// The sum of the four 16-bit parts of one draw (Irwin-Hall of order 4): each part is uniform
    /// on 0..65535 with variance (2^32 - 1)/12.
    pub(crate) fn fast_normal(&mut self) -> f32 {
        const MEAN: f32 = 2.0 * 65535.0;
        // 1 / sqrt(4 (2^32 - 1) / 12)
        const SCALE: f32 = 2.642_899_8e-5;
        let bits = self.generator.next_u64();
        let sum =
            (bits & 0xffff) + ((bits >> 16) & 0xffff) + ((bits >> 32) & 0xffff) + (bits >> 48);
        (sum as f32 - MEAN) * SCALE
    }
}

/// A first-order Gauss-Markov process: noise that wanders but stays.
///
/// x[k+1] = e x[k] + sigma sqrt(1 - e^2) w, e = exp(-dt / tau): its standard deviation is `sigma`
/// at all times, its correlation falls to 1/e in `tau`.
#[derive(Clone, Debug)]
pub(crate) struct GaussMarkov {
    value: Vector3<f64>,
    sigma: f64,
    time_constant_s: f64,
}

impl GaussMarkov {
    /// A process that starts in its stationary distribution.
    pub(crate) fn new(sigma: f64, time_constant_s: f64, noise: &mut Noise) -> Self {
        Self {
            value: noise.normal_vector() * sigma,
            sigma,
            time_constant_s,
        }
    }

    /// The value after `dt_s`.
    pub(crate) fn update(&mut self, dt_s: f64, noise: &mut Noise) -> Vector3<f64> {
        let decay = (-dt_s / self.time_constant_s).exp();
        let drive = self.sigma * (1.0 - decay * decay).sqrt();
        self.value = self.value * decay + noise.normal_vector() * drive;
        self.value
    }
}

/// Mean and variance of `values`.
#[cfg(test)]
pub(crate) fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, variance)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRAWS: usize = 40_000;

    /// Mean within 4 standard errors of 0, variance within 4 of 1 (standard error sqrt(2/n)).
    fn check_standard(values: &[f64]) {
        let n = values.len() as f64;
        let (mean, variance) = mean_and_variance(values);
        assert!(mean.abs() < 4.0 / n.sqrt(), "mean {mean}");
        assert!(
            (variance - 1.0).abs() < 4.0 * (2.0 / n).sqrt(),
            "variance {variance}"
        );
    }

    #[test]
    fn the_fast_normal_is_standard() {
        let mut noise = Noise::new(1, "a");
        let values: Vec<f64> = (0..DRAWS).map(|_| f64::from(noise.fast_normal())).collect();
        check_standard(&values);
    }

    #[test]
    fn a_gauss_markov_process_keeps_its_standard_deviation() {
        let values: Vec<f64> = (0..DRAWS as u64)
            .map(|seed| {
                let mut noise = Noise::new(seed, "gm");
                let mut process = GaussMarkov::new(1.0, 0.5, &mut noise);
                for _ in 0..3 {
                    process.update(0.1, &mut noise);
                }
                process.value.x
            })
            .collect();
        check_standard(&values);
    }

    #[test]
    fn a_gauss_markov_process_forgets_in_its_time_constant() {
        let products: Vec<f64> = (0..DRAWS as u64)
            .map(|seed| {
                let mut noise = Noise::new(seed, "gm");
                let mut process = GaussMarkov::new(1.0, 0.5, &mut noise);
                process.value.x * process.update(0.5, &mut noise).x
            })
            .collect();
        let (correlation, variance) = mean_and_variance(&products);
        let standard_error = (variance / DRAWS as f64).sqrt();
        assert!((correlation - (-1.0_f64).exp()).abs() < 4.0 * standard_error);
    }

    #[test]
    fn names_and_flight_seeds_give_unrelated_sequences() {
        let draws = |seed, name| {
            let mut noise = Noise::new(seed, name);
            (0..DRAWS).map(|_| noise.normal()).collect::<Vec<_>>()
        };
        let reference = draws(1, "imu");
        for other in [draws(2, "imu"), draws(1, "flow")] {
            let products: Vec<f64> = reference.iter().zip(&other).map(|(a, b)| a * b).collect();
            let (correlation, _) = mean_and_variance(&products);
            assert!(correlation.abs() < 4.0 / (DRAWS as f64).sqrt());
        }
        assert_eq!(reference, draws(1, "imu"));
    }
}
