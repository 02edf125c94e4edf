//! Looking round among people: somebody who left the view may come back from anywhere, and a
//! vehicle that is slower than a walker is met from the side.

use std::f64::consts::{PI, TAU};

use alula_geometry::so3::wrap_angle;
use alula_geometry::{Timestamp, so3};
use alula_messages::{
    DepthImage, Footprint, MAX_DEPTH_CAMERAS, NavState, Obstacle, ObstacleMotion, Sight,
};
use nalgebra::{Vector2, Vector3};

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
/// which is at least this, s,
const AT_ONCE_S: f64 = 0.3;
/// and longer by this if he must turn for that, s.
const TURN_S: f64 = 1.0;
/// A walker comes nearer by at least this when he comes straight here: who flees slows down, m/s.
const LEAST_CLOSING_M_S: f64 = 0.2;
/// By no more than this a walker is further aside than where one can meet the vehicle, because he
/// is wide and may be nearer than he should, rad.
const WIDE_RAD: f64 = 0.8;
/// Who may be here already is still this far away, m: behind a vehicle that leaves him he stays so.
const LEAST_GAP_M: f64 = 0.25;
/// Distance at which a walker is here, m.
const TOUCH_M: f64 = 0.8;
/// After this time more of it makes a walker no more urgent: a near one is than a far one, s.
const LOST_S: f64 = 1.0;
/// A walker who is seen counts as if unseen for this long, so that a near one is kept in view, s.
const HOLD_S: f64 = 0.5;
/// This far within the view a walker is seen whole, rad.
const WHOLE_RAD: f64 = 0.2;
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

/// Headings that are compared.
const HEADINGS: usize = 72;
/// The chosen heading counts this many times as much, by the walkers and by the places that it
/// shows: a place must not be given up for another on the way to it.
const KEEP: [f64; 2] = [1.2, 2.0];
/// What a radian of turning is worth against what is shown, s,
const TURN_COST: f64 = 0.2;
/// and a radian away from the course, s.
const ASIDE_COST: f64 = 0.1;

/// Where a camera of the vehicle looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Eye {
    /// Its heading less that of a level vehicle, rad.
    offset_rad: f64,
    /// Half its opening angle less its border, rad.
    half_view_rad: f64,
}

impl Eye {
    /// An eye with this heading less that of the vehicle and half its opening angle, rad.
    pub fn new(offset_rad: f64, half_view_rad: f64) -> Self {
        Self {
            offset_rad,
            half_view_rad: (half_view_rad - BORDER_RAD).max(BORDER_RAD),
        }
    }

    /// The eye that took an image.
    pub fn of(image: &DepthImage) -> Self {
        let axis_body = image.body_from_camera.rotation * Vector3::z();
        let [horizontal_rad, _] = image.camera.field_of_view_rad();
        Self::new(axis_body.y.atan2(axis_body.x), 0.5 * horizontal_rad)
    }
}

/// When each direction was last looked at, and where to look next.
#[derive(Clone, Debug)]
pub(super) struct Glance {
    seen: [Option<Timestamp>; SECTORS],
    /// When somebody was last seen who moves.
    people: Option<Timestamp>,
    /// The cameras that images came from.
    eyes: [Option<Eye>; MAX_DEPTH_CAMERAS],
    /// Heading that was chosen last, rad.
    aim: Option<f64>,
}

impl Glance {
    pub fn new() -> Self {
        Self {
            seen: [None; SECTORS],
            people: None,
            eyes: [None; MAX_DEPTH_CAMERAS],
            aim: None,
        }
    }

    /// Takes an image of a camera in: where the camera looks on the vehicle, its heading (rad), and
    /// who is seen.
    pub fn note(
        &mut self,
        time: Timestamp,
        camera: usize,
        eye: Eye,
        heading_rad: f64,
        obstacles: &[Obstacle],
    ) {
        self.eyes[camera] = Some(eye);
        for (sector, seen) in self.seen.iter_mut().enumerate() {
            if wrap_angle(bearing(sector) - heading_rad).abs() < eye.half_view_rad {
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

    /// How urgent it is to look at walkers, by direction. Who is out of sight is somewhere about
    /// where he should be, and not where the vehicle has just looked in vain.
    fn walkers(
        &self,
        state: &NavState,
        way_rad: f64,
        soon: &Vector2<f64>,
        known: &[Obstacle],
        walker_m_s: f64,
    ) -> [f64; SECTORS] {
        let mut urgency = [0.0; SECTORS];
        for walker in known.iter().filter(|o| may_walk(o)) {
            let Some(time_s) = reach_s(walker, state, way_rad, soon, walker_m_s) else {
                continue;
            };
            let (middle_rad, half_rad) = whereabouts(walker, state);
            let may_be = |sector: &usize| {
                let is_near = wrap_angle(bearing(*sector) - middle_rad).abs() <= half_rad;
                let is_open = matches!(walker.sight, Sight::Seen | Sight::Hidden)
                    || self.neglect_s(*sector, state.time) >= FRESH_S;
                is_near && is_open
            };
            let count = (0..SECTORS).filter(may_be).count().max(1);
            let share = urgency_of(walker, state, time_s) / count as f64;
            for sector in (0..SECTORS).filter(may_be) {
                urgency[sector] += share;
            }
        }
        urgency
    }

    /// Heading in which to look now, rad; `None` to look ahead. `way_rad` is the heading of the
    /// way, `soon` the velocity that is planned, world, m/s.
    pub fn heading(
        &mut self,
        state: &NavState,
        way_rad: f64,
        soon: &Vector2<f64>,
        known: &[Obstacle],
        conduct: &ConductConfig,
    ) -> Option<f64> {
        if !self.is_wary(state.time, conduct) {
            self.aim = None;
            return None;
        }
        let urgency = self.urgency(state, way_rad, soon, known, conduct);
        let greatest = urgency.places.iter().chain(&urgency.walkers);
        if greatest.fold(0.0, |a: f64, b| a.max(*b)) <= conduct.glance_s {
            self.aim = None;
            return None;
        }
        let now_rad = so3::yaw_rad(&state.world_from_body.rotation);
        let ahead_rad = course(state, way_rad).0;
        let worth = |heading_rad: f64, keep: [f64; 2]| {
            let turn = wrap_angle(heading_rad - now_rad).abs();
            let aside = wrap_angle(heading_rad - ahead_rad).abs();
            let (people, place) = self.shown(&urgency, heading_rad);
            let [keep_people, keep_place] = keep;
            keep_people * people + keep_place * place - TURN_COST * turn - ASIDE_COST * aside
        };
        let mut best = self.aim.unwrap_or(ahead_rad);
        let mut most = worth(best, KEEP);
        for step in 0..HEADINGS {
            let heading_rad = TAU * step as f64 / HEADINGS as f64;
            let value = worth(heading_rad, [1.0; 2]);
            if value > most {
                (best, most) = (heading_rad, value);
            }
        }
        self.aim = Some(best);
        Some(wrap_angle(best))
    }

    /// How urgent it is to look in each direction.
    fn urgency(
        &self,
        state: &NavState,
        way_rad: f64,
        soon: &Vector2<f64>,
        known: &[Obstacle],
        conduct: &ConductConfig,
    ) -> Urgency {
        let walkers = self.walkers(state, way_rad, soon, known, conduct.walker_m_s);
        let (course_rad, aside) = course(state, way_rad);
        let speed_m_s = mean_velocity(state, soon).norm();
        let aside = aside.unwrap_or(conduct.glance_deg.to_radians());
        let reach = meeting_angle(speed_m_s, conduct.walker_m_s).min(aside + self.widest_rad());
        let places = std::array::from_fn(|sector| {
            let off = wrap_angle(bearing(sector) - course_rad).abs();
            let ahead = if off < WAY_RAD { WAY_WEIGHT } else { 1.0 };
            if off < reach {
                ahead * self.neglect_s(sector, state.time)
            } else {
                0.0
            }
        });
        Urgency { places, walkers }
    }

    /// What the cameras of a vehicle with this heading show of what is urgent: all walkers, and the
    /// most urgent place.
    fn shown(&self, urgency: &Urgency, heading_rad: f64) -> (f64, f64) {
        let mut people = 0.0;
        let mut place = 0.0_f64;
        for sector in 0..SECTORS {
            let inside_rad = self.inside_rad(bearing(sector) - heading_rad);
            if inside_rad > WHOLE_RAD {
                people += urgency.walkers[sector];
            }
            if inside_rad > 0.0 {
                place = place.max(urgency.places[sector]);
            }
        }
        (people, place)
    }

    /// How far within a view a direction is that is off the vehicle's heading by `off_rad`, rad.
    fn inside_rad(&self, off_rad: f64) -> f64 {
        let eyes = self.eyes.iter().flatten();
        eyes.map(|eye| eye.half_view_rad - wrap_angle(off_rad - eye.offset_rad).abs())
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// Half the opening angle of the widest view, rad.
    fn widest_rad(&self) -> f64 {
        let eyes = self.eyes.iter().flatten();
        eyes.map(|eye| eye.half_view_rad).fold(0.0, f64::max)
    }
}

/// How urgent it is to look in a direction, by sector.
struct Urgency {
    places: [f64; SECTORS],
    walkers: [f64; SECTORS],
}

/// Course of the vehicle, rad, and how far aside of it to look for nobody in particular; `None` for
/// the angle of a vehicle in flight.
fn course(state: &NavState, way_rad: f64) -> (f64, Option<f64>) {
    let velocity = state.velocity_world.xy();
    if velocity.norm() > KEEP_WAY_M_S {
        (velocity.y.atan2(velocity.x), None)
    } else {
        (way_rad, Some(PI))
    }
}

/// Middle of a sector, rad.
fn bearing(sector: usize) -> f64 {
    (sector as f64 + 0.5) * TAU / SECTORS as f64 - PI
}

fn may_walk(obstacle: &Obstacle) -> bool {
    obstacle.footprint == Footprint::Round && obstacle.motion != ObstacleMotion::Static
}

/// How urgent it is to look at a walker who could be here in `time_s`, s.
fn urgency_of(walker: &Obstacle, state: &NavState, time_s: f64) -> f64 {
    let lost_s = unseen_s(walker, state);
    let turn_s = if comes_near(walker, state) {
        0.0
    } else {
        (TURN_S - lost_s).max(0.0)
    };
    WALKER_WEIGHT_S / (time_s + turn_s) * lost_s.max(HOLD_S)
}

/// Direction of a walker and how far aside of it he may be, rad.
fn whereabouts(walker: &Obstacle, state: &NavState) -> (f64, f64) {
    let line = (walker.centre_world - state.position_world()).xy();
    let sector_rad = 0.5 * TAU / SECTORS as f64;
    let aside_rad = if walker.sight == Sight::Seen {
        0.0
    } else {
        let variance = walker.covariance[(0, 0)].max(walker.covariance[(1, 1)]);
        variance.max(0.0).sqrt().atan2(line.norm())
    };
    (line.y.atan2(line.x), aside_rad.max(sector_rad))
}

/// For how long a walker has not been seen, as far as it counts, s.
fn unseen_s(walker: &Obstacle, state: &NavState) -> f64 {
    state.time.seconds_since(walker.last_seen).min(LOST_S)
}

/// Whether a walker who goes on comes near a vehicle that goes on.
fn comes_near(walker: &Obstacle, state: &NavState) -> bool {
    let offset = (walker.centre_world - state.position_world()).xy();
    let approach = (walker.velocity_world - state.velocity_world).xy();
    let (_, nearest_m) = nearest_approach(&offset, &approach, SOON_S);
    offset.dot(&approach) < 0.0 && nearest_m < NEAR_M
}

/// Velocity of the vehicle on the way from now to soon, m/s.
fn mean_velocity(state: &NavState, soon: &Vector2<f64>) -> Vector2<f64> {
    (state.velocity_world.xy() + soon) / 2.0
}

/// Time in which a walker could be at a vehicle that goes on or turns to its way, whichever way he
/// turns, s; `None` if he is far or stays behind.
fn reach_s(
    walker: &Obstacle,
    state: &NavState,
    way_rad: f64,
    soon: &Vector2<f64>,
    walker_m_s: f64,
) -> Option<f64> {
    let line = (walker.centre_world - state.position_world()).xy();
    let distance_m = line.norm();
    if distance_m > FAR_M {
        return None;
    }
    let velocity = mean_velocity(state, soon);
    let speed_m_s = velocity.norm();
    let onto_way = Vector2::new(way_rad.cos(), way_rad.sin()) * speed_m_s;
    let reach_m = TOUCH_M + walker_m_s * unseen_s(walker, state);
    let wide_rad = (reach_m / distance_m.max(reach_m)).asin().min(WIDE_RAD);
    let aside_rad = velocity.angle(&line).min(onto_way.angle(&line));
    if aside_rad > meeting_angle(speed_m_s, walker_m_s) + wide_rad {
        return None;
    }
    let approach_m_s = speed_m_s * aside_rad.cos();
    let left_m = (distance_m - reach_m).max(LEAST_GAP_M);
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
