//! Looking round among people: somebody who left the view may come back from anywhere, and a
//! vehicle that is slower than a walker is met from the side.

use std::f64::consts::{PI, TAU};

use alula_geometry::Timestamp;
use alula_geometry::so3::wrap_angle;
use alula_messages::{Footprint, NavState, Obstacle, ObstacleMotion, Sight};
use nalgebra::Vector2;

use super::ConductConfig;

/// Directions that are told apart.
const SECTORS: usize = 36;
/// Half the view counts less this much, rad: at its border people are seen in part.
const BORDER_RAD: f64 = 0.12;
/// Faster than this the way is kept in view, m/s.
const KEEP_WAY_M_S: f64 = 0.4;
/// A direction that was looked at this long ago has been looked at, s.
const FRESH_S: f64 = 0.1;
/// Directions within this angle of the way count more, rad.
const WAY_RAD: f64 = 0.45;
const WAY_WEIGHT: f64 = 1.5;
/// A direction in which a walker is counts this much over the time in which he could be here, s.
const WALKER_WEIGHT_S: f64 = 4.0;
/// ... or this share of it if he must turn for that,
const TURN_SHARE: f64 = 0.8;
/// and the time is at least this, s.
const AT_ONCE_S: f64 = 0.3;
/// A walker comes nearer by at least this when he comes straight here: who flees slows down, m/s.
const LEAST_CLOSING_M_S: f64 = 0.2;
/// Who is further aside than one who can meet the vehicle, by this angle, was passed, rad.
const BEHIND_RAD: f64 = 0.35;
/// Distance at which a walker is here, m.
const TOUCH_M: f64 = 0.8;
/// After this time more of it makes a walker no more urgent: a near one is than a far one, s.
const LOST_S: f64 = 1.0;
/// A walker who is seen counts as if unseen for this long, so that a near one is kept in view, s.
const HOLD_S: f64 = 0.5;
/// This far within the view a walker is seen whole, rad.
const WHOLE_RAD: f64 = 0.3;
/// Who comes nearer than this, m,
const NEAR_M: f64 = 1.5;
/// within this time comes near, s.
const SOON_S: f64 = 3.0;
/// Farther away than this nobody comes near soon, m.
const FAR_M: f64 = 6.0;
/// Time beyond this counts little, s: walkers are more urgent than empty places,
const LONG_S: f64 = 2.0;
/// namely this share of it.
const LONG_SHARE: f64 = 0.1;
/// A direction that was never looked at counts as if seen this long ago, s.
const NEVER_S: f64 = 10.0;

/// When each direction was last looked at, and where to look next.
#[derive(Clone, Debug)]
pub(super) struct Glance {
    seen: [Option<Timestamp>; SECTORS],
    /// When somebody was last seen who moves.
    people: Option<Timestamp>,
    half_view_rad: f64,
    aim: Option<usize>,
}

impl Glance {
    pub fn new() -> Self {
        Self {
            seen: [None; SECTORS],
            people: None,
            half_view_rad: 0.0,
            aim: None,
        }
    }

    /// Takes an image in: the heading of its camera, half its opening angle (rad), and who is seen.
    pub fn note(
        &mut self,
        time: Timestamp,
        heading_rad: f64,
        half_view_rad: f64,
        obstacles: &[Obstacle],
    ) {
        self.half_view_rad = (half_view_rad - BORDER_RAD).max(BORDER_RAD);
        for (sector, seen) in self.seen.iter_mut().enumerate() {
            if wrap_angle(bearing(sector) - heading_rad).abs() < self.half_view_rad {
                *seen = Some(time);
            }
        }
        let moves = |o: &Obstacle| o.motion == ObstacleMotion::Moving && o.sight == Sight::Seen;
        if obstacles.iter().any(moves) {
            self.people = Some(time);
        }
    }

    /// Whether people are about.
    pub fn is_wary(&self, now: Timestamp, conduct: &ConductConfig) -> bool {
        self.people
            .is_some_and(|seen| now.seconds_since(seen) <= conduct.wary_s)
    }

    /// How urgent it is to look in a direction because nobody did for this long, s.
    fn neglect_s(&self, sector: usize, now: Timestamp) -> f64 {
        let age_s = self.seen[sector].map_or(NEVER_S, |seen| now.seconds_since(seen));
        let beyond_s = (age_s.min(NEVER_S) - LONG_S).max(0.0);
        age_s.min(LONG_S) + LONG_SHARE * beyond_s
    }

    /// Who is not where he should be seen is not found by looking there.
    fn drop_missed(&self, state: &NavState, known: &[Obstacle], urgency: &mut [f64; SECTORS]) {
        for missed in known.iter().filter(|o| o.sight == Sight::Missed) {
            let sector = sector_towards(missed, state);
            if self.neglect_s(sector, state.time) < FRESH_S {
                urgency[sector] = 0.0;
            }
        }
    }

    /// Heading in which to look now, rad; `None` to look ahead. `way_rad` is the heading of the
    /// way, `velocity` that of the vehicle, world.
    pub fn heading(
        &mut self,
        state: &NavState,
        way_rad: f64,
        known: &[Obstacle],
        conduct: &ConductConfig,
    ) -> Option<f64> {
        let now = state.time;
        let velocity = state.velocity_world.xy();
        if !self.is_wary(now, conduct) {
            self.aim = None;
            return None;
        }
        let speed_m_s = velocity.norm();
        let (course, aside) = if speed_m_s > KEEP_WAY_M_S {
            (
                velocity.y.atan2(velocity.x),
                conduct.glance_deg.to_radians(),
            )
        } else {
            (way_rad, PI)
        };
        let reach = meeting_angle(speed_m_s, conduct.walker_m_s).min(aside + self.half_view_rad);
        let mut walkers = walkers(state, way_rad, known, conduct.walker_m_s);
        self.drop_missed(state, known, &mut walkers);
        let urgency = |sector: usize| {
            let off = wrap_angle(bearing(sector) - course).abs();
            let neglect_s = self.neglect_s(sector, now);
            let ahead = if off < WAY_RAD { WAY_WEIGHT } else { 1.0 };
            let place = if off < reach { ahead * neglect_s } else { 0.0 };
            walkers[sector].max(place)
        };
        let best = (0..SECTORS).max_by(|&a, &b| urgency(a).total_cmp(&urgency(b)));
        let best = best.filter(|&best| urgency(best) > conduct.glance_s);
        let kept = self.aim.filter(|&aim| urgency(aim) > FRESH_S);
        self.aim = match (kept, best) {
            (Some(kept), Some(best)) if urgency(best) > 2.0 * urgency(kept) => Some(best),
            (Some(kept), _) => Some(kept),
            (None, best) => best,
        };
        let aim = self.aim?;
        let off = wrap_angle(bearing(aim) - course);
        let (inside, aside) = if walkers[aim] > 0.0 {
            (WHOLE_RAD, PI)
        } else {
            (0.5 * TAU / SECTORS as f64, aside)
        };
        let turn = (off.abs() - self.half_view_rad + inside).clamp(0.0, aside);
        Some(wrap_angle(course + turn.copysign(off)))
    }
}

/// Middle of a sector, rad.
fn bearing(sector: usize) -> f64 {
    (sector as f64 + 0.5) * TAU / SECTORS as f64 - PI
}

/// How urgent it is to look at walkers, by direction.
fn walkers(state: &NavState, way_rad: f64, known: &[Obstacle], walker_m_s: f64) -> [f64; SECTORS] {
    let mut urgency = [0.0_f64; SECTORS];
    let may_move =
        |o: &&Obstacle| o.footprint == Footprint::Round && o.motion != ObstacleMotion::Static;
    for walker in known.iter().filter(may_move) {
        let Some(time_s) = reach_s(walker, state, way_rad, walker_m_s) else {
            continue;
        };
        let share = if comes_near(walker, state) {
            1.0
        } else {
            TURN_SHARE
        };
        let unseen_s = unseen_s(walker, state).max(HOLD_S);
        let sector = sector_towards(walker, state);
        urgency[sector] = urgency[sector].max(share * WALKER_WEIGHT_S / time_s * unseen_s);
    }
    urgency
}

/// For how long a walker has not been seen, as far as it counts, s.
fn unseen_s(walker: &Obstacle, state: &NavState) -> f64 {
    state.time.seconds_since(walker.last_seen).min(LOST_S)
}

fn sector_towards(obstacle: &Obstacle, state: &NavState) -> usize {
    let line = (obstacle.centre_world - state.position_world()).xy();
    let bearing_rad = line.y.atan2(line.x);
    let share = (wrap_angle(bearing_rad) + PI) / TAU;
    ((share * SECTORS as f64) as usize).min(SECTORS - 1)
}

/// Whether a walker who goes on comes near a vehicle that goes on.
fn comes_near(walker: &Obstacle, state: &NavState) -> bool {
    let offset = (walker.centre_world - state.position_world()).xy();
    let approach = (walker.velocity_world - state.velocity_world).xy();
    let (_, nearest_m) = nearest_approach(&offset, &approach, SOON_S);
    offset.dot(&approach) < 0.0 && nearest_m < NEAR_M
}

/// Time in which a walker could be at a vehicle that goes on or turns to its way, whichever way he
/// turns, s; `None` if he is far or stays behind.
fn reach_s(walker: &Obstacle, state: &NavState, way_rad: f64, walker_m_s: f64) -> Option<f64> {
    let line = (walker.centre_world - state.position_world()).xy();
    let distance_m = line.norm();
    if distance_m > FAR_M {
        return None;
    }
    let velocity = state.velocity_world.xy();
    let speed_m_s = velocity.norm();
    let onto_way = Vector2::new(way_rad.cos(), way_rad.sin()) * speed_m_s;
    let aside_rad = velocity.angle(&line).min(onto_way.angle(&line));
    if aside_rad > meeting_angle(speed_m_s, walker_m_s) + BEHIND_RAD {
        return None;
    }
    let approach_m_s = speed_m_s * aside_rad.cos();
    let left_m = distance_m - TOUCH_M - walker_m_s * unseen_s(walker, state);
    let closing_m_s = (walker_m_s + approach_m_s).max(LEAST_CLOSING_M_S);
    Some((left_m / closing_m_s).max(AT_ONCE_S))
}

/// Greatest angle from the course of a vehicle at which a walker can be who will meet it, rad.
///
/// On a course to meet, both move equally far across the line between them: the sine of the angle
/// is at most the ratio of the speeds.
fn meeting_angle(speed_m_s: f64, walker_m_s: f64) -> f64 {
    if speed_m_s > walker_m_s {
        (walker_m_s / speed_m_s).asin()
    } else {
        PI
    }
}

/// When something at `offset` (m) that moves with `velocity` (m/s) comes nearest to the origin, at
/// most `horizon_s` from now, s, and how near, m.
pub(super) fn nearest_approach(
    offset: &Vector2<f64>,
    velocity: &Vector2<f64>,
    horizon_s: f64,
) -> (f64, f64) {
    let squared = velocity.norm_squared();
    let time_s = if squared > 1e-6 {
        (-offset.dot(velocity) / squared).clamp(0.0, horizon_s)
    } else {
        0.0
    };
    (time_s, (offset + velocity * time_s).norm())
}

#[cfg(test)]
#[path = "glance_tests.rs"]
mod tests;
