//! Sensors against motions that are known in closed form.

use alula_geometry::{Pose, TimeDelta, Timestamp, gravity_world, so3};
use alula_messages::{Looking, Mount, SensorBatch};
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector2, Vector3};

use super::noise::mean_and_variance;
use super::*;
use crate::world::{World, WorldConfig};

/// Step of the simulation.
const STEP: TimeDelta = TimeDelta::from_ns(1_000_000);

/// Level ground at height zero and nothing else.
fn level_ground() -> World {
    World::new(&WorldConfig::default(), 0, &|_| Err("no files".into())).unwrap()
}

/// A motion in closed form.
type Motion = fn(f64) -> Pose;

/// Truth at a time, by central differences over 20 us.
fn truth(motion: Motion, time: Timestamp) -> Truth {
    let h = 1e-5;
    let t = time.as_s();
    let (before, now, after) = (motion(t - h), motion(t), motion(t + h));
    let [p0, p1, p2] = [before, now, after].map(|pose| pose.translation.vector);
    Truth {
        time,
        world_from_body: now,
        velocity_world: (p2 - p0) / (2.0 * h),
        acceleration_world: (p2 - p1 * 2.0 + p0) / (h * h),
        angular_rate_body: so3::log(&(before.rotation.inverse() * after.rotation)) / (2.0 * h),
        angular_acceleration_body: Vector3::zeros(),
        on_ground: false,
    }
}

/// Everything that arrives in `duration_s` of a motion.
fn fly(
    config: &SensorSuiteConfig,
    seed: u64,
    duration_s: f64,
    motion: Motion,
    motors: MotorActivity,
) -> SensorBatch {
    let world = level_ground();
    let mut suite = SensorSuite::new(config, seed).unwrap();
    let mut batch = SensorBatch::default();
    let mut from = truth(motion, Timestamp::ZERO);
    while from.time < Timestamp::from_s(duration_s) {
        let to = truth(motion, from.time + STEP);
        suite.advance(&world, &from, &to, &motors);
        suite.deliver(to.time, &mut batch);
        from = to;
    }
    batch
}

fn level_at(x_m: f64, y_m: f64, z_m: f64) -> Pose {
    Pose::from_parts(Translation3::new(x_m, y_m, z_m), UnitQuaternion::identity())
}

fn hover(_: f64) -> Pose {
    level_at(0.0, 0.0, 1.5)
}

/// Hovering with the right side down by 10 degrees.
fn tilted_by_10(_: f64) -> Pose {
    Pose::from_parts(
        Translation3::new(0.0, 0.0, 1.5),
        so3::from_roll_pitch_yaw(10_f64.to_radians(), 0.0, 0.0),
    )
}

fn tilted_by_30(_: f64) -> Pose {
    Pose::from_parts(
        Translation3::new(0.0, 0.0, 1.5),
        so3::from_roll_pitch_yaw(30_f64.to_radians(), 0.0, 0.0),
    )
}

/// Moving and turning about all axes.
fn waving(t: f64) -> Pose {
    let shift = Vector3::new((2.0 * t).sin(), 0.7 * (1.5 * t).cos(), 1.5 + 0.3 * t.sin());
    let turn = so3::from_roll_pitch_yaw(0.2 * (3.0 * t).sin(), 0.15 * (2.5 * t).cos(), 0.4 * t);
    Pose::from_parts(Translation3::from(shift), turn)
}

/// An inertial unit without any error.
fn perfect_imu() -> ImuModel {
    ImuModel {
        accelerometer_noise_m_s2_sqrt_hz: 0.0,
        accelerometer_bias_walk_m_s3_sqrt_hz: 0.0,
        accelerometer_bias_m_s2: Some([0.0; 3]),
        accelerometer_vibration_m_s2_sqrt_hz: 0.0,
        gyroscope_noise_rad_s_sqrt_hz: 0.0,
        gyroscope_bias_walk_rad_s2_sqrt_hz: 0.0,
        gyroscope_bias_rad_s: Some([0.0; 3]),
        gyroscope_vibration_rad_s_sqrt_hz: 0.0,
        ..ImuModel::default()
    }
}

fn only_imu(imu: ImuModel) -> SensorSuiteConfig {
    SensorSuiteConfig {
        imu,
        ..SensorSuiteConfig::default()
    }
}

/// All sensors, each with its defaults.
fn everything() -> SensorSuiteConfig {
    SensorSuiteConfig {
        sonar: Some(SonarSetup {
            mount: Mount::at([0.0, 0.0, -0.03], Looking::Down),
            model: SonarModel::default(),
        }),
        motion_capture: Some(MotionCaptureModel::default()),
        ..SensorSuiteConfig::small_multirotor()
    }
}

/// Variances within 4 of their standard errors, sqrt(2/n), of what they should be.
fn check_variance(values: &[f64], expected: f64) {
    let (_, variance) = mean_and_variance(values);
    let standard_error = (2.0 / values.len() as f64).sqrt();
    assert!(
        (variance / expected - 1.0).abs() < 4.0 * standard_error,
        "{variance} is not {expected}"
    );
}

#[test]
fn a_perfect_imu_reads_the_change_of_velocity_and_of_attitude() {
    let batch = fly(
        &only_imu(perfect_imu()),
        1,
        1.0,
        waving,
        MotorActivity::default(),
    );
    for pair in batch.imu.windows(2) {
        let [start, end] = [0, 1].map(|i| truth(waving, pair[i].time));
        let interval_s = end.time.seconds_since(start.time);
        let turn = start.world_from_body.rotation.inverse() * end.world_from_body.rotation;
        assert!((pair[1].angular_rate - so3::log(&turn) / interval_s).norm() < 1e-9);
        let change_world = (end.velocity_world - start.velocity_world) / interval_s;
        let middle = start
            .world_from_body
            .rotation
            .slerp(&end.world_from_body.rotation, 0.5);
        let specific_force = middle.inverse() * (change_world - gravity_world());
        // Within 4 ms the body turns by up to 3 mrad against the middle: to second order.
        assert!((pair[1].specific_force - specific_force).norm() < 1e-4);
    }
}

#[test]
fn white_noise_has_its_density_at_any_rate() {
    for rate_hz in [200.0, 500.0] {
        let imu = ImuModel {
            rate_hz,
            accelerometer_noise_m_s2_sqrt_hz: 1.317e-3,
            gyroscope_noise_rad_s_sqrt_hz: 1.143e-4,
            ..perfect_imu()
        };
        let batch = fly(&only_imu(imu), 1, 20.0, hover, MotorActivity::default());
        let force: Vec<f64> = batch.imu.iter().map(|s| s.specific_force.y).collect();
        let rate: Vec<f64> = batch.imu.iter().map(|s| s.angular_rate.z).collect();
        check_variance(&force, 1.317e-3_f64.powi(2) * rate_hz);
        check_variance(&rate, 1.143e-4_f64.powi(2) * rate_hz);
    }
}

#[test]
fn propellers_add_noise_in_proportion_to_thrust() {
    let imu = ImuModel {
        accelerometer_vibration_m_s2_sqrt_hz: 0.02,
        ..perfect_imu()
    };
    let motors = MotorActivity {
        armed: true,
        thrust_fraction: 0.5,
    };
    let batch = fly(&only_imu(imu), 1, 20.0, hover, motors);
    let force: Vec<f64> = batch.imu.iter().map(|s| s.specific_force.x).collect();
    check_variance(&force, 0.01_f64.powi(2) * 250.0);
}

#[test]
fn the_variance_of_a_bias_grows_in_proportion_to_time() {
    let imu = ImuModel {
        rate_hz: 50.0,
        accelerometer_bias_walk_m_s3_sqrt_hz: 0.1,
        gyroscope_bias_walk_rad_s2_sqrt_hz: 0.02,
        ..perfect_imu()
    };
    let runs: Vec<SensorBatch> = (0..1000)
        .map(|seed| {
            fly(
                &only_imu(imu.clone()),
                seed,
                0.4,
                hover,
                MotorActivity::default(),
            )
        })
        .collect();
    for (index, time_s) in [(4, 0.1), (9, 0.2), (19, 0.4)] {
        let force: Vec<f64> = runs
            .iter()
            .map(|run| run.imu[index].specific_force.x)
            .collect();
        let rate: Vec<f64> = runs
            .iter()
            .map(|run| run.imu[index].angular_rate.y)
            .collect();
        check_variance(&force, 0.1_f64.powi(2) * time_s);
        check_variance(&rate, 0.02_f64.powi(2) * time_s);
    }
}

#[test]
fn initial_biases_are_drawn_from_their_sigma_or_given() {
    let imu = ImuModel {
        accelerometer_bias_m_s2: None,
        accelerometer_bias_sigma_m_s2: 0.5,
        gyroscope_bias_rad_s: Some([0.01, -0.02, 0.03]),
        ..perfect_imu()
    };
    let first = |seed| {
        fly(
            &only_imu(imu.clone()),
            seed,
            0.005,
            hover,
            MotorActivity::default(),
        )
        .imu[0]
    };
    let drawn: Vec<f64> = (0..1000).map(|seed| first(seed).specific_force.x).collect();
    check_variance(&drawn, 0.25);
    assert!((first(7).angular_rate - Vector3::new(0.01, -0.02, 0.03)).norm() < 1e-12);
}

#[test]
fn scale_acts_on_the_truth_and_the_limit_on_the_reading() {
    let imu = ImuModel {
        accelerometer_scale: [1.0, 1.0, 1.1],
        accelerometer_limit_m_s2: 10.0,
        ..perfect_imu()
    };
    let at_limit = fly(
        &only_imu(imu.clone()),
        1,
        0.1,
        hover,
        MotorActivity::default(),
    );
    assert!(at_limit.imu.iter().all(|s| s.specific_force.z == 10.0));
    let imu = ImuModel {
        accelerometer_limit_m_s2: 20.0,
        ..imu
    };
    let scaled = fly(&only_imu(imu), 1, 0.1, hover, MotorActivity::default());
    assert!((scaled.imu[3].specific_force.z + 1.1 * gravity_world().z).abs() < 1e-9);
}

/// Flow camera and infrared ranger without noise, off the centre and askew.
fn perfect_downward() -> SensorSuiteConfig {
    let mount = Mount {
        position_m: [0.1, -0.05, -0.04],
        looking: Looking::Down,
        roll_pitch_yaw_deg: [2.0, -3.0, 30.0],
    };
    SensorSuiteConfig {
        flow: Some(FlowSetup {
            mount: mount.clone(),
            model: FlowModel {
                rate_hz: 400.0,
                noise_rad_s: 0.0,
                ..FlowModel::default()
            },
        }),
        infrared: Some(InfraredSetup {
            mount,
            model: InfraredModel {
                noise_m: 0.0,
                ..InfraredModel::default()
            },
        }),
        ..only_imu(perfect_imu())
    }
}

/// Image velocity of the ground point that the camera has at its principal point at `t`, by
/// central differences of its projection.
fn flow_by_differences(body_from_camera: &Pose, t: f64) -> Vector2<f64> {
    let camera = |t: f64| waving(t) * body_from_camera;
    let now = camera(t);
    let axis = now.rotation * Vector3::z();
    let point_world =
        Point3::from(now.translation.vector - axis * (now.translation.vector.z / axis.z));
    let project = |t: f64| {
        let p = camera(t).inverse() * point_world;
        Vector2::new(p.x / p.z, p.y / p.z)
    };
    let h = 1e-5;
    (project(t + h) - project(t - h)) / (2.0 * h)
}

#[test]
fn flow_is_the_image_velocity_of_the_ground_at_the_principal_point() {
    let config = perfect_downward();
    let mount = config.flow.as_ref().unwrap().mount.body_from_sensor();
    let batch = fly(&config, 1, 2.0, waving, MotorActivity::default());
    assert!(batch.flow.len() > 700);
    for sample in batch.flow.iter().filter(|s| s.quality > 0.0) {
        let expected = flow_by_differences(&mount, sample.time.as_s());
        // Sampling in 1 ms pieces of an interval of 2.5 ms: T^2/8 times the second derivative of
        // the flow, below 100 rad/s^3.
        assert!(
            (sample.flow_rad_s - expected).norm() < 1e-4,
            "{sample:?} {expected}"
        );
    }
}

#[test]
fn flow_has_no_quality_too_near_the_ground_or_too_fast() {
    let config = perfect_downward();
    let quality = |motion: Motion| {
        let batch = fly(&config, 1, 0.1, motion, MotorActivity::default());
        batch.flow[5].quality
    };
    assert_eq!(quality(hover), 1.0);
    assert_eq!(quality(|_| level_at(0.0, 0.0, 0.3)), 0.0);
    assert_eq!(quality(|t| level_at(5.0 * t, 0.0, 1.5)), 0.0);
    assert_eq!(quality(|_| level_at(0.0, 0.0, 20.0)), 0.0);
    let moderate = quality(|t| level_at(1.5 * t, 0.0, 1.5));
    assert!(moderate > 0.7 && moderate < 0.9);
}

#[test]
fn noise_of_flow_infrared_and_sonar_has_its_sigma() {
    let batch = fly(&everything(), 1, 60.0, hover, MotorActivity::default());
    let flow: Vec<f64> = batch.flow.iter().map(|s| s.flow_rad_s.x).collect();
    let infrared: Vec<f64> = batch.infrared.iter().map(|s| s.range_m).collect();
    let sonar: Vec<f64> = batch.sonar.iter().map(|s| s.range_m).collect();
    check_variance(&flow, 0.015_f64.powi(2));
    check_variance(&infrared, 0.02_f64.powi(2));
    check_variance(&sonar, 0.05_f64.powi(2));
    for ranges in [infrared, sonar] {
        let (mean, variance) = mean_and_variance(&ranges);
        assert!((mean - 1.47).abs() < 4.0 * (variance / ranges.len() as f64).sqrt());
    }
}

/// Sonar and infrared ranger at the centre, without noise.
fn perfect_rangers(wrong_echo_probability: f64) -> SensorSuiteConfig {
    SensorSuiteConfig {
        sonar: Some(SonarSetup {
            mount: Mount::at([0.0; 3], Looking::Down),
            model: SonarModel {
                noise_m: 0.0,
                wrong_echo_probability,
                ..SonarModel::default()
            },
        }),
        infrared: Some(InfraredSetup {
            mount: Mount::at([0.0; 3], Looking::Down),
            model: InfraredModel {
                noise_m: 0.0,
                ..InfraredModel::default()
            },
        }),
        ..SensorSuiteConfig::default()
    }
}

#[test]
fn a_tilted_sonar_still_reads_the_height_and_a_tilted_infrared_ranger_the_slant() {
    let batch = fly(
        &perfect_rangers(1.0),
        1,
        1.0,
        tilted_by_10,
        MotorActivity::default(),
    );
    let slant_m = 1.5 / 10_f64.to_radians().cos();
    assert!(batch.sonar.iter().all(|s| (s.range_m - 1.5).abs() < 1e-6));
    assert!(
        batch
            .infrared
            .iter()
            .all(|s| (s.range_m - slant_m).abs() < 1e-6)
    );
}

#[test]
fn a_sonar_tilted_beyond_20_degrees_gets_wrong_echoes() {
    let batch = fly(
        &perfect_rangers(0.3),
        1,
        100.0,
        tilted_by_30,
        MotorActivity::default(),
    );
    // The nearest ground in the cone lies 10 degrees off the vertical.
    let true_m = 1.5 / 10_f64.to_radians().cos();
    let wrong = batch
        .sonar
        .iter()
        .filter(|s| (s.range_m - true_m).abs() > 1e-6)
        .count() as f64;
    let expected = 0.3 * batch.sonar.len() as f64;
    assert!((wrong - expected).abs() < 4.0 * (0.7 * expected).sqrt());
    assert!(batch.sonar.iter().all(|s| s.is_valid()));
}

#[test]
fn rangers_say_when_they_are_too_near_or_too_far() {
    let readings = |motion: Motion| {
        let batch = fly(
            &perfect_rangers(0.0),
            1,
            0.2,
            motion,
            MotorActivity::default(),
        );
        (batch.sonar[0], batch.infrared[0])
    };
    let (sonar, infrared) = readings(|_| level_at(0.0, 0.0, 0.2));
    assert!(sonar.range_m < sonar.min_m && infrared.is_valid());
    let (sonar, infrared) = readings(|_| level_at(0.0, 0.0, 8.0));
    assert!(sonar.range_m > sonar.max_m && infrared.is_valid());
    let (_, infrared) = readings(|_| level_at(0.0, 0.0, 30.0));
    assert!(infrared.range_m > infrared.max_m);
}

#[test]
fn motion_capture_has_its_noise_and_its_losses() {
    let config = SensorSuiteConfig {
        motion_capture: Some(MotionCaptureModel {
            loss_probability: 0.1,
            ..MotionCaptureModel::default()
        }),
        ..SensorSuiteConfig::default()
    };
    let batch = fly(&config, 1, 60.0, tilted_by_10, MotorActivity::default());
    let truth = tilted_by_10(0.0);
    let error = |s: &alula_messages::PoseSample| truth.inverse() * s.world_from_body;
    let shifts: Vec<f64> = batch.poses.iter().map(|s| error(s).translation.x).collect();
    let turns: Vec<f64> = batch
        .poses
        .iter()
        .map(|s| so3::log(&error(s).rotation).y)
        .collect();
    check_variance(&shifts, 0.001_f64.powi(2));
    check_variance(&turns, 0.002_f64.powi(2));
    // 20 ms of latency hold back the last 3 of 7200.
    assert!((batch.poses.len() as f64 - 0.9 * 7197.0).abs() < 4.0 * (7197_f64 * 0.09).sqrt());
}

#[test]
fn samples_are_taken_on_time_and_arrive_after_their_latency() {
    let world = level_ground();
    let config = everything();
    let mut suite = SensorSuite::new(&config, 1).unwrap();
    let mut from = truth(waving, Timestamp::ZERO);
    let latencies_s = [0.0, 0.01, 0.02, 0.002, 0.03, 0.02, 0.005];
    let mut counts = [0_usize; 7];
    for _ in 0..400 {
        let to = truth(waving, from.time + STEP);
        let mut batch = SensorBatch::default();
        suite.advance(&world, &from, &to, &MotorActivity::default());
        suite.deliver(to.time, &mut batch);
        let half = |s: &alula_messages::FlowSample| TimeDelta::from_s(0.5 * s.interval_s);
        let taken: [Vec<Timestamp>; 7] = [
            batch.imu.iter().map(|s| s.time).collect(),
            batch.flow.iter().map(|s| s.time + half(s)).collect(),
            batch.sonar.iter().map(|s| s.time).collect(),
            batch.infrared.iter().map(|s| s.time).collect(),
            batch.depth.iter().map(|s| s.time).collect(),
            batch.poses.iter().map(|s| s.time).collect(),
            batch.autopilot.iter().map(|s| s.time).collect(),
        ];
        for (sensor, times) in taken.iter().enumerate() {
            for &time in times {
                let arrival = time + TimeDelta::from_s(latencies_s[sensor]);
                assert!(arrival > from.time && arrival <= to.time, "sensor {sensor}");
                counts[sensor] += 1;
            }
        }
        from = to;
    }
    // 0.4 s at 250, 100, 15, 50, 30, 120 and 50 Hz, less what is still on its way.
    assert_eq!(counts, [100, 39, 5, 19, 11, 45, 19]);
}

#[test]
fn further_depth_cameras_are_numbered_look_elsewhere_and_change_no_other() {
    let alone = fly(&everything(), 5, 0.5, waving, MotorActivity::default());
    let mut behind = everything().depth.unwrap();
    behind.mount.roll_pitch_yaw_deg = [0.0, 0.0, 180.0];
    let config = SensorSuiteConfig {
        more_depth: vec![behind],
        ..everything()
    };
    let both = fly(&config, 5, 0.5, waving, MotorActivity::default());
    let of = |sensor| both.depth.iter().filter(move |i| i.sensor == sensor);
    assert!(of(0).eq(&alone.depth));
    assert_eq!(of(1).count(), alone.depth.len());
    let axis = |sensor| of(sensor).next().unwrap().body_from_camera * Vector3::z();
    assert!((axis(0) + axis(1)).norm() < 1e-12);
    // At the same times, in the order of their numbers.
    for pair in both.depth.chunks(2) {
        assert_eq!((pair[0].sensor, pair[1].sensor), (0, 1));
        assert_eq!(pair[0].time, pair[1].time);
        assert_ne!(pair[0].depth_mm, pair[1].depth_mm);
    }
    let too_many = SensorSuiteConfig {
        more_depth: vec![config.more_depth[0].clone(); 4],
        ..config
    };
    let error = SensorSuite::new(&too_many, 1).err().unwrap();
    assert_eq!(
        error.to_string(),
        "`more_depth` is a list of 4; allowed is at most 3"
    );
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_others() {
    let motors = MotorActivity {
        armed: true,
        thrust_fraction: 0.5,
    };
    let run = |seed| fly(&everything(), seed, 0.5, waving, motors);
    assert_eq!(run(5), run(5));
    let (a, b) = (run(5), run(6));
    assert!(a.imu[0] != b.imu[0] && a.flow[0] != b.flow[0] && a.depth[0] != b.depth[0]);
    assert!(a.sonar[0] != b.sonar[0] && a.infrared[0] != b.infrared[0]);
    assert!(a.poses[0] != b.poses[0] && a.autopilot != b.autopilot);
}

#[test]
fn leaving_a_sensor_out_changes_no_other() {
    let with = fly(&everything(), 5, 0.5, waving, MotorActivity::default());
    let config = SensorSuiteConfig {
        flow: None,
        depth: None,
        ..everything()
    };
    let without = fly(&config, 5, 0.5, waving, MotorActivity::default());
    assert!(without.flow.is_empty() && without.depth.is_empty());
    assert_eq!(with.imu, without.imu);
    assert_eq!(with.sonar, without.sonar);
    assert_eq!(with.poses, without.poses);
}

#[test]
fn a_failure_leaves_the_samples_around_it_as_they_were() {
    let healthy = fly(&everything(), 5, 1.0, waving, MotorActivity::default());
    let mut config = everything();
    config.imu.failures.push(FailureConfig {
        kind: FailureKind::Outliers,
        start_s: 0.3,
        duration_s: 0.2,
        ..FailureConfig::default()
    });
    let failing = fly(&config, 5, 1.0, waving, MotorActivity::default());
    for (a, b) in healthy.imu.iter().zip(&failing.imu) {
        let inside = a.time >= Timestamp::from_s(0.3) && a.time < Timestamp::from_s(0.5);
        let shift = (a.specific_force - b.specific_force).norm();
        assert!((shift - f64::from(u8::from(inside))).abs() < 1e-12);
    }
}

#[test]
fn a_scenario_can_describe_sensors_and_their_failures() {
    let text = r#"
        imu.rate_hz = 400.0
        [flow]
        mount = { position_m = [0.0, 0.0, 0.0], looking = "down", roll_pitch_yaw_deg = [0.0, 0.0, 0.0] }
        model.failures = [{ kind = "drop_out", start_s = 5.0, duration_s = 2.0 }]
    "#;
    let config: SensorSuiteConfig = toml::from_str(text).unwrap();
    assert!(config.sonar.is_none());
    let failures = &config.flow.as_ref().unwrap().model.failures;
    assert_eq!(failures[0].kind, FailureKind::DropOut);
    let mut wrong = config.clone();
    wrong.imu.rate_hz = 5.0;
    let error = SensorSuite::new(&wrong, 1).err().unwrap();
    assert_eq!(error.key, "imu.rate_hz");
}
