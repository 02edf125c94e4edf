//! How fast to fly: no faster than the vehicle can stop before space that was never seen, and than
//! its flow camera can follow the ground.

use alula_messages::PLAN_POINTS;
use nalgebra::Vector3;

use super::ConductConfig;

/// Distance between the places that are looked at along the way, m.
const STEP_M: f64 = 0.15;

/// Greatest speed at each point of a plan, m/s, when its way follows `points` (world, m) and goes
/// on in the same direction; `is_free` says what has been seen to be free.
///
/// v^2 = 2 a d with the deceleration a and the distance d left to unseen space; v = w h with the
/// greatest flow w and the height h above the floor.
pub(super) fn speed_limits(
    points: &[Vector3<f64>],
    conduct: &ConductConfig,
    is_free: impl Fn(&Vector3<f64>) -> bool,
) -> [f64; PLAN_POINTS] {
    let stop_m = 0.5 * conduct.max_speed_m_s.powi(2) / conduct.braking_m_s2;
    let free_m = free_length(points, stop_m + conduct.unseen_margin_m, is_free);
    let mut limits = [conduct.max_speed_m_s; PLAN_POINTS];
    let mut flown_m = 0.0;
    for (k, limit) in limits.iter_mut().enumerate() {
        if k > 0 && k < points.len() {
            flown_m += (points[k] - points[k - 1]).xy().norm();
        }
        let left_m = (free_m - flown_m - conduct.unseen_margin_m).max(0.0);
        let by_braking = (2.0 * conduct.braking_m_s2 * left_m).sqrt();
        let height_m =
            points.get(k).or(points.last()).map_or(0.0, |p| p.z) - conduct.floor_height_m;
        let by_flow = conduct.max_flow_rad_s * height_m;
        let low = conduct.creep_speed_m_s.min(conduct.max_speed_m_s);
        *limit = by_braking.min(by_flow).clamp(low, conduct.max_speed_m_s);
    }
    limits
}

/// Length of the way that is known to be free, m, looked at for `beyond_m` past its last point.
fn free_length(
    points: &[Vector3<f64>],
    beyond_m: f64,
    is_free: impl Fn(&Vector3<f64>) -> bool,
) -> f64 {
    let mut length_m = 0.0;
    for pair in points.windows(2) {
        let (free_m, whole_m) = free_part(pair[0], pair[1], &is_free);
        length_m += free_m;
        if free_m < whole_m {
            return length_m;
        }
    }
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return 0.0;
    };
    let Some(ahead) = (last - first).try_normalize(1e-6) else {
        return length_m;
    };
    length_m + free_part(*last, last + ahead * beyond_m, &is_free).0
}

/// Length of the free part of a line from its start on, and its whole length, m.
fn free_part(
    from: Vector3<f64>,
    to: Vector3<f64>,
    is_free: &impl Fn(&Vector3<f64>) -> bool,
) -> (f64, f64) {
    let whole_m = (to - from).xy().norm();
    let steps = (whole_m / STEP_M).ceil().max(1.0) as usize;
    let free = (1..=steps)
        .take_while(|i| is_free(&from.lerp(&to, *i as f64 / steps as f64)))
        .count();
    (whole_m * free as f64 / steps as f64, whole_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn conduct() -> ConductConfig {
        ConductConfig {
            max_speed_m_s: 2.0,
            braking_m_s2: 1.0,
            creep_speed_m_s: 0.3,
            unseen_margin_m: 0.5,
            max_flow_rad_s: 10.0,
            ..ConductConfig::default()
        }
    }

    /// Limits on a straight way of 2 m along x, with free space up to `wall_m`.
    fn limits(wall_m: f64) -> [f64; PLAN_POINTS] {
        let points: Vec<_> = (0..PLAN_POINTS)
            .map(|k| Vector3::new(2.0 * k as f64 / 25.0, 0.0, 1.0))
            .collect();
        speed_limits(&points, &conduct(), |p| p.x < wall_m)
    }

    #[test]
    fn space_that_is_free_for_long_allows_the_greatest_speed() {
        assert_eq!(limits(10.0), [2.0; PLAN_POINTS]);
    }

    #[test]
    fn the_limit_is_the_speed_from_which_the_vehicle_can_stop() {
        let limits = limits(1.51);
        // The grid of places looked at is 0.15 m wide at most.
        assert!((limits[0] - 2f64.sqrt()).abs() < 0.15, "{}", limits[0]);
        assert!(limits.windows(2).all(|pair| pair[1] <= pair[0]));
        assert_eq!(limits[25], 0.3);
    }

    #[test]
    fn near_the_ground_the_flow_limits_the_speed() {
        let conduct = ConductConfig {
            max_flow_rad_s: 1.5,
            ..conduct()
        };
        let points = [Vector3::new(0.0, 0.0, 0.8), Vector3::new(1.0, 0.0, 1.0)];
        let limits = speed_limits(&points, &conduct, |_| true);
        assert!((limits[0] - 1.2).abs() < 1e-12);
        assert!((limits[25] - 1.5).abs() < 1e-12);
    }

    #[test]
    fn unseen_space_close_ahead_is_entered_at_a_creep() {
        assert_eq!(limits(0.3)[0], 0.3);
    }
}
