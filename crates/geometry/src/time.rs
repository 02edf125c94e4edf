//! Integer time: comparisons are exact and nothing depends on how long a flight has lasted.

use std::fmt;
use std::ops::{Add, AddAssign, Neg, Sub};

use serde::{Deserialize, Serialize};

const NANOSECONDS_PER_SECOND: f64 = 1e9;

/// A point in time, nanoseconds since an epoch that the source of the data chooses.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Timestamp(i64);

/// A signed span of time, nanoseconds.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct TimeDelta(i64);

impl Timestamp {
    /// The epoch itself.
    pub const ZERO: Self = Self(0);

    /// A time stamp from nanoseconds since the epoch.
    pub const fn from_ns(ns: i64) -> Self {
        Self(ns)
    }

    /// The time stamp nearest to `seconds` since the epoch.
    pub fn from_s(seconds: f64) -> Self {
        Self((seconds * NANOSECONDS_PER_SECOND).round() as i64)
    }

    /// Nanoseconds since the epoch.
    pub const fn as_ns(self) -> i64 {
        self.0
    }

    /// Seconds since the epoch; exact to a microsecond for epochs up to centuries ago.
    pub fn as_s(self) -> f64 {
        self.0 as f64 / NANOSECONDS_PER_SECOND
    }

    /// Seconds from `earlier` to `self`; negative if `earlier` is later.
    pub fn seconds_since(self, earlier: Self) -> f64 {
        (self - earlier).as_s()
    }
}

impl TimeDelta {
    /// No time at all.
    pub const ZERO: Self = Self(0);

    /// A span from nanoseconds.
    pub const fn from_ns(ns: i64) -> Self {
        Self(ns)
    }

    /// The span nearest to `seconds`.
    pub fn from_s(seconds: f64) -> Self {
        Self((seconds * NANOSECONDS_PER_SECOND).round() as i64)
    }

    /// The period of a rate, to the nearest nanosecond; `rate_hz` must be positive.
    pub fn from_hz(rate_hz: f64) -> Self {
        Self::from_s(1.0 / rate_hz)
    }

    /// Nanoseconds.
    pub const fn as_ns(self) -> i64 {
        self.0
    }

    /// Seconds.
    pub fn as_s(self) -> f64 {
        self.0 as f64 / NANOSECONDS_PER_SECOND
    }
}

impl Sub for Timestamp {
    type Output = TimeDelta;
    fn sub(self, earlier: Self) -> TimeDelta {
        TimeDelta(self.0.saturating_sub(earlier.0))
    }
}

impl Add<TimeDelta> for Timestamp {
    type Output = Self;
    fn add(self, delta: TimeDelta) -> Self {
        Self(self.0.saturating_add(delta.0))
    }
}

impl Sub<TimeDelta> for Timestamp {
    type Output = Self;
    fn sub(self, delta: TimeDelta) -> Self {
        Self(self.0.saturating_sub(delta.0))
    }
}

impl AddAssign<TimeDelta> for Timestamp {
    fn add_assign(&mut self, delta: TimeDelta) {
        *self = *self + delta;
    }
}

impl Add for TimeDelta {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl Sub for TimeDelta {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }
}

impl Neg for TimeDelta {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl fmt::Display for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.6} s", self.as_s())
    }
}

impl fmt::Display for TimeDelta {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.6} s", self.as_s())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_and_nanoseconds_agree() {
        let t = Timestamp::from_s(1403715273.262142976);
        assert!((t.as_s() - 1403715273.262142976).abs() < 1e-6);
        assert_eq!(Timestamp::from_s(0.25).as_ns(), 250_000_000);
    }

    #[test]
    fn differences_are_exact_at_any_epoch() {
        let start = Timestamp::from_ns(1_403_715_273_262_142_976);
        let later = start + TimeDelta::from_ns(1);
        assert_eq!(later - start, TimeDelta::from_ns(1));
        assert!(later > start);
    }
}
