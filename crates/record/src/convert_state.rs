//! The estimate to its schemas and back, every bit kept.

use alula_messages::{
    EstimateHealth, FlightPhase, Fusion, NavState, Rejection, Sensor, error_index,
};
use nalgebra::Vector3;

use crate::convert::{Mismatch, Recorded, pose_from, pose_to, time, vector_from, vector_to};
use crate::convert_output::present;
use crate::covariance::{covariance_from, fill_covariance};
use crate::schema;

/// Fills the message of a state, so that the memory of its covariance is used again.
pub(crate) fn fill_state(message: &mut schema::NavState, step_ns: i64, state: &NavState) {
    message.time_ns = state.time.as_ns();
    message.step_ns = step_ns;
    message.world_from_body = pose_to(&state.world_from_body);
    message.velocity_world_m_s = vector_to(&state.velocity_world);
    message.angular_rate_body_rad_s = vector_to(&state.angular_rate_body);
    message.acceleration_world_m_s2 = vector_to(&state.acceleration_world);
    message.accelerometer_bias_m_s2 = vector_to(&state.accelerometer_bias);
    message.gyroscope_bias_rad_s = vector_to(&state.gyroscope_bias);
    message.phase = state.phase.to_message();
    let (health, since) = health_to(&state.health);
    message.health = health as i32;
    message.since_velocity_s = since.map(|(velocity_s, _)| velocity_s);
    message.since_height_s = since.map(|(_, height_s)| height_s);
    fill_covariance(&mut message.covariance, &state.covariance);
}

pub(crate) fn state_from(message: &schema::NavState) -> Result<NavState, Mismatch> {
    Ok(NavState {
        time: time(message.time_ns),
        world_from_body: pose_from(&message.world_from_body),
        velocity_world: vector_from(&message.velocity_world_m_s),
        angular_rate_body: vector_from(&message.angular_rate_body_rad_s),
        acceleration_world: vector_from(&message.acceleration_world_m_s2),
        accelerometer_bias: vector_from(&message.accelerometer_bias_m_s2),
        gyroscope_bias: vector_from(&message.gyroscope_bias_rad_s),
        covariance: covariance_from(&message.covariance)?,
        phase: FlightPhase::from_message(&message.phase)?,
        health: health_from(message)?,
    })
}

type HealthKind = schema::nav_state::Health;

fn health_to(health: &EstimateHealth) -> (HealthKind, Option<(f64, f64)>) {
    match *health {
        EstimateHealth::Initialising => (HealthKind::Initialising, None),
        EstimateHealth::Good => (HealthKind::Good, None),
        EstimateHealth::Degraded {
            since_velocity_s,
            since_height_s,
        } => (
            HealthKind::Degraded,
            Some((since_velocity_s, since_height_s)),
        ),
        EstimateHealth::Failed => (HealthKind::Failed, None),
    }
}

fn health_from(message: &schema::NavState) -> Result<EstimateHealth, Mismatch> {
    Ok(match HealthKind::try_from(message.health)? {
        HealthKind::Initialising => EstimateHealth::Initialising,
        HealthKind::Good => EstimateHealth::Good,
        HealthKind::Degraded => EstimateHealth::Degraded {
            since_velocity_s: present(message.since_velocity_s, "since_velocity_s")?,
            since_height_s: present(message.since_height_s, "since_height_s")?,
        },
        HealthKind::Failed => EstimateHealth::Failed,
    })
}

/// Standard deviations of a state.
pub(crate) fn sigma(step_ns: i64, state: &NavState) -> schema::Sigma {
    let sigma = |row| vector_to(&state.sigma(row));
    schema::Sigma {
        time_ns: step_ns,
        position_world_m: sigma(error_index::POSITION),
        velocity_world_m_s: sigma(error_index::VELOCITY),
        orientation_body_rad: sigma(error_index::ORIENTATION),
        accelerometer_bias_m_s2: sigma(error_index::ACCELEROMETER_BIAS),
        gyroscope_bias_rad_s: sigma(error_index::GYROSCOPE_BIAS),
    }
}

impl Recorded for Fusion {
    type Message = schema::Fusion;

    fn to_message(&self) -> schema::Fusion {
        schema::Fusion {
            time_ns: self.time.as_ns(),
            sensor: self.sensor.to_message(),
            innovation: vector_to(&Vector3::from(self.innovation)),
            innovation_variance: vector_to(&Vector3::from(self.innovation_variance)),
            mahalanobis_squared: self.mahalanobis_squared,
            gate: self.gate,
            rejection: self.rejection.map(|r| r.to_message()),
        }
    }

    fn from_message(message: &schema::Fusion) -> Result<Self, Mismatch> {
        let rejection = message.rejection.as_ref();
        Ok(Self {
            time: time(message.time_ns),
            sensor: Sensor::from_message(&message.sensor)?,
            innovation: vector_from(&message.innovation).into(),
            innovation_variance: vector_from(&message.innovation_variance).into(),
            mahalanobis_squared: message.mahalanobis_squared,
            gate: message.gate,
            rejection: rejection.map(Rejection::from_message).transpose()?,
        })
    }
}
