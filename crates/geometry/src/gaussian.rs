//! Gaussian helpers: distribution functions and their inverses, gates.

/// Cumulative distribution of the standard normal.
///
/// Phi(x) = erfc(-x / sqrt 2) / 2.
pub fn normal_cdf(x: f64) -> f64 {
    0.5 * erfc(-x / std::f64::consts::SQRT_2)
}

/// Inverse of [`normal_cdf`] for probabilities in (0, 1); infinite at the ends, NaN outside.
pub fn normal_quantile(probability: f64) -> f64 {
    if !(0.0..=1.0).contains(&probability) {
        return f64::NAN;
    }
    if probability == 0.0 || probability == 1.0 {
        return if probability == 0.0 {
            f64::NEG_INFINITY
        } else {
            f64::INFINITY
        };
    }
    bisect(|x| normal_cdf(x) - probability, -40.0, 40.0)
}

/// Cumulative distribution of chi-square with `degrees` degrees of freedom.
///
/// P(k/2, x/2), the regularised lower incomplete gamma function.
pub fn chi_square_cdf(x: f64, degrees: u32) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    lower_gamma_regularised(0.5 * f64::from(degrees), 0.5 * x)
}

/// Quantile of chi-square: the `x` below which a draw falls with `probability` in (0, 1).
///
/// Meant for construction: a gate is computed once, not in the loop.
pub fn chi_square_quantile(probability: f64, degrees: u32) -> f64 {
    let mut high = f64::from(degrees) + 10.0;
    while chi_square_cdf(high, degrees) < probability && high < 1e6 {
        high *= 2.0;
    }
    bisect(|x| chi_square_cdf(x, degrees) - probability, 0.0, high)
}

/// Root of an increasing function between `low` and `high`, to the last bit.
fn bisect(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if f(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// Complementary error function: 1 - P(1/2, x^2) for x >= 0, reflected below.
fn erfc(x: f64) -> f64 {
    if x < 0.0 {
        return 2.0 - erfc(-x);
    }
    upper_gamma_regularised(0.5, x * x)
}

/// P(a, x) by its series below a + 1 and as 1 - Q(a, x) above.
fn lower_gamma_regularised(a: f64, x: f64) -> f64 {
    if x < a + 1.0 {
        gamma_series(a, x)
    } else {
        1.0 - gamma_fraction(a, x)
    }
}

/// Q(a, x) = 1 - P(a, x) without cancellation for large x.
fn upper_gamma_regularised(a: f64, x: f64) -> f64 {
    if x < a + 1.0 {
        1.0 - gamma_series(a, x)
    } else {
        gamma_fraction(a, x)
    }
}

/// P(a, x) = x^a e^-x / Gamma(a) sum_n x^n / (a (a+1) ... (a+n)).
fn gamma_series(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let mut term = 1.0 / a;
    let mut sum = term;
    let mut n = a;
    for _ in 0..1000 {
        n += 1.0;
        term *= x / n;
        sum += term;
        if term < sum * f64::EPSILON {
            break;
        }
    }
    sum * (a * x.ln() - x - ln_gamma(a)).exp()
}

/// Q(a, x) by its continued fraction (modified Lentz).
fn gamma_fraction(a: f64, x: f64) -> f64 {
    const TINY: f64 = 1e-300;
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / TINY;
    let mut d = 1.0 / b;
    let mut h = d;
    for n in 1..1000 {
        let n = f64::from(n);
        let numerator = -n * (n - a);
        b += 2.0;
        d = 1.0 / non_zero(numerator * d + b, TINY);
        c = non_zero(b + numerator / c, TINY);
        let factor = d * c;
        h *= factor;
        if (factor - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    h * (a * x.ln() - x - ln_gamma(a)).exp()
}

fn non_zero(value: f64, tiny: f64) -> f64 {
    if value.abs() < tiny { tiny } else { value }
}

/// ln Gamma(a) for a > 0: Stirling's series after shifting the argument above 15.
fn ln_gamma(a: f64) -> f64 {
    let mut shift = 0.0;
    let mut z = a;
    while z < 15.0 {
        shift -= z.ln();
        z += 1.0;
    }
    let r = 1.0 / (z * z);
    let series = (1.0 / 12.0 - r * (1.0 / 360.0 - r * (1.0 / 1260.0 - r / 1680.0))) / z;
    shift + (z - 0.5) * z.ln() - z + 0.5 * std::f64::consts::TAU.ln() + series
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(found: f64, expected: f64) {
        assert!(
            (found - expected).abs() < 1e-9 * expected.abs().max(1.0),
            "{found} {expected}"
        );
    }

    /// Values of scipy.stats.chi2.ppf.
    #[test]
    fn chi_square_quantiles_agree_with_tables() {
        check(chi_square_quantile(0.95, 1), 3.841_458_820_694_124);
        check(chi_square_quantile(0.95, 2), 5.991_464_547_107_979);
        check(chi_square_quantile(0.95, 3), 7.814_727_903_251_179);
        check(chi_square_quantile(0.999, 6), 22.457_744_484_825_323);
    }

    /// The band of document S, equation 2.92 (labels as in the errata): 6 degrees, 25 runs.
    #[test]
    fn the_anees_band_of_the_source() {
        assert!((chi_square_quantile(0.025, 150) / 25.0 - 4.719).abs() < 1e-3);
        assert!((chi_square_quantile(0.975, 150) / 25.0 - 7.432).abs() < 1e-3);
    }

    #[test]
    fn normal_functions_agree_with_tables() {
        check(normal_cdf(0.0), 0.5);
        check(normal_cdf(1.0), 0.841_344_746_068_542_9);
        check(normal_cdf(-3.0), 0.001_349_898_031_630_094_6);
        check(normal_quantile(0.975), 1.959_963_984_540_054);
        check(normal_quantile(0.03), -1.880_793_608_151_250_4);
    }

    #[test]
    fn quantiles_undo_distribution_functions() {
        for p in [0.001, 0.03, 0.2, 0.5, 0.9, 0.9999] {
            check(chi_square_cdf(chi_square_quantile(p, 4), 4), p);
            check(normal_cdf(normal_quantile(p)), p);
        }
    }
}
