//! The recent past of a filter, so that a measurement is fused at the time at which it was true
//! and everything after it is computed again (document O, section 2.4.2, figure 2.10).

use std::collections::VecDeque;
use std::mem::discriminant;

use alula_geometry::Timestamp;
use alula_messages::{Fusion, ImuSample, Rejection};
use nalgebra::Vector3;

use crate::eskf::{Filter, ImuNoise, InertialInput};
use crate::imu::mean_angular_rate;
use crate::measurement::{Gates, Measurement};

/// Measurements that can be kept for each inertial sample.
const MEASUREMENTS_PER_SAMPLE: usize = 4;

/// An inertial input that held since the node before, and the filter after all measurements up to
/// `time`.
#[derive(Clone, Debug)]
struct Node {
    time: Timestamp,
    input: InertialInput,
    filter: Filter,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    time: Timestamp,
    /// Which of several sensors of the same kind.
    source: u8,
    measurement: Measurement,
    /// Whether its first fusion was told to the caller.
    reported: bool,
}

/// A ring of inertial samples with the states after them, and the measurements in between, in
/// order of time. Nothing is allocated after construction.
///
/// A measurement between two samples is fused at its exact time: the interval is cut there, which
/// for an input that is constant over the interval is exact. Several measurements that arrive
/// together cost one rewind.
#[derive(Clone, Debug)]
pub struct History {
    noise: ImuNoise,
    gates: Gates,
    capacity: usize,
    nodes: VecDeque<Node>,
    entries: VecDeque<Entry>,
    /// Earliest time since the last settling at which something is new.
    changed_since: Option<Timestamp>,
}

impl History {
    /// An empty history of up to `capacity` inertial samples.
    pub fn new(capacity: usize, noise: ImuNoise, gates: Gates) -> Self {
        let capacity = capacity.max(2);
        Self {
            noise,
            gates,
            capacity,
            nodes: VecDeque::with_capacity(capacity + 1),
            entries: VecDeque::with_capacity(capacity * MEASUREMENTS_PER_SAMPLE + 1),
            changed_since: None,
        }
    }

    /// Forgets everything and starts from `filter` at `time`.
    pub fn start(&mut self, time: Timestamp, input: InertialInput, filter: Filter) {
        self.nodes.clear();
        self.entries.clear();
        self.changed_since = None;
        self.nodes.push_back(Node {
            time,
            input,
            filter,
        });
    }

    /// Time of the last inertial sample.
    pub fn latest_time(&self) -> Option<Timestamp> {
        self.nodes.back().map(|node| node.time)
    }

    /// The filter after the last inertial sample, as of the last [`Self::settle`].
    pub fn latest(&self) -> Option<(&Filter, &InertialInput)> {
        self.nodes.back().map(|node| (&node.filter, &node.input))
    }

    /// Adds an inertial sample that is later than all before it. When the ring is full the oldest
    /// sample leaves; `report` is used only if it takes unsettled changes with it.
    pub fn push(&mut self, sample: &ImuSample, noise_scale: f64, report: &mut dyn FnMut(Fusion)) {
        if self.nodes.len() == self.capacity {
            if self
                .changed_since
                .is_some_and(|since| since <= self.nodes[1].time)
            {
                self.settle(report);
            }
            self.forget_oldest();
        }
        let Some(last) = self.nodes.back() else {
            return;
        };
        let filter = last.filter.clone();
        let input = InertialInput {
            specific_force: sample.specific_force,
            angular_rate: sample.angular_rate,
            previous_angular_rate: last.input.angular_rate,
            interval_s: sample.time.seconds_since(last.time),
            noise_scale,
        };
        self.nodes.push_back(Node {
            time: sample.time,
            input,
            filter,
        });
        self.mark_changed(sample.time);
    }

    /// Adds a measurement of the only sensor of its kind, see [`Self::insert_from`].
    ///
    /// # Errors
    /// The reason why it cannot be.
    pub fn insert(&mut self, time: Timestamp, measurement: Measurement) -> Result<(), Rejection> {
        self.insert_from(0, time, measurement)
    }

    /// Adds a measurement of the sensor number `source` of its kind; it is fused by the next
    /// [`Self::settle`]. Those of equal time are fused in the order of their sources, so that the
    /// order in which sensors are heard does not matter.
    ///
    /// # Errors
    /// The reason why it cannot be: older than the history, later than the last inertial sample,
    /// or there is one of the same kind and source for this time already.
    pub fn insert_from(
        &mut self,
        source: u8,
        time: Timestamp,
        measurement: Measurement,
    ) -> Result<(), Rejection> {
        let (Some(first), Some(last)) = (self.nodes.front(), self.nodes.back()) else {
            return Err(Rejection::TooOld);
        };
        if time <= first.time {
            return Err(Rejection::TooOld);
        }
        if time > last.time {
            return Err(Rejection::Invalid);
        }
        let place = self
            .entries
            .partition_point(|e| (e.time, e.source) <= (time, source));
        let same_time = self
            .entries
            .iter()
            .take(place)
            .rev()
            .take_while(|e| (e.time, e.source) == (time, source));
        let kind = discriminant(&measurement);
        if same_time
            .into_iter()
            .any(|e| discriminant(&e.measurement) == kind)
        {
            return Err(Rejection::OutOfOrder);
        }
        if self.entries.len() == self.capacity * MEASUREMENTS_PER_SAMPLE {
            return Err(Rejection::TooOld);
        }
        self.entries.insert(
            place,
            Entry {
                time,
                source,
                measurement,
                reported: false,
            },
        );
        self.mark_changed(time);
        Ok(())
    }

    /// Mean reading of the gyroscope between two times, body frame, bias included, rad/s, as far
    /// as the history reaches.
    pub fn mean_angular_rate(&self, from: Timestamp, to: Timestamp) -> Option<Vector3<f64>> {
        let samples = self.nodes.iter().rev();
        mean_angular_rate(samples.map(|s| (s.time, s.input.angular_rate)), from, to)
    }

    /// Computes again all states from the first change on; tells `report` the fate of each
    /// measurement that is fused for the first time.
    pub fn settle(&mut self, report: &mut dyn FnMut(Fusion)) {
        let Some(since) = self.changed_since.take() else {
            return;
        };
        let first = self.nodes.partition_point(|node| node.time < since).max(1);
        if first >= self.nodes.len() {
            return;
        }
        let mut time = self.nodes[first - 1].time;
        let mut filter = self.nodes[first - 1].filter.clone();
        let mut next = self.entries.partition_point(|e| e.time <= time);
        for node in self.nodes.range_mut(first..) {
            while let Some(entry) = self.entries.get_mut(next).filter(|e| e.time <= node.time) {
                filter.propagate(&node.input, entry.time.seconds_since(time), &self.noise);
                time = entry.time;
                let fusion = entry.measurement.fuse(time, &mut filter, &self.gates);
                if !std::mem::replace(&mut entry.reported, true) {
                    fusion.into_iter().for_each(&mut *report);
                }
                next += 1;
            }
            filter.propagate(&node.input, node.time.seconds_since(time), &self.noise);
            time = node.time;
            node.filter.clone_from(&filter);
        }
    }

    fn forget_oldest(&mut self) {
        self.nodes.pop_front();
        if let Some(first) = self.nodes.front() {
            while self.entries.front().is_some_and(|e| e.time <= first.time) {
                self.entries.pop_front();
            }
        }
    }

    fn mark_changed(&mut self, time: Timestamp) {
        self.changed_since = Some(self.changed_since.map_or(time, |t| t.min(time)));
    }
}

#[cfg(test)]
#[path = "history_tests.rs"]
mod tests;
