//! Recordings that were cut off, damaged or changed.

// Helpers fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

mod made;

use std::path::{Path, PathBuf};

use alula_record::{DamageKind, Event, Header, RecordError, Recorder, Recording};
use made::{Numbers, events};

struct Flight {
    folder: tempfile::TempDir,
    events: Vec<Event>,
    bytes: Vec<u8>,
}

/// A flight of 3.5 s: three whole chunks and a shorter one.
fn flight() -> Flight {
    let folder = tempfile::tempdir().unwrap();
    let events = events(&mut Numbers::plain(7), 350);
    let path = folder.path().join("whole.mcap");
    let header = Header {
        config_toml: "gain = 1.0\n".repeat(10),
        ..Header::default()
    };
    let mut recorder = Recorder::create(&path, &header).unwrap();
    write(&mut recorder, &events);
    recorder.finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    Flight {
        folder,
        events,
        bytes,
    }
}

fn write(recorder: &mut Recorder, events: &[Event]) {
    for event in events {
        match event {
            Event::Batch(batch) => recorder.write_batch(batch).unwrap(),
            Event::Output(output) => recorder.write_output(output).unwrap(),
            Event::Truth(truth) => recorder.write_truth(truth).unwrap(),
            _ => {}
        }
    }
}

impl Flight {
    fn with_bytes(&self, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join("part.mcap");
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// Bytes at which the chunks end.
    fn chunk_ends(&self) -> Vec<usize> {
        const CHUNK: u8 = 0x06;
        let mut position = 8;
        let mut ends = Vec::new();
        while position + 9 <= self.bytes.len() {
            let length = &self.bytes[position + 1..position + 9];
            let length = u64::from_le_bytes(length.try_into().unwrap()) as usize;
            let end = position + 9 + length;
            if self.bytes[position] == CHUNK {
                ends.push(end);
            }
            position = end;
        }
        ends
    }
}

fn is_damage(event: &Event) -> bool {
    matches!(event, Event::Damage(_))
}

/// Events that were read, without and with the reports of damage.
fn read(path: &Path) -> Result<(Vec<Event>, Vec<Event>), RecordError> {
    let events: Vec<Event> = Recording::open(path)?.collect::<Result<_, _>>()?;
    Ok(events.into_iter().partition(|event| !is_damage(event)))
}

/// 100 steps with three events each fill a chunk.
const EVENTS_PER_CHUNK: usize = 300;

#[test]
fn a_truncated_recording_is_read_up_to_the_last_whole_chunk() {
    let flight = flight();
    let chunk_ends = flight.chunk_ends();
    assert_eq!(chunk_ends.len(), 4);
    let near_ends = chunk_ends.iter().flat_map(|end| end - 2..end + 3);
    let spread = (0..flight.bytes.len() - 1).step_by(4_999);
    let first = chunk_ends[0] / 2;
    for length in near_ends.chain(spread).filter(|length| *length > first) {
        let (found, damage) = read(&flight.with_bytes(&flight.bytes[..length])).unwrap();
        let whole_chunks = chunk_ends.iter().filter(|end| **end <= length).count();
        let expected = flight.events.len().min(whole_chunks * EVENTS_PER_CHUNK);
        assert_eq!(found.len(), expected, "{length}");
        assert_eq!(found, flight.events[..expected], "{length}");
        let [Event::Damage(damage)] = damage.as_slice() else {
            panic!("{damage:?}");
        };
        assert_eq!(damage.kind, DamageKind::Truncated, "{length}");
        assert!(damage.byte <= length as u64);
    }
}

#[test]
fn the_report_of_a_truncation_says_where_and_how_far() {
    let flight = flight();
    let end = flight.chunk_ends()[1] + 1000;
    let (_, damage) = read(&flight.with_bytes(&flight.bytes[..end])).unwrap();
    let Event::Damage(damage) = &damage[0] else {
        panic!("{damage:?}");
    };
    let message = damage.to_string();
    assert!(message.starts_with("truncated at byte "), "{message}");
    assert!(
        message.ends_with("; read up to t = 1.990000 s"),
        "{message}"
    );
}

#[test]
fn a_recorder_that_dies_leaves_all_but_the_last_second() {
    let flight = flight();
    let path = flight.folder.path().join("killed.mcap");
    let mut recorder = Recorder::create(&path, &Header::default()).unwrap();
    write(&mut recorder, &flight.events);
    let on_disk = std::fs::read(&path).unwrap();
    let (found, damage) = read(&flight.with_bytes(&on_disk)).unwrap();
    assert_eq!(found, flight.events[..3 * EVENTS_PER_CHUNK]);
    assert_eq!(damage.len(), 1);
}

#[test]
fn a_changed_byte_never_changes_what_is_read_in_silence() {
    let flight = flight();
    for (i, byte) in (0..flight.bytes.len()).step_by(4_999).enumerate() {
        let mut bytes = flight.bytes.clone();
        bytes[byte] ^= 1 << (i % 8);
        let Ok((found, damage)) = read(&flight.with_bytes(&bytes)) else {
            continue;
        };
        let mut expected = flight.events.iter();
        for event in &found {
            assert!(
                expected.any(|e| e == event),
                "byte {byte}: an event was made up"
            );
        }
        assert!(
            !damage.is_empty() || found.len() == flight.events.len(),
            "byte {byte}: {} of {} events, in silence",
            found.len(),
            flight.events.len()
        );
    }
}

#[test]
fn a_damaged_chunk_is_named_and_the_next_one_read() {
    let flight = flight();
    let ends = flight.chunk_ends();
    for chunk in 0..3 {
        let mut bytes = flight.bytes.clone();
        bytes[ends[chunk] - 5_000] ^= 0x10;
        let (found, damage) = read(&flight.with_bytes(&bytes)).unwrap();
        assert_eq!(found.len(), flight.events.len() - EVENTS_PER_CHUNK);
        assert_eq!(
            found[chunk * EVENTS_PER_CHUNK..],
            flight.events[(chunk + 1) * EVENTS_PER_CHUNK..]
        );
        let Event::Damage(damage) = &damage[0] else {
            panic!("{damage:?}");
        };
        let DamageKind::Unreadable { .. } = &damage.kind else {
            panic!("{damage}");
        };
        assert!((damage.byte as usize) < ends[chunk] - 5_000);
        assert!(damage.to_string().contains("damaged at byte"), "{damage}");
    }
}

#[test]
fn a_changed_byte_of_the_configuration_is_found() {
    let flight = flight();
    let place = flight
        .bytes
        .windows(10)
        .position(|window| window == b"gain = 1.0")
        .unwrap();
    let mut bytes = flight.bytes.clone();
    bytes[place + 7] = b'2';
    let path = flight.with_bytes(&bytes);
    let error = read(&path).unwrap_err();
    assert!(matches!(error, RecordError::ConfigChanged { .. }));
    let message = error.to_string();
    assert!(
        message.contains("the configuration in the recording was changed after the flight"),
        "{message}"
    );
    assert!(message.contains("part.mcap"), "{message}");
    let recording = Recording::open_unverified(&path).unwrap();
    assert!(recording.header().config_toml.starts_with("gain = 2.0"));
}

fn check_refusal(bytes: &[u8], part: &str) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.mcap");
    std::fs::write(&path, bytes).unwrap();
    let message = read(&path).unwrap_err().to_string();
    assert!(message.contains("bad.mcap"), "{message}");
    assert!(message.contains(part), "{message}");
}

#[test]
fn files_that_are_no_recordings_are_refused() {
    check_refusal(b"", "is not an MCAP file");
    check_refusal(b"timestamp,x,y\n1,2,3\n", "is not an MCAP file");
    check_refusal(mcap::MAGIC, "the file ends");
    let mut foreign = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::Writer::new(&mut foreign).unwrap();
    let channel = writer
        .add_channel(0, "/other", "json", &Default::default())
        .unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    drop(writer);
    check_refusal(foreign.get_ref(), "messages come first");
    let message = Recording::open("no/such.mcap").err().unwrap().to_string();
    assert!(message.contains("no/such.mcap") && message.contains("does not exist"));
}
