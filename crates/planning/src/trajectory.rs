//! A trajectory as it is flown: polynomials in time, sampled as references.

use alula_messages::Reference;
use nalgebra::Vector3;

use crate::extrema;
use crate::hermite::{COEFFICIENTS, Ends, falling};
use crate::yaw::YawSpline;

/// One polynomial of degree nine per axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Segment {
    pub duration_s: f64,
    /// Coefficients of powers of `u = t / duration`, one column per axis (m).
    pub coefficients: Ends,
}

impl Segment {
    /// Derivative of the given order with respect to time (s) at `u` in 0..1.
    pub(crate) fn derivative(&self, order: usize, u: f64) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for power in (order..COEFFICIENTS).rev() {
            let row = self.coefficients.row(power).transpose();
            sum = sum * u + row * falling(power, order);
        }
        sum / self.duration_s.powi(order as i32)
    }

    /// Greatest norm of the derivative of the given order.
    pub(crate) fn maximum(&self, order: usize) -> f64 {
        let mut square = vec![0.0; 2 * (COEFFICIENTS - order) - 1];
        for axis in 0..3 {
            let powers: Vec<f64> = (order..COEFFICIENTS)
                .map(|power| falling(power, order) * self.coefficients[(power, axis)])
                .collect();
            extrema::add_square(&mut square, &powers);
        }
        extrema::maximum(&square).max(0.0).sqrt() / self.duration_s.powi(order as i32)
    }

    /// Greatest norm of a derivative over `samples` points, a quick estimate of [`Self::maximum`].
    pub(crate) fn sampled_maximum(&self, order: usize, samples: usize) -> f64 {
        (0..=samples)
            .map(|k| self.derivative(order, k as f64 / samples as f64).norm())
            .fold(0.0, f64::max)
    }
}

/// A smooth path in position and yaw over time, from its start at time 0 to rest.
///
/// Position is continuous up to snap, yaw up to its rate.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    segments: Vec<Segment>,
    /// End of each segment, s.
    ends_s: Vec<f64>,
    yaw: YawSpline,
}

impl Trajectory {
    pub(crate) fn new(segments: Vec<Segment>, yaw: YawSpline) -> Self {
        let ends_s = segments
            .iter()
            .scan(0.0, |end, segment| {
                *end += segment.duration_s;
                Some(*end)
            })
            .collect();
        Self {
            segments,
            ends_s,
            yaw,
        }
    }

    /// Time from the start to rest, s. A turn in place at the end counts.
    pub fn duration_s(&self) -> f64 {
        self.motion_duration_s().max(self.yaw.duration_s())
    }

    /// Time at which each waypoint is reached, s.
    pub fn waypoint_times_s(&self) -> &[f64] {
        &self.ends_s
    }

    /// Greatest speed, m/s, exact and not sampled.
    pub fn max_speed_m_s(&self) -> f64 {
        self.maximum(1)
    }

    /// Greatest acceleration, m/s^2, exact and not sampled.
    pub fn max_acceleration_m_s2(&self) -> f64 {
        self.maximum(2)
    }

    /// Greatest snap, m/s^4, exact and not sampled.
    pub fn max_snap_m_s4(&self) -> f64 {
        self.maximum(4)
    }

    /// Greatest absolute yaw rate, rad/s.
    pub fn max_yaw_rate_rad_s(&self) -> f64 {
        self.yaw.max_rate_rad_s()
    }

    /// The reference at a time since the start, s. Before the start it is the start, after the end
    /// it is hover at the last waypoint.
    pub fn sample(&self, t_s: f64) -> Reference {
        let t_s = if t_s > 0.0 { t_s } else { 0.0 };
        let (yaw_rad, yaw_rate_rad_s, yaw_acceleration_rad_s2) = self.yaw.sample(t_s);
        let mut reference = Reference {
            yaw_rad,
            yaw_rate_rad_s,
            yaw_acceleration_rad_s2,
            ..Reference::default()
        };
        let index = self.ends_s.partition_point(|end| *end <= t_s);
        let Some(segment) = self.segments.get(index) else {
            reference.position_world = self.end_position();
            return reference;
        };
        let start_s = if index == 0 {
            0.0
        } else {
            self.ends_s[index - 1]
        };
        let u = (t_s - start_s) / segment.duration_s;
        reference.position_world = segment.derivative(0, u);
        reference.velocity_world = segment.derivative(1, u);
        reference.acceleration_world = segment.derivative(2, u);
        reference.jerk_world = segment.derivative(3, u);
        reference.snap_world = segment.derivative(4, u);
        reference
    }

    fn end_position(&self) -> Vector3<f64> {
        self.segments
            .last()
            .map_or_else(Vector3::zeros, |segment| segment.derivative(0, 1.0))
    }

    fn motion_duration_s(&self) -> f64 {
        self.ends_s.last().copied().unwrap_or(0.0)
    }

    fn maximum(&self, order: usize) -> f64 {
        self.segments
            .iter()
            .map(|segment| segment.maximum(order))
            .fold(0.0, f64::max)
    }
}
