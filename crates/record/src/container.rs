//! Reading an MCAP file from its start to wherever it ends, chunk by chunk.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::{ChunkHeader, Footer, MessageHeader, Metadata, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError, parse_record};

use crate::RecordError;

/// Bytes before the content of a record: its kind and its length.
const RECORD_START: u64 = 9;

/// Bytes of a footer record with its start, and of the magic number that follows it.
const FILE_END: u64 = RECORD_START + 20 + 8;

/// Larger records are not read: the length is damaged.
const RECORD_LIMIT: usize = 1 << 28;

/// A topic with the name of its schema.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Channel {
    pub topic: String,
    pub schema: String,
}

/// What follows in the file.
pub(crate) enum Part {
    /// Named values.
    Metadata(Metadata),
    /// Messages, which the visitor has seen.
    Messages,
    /// Bytes that cannot be read; reading goes on after them if the file goes on.
    Damaged { byte: u64, finding: String },
    /// The file breaks off.
    Truncated { byte: u64 },
    /// The file is complete.
    End,
}

/// A visitor of messages.
pub(crate) type Visitor<'a> = &'a mut dyn FnMut(&Channel, &MessageHeader, &[u8]);

/// An MCAP file that is being read.
pub(crate) struct Container<R> {
    file: R,
    path: PathBuf,
    position: u64,
    part_start: u64,
    length: u64,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Channel>,
    record: Vec<u8>,
    seen: u64,
    damaged: bool,
    ended: bool,
}

impl<R: Read + Seek> Container<R> {
    /// Begins to read; `path` is for error messages.
    pub fn open(mut file: R, path: &Path) -> Result<Self, RecordError> {
        let length = file
            .seek(SeekFrom::End(0))
            .map_err(RecordError::read(path))?;
        let mut container = Self {
            file,
            path: path.to_owned(),
            position: 0,
            part_start: 0,
            length,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            record: Vec::new(),
            seen: 0,
            damaged: false,
            ended: false,
        };
        container.read_magic()?;
        // The channels are defined in the first chunks; should one of those be damaged, the
        // summary still knows them.
        container.learn_channels_from_summary()?;
        container.go_to(MAGIC.len() as u64)?;
        Ok(container)
    }

    /// Bytes in the file.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Byte at which the last part begins.
    pub fn part_start(&self) -> u64 {
        self.part_start
    }

    fn read_magic(&mut self) -> Result<(), RecordError> {
        self.go_to(0)?;
        let mut start = [0; MAGIC.len()];
        let is_mcap = self.length >= MAGIC.len() as u64 && {
            self.file
                .read_exact(&mut start)
                .map_err(RecordError::read(&self.path))?;
            start == MAGIC
        };
        if is_mcap {
            return Ok(());
        }
        Err(RecordError::NotMcap {
            path: self.path.clone(),
        })
    }

    fn go_to(&mut self, position: u64) -> Result<(), RecordError> {
        self.file
            .seek(SeekFrom::Start(position))
            .map_err(RecordError::read(&self.path))?;
        self.position = position;
        Ok(())
    }

    fn learn_channels_from_summary(&mut self) -> Result<(), RecordError> {
        let Some(end) = self.length.checked_sub(FILE_END) else {
            return Ok(());
        };
        self.go_to(end)?;
        let footer: Option<Footer> = match self.read_record()? {
            Some(op::FOOTER) => match parse_record(op::FOOTER, &self.record) {
                Ok(Record::Footer(footer)) => Some(footer),
                _ => None,
            },
            _ => None,
        };
        let start = footer.map_or(0, |footer| footer.summary_start);
        if start == 0 || start >= end {
            return Ok(());
        }
        self.go_to(start)?;
        while let Some(kind) = self.read_record()? {
            match parse_record(kind, &self.record) {
                Ok(Record::Footer(_)) | Err(_) => break,
                Ok(record) => learn(&mut self.schemas, &mut self.channels, &record),
            }
        }
        Ok(())
    }

    /// Reads the next record into `self.record` and returns its kind; `None` where the file
    /// breaks off.
    fn read_record(&mut self) -> Result<Option<u8>, RecordError> {
        if self.position + RECORD_START > self.length {
            return Ok(None);
        }
        let mut start = [0; RECORD_START as usize];
        self.file
            .read_exact(&mut start)
            .map_err(RecordError::read(&self.path))?;
        let [kind, length @ ..] = start;
        let length = u64::from_le_bytes(length);
        let end = (self.position + RECORD_START).checked_add(length);
        let Some(end) = end.filter(|end| *end <= self.length) else {
            return Ok(None);
        };
        // Up to here the length is that of bytes which are in the file.
        self.record.resize(length as usize, 0);
        self.file
            .read_exact(&mut self.record)
            .map_err(RecordError::read(&self.path))?;
        self.position = end;
        Ok(Some(kind))
    }

    /// Reads up to the next part that says something; messages go to `visitor`, those of a
    /// damaged chunk not at all.
    pub fn next_part(&mut self, visitor: Visitor) -> Result<Part, RecordError> {
        if self.ended {
            return Ok(Part::End);
        }
        loop {
            let byte = self.position;
            self.part_start = byte;
            let Some(kind) = self.read_record()? else {
                self.ended = true;
                return Ok(Part::Truncated { byte });
            };
            match self.take(kind, visitor) {
                Ok(Some(Part::End)) => return self.end(byte),
                Ok(Some(part)) => return Ok(part),
                Ok(None) => {}
                Err(finding) => {
                    self.damaged = true;
                    return Ok(Part::Damaged { byte, finding });
                }
            }
        }
    }

    /// Takes the record that was read.
    fn take(&mut self, kind: u8, visitor: Visitor) -> Result<Option<Part>, String> {
        match parse_record(kind, &self.record).map_err(say)? {
            Record::Metadata(metadata) => Ok(Some(Part::Metadata(metadata))),
            Record::Chunk { header, data } => {
                let count = read_chunk(
                    &header,
                    data.len(),
                    &self.record,
                    &mut self.schemas,
                    &mut self.channels,
                    visitor,
                )?;
                self.seen += count;
                Ok(Some(Part::Messages))
            }
            Record::Message { header, data } => {
                visit(&self.channels, &header, &data, visitor)?;
                self.seen += 1;
                Ok(Some(Part::Messages))
            }
            Record::Statistics(statistics) => {
                if self.damaged || statistics.message_count == self.seen {
                    return Ok(None);
                }
                Err(format!(
                    "the summary counts {} messages and {} could be read",
                    statistics.message_count, self.seen
                ))
            }
            Record::Footer(_) => Ok(Some(Part::End)),
            Record::Unknown { opcode, .. } => {
                Err(format!("a record of unknown kind {opcode:#04x}"))
            }
            record => {
                learn(&mut self.schemas, &mut self.channels, &record);
                Ok(None)
            }
        }
    }

    /// Looks for the magic number after the footer at `byte`.
    fn end(&mut self, byte: u64) -> Result<Part, RecordError> {
        self.ended = true;
        let mut end = [0; MAGIC.len()];
        if self.length - self.position < MAGIC.len() as u64 {
            return Ok(Part::Truncated { byte });
        }
        self.file
            .read_exact(&mut end)
            .map_err(RecordError::read(&self.path))?;
        if end == MAGIC {
            return Ok(Part::End);
        }
        Ok(Part::Damaged {
            byte: self.position,
            finding: "the last bytes are not those of the format".to_owned(),
        })
    }
}

fn learn(
    schemas: &mut BTreeMap<u16, String>,
    channels: &mut BTreeMap<u16, Channel>,
    record: &Record,
) {
    match record {
        Record::Schema { header, .. } => {
            schemas.insert(header.id, header.name.clone());
        }
        Record::Channel(channel) => {
            let schema = schemas.get(&channel.schema_id).cloned();
            let known = Channel {
                topic: channel.topic.clone(),
                schema: schema.unwrap_or_default(),
            };
            channels.insert(channel.id, known);
        }
        _ => {}
    }
}

fn visit(
    channels: &BTreeMap<u16, Channel>,
    header: &MessageHeader,
    data: &[u8],
    visitor: Visitor,
) -> Result<(), String> {
    let channel = channels
        .get(&header.channel_id)
        .ok_or_else(|| format!("a message of the undefined channel {}", header.channel_id))?;
    visitor(channel, header, data);
    Ok(())
}

/// Visits the messages of a chunk after its checksum was found right; returns their number.
fn read_chunk(
    header: &ChunkHeader,
    data_length: usize,
    record: &[u8],
    schemas: &mut BTreeMap<u16, String>,
    channels: &mut BTreeMap<u16, Channel>,
    visitor: Visitor,
) -> Result<u64, String> {
    if header.uncompressed_size > RECORD_LIMIT as u64 || data_length > RECORD_LIMIT {
        return Err("a chunk of impossible size".to_owned());
    }
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(RECORD_LIMIT);
    let mut reader = LinearReader::new_with_options(options);
    let mut start = vec![op::CHUNK];
    start.extend_from_slice(&(record.len() as u64).to_le_bytes());
    let mut bytes = start.as_slice().chain(record);
    let mut count = 0;
    while let Some(event) = reader.next_event() {
        match event.map_err(say)? {
            LinearReadEvent::ReadRequest(wanted) => {
                let read = bytes
                    .read(reader.insert(wanted))
                    .map_err(|e| e.to_string())?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => match parse_record(opcode, data) {
                Ok(Record::Message { header, data }) => {
                    visit(channels, &header, &data, visitor)?;
                    count += 1;
                }
                Ok(record) => learn(schemas, channels, &record),
                Err(error) => return Err(say(error)),
            },
        }
    }
    Ok(count)
}

fn say(error: McapError) -> String {
    error.to_string()
}
