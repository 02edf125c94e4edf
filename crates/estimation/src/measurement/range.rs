//! Distance along the beam of a ranger that looks at the ground (document S, 2.4.4).

use alula_geometry::Pose;
use alula_messages::{Rejection, Sensor};
use nalgebra::{SVector, Vector1};

use super::Model;
use super::flow::distance_to_ground;
use crate::eskf::{Linearised, Nominal, Seen};

/// A reading of a ranger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeMeasurement {
    /// The kind of ranger.
    pub sensor: Sensor,
    /// Distance along the beam, m.
    pub range_m: f64,
    /// Calibrated pose of the ranger; the beam is its z axis.
    pub body_from_ranger: Pose,
    /// Standard deviation, m.
    pub sigma_m: f64,
}

impl Model<1> for RangeMeasurement {
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<1>, Rejection> {
        let (distance, jacobian) =
            distance_to_ground(nominal, &self.body_from_ranger).ok_or(Rejection::Invalid)?;
        Ok(Linearised {
            innovation: Vector1::new(self.range_m - distance),
            jacobian,
            variance: SVector::from([self.sigma_m * self.sigma_m]),
            from: Seen::FromBody,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::check_jacobian;
    use super::*;
    use alula_geometry::so3;
    use alula_messages::{Looking, Mount};
    use nalgebra::Vector3;

    fn measurement(mount: &Mount) -> RangeMeasurement {
        RangeMeasurement {
            sensor: Sensor::Infrared,
            range_m: 1.0,
            body_from_ranger: mount.body_from_sensor(),
            sigma_m: 0.02,
        }
    }

    #[test]
    fn jacobian_meets_differences() {
        check_jacobian(&measurement(&Mount {
            roll_pitch_yaw_deg: [-4.0, 3.0, 10.0],
            ..Mount::at([0.1, 0.2, -0.1], Looking::Down)
        }));
    }

    #[test]
    fn a_tilted_beam_is_longer_by_the_inverse_cosine() {
        let m = measurement(&Mount::at([0.0; 3], Looking::Down));
        let nominal = Nominal {
            position_world: Vector3::z() * 2.0,
            world_from_body: so3::from_roll_pitch_yaw(0.3, 0.0, 1.0),
            ..Nominal::default()
        };
        let seen = m.linearise(&nominal).unwrap();
        assert!((m.range_m - seen.innovation.x - 2.0 / 0.3_f64.cos()).abs() < 1e-12);
    }

    #[test]
    fn a_forward_beam_says_nothing_about_the_ground() {
        let m = measurement(&Mount::at([0.0; 3], Looking::Forward));
        assert_eq!(
            m.linearise(&Nominal::default()).unwrap_err(),
            Rejection::Invalid
        );
    }
}
