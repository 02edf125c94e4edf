//! Flight among obstacles: depth images to tracks, tracks to a way round, the way to a plan that
//! keeps its distance, and when to slow down, to stop, to give way and to give up.

mod caution;
mod config;
mod glance;
mod headway;
mod pace;
mod poses;

pub use config::{AvoidanceConfig, ConductConfig};

use alula_geometry::{Timestamp, so3};
use alula_messages::{
    DepthImage, FlightMode, Hindrance, MAX_DEPTH_CAMERAS, NavState, Obstacle, ObstacleMotion,
    PLAN_POINTS, Plan, PlanExit, Reference, SensorBatch, Sight, StackOutput,
};
use alula_parameters::{ParameterError, Parameters};
use alula_perception::{Detector, RayEnd, SeenSpace, Tracker, View};
use alula_planning::mpc::{
    Arrival, FieldOfView, PlanRequest, PredictivePlanner, YawTarget, reference_at,
};
use alula_planning::route::{Route, RouteEnd, RoutePlanner};
use nalgebra::Vector3;

use glance::{Eye, Glance, nearest_approach};
use headway::Headway;
use poses::PastPoses;

/// Share of the rays of an image that must say something for the image to count.
const MIN_KNOWN_SHARE: f64 = 0.1;
/// Space around the vehicle that is taken for free because it is there, m.
const OWN_SPACE_M: f64 = 0.8;
/// A jump of the estimate is reported for this long, s.
const JUMP_REPORT_S: f64 = 1.0;
/// Speed from which on the camera looks along the motion, m/s.
const LOOK_AHEAD_M_S: f64 = 0.4;
/// Nearer to its target than this the vehicle keeps its heading, m.
const KEEP_HEADING_M: f64 = 0.5;

/// Point of a plan whose velocity is that of soon, about one second ahead.
const SOON_POINT: usize = 16;

/// What the vehicle is about.
#[derive(Clone, Debug, Default)]
enum Task {
    /// Nothing: somebody else leads.
    #[default]
    None,
    /// Flying through goals in order.
    Fly {
        goals_world: Vec<Vector3<f64>>,
        next: usize,
    },
    /// Giving way to something that comes near a place where it hovers.
    GiveWay {
        hold: Reference,
        threatened: Timestamp,
    },
}

/// One depth camera.
struct Camera {
    detector: Detector,
    /// Latest image that says something.
    newest_image: Option<Timestamp>,
    /// What the last image shows, to tell a camera that is stuck.
    fingerprint: Option<u64>,
}

/// Who leads in the next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Lead {
    /// The guide.
    Guide,
    /// This reference.
    Follow(Reference),
    /// The guide again, from where the reference is now back to a hover.
    Return(Reference),
    /// The guide again, because the goals are reached or given up.
    Over,
}

/// Sees, remembers, plans.
pub struct Avoidance {
    conduct: ConductConfig,
    radius_m: f64,
    max_depth_m: f64,
    tracker: Tracker,
    seen: SeenSpace,
    route: RoutePlanner,
    planner: PredictivePlanner,
    poses: PastPoses,
    task: Task,
    headway: Headway,
    /// Position and velocity at the last step.
    last: Option<(Timestamp, Vector3<f64>, Vector3<f64>)>,
    jump: Option<(Timestamp, f64)>,
    cameras: [Camera; MAX_DEPTH_CAMERAS],
    view: Option<FieldOfView>,
    glance: Glance,
    planned: Option<Timestamp>,
    plan: Option<Plan>,
    /// Height at which the way to the present goal began, m.
    start_height_m: Option<f64>,
    /// Where to stop while no images arrive.
    stop_world: Option<Vector3<f64>>,
    /// Places along the way, from which the speed limits follow.
    way: Vec<Vector3<f64>>,
    /// The tracks as the planner takes them.
    known: Vec<Obstacle>,
}

impl Avoidance {
    /// Knows nothing yet.
    ///
    /// # Errors
    /// The first parameter outside its range.
    pub fn new(config: &AvoidanceConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        let under = |key: &'static str| move |e: ParameterError| e.under(key);
        let detector = Detector::new(&config.detector).map_err(under("detector"))?;
        Ok(Self {
            conduct: config.conduct.clone(),
            radius_m: config.planner.radius_m,
            max_depth_m: config.detector.max_depth_m,
            tracker: Tracker::new(&config.tracker).map_err(under("tracker"))?,
            seen: SeenSpace::new(&config.seen).map_err(under("seen"))?,
            route: RoutePlanner::new(&config.route).map_err(under("route"))?,
            planner: PredictivePlanner::new(&config.planner, &config.vehicle)
                .map_err(under("planner"))?,
            poses: PastPoses::new(),
            task: Task::None,
            headway: Headway::default(),
            last: None,
            jump: None,
            cameras: std::array::from_fn(|_| Camera {
                detector: detector.clone(),
                newest_image: None,
                fingerprint: None,
            }),
            view: None,
            glance: Glance::new(),
            planned: None,
            plan: None,
            start_height_m: None,
            stop_world: None,
            way: Vec::with_capacity(PLAN_POINTS),
            known: Vec::with_capacity(config.tracker.max_tracks),
        })
    }

    /// The detector of the camera that looks ahead, whose last U-depth map can be drawn.
    pub fn detector(&self) -> &Detector {
        &self.cameras[0].detector
    }

    /// Looks at the images of a batch with the state of the same step.
    pub(crate) fn observe(&mut self, batch: &SensorBatch, output: &mut StackOutput) {
        output.seen_at = None;
        output.detections.clear();
        output.obstacles.clear();
        if !output.state.is_finite() {
            return;
        }
        self.note_jump(&output.state);
        self.poses.push(&output.state);
        for image in &batch.depth {
            let Some(camera) = self.cameras.get_mut(usize::from(image.sensor)) else {
                continue;
            };
            let fingerprint = image.fingerprint();
            let is_stuck = camera.fingerprint.replace(fingerprint) == Some(fingerprint);
            if !is_stuck && !self.tracker.is_too_late(image.time) {
                self.look(image, output);
            }
        }
    }

    /// What was seen moves along when the estimate jumps: it was seen from the vehicle.
    fn note_jump(&mut self, state: &NavState) {
        let position = state.position_world();
        if let Some((time, last, velocity)) = self.last {
            let dt_s = state.time.seconds_since(time).clamp(0.0, 0.5);
            let step = position - last - velocity * dt_s;
            if step.norm() > self.conduct.jump_m {
                self.tracker.shift(&step);
                self.poses.shift(&step);
                self.seen.clear();
                self.planner.reset();
                self.route.reset();
                self.plan = None;
                self.jump = Some((state.time, step.norm()));
            }
        }
        self.last = Some((state.time, position, state.velocity_world));
    }

    fn look(&mut self, image: &DepthImage, output: &mut StackOutput) {
        let Some(past) = self.poses.at(image.time) else {
            return;
        };
        let view = View {
            world_from_body: past.world_from_body,
            orientation_covariance: past.tilt_covariance(),
            floor_height_m: Some(self.conduct.floor_height_m),
        };
        let number = usize::from(image.sensor);
        let camera = &mut self.cameras[number];
        let found = camera.detector.detect(image, &view);
        output.detections.extend_from_slice(found);
        let found = &output.detections[output.detections.len() - found.len()..];
        let contour = camera.detector.contour();
        let position = past.world_from_body.translation.vector;
        let obstacles = self.tracker.update(image.time, found, contour, &position);
        output.obstacles.clear();
        output.obstacles.extend_from_slice(obstacles);
        output.seen_at = Some(image.time);
        let known = contour.rays.iter().filter(|r| r.end != RayEnd::Unknown);
        if known.count() as f64 >= MIN_KNOWN_SHARE * contour.rays.len().max(1) as f64 {
            camera.newest_image = camera.newest_image.max(Some(image.time));
        }
        self.seen.update(contour);
        self.seen.mark_here(&position, OWN_SPACE_M, image.time);
        let world_from_camera = past.world_from_body * image.body_from_camera;
        let axis = world_from_camera.rotation * Vector3::z();
        let heading_rad = axis.y.atan2(axis.x);
        let eye = Eye::of(image);
        self.glance
            .note(image.time, number, eye, heading_rad, obstacles);
        if number != 0 {
            return;
        }
        let [horizontal_rad, vertical_rad] = image.camera.field_of_view_rad();
        self.view = Some(FieldOfView::new(
            &world_from_camera,
            horizontal_rad,
            vertical_rad,
            self.max_depth_m,
            self.conduct.view_setback_m,
        ));
    }

    /// Begins a flight through goals (world, m).
    pub(crate) fn fly(&mut self, goals_world: &[Vector3<f64>]) {
        self.begin(Task::Fly {
            goals_world: goals_world.to_vec(),
            next: 0,
        });
    }

    fn begin(&mut self, task: Task) {
        self.task = task;
        self.headway.reset();
        self.planner.reset();
        self.route.reset();
        self.planned = None;
        self.plan = None;
        self.start_height_m = None;
        self.stop_world = None;
    }

    /// Whether goals are being flown to.
    pub(crate) fn is_flying(&self) -> bool {
        matches!(self.task, Task::Fly { .. })
    }

    /// One step in a mode of flight. `hover` is the reference of a guide that stands still.
    pub(crate) fn advance(&mut self, output: &mut StackOutput, hover: Option<Reference>) -> Lead {
        output.plan = None;
        output.hindrance = None;
        match (output.mode, &self.task) {
            (FlightMode::Flying, Task::Fly { .. }) => self.fly_on(output),
            (FlightMode::Hovering, Task::GiveWay { .. }) => self.give_way_on(output),
            (FlightMode::Hovering, _) => {
                self.task = Task::None;
                match hover.filter(|hover| self.is_threatened(output.time, hover)) {
                    Some(hold) => {
                        self.begin(Task::GiveWay {
                            hold,
                            threatened: output.time,
                        });
                        self.give_way_on(output)
                    }
                    None => Lead::Guide,
                }
            }
            _ => {
                self.task = Task::None;
                Lead::Guide
            }
        }
    }

    fn fly_on(&mut self, output: &mut StackOutput) -> Lead {
        if !self.is_due(output.time) {
            output.hindrance = self.standing_hindrance(output.time);
            return self.follow(output.time);
        }
        let Some(goal) = self.goal_ahead(&output.state) else {
            self.task = Task::None;
            return Lead::Over;
        };
        if let Some(age_s) = self.stale_s(output.time) {
            output.hindrance = Some(Hindrance::DepthStale { age_s });
            self.plan_stop(output);
            return self.follow(output.time);
        }
        self.stop_world = None;
        self.take_stock(&output.state);
        let position = output.state.position_world();
        let route = self.route.route(&position, &goal, &self.known, stands);
        let stalled_s = self.note_headway(output.time, &route);
        output.hindrance = self
            .hindrance(&route, stalled_s)
            .or(self.standing_hindrance(output.time));
        if stalled_s > self.conduct.give_up_s {
            self.task = Task::None;
            return Lead::Over;
        }
        let arrives = self.is_last_goal() || matches!(route.end, RouteEnd::Closed { .. });
        let is_end = (route.target_world - goal).norm() < 1e-6;
        let arrival = if arrives && (is_end || route.end != RouteEnd::Goal) {
            Arrival::Stop
        } else {
            Arrival::Pass
        };
        let yaw = self.look_where(&output.state, &route.target_world);
        self.make_plan(output, route.target_world, arrival, yaw);
        self.follow(output.time)
    }

    /// The goal to fly to; `None` when the last is reached.
    fn goal_ahead(&mut self, state: &NavState) -> Option<Vector3<f64>> {
        let conduct = &self.conduct;
        let Task::Fly { goals_world, next } = &mut self.task else {
            return None;
        };
        while let Some(goal) = goals_world.get(*next) {
            let distance_m = (goal - state.position_world()).norm();
            let is_last = *next + 1 == goals_world.len();
            let reached = if is_last {
                distance_m < conduct.arrive_radius_m
                    && state.velocity_world.norm() < conduct.arrive_speed_m_s
            } else {
                distance_m < conduct.pass_radius_m
            };
            if !reached {
                return Some(*goal);
            }
            *next += 1;
            self.headway.reset();
            // Not that of the vehicle: who sank on one way must not sink on from there.
            self.start_height_m = Some(goal.z);
        }
        None
    }

    fn is_last_goal(&self) -> bool {
        matches!(&self.task, Task::Fly { goals_world, next } if next + 1 == goals_world.len())
    }

    fn note_headway(&mut self, now: Timestamp, route: &Route) -> f64 {
        self.headway
            .note(now, route.length_m, self.conduct.progress_m)
    }

    /// Why the vehicle does not come nearer.
    fn hindrance(&self, route: &Route, stalled_s: f64) -> Option<Hindrance> {
        if stalled_s < self.conduct.stall_s {
            return None;
        }
        Some(match route.end {
            RouteEnd::Closed {
                obstacle,
                at_goal: true,
            } => Hindrance::GoalBlocked { obstacle },
            RouteEnd::Closed { at_goal: false, .. } => Hindrance::NoRoute,
            RouteEnd::Goal | RouteEnd::Edge => Hindrance::Stalled { since_s: stalled_s },
        })
    }

    fn standing_hindrance(&self, now: Timestamp) -> Option<Hindrance> {
        let failed = self.plan.is_some_and(|p| p.exit == PlanExit::Failed);
        if let Some((time, jump_m)) = self.jump
            && now.seconds_since(time) < JUMP_REPORT_S
        {
            return Some(Hindrance::EstimateJumped { jump_m });
        }
        failed.then_some(Hindrance::PlannerFailed)
    }

    /// Age of the newest image of the camera that has been silent longest, s, when it is too old.
    fn stale_s(&self, now: Timestamp) -> Option<f64> {
        let newest = self.cameras.iter().filter_map(|camera| camera.newest_image);
        let age_s = newest
            .min()
            .map_or(f64::INFINITY, |time| now.seconds_since(time));
        (age_s > self.conduct.depth_stale_s).then_some(age_s)
    }

    fn is_due(&self, now: Timestamp) -> bool {
        self.plan.is_none()
            || self.planned.is_none_or(|last| {
                // A rounded difference of times must not cost a control period.
                now.seconds_since(last) >= self.conduct.replan_s - 1e-6
            })
    }

    /// What the planner takes the tracks for.
    fn take_stock(&mut self, state: &NavState) {
        let (now, height_m) = (state.time, state.position_world().z);
        let conduct = &self.conduct;
        let radius_m = self.radius_m;
        let tracks = self.tracker.obstacles().iter();
        self.known.clear();
        self.known
            .extend(tracks.map(|track| caution::taken(track, now, height_m, radius_m, conduct)));
    }

    fn plan_stop(&mut self, output: &mut StackOutput) {
        self.take_stock(&output.state);
        let state = &output.state;
        let stop_m = state.velocity_world.norm_squared() / (2.0 * self.conduct.braking_m_s2);
        let ahead = state.velocity_world.try_normalize(1e-3).unwrap_or_default();
        let stop = *self
            .stop_world
            .get_or_insert(state.position_world() + ahead * stop_m);
        let yaw = YawTarget::Hold(so3::yaw_rad(&state.world_from_body.rotation));
        self.make_plan(output, stop, Arrival::Stop, yaw);
    }

    fn look_where(&mut self, state: &NavState, target_world: &Vector3<f64>) -> YawTarget {
        let line = target_world.xy() - state.position_world().xy();
        let is_there = line.norm() < KEEP_HEADING_M;
        let way_rad = if is_there {
            so3::yaw_rad(&state.world_from_body.rotation)
        } else {
            line.y.atan2(line.x)
        };
        let soon = self.plan.map_or(state.velocity_world.xy(), |plan| {
            plan.points[SOON_POINT].velocity_world.xy()
        });
        let glance = self
            .glance
            .heading(state, way_rad, &soon, &self.known, &self.conduct);
        if let Some(heading_rad) = glance {
            return YawTarget::Towards(heading_rad);
        }
        if is_there {
            return YawTarget::Hold(way_rad);
        }
        if state.velocity_world.xy().norm() > LOOK_AHEAD_M_S {
            return YawTarget::AlongMotion;
        }
        YawTarget::Towards(way_rad)
    }

    fn make_plan(
        &mut self,
        output: &mut StackOutput,
        target_world: Vector3<f64>,
        arrival: Arrival,
        yaw: YawTarget,
    ) {
        self.start_height_m
            .get_or_insert(output.state.position_world().z);
        let max_speed_m_s = self.speed_limits(&output.state, &target_world);
        let plan = self.planner.plan(&PlanRequest {
            now: output.time,
            state: &output.state,
            target_world,
            arrival,
            yaw,
            max_speed_m_s: &max_speed_m_s,
            obstacles: &self.known,
            height_band_m: Some(self.height_band_m(target_world.z)),
            // Who looks round does not fly where he looks.
            view: self
                .view
                .as_ref()
                .filter(|_| !self.glance.is_wary(output.time, &self.conduct)),
        });
        output.plan = Some(*plan);
        self.plan = Some(*plan);
        self.planned = Some(output.time);
    }

    /// Heights between which the vehicle stays on its way from where the task began.
    fn height_band_m(&self, target_m: f64) -> [f64; 2] {
        let start_m = self.start_height_m.unwrap_or(target_m);
        let band_m = self.conduct.height_band_m;
        [
            start_m.min(target_m) - band_m,
            start_m.max(target_m) + band_m,
        ]
    }

    fn speed_limits(&mut self, state: &NavState, target: &Vector3<f64>) -> [f64; PLAN_POINTS] {
        let position = state.position_world();
        self.way.clear();
        self.way.push(position);
        let planned = self.plan.iter().flat_map(|plan| &plan.points[1..]);
        self.way.extend(planned.map(|point| point.position_world));
        let reach = self.way.last().map_or(0.0, |p| (p - position).norm());
        if reach < 0.5 {
            self.way.truncate(1);
            self.way.push(*target);
        }
        pace::speed_limits(&self.way, &self.conduct, |p| self.seen.is_free(p))
    }

    fn follow(&self, now: Timestamp) -> Lead {
        let plan = self.plan.as_ref();
        plan.map_or(Lead::Guide, |plan| Lead::Follow(reference_at(plan, now)))
    }

    fn give_way_on(&mut self, output: &mut StackOutput) -> Lead {
        let Task::GiveWay { hold, threatened } = self.task else {
            return Lead::Guide;
        };
        let now = output.time;
        let threat = self.is_threatened(now, &hold);
        let quiet_s = now.seconds_since(threatened);
        if threat {
            self.task = Task::GiveWay {
                hold,
                threatened: now,
            };
        } else if quiet_s > self.conduct.return_s {
            self.task = Task::None;
            return Lead::Return(hold);
        }
        if self.is_due(now) {
            self.take_stock(&output.state);
            let yaw = self.look_at_threat(&output.state, &hold);
            self.make_plan(output, hold.position_world, Arrival::Stop, yaw);
        }
        self.follow(now)
    }

    /// Whether something that moves will come too near a place within the horizon of a plan.
    fn is_threatened(&self, now: Timestamp, hold: &Reference) -> bool {
        self.tracker
            .obstacles()
            .iter()
            .any(|o| self.threatens(o, now, hold))
    }

    fn threatens(&self, obstacle: &Obstacle, now: Timestamp, hold: &Reference) -> bool {
        /// A hovering vehicle looks this far ahead, s.
        const AHEAD_S: f64 = 2.0;
        if obstacle.motion == ObstacleMotion::Static || obstacle.images < 3 {
            return false;
        }
        let age_s = now.seconds_since(obstacle.time);
        let offset = (obstacle.centre_after(age_s) - hold.position_world).xy();
        let velocity = obstacle.velocity_world.xy();
        let (_, nearest_m) = nearest_approach(&offset, &velocity, AHEAD_S);
        let size_m = 0.5 * obstacle.size_m.xy().max();
        nearest_m - size_m - self.radius_m < self.conduct.give_way_m
    }

    fn look_at_threat(&self, state: &NavState, hold: &Reference) -> YawTarget {
        let now = state.time;
        let position = state.position_world().xy();
        let threats = self.tracker.obstacles().iter();
        let nearest = threats
            .filter(|o| self.threatens(o, now, hold))
            .map(|o| o.centre_world.xy() - position)
            .min_by(|a, b| a.norm().total_cmp(&b.norm()));
        match nearest {
            Some(line) if line.norm() > KEEP_HEADING_M => YawTarget::Towards(line.y.atan2(line.x)),
            _ => YawTarget::Hold(so3::yaw_rad(&state.world_from_body.rotation)),
        }
    }
}

/// Whether the way must lead round an obstacle: those that move are left to the planner, which
/// knows where they will be.
fn stands(obstacle: &Obstacle) -> bool {
    obstacle.motion != ObstacleMotion::Moving
        && !(obstacle.images < 3 && obstacle.sight == Sight::Missed)
}
