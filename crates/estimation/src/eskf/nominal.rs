//! The nominal state, and what the inertial unit says about how it moves.

use alula_geometry::{gravity_world, so3};
use alula_messages::error_index;
use nalgebra::{SVector, UnitQuaternion, Vector3};

use super::QuaternionIntegration;
use error_index::{ACCELEROMETER_BIAS, GYROSCOPE_BIAS, ORIENTATION, POSITION, VELOCITY};

/// The error state in the order of [`error_index`], its orientation part local.
pub type ErrorVector = SVector<f64, 15>;

/// What the inertial unit says about an interval of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialInput {
    /// Specific force, body frame, m/s^2, bias included.
    pub specific_force: Vector3<f64>,
    /// Angular rate, body frame, rad/s, bias included.
    pub angular_rate: Vector3<f64>,
    /// That of the sample before, rad/s.
    pub previous_angular_rate: Vector3<f64>,
    /// Time between the two samples, s.
    pub interval_s: f64,
    /// Factor on the standard deviation of the white noise: 1, or more for invented samples.
    pub noise_scale: f64,
}

impl InertialInput {
    /// A sample with nothing known of the one before.
    pub fn steady(specific_force: Vector3<f64>, angular_rate: Vector3<f64>) -> Self {
        Self {
            specific_force,
            angular_rate,
            previous_angular_rate: angular_rate,
            interval_s: 0.0,
            noise_scale: 1.0,
        }
    }

    /// The constant rate that turns the body over the interval as the integration has it.
    ///
    /// Q1 (document S, equation 2.33c): its term dt^2/24 w0 x w1 in the vector part of a quaternion
    /// is a rotation by dt^2/12 w0 x w1; as part of a rotation vector it leaves the length at 1.
    pub(super) fn rate(
        &self,
        integration: QuaternionIntegration,
        bias: &Vector3<f64>,
    ) -> Vector3<f64> {
        let (before, after) = (self.previous_angular_rate - bias, self.angular_rate - bias);
        match integration {
            QuaternionIntegration::Q0F => before,
            QuaternionIntegration::Q0B => after,
            QuaternionIntegration::Q1 => {
                (before + after) * 0.5 + before.cross(&after) * (self.interval_s / 12.0)
            }
        }
    }
}

/// The nominal state (document S, equation 2.1b).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nominal {
    /// Position of the body's origin, world frame, m.
    pub position_world: Vector3<f64>,
    /// Its velocity, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Orientation.
    pub world_from_body: UnitQuaternion<f64>,
    /// Accelerometer bias, body frame, m/s^2.
    pub accelerometer_bias: Vector3<f64>,
    /// Gyroscope bias, body frame, rad/s.
    pub gyroscope_bias: Vector3<f64>,
}

impl Default for Nominal {
    fn default() -> Self {
        Self {
            position_world: Vector3::zeros(),
            velocity_world: Vector3::zeros(),
            world_from_body: UnitQuaternion::identity(),
            accelerometer_bias: Vector3::zeros(),
            gyroscope_bias: Vector3::zeros(),
        }
    }
}

impl Nominal {
    /// The composition of nominal state and error (document S, equations 2.2, 2.3b).
    pub fn plus(&self, error: &ErrorVector) -> Self {
        let part = |row| error.fixed_rows::<3>(row).into_owned();
        Self {
            position_world: self.position_world + part(POSITION),
            velocity_world: self.velocity_world + part(VELOCITY),
            world_from_body: renormalised(self.world_from_body * so3::exp(&part(ORIENTATION))),
            accelerometer_bias: self.accelerometer_bias + part(ACCELEROMETER_BIAS),
            gyroscope_bias: self.gyroscope_bias + part(GYROSCOPE_BIAS),
        }
    }

    /// The error that composed with `self` gives `other`.
    pub fn error_to(&self, other: &Self) -> ErrorVector {
        let turn = so3::log(&(self.world_from_body.inverse() * other.world_from_body));
        let mut error = ErrorVector::zeros();
        let mut set = |row, part: Vector3<f64>| error.fixed_rows_mut::<3>(row).copy_from(&part);
        set(POSITION, other.position_world - self.position_world);
        set(VELOCITY, other.velocity_world - self.velocity_world);
        set(ORIENTATION, turn);
        set(
            ACCELEROMETER_BIAS,
            other.accelerometer_bias - self.accelerometer_bias,
        );
        set(GYROSCOPE_BIAS, other.gyroscope_bias - self.gyroscope_bias);
        error
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let vectors = [
            self.position_world,
            self.velocity_world,
            self.accelerometer_bias,
            self.gyroscope_bias,
        ];
        vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
            && self.world_from_body.coords.iter().all(|x| x.is_finite())
    }

    /// Acceleration of the body's origin under `input`, world frame, m/s^2.
    pub fn acceleration_world(&self, input: &InertialInput) -> Vector3<f64> {
        self.world_from_body * (input.specific_force - self.accelerometer_bias) + gravity_world()
    }
}

/// One step of a unit quaternion towards length 1: exact to rounding after each composition.
pub(super) fn renormalised(q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let factor = 1.5 - 0.5 * q.coords.norm_squared();
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::from(q.coords * factor))
}
