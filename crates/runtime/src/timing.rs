//! Wall-clock durations of the parts of a step, and their distribution.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::Serialize;

/// Distribution of durations, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Distribution {
    /// Arithmetic mean.
    pub mean: f64,
    /// Median.
    pub p50: f64,
    /// 75th percentile.
    pub p75: f64,
    /// 99th percentile.
    pub p99: f64,
    /// The longest.
    pub max: f64,
}

impl Distribution {
    /// Distribution of the given values; all zero if there are none. Percentiles are values that
    /// occurred (nearest rank).
    pub fn of(values: &[f64]) -> Self {
        if values.is_empty() {
            return Self::default();
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let rank = |share: f64| {
            let index = (share * sorted.len() as f64).ceil() as usize;
            sorted[index.clamp(1, sorted.len()) - 1]
        };
        Self {
            mean: sorted.iter().sum::<f64>() / sorted.len() as f64,
            p50: rank(0.5),
            p75: rank(0.75),
            p99: rank(0.99),
            max: rank(1.0),
        }
    }
}

/// Measures how long named parts of a loop take.
#[derive(Debug)]
pub struct Stopwatch {
    last: Instant,
    laps_ms: BTreeMap<&'static str, Vec<f64>>,
}

impl Default for Stopwatch {
    fn default() -> Self {
        Self {
            last: Instant::now(),
            laps_ms: BTreeMap::new(),
        }
    }
}

impl Stopwatch {
    /// Starts the first part anew.
    pub fn start(&mut self) {
        self.last = Instant::now();
    }

    /// Ends the part `name`; the next one starts here.
    pub fn lap(&mut self, name: &'static str) {
        let now = Instant::now();
        let elapsed_ms = now.duration_since(self.last).as_secs_f64() * 1e3;
        self.laps_ms.entry(name).or_default().push(elapsed_ms);
        self.last = now;
    }

    /// Distribution of each part's durations.
    pub fn distributions(&self) -> BTreeMap<&'static str, Distribution> {
        self.laps_ms
            .iter()
            .map(|(name, laps)| (*name, Distribution::of(laps)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_that_occurred() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        let found = Distribution::of(&values);
        assert_eq!(
            (found.p50, found.p75, found.p99, found.max),
            (50.0, 75.0, 99.0, 100.0)
        );
        assert_eq!(found.mean, 50.5);
    }

    #[test]
    fn nothing_measured_is_all_zero() {
        assert_eq!(Distribution::of(&[]), Distribution::default());
    }
}
