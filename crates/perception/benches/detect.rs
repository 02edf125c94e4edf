//! Time of the detector on one core. Budget: 0.35 ms median at 424x240, 1 ms at 320x240 with the
//! reduction from 640x480.

// Helpers of tests may fail like tests do.
#![allow(clippy::unwrap_used)]

#[path = "../tests/scene/mod.rs"]
mod scene;

use alula_geometry::PinholeCamera;
use alula_perception::detect::reduce;
use alula_perception::{Detector, DetectorConfig};

fn main() {
    divan::main();
}

fn sized(width_px: u32, height_px: u32) -> PinholeCamera {
    let [across, down] = [87.0, 58.0].map(f64::to_radians);
    PinholeCamera::from_field_of_view(width_px, height_px, across, down)
}

fn run(bencher: divan::Bencher, camera: PinholeCamera, pitch_deg: f64) {
    let view = scene::view(1.2, 0.0, pitch_deg, 0.0);
    let image = scene::render(camera, &view, &scene::room());
    let image = scene::noisy(&image, &mut scene::generator(1));
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    bencher.bench_local(|| detector.detect(&image, &view).len());
}

#[divan::bench(sample_count = 1000)]
fn level_424x240(bencher: divan::Bencher) {
    run(bencher, scene::camera(), 0.0);
}

#[divan::bench(sample_count = 1000)]
fn pitched_424x240(bencher: divan::Bencher) {
    run(bencher, scene::camera(), 20.0);
}

#[divan::bench(sample_count = 1000)]
fn level_640x480(bencher: divan::Bencher) {
    run(bencher, sized(640, 480), 0.0);
}

#[divan::bench(sample_count = 1000)]
fn reduced_to_320x240(bencher: divan::Bencher) {
    let view = scene::view(1.2, 0.0, 0.0, 0.0);
    let image = scene::render(sized(640, 480), &view, &scene::room());
    let image = scene::noisy(&image, &mut scene::generator(1));
    let mut detector = Detector::new(&DetectorConfig::default()).unwrap();
    let mut small = image.clone();
    bencher.bench_local(|| {
        reduce(&image, &mut small);
        detector.detect(&small, &view).len()
    });
}
