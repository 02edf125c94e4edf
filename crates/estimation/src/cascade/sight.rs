//! Raw flow and range as linear measurements of velocity and height, seen from the attitude of the
//! first stage (document O, equations 2.24 and 2.67 to 2.69).

use alula_geometry::Pose;
use alula_messages::Rejection;
use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2, Vector3};

use super::kalman::{HEIGHT, Seen, VELOCITY};
use super::past::Moment;

/// Least downward part of the axis of a downward sensor: 60 degrees of tilt.
const LEAST_DOWNWARD: f64 = 0.5;

/// Uncertainty of what the first stage says.
#[derive(Clone, Copy, Debug)]
pub struct FirstStage {
    /// Standard deviation of tilt, rad.
    pub tilt_sigma_rad: f64,
    /// Standard deviation of the angular rate, rad/s.
    pub rate_sigma_rad_s: f64,
}

/// The ground along the axis of a downward sensor.
struct Ground {
    /// Height of the sensor less that of the body's origin, m.
    lever_up_m: f64,
    /// Downward part of the axis, 0 to 1.
    downward: f64,
}

impl Ground {
    fn below(moment: &Moment, body_from_sensor: &Pose) -> Result<Self, Rejection> {
        let up = moment.world_from_body.inverse() * Vector3::z();
        let downward = -up.dot(&(body_from_sensor.rotation * Vector3::z()));
        if downward.is_nan() || downward < LEAST_DOWNWARD {
            return Err(Rejection::Invalid);
        }
        Ok(Self {
            lever_up_m: up.dot(&body_from_sensor.translation.vector),
            downward,
        })
    }

    /// Distance along the axis from a height of the body's origin, m.
    fn distance_m(&self, height_m: f64) -> f64 {
        (height_m + self.lever_up_m) / self.downward
    }

    /// Derivative of ln(distance) with respect to the tilt.
    fn tangent(&self) -> f64 {
        (1.0 - self.downward * self.downward).max(0.0).sqrt() / self.downward
    }
}

/// A range as a measurement of height: range * r - lever, with `r` the downward part of the beam.
///
/// # Errors
/// If the beam does not look down.
pub fn range(
    range_m: f64,
    sigma_m: f64,
    body_from_ranger: &Pose,
    moment: &Moment,
    age_s: f64,
    first: &FirstStage,
) -> Result<Seen<1>, Rejection> {
    let ground = Ground::below(moment, body_from_ranger)?;
    let height_m = range_m * ground.downward - ground.lever_up_m;
    let from_tilt = range_m * ground.downward * ground.tangent() * first.tilt_sigma_rad;
    Ok(Seen {
        innovation: SVector::from([height_m - moment.height_m]),
        jacobian: height_row(age_s),
        variance: SVector::from([(sigma_m * ground.downward).powi(2) + from_tilt.powi(2)]),
    })
}

/// Derivative of the height `age_s` ago with respect to the present state.
fn height_row(age_s: f64) -> SMatrix<f64, 1, 7> {
    let mut row = SMatrix::<f64, 1, 7>::zeros();
    row[HEIGHT] = 1.0;
    row[VELOCITY + 2] = -age_s;
    row
}

/// A reading of the flow camera with what the gyroscope says about the same interval.
#[derive(Clone, Copy, Debug)]
pub struct Flow {
    /// Image velocity, optical frame, rad/s.
    pub flow_rad_s: Vector2<f64>,
    /// Angular rate, body frame, bias removed, rad/s.
    pub angular_rate: Vector3<f64>,
    /// Standard deviation of the flow on each axis, rad/s.
    pub sigma_rad_s: f64,
    /// Distance along the optical axis below which the camera sees nothing sharp, m.
    pub min_distance_m: f64,
}

impl Flow {
    /// Flow as a measurement of velocity in the image plane. With the distance `d` from the
    /// filtered height, and the turning part `T w_c = (-w_y, w_x)` removed:
    /// (T w_c - flow) d - [C^T (w x t)]_xy = [C^T R^T v]_xy.
    ///
    /// # Errors
    /// If the camera does not look down, or is too close to the ground.
    pub fn seen(
        &self,
        body_from_camera: &Pose,
        moment: &Moment,
        age_s: f64,
        first: &FirstStage,
    ) -> Result<Seen<2>, Rejection> {
        let ground = Ground::below(moment, body_from_camera)?;
        let distance_m = ground.distance_m(moment.height_m);
        if distance_m.is_nan() || distance_m < self.min_distance_m {
            return Err(Rejection::Phase);
        }
        let camera_from_body = body_from_camera.rotation.inverse();
        let rate_camera = camera_from_body * self.angular_rate;
        let lever = body_from_camera.translation.vector;
        let swing = (camera_from_body * self.angular_rate.cross(&lever)).xy();
        let slope = Vector2::new(-rate_camera.y, rate_camera.x) - self.flow_rad_s;
        let velocity_image = slope * distance_m - swing;

        let image_from_world = Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
            * (camera_from_body * moment.world_from_body.inverse())
                .to_rotation_matrix()
                .into_inner();
        // What is measured grows with the height as well: it moves to the side of the prediction.
        let from_height = slope * (-1.0 / ground.downward);
        let mut jacobian = from_height * height_row(age_s);
        let mut target = jacobian.fixed_columns_mut::<3>(VELOCITY);
        target += image_from_world;

        let speed = moment.velocity_world.norm();
        let from_tilt =
            (speed + slope.norm() * distance_m * ground.tangent()) * first.tilt_sigma_rad;
        let from_image = self.sigma_rad_s.hypot(first.rate_sigma_rad_s) * distance_m;
        Ok(Seen {
            innovation: velocity_image - image_from_world * moment.velocity_world,
            jacobian,
            variance: Vector2::repeat(from_image * from_image + from_tilt * from_tilt),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::{Timestamp, so3};
    use alula_messages::{Looking, Mount};
    use nalgebra::{Point3, Translation3};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    const EXACT: FirstStage = FirstStage {
        tilt_sigma_rad: 0.0,
        rate_sigma_rad_s: 0.0,
    };

    fn mount() -> Pose {
        Mount {
            roll_pitch_yaw_deg: [2.0, -3.0, 5.0],
            ..Mount::at([0.1, -0.05, -0.07], Looking::Down)
        }
        .body_from_sensor()
    }

    /// One to five metres above ground, tilted by up to half a radian.
    fn random_moments() -> impl Iterator<Item = Moment> {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut draw = move || rng.random_range(-1.0..1.0);
        (0..50).map(move |_| {
            let mut vector = |size: f64| Vector3::from_fn(|_, _| draw() * size);
            Moment {
                time: Timestamp::ZERO,
                world_from_body: so3::exp(&(Vector3::z() * vector(3.0).x)) * so3::exp(&vector(0.3)),
                angular_rate: Vector3::zeros(),
                velocity_world: vector(3.0),
                height_m: 3.0 + vector(2.0).x,
            }
        })
    }

    fn flow() -> Flow {
        Flow {
            flow_rad_s: Vector2::new(0.3, -0.2),
            angular_rate: Vector3::new(0.4, -0.7, 0.2),
            sigma_rad_s: 0.015,
            min_distance_m: 0.3,
        }
    }

    /// The state `change` away from `moment`, where the height `age_s` ago lags.
    fn changed(moment: &Moment, change: &SVector<f64, 7>, age_s: f64) -> Moment {
        Moment {
            velocity_world: moment.velocity_world + change.fixed_rows::<3>(VELOCITY),
            height_m: moment.height_m + change[HEIGHT] - change[VELOCITY + 2] * age_s,
            ..*moment
        }
    }

    /// Both are linear in velocity and height: differences of any step are exact to rounding.
    fn check_jacobian<const M: usize>(seen: impl Fn(&Moment, f64) -> Seen<M>) {
        const AGE_S: f64 = 0.1;
        for here in random_moments() {
            let at = |change: &SVector<f64, 7>| seen(&changed(&here, change, AGE_S), AGE_S);
            let mut numeric = SMatrix::<f64, M, 7>::zeros();
            for i in 0..7 {
                let mut change = SVector::<f64, 7>::zeros();
                change[i] = 0.01;
                // The prediction is the measurement less the innovation.
                let column = (at(&-change).innovation - at(&change).innovation) / 0.02;
                numeric.set_column(i, &column);
            }
            assert!((numeric - seen(&here, AGE_S).jacobian).amax() < 1e-9);
        }
    }

    #[test]
    fn jacobians_meet_differences() {
        check_jacobian(|moment, age| flow().seen(&mount(), moment, age, &EXACT).unwrap());
        check_jacobian(|moment, age| range(2.0, 0.02, &mount(), moment, age, &EXACT).unwrap());
    }

    /// Pose of the sensor `t` later, and the point of the ground on its axis at `t` = 0.
    fn world_from_sensor(moment: &Moment, t: f64) -> Pose {
        let position = Vector3::z() * moment.height_m + moment.velocity_world * t;
        let attitude = moment.world_from_body * so3::exp(&(flow().angular_rate * t));
        Pose::from_parts(Translation3::from(position), attitude) * mount()
    }

    fn true_range_m(moment: &Moment) -> f64 {
        let pose = world_from_sensor(moment, 0.0);
        -pose.translation.z / (pose.rotation * Vector3::z()).z
    }

    #[test]
    fn the_true_range_leaves_no_innovation() {
        for moment in random_moments() {
            let seen = range(true_range_m(&moment), 0.02, &mount(), &moment, 0.0, &EXACT);
            assert!(seen.unwrap().innovation.norm() < 1e-12);
        }
    }

    /// Central differences of the projection with a step of 1e-5 s are good to 1e-9.
    #[test]
    fn the_motion_of_the_projected_ground_leaves_no_innovation() {
        for moment in random_moments() {
            let ground =
                world_from_sensor(&moment, 0.0) * Point3::new(0.0, 0.0, true_range_m(&moment));
            let image = |t: f64| {
                let p = world_from_sensor(&moment, t).inverse() * ground;
                p.coords.xy() / p.z
            };
            let read = Flow {
                flow_rad_s: (image(1e-5) - image(-1e-5)) / 2e-5,
                ..flow()
            };
            let seen = read.seen(&mount(), &moment, 0.0, &EXACT).unwrap();
            assert!(seen.innovation.norm() < 1e-7, "{}", seen.innovation);
        }
    }

    #[test]
    fn a_sensor_that_looks_forward_says_nothing_about_the_ground() {
        let forward = Mount::at([0.0; 3], Looking::Forward).body_from_sensor();
        let level = Moment {
            time: Timestamp::ZERO,
            world_from_body: so3::exp(&Vector3::zeros()),
            angular_rate: Vector3::zeros(),
            velocity_world: Vector3::zeros(),
            height_m: 1.0,
        };
        let found = range(1.0, 0.02, &forward, &level, 0.0, &EXACT);
        assert_eq!(found.unwrap_err(), Rejection::Invalid);
        let found = flow().seen(&forward, &level, 0.0, &EXACT);
        assert_eq!(found.unwrap_err(), Rejection::Invalid);
    }
}
