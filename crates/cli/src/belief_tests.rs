//! Facts about the figures of what was believed, from a made-up flight past a walking person.

use std::sync::Arc;

use alula_geometry::{PinholeCamera, Pose};
use alula_messages::{
    Cut, DepthImage, Detection, FlightMode, Footprint, Hindrance, Looking, Mount,
    ObstacleCovariance, PixelBox, Plan, SensorBatch, StackOutput,
};
use alula_record::TruthRecord;
use alula_sim::world::{Assets, WorldConfig};

use super::*;

const WORLD: &str = r#"
[[obstacles]]
kind = "cylinder"
centre_m = [0.0, 2.0]
radius_m = 0.3

[[people]]
waypoints_m = [[4.0, -1.5], [-4.0, -1.5]]
speed_m_s = 1.2
semi_axes_m = [0.4, 0.4, 0.9]
"#;

const START_M: f64 = -4.0;

fn world() -> World {
    let config: WorldConfig = toml::from_str(WORLD).unwrap();
    let none: &Assets<'_> = &|file: &str| Err(format!("{file}: no files here"));
    World::new(&config, 1, none).unwrap()
}

fn obstacle(
    id: u32,
    motion: ObstacleMotion,
    centre: Vector3<f64>,
    velocity: Vector3<f64>,
) -> Obstacle {
    Obstacle {
        id,
        time: Timestamp::ZERO,
        centre_world: centre,
        velocity_world: velocity,
        covariance: ObstacleCovariance::from_diagonal_element(0.02),
        yaw_rad: 0.3,
        size_m: Vector3::new(0.8, 0.7, 1.8),
        size_variance_m2: Vector3::repeat(0.01),
        footprint: Footprint::Round,
        motion,
        sight: Sight::Seen,
        last_seen: Timestamp::ZERO,
        images: 10,
    }
}

/// What a flat wall at 3 m with a thing at 1.5 m before it would look like.
fn image(time: Timestamp) -> Arc<DepthImage> {
    let camera = PinholeCamera::from_field_of_view(64, 40, 1.5, 1.0);
    let depth_mm = (0..64 * 40).map(|i| {
        if (20..36).contains(&(i % 64)) {
            1500
        } else {
            3000
        }
    });
    Arc::new(DepthImage {
        time,
        sensor: 0,
        camera,
        body_from_camera: Mount::at([0.1, 0.0, 0.0], Looking::Forward).body_from_sensor(),
        depth_mm: depth_mm.collect(),
    })
}

fn detection() -> Detection {
    Detection {
        sensor: 0,
        centre_world: Vector3::zeros(),
        yaw_rad: 0.0,
        size_m: Vector3::repeat(0.8),
        footprint: Footprint::Round,
        centre_covariance: Matrix3::identity(),
        size_variance_m2: Vector3::zeros(),
        cut: Cut::default(),
        window: PixelBox {
            left: 20,
            right: 35,
            top: 0,
            bottom: 39,
        },
        depth_m: [1.5, 1.6],
        pixels: 640,
    }
}

fn output(time: Timestamp, place: Vector3<f64>) -> StackOutput {
    let mut plan = Plan {
        time,
        target_world: place + Vector3::x() * 2.0,
        iterations: 3,
        max_violation_m: 0.01,
        ..Plan::default()
    };
    for (i, point) in plan.points.iter_mut().enumerate() {
        point.position_world = place + Vector3::x() * 0.06 * i as f64;
    }
    let person = Vector3::new(4.0 - 1.2 * time.as_s(), -1.5, 0.9);
    let state = alula_messages::NavState {
        world_from_body: Pose::from(place),
        ..alula_messages::NavState::default()
    };
    StackOutput {
        time,
        state,
        mode: FlightMode::Flying,
        seen_at: Some(time),
        detections: vec![detection()],
        obstacles: vec![
            obstacle(
                1,
                ObstacleMotion::Static,
                Vector3::new(0.0, 2.0, 1.0),
                Vector3::zeros(),
            ),
            obstacle(2, ObstacleMotion::Moving, person, -1.2 * Vector3::x()),
        ],
        plan: Some(plan),
        hindrance: (2.0..3.0)
            .contains(&time.as_s())
            .then_some(Hindrance::NoRoute),
        ..StackOutput::default()
    }
}

/// Eight seconds along x at 1 m/s, a step every 0.05 s.
fn figures() -> BeliefFigures {
    let world = world();
    let mut belief = BeliefLog::default();
    let mut log = FlightLog::default();
    for step in 0..160 {
        let time = Timestamp::from_ns(step * 50_000_000);
        let place = Vector3::new(START_M + time.as_s(), 0.0, 1.0);
        let truth = TruthRecord {
            time,
            world_from_body: Pose::from(place),
            velocity_world: Vector3::x(),
            clearance_m: None,
        };
        let batch = SensorBatch {
            now: time,
            depth: vec![image(time)],
            ..SensorBatch::default()
        };
        let output = output(time, place);
        log.push(&output, &truth);
        belief.push(&batch, &output, &truth, &world);
    }
    BeliefFigures::new(&belief, &log, &world, 0.4, &Eye::default()).unwrap()
}

fn drawn() -> Vec<String> {
    figures().figures().into_iter().map(|f| f.svg).collect()
}

#[test]
fn a_flight_that_saw_nothing_has_no_figures() {
    let (belief, log) = (BeliefLog::default(), FlightLog::default());
    let figures = BeliefFigures::new(&belief, &log, &world(), 0.4, &Eye::default());
    assert!(figures.is_none());
}

#[test]
fn figures_are_valid_documents() {
    for svg in drawn() {
        let options = resvg::usvg::Options::default();
        resvg::usvg::Tree::from_str(&svg, &options).expect("valid SVG");
        assert!(!svg.contains("NaN") && !svg.contains("inf\""));
    }
}

#[test]
fn a_moment_shows_image_and_map() {
    let moments: Vec<String> = drawn()
        .into_iter()
        .filter(|svg| svg.contains("plan"))
        .collect();
    assert!(moments.len() >= 2, "{}", moments.len());
    for svg in moments {
        // Depth image, U-depth map, and the bars of colours of both.
        assert_eq!(svg.matches("data:image/png;base64,").count(), 4);
        for legend in [
            "believed to stand",
            "believed to move",
            "2 sigma of its place",
            "velocity",
        ] {
            assert!(svg.contains(legend), "{legend}");
        }
    }
}

#[test]
fn the_nearest_thing_is_named() {
    assert!(drawn().iter().any(|svg| svg.contains("m from person 1")));
}

#[test]
fn the_distance_chart_has_the_line_of_contact() {
    let chart = &figures().charts[0];
    let line = chart.series.iter().find(|s| s.name == "0.40 m").unwrap();
    assert!(line.points.iter().all(|p| p.1 == 0.4));
}

#[test]
fn the_reason_for_standing_still_is_in_a_table() {
    let tables = figures().tables();
    assert_eq!(tables[0].rows[0].cells[0], "2.0");
}

#[test]
fn the_ellipse_of_a_turned_covariance_has_its_axes() {
    let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), 0.5);
    let axes = Matrix3::from_diagonal(&Vector3::new(0.09, 0.01, 1.0));
    let covariance = turn.matrix() * axes * turn.matrix().transpose();
    let Outline::Ellipse {
        half_axes,
        angle_rad,
        ..
    } = sigma_ellipse(&Vector3::zeros(), &covariance, 2.0)
    else {
        panic!("not an ellipse");
    };
    assert!((half_axes.0 - 0.6).abs() < 1e-9 && (half_axes.1 - 0.2).abs() < 1e-9);
    assert!((angle_rad - 0.5).abs() < 1e-9);
}

#[test]
fn classes_of_speed_reach_the_greatest_speed() {
    for max_m_s in [0.0, 0.3, 1.6, 2.44] {
        assert!(speed_step(max_m_s) * SPEEDS.len() as f64 >= max_m_s);
    }
}
