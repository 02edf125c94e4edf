//! A flight in closed loop: the stack commands a simulated vehicle and the vehicle answers.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use alula_geometry::{Pose, Timestamp};
use alula_messages::{Hindrance, Mount, SensorBatch, StackOutput, Vehicle};
use alula_record::{Header, LogLevel, Recorder, TruthRecord, depth_camera_frame};
use alula_sim::world::World;
use alula_sim::{Collision, SimulatedVehicle};
use alula_stack::{Stack, Stage};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::belief::BeliefLog;
use crate::encounters::{Contact, Encounters};
use crate::failure;
use crate::flight_log::{EstimationErrors, FlightLog};
use crate::mission::Mission;
use crate::scenario::StateSource;
use crate::scene;
use crate::timing::{Distribution, Stopwatch};
use crate::{RunError, Scenario, VERSION};

/// The flight goes on for this long after the motors stopped, s.
const AFTERMATH_S: f64 = 0.5;

/// A mission that asked in vain for this long is given up, s.
const REFUSED_S: f64 = 10.0;

/// How a flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Every waypoint was flown and the vehicle landed.
    Reached,
    /// The vehicle hit something.
    Collision,
    /// The time limit passed.
    Timeout,
    /// The mission ended early: the guard landed the vehicle, or requests were refused.
    Aborted,
}

impl Outcome {
    /// The word of the JSON output.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::Collision => "collision",
            Self::Timeout => "timeout",
            Self::Aborted => "aborted",
        }
    }
}

/// The figures of a flight: the JSON object of `alula fly`.
#[derive(Clone, Debug, Serialize)]
pub struct FlightSummary {
    /// Name of the scenario.
    pub scenario: String,
    /// How it ended.
    pub outcome: Outcome,
    /// Why, in words.
    pub reason: String,
    /// What stopped the flight, a stable word for tables; `None` if it reached its end.
    pub failure: Option<String>,
    /// Simulated time, s.
    pub duration_s: f64,
    /// True length of the path while airborne, m.
    pub path_length_m: f64,
    /// Greatest true speed, m/s.
    pub max_speed_m_s: f64,
    /// Least true distance from the vehicle's surface to the nearest thing, m.
    pub min_clearance_m: Option<f64>,
    /// Number of collisions; the first ends the flight.
    pub collisions: u32,
    /// Least true distance from the vehicle's centre to a person's ellipsoid while it flew, m.
    pub min_person_distance_m: Option<f64>,
    /// People who came nearer than allowed.
    pub contacts: Vec<Contact>,
    /// Those of them who came from outside the field of view.
    pub unseen_contacts: u32,
    /// Longest time of the way through the waypoints without leaving a ball of half a metre, s.
    pub stalled_s: f64,
    /// True horizontal distance from the take-off point at the end, m.
    pub landing_distance_m: f64,
    /// Root mean square distance of the true position from the reference along the waypoints, m.
    pub tracking_rmse_m: f64,
    /// The gravest thing that the guard did.
    pub guard: alula_messages::Fallback,
    /// Errors of the estimate.
    pub estimation: EstimationErrors,
    /// Simulated over real time.
    pub real_time_factor: f64,
    /// Durations of the parts of a step, ms.
    pub timing_ms: BTreeMap<&'static str, Distribution>,
    /// Seed of everything random.
    pub seed: u64,
    /// Version of the program.
    pub version: &'static str,
}

/// A flight that is over.
#[derive(Clone, Debug)]
pub struct Flight {
    /// Its figures.
    pub summary: FlightSummary,
    /// Its story.
    pub log: FlightLog,
    /// What was believed in it; empty if it was not recorded.
    pub belief: BeliefLog,
    /// Where it took place.
    pub world: Arc<World>,
}

/// What can be told about a flight under way.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Simulated time, s.
    pub t_s: f64,
    /// What the sensors delivered in this step.
    pub batch: &'a SensorBatch,
    /// The last output of the stack.
    pub output: &'a StackOutput,
    /// The true velocity, world, m/s.
    pub velocity_world: Vector3<f64>,
    /// The true pose.
    pub world_from_body: Pose,
}

/// What to write to a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum RecordTo {
    /// No recording.
    #[default]
    Nothing,
    /// A file.
    File(PathBuf),
}

/// Flies a scenario. `watch` is called once for every step.
///
/// # Errors
/// When the scenario cannot be flown or its recording cannot be written.
pub fn fly(
    scenario: &Scenario,
    seed: u64,
    record_to: &RecordTo,
    watch: &mut dyn FnMut(&Progress),
) -> Result<Flight, RunError> {
    let world = scenario.build_world(seed)?;
    let vehicle = scenario.build_vehicle(Arc::clone(&world), seed)?;
    let tape = match record_to {
        RecordTo::Nothing => None,
        RecordTo::File(path) => Some(Tape::start(path, scenario, seed, &world)?),
    };
    Run::new(scenario, seed, world, vehicle, tape)?.complete(watch)
}

/// A flight under way.
struct Run<'a> {
    scenario: &'a Scenario,
    seed: u64,
    world: Arc<World>,
    vehicle: SimulatedVehicle,
    stack: Stack,
    mission: Mission,
    tape: Option<Tape>,
    log: FlightLog,
    stopwatch: Stopwatch,
    batch: SensorBatch,
    /// Since when every request has been refused.
    refused_since: Option<Timestamp>,
    encounters: Encounters,
    /// The last thing that kept it from advancing, and when.
    hindrance: Option<(Hindrance, Timestamp)>,
}

impl<'a> Run<'a> {
    fn new(
        scenario: &'a Scenario,
        seed: u64,
        world: Arc<World>,
        vehicle: SimulatedVehicle,
        tape: Option<Tape>,
    ) -> Result<Self, RunError> {
        let simulation = &scenario.config().simulation;
        Ok(Self {
            encounters: Encounters::new(
                simulation.contact_distance_m,
                simulation.sensors.depth_cameras().map(|(_, setup)| setup),
            ),
            hindrance: None,
            scenario,
            seed,
            world,
            vehicle,
            stack: scenario.build_stack()?,
            mission: Mission::new(&scenario.config().mission),
            tape,
            log: FlightLog::default(),
            stopwatch: Stopwatch::default(),
            batch: SensorBatch::default(),
            refused_since: None,
        })
    }

    fn complete(mut self, watch: &mut dyn FnMut(&Progress)) -> Result<Flight, RunError> {
        let clock = std::time::Instant::now();
        let mut ending: Option<(Outcome, String, Timestamp)> = None;
        loop {
            self.step()?;
            watch(&Progress {
                t_s: self.batch.now.as_s(),
                batch: &self.batch,
                output: self.stack.output(),
                velocity_world: self.vehicle.truth().velocity_world,
                world_from_body: self.vehicle.truth().world_from_body,
            });
            if ending.is_none() {
                ending = self
                    .verdict()
                    .map(|(outcome, reason)| (outcome, reason, self.batch.now));
            }
            let over = ending
                .as_ref()
                .is_some_and(|(_, _, since)| self.batch.now.seconds_since(*since) >= AFTERMATH_S);
            if over {
                break;
            }
        }
        let wall_s = clock.elapsed().as_secs_f64();
        // The loop ends only after a verdict.
        let (outcome, reason, _) =
            ending.unwrap_or((Outcome::Aborted, String::new(), self.batch.now));
        self.finish(outcome, reason, wall_s)
    }

    /// One control period: sense, decide, command, and write it all down.
    fn step(&mut self) -> Result<(), RunError> {
        if let Some(intent) = self.mission.next(self.stack.output()) {
            self.stack.request(intent);
        }
        self.stopwatch.start();
        self.vehicle.sense(&mut self.batch)?;
        self.stopwatch.lap("simulation");
        self.decide();
        self.vehicle.command(&self.stack.output().command)?;
        self.note_refusals();
        self.note_hindrance();
        let truth = true_record(&self.vehicle);
        self.log.push(self.stack.output(), &truth);
        self.note_encounters(&truth);
        if let Some(tape) = &mut self.tape {
            tape.write(&self.batch, &self.stack, &truth, &self.world, &self.log)?;
        }
        self.stopwatch.lap("recording");
        Ok(())
    }

    fn decide(&mut self) {
        let stopwatch = &mut self.stopwatch;
        let mut done = |stage: Stage| stopwatch.lap(stage.name());
        match self.scenario.config().simulation.state {
            StateSource::Estimated => self.stack.update_watched(&self.batch, &mut done),
            StateSource::Truth => {
                let state = self.vehicle.truth().as_estimate(self.batch.now);
                self.stack.update_with_state(&self.batch, &state, &mut done)
            }
        };
    }

    fn note_refusals(&mut self) {
        let output = self.stack.output();
        if output.requests.iter().any(|(_, refusal)| refusal.is_some()) {
            self.refused_since.get_or_insert(output.time);
        } else if !output.requests.is_empty() {
            self.refused_since = None;
        }
    }

    fn note_hindrance(&mut self) {
        let output = self.stack.output();
        if let Some(hindrance) = output.hindrance {
            self.hindrance = Some((hindrance, output.time));
        }
    }

    fn note_encounters(&mut self, truth: &TruthRecord) {
        let airborne = self.log.airborne() && !self.vehicle.truth().on_ground;
        let pose = &truth.world_from_body;
        self.encounters
            .push(&self.world, truth.time, pose, airborne);
    }

    /// Whether the flight is over, how and why.
    fn verdict(&self) -> Option<(Outcome, String)> {
        let now = self.batch.now;
        let limit_s = self.scenario.config().simulation.time_limit_s;
        if let Some(what) = self.vehicle.collision() {
            return Some((Outcome::Collision, describe_collision(what)));
        }
        if self.mission.step() == crate::mission::Step::Done {
            return Some(if self.mission.succeeded() {
                (Outcome::Reached, "all waypoints flown, landed".to_owned())
            } else {
                (Outcome::Aborted, self.reason_of_abort())
            });
        }
        if self
            .refused_since
            .is_some_and(|since| now.seconds_since(since) > REFUSED_S)
        {
            return Some((Outcome::Aborted, self.reason_of_abort()));
        }
        (now.as_s() >= limit_s)
            .then(|| (Outcome::Timeout, format!("not finished after {limit_s} s")))
    }

    fn reason_of_abort(&self) -> String {
        if let Some((hindrance, at)) = self.mission.gave_up() {
            return format!("gave up at {:.1} s: {}", at.as_s(), hindrance.describe());
        }
        let event = failure::grave_event(&self.log);
        event.map_or("the mission ended early".to_owned(), |event| {
            format!("{} at {:.1} s", event.describe(), event.t_s)
        })
    }

    /// What stopped the flight, in one word.
    fn failure(&self, outcome: Outcome) -> Option<String> {
        let word = match outcome {
            Outcome::Reached => return None,
            Outcome::Collision => {
                failure::of_collision(self.vehicle.collision(), &self.encounters).to_owned()
            }
            Outcome::Timeout => {
                failure::of_timeout(self.hindrance, self.batch.now, &self.log).to_owned()
            }
            Outcome::Aborted => failure::of_abort(self.mission.gave_up(), &self.log),
        };
        Some(word)
    }

    fn finish(self, outcome: Outcome, reason: String, wall_s: f64) -> Result<Flight, RunError> {
        let failure = self.failure(outcome);
        let mut belief = BeliefLog::default();
        if let Some(tape) = self.tape {
            tape.recorder.finish()?;
            belief = tape.belief;
        }
        let duration_s = self.batch.now.as_s();
        let log = self.log;
        let summary = FlightSummary {
            scenario: self.scenario.config().name.clone(),
            outcome,
            reason,
            failure,
            duration_s,
            path_length_m: log.path_length_m,
            max_speed_m_s: log.max_speed_m_s,
            min_clearance_m: log.min_clearance_m,
            collisions: u32::from(outcome == Outcome::Collision),
            min_person_distance_m: self.encounters.min_distance_m(),
            unseen_contacts: self.encounters.unseen(),
            contacts: self.encounters.contacts().to_vec(),
            stalled_s: log.stalled_s,
            landing_distance_m: log.distance_from_start_m(),
            tracking_rmse_m: log.tracking_rmse_m(),
            guard: log.worst_fallback,
            estimation: log.estimation_errors(),
            real_time_factor: duration_s / wall_s,
            timing_ms: self.stopwatch.distributions(),
            seed: self.seed,
            version: VERSION,
        };
        Ok(Flight {
            summary,
            log,
            belief,
            world: self.world,
        })
    }
}

/// A recording that is being written.
struct Tape {
    recorder: Recorder,
    belief: BeliefLog,
    events_written: usize,
    /// Memory for a U-depth map.
    u_depth: Vec<u16>,
}

impl Tape {
    fn start(path: &Path, scenario: &Scenario, seed: u64, world: &World) -> Result<Self, RunError> {
        let header = Header {
            config_toml: scenario.resolved_text()?,
            scenario_name: scenario.config().name.clone(),
            seed,
            version: VERSION.to_owned(),
        };
        let mut recorder = Recorder::create(path, &header)?;
        recorder.write_scene(&scene::static_shapes(world));
        for (name, mount) in mounts(scenario) {
            recorder.write_mount(Timestamp::ZERO, name, &mount.body_from_sensor())?;
        }
        Ok(Self {
            recorder,
            belief: BeliefLog::default(),
            events_written: 0,
            u_depth: Vec::new(),
        })
    }

    fn write(
        &mut self,
        batch: &SensorBatch,
        stack: &Stack,
        truth: &TruthRecord,
        world: &World,
        log: &FlightLog,
    ) -> Result<(), RunError> {
        let output = stack.output();
        self.recorder.write_batch(batch)?;
        self.recorder.write_output(output)?;
        self.write_u_depth(stack)?;
        self.recorder.write_truth(truth)?;
        self.belief.push(batch, output, truth, world);
        self.recorder
            .write_people(batch.now, scene::people(world, batch.now))?;
        for event in &log.events[self.events_written..] {
            self.recorder
                .write_log(batch.now, LogLevel::Info, &event.describe())?;
        }
        self.events_written = log.events.len();
        Ok(())
    }

    /// The map of the image that was looked at in this step; the recorder takes five a second.
    fn write_u_depth(&mut self, stack: &Stack) -> Result<(), RunError> {
        let Some(avoidance) = stack
            .avoidance()
            .filter(|_| stack.output().seen_at.is_some())
        else {
            return Ok(());
        };
        let map = avoidance.detector().u_depth();
        self.u_depth.clear();
        // The nearest bin holds the pixels without a return as well.
        self.u_depth.resize(map.columns, 0);
        for bin in 1..map.bins {
            self.u_depth.extend_from_slice(map.row(bin));
        }
        let time = stack.output().time;
        let (columns, bins) = (map.columns, map.bins);
        self.recorder
            .write_u_depth(time, columns, bins, &self.u_depth)?;
        Ok(())
    }
}

/// The sensors of a scenario and how they are fixed to the body.
fn mounts(scenario: &Scenario) -> Vec<(&'static str, &Mount)> {
    let sensors = &scenario.config().simulation.sensors;
    let depth_cameras = sensors
        .depth_cameras()
        .map(|(sensor, setup)| (depth_camera_frame(sensor), Some(&setup.mount)));
    [
        ("flow_camera", sensors.flow.as_ref().map(|s| &s.mount)),
        ("sonar", sensors.sonar.as_ref().map(|s| &s.mount)),
        ("infrared", sensors.infrared.as_ref().map(|s| &s.mount)),
    ]
    .into_iter()
    .chain(depth_cameras)
    .filter_map(|(name, mount)| mount.map(|mount| (name, mount)))
    .collect()
}

fn true_record(vehicle: &SimulatedVehicle) -> TruthRecord {
    let truth = vehicle.truth();
    TruthRecord {
        time: truth.time,
        world_from_body: truth.world_from_body,
        velocity_world: truth.velocity_world,
        clearance_m: vehicle.clearance().map(|c| c.distance_m),
    }
}

fn describe_collision(collision: &Collision) -> String {
    match collision {
        Collision::Contact { time, what, .. } => format!("hit {what} at {time}"),
        Collision::HardLanding { time, speed_m_s } => {
            format!("hit the ground at {speed_m_s:.1} m/s at {time}")
        }
        Collision::RotorStrike { time, tilt_rad } => {
            format!(
                "a rotor met the ground at {time}, tilted {:.0} degrees",
                tilt_rad.to_degrees()
            )
        }
    }
}
