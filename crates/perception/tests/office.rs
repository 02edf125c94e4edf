//! The detector on a recording of a static office: what stands still must be found where it was.

// Helpers of tests may fail like tests do.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[path = "../../../tests/percentile.rs"]
mod percentile;

use std::path::PathBuf;
use std::time::Instant;

use alula_messages::{Detection, Footprint};
use alula_perception::detect::reduce;
use alula_perception::{Detector, DetectorConfig, View};
use alula_record::seven_scenes::{self, Frame};
use nalgebra::Matrix3;
use percentile::percentile;

/// Boxes of neighbouring frames further apart than this, m, are not the same thing.
const SAME_M: f64 = 0.3;
/// Standard deviation of the poses of the fusion, rad.
const POSE_SIGMA_RAD: f64 = 0.005;

fn folder() -> Option<PathBuf> {
    let data = std::env::var_os("ALULA_DATA").map(PathBuf::from);
    let folder = data
        .map(|data| data.join("kinect_office"))
        .filter(|folder| folder.is_dir());
    if folder.is_none() {
        println!("skipped: ALULA_DATA names no folder with `kinect_office`");
    }
    folder
}

/// A Kinect: the structured light of its first generation is less noisy than stereo (Khoshelham and
/// Elberink, 2012: 1.4 mm at 1 m, growing with the square).
fn config() -> DetectorConfig {
    DetectorConfig {
        noise_per_m: 0.0015,
        ..DetectorConfig::default()
    }
}

/// Whether the image shows all of a box's width.
fn is_whole(detection: &Detection) -> bool {
    !(detection.cut.left || detection.cut.right)
}

/// Distances, m, seen from above, from each whole box to the one of its kind nearest in `others`.
fn moves<'a>(boxes: &'a [Detection], others: &'a [Detection]) -> impl Iterator<Item = f64> + 'a {
    boxes.iter().filter(|b| is_whole(b)).map(move |b| {
        let same = others.iter().filter(|o| o.footprint == b.footprint);
        let apart = same.map(|o| (o.centre_world - b.centre_world).xy().norm());
        apart.fold(f64::INFINITY, f64::min)
    })
}

/// What was measured over a recording.
#[derive(Default)]
struct Measured {
    times_ms: Vec<f64>,
    boxes: usize,
    round: usize,
    whole: usize,
    /// Moves of the boxes that were found again, m.
    moves_m: Vec<f64>,
}

impl Measured {
    fn add(&mut self, found: &[Detection], before: &[Detection]) {
        self.boxes += found.len();
        let round = found.iter().filter(|b| b.footprint == Footprint::Round);
        self.round += round.count();
        let all_m: Vec<f64> = moves(found, before).collect();
        self.whole += all_m.len();
        self.moves_m.extend(all_m.iter().filter(|m| **m < SAME_M));
    }
}

fn measure(frames: &[Frame]) -> Measured {
    let upright = seven_scenes::upright(frames.iter().step_by(10)).unwrap();
    let mut detector = Detector::new(&config()).unwrap();
    let mut small = frames[0].image.clone();
    let mut measured = Measured::default();
    let mut before: Option<Vec<Detection>> = None;
    for frame in frames {
        let view = View {
            world_from_body: upright.pose(&frame.world_from_camera),
            orientation_covariance: Matrix3::identity() * POSE_SIGMA_RAD.powi(2),
            floor_height_m: Some(upright.floor_height_m),
        };
        let start = Instant::now();
        reduce(&frame.image, &mut small);
        let found = detector.detect(&small, &view).to_vec();
        measured.times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        if let Some(before) = before {
            measured.add(&found, &before);
        }
        before = Some(found);
    }
    measured
}

#[test]
fn boxes_of_an_office_stay_where_they_are() {
    let Some(folder) = folder() else { return };
    let frames: Vec<Frame> = seven_scenes::open(folder)
        .unwrap()
        .map(Result::unwrap)
        .collect();
    let mut measured = measure(&frames);
    let pairs = (frames.len() - 1) as f64;
    let again = measured.moves_m.len() as f64 / measured.whole as f64;
    let [median_m, p90_m] = [0.5, 0.9].map(|share| percentile(&mut measured.moves_m, share));
    let [median_ms, p99_ms] = [0.5, 0.99].map(|share| percentile(&mut measured.times_ms, share));
    let (boxes, round) = (measured.boxes as f64 / pairs, measured.round as f64 / pairs);
    println!("{boxes:.1} boxes an image, {round:.1} of them round");
    println!("{again:.3} of the whole ones are found again in the next image");
    println!("they move {median_m:.3} m (median), {p90_m:.3} m (p90)");
    println!("reduction and detection take {median_ms:.2} ms (median), {p99_ms:.2} ms (p99)");
    // What is measured is 0.92, 8 mm and 0.10 m: the limits say where a change is a loss. Ends of
    // surfaces come and go behind others and at the border as the camera moves, hence the p90.
    assert!(again > 0.85);
    assert!(median_m < 0.02);
    assert!(p90_m < 0.15);
}
