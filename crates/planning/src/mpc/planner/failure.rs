//! What is flown when there is no new plan.

use alula_geometry::so3::{wrap_angle, yaw_rad};
use alula_geometry::{TimeDelta, Timestamp};
use alula_messages::{PLAN_INTERVALS, Plan, PlanExit, PlanPoint};

use super::super::follow::{braking_reference_at, reference_at};
use super::super::request::PlanRequest;
use super::PredictivePlanner;

impl PredictivePlanner {
    /// The last plan, braking; one that brakes already goes on.
    pub(super) fn fail(&mut self, request: &PlanRequest<'_>) -> &Plan {
        let now = request.now;
        let last = self.plan;
        let begun = self.planned || last.exit == PlanExit::Failed;
        let mut plan = Plan {
            time: now,
            target_world: last.target_world,
            exit: PlanExit::Failed,
            iterations: 0,
            ..last
        };
        let mut yaw = last.points[0].yaw_rad;
        for (k, point) in plan.points.iter_mut().enumerate() {
            let at = now + TimeDelta::from_s(k as f64 * last.interval_s);
            *point = if begun {
                braking_point(&last, now, at, &mut yaw)
            } else {
                standing_point(request)
            };
        }
        self.plan = plan;
        self.planned = false;
        self.detour = None;
        &self.plan
    }
}

/// The last plan at a time, braking from `now` on unless it brakes already.
fn braking_point(last: &Plan, now: Timestamp, at: Timestamp, yaw: &mut f64) -> PlanPoint {
    let reference = if last.exit == PlanExit::Failed {
        reference_at(last, at)
    } else {
        braking_reference_at(last, now, at)
    };
    *yaw += wrap_angle(reference.yaw_rad - *yaw);
    PlanPoint {
        position_world: reference.position_world,
        velocity_world: reference.velocity_world,
        acceleration_world: reference.acceleration_world,
        yaw_rad: *yaw,
        yaw_rate_rad_s: reference.yaw_rate_rad_s,
        position_covariance: last.points[PLAN_INTERVALS].position_covariance,
    }
}

/// Standing at the state, or at the origin if it is not finite.
fn standing_point(request: &PlanRequest<'_>) -> PlanPoint {
    if !request.state.is_finite() {
        return PlanPoint::default();
    }
    PlanPoint {
        position_world: request.state.position_world(),
        yaw_rad: yaw_rad(&request.state.world_from_body.rotation),
        ..PlanPoint::default()
    }
}
