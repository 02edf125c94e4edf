//! Running the stack again over a recording, and finding the first difference.

use std::fmt::Debug;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use alula_messages::{SensorBatch, StackOutput};
use alula_record::{Event, Recording};
use alula_sim::world::World;
use alula_stack::Stack;
use serde::Serialize;

use crate::belief::BeliefLog;
use crate::config::ConfigText;
use crate::flight_log::FlightLog;
use crate::scenario::StateSource;
use crate::{RunError, Scenario};

/// The first place where a replay departs from its recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Time of the step, ns.
    pub time_ns: i64,
    /// Number of the step, from 0.
    pub step: usize,
    /// What differs.
    pub field: &'static str,
    /// As recorded.
    pub recorded: String,
    /// As replayed.
    pub replayed: String,
}

/// What a replay found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ReplayReport {
    /// The recording.
    pub file: PathBuf,
    /// Name of its scenario.
    pub scenario: String,
    /// Its seed.
    pub seed: u64,
    /// Version that recorded it.
    pub recorded_version: String,
    /// Steps that were compared.
    pub steps: usize,
    /// The first difference, if there is one.
    pub first_difference: Option<Difference>,
    /// Places where the recording is not whole.
    pub damage: Vec<String>,
}

/// Replays a recording. `overrides` are `key=value` changes to its configuration: with them, the
/// replay shows what the stack would have done.
///
/// # Errors
/// When the recording cannot be read, or its configuration was changed after the flight.
pub fn replay(path: &Path, overrides: &[String]) -> Result<ReplayReport, RunError> {
    let recording = Recording::open(path)?;
    let header = recording.header().clone();
    let scenario = recorded_scenario(path, &header.config_toml, overrides)?;
    let mut rerun = Rerun::new(&scenario)?;
    let mut report = ReplayReport {
        file: path.to_path_buf(),
        scenario: header.scenario_name,
        seed: header.seed,
        recorded_version: header.version,
        steps: 0,
        first_difference: None,
        damage: Vec::new(),
    };
    for event in recording {
        match event? {
            Event::Batch(batch) => rerun.batch = Some(batch),
            Event::Output(recorded) => {
                let Some(batch) = rerun.batch.take() else {
                    continue;
                };
                let replayed = rerun.step(&batch, &recorded);
                report.first_difference = first_difference(report.steps, &recorded, replayed);
                report.steps += 1;
            }
            Event::Damage(damage) => report.damage.push(damage.to_string()),
            Event::Truth(_) | Event::Log(_) => {}
        }
        if report.first_difference.is_some() {
            break;
        }
    }
    Ok(report)
}

/// A stack that is fed what a recorded one was fed.
struct Rerun {
    stack: Stack,
    state: StateSource,
    batch: Option<SensorBatch>,
}

impl Rerun {
    fn new(scenario: &Scenario) -> Result<Self, RunError> {
        let state = scenario.config().simulation.state;
        Ok(Self {
            stack: scenario.build_stack()?,
            state,
            batch: None,
        })
    }

    fn step(&mut self, batch: &SensorBatch, recorded: &StackOutput) -> &StackOutput {
        for (intent, _) in &recorded.requests {
            self.stack.request(intent.clone());
        }
        match self.state {
            StateSource::Estimated => self.stack.update(batch),
            StateSource::Truth => self
                .stack
                .update_with_state(batch, &recorded.state, &mut |_| {}),
        }
    }
}

/// The scenario in a recording's header, with overrides.
fn recorded_scenario(
    path: &Path,
    config_toml: &str,
    overrides: &[String],
) -> Result<Scenario, RunError> {
    let text = ConfigText {
        file: format!("the configuration in {}", path.display()),
        text: config_toml.to_owned(),
    };
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    Scenario::parse(text.with_overrides(overrides)?, folder)
}

/// The first field in which two outputs differ.
fn first_difference(
    step: usize,
    recorded: &StackOutput,
    replayed: &StackOutput,
) -> Option<Difference> {
    if recorded == replayed {
        return None;
    }
    let (a, b) = (recorded, replayed);
    let fields = [
        field("time", &a.time, &b.time),
        field("estimate: health", &a.state.health, &b.state.health),
        field(
            "estimate: pose",
            &a.state.world_from_body,
            &b.state.world_from_body,
        ),
        field(
            "estimate: velocity",
            &a.state.velocity_world,
            &b.state.velocity_world,
        ),
        field(
            "estimate: covariance",
            &a.state.covariance,
            &b.state.covariance,
        ),
        field("estimate", &a.state, &b.state),
        field("fusions", &a.fusions, &b.fusions),
        field("requests", &a.requests, &b.requests),
        field("time of the image", &a.seen_at, &b.seen_at),
        field("detections", &a.detections, &b.detections),
        field("obstacles", &a.obstacles, &b.obstacles),
        field("plan", &a.plan, &b.plan),
        field("hindrance", &a.hindrance, &b.hindrance),
        field("mode", &a.mode, &b.mode),
        field("reference", &a.reference, &b.reference),
        field("requested command", &a.requested, &b.requested),
        field("guard", &a.guard, &b.guard),
        field("command", &a.command, &b.command),
    ];
    let (name, recorded, replayed) = fields.into_iter().flatten().next()?;
    Some(Difference {
        time_ns: b.time.as_ns(),
        step,
        field: name,
        recorded: shortened(recorded),
        replayed: shortened(replayed),
    })
}

/// Both values as text, if they differ. Text tells apart all numbers but finds NaN equal to NaN.
fn field<T: Debug>(
    name: &'static str,
    recorded: &T,
    replayed: &T,
) -> Option<(&'static str, String, String)> {
    let (recorded, replayed) = (format!("{recorded:?}"), format!("{replayed:?}"));
    (recorded != replayed).then_some((name, recorded, replayed))
}

fn shortened(text: String) -> String {
    const LONGEST: usize = 300;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text,
    }
}

/// A recorded flight, ready to be drawn.
pub struct RecordedFlight {
    /// Its scenario.
    pub scenario: Scenario,
    /// Its seed.
    pub seed: u64,
    /// Its story; without recorded truth, the estimate stands in for it.
    pub log: FlightLog,
    /// What was believed in it.
    pub belief: BeliefLog,
    /// Where it took place.
    pub world: Arc<World>,
    /// Places where the recording is not whole.
    pub damage: Vec<String>,
}

/// Reads a recorded flight.
///
/// # Errors
/// When the recording cannot be read, or its configuration was changed after the flight.
pub fn read_flight(path: &Path) -> Result<RecordedFlight, RunError> {
    let recording = Recording::open(path)?;
    let seed = recording.header().seed;
    let scenario = recorded_scenario(path, &recording.header().config_toml, &[])?;
    let world = scenario.build_world(seed)?;
    let mut log = FlightLog::default();
    let mut belief = BeliefLog::default();
    let mut damage = Vec::new();
    let mut batch = SensorBatch::default();
    let mut output = None;
    for event in recording {
        match event? {
            Event::Output(next) => output = Some(next),
            Event::Truth(truth) => {
                if let Some(output) = output.take() {
                    log.push(&output, &truth);
                    belief.push(&batch, &output, &truth, &world);
                }
            }
            Event::Damage(found) => damage.push(found.to_string()),
            Event::Batch(next) => batch = next,
            Event::Log(_) => {}
        }
    }
    Ok(RecordedFlight {
        scenario,
        seed,
        log,
        belief,
        world,
        damage,
    })
}
