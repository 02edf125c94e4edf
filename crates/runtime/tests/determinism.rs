//! Same inputs, same bits.

// Helpers fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use std::fs;

use support::{SHORT, first_flight, flown, recorded};

/// A log as text: shortest decimal numbers tell all values apart.
fn story(overrides: &[&str], seed: u64) -> String {
    format!("{:?}", flown(&first_flight(overrides), seed).log)
}

fn recording(overrides: &[&str], seed: u64) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = recorded(&first_flight(overrides), seed, folder.path());
    fs::read(path).unwrap()
}

#[test]
fn two_flights_of_the_built_in_mission_leave_the_same_recording() {
    let (first, second) = (recording(&[], 5), recording(&[], 5));
    let difference = first.iter().zip(&second).position(|(a, b)| a != b);
    assert_eq!(difference, None, "first byte that differs");
    assert_eq!(first.len(), second.len());
}

#[test]
fn two_flights_with_the_same_seed_have_the_same_story() {
    assert_eq!(story(&SHORT, 3), story(&SHORT, 3));
}

#[test]
fn flights_with_different_seeds_differ() {
    assert_ne!(story(&SHORT, 3), story(&SHORT, 4));
    assert_ne!(recording(&SHORT, 3), recording(&SHORT, 4));
}

#[test]
fn recording_a_flight_does_not_change_it() {
    let folder = tempfile::tempdir().unwrap();
    let (with_recording, _) = recorded(&first_flight(&SHORT), 3, folder.path());
    assert_eq!(format!("{:?}", with_recording.log), story(&SHORT, 3));
}

#[test]
fn flights_at_the_same_time_do_not_touch_one_another() {
    let alone = story(&SHORT, 6);
    let together: Vec<String> = std::thread::scope(|scope| {
        let flights = [6, 7, 6].map(|seed| scope.spawn(move || story(&SHORT, seed)));
        flights.map(|flight| flight.join().unwrap()).into()
    });
    assert_eq!(together[0], alone);
    assert_eq!(together[2], alone);
    assert_ne!(together[1], alone);
}
