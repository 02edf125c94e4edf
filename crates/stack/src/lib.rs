//! The stack: estimation, modes, guidance, control and the guard in a fixed order, one step for
//! every batch of sensor data. It is pure: time comes with the data, and equal inputs give equal
//! bits.

mod avoidance;
mod config;
mod ground_range;
mod guide;

pub use avoidance::{Avoidance, AvoidanceConfig, ConductConfig};
pub use config::{BodyConfig, EstimationConfig, StackConfig};
pub use guide::{Guide, GuideConfig};

use alula_control::geometric::GeometricController;
use alula_control::modes::{FlightModes, Progress, Situation};
use alula_estimation::Estimator;
use alula_geometry::Timestamp;
use alula_messages::{
    Command, FlightMode, GuardReport, Intent, NavState, Refusal, SensorBatch, StackOutput,
};
use alula_parameters::ParameterError;
use alula_safety::{Guard, GuardInput};

use avoidance::Lead;
use ground_range::GroundRange;

/// A part of a step, for those who measure how long each takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Sensor data to state.
    Estimation,
    /// Depth images to obstacles.
    Perception,
    /// Requests, modes and the reference.
    Guidance,
    /// Reference and state to a command.
    Control,
    /// The last word.
    Guard,
}

impl Stage {
    /// All stages in the order in which they run.
    pub const ALL: [Self; 5] = [
        Self::Estimation,
        Self::Perception,
        Self::Guidance,
        Self::Control,
        Self::Guard,
    ];

    /// Name for tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Estimation => "estimation",
            Self::Perception => "perception",
            Self::Guidance => "guidance",
            Self::Control => "control",
            Self::Guard => "guard",
        }
    }
}

/// The guidance stack of one vehicle.
pub struct Stack {
    estimator: Box<dyn Estimator>,
    modes: FlightModes,
    guide: Guide,
    avoidance: Option<Avoidance>,
    controller: GeometricController,
    guard: Guard,
    ground_range: GroundRange,
    thrust_fraction: f64,
    take_off_height_m: f64,
    requests: Vec<Intent>,
    last_time: Option<Timestamp>,
    output: StackOutput,
}

impl Stack {
    /// A stack on the ground with its motors off.
    ///
    /// # Errors
    /// When a parameter is outside its range.
    pub fn new(config: &StackConfig) -> Result<Self, ParameterError> {
        let mut guard =
            Guard::new(&config.guard, &config.body.for_guard()).map_err(|e| e.under("guard"))?;
        if config.avoidance.is_some() {
            guard.expect_depth();
        }
        let mut output = StackOutput::default();
        // The first findings of a flight must not wait for memory, nor may what is seen in it.
        output
            .guard
            .findings
            .reserve(guard.report().findings.capacity());
        Ok(Self {
            estimator: config
                .estimation
                .build()
                .map_err(|e| e.under("estimation"))?,
            modes: FlightModes::new(&config.modes).map_err(|e| e.under("modes"))?,
            guide: Guide::new(&config.guide).map_err(|e| e.under("guide"))?,
            avoidance: match &config.avoidance {
                Some(avoidance) => {
                    let part = Avoidance::new(avoidance).map_err(|e| e.under("avoidance"))?;
                    let tracker = &avoidance.tracker;
                    output.detections.reserve(tracker.max_detections);
                    output.obstacles.reserve(tracker.max_tracks);
                    Some(part)
                }
                None => None,
            },
            controller: GeometricController::new(&config.control, &config.body.for_control())
                .map_err(|e| e.under("control"))?,
            guard,
            ground_range: GroundRange::default(),
            thrust_fraction: 0.0,
            take_off_height_m: 0.0,
            requests: Vec::new(),
            last_time: None,
            output,
        })
    }

    /// Queues a request for the next step.
    pub fn request(&mut self, intent: Intent) {
        self.requests.push(intent);
    }

    /// The result of the last step.
    pub fn output(&self) -> &StackOutput {
        &self.output
    }

    /// The part that sees and avoids, if there is one.
    pub fn avoidance(&self) -> Option<&Avoidance> {
        self.avoidance.as_ref()
    }

    /// One step: everything that follows from a batch of sensor data.
    pub fn update(&mut self, batch: &SensorBatch) -> &StackOutput {
        self.update_watched(batch, &mut |_| {})
    }

    /// As [`Self::update`], and calls `done` at the end of each stage.
    pub fn update_watched(
        &mut self,
        batch: &SensorBatch,
        done: &mut dyn FnMut(Stage),
    ) -> &StackOutput {
        self.estimator.update(batch, self.output.mode);
        self.output.state.clone_from(self.estimator.state());
        self.output.fusions.clear();
        self.output
            .fusions
            .extend_from_slice(self.estimator.fusions());
        done(Stage::Estimation);
        self.decide(batch, done)
    }

    /// One step of a vehicle that delivers its own state, for example by motion capture.
    pub fn update_with_state(
        &mut self,
        batch: &SensorBatch,
        state: &NavState,
        done: &mut dyn FnMut(Stage),
    ) -> &StackOutput {
        self.output.state.clone_from(state);
        self.output.fusions.clear();
        done(Stage::Estimation);
        self.decide(batch, done)
    }

    /// Everything after estimation.
    fn decide(&mut self, batch: &SensorBatch, done: &mut dyn FnMut(Stage)) -> &StackOutput {
        self.output.time = batch.now;
        self.observe(batch);
        self.perceive(batch);
        done(Stage::Perception);
        self.handle_requests();
        self.advance_mode();
        self.lead();
        done(Stage::Guidance);
        self.control();
        done(Stage::Control);
        self.protect(batch);
        done(Stage::Guard);
        self.last_time = Some(batch.now);
        &self.output
    }

    /// Keeps what the modes need of the raw data.
    fn observe(&mut self, batch: &SensorBatch) {
        let ranges = if batch.infrared.is_empty() {
            &batch.sonar
        } else {
            &batch.infrared
        };
        for sample in ranges {
            self.ground_range.take(sample);
        }
        if let Some(status) = batch.autopilot.last() {
            self.thrust_fraction = status.thrust_fraction;
        }
    }

    fn perceive(&mut self, batch: &SensorBatch) {
        if let Some(avoidance) = &mut self.avoidance {
            avoidance.observe(batch, &mut self.output);
        }
    }

    fn handle_requests(&mut self) {
        self.output.requests.clear();
        for intent in std::mem::take(&mut self.requests) {
            let refusal = self.handle(&intent).err();
            self.output.requests.push((intent, refusal));
        }
    }

    fn handle(&mut self, intent: &Intent) -> Result<(), Refusal> {
        if *intent == Intent::Arm && self.guard.ready().is_err() {
            return Err(Refusal::GuardActive);
        }
        self.request_of_modes(intent)?;
        match intent {
            Intent::TakeOff { height_m } => self.take_off_height_m = *height_m,
            Intent::Fly { waypoints_world } if self.avoidance.is_some() => {
                if let Some(avoidance) = &mut self.avoidance {
                    avoidance.fly(waypoints_world);
                }
            }
            Intent::Fly { waypoints_world } => {
                let now = self.output.time;
                let planned = self
                    .guide
                    .plan_through(now, &self.output.state, waypoints_world);
                match planned {
                    Ok(trajectory) => self.guide.follow(trajectory, now),
                    Err(_) => {
                        self.request_of_modes(&Intent::Hold)?;
                        return Err(Refusal::NoTrajectory);
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn request_of_modes(&mut self, intent: &Intent) -> Result<(), Refusal> {
        let situation = situation(
            &self.output,
            self.progress(),
            self.ground_range,
            self.thrust_fraction,
        );
        self.modes.request(intent, &situation)
    }

    fn advance_mode(&mut self) {
        let situation = situation(
            &self.output,
            self.progress(),
            self.ground_range,
            self.thrust_fraction,
        );
        let mode = self.modes.update(&situation);
        if mode != self.output.mode && !self.output.mode.is_airborne() {
            self.controller.reset();
        }
        let now = self.output.time;
        self.guide
            .enter(mode, now, &self.output.state, self.take_off_height_m);
        self.output.mode = mode;
    }

    /// Decides who says where the vehicle should be, and asks.
    fn lead(&mut self) {
        let now = self.output.time;
        if let Some(avoidance) = &mut self.avoidance {
            match avoidance.advance(&mut self.output, self.guide.hover()) {
                Lead::Guide => {}
                Lead::Follow(reference) => self.guide.be_led(reference),
                Lead::Return(hover) => self.guide.return_to(&hover, now),
                Lead::Over => self.guide.brake(now, &self.output.state),
            }
        }
        self.output.reference = self.guide.reference(now);
    }

    /// How far the vehicle is on its way, whoever leads.
    fn progress(&self) -> Progress {
        match &self.avoidance {
            Some(avoidance) if avoidance.is_flying() => Progress::Running,
            _ => self.guide.progress(self.output.time),
        }
    }

    fn control(&mut self) {
        let dt_s = self
            .last_time
            .map_or(0.0, |last| self.output.time.seconds_since(last));
        self.output.requested = match (self.output.mode, &self.output.reference) {
            (FlightMode::Armed, _) => Command::Idle,
            (_, Some(reference)) => self
                .controller
                .update(&self.output.state, reference, dt_s)
                .attitude_thrust_command(),
            (_, None) => Command::Disarm,
        };
    }

    fn protect(&mut self, batch: &SensorBatch) {
        self.guard.update(&GuardInput {
            batch,
            state: &self.output.state,
            mode: self.output.mode,
            requested: &self.output.requested,
        });
        self.output.command = self.guard.command();
        copy_report(&mut self.output.guard, self.guard.report());
    }
}

/// Copies a report into the memory of an earlier one.
fn copy_report(target: &mut GuardReport, report: &GuardReport) {
    let GuardReport {
        fallback,
        cause,
        findings,
    } = report;
    target.fallback = *fallback;
    target.cause = *cause;
    target.findings.clone_from(findings);
}

fn situation<'a>(
    output: &'a StackOutput,
    trajectory: Progress,
    ground_range: GroundRange,
    thrust_fraction: f64,
) -> Situation<'a> {
    Situation {
        time: output.time,
        state: &output.state,
        height_above_ground_m: ground_range.height_m(&output.state, output.time),
        thrust_fraction,
        trajectory,
        guard: output.guard.fallback,
    }
}
