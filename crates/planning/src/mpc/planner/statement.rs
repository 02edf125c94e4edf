//! From a request to the program's costs and constraints.

use alula_geometry::gaussian::normal_quantile;
use alula_messages::{PLAN_INTERVALS, PLAN_OBSTACLES, PLAN_POINTS};
use nalgebra::Vector3;

use super::super::config::PredictiveConfig;
use super::super::dynamics::{Input, State, TiltDynamics};
use super::super::prediction::Scene;
use super::super::problem::{Penalty, Potential, Problem, SpeedCost, Stage};
use super::super::request::{Arrival, PlanRequest};
use super::super::uncertainty;
use super::{PredictivePlanner, position};

/// A plan that leads past its target aims this long ahead, s.
const PASS_AHEAD_S: f64 = 2.0;

impl PredictivePlanner {
    /// The point at which the last point of the plan aims.
    pub(super) fn lead(&self, request: &PlanRequest<'_>, start: &State) -> Vector3<f64> {
        let from = position(start);
        let way = request.target_world - from;
        let distance_m = way.norm();
        let mut lead_m = distance_m;
        if request.arrival == Arrival::Pass {
            let reach_m = request.max_speed_m_s[PLAN_INTERVALS].max(0.0) * PASS_AHEAD_S;
            let share = distance_m / (distance_m + self.config.radius_m);
            lead_m += (reach_m - distance_m).max(0.0) * share;
        }
        from + way * (lead_m.min(self.config.lead_m) / distance_m.max(1e-9))
    }

    /// States costs and constraints for this request.
    pub(super) fn state_problem(
        &mut self,
        request: &PlanRequest<'_>,
        start: &State,
        target: &Vector3<f64>,
    ) {
        let mut yaw = [0.0; PLAN_POINTS];
        let states = &self.path.states;
        let config = &self.config;
        self.heading.targets(
            config,
            request.yaw,
            start[8],
            states,
            &request.target_world,
            &mut yaw,
        );
        let initial = uncertainty::initial(config, request.state);
        let dynamics = &self.problem.dynamics;
        uncertainty::propagate(
            config,
            dynamics,
            &initial,
            states,
            &self.path.inputs,
            &mut self.own,
        );
        let goal = Goal::new(config, request.arrival, start, target);
        for (k, stage) in self.problem.stages.iter_mut().enumerate() {
            goal.state_in(config, k == PLAN_INTERVALS, stage);
            stage.yaw_rad = yaw[k];
            stage.speed = Some(SpeedCost {
                limit_m_s: request.max_speed_m_s[k].max(0.0),
                softness_m_s: config.speed_softness_m_s,
                weight: config.speed_weight,
            });
        }
        self.problem.height_band = request
            .height_band_m
            .map(|band_m| (band_m, self.problem.collision));
        self.problem.view = request.view.map(|view| (*view, penalty_of_view(config)));
        self.state_keepouts(request, target);
    }

    fn state_keepouts(&mut self, request: &PlanRequest<'_>, target: &Vector3<f64>) {
        let scene = Scene {
            config: &self.config,
            quantile: self.problem.quantile,
            now: request.now,
            states: &self.path.states,
            target: *target,
            speed_m_s: request.max_speed_m_s[0].max(0.0),
        };
        scene.choose(request.obstacles, &mut self.threats);
        for (k, stage) in self.problem.stages.iter_mut().enumerate() {
            stage.keepouts.clear();
            if k == 0 {
                continue;
            }
            for threat in &self.threats {
                let obstacle = &request.obstacles[threat.index];
                stage
                    .keepouts
                    .push(scene.keepout(obstacle, threat, k, &self.own[k]));
            }
        }
    }
}

fn penalty_of_view(config: &PredictiveConfig) -> Penalty {
    Penalty {
        linear: config.view_linear,
        quadratic: config.view_quadratic,
    }
}

/// Weights of the target, scaled by the distance from which it is approached.
struct Goal {
    target: Vector3<f64>,
    stage_weight: Vector3<f64>,
    last_weight: Vector3<f64>,
    last_velocity_weight: f64,
}

impl Goal {
    fn new(
        config: &PredictiveConfig,
        arrival: Arrival,
        start: &State,
        target: &Vector3<f64>,
    ) -> Self {
        let way = target - position(start);
        let scale = 1.0 / way.norm_squared().max(1.0);
        let height_scale = 1.0 / (way.z * way.z).max(1.0);
        let mut stage_weight = Vector3::repeat(config.stage_goal_weight * scale);
        stage_weight.z += config.height_weight * height_scale;
        let stop = match arrival {
            Arrival::Stop => config.stop_weight * scale,
            Arrival::Pass => 0.0,
        };
        Self {
            target: *target,
            stage_weight,
            last_weight: Vector3::repeat(config.goal_weight * scale),
            last_velocity_weight: stop + config.velocity_weight,
        }
    }

    fn state_in(&self, config: &PredictiveConfig, last: bool, stage: &mut Stage) {
        stage.target = self.target;
        stage.potential_weight = config.potential_weight;
        if last {
            stage.position_weight = self.last_weight;
            stage.position_weight.z += self.stage_weight.z;
            stage.velocity_weight = Vector3::repeat(self.last_velocity_weight);
            stage.yaw_weight = config.yaw_weight;
        } else {
            stage.position_weight = self.stage_weight;
            stage.velocity_weight = Vector3::repeat(config.velocity_weight);
            stage.yaw_weight = config.stage_yaw_weight;
        }
    }
}

/// The problem without a target.
pub(super) fn blank_problem(config: &PredictiveConfig, dynamics: TiltDynamics) -> Problem {
    let tilt = config.max_tilt_deg.to_radians();
    let yaw_rate = config.max_yaw_rate_deg_s.to_radians();
    Problem {
        dynamics,
        input_limit: Input::new(tilt, tilt, config.max_climb_m_s, yaw_rate),
        input_weight: config.input_weight,
        potential: Potential {
            slope_1_m: config.potential_slope_1_m,
            buffer_m: config.potential_buffer_m,
        },
        quantile: normal_quantile(1.0 - config.delta),
        collision: Penalty {
            linear: config.collision_linear,
            quadratic: config.collision_quadratic,
        },
        velocity_bound: None,
        height_band: None,
        view: None,
        // Copies of an empty list would come without its room.
        stages: (0..PLAN_POINTS)
            .map(|_| Stage::with_capacity(PLAN_OBSTACLES))
            .collect(),
    }
}
