//! How long each segment lasts.
//!
//! A first guess from the distances, then descent on snap over the relative times, as Mellinger and
//! Kumar (2011) do. The fastest timing on the way is scaled so that the exact maxima meet the
//! limits.

use crate::corridor;
use crate::minimum_snap::{MinimumSnapConfig, PlanError};
use crate::problem::{Knot, SnapProblem};
use crate::trajectory::Segment;
use alula_optim::Exit;

/// Points per segment at which speed and acceleration are sampled while times are sought.
const SAMPLES: usize = 12;
/// Longest and shortest segment may differ by this factor from their first guess.
const MAX_STRETCH: f64 = 20.0;
/// Ratio between neighbouring total times in the search from a moving start.
const SEARCH_RATIO: f64 = 1.12;
/// Factors on the time of the first segment, which has to shed the speed of the start.
const FIRST_FACTORS: [f64; 4] = [1.0, 1.6, 0.6, 2.5];
/// Steps of that search on either side of the first guess.
const SEARCH_STEPS: i32 = 12;
/// Halvings that refine its result: 1.12^(1/16) is within 1 %.
const SEARCH_HALVINGS: usize = 4;
/// Distance that exact maxima keep from the limits, for the rounding of polynomials.
const ROUNDING: f64 = 1e-9;

/// The limits, and how near to them a motion comes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Effort {
    pub max_speed_m_s: f64,
    pub max_acceleration_m_s2: f64,
}

impl Effort {
    /// Greatest of speed over its limit and the root of acceleration over its limit: the factor by
    /// which a motion from rest must be slowed down. 1 is at a limit.
    fn of(&self, speed_m_s: f64, acceleration_m_s2: f64) -> f64 {
        (speed_m_s / self.max_speed_m_s)
            .max((acceleration_m_s2 / self.max_acceleration_m_s2).sqrt())
    }

    fn sampled(&self, segment: &Segment) -> f64 {
        self.of(
            segment.sampled_maximum(1, SAMPLES),
            segment.sampled_maximum(2, SAMPLES),
        )
    }

    fn exact(&self, segments: &[Segment]) -> f64 {
        segments
            .iter()
            .map(|segment| self.of(segment.maximum(1), segment.maximum(2)))
            .fold(0.0, f64::max)
    }

    /// Distance (m) in which a speed is shed smoothly. A bell of acceleration, v' ~ s^3 (1 - s)^3,
    /// takes 2.2 times the v^2 / (2 a) of the least distance; a start may also still accelerate.
    fn braking_m(&self, speed_m_s: f64) -> f64 {
        1.5 * speed_m_s * speed_m_s / self.max_acceleration_m_s2
    }
}

/// Times for the segments (s): good relative to each other, near the limits as a whole.
pub(crate) fn allocate(
    problem: &SnapProblem<'_>,
    effort: &Effort,
    config: &MinimumSnapConfig,
) -> Result<Vec<f64>, PlanError> {
    let guess = first_guess(problem, effort);
    let mut search = Search::new(problem, effort, guess);
    search.descend(config.descent_steps)?;
    Ok(search.best)
}

/// Each segment at a speed that its length allows, with time to gather and shed it at the ends.
fn first_guess(problem: &SnapProblem<'_>, effort: &Effort) -> Vec<f64> {
    let last = problem.segments() - 1;
    let acceleration = effort.max_acceleration_m_s2;
    let start_speed = problem.start_velocity().norm();
    problem
        .points
        .windows(2)
        .enumerate()
        .map(|(i, pair)| {
            let line = pair[1] - pair[0];
            let length = line.norm();
            let speed = effort.max_speed_m_s.min((acceleration * length).sqrt());
            let ends = 1.0 + f64::from(u8::from(i == 0)) + f64::from(u8::from(i == last));
            let mut time = length / speed + 0.5 * ends * speed / acceleration;
            if i == 0 && start_speed > 0.0 {
                // Speed that does not lead to the waypoint has to be shed first.
                let along = problem.start_velocity().dot(&line) / length;
                time += (start_speed - along) / acceleration;
            }
            time
        })
        .collect()
}

/// Times and the derivatives that belong to them.
struct Solution {
    times_s: Vec<f64>,
    knots: Vec<Knot>,
}

/// The search over times, with the fastest found.
struct Search<'a> {
    problem: &'a SnapProblem<'a>,
    effort: &'a Effort,
    guess: Vec<f64>,
    times_s: Vec<f64>,
    best: Vec<f64>,
    best_duration_s: f64,
}

impl<'a> Search<'a> {
    fn new(problem: &'a SnapProblem<'a>, effort: &'a Effort, guess: Vec<f64>) -> Self {
        Self {
            problem,
            effort,
            times_s: guess.clone(),
            best: guess.clone(),
            guess,
            best_duration_s: f64::INFINITY,
        }
    }

    fn solve(&self, times_s: &[f64]) -> Result<Vec<Knot>, PlanError> {
        self.problem.solve(times_s).ok_or(PlanError::Unsolved {
            exit: Exit::NotConvex,
        })
    }

    /// Keeps the present times if they are the fastest so far.
    fn judge(&mut self, knots: &[Knot]) {
        let segments = self.problem.polynomials(knots, &self.times_s);
        let slowdown = segments
            .iter()
            .map(|segment| self.effort.sampled(segment))
            .fold(0.0, f64::max);
        let duration_s = slowdown * self.times_s.iter().sum::<f64>();
        if duration_s < self.best_duration_s {
            self.best_duration_s = duration_s;
            self.best = self.times_s.iter().map(|t| t * slowdown).collect();
        }
    }

    /// Descent on the logarithm of snap over the logarithms of the times, their sum kept.
    fn descend(&mut self, steps: usize) -> Result<(), PlanError> {
        let mut knots = self.solve(&self.times_s)?;
        self.judge(&knots);
        let mut length = 0.1;
        for _ in 0..steps {
            let (cost, slope) = self.slope(&knots, &self.times_s);
            let Some(lower) = self.line_search(cost, &slope, &mut length)? else {
                break;
            };
            self.times_s = lower.times_s;
            knots = lower.knots;
            self.judge(&knots);
        }
        Ok(())
    }

    /// Halves the step until snap falls, then lets the next one try twice as far.
    fn line_search(
        &self,
        cost: f64,
        slope: &[f64],
        length: &mut f64,
    ) -> Result<Option<Solution>, PlanError> {
        let steepest = slope.iter().fold(0.0_f64, |a, g| a.max(g.abs()));
        // A slope of 1e-3 changes snap by a tenth of a percent when a time changes by e.
        if steepest < 1e-3 {
            return Ok(None);
        }
        for _ in 0..6 {
            let times_s = self.stepped(slope, *length / steepest.max(1.0));
            let knots = self.solve(&times_s)?;
            if self.problem.cost(&knots, &times_s).ln() < cost.ln() {
                *length *= 2.0;
                return Ok(Some(Solution { times_s, knots }));
            }
            *length *= 0.5;
        }
        Ok(None)
    }

    /// Snap, and the slope of its logarithm over the logarithm of each time while the sum stays.
    fn slope(&self, knots: &[Knot], times_s: &[f64]) -> (f64, Vec<f64>) {
        let costs = self.problem.costs(knots, times_s);
        let cost: f64 = costs.iter().map(|(cost, _)| cost).sum();
        let total: f64 = times_s.iter().sum();
        let whole: f64 = costs.iter().map(|(_, slope)| slope / cost).sum();
        let slope = costs
            .iter()
            .zip(times_s)
            .map(|((_, slope), t_s)| slope / cost - whole * t_s / total)
            .collect();
        (cost, slope)
    }

    fn stepped(&self, slope: &[f64], length: f64) -> Vec<f64> {
        let total: f64 = self.times_s.iter().sum();
        let mut times_s: Vec<f64> = self
            .times_s
            .iter()
            .zip(slope)
            .zip(&self.guess)
            .map(|((t, g), guess)| {
                (t * (-length * g).exp()).clamp(guess / MAX_STRETCH, guess * MAX_STRETCH)
            })
            .collect();
        let sum: f64 = times_s.iter().sum();
        times_s.iter_mut().for_each(|t| *t *= total / sum);
        times_s
    }
}

/// The segments for these relative times, as fast as the limits allow.
pub(crate) fn meet_limits(
    problem: &SnapProblem<'_>,
    effort: &Effort,
    config: &MinimumSnapConfig,
    times_s: &[f64],
) -> Result<Vec<Segment>, PlanError> {
    let fit = |first: f64, scale: f64| {
        let mut times_s: Vec<f64> = times_s.iter().map(|t| t * scale).collect();
        times_s[0] *= first;
        fit(problem, effort, config, &times_s)
    };
    if problem.starts_at_rest() {
        return Ok(slowed(fit(1.0, 1.0)?, effort));
    }
    MovingStart::new(effort, &fit).search(1.0 + config.start_margin)
}

/// The same path, slowed down or sped up until it is at a limit.
fn slowed(mut segments: Vec<Segment>, effort: &Effort) -> Vec<Segment> {
    let slowdown = effort.exact(&segments) * (1.0 + ROUNDING);
    for segment in &mut segments {
        segment.duration_s *= slowdown;
    }
    segments
}

/// Solves for given times, within the corridor.
fn fit(
    problem: &SnapProblem<'_>,
    effort: &Effort,
    config: &MinimumSnapConfig,
    times_s: &[f64],
) -> Result<Vec<Segment>, PlanError> {
    let unsolved = |exit| PlanError::Unsolved { exit };
    let free = problem.solve(times_s).ok_or(unsolved(Exit::NotConvex))?;
    let braking_m = effort.braking_m(problem.start_velocity().norm());
    let corridor_m = |segment: usize| {
        if segment == 0 {
            config.corridor_m + braking_m
        } else {
            config.corridor_m
        }
    };
    let knots = corridor::solve(problem, times_s, corridor_m, free).map_err(unsolved)?;
    Ok(problem.polynomials(&knots, times_s))
}

/// The search for the shortest times from a moving start. Neither speed nor acceleration falls
/// steadily with time there: too fast and the path needs more than the limits, too slow and the
/// speed of the start leads astray.
struct MovingStart<'a, F> {
    effort: &'a Effort,
    /// Segments for a factor on the first time and a factor on all of them.
    fit: &'a F,
    least: f64,
    best: Result<Vec<Segment>, PlanError>,
}

impl<'a, F> MovingStart<'a, F>
where
    F: Fn(f64, f64) -> Result<Vec<Segment>, PlanError>,
{
    fn new(effort: &'a Effort, fit: &'a F) -> Self {
        Self {
            effort,
            fit,
            least: f64::INFINITY,
            best: Err(PlanError::LimitsUnreachable {
                effort: f64::INFINITY,
            }),
        }
    }

    /// The fastest segments within the limits, or else those that exceed them least, if that is by
    /// no more than `accepted`.
    fn search(mut self, accepted: f64) -> Result<Vec<Segment>, PlanError> {
        for first in FIRST_FACTORS {
            for step in -SEARCH_STEPS..=SEARCH_STEPS {
                let scale = SEARCH_RATIO.powi(step);
                if let Some(segments) = self.attempt(first, scale) {
                    return Ok(self.refine(first, scale, segments));
                }
            }
        }
        if self.least.is_finite() && self.least > accepted {
            return Err(PlanError::LimitsUnreachable { effort: self.least });
        }
        self.best
    }

    /// The segments if they keep the limits.
    fn attempt(&mut self, first: f64, scale: f64) -> Option<Vec<Segment>> {
        match (self.fit)(first, scale) {
            Err(error) => {
                if self.least.is_infinite() {
                    self.best = Err(error);
                }
                None
            }
            Ok(segments) => {
                let found = self.effort.exact(&segments);
                if found <= 1.0 {
                    return Some(segments);
                }
                if found < self.least {
                    self.least = found;
                    self.best = Ok(segments);
                }
                None
            }
        }
    }

    /// Halves the interval between the last scale that failed and the first that did not.
    fn refine(mut self, first: f64, scale: f64, segments: Vec<Segment>) -> Vec<Segment> {
        let (mut slow, mut fast) = (scale, scale / SEARCH_RATIO);
        let mut best = segments;
        for _ in 0..SEARCH_HALVINGS {
            let middle = (slow * fast).sqrt();
            match self.attempt(first, middle) {
                Some(segments) => {
                    best = segments;
                    slow = middle;
                }
                None => fast = middle,
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hermite::Hermite;
    use alula_messages::Reference;
    use nalgebra::Vector3;

    const EFFORT: Effort = Effort {
        max_speed_m_s: 2.0,
        max_acceleration_m_s2: 2.5,
    };

    fn problem(hermite: &Hermite) -> SnapProblem<'_> {
        let start = Reference {
            velocity_world: Vector3::new(0.8, 0.1, 0.0),
            ..Reference::default()
        };
        let waypoints = [
            Vector3::new(3.0, 0.0, 1.0),
            Vector3::new(3.0, 2.0, 1.5),
            Vector3::new(-1.0, 4.0, 0.5),
        ];
        SnapProblem::new(hermite, &start, &waypoints)
    }

    #[test]
    fn the_slope_over_times_meets_differences() {
        let hermite = Hermite::new().unwrap();
        let problem = problem(&hermite);
        let search = Search::new(&problem, &EFFORT, vec![2.5, 1.7, 3.1]);
        let knots = problem.solve(&search.times_s).unwrap();
        let (_, slope) = search.slope(&knots, &search.times_s);
        let log_cost = |i: usize, h: f64| {
            let mut direction = vec![0.0; 3];
            direction[i] = -1.0;
            let times_s = search.stepped(&direction, h);
            let knots = problem.solve(&times_s).unwrap();
            problem.cost(&knots, &times_s).ln()
        };
        for i in 0..3 {
            let h = 1e-4;
            let difference = (log_cost(i, h) - log_cost(i, -h)) / (2.0 * h);
            assert!(
                (difference - slope[i]).abs() < 1e-5,
                "{difference} {slope:?}"
            );
        }
    }

    #[test]
    fn descent_ends_where_snap_is_stationary_in_the_times() {
        let hermite = Hermite::new().unwrap();
        let problem = problem(&hermite);
        let guess = first_guess(&problem, &EFFORT);
        let mut search = Search::new(&problem, &EFFORT, guess);
        search.descend(200).unwrap();
        let knots = problem.solve(&search.times_s).unwrap();
        let (_, slope) = search.slope(&knots, &search.times_s);
        // The descent stops by itself at a slope of 1e-3, or where steps no longer help.
        assert!(slope.iter().all(|g| g.abs() < 0.02), "{slope:?}");
    }
}
