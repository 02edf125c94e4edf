//! From a track to what the planner had better take it for: what an image cuts off is not known.

use alula_geometry::Timestamp;
use alula_messages::{Footprint, Obstacle, ObstacleMotion};

use super::ConductConfig;

/// How far above the vehicle something that reaches its height is taken to go on, m.
const UPWARDS_M: f64 = 3.0;

/// The obstacle at time `now` as the planner takes it, for a vehicle at `height_m` (world) with
/// `radius_m`: upright from the floor on where it reaches the vehicle, and not slimmer than a
/// person where it moves.
pub(super) fn taken(
    track: &Obstacle,
    now: Timestamp,
    height_m: f64,
    radius_m: f64,
    conduct: &ConductConfig,
) -> Obstacle {
    let mut taken = *track;
    let age_s = now.seconds_since(track.time).clamp(0.0, 1.0);
    taken.centre_world = track.centre_after(age_s);
    let position = track.centre_covariance_after(age_s);
    taken
        .covariance
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&position);
    taken.time = now;
    stand_upright(&mut taken, height_m, radius_m, conduct);
    if taken.footprint == Footprint::Round && track.motion != ObstacleMotion::Static {
        for axis in 0..2 {
            taken.size_m[axis] = taken.size_m[axis].max(conduct.least_width_m);
        }
    }
    taken
}

fn stand_upright(taken: &mut Obstacle, height_m: f64, radius_m: f64, conduct: &ConductConfig) {
    let (centre, half) = (taken.centre_world.z, 0.5 * taken.size_m.z);
    let lower = height_m - radius_m - conduct.pass_over_m;
    let upper = height_m + radius_m + conduct.pass_over_m;
    if centre + half < lower || centre - half > upper {
        return;
    }
    let bottom = conduct.floor_height_m.min(centre - half);
    let top = (height_m + UPWARDS_M).max(centre + half);
    taken.centre_world.z = 0.5 * (bottom + top);
    taken.size_m.z = top - bottom;
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_messages::{ObstacleCovariance, Sight};
    use nalgebra::Vector3;

    fn track(motion: ObstacleMotion, z: f64, size: [f64; 3]) -> Obstacle {
        Obstacle {
            id: 1,
            time: Timestamp::ZERO,
            centre_world: Vector3::new(2.0, 0.0, z),
            velocity_world: Vector3::new(1.0, 0.0, 0.0),
            covariance: ObstacleCovariance::identity() * 0.01,
            yaw_rad: 0.0,
            size_m: Vector3::from(size),
            size_variance_m2: Vector3::zeros(),
            footprint: Footprint::Round,
            motion,
            sight: Sight::Seen,
            last_seen: Timestamp::ZERO,
            images: 9,
        }
    }

    fn taken_at(track: &Obstacle, height_m: f64) -> Obstacle {
        let now = Timestamp::from_s(0.1);
        taken(track, now, height_m, 0.4, &ConductConfig::default())
    }

    #[test]
    fn what_reaches_the_vehicle_goes_on_up_and_down() {
        let found = taken_at(&track(ObstacleMotion::Static, 1.0, [0.5, 0.5, 0.6]), 1.2);
        let (bottom, top) = (
            found.centre_world.z - 0.5 * found.size_m.z,
            found.centre_world.z + 0.5 * found.size_m.z,
        );
        assert!(bottom.abs() < 1e-9 && top > 4.0);
    }

    #[test]
    fn what_is_far_below_stays_low() {
        let low = track(ObstacleMotion::Static, 0.2, [0.5, 0.5, 0.4]);
        assert_eq!(taken_at(&low, 2.0).size_m.z, 0.4);
    }

    #[test]
    fn the_arm_of_a_walker_is_taken_for_a_walker() {
        let found = taken_at(&track(ObstacleMotion::Moving, 1.0, [0.1, 0.2, 1.0]), 1.2);
        assert!(found.size_m.x >= 0.6 && found.size_m.y >= 0.6);
        assert_eq!(
            taken_at(&track(ObstacleMotion::Static, 1.0, [0.1, 0.2, 1.0]), 1.2)
                .size_m
                .x,
            0.1
        );
    }

    #[test]
    fn what_moves_has_moved_on_since_it_was_seen() {
        let walker = track(ObstacleMotion::Moving, 1.0, [0.5, 0.5, 1.7]);
        let found = taken_at(&walker, 1.2);
        assert!((found.centre_world.x - 2.1).abs() < 1e-12);
        // 0.01 m^2 + 0.01 m^2/s^2 (0.1 s)^2.
        assert!((found.covariance[(0, 0)] - 0.0101).abs() < 1e-12);
    }
}
