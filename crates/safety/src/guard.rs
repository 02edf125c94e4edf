//! The guard itself: observe, check, decide, command.

use alula_geometry::{Timestamp, so3};
use alula_messages::{
    Command, EstimateHealth, Fallback, Finding, FlightMode, GuardReport, NavState, SensorBatch,
    Violation,
};
use alula_parameters::{ParameterError, Parameters};
use nalgebra::Vector3;

use crate::checks::{
    ALL, View, all_stages, command_excess, flow_is_expected, is_finite, range_is_expected,
};
use crate::config::{GuardConfig, GuardVehicle};
use crate::descent::Descent;
use crate::raw::RawMotion;
use crate::rules::{Stages, Watch};

/// Longest step that the filters take at once, s.
const MAX_STEP_S: f64 = 0.1;
/// A report of the autopilot's thrust counts for this long, s.
const STATUS_FRESH_S: f64 = 0.2;
/// Samples of a sensor must have arrived within this time before a flight, s.
const ARRIVING_S: f64 = 1.0;
/// Greatest difference of the verticals before a flight, degrees.
const READY_GAP_DEG: f64 = 10.0;

/// What the guard sees in one step.
#[derive(Clone, Copy, Debug)]
pub struct GuardInput<'a> {
    /// The raw data, the same that the estimator got.
    pub batch: &'a SensorBatch,
    /// The estimate.
    pub state: &'a NavState,
    /// The mode of flight.
    pub mode: FlightMode,
    /// The command that the controller wants to give.
    pub requested: &'a Command,
}

/// The last part before the vehicle: passes a command on or replaces it by a safer one.
#[derive(Clone, Debug)]
pub struct Guard {
    config: GuardConfig,
    vehicle: GuardVehicle,
    stages: [Stages; ALL.len()],
    watches: [Watch; ALL.len()],
    raw: RawMotion,
    descent: Descent,
    /// The gravest fallback that is kept until the vehicle is disarmed.
    latched: Fallback,
    /// Since when the flight modes do something else than the fallback asks.
    disobeyed_since: Option<Timestamp>,
    /// Since when the guard waits for its landing to end.
    landing_since: Option<Timestamp>,
    flow_expected_since: Option<Timestamp>,
    range_expected_since: Option<Timestamp>,
    /// Thrust as the autopilot reported it, N, and when.
    reported_thrust: Option<(Timestamp, f64)>,
    ground_z_m: f64,
    last: Option<Timestamp>,
    /// Whether the vehicle avoids what it sees.
    needs_depth: bool,
    ready: Result<(), Violation>,
    command: Command,
    report: GuardReport,
}

impl Guard {
    /// A guard that has seen nothing yet and passes nothing but [`Command::Disarm`].
    ///
    /// # Errors
    /// The first parameter or fact outside its range.
    pub fn new(config: &GuardConfig, vehicle: &GuardVehicle) -> Result<Self, ParameterError> {
        config.validate()?;
        config.validate_order()?;
        vehicle.validate()?;
        Ok(Self {
            stages: all_stages(config),
            watches: [Watch::default(); ALL.len()],
            raw: RawMotion::new(&config.sensors, &config.descent),
            descent: Descent::new(&config.descent, vehicle),
            latched: Fallback::None,
            disobeyed_since: None,
            landing_since: None,
            flow_expected_since: None,
            range_expected_since: None,
            reported_thrust: None,
            ground_z_m: 0.0,
            last: None,
            needs_depth: false,
            ready: Err(Violation::ImuLost),
            command: Command::Disarm,
            report: GuardReport {
                findings: Vec::with_capacity(ALL.len()),
                ..GuardReport::default()
            },
            config: config.clone(),
            vehicle: vehicle.clone(),
        })
    }

    /// From now on depth images are expected: the vehicle avoids what it sees.
    pub fn expect_depth(&mut self) {
        self.needs_depth = true;
    }

    /// The command after the guard.
    pub fn command(&self) -> Command {
        self.command
    }

    /// What the guard found and did in the last step.
    pub fn report(&self) -> &GuardReport {
        &self.report
    }

    /// Whether a flight may begin: all data arrive and agree. Known on the ground only.
    ///
    /// # Errors
    /// What is wrong.
    pub fn ready(&self) -> Result<(), Violation> {
        self.ready
    }

    /// Judges one step. Afterwards [`Guard::command`] is what the vehicle may get.
    pub fn update(&mut self, input: &GuardInput) -> &GuardReport {
        let step_s = self.step_s(input.batch.now);
        self.note_thrust(input.batch, step_s);
        self.report.findings.clear();
        match input.mode {
            FlightMode::Disarmed | FlightMode::Armed => self.stand(input),
            FlightMode::Killed => self.command = Command::Disarm,
            FlightMode::TakingOff
            | FlightMode::Hovering
            | FlightMode::Flying
            | FlightMode::Landing => self.fly(input, step_s),
        }
        &self.report
    }

    fn step_s(&mut self, now: Timestamp) -> f64 {
        let step_s = self.last.map_or(0.0, |last| now.seconds_since(last));
        self.last = Some(now);
        step_s.clamp(0.0, MAX_STEP_S)
    }

    /// The thrust that is given: as reported, else as commanded last.
    fn note_thrust(&mut self, batch: &SensorBatch, step_s: f64) {
        for status in &batch.autopilot {
            let thrust_n = status.thrust_fraction * self.vehicle.max_thrust_n;
            self.reported_thrust = Some((status.time, thrust_n));
        }
        let is_fresh = |time| batch.now.seconds_since(time) <= STATUS_FRESH_S;
        let reported = self.reported_thrust.filter(|&(time, _)| is_fresh(time));
        let commanded = match self.command {
            Command::AttitudeThrust { thrust_n, .. } | Command::ThrustTorque { thrust_n, .. } => {
                Some(thrust_n)
            }
            Command::Disarm | Command::Idle | Command::TiltClimb { .. } => None,
        };
        let thrust_n = reported.map(|(_, thrust_n)| thrust_n).or(commanded);
        self.descent.note_thrust(thrust_n, step_s);
    }

    /// On the ground nothing is released in flight and everything is forgotten.
    fn stand(&mut self, input: &GuardInput) {
        self.raw.observe_standing(input.batch);
        if input.state.is_finite() {
            self.ground_z_m = input.state.position_world().z;
        }
        self.watches = [Watch::default(); ALL.len()];
        self.latched = Fallback::None;
        self.disobeyed_since = None;
        self.landing_since = None;
        self.flow_expected_since = None;
        self.range_expected_since = None;
        self.report.fallback = Fallback::None;
        self.report.cause = None;
        self.descent.reset();
        self.ready = self.check_ready(input);
        self.command = match (input.mode, input.requested) {
            (FlightMode::Armed, Command::Disarm) => Command::Disarm,
            (FlightMode::Armed, _) => Command::Idle,
            _ => Command::Disarm,
        };
    }

    fn check_ready(&self, input: &GuardInput) -> Result<(), Violation> {
        let (raw, state) = (&self.raw, input.state);
        let arrives =
            |time: Option<Timestamp>| time.is_none_or(|_| raw.seconds_since(time) <= ARRIVING_S);
        let age_s = input.batch.now.seconds_since(state.time).abs();
        let rotation = &state.world_from_body.rotation;
        let up_body = rotation.inverse() * Vector3::z();
        let gap_deg = up_body.angle(&raw.up_body).to_degrees();
        let tilt_deg = so3::tilt_rad(rotation).to_degrees();
        let fence = &self.config.fence;
        let position = state.position_world();
        let inside = (0..3).all(|i| position[i] >= fence.min_m[i] && position[i] <= fence.max_m[i]);
        let findings = [
            (raw.imu_is_fresh(), Violation::ImuLost),
            (
                state.is_finite()
                    && state.health == EstimateHealth::Good
                    && age_s <= self.config.estimate.stale_s,
                Violation::EstimateStale,
            ),
            (gap_deg <= READY_GAP_DEG, Violation::EstimateInconsistent),
            (tilt_deg <= self.config.motion.tilt_deg, Violation::Tilt),
            (inside, Violation::Geofence),
            (arrives(raw.flow_arrived), Violation::FlowLost),
            (
                !self.needs_depth || raw.seconds_since(raw.depth()) <= ARRIVING_S,
                Violation::DepthLost,
            ),
            (
                arrives(raw.sonar.arrived) && arrives(raw.infrared.arrived),
                Violation::RangeLost,
            ),
        ];
        let wrong = findings.iter().find(|(good, _)| !good);
        wrong.map_or(Ok(()), |&(_, violation)| Err(violation))
    }

    fn fly(&mut self, input: &GuardInput, step_s: f64) {
        self.observe(input, step_s);
        let cause = self.check(input);
        self.decide(input, cause);
        self.command = self.choose(input, step_s);
    }

    fn observe(&mut self, input: &GuardInput, step_s: f64) {
        let state = input.state;
        let velocity_body = state.world_from_body.rotation.inverse() * state.velocity_world;
        self.raw.observe_flying(input.batch, &velocity_body);
        let free = matches!(input.mode, FlightMode::Hovering | FlightMode::Flying);
        if free && self.report.fallback <= Fallback::Hold && self.raw.imu_is_fresh() {
            self.descent.learn_hover(&self.raw, step_s);
        }
        let now = input.batch.now;
        let min_height_m = self.config.sensors.flow_min_height_m;
        keep_since(
            &mut self.flow_expected_since,
            flow_is_expected(input.mode, &self.raw, min_height_m),
            now,
        );
        keep_since(
            &mut self.range_expected_since,
            range_is_expected(input.mode, &self.raw),
            now,
        );
    }

    /// Runs all rules; the result is the finding that asks for the gravest fallback.
    fn check(&mut self, input: &GuardInput) -> (Fallback, Option<Finding>) {
        let now = input.batch.now;
        let elapsed_s = |since: Option<Timestamp>| since.map_or(0.0, |s| now.seconds_since(s));
        let view = View {
            config: &self.config,
            vehicle: &self.vehicle,
            now,
            mode: input.mode,
            state: input.state,
            state_is_finite: is_finite(input.state),
            requested: input.requested,
            raw: &self.raw,
            ground_z_m: self.ground_z_m,
            flow_expected_s: elapsed_s(self.flow_expected_since),
            range_expected_s: elapsed_s(self.range_expected_since),
            needs_depth: self.needs_depth,
            support: self.descent.support(&self.raw),
        };
        let mut gravest = (Fallback::None, None);
        let mut doubted = false;
        for ((check, watch), stages) in ALL.iter().zip(&mut self.watches).zip(&self.stages) {
            let found = check.find(&view);
            doubted |= found.is_some() && check.doubts_the_estimate();
            watch.update(now, found, stages, self.config.release_s);
            self.report.findings.extend(watch.finding());
            if watch.fallback() > gravest.0 {
                gravest = (watch.fallback(), watch.finding());
            }
        }
        if !doubted && self.raw.imu_is_calm() {
            self.descent.note_trusted(input.state, view.flow_gap_m_s());
        }
        gravest
    }

    fn decide(&mut self, input: &GuardInput, (asked, finding): (Fallback, Option<Finding>)) {
        let mut fallback = asked.max(self.latched);
        fallback = fallback.max(self.insist(fallback, input));
        if fallback == Fallback::Descend && self.descent.has_ended() {
            fallback = Fallback::Cut;
        }
        if fallback >= Fallback::Land {
            self.latched = fallback;
        }
        if asked > self.report.fallback {
            self.report.cause = finding;
        }
        if fallback == Fallback::None {
            self.report.cause = None;
        }
        self.report.fallback = fallback;
    }

    /// The next graver fallback when the flight modes do not obey the present one in time.
    fn insist(&mut self, fallback: Fallback, input: &GuardInput) -> Fallback {
        use FlightMode::{Flying, Landing, TakingOff};
        let now = input.batch.now;
        let (obeyed, next) = match fallback {
            Fallback::Hold => (!matches!(input.mode, TakingOff | Flying), Fallback::Land),
            Fallback::Land => (input.mode == Landing, Fallback::Descend),
            Fallback::None | Fallback::Descend | Fallback::Cut => (true, Fallback::None),
        };
        keep_since(&mut self.disobeyed_since, !obeyed, now);
        keep_since(&mut self.landing_since, fallback == Fallback::Land, now);
        let lasts = |since: Option<Timestamp>, limit_s: f64| {
            since.is_some_and(|since| now.seconds_since(since) >= limit_s)
        };
        if lasts(self.disobeyed_since, self.config.obey_s) {
            self.disobeyed_since = None;
            return next;
        }
        if lasts(self.landing_since, self.config.landing_limit_s) {
            return Fallback::Descend;
        }
        Fallback::None
    }

    /// What the vehicle gets. Motors that the controller wants to stop are never kept turning.
    fn choose(&mut self, input: &GuardInput, step_s: f64) -> Command {
        let requested = input.requested;
        if matches!(requested, Command::Disarm | Command::Idle) {
            return *requested;
        }
        match self.report.fallback {
            Fallback::Cut => Command::Disarm,
            Fallback::Descend => self
                .descent
                .fly(input.batch.now, step_s, &self.raw, requested),
            _ if command_excess(requested, &self.config.command, &self.vehicle).is_some() => {
                self.descent.level(&self.raw, requested)
            }
            Fallback::None | Fallback::Hold | Fallback::Land => *requested,
        }
    }
}

/// Keeps the time since when `holds` is true.
fn keep_since(since: &mut Option<Timestamp>, holds: bool, now: Timestamp) {
    *since = if holds { since.or(Some(now)) } else { None };
}
