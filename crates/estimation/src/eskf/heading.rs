//! What no measurement from the body can tell: the heading.

use nalgebra::{RowVector4, SVector, UnitQuaternion, Vector3};

use super::{Covariance, FilterKind, index};

/// What a measurement stays the same under.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// Seen from the body: it reads the same if the world with the vehicle in it is turned about the
    /// vertical.
    FromBody,
    /// Told in the frame of the world.
    InWorld,
}

/// Expresses, after a correction by what was seen from the body, the errors of position and velocity
/// such that an error of heading still turns both of them as a whole.
///
/// An error `psi` of heading makes errors `psi e3 x p` and `psi e3 x v`. No measurement from the body
/// tells `psi`, and the covariance before the correction has that combination of errors unobserved
/// for the estimates `p` and `v` that it had then. At the new estimates the same ignorance is
/// `psi e3 x (p + dp)` and `psi e3 x (v + dv)`: position and velocity gain `psi e3 x dp` and
/// `psi e3 x dv`. Without this the filter takes the difference for news about the heading, at each
/// correction anew.
pub(super) fn turn_along(
    covariance: &mut Covariance,
    filter: FilterKind,
    orientation: &UnitQuaternion<f64>,
    correction: &SVector<f64, 16>,
) {
    // psi = e3 . R theta = (R^T e3) . theta
    let up_body = orientation.inverse() * Vector3::z();
    let psi: RowVector4<f64> = up_body.transpose() * filter.local_from_coordinates(orientation);
    let mut gain = SVector::<f64, 16>::zeros();
    for row in [index::POSITION, index::VELOCITY] {
        gain[row] = -correction[row + 1];
        gain[row + 1] = correction[row];
    }
    // (I + gain psi) P (I + gain psi)^T, of which P psi^T is all that is needed.
    let with_psi = covariance.fixed_columns::<4>(index::ORIENTATION) * psi.transpose();
    let variance = (psi * with_psi.fixed_rows::<4>(index::ORIENTATION))[0];
    let half = with_psi + gain * (0.5 * variance);
    *covariance += gain * half.transpose() + half * gain.transpose();
}

#[cfg(test)]
mod tests {
    use super::super::{Filter, ImuNoise, InertialInput, Nominal, Variant};
    use super::*;
    use crate::measurement::{FlowMeasurement, Gates, Measurement, RangeMeasurement};
    use alula_geometry::{Timestamp, gravity_world, so3};
    use alula_messages::{ErrorCovariance, Looking, Mount, Sensor};
    use nalgebra::Vector2;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// What turning the world with the vehicle by a small angle does to the error, per angle.
    fn turned(nominal: &Nominal) -> SVector<f64, 15> {
        let mut turned = SVector::<f64, 15>::zeros();
        for (row, v) in [(0, nominal.position_world), (3, nominal.velocity_world)] {
            turned
                .fixed_rows_mut::<3>(row)
                .copy_from(&Vector3::z().cross(&v));
        }
        let up_body = nominal.world_from_body.inverse() * Vector3::z();
        turned.fixed_rows_mut::<3>(6).copy_from(&up_body);
        turned
    }

    /// Where only turns of the world are uncertain, a correction of position and velocity leaves
    /// turns of the world uncertain, those of the new place and velocity.
    #[test]
    fn turns_of_the_world_stay_what_they_are() {
        let mut before = Nominal {
            position_world: Vector3::new(5.0, -3.0, 1.0),
            velocity_world: Vector3::new(1.0, 2.0, -0.3),
            world_from_body: so3::from_roll_pitch_yaw(0.2, -0.4, 1.0),
            ..Nominal::default()
        };
        for variant in Variant::all() {
            let only_turns = turned(&before) * turned(&before).transpose();
            let mut filter = Filter::with_covariance(before, &only_turns, variant);
            let mut correction = SVector::<f64, 16>::zeros();
            for (i, value) in [0.4, -0.2, 0.1, 0.05, 0.3, -0.1].into_iter().enumerate() {
                correction[i] = value;
            }
            filter.inject(&correction, Seen::FromBody);
            let expected = turned(&filter.nominal) * turned(&filter.nominal).transpose();
            // The bounds add 1e-10 to variances that are zero.
            assert!((filter.covariance() - expected).amax() < 1e-9, "{variant}");
            before.position_world.x += 0.1;
        }
    }

    /// Half a minute of swinging flight on noisy flow and range, with errors of the first estimate
    /// that have to be corrected. The heading is as unknown after it as before.
    fn heading_sigma_rad(variant: Variant) -> f64 {
        let mut random = Pcg64::seed_from_u64(5);
        let mut draw = move || random.random_range(-1.0..1.0) * 3.0_f64.sqrt();
        let camera = Mount::at([0.05, 0.0, -0.04], Looking::Down).body_from_sensor();
        let noise = ImuNoise {
            gyroscope_noise_rad_s_sqrt_hz: 1e-7,
            gyroscope_bias_walk_rad_s2_sqrt_hz: 0.0,
            ..ImuNoise::default()
        };
        let start = Nominal {
            position_world: Vector3::z() * 1.5,
            velocity_world: Vector3::new(0.3, -0.3, 0.0),
            world_from_body: so3::exp(&Vector3::new(0.05, -0.05, 0.0)),
            ..Nominal::default()
        };
        let sigma = [0.1, 0.3, 0.1, 0.05, 1e-6_f64];
        let mut covariance = ErrorCovariance::zeros();
        for i in 0..15 {
            covariance[(i, i)] = sigma[i / 3].powi(2);
        }
        let mut filter = Filter::with_covariance(start, &covariance, variant);
        let gates = Gates::new(0.999);
        for step in 1..3000 {
            let t = 0.01 * f64::from(step);
            // A body that stays level and swings: the force tilts, the body does not.
            let swing = Vector3::new(t.sin(), (1.3 * t).cos(), 0.0);
            let velocity = Vector3::new(1.0 - t.cos(), (1.3 * t).sin() / 1.3, 0.0);
            let shake = Vector3::new(draw(), draw(), draw()) * 0.4;
            let input = InertialInput::steady(swing - gravity_world() + shake, Vector3::zeros());
            filter.propagate(&input, 0.01, &noise);
            let velocity_camera = camera.rotation.inverse() * velocity;
            let flow = Measurement::Flow(FlowMeasurement {
                flow_rad_s: velocity_camera.xy() / -1.46 + Vector2::new(draw(), draw()) * 0.015,
                angular_rate: Vector3::zeros(),
                interval_s: 0.01,
                body_from_camera: camera,
                sigma_rad_s: 0.015,
                min_distance_m: 0.3,
            });
            let range = Measurement::Range(RangeMeasurement {
                sensor: Sensor::Infrared,
                range_m: 1.46 + draw() * 0.02,
                body_from_ranger: camera,
                sigma_m: 0.02,
            });
            for measurement in [flow, range] {
                measurement.fuse(Timestamp::ZERO, &mut filter, &gates);
            }
        }
        let up_body = filter.nominal.world_from_body.inverse() * Vector3::z();
        let turn = filter.covariance().fixed_view::<3, 3>(6, 6).into_owned();
        (up_body.transpose() * turn * up_body)[0].sqrt()
    }

    /// The turn of tilt corrections is exact to first order only: the first ones, of 0.07 rad, cost
    /// a few percent. Taken as if flow told the heading, a third is left.
    #[test]
    fn flow_and_range_tell_no_heading() {
        for variant in Variant::all() {
            let sigma = heading_sigma_rad(variant);
            assert!((0.095..0.1001).contains(&sigma), "{variant}: {sigma}");
        }
    }
}
