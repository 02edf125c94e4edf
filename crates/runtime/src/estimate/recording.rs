//! An alula recording as input of an estimator.

use alula_messages::{FlightMode, PoseSample, SensorBatch};
use alula_record::{Event, Recording};

use super::{Feed, Job, TrueMotion};
use crate::RunError;
use crate::config::{ConfigText, resolved_text};
use crate::scenario::ScenarioConfig;

/// Reads the batches of a recording with the modes of flight in which they arrived.
pub(super) fn read(job: &Job) -> Result<Feed, RunError> {
    let recording = Recording::open(&job.log)?;
    let text = ConfigText {
        file: format!("the configuration in {}", job.log.display()),
        text: recording.header().config_toml.clone(),
    };
    let scenario: ScenarioConfig = text.read()?;
    let mut estimation = scenario.stack.estimation;
    if let Some(name) = &job.estimator {
        estimation.estimator.clone_from(name);
    }
    let estimation = ConfigText {
        file: text.file,
        text: resolved_text(&estimation)?,
    }
    .with_overrides(&job.overrides)?
    .read()?;
    let mut feed = Feed {
        steps: Vec::new(),
        truth: Vec::new(),
        estimation,
        notes: Vec::new(),
    };
    collect(recording, &mut feed)?;
    if let Some(path) = &job.truth {
        feed.truth = super::read_truth(path)?;
    }
    if feed.estimation.estimator == "pose-imu" {
        give_poses(job, &mut feed)?;
    }
    Ok(feed)
}

fn collect(recording: Recording, feed: &mut Feed) -> Result<(), RunError> {
    let mut mode = FlightMode::Disarmed;
    for event in recording {
        match event? {
            Event::Batch(mut batch) => {
                // Images are of no use to these estimators and fill the memory.
                batch.depth.clear();
                feed.steps.push((batch, mode));
            }
            Event::Output(output) => mode = output.mode,
            Event::Truth(truth) => feed.truth.push(TrueMotion {
                time: truth.time,
                world_from_body: truth.world_from_body,
                velocity_world: Some(truth.velocity_world),
            }),
            Event::Damage(damage) => feed.notes.push(damage.to_string()),
            Event::Log(_) => {}
        }
    }
    Ok(())
}

/// Makes sure that there are poses: those of motion capture, or else of the truth.
fn give_poses(job: &Job, feed: &mut Feed) -> Result<(), RunError> {
    if feed.steps.iter().any(|(batch, _)| !batch.poses.is_empty()) {
        return Ok(());
    }
    if feed.truth.is_empty() {
        return Err(RunError::Input {
            what: job.log.display().to_string(),
            finding: "the recording has neither external poses nor the truth".into(),
            remedy: "Choose another estimator, for example --estimator flow-odometry".into(),
        });
    }
    let poses: Vec<PoseSample> = feed.truth.iter().map(TrueMotion::pose_sample).collect();
    let arriving = super::euroc::arriving_poses(&poses, &job.poses, job.seed);
    let batches: Vec<&mut SensorBatch> = feed.steps.iter_mut().map(|(batch, _)| batch).collect();
    super::euroc::deliver_poses(batches, &arriving);
    feed.notes
        .push("external poses were made from the recorded truth".into());
    Ok(())
}
