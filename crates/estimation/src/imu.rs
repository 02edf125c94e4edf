//! Plausibility of inertial samples: a filter that integrates must not be fed nonsense.

use alula_geometry::Timestamp;
use alula_messages::{FlightMode, ImuSample, Rejection};
use alula_parameters::parameters;
use nalgebra::Vector3;

/// Outlying samples in a row that agree with each other before they are believed: a burst of
/// outliers does not agree, a real change of motion does.
const AGREEING_SAMPLES: u32 = 5;

/// Samples with old time stamps in a row after which the clock is taken to have been set back.
const BACKWARD_SAMPLES: u32 = 50;

/// Longest time between samples that counts as regular, s.
const REGULAR_GAP_S: f64 = 0.02;

parameters! {
    /// What an inertial unit on a small multirotor can plausibly say.
    pub struct ImuLimits {
        /// Reading of the accelerometer at which an axis saturates, m/s^2 (16 g).
        pub max_specific_force_m_s2: f64 = 156.0, within(20.0, 1e4);
        /// Reading of the gyroscope at which an axis saturates, rad/s (2000 degrees per second).
        pub max_angular_rate_rad_s: f64 = 34.8, within(1.0, 1e3);
        /// Greatest believable change of specific force from sample to sample, m/s^2.
        pub max_specific_force_jump_m_s2: f64 = 40.0, within(1.0, 1e4);
        /// Greatest believable change of angular rate from sample to sample, rad/s.
        pub max_angular_rate_jump_rad_s: f64 = 8.0, within(0.1, 1e3);
        /// Longest time without a good sample, s; after it the state is lost.
        pub max_gap_s: f64 = 0.2, within(0.01, 2.0);
        /// Factor on the noise of invented samples, which bridge gaps and bad samples.
        pub bridge_noise_factor: f64 = 10.0, within(1.0, 1e3);
    }
}

/// What to do with a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImuVerdict {
    /// Use it.
    Good(ImuSample),
    /// It came after a gap: use its mean with the sample before the gap, with more noise.
    AfterGap(ImuSample),
    /// Use the last good reading in its place, with more noise.
    Bridged(ImuSample, Rejection),
    /// Leave it out.
    Rejected(Rejection),
}

/// Whether the ground may strike the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// It flies where no ground is, or stands.
    Impossible,
    /// It is landing: feet that meet the ground make the specific force along the body's z axis
    /// jump by more than any flight does, and that jump takes the speed of the descent away.
    Possible,
}

impl Contact {
    /// What a mode of flight says about it.
    pub fn in_mode(mode: FlightMode) -> Self {
        if mode == FlightMode::Landing {
            Self::Possible
        } else {
            Self::Impossible
        }
    }
}

/// Judges inertial samples one by one.
#[derive(Clone, Debug)]
pub struct ImuMonitor {
    limits: ImuLimits,
    last_good: Option<ImuSample>,
    last_raw: Option<ImuSample>,
    last_time: Option<Timestamp>,
    agreeing: u32,
    backwards: u32,
}

impl ImuMonitor {
    /// A monitor that has seen nothing; `limits` are validated by whoever owns the configuration.
    pub fn new(limits: ImuLimits) -> Self {
        Self {
            limits,
            last_good: None,
            last_raw: None,
            last_time: None,
            agreeing: 0,
            backwards: 0,
        }
    }

    /// Forgets all samples.
    pub fn reset(&mut self) {
        *self = Self::new(self.limits.clone());
    }

    /// The last good sample.
    pub fn last_good(&self) -> Option<&ImuSample> {
        self.last_good.as_ref()
    }

    /// Whether there was no good sample for too long, or the clock was set back.
    pub fn is_lost(&self, now: Timestamp) -> bool {
        let silent = self
            .last_good
            .is_some_and(|good| now.seconds_since(good.time) > self.limits.max_gap_s);
        silent || self.backwards >= BACKWARD_SAMPLES
    }

    /// Judges the next sample: the one to use, if any, with the factor on its noise, and why it is
    /// not the one that came.
    pub fn admit(
        &mut self,
        sample: &ImuSample,
        contact: Contact,
    ) -> (Option<(ImuSample, f64)>, Option<Rejection>) {
        let bridged = self.limits.bridge_noise_factor;
        match self.judge(sample, contact) {
            ImuVerdict::Good(sample) => (Some((sample, 1.0)), None),
            ImuVerdict::AfterGap(sample) => (Some((sample, bridged)), None),
            ImuVerdict::Bridged(invented, reason) => (Some((invented, bridged)), Some(reason)),
            ImuVerdict::Rejected(reason) => (None, Some(reason)),
        }
    }

    /// Judges the next sample.
    pub fn judge(&mut self, sample: &ImuSample, contact: Contact) -> ImuVerdict {
        if self.last_time.is_some_and(|last| sample.time <= last) {
            self.backwards += 1;
            return ImuVerdict::Rejected(Rejection::OutOfOrder);
        }
        self.backwards = 0;
        let last_time = self.last_time.replace(sample.time);
        let gap_s = last_time.map_or(0.0, |last| sample.time.seconds_since(last));
        match (self.fault(sample, contact), self.last_good) {
            (None, before) => {
                self.last_good = Some(*sample);
                self.agreeing = 0;
                match before {
                    Some(before) if gap_s > REGULAR_GAP_S => after_gap(&before, sample),
                    _ => ImuVerdict::Good(*sample),
                }
            }
            (Some(reason), None) => ImuVerdict::Rejected(reason),
            (Some(reason), Some(good)) => ImuVerdict::Bridged(
                ImuSample {
                    time: sample.time,
                    ..good
                },
                reason,
            ),
        }
    }

    fn fault(&mut self, sample: &ImuSample, contact: Contact) -> Option<Rejection> {
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        if !finite(&sample.specific_force) || !finite(&sample.angular_rate) {
            return Some(Rejection::NotFinite);
        }
        if sample.specific_force.amax() >= self.limits.max_specific_force_m_s2
            || sample.angular_rate.amax() >= self.limits.max_angular_rate_rad_s
        {
            return Some(Rejection::Invalid);
        }
        let is_near = |other: ImuSample| self.is_near(&other, sample, contact);
        let agrees = self.last_raw.is_none_or(is_near);
        let is_good = self.last_good.is_none_or(is_near);
        self.last_raw = Some(*sample);
        if is_good {
            return None;
        }
        self.agreeing = if agrees { self.agreeing + 1 } else { 0 };
        (self.agreeing < AGREEING_SAMPLES).then_some(Rejection::Outlier)
    }

    fn is_near(&self, a: &ImuSample, b: &ImuSample, contact: Contact) -> bool {
        let mut jump = a.specific_force - b.specific_force;
        if contact == Contact::Possible {
            jump.z = 0.0;
        }
        jump.norm() <= self.limits.max_specific_force_jump_m_s2
            && (a.angular_rate - b.angular_rate).norm() <= self.limits.max_angular_rate_jump_rad_s
    }
}

/// The mean of the readings on both sides of a gap.
fn after_gap(before: &ImuSample, sample: &ImuSample) -> ImuVerdict {
    ImuVerdict::AfterGap(ImuSample {
        time: sample.time,
        specific_force: (before.specific_force + sample.specific_force) * 0.5,
        angular_rate: (before.angular_rate + sample.angular_rate) * 0.5,
    })
}

/// Mean angular rate between two times, rad/s, of samples with their time, newest first; a sample
/// holds from the one before it on. `None` where they do not reach.
pub(crate) fn mean_angular_rate(
    newest_first: impl Iterator<Item = (Timestamp, Vector3<f64>)>,
    from: Timestamp,
    to: Timestamp,
) -> Option<Vector3<f64>> {
    let mut turn = Vector3::zeros();
    let mut duration_s = 0.0;
    let mut samples = newest_first.peekable();
    while let (Some((end, rate)), Some((begin, _))) = (samples.next(), samples.peek()) {
        if end <= from {
            break;
        }
        let overlap_s = end.min(to).seconds_since(from.max(*begin));
        if overlap_s > 0.0 {
            turn += rate * overlap_s;
            duration_s += overlap_s;
        }
    }
    (duration_s > 0.0).then(|| turn / duration_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(ms: i64, x: f64) -> ImuSample {
        ImuSample {
            time: Timestamp::from_ns(ms * 1_000_000),
            specific_force: Vector3::new(x, 0.0, 9.8),
            angular_rate: Vector3::zeros(),
        }
    }

    fn monitor() -> ImuMonitor {
        let mut monitor = ImuMonitor::new(ImuLimits::default());
        assert_eq!(
            monitor.judge(&sample(4, 0.0), Contact::Impossible),
            ImuVerdict::Good(sample(4, 0.0))
        );
        monitor
    }

    #[test]
    fn numbers_that_are_not_finite_are_bridged_with_the_last_good_reading() {
        let verdict = monitor().judge(&sample(8, f64::NAN), Contact::Impossible);
        assert_eq!(
            verdict,
            ImuVerdict::Bridged(sample(8, 0.0), Rejection::NotFinite)
        );
    }

    #[test]
    fn saturated_samples_are_bridged() {
        let verdict = monitor().judge(&sample(8, 156.9), Contact::Impossible);
        assert_eq!(
            verdict,
            ImuVerdict::Bridged(sample(8, 0.0), Rejection::Invalid)
        );
    }

    #[test]
    fn a_burst_that_does_not_agree_with_itself_is_never_believed() {
        let mut monitor = monitor();
        for i in 0..100 {
            let x = if i % 2 == 0 { 90.0 } else { -90.0 };
            let verdict = monitor.judge(&sample(8 + 4 * i, x), Contact::Impossible);
            assert!(matches!(
                verdict,
                ImuVerdict::Bridged(_, Rejection::Outlier)
            ));
        }
        assert!(monitor.is_lost(sample(408, 0.0).time));
    }

    /// A sample with this specific force along the body's z axis.
    fn pushed(ms: i64, z: f64) -> ImuSample {
        let mut sample = sample(ms, 0.0);
        sample.specific_force.z = z;
        sample
    }

    /// Sum of the specific forces along z over the samples of an impact of the feet on the ground,
    /// as the filter gets them, and as they are.
    fn impact(contact: Contact) -> (f64, f64) {
        let mut monitor = monitor();
        let readings = [70.0, 55.0, 38.0, 22.0, 8.0, 9.8];
        let mut used = 0.0;
        for (i, z) in readings.iter().enumerate() {
            match monitor.judge(&pushed(8 + 4 * i as i64, *z), contact) {
                ImuVerdict::Good(sample) | ImuVerdict::Bridged(sample, _) => {
                    used += sample.specific_force.z;
                }
                other => panic!("{other:?}"),
            }
        }
        (used, readings.iter().sum())
    }

    #[test]
    fn in_a_landing_the_ground_may_push() {
        let (used, true_sum) = impact(Contact::Possible);
        assert_eq!(used, true_sum);
    }

    #[test]
    fn in_flight_such_a_push_is_an_outlier() {
        let (used, true_sum) = impact(Contact::Impossible);
        assert!(used < 0.5 * true_sum, "{used} of {true_sum}");
    }

    #[test]
    fn in_a_landing_jumps_across_are_outliers_all_the_same() {
        let verdict = monitor().judge(&sample(8, 90.0), Contact::Possible);
        assert_eq!(
            verdict,
            ImuVerdict::Bridged(sample(8, 0.0), Rejection::Outlier)
        );
    }

    #[test]
    fn a_lasting_change_is_believed_after_a_few_samples() {
        let mut monitor = monitor();
        let believed = (0..10).find(|i| {
            matches!(
                monitor.judge(&sample(8 + 4 * i, 90.0), Contact::Impossible),
                ImuVerdict::Good(_)
            )
        });
        assert_eq!(believed, Some(i64::from(AGREEING_SAMPLES)));
    }

    #[test]
    fn time_that_does_not_advance_is_refused_and_in_the_end_means_loss() {
        let mut monitor = monitor();
        for _ in 0..BACKWARD_SAMPLES {
            assert!(!monitor.is_lost(sample(4, 0.0).time));
            let verdict = monitor.judge(&sample(4, 0.0), Contact::Impossible);
            assert_eq!(verdict, ImuVerdict::Rejected(Rejection::OutOfOrder));
        }
        assert!(monitor.is_lost(sample(4, 0.0).time));
    }

    #[test]
    fn silence_beyond_the_limit_means_loss() {
        assert!(!monitor().is_lost(sample(203, 0.0).time));
        assert!(monitor().is_lost(sample(206, 0.0).time));
    }
}
