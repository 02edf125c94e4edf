//! Messages back to batches and outputs.

use std::sync::Arc;

use alula_geometry::Timestamp;
use alula_messages::{Command, FlightMode, GuardReport, SensorBatch, StackOutput};
use foxglove::messages as fox;
use prost::Message;

use crate::convert::{Mismatch, Recorded, depth_image, time};
use crate::convert_output::reference_from;
use crate::convert_seen::{hindrance_from, plan_from};
use crate::convert_state::state_from;
use crate::recording::{Event, LogEntry, LogLevel, TruthRecord};
use crate::schema;
use crate::topic::Topic;

/// Parts of the batch and of the output that are not complete yet.
#[derive(Default)]
pub(crate) struct Assembler {
    batch: SensorBatch,
    pixels: Vec<Vec<u16>>,
    output: Option<Box<StackOutput>>,
    mode: Option<FlightMode>,
    guard: Option<GuardReport>,
}

impl Assembler {
    /// Drops what is not complete.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// Takes the next message, logged at `logged`; returns what it completes.
    pub fn take(
        &mut self,
        topic: &str,
        logged: Timestamp,
        data: &[u8],
    ) -> Result<Option<Event>, Mismatch> {
        let Some(topic) = Topic::from_name(topic) else {
            return Ok(None);
        };
        match topic {
            Topic::Imu => self.batch.imu.push(recorded(data)?),
            Topic::Flow => self.batch.flow.push(recorded(data)?),
            Topic::Sonar => self.batch.sonar.push(recorded(data)?),
            Topic::Infrared => self.batch.infrared.push(recorded(data)?),
            Topic::MotionCapture => self.batch.poses.push(recorded(data)?),
            Topic::Autopilot => self.batch.autopilot.push(recorded(data)?),
            Topic::Depth | Topic::Depth1 | Topic::Depth2 | Topic::Depth3 => {
                self.pixels.push(pixels(data)?);
            }
            Topic::Batch => return self.end_batch(data).map(Some),
            Topic::State => self.begin_output(data)?,
            Topic::Fusions => self.take_fusions(data)?,
            Topic::Mode => self.mode = Some(mode(data)?),
            Topic::Requests => self.take_requests(data)?,
            Topic::Reference => self.take_reference(data)?,
            Topic::Detections => self.take_detections(data)?,
            Topic::Obstacles => self.take_obstacles(data)?,
            Topic::Plan => self.output()?.plan = Some(plan_from(&schema::Plan::decode(data)?)?),
            Topic::Hindrance => self.take_hindrance(data)?,
            Topic::Guard => self.guard = Some(recorded(data)?),
            Topic::Command => return self.end_output(data).map(Some),
            Topic::Truth => return Ok(Some(Event::Truth(recorded::<TruthRecord>(data)?))),
            Topic::Log => return log(logged, data).map(Some),
            Topic::DepthCalibration
            | Topic::Depth1Calibration
            | Topic::Depth2Calibration
            | Topic::Depth3Calibration
            | Topic::Sigma
            | Topic::Tf
            | Topic::TfStatic
            | Topic::Pose
            | Topic::Path
            | Topic::PathTrue
            | Topic::Scene
            | Topic::People
            | Topic::SceneObstacles
            | Topic::ScenePlan
            | Topic::Annotations
            | Topic::UDepth => {}
        }
        Ok(None)
    }

    fn end_batch(&mut self, data: &[u8]) -> Result<Event, Mismatch> {
        let mut batch = std::mem::take(&mut self.batch);
        let pixels = std::mem::take(&mut self.pixels);
        let message = schema::Batch::decode(data)?;
        let found = [
            batch.imu.len(),
            batch.flow.len(),
            batch.sonar.len(),
            batch.infrared.len(),
            batch.poses.len(),
            batch.autopilot.len(),
            pixels.len(),
        ];
        let counted = [
            message.imu as usize,
            message.flow as usize,
            message.sonar as usize,
            message.infrared as usize,
            message.motion_capture as usize,
            message.autopilot as usize,
            message.depth.len(),
        ];
        if found != counted {
            return Err(Mismatch::Incomplete("a batch"));
        }
        batch.now = time(message.now_ns);
        for (info, pixels) in message.depth.iter().zip(pixels) {
            batch.depth.push(Arc::new(depth_image(info, pixels)?));
        }
        Ok(Event::Batch(batch))
    }

    fn begin_output(&mut self, data: &[u8]) -> Result<(), Mismatch> {
        self.output = None;
        let message = schema::NavState::decode(data)?;
        self.output = Some(Box::new(StackOutput {
            time: time(message.step_ns),
            state: state_from(&message)?,
            ..StackOutput::default()
        }));
        Ok(())
    }

    fn output(&mut self) -> Result<&mut StackOutput, Mismatch> {
        self.output
            .as_deref_mut()
            .ok_or(Mismatch::Incomplete("an output"))
    }

    fn take_fusions(&mut self, data: &[u8]) -> Result<(), Mismatch> {
        let message = schema::Fusions::decode(data)?;
        let fusions = message.fusions.iter().map(Recorded::from_message);
        self.output()?.fusions = fusions.collect::<Result<_, _>>()?;
        Ok(())
    }

    fn take_requests(&mut self, data: &[u8]) -> Result<(), Mismatch> {
        let message = schema::Requests::decode(data)?;
        let requests = message.requests.iter().map(Recorded::from_message);
        self.output()?.requests = requests.collect::<Result<_, _>>()?;
        Ok(())
    }

    fn take_reference(&mut self, data: &[u8]) -> Result<(), Mismatch> {
        let message = schema::Reference::decode(data)?;
        self.output()?.reference = Some(reference_from(&message));
        Ok(())
    }

    fn take_detections(&mut self, data: &[u8]) -> Result<(), Mismatch> {
        let message = schema::Detections::decode(data)?;
        let detections = message.detections.iter().map(Recorded::from_message);
        let output = self.output()?;
        output.seen_at = message.seen_at_ns.map(time);
        output.detections = detections.collect::<Result<_, _>>()?;
        Ok(())
    }

    fn take_obstacles(&mut self, data: &[u8]) -> Result<(), Mismatch> {
        let message = schema::Obstacles::decode(data)?;
        let obstacles = message.obstacles.iter().map(Recorded::from_message);
        self.output()?.obstacles = obstacles.collect::<Result<_, _>>()?;
        Ok(())
    }

    fn take_hindrance(&mut self, data: &[u8]) -> Result<(), Mismatch> {
        let message = schema::Hindrance::decode(data)?;
        self.output()?.hindrance = Some(hindrance_from(&message)?);
        Ok(())
    }

    fn end_output(&mut self, data: &[u8]) -> Result<Event, Mismatch> {
        let incomplete = || Mismatch::Incomplete("an output");
        let mut output = self.output.take().ok_or_else(incomplete)?;
        let message = schema::StepCommand::decode(data)?;
        if message.time_ns != output.time.as_ns() {
            return Err(incomplete());
        }
        output.mode = self.mode.ok_or_else(incomplete)?;
        output.guard = self.guard.clone().ok_or_else(incomplete)?;
        output.command = Command::from_message(&message.command)?;
        let requested = message.requested.as_ref().unwrap_or(&message.command);
        output.requested = Command::from_message(requested)?;
        Ok(Event::Output(output))
    }
}

fn recorded<T: Recorded<Message: Message + Default>>(data: &[u8]) -> Result<T, Mismatch> {
    T::from_message(&T::Message::decode(data)?)
}

fn mode(data: &[u8]) -> Result<FlightMode, Mismatch> {
    FlightMode::from_message(&schema::FlightMode::decode(data)?.mode)
}

fn pixels(data: &[u8]) -> Result<Vec<u16>, Mismatch> {
    let image = fox::RawImage::decode(data)?;
    let pairs = image.data.as_chunks().0.iter();
    Ok(pairs.map(|pair| u16::from_le_bytes(*pair)).collect())
}

fn log(logged: Timestamp, data: &[u8]) -> Result<Event, Mismatch> {
    let message = fox::Log::decode(data)?;
    Ok(Event::Log(LogEntry {
        time: logged,
        level: LogLevel::from_foxglove(message.level()),
        text: message.message,
    }))
}
