//! Measurements: what each sensor should read in a state, its derivative, and its gate.

mod flow;
mod ground;
mod planar_velocity;
mod pose;
mod range;
mod sonar;

pub use flow::FlowMeasurement;
pub use ground::{AngularRateMeasurement, HoldMeasurement, VelocityMeasurement};
pub use planar_velocity::PlanarVelocityMeasurement;
pub use pose::{OrientationMeasurement, PositionMeasurement};
pub use range::RangeMeasurement;
pub use sonar::SonarMeasurement;

use alula_geometry::{Timestamp, gaussian::chi_square_quantile};
use alula_messages::{Fusion, Rejection, Sensor};
use nalgebra::Vector3;

use crate::eskf::{ErrorVector, Filter, Linearised, Nominal};

/// Chi-square thresholds for one, two and three degrees of freedom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gates([f64; 3]);

impl Gates {
    /// Gates that pass a good measurement with this probability.
    pub fn new(probability: f64) -> Self {
        Self([1, 2, 3].map(|degrees| chi_square_quantile(probability, degrees)))
    }

    /// The threshold for a measurement of one to three numbers.
    pub fn threshold(&self, dimension: usize) -> f64 {
        self.0[dimension.clamp(1, 3) - 1]
    }
}

/// A prediction of `M` numbers with its derivative.
trait Model<const M: usize> {
    /// The measurement seen from `nominal`.
    ///
    /// # Errors
    /// The reason why it says nothing in this state.
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<M>, Rejection>;
}

/// Something that corrects the filter at a point in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measurement {
    /// Raw flow.
    Flow(FlowMeasurement),
    /// Distance to the ground along a beam.
    Range(RangeMeasurement),
    /// Velocity along the image plane.
    PlanarVelocity(PlanarVelocityMeasurement),
    /// Distance to the nearest ground.
    Sonar(SonarMeasurement),
    /// External position.
    Position(PositionMeasurement),
    /// External orientation.
    Orientation(OrientationMeasurement),
    /// Standing still: velocity.
    GroundVelocity(VelocityMeasurement),
    /// Standing still: angular rate.
    GroundRate(AngularRateMeasurement),
    /// Standing at a known place and heading.
    GroundHold(HoldMeasurement),
    /// Not a reading but an admission: adds uncertainty with these standard deviations.
    Inflation(ErrorVector),
}

impl Measurement {
    /// The sensor it comes from; `None` for an inflation.
    pub fn sensor(&self) -> Option<Sensor> {
        match self {
            Self::Flow(_) | Self::PlanarVelocity(_) => Some(Sensor::Flow),
            Self::Range(range) => Some(range.sensor),
            Self::Sonar(_) => Some(Sensor::Sonar),
            Self::Position(_) => Some(Sensor::Position),
            Self::Orientation(_) => Some(Sensor::Orientation),
            Self::GroundVelocity(_) | Self::GroundRate(_) | Self::GroundHold(_) => {
                Some(Sensor::Ground)
            }
            Self::Inflation(_) => None,
        }
    }

    /// The interval over which it needs to know the mean angular rate, s, and where to put that.
    pub fn angular_rate_mut(&mut self) -> Option<(f64, &mut Vector3<f64>)> {
        match self {
            Self::Flow(m) => Some((m.interval_s, &mut m.angular_rate)),
            Self::PlanarVelocity(m) => Some((m.interval_s, &mut m.angular_rate)),
            _ => None,
        }
    }

    /// Corrects `filter` and says what came of it; `None` for an inflation.
    pub fn fuse(&self, time: Timestamp, filter: &mut Filter, gates: &Gates) -> Option<Fusion> {
        let sensor = self.sensor();
        let mut attempt = Attempt {
            time,
            filter,
            gates,
        };
        match self {
            Self::Flow(m) => Some(attempt.run(Sensor::Flow, m)),
            Self::Range(m) => Some(attempt.run(m.sensor, m)),
            Self::PlanarVelocity(m) => Some(attempt.run(Sensor::Flow, m)),
            Self::Sonar(m) => Some(attempt.run(Sensor::Sonar, m)),
            Self::Position(m) => Some(attempt.run(Sensor::Position, m)),
            Self::Orientation(m) => Some(attempt.run(Sensor::Orientation, m)),
            Self::GroundVelocity(m) => Some(attempt.run(Sensor::Ground, m)),
            Self::GroundRate(m) => Some(attempt.run(Sensor::Ground, m)),
            Self::GroundHold(m) => Some(attempt.run(Sensor::Ground, m)),
            Self::Inflation(sigma) => {
                debug_assert!(sensor.is_none());
                attempt.filter.inflate(sigma);
                None
            }
        }
    }
}

struct Attempt<'a> {
    time: Timestamp,
    filter: &'a mut Filter,
    gates: &'a Gates,
}

impl Attempt<'_> {
    fn run<const M: usize>(&mut self, sensor: Sensor, model: &impl Model<M>) -> Fusion {
        let gate = self.gates.threshold(M);
        let mut fusion = rejected(self.time, sensor, Rejection::NotFinite);
        fusion.gate = gate;
        let seen = match model.linearise(&self.filter.nominal) {
            Ok(seen) => seen,
            Err(reason) => {
                fusion.rejection = Some(reason);
                return fusion;
            }
        };
        if !seen.innovation.iter().all(|x| x.is_finite()) {
            return fusion;
        }
        let outcome = self.filter.fuse(&seen, gate);
        for i in 0..M {
            fusion.innovation[i] = seen.innovation[i];
            fusion.innovation_variance[i] = outcome.innovation_variance[i];
        }
        fusion.mahalanobis_squared = outcome.mahalanobis_squared;
        fusion.rejection = (!outcome.accepted).then_some(Rejection::Gate);
        fusion
    }
}

/// The record of a measurement that met no filter.
pub fn rejected(time: Timestamp, sensor: Sensor, reason: Rejection) -> Fusion {
    Fusion {
        time,
        sensor,
        innovation: [0.0; 3],
        innovation_variance: [0.0; 3],
        mahalanobis_squared: 0.0,
        gate: 1.0,
        rejection: Some(reason),
    }
}

/// Variances of three equal standard deviations.
fn variances(sigma: f64) -> Vector3<f64> {
    Vector3::repeat(sigma * sigma)
}

#[cfg(test)]
mod testing {
    use super::*;
    use alula_geometry::so3;
    use nalgebra::{SMatrix, SVector};
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    /// States one to five metres above ground, tilted by up to half a radian.
    pub fn random_states() -> impl Iterator<Item = Nominal> {
        let mut rng = Pcg64::seed_from_u64(7);
        let mut draw = move || rng.random_range(-1.0..1.0);
        (0..50).map(move |_| {
            let mut vector = |size: f64| Vector3::from_fn(|_, _| draw() * size);
            Nominal {
                position_world: vector(2.0) + Vector3::z() * 3.0,
                velocity_world: vector(3.0),
                world_from_body: so3::from_roll_pitch_yaw(0.0, 0.0, vector(3.0).x)
                    * so3::exp(&vector(0.3)),
                accelerometer_bias: vector(0.2),
                gyroscope_bias: vector(0.1),
            }
        })
    }

    /// Checks the Jacobian against central differences: with a step of 1e-6 they are good to
    /// 1e-12 (curvature) and 1e-10 (rounding) of values up to ten.
    pub fn check_jacobian<const M: usize>(model: &impl Model<M>) {
        const H: f64 = 1e-6;
        for nominal in random_states() {
            let seen = model.linearise(&nominal).unwrap();
            let innovation = |error: &ErrorVector| -> SVector<f64, M> {
                model.linearise(&nominal.plus(error)).unwrap().innovation
            };
            let mut numeric = SMatrix::<f64, M, 15>::zeros();
            for k in 0..15 {
                let mut error = ErrorVector::zeros();
                error[k] = H;
                // The prediction is the measurement less the innovation.
                let column = (innovation(&-error) - innovation(&error)) / (2.0 * H);
                numeric.set_column(k, &column);
            }
            let difference = (numeric - seen.jacobian).amax();
            assert!(
                difference < 1e-7,
                "{difference}: {numeric} {}",
                seen.jacobian
            );
        }
    }
}
