//! Other guesses and ways round: what helps where the program alone would stand still.

use std::f64::consts::TAU;

use alula_messages::{ObstacleMotion, PLAN_INTERVALS};
use alula_optim::ocp::{OcpExit, weigh};
use nalgebra::Vector3;

use super::super::detour::{self, Detour};
use super::super::dynamics::State;
use super::super::guess::Path;
use super::super::keepout::Keepout;
use super::super::request::PlanRequest;
use super::{PredictivePlanner, Solution, position};

/// Another solution replaces the first when its cost is lower by this share.
const BETTER: f64 = 0.15;
/// Directions of the straight flights that are tried,
const DIRECTIONS: usize = 8;
/// how far away they aim, m,
const AIM_M: f64 = 4.0;
/// and their least speed, m/s.
const EVASION_M_S: f64 = 1.5;
/// A solution that lacks more clearance than this is tried again from another guess, m.
const BLOCKED_M: f64 = 0.02;
/// A plan comes to a halt when it ends further from the goal than this, m,
const FAR_M: f64 = 1.0;
/// while its last speed towards the target is below this share of the limit.
const SLOW_SHARE: f64 = 0.7;
/// A plan on a way round that ends nearer to its start than this makes no progress, m.
const STANDING_M: f64 = 0.5;
/// A point to pass is aimed at from at least this far, m.
const VIA_LEAD_M: f64 = 2.0;

impl PredictivePlanner {
    /// Solves again from the cheapest of a fan of simple flights if the solution comes too near to
    /// an obstacle or to a halt, and keeps the better solution.
    pub(super) fn try_other_guess(
        &mut self,
        request: &PlanRequest<'_>,
        start: &State,
        target: &Vector3<f64>,
        first: Solution,
    ) -> Solution {
        let last = &first.path.states[PLAN_INTERVALS];
        let halts = is_halting(request, target, last);
        if first.violation_m <= BLOCKED_M && !halts {
            return first;
        }
        self.path = self.cheapest_flight(request, start, target, &first.path);
        self.solver.forget();
        let second = self.solve(start);
        let better = second.report.exit != OcpExit::NotFinite
            && second.report.cost < first.report.cost * (1.0 - BETTER);
        if better || first.report.exit == OcpExit::NotFinite {
            return second;
        }
        self.solver.forget();
        first
    }

    /// The cheapest of some simple flights: past the obstacle nearest to the path of a solution on
    /// either side, to a halt, and straight in directions all round.
    fn cheapest_flight(
        &self,
        request: &PlanRequest<'_>,
        start: &State,
        target: &Vector3<f64>,
        path: &Path,
    ) -> Path {
        let from = position(start);
        let limit_m_s = request.max_speed_m_s[0].max(0.0);
        let cost = |path: &Path| weigh(&self.problem, &path.states, &path.inputs).0;
        let mut best = self.flight(start, target, None, 0.0);
        let mut least = cost(&best);
        let mut consider = |path: Path| {
            let cost = cost(&path);
            if cost < least {
                (best, least) = (path, cost);
            }
        };
        if let Some(nearest) = self.nearest(path) {
            for side in [1.0, -1.0] {
                let past = detour::via(nearest, side, &from, target);
                consider(self.flight(start, target, past.as_ref(), limit_m_s));
            }
        }
        for step in 0..DIRECTIONS {
            let (sin, cos) = (TAU * step as f64 / DIRECTIONS as f64).sin_cos();
            let aim = Vector3::new(from.x + AIM_M * cos, from.y + AIM_M * sin, target.z);
            consider(self.flight(start, &aim, None, limit_m_s.max(EVASION_M_S)));
        }
        best
    }

    /// The volume with the least clearance from a path.
    fn nearest(&self, path: &Path) -> Option<&Keepout> {
        let mut nearest: Option<(f64, &Keepout)> = None;
        for (stage, state) in self.problem.stages.iter().zip(&path.states) {
            for keepout in &stage.keepouts {
                let value = keepout.chance_value(&position(state), self.problem.quantile);
                if nearest.is_none_or(|(least, _)| value < least) {
                    nearest = Some((value, keepout));
                }
            }
        }
        nearest.map(|(_, keepout)| keepout)
    }

    /// Volumes in the middle of the horizon of the last plan, in the order of its obstacles.
    fn volumes(&self) -> &[Keepout] {
        &self.problem.stages[PLAN_INTERVALS / 2].keepouts
    }

    /// The point to aim at on the way round, or the goal itself once the straight way is free.
    pub(super) fn round(&mut self, start: &State, goal: &Vector3<f64>) -> Vector3<f64> {
        let from = position(start);
        let quantile = self.problem.quantile;
        let via = self.detour.and_then(|detour| {
            let slot = self
                .plan
                .obstacles
                .iter()
                .position(|&id| id == detour.obstacle)?;
            let keepout = self.volumes().get(slot)?;
            let blocked = detour::straight_clearance_m(keepout, quantile, &from, goal) < 0.0;
            blocked
                .then(|| detour::via(keepout, detour.side, &from, goal))
                .flatten()
        });
        let Some(via) = via else {
            self.detour = None;
            return *goal;
        };
        let way = via.point - from;
        let distance_m = way.norm().max(1e-9);
        from + way * (distance_m.max(VIA_LEAD_M) / distance_m)
    }

    /// Begins a way round when the plan comes to a halt before an obstacle on the straight way.
    /// One that moves is gone before it is passed: aiming beside it would follow it.
    pub(super) fn find_detour(
        &mut self,
        request: &PlanRequest<'_>,
        start: &State,
        goal: &Vector3<f64>,
    ) {
        if let Some(detour) = &mut self.detour {
            let [first, .., last] = &self.plan.points;
            let advance = last.position_world - first.position_world;
            detour.count(advance.norm() < STANDING_M);
            return;
        }
        if !is_halting(request, goal, &self.path.states[PLAN_INTERVALS]) {
            return;
        }
        let (from, quantile) = (position(start), self.problem.quantile);
        let mut blocking: Option<(f64, usize)> = None;
        for (slot, keepout) in self.volumes().iter().enumerate() {
            let obstacle = self.threats.get(slot).map(|t| &request.obstacles[t.index]);
            if obstacle.is_some_and(|o| o.motion == ObstacleMotion::Moving) {
                continue;
            }
            let clearance = detour::straight_clearance_m(keepout, quantile, &from, goal);
            let distance = (keepout.centre - from).norm();
            if clearance < 0.0 && blocking.is_none_or(|(least, _)| distance < least) {
                blocking = Some((distance, slot));
            }
        }
        self.detour = blocking.and_then(|(_, slot)| {
            let all = self.volumes();
            let side = detour::better_side(all.get(slot)?, all, quantile, &from, goal)?;
            let obstacle = self.plan.obstacles[slot];
            Some(Detour {
                obstacle,
                side,
                halts: 0,
            })
        });
    }
}

/// Whether a plan that ends in this state ends far from the goal and slowly.
fn is_halting(request: &PlanRequest<'_>, goal: &Vector3<f64>, last: &State) -> bool {
    let way = goal - position(last);
    let distance_m = way.norm();
    let velocity = Vector3::new(last[3], last[4], last[5]);
    let speed = way.dot(&velocity) / distance_m.max(1e-9);
    distance_m > FAR_M && speed < SLOW_SHARE * request.max_speed_m_s[PLAN_INTERVALS]
}
