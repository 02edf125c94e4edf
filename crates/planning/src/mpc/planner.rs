//! The predictive planner: states the problem for a request, solves it, and says what it intends.

mod failure;
mod statement;
mod ways;

use alula_geometry::so3::{to_roll_pitch_yaw, wrap_angle};
use alula_messages::{
    NO_OBSTACLE, PLAN_INTERVALS, PLAN_OBSTACLES, PLAN_POINTS, Plan, PlanExit, PlanPoint,
};
use alula_optim::ocp::{OcpExit, OcpReport, OcpSettings, OcpSolver};
use alula_parameters::{ParameterError, Parameters};
use nalgebra::{Matrix3, Vector3};

use self::statement::blank_problem;
use super::config::PredictiveConfig;
use super::detour::{Detour, Via};
use super::dynamics::{Input, NU, NX, State, TiltDynamics, TiltModel};
use super::guess::{Path, simple_flight};
use super::heading::Heading;
use super::prediction::Threat;
use super::problem::{HEIGHT_SIDES, Problem};
use super::request::PlanRequest;
use super::view::VIEW_SIDES;

/// A shift by whole intervals, to this share of one, moves the solver's memory along.
const WHOLE_SHIFT: f64 = 0.05;

/// Plans over a horizon of [`PLAN_INTERVALS`] by chance-constrained model predictive control
/// (document L, chapter 6). See `docs/derivations/chance-constrained-mpc.md`.
pub struct PredictivePlanner {
    config: PredictiveConfig,
    problem: Problem,
    solver: OcpSolver<NX, NU>,
    heading: Heading,
    threats: Vec<Threat>,
    own: [Matrix3<f64>; PLAN_POINTS],
    /// First guess, then the solution that the plan states.
    path: Path,
    plan: Plan,
    planned: bool,
    /// Way round the obstacle that blocks the straight way.
    detour: Option<Detour>,
}

/// A solution of the present problem.
struct Solution {
    report: OcpReport,
    path: Path,
    /// Greatest lack of clearance, m.
    violation_m: f64,
}

impl PredictivePlanner {
    /// A planner for a vehicle.
    ///
    /// # Errors
    /// A value outside its range.
    pub fn new(config: &PredictiveConfig, model: &TiltModel) -> Result<Self, ParameterError> {
        config.validate()?;
        let problem = blank_problem(config, TiltDynamics::new(model, config.interval_s)?);
        let settings = OcpSettings {
            max_iterations: config.max_iterations,
            ..OcpSettings::default()
        };
        Ok(Self {
            config: config.clone(),
            problem,
            solver: OcpSolver::new(
                PLAN_INTERVALS,
                PLAN_OBSTACLES + HEIGHT_SIDES + VIEW_SIDES,
                settings,
            ),
            heading: Heading::default(),
            threats: Vec::with_capacity(PLAN_OBSTACLES),
            own: [Matrix3::zeros(); PLAN_POINTS],
            path: Path::standing(&State::zeros()),
            plan: Plan {
                interval_s: config.interval_s,
                ..Plan::default()
            },
            planned: false,
            detour: None,
        })
    }

    /// Forgets the last plan: the next one starts from nothing.
    pub fn reset(&mut self) {
        self.plan = Plan {
            interval_s: self.config.interval_s,
            ..Plan::default()
        };
        self.planned = false;
        self.detour = None;
        self.solver.forget();
        self.heading = Heading::default();
    }

    /// The input at the first point of the last plan that did not fail.
    pub fn first_input(&self) -> Input {
        self.path.inputs[0]
    }

    /// The plan from here.
    ///
    /// If a number is not finite or the solver breaks down, the last plan goes on and brakes
    /// ([`PlanExit::Failed`]); without one it stands where the state is, or at the world's origin
    /// if that is not finite either. The stack must not fly on a failed plan for long.
    pub fn plan(&mut self, request: &PlanRequest<'_>) -> &Plan {
        if !request.is_finite() {
            return self.fail(request);
        }
        let start = self.start(request);
        let goal = self.lead(request, &start);
        let target = self.round(&start, &goal);
        self.guess(request, &start, &target);
        self.state_problem(request, &start, &target);
        let mut best = self.solve(&start);
        for _ in 0..self.config.restarts {
            best = self.try_other_guess(request, &start, &target, best);
        }
        if best.report.exit == OcpExit::NotFinite || !is_finite(&best.path) {
            self.solver.forget();
            return self.fail(request);
        }
        self.publish(request, &best);
        self.find_detour(request, &start, &goal);
        &self.plan
    }

    /// The state in the planner's coordinates, with the turn of yaw nearest to the last plan's.
    fn start(&self, request: &PlanRequest<'_>) -> State {
        let state = request.state;
        let (roll, pitch, yaw) = to_roll_pitch_yaw(&state.world_from_body.rotation);
        let last = if self.planned {
            self.path.states[1][8]
        } else {
            yaw
        };
        let (p, v) = (state.position_world(), state.velocity_world);
        let yaw = last + wrap_angle(yaw - last);
        State::from_column_slice(&[p.x, p.y, p.z, v.x, v.y, v.z, roll, pitch, yaw])
    }

    /// The first guess: the last solution moved on, or a simple flight.
    fn guess(&mut self, request: &PlanRequest<'_>, start: &State, target: &Vector3<f64>) {
        let shift = request.now.seconds_since(self.plan.time) / self.config.interval_s;
        let follows = self.planned && (0.0..=0.5 * PLAN_INTERVALS as f64).contains(&shift);
        if follows {
            let path = self.path.shifted(shift, start);
            let expected = position(&self.path.shifted(shift - 1.0, start).states[1]);
            if (position(start) - expected).norm() <= self.config.jump_m {
                if (shift - shift.round()).abs() < WHOLE_SHIFT {
                    for _ in 0..shift.round() as usize {
                        self.solver.shift();
                    }
                }
                self.path = path;
                return;
            }
        }
        self.solver.forget();
        let speed_m_s = request.max_speed_m_s[0].max(0.0);
        self.path = self.flight(start, target, None, speed_m_s);
    }

    /// A simple flight with the present yaw.
    fn flight(
        &self,
        start: &State,
        target: &Vector3<f64>,
        via: Option<&Via>,
        speed_m_s: f64,
    ) -> Path {
        let yaw = [start[8]; PLAN_POINTS];
        let (dynamics, limit) = (&self.problem.dynamics, &self.problem.input_limit);
        simple_flight(dynamics, limit, start, target, via, speed_m_s, &yaw)
    }

    /// Solves from the path as the first guess.
    fn solve(&mut self, start: &State) -> Solution {
        self.solver.set_guess(&self.path.states, &self.path.inputs);
        let report = self.solver.solve(&self.problem, start);
        let mut path = Path::standing(start);
        path.states.copy_from_slice(self.solver.states());
        path.inputs.copy_from_slice(self.solver.inputs());
        let violation_m = self.violation_m(&path);
        Solution {
            report,
            path,
            violation_m,
        }
    }

    /// Greatest lack of clearance from an obstacle, m.
    fn violation_m(&self, path: &Path) -> f64 {
        let mut greatest = 0.0_f64;
        for (stage, state) in self.problem.stages.iter().zip(&path.states) {
            for keepout in &stage.keepouts {
                let value = keepout.chance_value(&position(state), self.problem.quantile);
                greatest = greatest.max(-value);
            }
        }
        greatest
    }

    /// States the solution as the plan.
    fn publish(&mut self, request: &PlanRequest<'_>, solution: &Solution) {
        self.path.clone_from(&solution.path);
        self.planned = true;
        let mut obstacles = [NO_OBSTACLE; PLAN_OBSTACLES];
        for (slot, threat) in obstacles.iter_mut().zip(&self.threats) {
            *slot = request.obstacles[threat.index].id;
        }
        self.plan = Plan {
            time: request.now,
            interval_s: self.config.interval_s,
            points: std::array::from_fn(|k| self.point(k)),
            target_world: request.target_world,
            exit: plan_exit(solution.report.exit),
            iterations: solution.report.iterations,
            cost: solution.report.cost,
            max_violation_m: solution.violation_m,
            obstacles,
        };
    }

    fn point(&self, k: usize) -> PlanPoint {
        let x = &self.path.states[k];
        let u = &self.path.inputs[k.min(PLAN_INTERVALS - 1)];
        PlanPoint {
            position_world: position(x),
            velocity_world: Vector3::new(x[3], x[4], x[5]),
            acceleration_world: self.problem.dynamics.acceleration(x, u),
            yaw_rad: x[8],
            yaw_rate_rad_s: u[3],
            position_covariance: self.own[k],
        }
    }
}

fn position(x: &State) -> Vector3<f64> {
    Vector3::new(x[0], x[1], x[2])
}

fn is_finite(path: &Path) -> bool {
    path.states.iter().all(|x| x.iter().all(|v| v.is_finite()))
        && path.inputs.iter().all(|u| u.iter().all(|v| v.is_finite()))
}

fn plan_exit(exit: OcpExit) -> PlanExit {
    match exit {
        OcpExit::Converged => PlanExit::Converged,
        OcpExit::IterationLimit => PlanExit::IterationLimit,
        OcpExit::NoProgress { .. } => PlanExit::NoProgress,
        OcpExit::NotFinite => PlanExit::Failed,
    }
}
