//! From a plan to the reference of a controller.

use alula_geometry::Timestamp;
use alula_geometry::so3::wrap_angle;
use alula_messages::{PLAN_INTERVALS, Plan, PlanPoint, Reference};
use nalgebra::Vector3;

/// Greatest deceleration along the path while braking, m/s^2.
const BRAKING_M_S2: f64 = 1.5;
/// Braking takes at least this long, s.
const LEAST_BRAKING_S: f64 = 0.3;

/// Where the vehicle should be at `now`: on the plan, and after its last point braking to rest
/// straight on.
pub fn reference_at(plan: &Plan, now: Timestamp) -> Reference {
    let end_s = PLAN_INTERVALS as f64 * plan.interval_s;
    braking_after_s(plan, end_s, now.seconds_since(plan.time))
}

/// Where the vehicle should be at `now` if it brakes to rest along the plan from `brake_at` on: a
/// stale plan is followed with time that slows down, so that the path stays the planned one.
pub fn braking_reference_at(plan: &Plan, brake_at: Timestamp, now: Timestamp) -> Reference {
    let end_s = PLAN_INTERVALS as f64 * plan.interval_s;
    let brake_s = brake_at.seconds_since(plan.time).clamp(0.0, end_s);
    braking_after_s(plan, brake_s, now.seconds_since(plan.time))
}

/// Braking from `brake_s` on; both times count from the plan's first point.
///
/// The plan's time `s(t)` runs with `s' = 1 - (3 q^2 - 2 q^3)`, `q = (t - brake_s) / duration`, so
/// that velocity is `s' v(s)` and acceleration `s'^2 a(s) + s'' v(s)`, and ends half a duration
/// further on.
fn braking_after_s(plan: &Plan, brake_s: f64, elapsed_s: f64) -> Reference {
    if elapsed_s <= brake_s {
        return on_plan(plan, elapsed_s.max(0.0));
    }
    let speed = on_plan(plan, brake_s).velocity_world.norm();
    let duration_s = (1.5 * speed / BRAKING_M_S2).max(LEAST_BRAKING_S);
    let q = ((elapsed_s - brake_s) / duration_s).min(1.0);
    let pace = 1.0 - q * q * (3.0 - 2.0 * q);
    let pace_rate_1_s = -6.0 * q * (1.0 - q) / duration_s;
    let pace_rate_rate_1_s2 = if q < 1.0 {
        -6.0 * (1.0 - 2.0 * q) / (duration_s * duration_s)
    } else {
        0.0
    };
    let s = brake_s + duration_s * (q - q * q * q + 0.5 * q * q * q * q);
    let at = on_plan(plan, s);
    Reference {
        velocity_world: at.velocity_world * pace,
        acceleration_world: at.acceleration_world * (pace * pace)
            + at.velocity_world * pace_rate_1_s,
        jerk_world: at.jerk_world * pace.powi(3)
            + at.acceleration_world * (3.0 * pace * pace_rate_1_s)
            + at.velocity_world * pace_rate_rate_1_s2,
        yaw_rate_rad_s: at.yaw_rate_rad_s * pace,
        yaw_acceleration_rad_s2: at.yaw_rate_rad_s * pace_rate_1_s,
        ..at
    }
}

/// The plan at `s` seconds from its first point; straight on after its last.
///
/// Between points position is the polynomial of degree five through positions, velocities and
/// accelerations. Jerk is the mean one of the interval; snap, in which the plan jumps, is zero.
fn on_plan(plan: &Plan, s: f64) -> Reference {
    let h = plan.interval_s;
    let place = s / h;
    let k = place.floor();
    if !(k >= 0.0 && k < PLAN_INTERVALS as f64) {
        return straight_on(&plan.points[PLAN_INTERVALS], s - PLAN_INTERVALS as f64 * h);
    }
    let (from, to) = (&plan.points[k as usize], &plan.points[k as usize + 1]);
    let u = place - k;
    let [position_world, velocity_world, acceleration_world] = quintic(from, to, h, u);
    let turn = to.yaw_rad - from.yaw_rad;
    Reference {
        position_world,
        velocity_world,
        acceleration_world,
        jerk_world: (to.acceleration_world - from.acceleration_world) / h,
        snap_world: Vector3::zeros(),
        yaw_rad: wrap_angle(from.yaw_rad + turn * u),
        yaw_rate_rad_s: turn / h,
        yaw_acceleration_rad_s2: 0.0,
    }
}

fn straight_on(last: &PlanPoint, beyond_s: f64) -> Reference {
    Reference {
        position_world: last.position_world + last.velocity_world * beyond_s,
        velocity_world: last.velocity_world,
        yaw_rad: wrap_angle(last.yaw_rad),
        ..Reference::default()
    }
}

/// Position, velocity and acceleration at the share `u` of an interval of `h` seconds.
fn quintic(from: &PlanPoint, to: &PlanPoint, h: f64, u: f64) -> [Vector3<f64>; 3] {
    let p0 = from.position_world;
    let v0 = from.velocity_world * h;
    let a0 = from.acceleration_world * (0.5 * h * h);
    let v1 = to.velocity_world * h;
    let a1 = to.acceleration_world * (h * h);
    let gap = to.position_world - p0 - v0 - a0;
    let gap_v = v1 - v0 - a0 * 2.0;
    let gap_a = a1 - a0 * 2.0;
    let c3 = gap * 10.0 - gap_v * 4.0 + gap_a * 0.5;
    let c4 = gap * -15.0 + gap_v * 7.0 - gap_a;
    let c5 = gap * 6.0 - gap_v * 3.0 + gap_a * 0.5;
    let position = p0 + (v0 + (a0 + (c3 + (c4 + c5 * u) * u) * u) * u) * u;
    let velocity = v0 + (a0 * 2.0 + (c3 * 3.0 + (c4 * 4.0 + c5 * (5.0 * u)) * u) * u) * u;
    let acceleration = a0 * 2.0 + (c3 * 6.0 + (c4 * 12.0 + c5 * (20.0 * u)) * u) * u;
    [position, velocity / h, acceleration / (h * h)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::TimeDelta;
    use alula_messages::PLAN_POINTS;

    /// Constant jerk along a slanted line with a steady turn.
    fn plan() -> Plan {
        let direction = Vector3::new(0.6, -0.8, 0.1);
        let points: [PlanPoint; PLAN_POINTS] = std::array::from_fn(|k| {
            let t = k as f64 * 0.06;
            PlanPoint {
                position_world: direction * (t + 0.3 * t * t + 0.1 * t * t * t),
                velocity_world: direction * (1.0 + 0.6 * t + 0.3 * t * t),
                acceleration_world: direction * (0.6 + 0.6 * t),
                yaw_rad: 3.0 + 0.5 * t,
                yaw_rate_rad_s: 0.5,
                ..PlanPoint::default()
            }
        });
        Plan {
            time: Timestamp::from_s(10.0),
            points,
            ..Plan::default()
        }
    }

    fn at(plan: &Plan, s: f64) -> Reference {
        reference_at(plan, plan.time + TimeDelta::from_s(s))
    }

    /// Differences of the reference around a time against its own derivatives.
    fn assert_consistent(reference: impl Fn(f64) -> Reference, t: f64) {
        let h = 1e-4;
        let (before, now, after) = (reference(t - h), reference(t), reference(t + h));
        let velocity = (after.position_world - before.position_world) / (2.0 * h);
        let acceleration = (after.velocity_world - before.velocity_world) / (2.0 * h);
        let jerk = (after.acceleration_world - before.acceleration_world) / (2.0 * h);
        // Second-order differences of motions whose derivatives stay below 100.
        assert!((velocity - now.velocity_world).norm() < 1e-5, "{t}");
        assert!((acceleration - now.acceleration_world).norm() < 1e-5, "{t}");
        assert!((jerk - now.jerk_world).norm() < 1e-3, "{t}");
        let turned = wrap_angle(after.yaw_rad - before.yaw_rad) / (2.0 * h);
        assert!((turned - now.yaw_rate_rad_s).abs() < 1e-5, "{t}");
    }

    #[test]
    fn a_cubic_is_followed_exactly_between_points() {
        let (plan, t) = (plan(), 0.4321);
        let expected = Vector3::new(0.6, -0.8, 0.1) * (t + 0.3 * t * t + 0.1 * t * t * t);
        assert!((at(&plan, t).position_world - expected).norm() < 1e-12);
    }

    #[test]
    fn derivatives_belong_together_on_the_plan_and_while_braking() {
        let plan = plan();
        for t in [0.05, 0.33, 1.0, 1.45, 1.6, 2.0, 2.7] {
            assert_consistent(|s| at(&plan, s), t);
        }
        let from = plan.time + TimeDelta::from_s(0.5);
        for t in [0.4, 0.55, 0.7, 0.95, 1.3] {
            assert_consistent(
                |s| braking_reference_at(&plan, from, plan.time + TimeDelta::from_s(s)),
                t,
            );
        }
    }

    #[test]
    fn braking_ends_at_rest_on_the_path() {
        let plan = plan();
        let from = plan.time + TimeDelta::from_s(0.3);
        let speed = at(&plan, 0.3).velocity_world.norm();
        let duration = 1.5 * speed / BRAKING_M_S2;
        let stop = braking_reference_at(&plan, from, plan.time + TimeDelta::from_s(30.0));
        assert_eq!(stop.velocity_world.norm(), 0.0);
        assert_eq!(stop.acceleration_world.norm(), 0.0);
        let on_path = at(&plan, 0.3 + 0.5 * duration).position_world;
        assert!((stop.position_world - on_path).norm() < 1e-9);
    }

    #[test]
    fn the_time_before_the_plan_is_its_first_point() {
        let plan = plan();
        assert_eq!(
            at(&plan, -1.0).position_world,
            plan.points[0].position_world
        );
    }

    #[test]
    fn yaw_stays_within_half_a_turn() {
        let yaw = at(&plan(), 1.2).yaw_rad;
        assert!((yaw - (3.6 - std::f64::consts::TAU)).abs() < 1e-9);
    }
}
