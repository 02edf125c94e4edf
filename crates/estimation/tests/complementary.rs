//! The complementary attitude filter on the manoeuvres of document O, section 2.5.3, with all errors
//! of an inertial unit that its section 2.2.4 names.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod support;

use alula_estimation::alignment::{Alignment, AlignmentConfig};
use alula_estimation::complementary::{Complementary, ComplementaryConfig};
use alula_geometry::so3;
use alula_messages::SensorBatch;
use nalgebra::Vector3;
use support::{Flight, LEGS_LAND_S, TAKE_OFF_S};

const DT_S: f64 = 0.004;

/// Errors of roll and pitch, and their claimed standard deviations, over one flight, rad.
struct Errors {
    roll_rad: Vec<f64>,
    pitch_rad: Vec<f64>,
    sigma_rad: Vec<f64>,
}

fn fly(mut flight: Flight) -> Errors {
    let mut alignment = Alignment::new(AlignmentConfig::default());
    let mut filter: Option<Complementary> = None;
    let mut batch = SensorBatch::default();
    let mut errors = Errors {
        roll_rad: Vec::new(),
        pitch_rad: Vec::new(),
        sigma_rad: Vec::new(),
    };
    loop {
        let t = flight.step(&mut batch);
        if t > LEGS_LAND_S {
            return errors;
        }
        let imu = batch.imu[0];
        let Some(filter) = &mut filter else {
            filter = alignment.add(&imu, &Vector3::zeros(), 0.0).map(|start| {
                let (attitude, bias) =
                    (start.nominal.world_from_body, start.nominal.gyroscope_bias);
                Complementary::new(&ComplementaryConfig::default(), attitude, bias).unwrap()
            });
            continue;
        };
        if t < TAKE_OFF_S {
            filter.rest(&imu.specific_force, &imu.angular_rate, DT_S);
        } else {
            filter.update(&imu.specific_force, &imu.angular_rate, DT_S);
        }
        let (roll, pitch, _) = so3::to_roll_pitch_yaw(filter.world_from_body());
        let truth = flight.truth(t).world_from_body;
        let (true_roll, true_pitch, _) = so3::to_roll_pitch_yaw(&truth);
        errors.roll_rad.push(roll - true_roll);
        errors.pitch_rad.push(pitch - true_pitch);
        errors.sigma_rad.push(filter.tilt_sigma_rad());
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn roll_and_pitch_are_better_than_a_degree() {
    for seed in 0..20 {
        let errors = fly(Flight::legs(seed));
        let (roll, pitch) = (
            rms(&errors.roll_rad).to_degrees(),
            rms(&errors.pitch_rad).to_degrees(),
        );
        println!("seed {seed}: roll {roll:.3} deg, pitch {pitch:.3} deg");
        assert!(roll < 1.0 && pitch < 1.0, "seed {seed}: {roll} {pitch}");
    }
}

/// Over many flights the squared errors are on average not above the claimed variances.
#[test]
fn the_claimed_uncertainty_is_not_too_small() {
    let (mut squares, mut claims) = (0.0, 0.0);
    for seed in 0..20 {
        let errors = fly(Flight::legs(seed));
        squares += rms(&errors.roll_rad).powi(2) + rms(&errors.pitch_rad).powi(2);
        claims += 2.0 * rms(&errors.sigma_rad).powi(2);
    }
    println!("squared errors over claims: {:.2}", squares / claims);
    assert!(squares < claims, "{squares} {claims}");
}
