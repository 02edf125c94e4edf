//! What was written is read back, bit by bit.

// Helpers fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

mod made;

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use alula_geometry::{Pose, Timestamp};
use alula_messages::{Command, ImuSample, SensorBatch, StackOutput};
use alula_record::{Event, Header, LogEntry, LogLevel, Person, Recorder, Recording, SceneShape};
use made::{Numbers, SmoothFlight, events};
use nalgebra::{Point3, Vector3};

fn header() -> Header {
    Header {
        config_toml: "[vehicle]\nname = \"quad\"\n".into(),
        scenario_name: "figure eight".into(),
        seed: u64::MAX,
        version: "0.1.0".into(),
    }
}

fn record(path: &Path, events: &[Event]) {
    let mut recorder = Recorder::create(path, &header()).unwrap();
    for event in events {
        match event {
            Event::Batch(batch) => recorder.write_batch(batch),
            Event::Output(output) => recorder.write_output(output),
            Event::Truth(truth) => recorder.write_truth(truth),
            Event::Log(entry) => recorder.write_log(entry.time, entry.level, &entry.text),
            Event::Damage(_) => Ok(()),
        }
        .unwrap();
    }
    recorder.finish().unwrap();
}

fn read(path: &Path) -> Vec<Event> {
    let recording = Recording::open(path).unwrap();
    recording.collect::<Result<_, _>>().unwrap()
}

fn read_back(events: &[Event]) -> Vec<Event> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    record(&path, events);
    read(&path)
}

/// Printed, numbers show every bit except those of a NaN: 0 and -0 differ, a NaN equals itself.
fn assert_same(found: &[Event], expected: &[Event]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!(format!("{found:?}"), format!("{expected:?}"));
    }
}

#[test]
fn a_flight_reads_back_as_it_was_written() {
    let events = events(&mut Numbers::plain(1), 300);
    assert_eq!(read_back(&events), events);
}

#[test]
fn special_values_read_back_as_they_were_written() {
    let events = events(&mut Numbers::with_special_values(2), 300);
    assert_same(&read_back(&events), &events);
}

#[test]
fn the_payload_of_a_nan_is_kept() {
    let nan = f64::from_bits(0xfff0_dead_beef_0001);
    let batch = SensorBatch {
        imu: vec![ImuSample {
            time: Timestamp::from_ns(i64::MIN),
            specific_force: Vector3::new(nan, 0.0, -0.0),
            angular_rate: Vector3::zeros(),
        }],
        ..SensorBatch::default()
    };
    let found = read_back(&[Event::Batch(batch)]);
    let [Event::Batch(found)] = found.as_slice() else {
        panic!("{found:?}");
    };
    assert_eq!(found.imu[0].time, Timestamp::from_ns(i64::MIN));
    assert_eq!(found.imu[0].specific_force.x.to_bits(), nan.to_bits());
    assert_eq!(
        found.imu[0].specific_force.z.to_bits(),
        (-0.0_f64).to_bits()
    );
}

#[test]
fn a_command_that_the_guard_changed_in_one_bit_is_told_apart() {
    let command = |yaw_rate_rad_s| Command::TiltClimb {
        roll_rad: f64::NAN,
        pitch_rad: 0.0,
        yaw_rate_rad_s,
        climb_rate_m_s: 0.0,
    };
    let events = [Event::Output(Box::new(StackOutput {
        requested: command(-0.0),
        command: command(0.0),
        ..StackOutput::default()
    }))];
    assert_same(&read_back(&events), &events);
}

#[test]
fn a_step_that_saw_nothing_is_not_one_that_did_not_look() {
    let seen_at = |seen_at| {
        Event::Output(Box::new(StackOutput {
            seen_at,
            ..StackOutput::default()
        }))
    };
    let events = [
        seen_at(None),
        seen_at(Some(Timestamp::from_ns(-3))),
        seen_at(None),
    ];
    assert_eq!(read_back(&events), events);
}

#[test]
fn the_log_reads_back() {
    let entry = |ns, level, text: &str| {
        Event::Log(LogEntry {
            time: Timestamp::from_ns(ns),
            level,
            text: text.into(),
        })
    };
    let events = [
        entry(0, LogLevel::Info, "take-off"),
        entry(5, LogLevel::Warning, "flow lost: 1 s"),
        entry(1_403_715_273_262_142_976, LogLevel::Error, "mötors off"),
    ];
    assert_eq!(read_back(&events), events);
}

#[test]
fn the_header_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    record(&path, &[]);
    assert_eq!(Recording::open(&path).unwrap().header(), &header());
    assert!(read(&path).is_empty());
}

#[test]
fn viewing_messages_are_not_events_but_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(&path, &header()).unwrap();
    recorder.write_scene(&[
        SceneShape::Box {
            world_from_box: Pose::identity(),
            size_m: Vector3::new(1.0, 2.0, 3.0),
        },
        SceneShape::Sphere {
            centre_world: Point3::origin(),
            radius_m: 1.0,
        },
    ]);
    let person = Person {
        id: 3,
        world_from_person: Pose::identity(),
        semi_axes_m: Vector3::new(0.4, 0.4, 0.9),
    };
    let mut flight = SmoothFlight::new();
    let (mut batch, mut output, mut truth) = Default::default();
    for _ in 0..2 * SmoothFlight::RATE_HZ {
        flight.next(&mut batch, &mut output, &mut truth);
        recorder.write_batch(&batch).unwrap();
        recorder.write_output(&output).unwrap();
        recorder.write_people(batch.now, [person]).unwrap();
        recorder
            .write_mount(batch.now, "imu", &Pose::identity())
            .unwrap();
    }
    recorder.finish().unwrap();

    let summary = Recording::open(&path).unwrap().summary().unwrap();
    assert_eq!((summary.batches, summary.outputs), (400, 400));
    assert!(summary.damage.is_empty());
    assert!((summary.duration_s() - 1.995).abs() < 1e-12);
    let count = |topic: &str| summary.topics.get(topic).map_or(0, |t| t.messages);
    assert_eq!(count("/sensors/imu"), 400);
    assert_eq!(count("/estimate/state"), 400);
    // Once a chunk, and there are two.
    assert_eq!(count("/mode"), 2);
    assert_eq!(count("/guard"), 2);
    assert_eq!(count("/tf_static"), 2);
    assert_eq!(count("/tf"), 100);
    assert_eq!(count("/pose"), 100);
    assert_eq!(count("/people"), 20);
    assert_eq!(count("/estimate/sigma"), 20);
    assert_eq!(count("/path"), 2);
    assert_eq!(count("/scene"), 1);
    assert_eq!(summary.topics["/scene"].schema, "foxglove.SceneUpdate");
    assert_eq!(summary.topics["/command"].schema, "alula.StepCommand");
    assert_eq!(read(&path).len(), 800);
}

/// Records a second of flight in which every step of 200 Hz sees one obstacle and makes a plan, and
/// every tenth brings the image; returns the number of messages of a topic.
fn count_of_sights(topic: &str) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(&path, &header()).unwrap();
    let mut flight = SmoothFlight::new();
    let (mut batch, mut output, mut truth) = Default::default();
    let mut numbers = Numbers::plain(3);
    for step in 0..SmoothFlight::RATE_HZ {
        flight.next(&mut batch, &mut output, &mut truth);
        output.seen_at = Some(batch.now);
        output.detections = vec![made::detection(&mut numbers)];
        output.obstacles = vec![made::obstacle(&mut numbers)];
        output.plan = Some(made::plan(&mut numbers));
        if step % 10 == 0 {
            let mut ahead = made::depth(&mut numbers, batch.now);
            Arc::make_mut(&mut ahead).sensor = 0;
            batch.depth = vec![ahead];
        }
        recorder.write_batch(&batch).unwrap();
        recorder.write_output(&output).unwrap();
        recorder
            .write_u_depth(batch.now, 6, 2, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 300, 11])
            .unwrap();
    }
    recorder.finish().unwrap();
    let summary = Recording::open(&path).unwrap().summary().unwrap();
    assert!(summary.damage.is_empty());
    summary.topics.get(topic).map_or(0, |t| t.messages)
}

#[test]
fn obstacles_are_drawn_ten_times_a_second() {
    assert_eq!(count_of_sights("/scene/obstacles"), 10);
}

#[test]
fn plans_are_drawn_ten_times_a_second() {
    assert_eq!(count_of_sights("/scene/plan"), 10);
}

#[test]
fn boxes_are_drawn_over_the_images_that_are_in_the_recording() {
    assert_eq!(count_of_sights("/camera/annotations"), 20);
}

#[test]
fn u_depth_maps_are_drawn_five_times_a_second() {
    assert_eq!(count_of_sights("/u_depth"), 5);
}

#[test]
fn all_plans_are_recorded() {
    assert_eq!(count_of_sights("/plan"), 200);
}

#[test]
fn a_minute_without_depth_fits_in_the_budget() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(&path, &header()).unwrap();
    let mut flight = SmoothFlight::new();
    let (mut batch, mut output, mut truth) = Default::default();
    for _ in 0..60 * SmoothFlight::RATE_HZ {
        flight.next(&mut batch, &mut output, &mut truth);
        recorder.write_batch(&batch).unwrap();
        recorder.write_output(&output).unwrap();
        if let Some(truth) = &truth {
            recorder.write_truth(truth).unwrap();
        }
    }
    recorder.finish().unwrap();
    let bytes = File::open(&path).unwrap().metadata().unwrap().len();
    // 120 numbers of a covariance 200 times a second are 11.5 MB that do not compress; the rest
    // of the flight has to fit beside them.
    assert!(bytes < 22_000_000, "{bytes}");
}
