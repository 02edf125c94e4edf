//! Whom to keep an eye on: a camera that looks only where the vehicle flies loses those who come
//! from the side when they matter most.

use alula_geometry::so3::wrap_angle;
use alula_messages::{NavState, Obstacle, ObstacleMotion};
use nalgebra::Vector2;

/// Only what comes as near as this is watched, m.
const NEAR_M: f64 = 1.8;
/// ... within this time, s.
const SOON_S: f64 = 3.0;
/// Farther away than this it is in view anyhow, m.
const FAR_M: f64 = 4.5;
/// Greatest angle between the camera and the way while watching, rad: the way stays in view.
const ASIDE_RAD: f64 = 0.9;
/// Unseen for longer than this, nobody knows where to look, s.
const LOST_S: f64 = 1.0;

/// Heading of the camera (rad) that keeps the one in view who comes nearest soonest, as far as the
/// way (from the vehicle, m) allows; `None` when nobody comes near.
pub(super) fn heading(known: &[Obstacle], state: &NavState, way: &Vector2<f64>) -> Option<f64> {
    let bearing = |o: &Obstacle| {
        let offset = (o.centre_world - state.position_world()).xy();
        offset.y.atan2(offset.x)
    };
    let watched = known
        .iter()
        .filter(|o| o.motion == ObstacleMotion::Moving)
        .filter(|o| state.time.seconds_since(o.last_seen) < LOST_S)
        .filter_map(|o| Some((meeting(o, state)?, bearing(o))))
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    if way.norm() < 1e-3 {
        return Some(watched.1);
    }
    let ahead = way.y.atan2(way.x);
    let aside = wrap_angle(watched.1 - ahead).clamp(-ASIDE_RAD, ASIDE_RAD);
    Some(wrap_angle(ahead + aside))
}

/// Time until the vehicle and an obstacle are nearest to each other, s, if they come near soon
/// with the velocities they have.
fn meeting(obstacle: &Obstacle, state: &NavState) -> Option<f64> {
    let offset = (obstacle.centre_world - state.position_world()).xy();
    let approach = (obstacle.velocity_world - state.velocity_world).xy();
    let (time_s, nearest_m) = nearest_approach(&offset, &approach, SOON_S);
    (offset.norm() < FAR_M && nearest_m < NEAR_M).then_some(time_s)
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
mod tests {
    use super::*;
    use alula_geometry::Timestamp;
    use alula_messages::{Footprint, ObstacleCovariance, Sight};
    use nalgebra::Vector3;

    /// Someone at a place with a velocity.
    fn walker(place: [f64; 2], velocity: [f64; 2]) -> Obstacle {
        Obstacle {
            id: 1,
            time: Timestamp::ZERO,
            centre_world: Vector3::new(place[0], place[1], 0.9),
            velocity_world: Vector3::new(velocity[0], velocity[1], 0.0),
            covariance: ObstacleCovariance::zeros(),
            yaw_rad: 0.0,
            size_m: Vector3::new(0.8, 0.8, 1.8),
            size_variance_m2: Vector3::zeros(),
            footprint: Footprint::Round,
            motion: ObstacleMotion::Moving,
            sight: Sight::Seen,
            last_seen: Timestamp::ZERO,
            images: 20,
        }
    }

    /// The heading of a vehicle at the origin that flies at 1.5 m/s along x.
    fn watched(known: &[Obstacle]) -> Option<f64> {
        let state = NavState {
            velocity_world: Vector3::new(1.5, 0.0, 0.0),
            ..NavState::default()
        };
        heading(known, &state, &Vector2::new(4.0, 0.0))
    }

    #[test]
    fn someone_who_crosses_is_kept_in_view() {
        let heading = watched(&[walker([2.0, 1.5], [0.0, -1.2])]).unwrap();
        assert!((heading - 1.5_f64.atan2(2.0)).abs() < 1e-9);
    }

    #[test]
    fn the_way_stays_in_view() {
        let heading = watched(&[walker([0.2, 1.5], [0.0, -1.2])]).unwrap();
        assert_eq!(heading, ASIDE_RAD);
    }

    #[test]
    fn those_who_leave_are_not_watched() {
        assert_eq!(watched(&[walker([-2.5, 0.5], [-1.2, 0.0])]), None);
        assert_eq!(watched(&[walker([3.0, 3.0], [0.0, 1.2])]), None);
    }

    #[test]
    fn the_first_to_come_is_watched() {
        let near = walker([1.0, -1.0], [0.0, 1.2]);
        let late = walker([4.0, 1.0], [0.0, -0.3]);
        assert!(watched(&[late, near]).unwrap() < 0.0);
    }
}
