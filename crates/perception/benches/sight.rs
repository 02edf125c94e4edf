//! Time from a depth image to the tracks on one core: median, 99th percentile and worst. Budget:
//! 0.5 ms median and 1 ms p99 at 424x240.

// Helpers of tests may fail like tests do.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[path = "../../../tests/percentile.rs"]
mod percentile;
#[path = "../tests/scene/mod.rs"]
mod scene;

use std::time::Instant;

use alula_geometry::Timestamp;
use alula_messages::{DepthImage, Detection};
use alula_perception::{Detector, DetectorConfig, Tracker, TrackerConfig, View};
use percentile::percentile;

/// Images of a turn to and fro.
const IMAGES: usize = 120;
/// How often the turn is seen.
const TURNS: usize = 25;
/// Time between images, s.
const INTERVAL_S: f64 = 1.0 / 30.0;

fn main() {
    let images = images();
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    let mut tracker = Tracker::new(&TrackerConfig::default()).unwrap();
    let mut both_ms = Vec::with_capacity(IMAGES * TURNS);
    let mut tracking_ms = Vec::with_capacity(IMAGES * TURNS);
    let mut detections: Vec<Detection> = Vec::with_capacity(256);
    let mut found = 0;
    for step in 0..IMAGES * TURNS {
        let (image, view) = &images[step % IMAGES];
        let mut image = image.clone();
        image.time = Timestamp::from_s(INTERVAL_S * step as f64);
        let start = Instant::now();
        detections.clear();
        detections.extend_from_slice(detector.detect(&image, view));
        let seen = Instant::now();
        let position = view.world_from_body.translation.vector;
        tracker.update(image.time, &detections, detector.contour(), &position);
        both_ms.push(start.elapsed().as_secs_f64() * 1e3);
        tracking_ms.push(seen.elapsed().as_secs_f64() * 1e3);
        found += detections.len();
    }
    let quietest = quietest_ms(&both_ms);
    let mean = found as f64 / (IMAGES * TURNS) as f64;
    println!(
        "{} images of 424x240, {mean:.1} detections in each",
        IMAGES * TURNS
    );
    print("detection and tracking", &mut both_ms);
    print("of which tracking", &mut tracking_ms);
    println!("in the quietest turn     median {quietest:.3} ms");
    println!("budget: 0.5 ms median, 1 ms p99");
}

/// Least median of the turns, ms: what the program takes while nothing else wants the core.
fn quietest_ms(both_ms: &[f64]) -> f64 {
    let turns = both_ms.chunks_exact(IMAGES);
    let medians = turns.map(|turn| percentile(&mut turn.to_vec(), 0.5));
    medians.fold(f64::INFINITY, f64::min)
}

/// What a camera sees that turns to and fro in a room with people and furniture.
fn images() -> Vec<(DepthImage, View)> {
    let mut random = scene::generator(1);
    let image = |step: usize| {
        let yaw_deg = 30.0 * (std::f64::consts::TAU * step as f64 / IMAGES as f64).sin();
        let view = scene::view(1.2, 0.0, 10.0, yaw_deg);
        let image = scene::render(scene::camera(), &view, &scene::room());
        (scene::noisy(&image, &mut random), view)
    };
    (0..IMAGES).map(image).collect()
}

fn print(name: &str, times_ms: &mut [f64]) {
    let [median, p99, worst] = [0.5, 0.99, 1.0].map(|share| percentile(times_ms, share));
    println!("{name:24} median {median:.3} ms, p99 {p99:.3} ms, worst {worst:.3} ms");
}
