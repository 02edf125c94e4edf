//! Covariances tell the truth, and stay covariances whatever comes in.

// A helper that finds nothing should stop its test.
#![allow(clippy::unwrap_used)]

mod track_support;

use alula_geometry::Timestamp;
use alula_geometry::gaussian::chi_square_quantile;
use alula_messages::{Cut, Detection, Footprint, Obstacle, PixelBox};
use alula_perception::{Contour, Ray, RayEnd, Tracker, TrackerConfig};
use nalgebra::{Matrix3, Rotation2, Vector2, Vector3, Vector4};
use proptest::prelude::*;
use rand_pcg::Pcg64;
use track_support::{RATE_HZ, normal, random, stamp};

const SIGMA_M: [f64; 3] = [0.03, 0.06, 0.04];
const SIZE_SIGMA_M: f64 = 0.03;

fn noisy(centre: Vector3<f64>, size: Vector3<f64>, random: &mut Pcg64) -> Detection {
    let error = Vector3::from(SIGMA_M).map(|sigma| sigma * normal(random));
    Detection {
        sensor: 0,
        centre_world: centre + error,
        yaw_rad: 0.0,
        size_m: size.map(|length| length + SIZE_SIGMA_M * normal(random)),
        footprint: Footprint::Round,
        centre_covariance: Matrix3::from_diagonal(&Vector3::from(SIGMA_M).map(|s| s * s)),
        size_variance_m2: Vector3::repeat(SIZE_SIGMA_M * SIZE_SIGMA_M),
        cut: Cut::default(),
        window: PixelBox::default(),
        depth_m: [2.0, 2.5],
        pixels: 1000,
    }
}

/// The tracker's model without what is not in this test's truth: changes of shape, and judgements.
fn model_only() -> TrackerConfig {
    let mut config = TrackerConfig::default();
    config.model.shape_noise_m = 0.0;
    config.model.size_noise_m_sqrt_s = 0.0;
    config.model.turn_rate_deg_s = 0.0;
    config.model.turn_acceleration_noise_m_s2_sqrt_hz =
        config.model.steady_acceleration_noise_m_s2_sqrt_hz;
    config.motion.min_images = 1000;
    config.gate_probability = 0.999_999_9;
    config
}

/// How somebody's velocity turns: at a rate to either side, or not, after exponential times.
struct Way {
    rate_rad_s: f64,
    noise: f64,
}

impl Way {
    fn straight(noise: f64) -> Self {
        Self {
            rate_rad_s: 0.0,
            noise,
        }
    }

    fn drawn(&self, config: &TrackerConfig, random: &mut Pcg64) -> Self {
        let model = &config.model;
        let rate = model.turn_rate_deg_s.to_radians();
        let is_straight = self.rate_rad_s == 0.0;
        let mean_s = if is_straight {
            model.straight_s
        } else {
            model.turn_s
        };
        let stays = random.random::<f64>() < (-1.0 / (RATE_HZ * mean_s)).exp();
        let first = random.random::<bool>();
        let rate_rad_s = match (stays, is_straight) {
            (true, _) => self.rate_rad_s,
            (false, true) => {
                if first {
                    rate
                } else {
                    -rate
                }
            }
            (false, false) => {
                if first {
                    0.0
                } else {
                    -self.rate_rad_s
                }
            }
        };
        let noise = if rate_rad_s == 0.0 {
            model.steady_acceleration_noise_m_s2_sqrt_hz
        } else {
            model.turn_acceleration_noise_m_s2_sqrt_hz
        };
        Self { rate_rad_s, noise }
    }
}

/// Squared Mahalanobis error, of horizontal position and velocity, of the track of somebody who
/// goes ways that `next` draws, after `images`.
fn squared_error(
    config: &TrackerConfig,
    first: Way,
    next: impl Fn(&Way, &mut Pcg64) -> Way,
    images: usize,
    seed: u64,
) -> f64 {
    let mut tracker = Tracker::new(config).unwrap();
    let mut random = random(seed);
    let (size, dt) = (Vector3::new(0.5, 0.4, 1.8), 1.0 / RATE_HZ);
    let sigma = config.model.max_velocity_sigma_m_s;
    let mut way = first;
    let mut place = Vector2::new(3.0, 0.0);
    let mut velocity = Vector2::from_fn(|_, _| sigma * normal(&mut random));
    for image in 0..images {
        if image > 0 {
            way = next(&way, &mut random);
            let turn = Rotation2::new(way.rate_rad_s * dt);
            let before = velocity;
            velocity = turn * velocity;
            // The mean of both ends travels right to the third order of the angle.
            place += (before + velocity) * (0.5 * dt);
            let noise = way.noise;
            // Exact draw of white acceleration over one image: Cholesky of
            // q [dt^3/3, dt^2/2; dt^2/2, dt].
            for i in 0..2 {
                let (a, b) = (normal(&mut random), normal(&mut random));
                place[i] += noise * dt.powf(1.5) * (a / 2.0 + b / 12_f64.sqrt());
                velocity[i] += noise * dt.sqrt() * a;
            }
        }
        let centre = Vector3::new(place.x, place.y, 0.9);
        let seen = [noisy(centre, size, &mut random)];
        tracker.update(stamp(image), &seen, &Contour::default(), &Vector3::zeros());
    }
    let obstacle = &tracker.obstacles()[0];
    assert_eq!(obstacle.images as usize, images);
    let (position, speed) = (obstacle.centre_world, obstacle.velocity_world);
    let error = Vector4::new(
        position.x - place.x,
        position.y - place.y,
        speed.x - velocity.x,
        speed.y - velocity.y,
    );
    let rows = [0, 1, 3, 4];
    let covariance = nalgebra::Matrix4::from_fn(|i, j| obstacle.covariance[(rows[i], rows[j])]);
    error.dot(&covariance.cholesky().unwrap().solve(&error))
}

/// Sum over seeds and the band in which 99.9 % of such sums lie.
fn sum_and_band(config: &TrackerConfig, noise: f64, images: usize) -> (f64, f64, f64) {
    let runs = 200;
    let straight = |_: &Way, _: &mut Pcg64| Way::straight(noise);
    let sum = (0..runs)
        .map(|seed| squared_error(config, Way::straight(noise), straight, images, seed))
        .sum();
    let quantile = |p: f64| chi_square_quantile(p, 4 * runs as u32);
    (sum, quantile(0.0005), quantile(0.9995))
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    let config = model_only();
    let noise = config.model.steady_acceleration_noise_m_s2_sqrt_hz;
    for images in [2, 5, 20, 60] {
        let (sum, low, high) = sum_and_band(&config, noise, images);
        assert!(
            low < sum && sum < high,
            "{images} images: {sum} outside {low} to {high}"
        );
    }
}

#[test]
fn errors_at_constant_velocity_are_not_larger_than_the_covariance_says() {
    for images in [5, 20, 60] {
        let (sum, _, high) = sum_and_band(&model_only(), 0.0, images);
        assert!(sum < high, "{images} images: {sum} above {high}");
    }
}

/// The three filters are not exactly right together: they keep three of the many pasts.
#[test]
fn errors_of_those_who_turn_are_as_large_as_the_covariance_says() {
    let mut config = model_only();
    let defaults = TrackerConfig::default().model;
    config.model.turn_rate_deg_s = defaults.turn_rate_deg_s;
    config.model.turn_acceleration_noise_m_s2_sqrt_hz =
        defaults.turn_acceleration_noise_m_s2_sqrt_hz;
    let noise = config.model.steady_acceleration_noise_m_s2_sqrt_hz;
    let runs = 400;
    for images in [20, 60] {
        let next = |way: &Way, random: &mut Pcg64| way.drawn(&config, random);
        let sum: f64 = (0..runs)
            .map(|seed| squared_error(&config, Way::straight(noise), next, images, seed))
            .sum();
        let each = sum / (4.0 * runs as f64);
        assert!((0.8..1.3).contains(&each), "{images} images: {each}");
    }
}

fn check_obstacle(obstacle: &Obstacle, config: &TrackerConfig) {
    let covariance = obstacle.covariance;
    assert_eq!(covariance, covariance.transpose());
    let values = covariance.symmetric_eigenvalues();
    let (least, greatest) = (values.min(), values.max());
    assert!(least >= -1e-12 * greatest.max(1.0), "{least} of {greatest}");
    let velocity = covariance.fixed_view::<2, 2>(3, 3).into_owned();
    let bound = config.model.max_velocity_sigma_m_s.powi(2);
    assert!(velocity.symmetric_eigenvalues().max() <= bound * (1.0 + 1e-9));
    assert!(covariance[(5, 5)] <= config.model.max_vertical_velocity_sigma_m_s.powi(2) * 1.000_001);
    assert!(obstacle.centre_world.iter().all(|x| x.is_finite()));
    assert!(obstacle.size_m.iter().all(|&x| x > 0.0));
}

fn any_number(scale: f64) -> impl Strategy<Value = f64> {
    prop_oneof![20 => -scale..scale, 1 => Just(f64::NAN), 1 => Just(0.0), 1 => Just(1e300)]
}

prop_compose! {
    fn any_detection()(
        centre in prop::array::uniform3(any_number(5.0)),
        yaw in any_number(7.0),
        size in prop::array::uniform3(prop_oneof![9 => 0.0..1.5, 1 => 1.5..20.0]),
        root in prop::array::uniform9(-0.3..0.3),
        size_variance in prop::array::uniform3(0.0..0.3),
        cut in any::<[bool; 4]>(),
        columns in (0u16..300, 0u16..120),
        depth in 0.3..5.0,
        flat in prop::bool::weighted(0.3),
    ) -> Detection {
        let root = Matrix3::from_row_slice(&root);
        Detection {
            sensor: 0,
            centre_world: centre.into(),
            yaw_rad: yaw,
            size_m: size.into(),
            footprint: if flat { Footprint::Flat } else { Footprint::Round },
            centre_covariance: root * root.transpose(),
            size_variance_m2: size_variance.into(),
            cut: Cut { left: cut[0], right: cut[1], top: cut[2], bottom: cut[3] },
            window: PixelBox { left: columns.0, right: columns.0 + columns.1, top: 0, bottom: 99 },
            depth_m: [depth, depth + 0.5],
            pixels: 100,
        }
    }
}

prop_compose! {
    fn any_contour()(
        camera in prop::array::uniform3(any_number(1.0)),
        ranges in prop::collection::vec((any_number(8.0), 0..3), 0..20),
    ) -> Contour {
        let ray = |(i, &(range_m, end)): (usize, &(f64, i32))| Ray {
            heading_rad: 1.0 - 0.1 * i as f64,
            range_m,
            end: [RayEnd::Unknown, RayEnd::Free, RayEnd::Hit][end as usize],
        };
        Contour {
            time: Timestamp::ZERO,
            sensor: 0,
            camera_world: camera.into(),
            rays: ranges.iter().enumerate().map(ray).collect(),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..Default::default() })]

    #[test]
    fn covariances_stay_bounded_covariances_whatever_comes_in(
        images in prop::collection::vec(
            (prop::collection::vec(any_detection(), 0..12), any_contour(), -5_000_000_i64..300_000_000),
            1..25,
        ),
    ) {
        let config = TrackerConfig { max_tracks: 10, ..TrackerConfig::default() };
        let mut tracker = Tracker::new(&config).unwrap();
        let mut time = 0;
        for (seen, contour, step_ns) in &images {
            time += step_ns;
            let vehicle = contour.camera_world;
            let obstacles = tracker.update(Timestamp::from_ns(time), seen, contour, &vehicle);
            prop_assert!(obstacles.len() <= 10);
            let mut ids: Vec<_> = obstacles.iter().map(|o| o.id).collect();
            ids.dedup();
            prop_assert_eq!(ids.len(), obstacles.len());
            obstacles.iter().for_each(|o| check_obstacle(o, &config));
        }
    }
}
