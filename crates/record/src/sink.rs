//! The file that is being written: channels, chunks and the buffer in which messages are encoded.

use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::path::PathBuf;

use alula_geometry::Timestamp;
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use prost::Message;

use crate::topic::Topic;
use crate::{Header, RecordError};

/// A chunk is closed after this much flight, so that a kill loses no more than that.
const CHUNK_S: f64 = 1.0;

/// A chunk is closed beyond this size: depth images fill it faster than time does.
const CHUNK_BYTES: usize = 4 << 20;

/// An open recording.
pub(crate) struct Sink<W: Write + Seek> {
    writer: Writer<W>,
    path: PathBuf,
    channels: [Option<u16>; Topic::COUNT],
    sequence: [u32; Topic::COUNT],
    buffer: Vec<u8>,
    chunk_start: Option<Timestamp>,
    chunk_bytes: usize,
    chunk_number: u64,
}

impl<W: Write + Seek> Sink<W> {
    /// Begins a recording with its header; `path` is for error messages.
    pub fn new(target: W, path: PathBuf, header: &Header) -> Result<Self, RecordError> {
        // Chunks are built in memory and written whole: the file never ends in half a chunk
        // unless the operating system tears it.
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .profile("alula")
            .library(concat!("alula-record/", env!("CARGO_PKG_VERSION")))
            .chunk_size(None)
            .disable_seeking(true);
        let mut writer =
            Writer::with_options(target, options).map_err(RecordError::container(&path))?;
        writer
            .write_metadata(&header.to_metadata())
            .and_then(|()| writer.flush())
            .map_err(RecordError::container(&path))?;
        Ok(Self {
            writer,
            path,
            channels: [None; Topic::COUNT],
            sequence: [0; Topic::COUNT],
            buffer: Vec::with_capacity(4096),
            chunk_start: None,
            chunk_bytes: 0,
            chunk_number: 0,
        })
    }

    /// Number of the present chunk: what a reader needs in each chunk is written when it changes.
    pub fn chunk_number(&self) -> u64 {
        self.chunk_number
    }

    /// Closes the chunk and hands it to the operating system when it is old or large enough.
    /// Called between batches, so that no batch straddles a chunk.
    pub fn end_chunk_if_due(&mut self, now: Timestamp) -> Result<(), RecordError> {
        let start = *self.chunk_start.get_or_insert(now);
        // A clock that jumps backwards must not keep the chunk open.
        let age_s = now.seconds_since(start).abs();
        if age_s < CHUNK_S && self.chunk_bytes < CHUNK_BYTES {
            return Ok(());
        }
        self.writer
            .flush()
            .map_err(RecordError::container(&self.path))?;
        self.chunk_start = Some(now);
        self.chunk_bytes = 0;
        self.chunk_number += 1;
        Ok(())
    }

    /// Writes a message that became known at `logged` and was true at `measured`.
    pub fn write(
        &mut self,
        topic: Topic,
        logged: Timestamp,
        measured: Timestamp,
        message: &impl Message,
    ) -> Result<(), RecordError> {
        self.buffer.clear();
        message
            .encode(&mut self.buffer)
            .map_err(|e| RecordError::write(&self.path)(std::io::Error::other(e)))?;
        let header = MessageHeader {
            channel_id: self.channel(topic)?,
            sequence: self.next_sequence(topic),
            log_time: unsigned_ns(logged),
            publish_time: unsigned_ns(measured),
        };
        self.chunk_bytes += self.buffer.len();
        self.writer
            .write_to_known_channel(&header, &self.buffer)
            .map_err(RecordError::container(&self.path))
    }

    /// Closes the recording with its summary.
    pub fn finish(mut self) -> Result<(), RecordError> {
        self.writer
            .finish()
            .map_err(RecordError::container(&self.path))?;
        self.writer
            .into_inner()
            .flush()
            .map_err(RecordError::write(&self.path))
    }

    fn next_sequence(&mut self, topic: Topic) -> u32 {
        let sequence = &mut self.sequence[topic as usize];
        *sequence = sequence.wrapping_add(1);
        *sequence
    }

    /// The channel of a topic, made when it is first used.
    fn channel(&mut self, topic: Topic) -> Result<u16, RecordError> {
        if let Some(id) = self.channels[topic as usize] {
            return Ok(id);
        }
        let id = self
            .add_channel(topic)
            .map_err(RecordError::container(&self.path))?;
        self.channels[topic as usize] = Some(id);
        Ok(id)
    }

    fn add_channel(&mut self, topic: Topic) -> mcap::McapResult<u16> {
        let schema_id = match topic.schema() {
            Some(schema) => self
                .writer
                .add_schema(&schema.name, &schema.encoding, &schema.data)?,
            None => 0,
        };
        self.writer
            .add_channel(schema_id, topic.name(), "protobuf", &BTreeMap::new())
    }
}

/// Time for the container, which knows no time before its epoch; messages hold the exact one.
fn unsigned_ns(time: Timestamp) -> u64 {
    u64::try_from(time.as_ns()).unwrap_or(0)
}
