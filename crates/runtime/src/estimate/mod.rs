//! Estimators over flights that were recorded before, judged against the truth where it is known.

mod euroc;
mod judge;
mod recording;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use alula_geometry::{Pose, Timestamp};
use alula_messages::{FlightMode, NavState, PoseSample, SensorBatch};
use alula_parameters::{Parameters, parameters};
use alula_stack::EstimationConfig;
use nalgebra::Vector3;
use serde::Serialize;

use crate::RunError;
use crate::timing::{Distribution, Stopwatch};

pub use judge::{AlignTo, Errors};

parameters! {
    /// How external poses reach the estimator (document O, sections 2.4.3 and 2.4.4).
    pub struct PoseFeed {
        /// Poses per second; all of the log if absent.
        pub rate_hz: Option<f64> = None, within(0.1, 1000.0);
        /// Time from measurement to arrival, s.
        pub delay_s: f64 = 0.0, within(0.0, 2.0);
        /// Losses: pairs of start after the first sample and duration, s.
        pub outages_s: Vec<[f64; 2]> = Vec::new(), within(0.0, 1e6);
        /// Share of poses that are lost at random.
        pub loss_share: f64 = 0.0, within(0.0, 0.95);
    }
}

/// What to estimate from which log.
#[derive(Clone, Debug)]
pub struct Job {
    /// A EuRoC folder or an alula recording.
    pub log: PathBuf,
    /// Name of the estimator; that of the recording, or `pose-imu`, if absent.
    pub estimator: Option<String>,
    /// A TUM trajectory in place of the log's own truth: of the body, or of the IMU in a EuRoC folder.
    pub truth: Option<PathBuf>,
    /// How external poses reach the estimator.
    pub poses: PoseFeed,
    /// Alignment before position errors are taken; chosen by the estimator if absent.
    pub align: Option<AlignTo>,
    /// Duration of the pieces whose relative errors are taken, s.
    pub rpe_delta_s: f64,
    /// Seed of noise and losses where sensor data are made from truth.
    pub seed: u64,
    /// `key=value` changes to the configuration of the estimation.
    pub overrides: Vec<String>,
}

/// The true motion at an instant.
#[derive(Clone, Copy, Debug)]
pub struct TrueMotion {
    /// The instant.
    pub time: Timestamp,
    /// Pose of the body in the world.
    pub world_from_body: Pose,
    /// Velocity, world frame, m/s; not in every log.
    pub velocity_world: Option<Vector3<f64>>,
}

impl TrueMotion {
    /// The pose alone.
    pub fn pose_sample(&self) -> PoseSample {
        PoseSample {
            time: self.time,
            sensor: 0,
            world_from_body: self.world_from_body,
        }
    }
}

/// A log in the shape that an estimator takes.
pub(crate) struct Feed {
    /// What arrived, period by period, with the mode of flight.
    pub steps: Vec<(SensorBatch, FlightMode)>,
    /// The truth, in order of time.
    pub truth: Vec<TrueMotion>,
    /// The estimator and its configuration.
    pub estimation: EstimationConfig,
    /// What a reader of the results must know.
    pub notes: Vec<String>,
}

/// The figures of an estimation: the JSON object of `alula estimate`.
#[derive(Clone, Debug, Serialize)]
pub struct EstimationReport {
    /// Name of the estimator.
    pub estimator: String,
    /// The log.
    pub log: PathBuf,
    /// Inertial samples.
    pub samples: usize,
    /// Share of the log for which there is an estimate.
    pub completed_fraction: f64,
    /// Measurements that met the filter.
    pub measurements: usize,
    /// Measurements that were rejected, by reason. Those of the phase are not trusted near the
    /// ground.
    pub rejected: BTreeMap<&'static str, usize>,
    /// Parts of the state that nothing observed at the end.
    pub unobserved: Vec<&'static str>,
    /// Greatest step of the estimated position beyond what its velocity explains, m.
    pub max_jump_m: f64,
    /// Errors against the truth, where it is known.
    #[serde(flatten)]
    pub errors: Option<Errors>,
    /// Duration of an update, ms.
    pub timing_ms: Distribution,
    /// What a reader must know: data made from truth, damage, oddities.
    pub notes: Vec<String>,
}

/// An estimation that is over.
#[derive(Clone, Debug)]
pub struct Estimation {
    /// Its figures.
    pub report: EstimationReport,
    /// The estimates, as they were known at each instant.
    pub states: Vec<NavState>,
    /// The truth.
    pub truth: Vec<TrueMotion>,
}

/// Runs an estimator over a log.
///
/// # Errors
/// When the log cannot be read or lacks what the estimator needs, or a parameter is not allowed.
pub fn estimate(job: &Job) -> Result<Estimation, RunError> {
    job.poses.validate().map_err(|error| error.under("poses"))?;
    let feed = read(job)?;
    let mut run = Run::new(&feed)?;
    for (batch, mode) in &feed.steps {
        run.step(batch, *mode);
    }
    run.finish(job, feed)
}

/// The log as a feed, whatever its format.
fn read(job: &Job) -> Result<Feed, RunError> {
    if job.log.is_dir() {
        return euroc::read(job);
    }
    match job.log.extension().and_then(|e| e.to_str()) {
        Some("mcap") => recording::read(job),
        _ if !job.log.exists() => Err(RunError::Input {
            what: job.log.display().to_string(),
            finding: "there is no such file or folder".into(),
            remedy: "Name a EuRoC folder or an .mcap recording".into(),
        }),
        _ => Err(RunError::Input {
            what: job.log.display().to_string(),
            finding: "not a log that alula reads".into(),
            remedy: "Name a EuRoC folder or an .mcap recording".into(),
        }),
    }
}

fn read_truth(path: &Path) -> Result<Vec<TrueMotion>, RunError> {
    let poses = alula_record::tum::read(path)?;
    Ok(poses
        .iter()
        .map(|pose| TrueMotion {
            time: pose.time,
            world_from_body: pose.world_from_body,
            velocity_world: None,
        })
        .collect())
}

/// An estimator at work.
struct Run {
    estimator: Box<dyn alula_estimation::Estimator>,
    states: Vec<NavState>,
    samples: usize,
    fusions: usize,
    rejected: BTreeMap<&'static str, usize>,
    usable_steps: usize,
    steps: usize,
    max_jump_m: f64,
    stopwatch: Stopwatch,
}

impl Run {
    fn new(feed: &Feed) -> Result<Self, RunError> {
        Ok(Self {
            estimator: feed.estimation.build()?,
            states: Vec::with_capacity(feed.steps.len()),
            samples: 0,
            fusions: 0,
            rejected: BTreeMap::new(),
            usable_steps: 0,
            steps: 0,
            max_jump_m: 0.0,
            stopwatch: Stopwatch::default(),
        })
    }

    fn step(&mut self, batch: &SensorBatch, mode: FlightMode) {
        self.stopwatch.start();
        self.estimator.update(batch, mode);
        self.stopwatch.lap("update");
        self.samples += batch.imu.len();
        self.steps += 1;
        self.fusions += self.estimator.fusions().len();
        for reason in self
            .estimator
            .fusions()
            .iter()
            .filter_map(|fusion| fusion.rejection)
        {
            *self.rejected.entry(reason.name()).or_default() += 1;
        }
        let state = self.estimator.state();
        if !judge::is_usable(state) {
            return;
        }
        self.usable_steps += 1;
        if let Some(last) = self.states.last() {
            self.max_jump_m = self.max_jump_m.max(judge::jump_m(last, state));
        }
        self.states.push(state.clone());
    }

    fn finish(self, job: &Job, feed: Feed) -> Result<Estimation, RunError> {
        let name = feed.estimation.estimator.clone();
        let align = job.align.unwrap_or(AlignTo::natural_for(&name));
        let mut notes = feed.notes;
        let errors = match judge::judge(&self.states, &feed.truth, align, job.rpe_delta_s) {
            Ok(errors) => Some(errors),
            Err(reason) => {
                notes.push(format!("no errors are reported: {reason}"));
                None
            }
        };
        let report = EstimationReport {
            estimator: name,
            log: job.log.clone(),
            samples: self.samples,
            completed_fraction: self.usable_steps as f64 / self.steps.max(1) as f64,
            measurements: self.fusions,
            rejected: self.rejected,
            unobserved: self.estimator.unobserved().names().collect(),
            max_jump_m: self.max_jump_m,
            errors,
            timing_ms: self
                .stopwatch
                .distributions()
                .get("update")
                .copied()
                .unwrap_or_default(),
            notes,
        };
        Ok(Estimation {
            report,
            states: self.states,
            truth: feed.truth,
        })
    }
}
