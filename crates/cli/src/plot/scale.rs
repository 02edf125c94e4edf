//! Ranges of values and the round numbers that mark them.

/// Values beyond this are taken for broken data: their differences may not be finite.
const LARGEST: f64 = 1e100;

/// Below this a constant is taken for zero.
const SMALLEST_CONSTANT: f64 = 1e-12;

/// A range narrower than this part of its values is taken for a constant.
const SMALLEST_RELATIVE_SPAN: f64 = 1e-9;

/// Whether a value can be drawn.
pub(super) fn drawable(value: f64) -> bool {
    value.abs() <= LARGEST
}

/// A range of values with `low < high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    pub low: f64,
    pub high: f64,
}

impl Range {
    /// The range of the drawable values; from 0 to 1 if there are none, and around a constant.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let drawn = values.into_iter().filter(|value| drawable(*value));
        let empty = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = drawn.fold(empty, |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            Range {
                low: 0.0,
                high: 1.0,
            }
        } else {
            Range::between(low, high)
        }
    }

    /// The range between two drawable values, widened around a constant.
    fn between(low: f64, high: f64) -> Self {
        let size = low.abs().max(high.abs());
        if size < SMALLEST_CONSTANT {
            Range {
                low: -1.0,
                high: 1.0,
            }
        } else if high - low <= SMALLEST_RELATIVE_SPAN * size {
            Range {
                low: low - 0.1 * size,
                high: high + 0.1 * size,
            }
        } else {
            Range { low, high }
        }
    }

    /// The range asked for, or that of the values if nothing usable is asked for.
    pub fn chosen(asked: Option<(f64, f64)>, otherwise: impl FnOnce() -> Range) -> Self {
        match asked {
            Some((low, high)) if drawable(low) && drawable(high) && low < high => {
                Range::between(low, high)
            }
            _ => otherwise(),
        }
    }

    pub fn span(self) -> f64 {
        self.high - self.low
    }

    pub fn holds(self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }

    pub fn centre(self) -> f64 {
        0.5 * (self.low + self.high)
    }

    /// The range with `fraction` of its span added on both sides.
    pub fn padded(self, fraction: f64) -> Self {
        let pad = fraction * self.span();
        Range {
            low: self.low - pad,
            high: self.high + pad,
        }
    }

    /// The range with some room around the values, and down to zero if that is near: amounts are
    /// then read as heights.
    pub fn roomy(self) -> Self {
        let near = 0.3;
        let padded = self.padded(0.06);
        if self.low >= 0.0 && self.low < near * self.high {
            Range { low: 0.0, ..padded }
        } else if self.high <= 0.0 && self.high > near * self.low {
            Range {
                high: 0.0,
                ..padded
            }
        } else {
            padded
        }
    }

    /// The range about the same centre with another span.
    pub fn with_span(self, span: f64) -> Self {
        Range {
            low: self.centre() - 0.5 * span,
            high: self.centre() + 0.5 * span,
        }
    }
}

/// Round numbers within a range, one step apart.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ticks {
    pub values: Vec<f64>,
    decimals: usize,
    /// Labels show the value divided by ten to this.
    pub exponent: i32,
}

impl Ticks {
    /// At most about `count` ticks over `range`, with a step of 1, 2 or 5 times a power of ten.
    pub fn over(range: Range, count: f64) -> Self {
        Ticks::with_step(range, round_step(range.span() / count.max(1.0)))
    }

    /// Multiples of `step` within `range`.
    pub fn with_step(range: Range, step: f64) -> Self {
        // A tick that rounding has put just outside of the range still belongs to it.
        let slack = 1e-9;
        let first = (range.low / step - slack).ceil();
        let last = (range.high / step + slack).floor();
        let count = (last - first).clamp(-1.0, 1000.0) as i32;
        let values = (0..=count).map(|i| (first + f64::from(i)) * step).collect();
        let exponent = exponent(range);
        let step_exponent = (step.log10() + slack).floor() as i32;
        let decimals = usize::try_from(exponent - step_exponent).unwrap_or(0);
        Ticks {
            values,
            decimals,
            exponent,
        }
    }

    /// Label of a tick.
    pub fn label(&self, value: f64) -> String {
        number(value / 10f64.powi(self.exponent), self.decimals)
    }

    /// Labels of all ticks.
    pub fn labels(&self) -> Vec<String> {
        self.values.iter().map(|value| self.label(*value)).collect()
    }
}

/// The smallest of 1, 2 and 5 times a power of ten that is not below `raw`.
pub(super) fn round_step(raw: f64) -> f64 {
    let power = 10f64.powf(raw.log10().floor());
    let slack = 1.0 + 1e-9;
    [1.0, 2.0, 5.0]
        .into_iter()
        .map(|m| m * power)
        .find(|s| raw <= s * slack)
        .unwrap_or(10.0 * power)
}

/// Power of ten to take out of the labels so that they stay short: a multiple of three.
fn exponent(range: Range) -> i32 {
    let size = range.low.abs().max(range.high.abs());
    if (1e-2..1e5).contains(&size) {
        0
    } else {
        3 * (size.log10() / 3.0).floor() as i32
    }
}

/// A number with fixed decimals and a proper minus sign.
pub(super) fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.contains(|c: char| ('1'..='9').contains(&c)) => {
            format!("\u{2212}{digits}")
        }
        Some(digits) => digits.to_string(),
        None => text,
    }
}

/// `×10ⁿ`, or nothing for n = 0.
pub(super) fn power_of_ten(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    if exponent == 0 {
        return String::new();
    }
    let raised = exponent.to_string();
    let raised = raised
        .chars()
        .map(|c| c.to_digit(10).map_or('⁻', |d| DIGITS[d as usize]));
    format!("×10{}", raised.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check_ticks(low: f64, high: f64, count: f64, labels: &[&str]) {
        assert_eq!(Ticks::over(Range { low, high }, count).labels(), labels);
    }

    #[test]
    fn steps_are_one_two_or_five_times_a_power_of_ten() {
        check_ticks(0.0, 10.0, 5.0, &["0", "2", "4", "6", "8", "10"]);
        check_ticks(-0.9, 1.1, 5.0, &["−0.5", "0.0", "0.5", "1.0"]);
        check_ticks(0.0, 60.0, 6.0, &["0", "10", "20", "30", "40", "50", "60"]);
        check_ticks(0.0, 0.3, 3.0, &["0.0", "0.1", "0.2", "0.3"]);
    }

    #[test]
    fn a_narrow_range_far_from_zero_keeps_its_decimals() {
        check_ticks(100.0, 100.02, 2.0, &["100.00", "100.01", "100.02"]);
    }

    #[test]
    fn small_and_large_values_share_an_exponent() {
        let ticks = Ticks::over(
            Range {
                low: 0.0,
                high: 2e-5,
            },
            2.0,
        );
        assert_eq!(
            (ticks.labels().join(" "), ticks.exponent),
            ("0 10 20".to_string(), -6)
        );
        assert_eq!(power_of_ten(-6), "×10⁻⁶");
        assert_eq!(
            Ticks::over(
                Range {
                    low: 0.0,
                    high: 3e6
                },
                3.0
            )
            .labels(),
            ["0", "1", "2", "3"]
        );
    }

    #[test]
    fn ticks_lie_within_the_range() {
        for (low, high) in [(-3.7, 12.9), (1e-7, 4e-7), (-1e9, 3.3), (5.0, 5.1)] {
            let ticks = Ticks::over(Range { low, high }, 6.0);
            let slack = 1e-6 * (high - low);
            assert!(
                (2..=8).contains(&ticks.values.len()),
                "{low} {high}: {ticks:?}"
            );
            assert!(
                ticks
                    .values
                    .iter()
                    .all(|v| *v >= low - slack && *v <= high + slack)
            );
        }
    }

    #[test]
    fn a_constant_gets_a_range_around_it() {
        assert_eq!(
            Range::of([3.0, 3.0]),
            Range {
                low: 2.7,
                high: 3.3
            }
        );
        assert_eq!(
            Range::of([0.0]),
            Range {
                low: -1.0,
                high: 1.0
            }
        );
    }

    #[test]
    fn values_that_are_not_finite_do_not_count() {
        let values = [f64::NAN, 2.0, f64::INFINITY, 1.0, f64::MAX];
        assert_eq!(
            Range::of(values),
            Range {
                low: 1.0,
                high: 2.0
            }
        );
        assert_eq!(
            Range::of([f64::NAN]),
            Range {
                low: 0.0,
                high: 1.0
            }
        );
    }

    #[test]
    fn zero_has_no_sign() {
        assert_eq!(number(-0.001, 1), "0.0");
    }

    #[test]
    fn an_unusable_range_is_replaced() {
        let otherwise = Range {
            low: 0.0,
            high: 1.0,
        };
        for asked in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0)] {
            assert_eq!(Range::chosen(Some(asked), || otherwise), otherwise);
        }
    }
}
