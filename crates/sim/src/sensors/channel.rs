//! What all sensors share: when samples are due, how they fail, and when they arrive.

use std::collections::VecDeque;

use alula_geometry::{TimeDelta, Timestamp};

use super::failure::{FailureConfig, FailureKind, Sample};
use super::noise::Noise;

/// The way of samples from a sensor to the vehicle's computer.
#[derive(Clone, Debug)]
pub(super) struct Channel<T> {
    rate_hz: f64,
    latency: TimeDelta,
    failures: Vec<FailureConfig>,
    /// Draws for failures come from their own generator: a failure leaves the noise outside of it
    /// as it was.
    noise: Noise,
    /// Samples taken so far.
    taken: u64,
    /// The last sample taken outside of every failure that freezes the sensor.
    last_healthy: Option<T>,
    /// Samples with their times of arrival, oldest first.
    in_flight: VecDeque<(Timestamp, T)>,
}

impl<T: Sample> Channel<T> {
    /// A channel for the sensor called `name`.
    pub(super) fn new(
        rate_hz: f64,
        latency_s: f64,
        failures: &[FailureConfig],
        flight_seed: u64,
        name: &str,
    ) -> Self {
        Self {
            rate_hz,
            latency: TimeDelta::from_s(latency_s),
            failures: failures.to_vec(),
            noise: Noise::new(flight_seed, &format!("{name}.failures")),
            taken: 0,
            last_healthy: None,
            in_flight: VecDeque::new(),
        }
    }

    /// When the next sample is to be taken: a whole number of periods after the start, so that
    /// rounding does not add up.
    pub(super) fn due(&self) -> Timestamp {
        Timestamp::from_s((self.taken + 1) as f64 / self.rate_hz)
    }

    /// Lets the sample due now go by without one.
    pub(super) fn skip(&mut self) {
        self.taken += 1;
    }

    /// Sends the sample due now on its way, as far as the failures let it.
    pub(super) fn send(&mut self, mut sample: T) {
        let time = self.due();
        self.taken += 1;
        let mut stuck = false;
        for failure in self.failures.iter().filter(|f| f.covers(time)) {
            let affected = self.noise.happens(failure.probability);
            match failure.kind {
                FailureKind::DropOut if affected => return,
                FailureKind::Outliers if affected => {
                    sample.disturb(failure.magnitude, &mut self.noise);
                }
                FailureKind::Stuck => {
                    stuck = true;
                    if affected && let Some(last) = &self.last_healthy {
                        sample = last.repeated_at(&sample);
                    }
                }
                FailureKind::DropOut | FailureKind::Outliers => {}
            }
        }
        if !stuck {
            self.last_healthy = Some(sample.clone());
        }
        self.in_flight.push_back((time + self.latency, sample));
    }

    /// Appends all samples that have arrived by `now` to `received`.
    pub(super) fn deliver(&mut self, now: Timestamp, received: &mut Vec<T>) {
        let arrived = self
            .in_flight
            .partition_point(|(arrival, _)| *arrival <= now);
        received.extend(self.in_flight.drain(..arrived).map(|(_, sample)| sample));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_messages::RangeSample;

    fn sample(time: Timestamp) -> RangeSample {
        RangeSample {
            time,
            range_m: time.as_s(),
            min_m: 0.1,
            max_m: 100.0,
        }
    }

    fn failure(kind: FailureKind) -> FailureConfig {
        FailureConfig {
            kind,
            start_s: 1.0,
            duration_s: 2.0,
            probability: 1.0,
            magnitude: 50.0,
        }
    }

    /// Four seconds at 10 Hz; samples read the time at which they were taken.
    fn received(failures: &[FailureConfig]) -> Vec<RangeSample> {
        let mut channel = Channel::new(10.0, 0.0, failures, 1, "test");
        while channel.due() <= Timestamp::from_s(4.0) {
            channel.send(sample(channel.due()));
        }
        let mut samples = Vec::new();
        channel.deliver(Timestamp::from_s(4.0), &mut samples);
        samples
    }

    fn is_in_failure(sample: &RangeSample) -> bool {
        sample.time >= Timestamp::from_s(1.0) && sample.time < Timestamp::from_s(3.0)
    }

    #[test]
    fn samples_arrive_exactly_after_their_latency() {
        let mut channel = Channel::new(10.0, 0.035, &[], 1, "test");
        channel.send(sample(channel.due()));
        let arrival = Timestamp::from_ns(135_000_000);
        let mut samples = Vec::new();
        channel.deliver(arrival - TimeDelta::from_ns(1), &mut samples);
        assert!(samples.is_empty());
        channel.deliver(arrival, &mut samples);
        assert_eq!(samples, [sample(Timestamp::from_ns(100_000_000))]);
    }

    #[test]
    fn rates_that_divide_no_nanosecond_do_not_drift() {
        let mut channel = Channel::<RangeSample>::new(120.0, 0.0, &[], 1, "test");
        for _ in 0..119_999 {
            channel.skip();
        }
        assert_eq!(channel.due(), Timestamp::from_s(1000.0));
    }

    #[test]
    fn a_drop_out_loses_the_samples_in_its_window() {
        let samples = received(&[failure(FailureKind::DropOut)]);
        assert_eq!(samples.len(), 20);
        assert!(!samples.iter().any(is_in_failure));
    }

    #[test]
    fn a_stuck_sensor_repeats_its_last_sample_with_fresh_stamps() {
        let samples = received(&[failure(FailureKind::Stuck)]);
        assert_eq!(samples.len(), 40);
        for sample in samples {
            let expected_m = if is_in_failure(&sample) {
                0.9
            } else {
                sample.time.as_s()
            };
            assert_eq!(sample.range_m, expected_m);
        }
    }

    #[test]
    fn outliers_are_off_by_their_magnitude_in_their_window() {
        for sample in received(&[failure(FailureKind::Outliers)]) {
            let error_m = (sample.range_m - sample.time.as_s()).abs();
            if is_in_failure(&sample) {
                // Downwards the reading ends at zero.
                assert!(sample.range_m == 0.0 || (error_m - 50.0).abs() < 1e-12);
            } else {
                assert_eq!(error_m, 0.0);
            }
        }
    }

    #[test]
    fn failures_strike_with_their_probability() {
        let loss = FailureConfig {
            probability: 0.3,
            ..FailureConfig::default()
        };
        let mut channel = Channel::new(1000.0, 0.0, &[loss], 1, "test");
        for _ in 0..10_000 {
            channel.send(sample(channel.due()));
        }
        // Binomial: 7000 expected, standard deviation sqrt(10000 * 0.3 * 0.7) = 46.
        assert!((channel.in_flight.len() as f64 - 7000.0).abs() < 4.0 * 46.0);
    }
}
