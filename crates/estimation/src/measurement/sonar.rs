//! Height above the ground from an ultrasonic ranger (document S, 2.4.2).

use alula_geometry::Pose;
use alula_messages::{Rejection, error_index};
use nalgebra::{SMatrix, SVector, Vector1, Vector3};

use super::Model;
use crate::eskf::{Linearised, Nominal, Seen};

/// A reading of a sonar: its strongest echo comes from where the ground is nearest, whatever the
/// tilt (document S, figure 2.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SonarMeasurement {
    /// Distance to the nearest ground, m.
    pub range_m: f64,
    /// Calibrated pose of the sonar.
    pub body_from_sonar: Pose,
    /// Standard deviation, m.
    pub sigma_m: f64,
}

/// Height of a point of the body above the plane z = 0, and that axis in the body.
fn height_of(nominal: &Nominal, lever: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let up_body = nominal.world_from_body.inverse() * Vector3::z();
    (nominal.position_world.z + up_body.dot(lever), up_body)
}

impl SonarMeasurement {
    /// The reading less what `nominal` predicts, m.
    pub fn residual_m(&self, nominal: &Nominal) -> f64 {
        self.range_m - height_of(nominal, &self.body_from_sonar.translation.vector).0
    }
}

impl Model<1> for SonarMeasurement {
    /// h = e3 . (p + R t): the first row of document S, equation 2.14, with the lever arm turned
    /// into the world. Its derivative with respect to the turn is that of (R^T e3) . t.
    fn linearise(&self, nominal: &Nominal) -> Result<Linearised<1>, Rejection> {
        let lever = self.body_from_sonar.translation.vector;
        let (height, up_body) = height_of(nominal, &lever);
        let mut jacobian = SMatrix::<f64, 1, 15>::zeros();
        jacobian[error_index::POSITION + 2] = 1.0;
        jacobian
            .fixed_columns_mut::<3>(error_index::ORIENTATION)
            .copy_from(&lever.cross(&up_body).transpose());
        Ok(Linearised {
            innovation: Vector1::new(self.range_m - height),
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

    fn measurement(lever: [f64; 3]) -> SonarMeasurement {
        SonarMeasurement {
            range_m: 1.0,
            body_from_sonar: Mount::at(lever, Looking::Down).body_from_sensor(),
            sigma_m: 0.05,
        }
    }

    #[test]
    fn jacobian_meets_differences() {
        check_jacobian(&measurement([0.1, 0.2, -0.1]));
    }

    #[test]
    fn a_tilted_sonar_still_reads_its_height() {
        let nominal = Nominal {
            position_world: Vector3::z() * 2.0,
            world_from_body: so3::from_roll_pitch_yaw(0.3, 0.0, 1.0),
            ..Nominal::default()
        };
        // With positive roll the left side is up.
        let at_the_left = measurement([0.0, 0.5, 0.0]);
        let expected = 2.0 + 0.5 * 0.3_f64.sin();
        assert!((at_the_left.residual_m(&nominal) - (1.0 - expected)).abs() < 1e-12);
    }
}
