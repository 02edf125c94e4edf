//! People: ellipsoids that move as a pure function of time.

use alula_geometry::{Pose, Timestamp};
use nalgebra::{Point3, Rotation2, Translation3, UnitQuaternion, Vector2, Vector3};

use super::config::PersonConfig;
use super::tracks::Track;
use super::{WorldError, distance};

/// Where a person is and how they move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonState {
    /// Index of the person in the world, from 0; the same at all times.
    pub id: u32,
    /// Centre of the ellipsoid, world frame.
    pub centre_world: Point3<f64>,
    /// Velocity of the centre, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Semi-axes of the ellipsoid: forward, sideways, up, m.
    pub semi_axes_m: Vector3<f64>,
    /// Heading, counter-clockwise from east, rad.
    pub yaw_rad: f64,
}

impl PersonState {
    /// Pose of the ellipsoid: x forward, z up.
    pub fn world_from_person(&self) -> Pose {
        Pose::from_parts(
            Translation3::from(self.centre_world),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw_rad),
        )
    }

    /// Signed distance from a point to the ellipsoid, m, negative inside.
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        let local = self.world_from_person().inverse_transform_point(point);
        distance::ellipsoid(&local, &self.semi_axes_m)
    }
}

/// A person of a world.
#[derive(Clone, Debug)]
pub(super) struct Person {
    pub name: String,
    pub semi_axes_m: Vector3<f64>,
    pub motion: Motion,
}

/// Time between two places at which a walk is looked at to keep clear of it, s: a step of 0.12 m
/// for somebody who walks at 1.2 m/s, between which a straight line strays from no place to be kept
/// clear by more than 0.06^2 / (2 * 0.4) = 4.5 mm.
const LOOK_S: f64 = 0.1;

/// The times at which the first `duration_s` of a walk are looked at.
pub(super) fn times(duration_s: f64) -> impl Iterator<Item = Timestamp> {
    let count = (duration_s / LOOK_S).ceil() as u32;
    (0..=count).map(|i| Timestamp::from_s(LOOK_S * f64::from(i)))
}

/// How a person moves.
#[derive(Clone, Debug)]
pub(super) enum Motion {
    Loop(Loop),
    Track(Track),
}

/// Place, velocity and heading on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    pub place: Vector2<f64>,
    pub velocity: Vector2<f64>,
    pub yaw_rad: f64,
}

/// Time by which the presence of a person is taken longer, s: more than times err when rounded.
const PRESENCE_MARGIN_S: f64 = 1e-3;

impl Person {
    /// Times of the simulation, s, before and after which the person is not in the world.
    pub fn presence_s(&self) -> (f64, f64) {
        let (first, last) = match &self.motion {
            Motion::Loop(_) => (f64::NEG_INFINITY, f64::INFINITY),
            Motion::Track(track) => track.presence_s(),
        };
        (first - PRESENCE_MARGIN_S, last + PRESENCE_MARGIN_S)
    }

    /// Where the person is; `None` when they are not in the world.
    pub fn state(&self, id: u32, ground_m: f64, time: Timestamp) -> Option<PersonState> {
        let step = match &self.motion {
            Motion::Loop(path) => path.at(time.as_s()),
            Motion::Track(track) => track.at(time.as_s())?,
        };
        Some(PersonState {
            id,
            centre_world: Point3::new(step.place.x, step.place.y, ground_m + self.semi_axes_m.z),
            velocity_world: Vector3::new(step.velocity.x, step.velocity.y, 0.0),
            semi_axes_m: self.semi_axes_m,
            yaw_rad: step.yaw_rad,
        })
    }
}

/// A closed line through waypoints, walked at constant speed.
#[derive(Clone, Debug)]
pub(super) struct Loop {
    /// Corners with the length of the line up to each, edges of no length left out.
    corners: Vec<(f64, Vector2<f64>)>,
    length_m: f64,
    speed_m_s: f64,
    start_s: f64,
}

impl Loop {
    /// The loop of a valid config.
    pub fn new(config: &PersonConfig, key: &str) -> Result<Self, WorldError> {
        let line = rounded(&config.waypoints_m, config.turn_radius_m);
        let Some(&first) = line.first() else {
            return Err(WorldError::degenerate(
                key,
                "`waypoints_m` is empty",
                "give at least one waypoint",
            ));
        };
        let mut corners = vec![(0.0, first)];
        let mut length_m = 0.0;
        let mut here = first;
        for &next in line[1..].iter().chain([&first]) {
            length_m += (next - here).norm();
            if next != here {
                corners.push((length_m, next));
            }
            here = next;
        }
        if line.len() > 1 && length_m == 0.0 && config.speed_m_s > 0.0 {
            return Err(WorldError::degenerate(
                key,
                "all waypoints are the same place",
                "move one of them, or give one waypoint to let the person stand",
            ));
        }
        Ok(Self {
            corners,
            length_m,
            speed_m_s: config.speed_m_s,
            start_s: config.start_s,
        })
    }

    fn at(&self, time_s: f64) -> Step {
        if self.length_m == 0.0 {
            return Step {
                place: self.corners[0].1,
                velocity: Vector2::zeros(),
                yaw_rad: 0.0,
            };
        }
        let walked = (self.speed_m_s * (time_s + self.start_s)).rem_euclid(self.length_m);
        let next = self
            .corners
            .partition_point(|(length, _)| *length <= walked);
        let next = next.clamp(1, self.corners.len() - 1);
        let ((from_m, from), (_, to)) = (self.corners[next - 1], self.corners[next]);
        let direction = (to - from).normalize();
        Step {
            place: from + direction * (walked - from_m),
            velocity: direction * self.speed_m_s,
            yaw_rad: direction.y.atan2(direction.x),
        }
    }
}

/// Straight pieces in which a turn is walked.
const TURN_PIECES: u32 = 8;

/// A closed line through waypoints whose corners are arcs of this radius, m, or of the greatest that
/// leaves half of both edges. Turns back on the spot stay.
fn rounded(waypoints: &[[f64; 2]], radius_m: f64) -> Vec<Vector2<f64>> {
    let corners: Vec<Vector2<f64>> = waypoints.iter().map(|p| Vector2::from(*p)).collect();
    let count = corners.len();
    let mut line = Vec::new();
    for (i, corner) in corners.iter().enumerate() {
        let before = corner - corners[(i + count - 1) % count];
        let after = corners[(i + 1) % count] - corner;
        let turn = before.perp(&after).atan2(before.dot(&after));
        let tangent = (0.5 * turn.abs()).tan();
        if radius_m <= 0.0 || !(1e-6..=1e3).contains(&tangent) {
            line.push(*corner);
            continue;
        }
        let cut_m = (radius_m * tangent).min(0.5 * before.norm().min(after.norm()));
        let begin = corner - before.normalize() * cut_m;
        let left = Vector2::new(-before.y, before.x).normalize();
        let centre = begin + left * (cut_m / tangent * turn.signum());
        for piece in 0..=TURN_PIECES {
            let part = f64::from(piece) / f64::from(TURN_PIECES);
            line.push(centre + Rotation2::new(turn * part) * (begin - centre));
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_walked_as_arcs() {
        let config = PersonConfig {
            turn_radius_m: 0.5,
            ..square_config(1.0, 0.0)
        };
        let path = Loop::new(&config, "").unwrap();
        let centre = Vector2::new(3.5, 0.5);
        for i in 0..=60 {
            let t = 3.0 + f64::from(i) * 0.01;
            let place = path.at(t).place;
            if place.x > 3.5 && place.y < 0.5 {
                let reach = (place - centre).norm();
                // A chord of an eighth of a quarter turn is 2.4 mm inside its arc.
                assert!((0.4975..=0.5 + 1e-9).contains(&reach), "{reach} at {t}");
            }
        }
        // Four quarter arcs in place of the corners, each of eight chords.
        let arcs_m = 32.0 * 2.0 * 0.5 * (std::f64::consts::PI / 32.0).sin();
        assert!((path.length_m - (12.0 - 8.0 * 0.5 + arcs_m)).abs() < 1e-9);
    }

    #[test]
    fn a_turn_leaves_half_of_a_short_edge() {
        let config = PersonConfig {
            turn_radius_m: 5.0,
            ..square_config(1.0, 0.0)
        };
        let path = Loop::new(&config, "").unwrap();
        for i in 0..120 {
            let place = path.at(0.1 * f64::from(i)).place;
            // The arcs reach the edges, to rounding.
            let within = |x: f64, end: f64| (-1e-9..=end + 1e-9).contains(&x);
            assert!(within(place.x, 4.0) && within(place.y, 2.0), "{place}");
        }
    }

    #[test]
    fn who_turns_back_does_so_on_the_spot() {
        let config = PersonConfig {
            waypoints_m: vec![[0.0, 0.0], [4.0, 0.0]],
            speed_m_s: 1.0,
            turn_radius_m: 0.5,
            ..PersonConfig::default()
        };
        let path = Loop::new(&config, "").unwrap();
        assert!((path.at(4.0).place - Vector2::new(4.0, 0.0)).norm() < 1e-12);
    }

    fn square_config(speed_m_s: f64, start_s: f64) -> PersonConfig {
        PersonConfig {
            waypoints_m: vec![[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]],
            speed_m_s,
            start_s,
            ..PersonConfig::default()
        }
    }

    fn square(speed_m_s: f64, start_s: f64) -> Loop {
        Loop::new(&square_config(speed_m_s, start_s), "world.people[0]").unwrap()
    }

    #[test]
    fn the_loop_includes_the_edge_back_to_the_first_waypoint() {
        let path = square(1.0, 0.0);
        assert!((path.at(11.0).place - Vector2::new(0.0, 1.0)).norm() < 1e-12);
        assert!((path.at(11.0).velocity - Vector2::new(0.0, -1.0)).norm() < 1e-12);
        assert!((path.at(5.0).place - Vector2::new(4.0, 1.0)).norm() < 1e-12);
    }

    #[test]
    fn rounds_repeat_and_the_start_shifts_them() {
        for i in 0..200 {
            let t = 0.1 * f64::from(i);
            let (one, other) = (square(1.5, 2.0).at(t), square(1.5, 0.0).at(t + 2.0 + 8.0));
            assert!((one.place - other.place).norm() < 1e-9);
        }
    }

    #[test]
    fn the_velocity_is_the_derivative_of_the_place() {
        let (path, h) = (square(1.3, 0.05), 1e-6);
        for i in 0..90 {
            let t = 0.1 * f64::from(i);
            let (a, b) = (path.at(t - h), path.at(t + h));
            if a.yaw_rad == b.yaw_rad {
                assert!(((b.place - a.place) / (2.0 * h) - path.at(t).velocity).norm() < 1e-6);
            }
        }
    }

    #[test]
    fn one_waypoint_is_a_person_who_stands() {
        let config = PersonConfig {
            waypoints_m: vec![[3.0, 1.0]],
            ..PersonConfig::default()
        };
        let step = Loop::new(&config, "").unwrap().at(17.0);
        assert_eq!(
            (step.place, step.velocity),
            (Vector2::new(3.0, 1.0), Vector2::zeros())
        );
    }

    #[test]
    fn loops_without_length_are_refused() {
        let config = PersonConfig {
            waypoints_m: vec![[3.0, 1.0]; 3],
            ..PersonConfig::default()
        };
        let message = Loop::new(&config, "world.people[4]")
            .unwrap_err()
            .to_string();
        assert!(message.contains("world.people[4]") && message.contains("same place"));
    }
}
