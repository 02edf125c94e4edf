//! Writing a flight.

use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use alula_geometry::{Pose, Timestamp};
use alula_messages::{FlightMode, SensorBatch, StackOutput};
use prost::Message;

use crate::convert::{Recorded, fill_batch};
use crate::convert_output::reference_to;
use crate::convert_seen::{hindrance_to, plan_to};
use crate::convert_state::fill_state;
use crate::draw::{Person, SceneShape};
use crate::recording::{LogLevel, TruthRecord};
use crate::sink::Sink;
use crate::topic::Topic;
use crate::view::View;
use crate::{Header, RecordError, schema};

/// Writes a flight into an MCAP file.
///
/// Batches, outputs and truth are written whole; messages that only viewers need are thinned.
/// The file is complete up to the last second at any moment, whatever happens to the program.
pub struct Recorder<W: Write + Seek = BufWriter<File>> {
    sink: Sink<W>,
    view: View,
    batch: schema::Batch,
    state: schema::NavState,
    fusions: schema::Fusions,
    mode: OnChange<FlightMode>,
    guard: OnChange<Vec<u8>>,
}

/// The value that a reader of the present chunk knows.
#[derive(Default)]
struct OnChange<T> {
    known: Option<(u64, T)>,
}

impl<T: PartialEq> OnChange<T> {
    /// Whether a reader of this chunk does not know the value yet; from now on it does.
    fn is_news(&mut self, chunk: u64, value: T) -> bool {
        let now = Some((chunk, value));
        let news = self.known != now;
        self.known = now;
        news
    }
}

impl Recorder {
    /// Creates the file, or empties it, and writes the header.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(path: impl AsRef<Path>, header: &Header) -> Result<Self, RecordError> {
        let path = path.as_ref();
        let file = File::create(path).map_err(RecordError::write(path))?;
        Self::new(BufWriter::new(file), path, header)
    }
}

impl<W: Write + Seek> Recorder<W> {
    /// Begins a recording in anything that can be written; error messages call it `name`.
    ///
    /// # Errors
    /// When the header cannot be written.
    pub fn new(target: W, name: impl Into<PathBuf>, header: &Header) -> Result<Self, RecordError> {
        Ok(Self {
            sink: Sink::new(target, name.into(), header)?,
            view: View::default(),
            batch: schema::Batch::default(),
            state: schema::NavState::default(),
            fusions: schema::Fusions::default(),
            mode: OnChange::default(),
            guard: OnChange::default(),
        })
    }

    /// Writes all that arrived in one period.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_batch(&mut self, batch: &SensorBatch) -> Result<(), RecordError> {
        let now = batch.now;
        self.sink.end_chunk_if_due(now)?;
        self.view.write_scene(&mut self.sink, now)?;
        for sample in &batch.imu {
            self.sample(Topic::Imu, now, sample.time, sample)?;
        }
        for sample in &batch.flow {
            self.sample(Topic::Flow, now, sample.time, sample)?;
        }
        for sample in &batch.sonar {
            self.sample(Topic::Sonar, now, sample.time, sample)?;
        }
        for sample in &batch.infrared {
            self.sample(Topic::Infrared, now, sample.time, sample)?;
        }
        for sample in &batch.poses {
            self.sample(Topic::MotionCapture, now, sample.time, sample)?;
        }
        for sample in &batch.autopilot {
            self.sample(Topic::Autopilot, now, sample.time, sample)?;
        }
        for image in &batch.depth {
            self.view.write_depth(&mut self.sink, now, image)?;
        }
        fill_batch(&mut self.batch, batch);
        self.sink.write(Topic::Batch, now, now, &self.batch)
    }

    fn sample<T: Recorded<Message: Message>>(
        &mut self,
        topic: Topic,
        now: Timestamp,
        measured: Timestamp,
        sample: &T,
    ) -> Result<(), RecordError> {
        self.sink.write(topic, now, measured, &sample.to_message())
    }

    /// Writes all that the stack said in one step.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_output(&mut self, output: &StackOutput) -> Result<(), RecordError> {
        self.write_estimate(output)?;
        self.write_sights(output)?;
        self.write_decisions(output)?;
        self.write_command(output)?;
        self.view.write_output(&mut self.sink, output)
    }

    fn write_estimate(&mut self, output: &StackOutput) -> Result<(), RecordError> {
        let now = output.time;
        let measured = output.state.time;
        fill_state(&mut self.state, now.as_ns(), &output.state);
        self.sink.write(Topic::State, now, measured, &self.state)?;
        if output.fusions.is_empty() {
            return Ok(());
        }
        self.fusions.time_ns = now.as_ns();
        self.fusions.fusions.clear();
        let fusions = output.fusions.iter().map(Recorded::to_message);
        self.fusions.fusions.extend(fusions);
        self.sink.write(Topic::Fusions, now, now, &self.fusions)
    }

    /// What was seen, planned and met, in the steps in which there is something to say.
    fn write_sights(&mut self, output: &StackOutput) -> Result<(), RecordError> {
        let now = output.time;
        let time_ns = now.as_ns();
        let measured = output.seen_at.unwrap_or(now);
        if output.seen_at.is_some() || !output.detections.is_empty() {
            let message = schema::Detections {
                time_ns,
                seen_at_ns: output.seen_at.map(Timestamp::as_ns),
                detections: output.detections.iter().map(Recorded::to_message).collect(),
            };
            self.sink
                .write(Topic::Detections, now, measured, &message)?;
        }
        if !output.obstacles.is_empty() {
            let obstacles = output.obstacles.iter().map(Recorded::to_message).collect();
            let message = schema::Obstacles { time_ns, obstacles };
            self.sink.write(Topic::Obstacles, now, measured, &message)?;
        }
        if let Some(plan) = &output.plan {
            let message = plan_to(time_ns, plan);
            self.sink.write(Topic::Plan, now, plan.time, &message)?;
        }
        if let Some(hindrance) = output.hindrance {
            let message = hindrance_to(time_ns, hindrance);
            self.sink.write(Topic::Hindrance, now, now, &message)?;
        }
        Ok(())
    }

    fn write_decisions(&mut self, output: &StackOutput) -> Result<(), RecordError> {
        let now = output.time;
        let time_ns = now.as_ns();
        let chunk = self.sink.chunk_number();
        if self.mode.is_news(chunk, output.mode) {
            let mode = output.mode.to_message();
            let message = schema::FlightMode { time_ns, mode };
            self.sink.write(Topic::Mode, now, now, &message)?;
        }
        if !output.requests.is_empty() {
            let requests = output.requests.iter().map(Recorded::to_message).collect();
            let message = schema::Requests { time_ns, requests };
            self.sink.write(Topic::Requests, now, now, &message)?;
        }
        if let Some(reference) = &output.reference {
            let message = reference_to(time_ns, reference);
            self.sink.write(Topic::Reference, now, now, &message)?;
        }
        let mut guard = output.guard.to_message();
        if self.guard.is_news(chunk, guard.encode_to_vec()) {
            guard.time_ns = time_ns;
            self.sink.write(Topic::Guard, now, now, &guard)?;
        }
        Ok(())
    }

    fn write_command(&mut self, output: &StackOutput) -> Result<(), RecordError> {
        let now = output.time;
        let command = output.command.to_message();
        let requested = output.requested.to_message();
        // Encoded, 0 and -0 differ and a NaN is itself.
        let unchanged = command.encode_to_vec() == requested.encode_to_vec();
        let message = schema::StepCommand {
            time_ns: now.as_ns(),
            command,
            requested: (!unchanged).then_some(requested),
        };
        self.sink.write(Topic::Command, now, now, &message)
    }

    /// Writes what really happened.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_truth(&mut self, truth: &TruthRecord) -> Result<(), RecordError> {
        self.sample(Topic::Truth, truth.time, truth.time, truth)?;
        self.view.write_truth(&mut self.sink, truth)
    }

    /// Says where a sensor is: `body_from_sensor` of the frame called `name`, for viewers.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_mount(
        &mut self,
        time: Timestamp,
        name: &str,
        body_from_sensor: &Pose,
    ) -> Result<(), RecordError> {
        self.view
            .write_mount(&mut self.sink, time, name, body_from_sensor)
    }

    /// Draws the things that stand still from the next batch on, for viewers; each call replaces
    /// what was drawn before.
    pub fn write_scene(&mut self, shapes: &[SceneShape]) {
        self.view.set_scene(shapes);
    }

    /// Draws people where they are at `time`, ten times a second at most, for viewers. In between
    /// nobody asks `people`.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_people(
        &mut self,
        time: Timestamp,
        people: impl IntoIterator<Item = Person>,
    ) -> Result<(), RecordError> {
        self.view.write_people(&mut self.sink, time, people)
    }

    /// Draws a U-depth map, five times a second at most, for viewers: the number of pixels at each
    /// of `bins` distances, the nearest first, in each of `columns` columns of the image. A map of
    /// another size than `columns * bins` is left out.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_u_depth(
        &mut self,
        time: Timestamp,
        columns: usize,
        bins: usize,
        counts: &[u16],
    ) -> Result<(), RecordError> {
        self.view
            .write_u_depth(&mut self.sink, time, [columns, bins], counts)
    }

    /// Writes an event in words.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_log(
        &mut self,
        time: Timestamp,
        level: LogLevel,
        text: &str,
    ) -> Result<(), RecordError> {
        self.view.write_log(&mut self.sink, time, level, text)
    }

    /// Closes the recording with its summary, which lets viewers jump in it.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(self) -> Result<(), RecordError> {
        self.sink.finish()
    }
}
