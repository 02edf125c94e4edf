//! How far the ground is below the vehicle, by the raw ranger alone.

use alula_geometry::{Timestamp, so3};
use alula_messages::{NavState, RangeSample};

/// Readings older than this say nothing about the present, s.
const MAX_AGE_S: f64 = 0.3;

/// A ranger that stops to see the ground within this distance above its least one has come too
/// near to it, m: what a landing passes in a tenth of a second, and the noise of a reading.
const NEAR_THE_LEAST_M: f64 = 0.1;

/// The latest distance to the ground.
///
/// A ranger says nothing below its least distance, and vehicles with short legs stand below it.
/// One that falls silent that way just above its least distance is near the ground all the same,
/// until it sees something or stops to speak.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct GroundRange {
    /// When the ranger spoke last, and the distance along its beam, m.
    latest: Option<(Timestamp, f64)>,
}

impl GroundRange {
    pub(crate) fn take(&mut self, sample: &RangeSample) {
        self.latest = if sample.is_valid() {
            Some((sample.time, sample.range_m))
        } else {
            self.too_near(sample).map(|range_m| (sample.time, range_m))
        };
    }

    /// The greatest distance that a reading below the least one can mean; `None` if it may mean
    /// anything.
    fn too_near(&self, sample: &RangeSample) -> Option<f64> {
        let (time, range_m) = self.latest?;
        let follows = sample.time.seconds_since(time) <= MAX_AGE_S;
        let came_near = range_m <= sample.min_m + NEAR_THE_LEAST_M;
        (sample.range_m < sample.min_m && follows && came_near).then_some(sample.min_m)
    }

    /// Height of the ranger above the ground, with the beam tilted as the vehicle is, m. Where the
    /// ranger is too near, it is no higher than that.
    pub(crate) fn height_m(&self, state: &NavState, now: Timestamp) -> Option<f64> {
        let (time, range_m) = self.latest?;
        let upright = so3::tilt_rad(&state.world_from_body.rotation).cos();
        (now.seconds_since(time) < MAX_AGE_S).then_some(range_m * upright)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Height after these readings, one every 20 ms, of a ranger that sees from 5 cm on.
    fn height_after(readings_m: &[f64]) -> Option<f64> {
        let mut ground = GroundRange::default();
        let mut time = Timestamp::ZERO;
        for (i, range_m) in readings_m.iter().enumerate() {
            time = Timestamp::from_s(0.02 * i as f64);
            ground.take(&RangeSample {
                time,
                range_m: *range_m,
                min_m: 0.05,
                max_m: 14.0,
            });
        }
        ground.height_m(&NavState::default(), time)
    }

    #[test]
    fn a_reading_is_a_height() {
        assert_eq!(height_after(&[1.2]), Some(1.2));
    }

    #[test]
    fn a_ranger_that_came_too_near_is_near() {
        let mut readings_m = vec![0.11, 0.09, 0.07];
        readings_m.extend([0.0; 100]);
        assert_eq!(height_after(&readings_m), Some(0.05));
    }

    #[test]
    fn a_ranger_that_reads_too_near_high_above_the_ground_says_nothing() {
        assert_eq!(height_after(&[1.2, 0.0]), None);
        assert_eq!(height_after(&[1.2, 0.0, 0.0]), None);
    }

    #[test]
    fn a_ranger_that_has_seen_nothing_yet_says_nothing() {
        assert_eq!(height_after(&[0.0, 0.0]), None);
    }

    #[test]
    fn no_echo_near_the_ground_says_nothing() {
        assert_eq!(height_after(&[0.07, 28.0, 0.0]), None);
    }

    #[test]
    fn a_silent_ranger_says_nothing() {
        let mut ground = GroundRange::default();
        let sample = |time: Timestamp, range_m: f64| RangeSample {
            time,
            range_m,
            min_m: 0.05,
            max_m: 14.0,
        };
        ground.take(&sample(Timestamp::ZERO, 0.07));
        let late = Timestamp::from_s(0.4);
        assert_eq!(ground.height_m(&NavState::default(), late), None);
        ground.take(&sample(late, 0.0));
        assert_eq!(ground.height_m(&NavState::default(), late), None);
    }
}
