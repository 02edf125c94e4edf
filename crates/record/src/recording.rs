//! Reading a flight back.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use alula_geometry::{Pose, Timestamp};
use alula_messages::{SensorBatch, StackOutput};
use foxglove::messages::log::Level;
use nalgebra::Vector3;

use crate::assemble::Assembler;
use crate::container::{Container, Part};
use crate::{Header, RecordError};

/// What really happened at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthRecord {
    /// The instant.
    pub time: Timestamp,
    /// Pose of the body in the world.
    pub world_from_body: Pose,
    /// Velocity of the body's origin, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Distance from the vehicle's surface to the nearest thing, m, if known.
    pub clearance_m: Option<f64>,
}

/// How grave an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogLevel {
    /// Of interest to developers.
    Debug,
    /// A normal event.
    Info,
    /// Something is not as it should be.
    Warning,
    /// Something failed.
    Error,
}

impl LogLevel {
    pub(crate) fn to_foxglove(self) -> Level {
        match self {
            Self::Debug => Level::Debug,
            Self::Info => Level::Info,
            Self::Warning => Level::Warning,
            Self::Error => Level::Error,
        }
    }

    pub(crate) fn from_foxglove(level: Level) -> Self {
        match level {
            Level::Unknown | Level::Debug => Self::Debug,
            Level::Info => Self::Info,
            Level::Warning => Self::Warning,
            Level::Error | Level::Fatal => Self::Error,
        }
    }
}

/// An event in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogEntry {
    /// When it happened.
    pub time: Timestamp,
    /// How grave it is.
    pub level: LogLevel,
    /// What happened.
    pub text: String,
}

/// What is wrong at a place of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DamageKind {
    /// The file breaks off: the recording was not finished, or not copied whole.
    Truncated,
    /// A part of the file cannot be read; reading goes on after it.
    Unreadable {
        /// What was found.
        finding: String,
    },
}

/// A place where a recording is not whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// What is wrong.
    pub kind: DamageKind,
    /// Byte of the file where it begins.
    pub byte: u64,
    /// Bytes in the file.
    pub length: u64,
    /// Time of the last message before it; `None` if there is none.
    pub read_up_to: Option<Timestamp>,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.kind {
            DamageKind::Truncated => write!(
                f,
                "truncated at byte {} (the file ends at byte {})",
                self.byte, self.length
            )?,
            DamageKind::Unreadable { finding } => {
                write!(f, "damaged at byte {}: {finding}", self.byte)?
            }
        }
        match self.read_up_to {
            Some(time) => write!(f, "; read up to t = {time}"),
            None => write!(f, "; nothing could be read before it"),
        }
    }
}

/// What a recording holds, in the order in which it was written.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// All that arrived in one period.
    Batch(SensorBatch),
    /// All that the stack said in one step.
    Output(Box<StackOutput>),
    /// What really happened.
    Truth(TruthRecord),
    /// An event in words.
    Log(LogEntry),
    /// The recording is not whole here.
    Damage(Damage),
}

/// A recording that is being read: an iterator over its events.
pub struct Recording {
    container: Container<BufReader<File>>,
    path: PathBuf,
    header: Header,
    assembler: Assembler,
    events: VecDeque<Event>,
    last_message: Option<Timestamp>,
    ended: bool,
}

impl Recording {
    /// Opens a recording and checks that its header is the one it was recorded with.
    ///
    /// # Errors
    /// When the file cannot be read, is no recording, or its header was changed
    /// ([`RecordError::ConfigChanged`]).
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordError> {
        Self::open_with(path.as_ref(), Header::verify)
    }

    /// Opens a recording whatever its header says: good for looking at the flight, not for flying
    /// it again.
    ///
    /// # Errors
    /// When the file cannot be read or is no recording.
    pub fn open_unverified(path: impl AsRef<Path>) -> Result<Self, RecordError> {
        Self::open_with(path.as_ref(), |_, _, _| Ok(()))
    }

    fn open_with(
        path: &Path,
        verify: impl Fn(&Header, &mcap::records::Metadata, &Path) -> Result<(), RecordError>,
    ) -> Result<Self, RecordError> {
        if !path.exists() {
            return Err(RecordError::Missing {
                what: "recording",
                path: path.to_owned(),
                remedy: "check the name; `alula fly --out DIR` makes a recording",
            });
        }
        let file = File::open(path).map_err(RecordError::read(path))?;
        let mut container = Container::open(BufReader::new(file), path)?;
        let no_header = |finding: String| RecordError::NoHeader {
            path: path.to_owned(),
            finding,
        };
        let metadata = match container.next_part(&mut |_, _, _| {})? {
            Part::Metadata(metadata) => metadata,
            Part::Messages => return Err(no_header("messages come first".to_owned())),
            Part::Damaged { finding, .. } => return Err(no_header(finding)),
            Part::Truncated { .. } | Part::End => {
                return Err(no_header("the file ends".to_owned()));
            }
        };
        let header = Header::from_metadata(&metadata, path)?;
        verify(&header, &metadata, path)?;
        Ok(Self {
            container,
            path: path.to_owned(),
            header,
            assembler: Assembler::default(),
            events: VecDeque::new(),
            last_message: None,
            ended: false,
        })
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the rest of the recording and says what is in it.
    ///
    /// # Errors
    /// When the file cannot be read; damage is in the summary instead.
    pub fn summary(mut self) -> Result<Summary, RecordError> {
        let mut summary = Summary {
            header: self.header.clone(),
            bytes: self.container.length(),
            ..Summary::default()
        };
        while !self.ended {
            self.read_part(Some(&mut summary.topics))?;
            for event in self.events.drain(..) {
                match event {
                    Event::Batch(_) => summary.batches += 1,
                    Event::Output(_) => summary.outputs += 1,
                    Event::Damage(damage) => summary.damage.push(damage),
                    Event::Truth(_) | Event::Log(_) => {}
                }
            }
        }
        Ok(summary)
    }

    /// Reads the next part of the file and queues its events.
    fn read_part(
        &mut self,
        mut topics: Option<&mut BTreeMap<String, TopicSummary>>,
    ) -> Result<(), RecordError> {
        let Self {
            container,
            assembler,
            events,
            last_message,
            ..
        } = self;
        let mut misfit = None;
        let part = container.next_part(&mut |channel, header, data| {
            let time = Timestamp::from_ns(i64::try_from(header.log_time).unwrap_or(i64::MAX));
            *last_message = Some(last_message.map_or(time, |last| last.max(time)));
            if let Some(topics) = &mut topics {
                let topic = topics.entry(channel.topic.clone()).or_default();
                topic.count(&channel.schema, time);
            }
            match assembler.take(&channel.topic, time, data) {
                Ok(event) => events.extend(event),
                Err(error) => {
                    misfit = misfit
                        .take()
                        .or(Some(format!("{}: {error}", channel.topic)))
                }
            }
        })?;
        let damage = match part {
            Part::Metadata(_) => None,
            Part::Messages => misfit.map(|finding| (self.container.part_start(), finding)),
            Part::Damaged { byte, finding } => {
                // What came before the damage does not belong to what comes after it.
                self.assembler.forget();
                Some((byte, finding))
            }
            Part::Truncated { byte } => {
                self.ended = true;
                self.push_damage(DamageKind::Truncated, byte);
                None
            }
            Part::End => {
                self.ended = true;
                None
            }
        };
        if let Some((byte, finding)) = damage {
            self.push_damage(DamageKind::Unreadable { finding }, byte);
        }
        Ok(())
    }

    fn push_damage(&mut self, kind: DamageKind, byte: u64) {
        self.events.push_back(Event::Damage(Damage {
            kind,
            byte,
            length: self.container.length(),
            read_up_to: self.last_message,
        }));
    }
}

impl Iterator for Recording {
    type Item = Result<Event, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.events.is_empty() && !self.ended {
            if let Err(error) = self.read_part(None) {
                self.ended = true;
                return Some(Err(error));
            }
        }
        self.events.pop_front().map(Ok)
    }
}

/// What is on one topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TopicSummary {
    /// Name of its schema.
    pub schema: String,
    /// Number of messages.
    pub messages: u64,
    /// Time of the first one.
    pub first: Timestamp,
    /// Time of the last one.
    pub last: Timestamp,
}

impl TopicSummary {
    fn count(&mut self, schema: &str, time: Timestamp) {
        if self.messages == 0 {
            self.schema = schema.to_owned();
            self.first = time;
        }
        self.messages += 1;
        self.last = time;
    }
}

/// What is in a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// The header.
    pub header: Header,
    /// Bytes in the file.
    pub bytes: u64,
    /// All topics by name.
    pub topics: BTreeMap<String, TopicSummary>,
    /// Complete batches.
    pub batches: u64,
    /// Complete outputs of the stack.
    pub outputs: u64,
    /// Where the recording is not whole; empty if it is.
    pub damage: Vec<Damage>,
}

impl Summary {
    /// Seconds from the first message to the last; 0 without messages.
    pub fn duration_s(&self) -> f64 {
        let first = self.topics.values().map(|topic| topic.first).min();
        let last = self.topics.values().map(|topic| topic.last).max();
        first
            .zip(last)
            .map_or(0.0, |(first, last)| last.seconds_since(first))
    }
}
