//! How much a share of successes says about the probability of success.

/// Probability that the truth lies beyond either end of a 95 % interval.
const TAIL: f64 = 0.025;

/// Halvings of the unit interval until neighbouring f64 near 1 are apart no more.
const HALVINGS: usize = 60;

/// The 95 % confidence interval of a probability after `successes` of `trials`, by Clopper and
/// Pearson ("The use of confidence or fiducial limits illustrated in the case of the binomial",
/// Biometrika 26, 1934).
///
/// The lower end is the probability p at which as many successes or more would be seen with
/// probability 2.5 %, the upper end that at which as many or fewer would. It covers the truth at
/// least 95 % of the time, whatever the truth is; others (Wilson) do so on average only, and fall
/// short near 0 and 1, where the probabilities of collisions lie. Without trials, nothing is known:
/// `[0, 1]`.
pub fn clopper_pearson_95(successes: u64, trials: u64) -> [f64; 2] {
    let successes = successes.min(trials);
    [
        lower_end(successes, trials),
        1.0 - lower_end(trials - successes, trials),
    ]
}

/// The p at which `successes` or more of `trials` have the probability [`TAIL`].
fn lower_end(successes: u64, trials: u64) -> f64 {
    if successes == 0 {
        return 0.0;
    }
    let ln_binomial = ln_binomial(trials, successes);
    let (mut low, mut high) = (0.0, successes as f64 / trials as f64);
    for _ in 0..HALVINGS {
        let p = 0.5 * (low + high);
        if upper_tail(successes, trials, ln_binomial, p) < TAIL {
            low = p;
        } else {
            high = p;
        }
    }
    0.5 * (low + high)
}

/// ln of `n` over `k`.
fn ln_binomial(n: u64, k: u64) -> f64 {
    let k = k.min(n - k);
    (1..=k).map(|i| ((n - k + i) as f64 / i as f64).ln()).sum()
}

/// Probability of `k` or more successes in `n` trials of probability `p` < k / n: there the terms
/// of the sum fall from the first on.
fn upper_tail(k: u64, n: u64, ln_binomial: f64, p: f64) -> f64 {
    let ln_first = ln_binomial + k as f64 * p.ln() + (n - k) as f64 * (-p).ln_1p();
    let mut term = ln_first.exp();
    let mut sum = term;
    for i in k..n {
        term *= (n - i) as f64 / (i + 1) as f64 * p / (1.0 - p);
        sum += term;
        if term < sum * f64::EPSILON {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published values are rounded to `digits`.
    fn check(successes: u64, trials: u64, published: [f64; 2], digits: i32) {
        let found = clopper_pearson_95(successes, trials);
        for (found, published) in found.iter().zip(published) {
            let error = (found - published).abs();
            assert!(
                error <= 0.5001 * 10f64.powi(-digits),
                "{successes}/{trials}: {found} is not {published}"
            );
        }
    }

    #[test]
    fn intervals_are_those_of_published_tables() {
        check(1, 10, [0.0025, 0.4450], 4);
        check(5, 10, [0.1871, 0.8129], 4);
        check(10, 100, [0.0490, 0.1762], 4);
        check(98, 100, [0.9296, 0.9976], 4);
    }

    #[test]
    fn without_a_success_the_upper_end_has_a_closed_form() {
        for trials in [1, 10, 1000, 100_000] {
            let [low, high] = clopper_pearson_95(0, trials);
            let exact = -(TAIL.ln() / trials as f64).exp_m1();
            assert_eq!(low, 0.0);
            assert!((high - exact).abs() < 1e-12, "{trials}: {high} {exact}");
        }
        assert!((clopper_pearson_95(0, 1000)[1] - 0.00368).abs() < 5e-6);
    }

    #[test]
    fn failures_have_the_mirrored_interval() {
        for (k, n) in [(3, 7), (980, 1000), (1, 50)] {
            let [low, high] = clopper_pearson_95(k, n);
            let [mirrored_low, mirrored_high] = clopper_pearson_95(n - k, n);
            assert!((low - (1.0 - mirrored_high)).abs() < 1e-15);
            assert!((high - (1.0 - mirrored_low)).abs() < 1e-15);
        }
    }

    #[test]
    fn at_the_ends_the_tails_hold_a_fortieth() {
        let (k, n) = (37_u64, 120_u64);
        let [low, high] = clopper_pearson_95(k, n);
        let probability = |i: u64, p: f64| {
            (ln_binomial(n, i) + i as f64 * p.ln() + (n - i) as f64 * (1.0 - p).ln()).exp()
        };
        let above: f64 = (k..=n).map(|i| probability(i, low)).sum();
        let below: f64 = (0..=k).map(|i| probability(i, high)).sum();
        assert!((above - TAIL).abs() < 1e-12, "{above}");
        assert!((below - TAIL).abs() < 1e-12, "{below}");
    }

    #[test]
    fn nothing_tried_is_nothing_known() {
        assert_eq!(clopper_pearson_95(0, 0), [0.0, 1.0]);
    }
}
