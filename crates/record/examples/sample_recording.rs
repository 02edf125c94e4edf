//! Writes a made-up minute of flight and says how fast that went.
//!
//! `cargo run --release -p alula-record --example sample_recording -- flight.mcap [depth]`

#![allow(clippy::print_stdout)]

#[path = "../tests/made/mod.rs"]
mod made;

use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use alula_geometry::{PinholeCamera, Pose, Timestamp};
use alula_messages::{DepthImage, Looking, Mount};
use alula_record::{Header, LogLevel, Person, Recorder, SceneShape};
use made::SmoothFlight;
use nalgebra::{Point3, Translation3, Vector3};

const SECONDS: i64 = 60;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or_else(|| "flight.mcap".to_owned());
    let with_depth = arguments.next().is_some();
    let header = Header {
        config_toml: "# made up\n".into(),
        scenario_name: "figure eight".into(),
        seed: 1,
        version: env!("CARGO_PKG_VERSION").into(),
    };
    let mut recorder = Recorder::create(&path, &header)?;
    draw_scene(&mut recorder)?;

    let mut flight = SmoothFlight::new();
    let (mut batch, mut output, mut truth) = Default::default();
    let mut took = Vec::new();
    for step in 0..SECONDS * SmoothFlight::RATE_HZ {
        flight.next(&mut batch, &mut output, &mut truth);
        if with_depth && step % 7 == 0 {
            batch.depth.push(depth_image(batch.now));
        }
        let start = Instant::now();
        recorder.write_batch(&batch)?;
        recorder.write_output(&output)?;
        took.push(start.elapsed());
        if let Some(truth) = &truth {
            recorder.write_truth(truth)?;
        }
        recorder.write_people(batch.now, [person(batch.now)])?;
    }
    recorder.finish()?;
    report(&path, took)
}

fn draw_scene(recorder: &mut Recorder) -> Result<(), Box<dyn Error>> {
    recorder.write_log(Timestamp::ZERO, LogLevel::Info, "take-off")?;
    recorder.write_scene(&[
        SceneShape::Box {
            world_from_box: Pose::translation(0.0, 3.0, 1.0),
            size_m: Vector3::new(1.0, 1.0, 2.0),
        },
        SceneShape::Cylinder {
            world_from_cylinder: Pose::translation(0.0, -3.0, 1.5),
            radius_m: 0.3,
            height_m: 3.0,
        },
        SceneShape::Sphere {
            centre_world: Point3::new(4.0, 0.0, 1.0),
            radius_m: 0.5,
        },
        SceneShape::Triangles {
            corners_world: vec![
                Point3::new(-5.0, -5.0, 0.0),
                Point3::new(5.0, -5.0, 0.0),
                Point3::new(0.0, 5.0, 0.0),
            ],
        },
    ]);
    let camera = Mount::at([0.0, 0.0, -0.05], Looking::Down).body_from_sensor();
    recorder.write_mount(Timestamp::ZERO, "flow_camera", &camera)?;
    Ok(())
}

fn person(time: Timestamp) -> Person {
    let place = Translation3::new((0.3 * time.as_s()).sin(), 4.0, 0.9);
    Person {
        id: 1,
        world_from_person: Pose::from_parts(place, nalgebra::UnitQuaternion::identity()),
        semi_axes_m: Vector3::new(0.4, 0.4, 0.9),
    }
}

fn depth_image(time: Timestamp) -> Arc<DepthImage> {
    let camera =
        PinholeCamera::from_field_of_view(424, 240, 87_f64.to_radians(), 58_f64.to_radians());
    let pixels = camera.width_px * camera.height_px;
    Arc::new(DepthImage {
        time,
        sensor: 0,
        camera,
        body_from_camera: Mount::at([0.1, 0.0, 0.0], Looking::Forward).body_from_sensor(),
        depth_mm: (0..pixels).map(|i| 500 + (i / 7 % 9000) as u16).collect(),
    })
}

fn report(path: &str, mut took: Vec<Duration>) -> Result<(), Box<dyn Error>> {
    let total: Duration = took.iter().sum();
    took.sort();
    let at = |share: usize| took[(took.len() - 1) * share / 1000];
    println!("{path}: {} bytes", std::fs::metadata(path)?.len());
    println!(
        "a batch with its output: mean {:?}, median {:?}, p99 {:?}, max {:?}; {:.0} a second",
        total / took.len() as u32,
        at(500),
        at(990),
        at(1000),
        took.len() as f64 / total.as_secs_f64()
    );
    Ok(())
}
