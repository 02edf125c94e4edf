//! Readings of the downward sensors as measurements, or the reason why they are none.

use alula_geometry::{Pose, Timestamp};
use alula_messages::{FlowSample, RangeSample, Rejection, Sensor};
use nalgebra::Vector3;

use super::config::{FlowCalibration, FlowOdometryConfig, SensorSet};
use crate::eskf::Nominal;
use crate::measurement::{
    FlowMeasurement, Measurement, PlanarVelocityMeasurement, RangeMeasurement, SonarMeasurement,
};
use crate::outliers::OutlierTest;
use crate::watch::{Repetition, check_flow, check_range};

/// The downward sensors. Each reading is told the state in which it is judged, and without one,
/// before take-off, it says nothing.
#[derive(Clone, Debug)]
pub struct Downward {
    config: FlowOdometryConfig,
    body_from_camera: Pose,
    body_from_ranger: Pose,
    flow_repetition: Repetition,
    infrared_repetition: Repetition,
    sonar_repetition: Repetition,
    sonar_outliers: OutlierTest,
    /// Time and reading of the last good sonar reading.
    sonar: Option<(Timestamp, f64)>,
}

impl Downward {
    pub fn new(config: &FlowOdometryConfig, calibration: &FlowCalibration) -> Self {
        Self {
            body_from_camera: calibration.flow_camera.body_from_sensor(),
            body_from_ranger: calibration.infrared.body_from_sensor(),
            flow_repetition: Repetition::default(),
            infrared_repetition: Repetition::default(),
            sonar_repetition: Repetition::default(),
            sonar_outliers: OutlierTest::new(&config.sonar.outliers),
            sonar: None,
            config: config.clone(),
        }
    }

    /// Forgets what was read in the flight before.
    pub fn clear(&mut self) {
        self.sonar_outliers.clear();
        self.sonar = None;
    }

    /// The ranger whose readings are fused.
    pub fn height_sensor(&self) -> Sensor {
        match self.config.sensors {
            SensorSet::FlowAndInfrared => Sensor::Infrared,
            SensorSet::VelocityAndSonar => Sensor::Sonar,
        }
    }

    pub fn flow(
        &mut self,
        sample: &FlowSample,
        now: Timestamp,
        state: Option<&Nominal>,
    ) -> Result<Measurement, Rejection> {
        let state = check_flow(
            sample,
            now,
            state.ok_or(Rejection::Phase),
            &mut self.flow_repetition,
            self.config.flow_min_quality,
            self.config.stuck_after_s,
        )?;
        // Where the sonar does not tell the distance, that of the state has to do.
        Ok(match self.sonar_distance_m(sample.time, state) {
            Some(distance_m) => self.velocity(sample, distance_m),
            None => self.raw_flow(sample),
        })
    }

    fn raw_flow(&self, sample: &FlowSample) -> Measurement {
        Measurement::Flow(FlowMeasurement {
            flow_rad_s: sample.flow_rad_s,
            angular_rate: Vector3::zeros(),
            interval_s: sample.interval_s,
            body_from_camera: self.body_from_camera,
            sigma_rad_s: self.config.flow_sigma_rad_s,
            min_distance_m: self.config.flow_min_distance_m,
        })
    }

    fn velocity(&self, sample: &FlowSample, distance_m: f64) -> Measurement {
        Measurement::PlanarVelocity(PlanarVelocityMeasurement {
            interval_s: sample.interval_s,
            body_from_camera: self.body_from_camera,
            sigma_m_s: self.config.sonar.velocity_sigma_m_s,
            ..PlanarVelocityMeasurement::from_flow(sample.flow_rad_s, distance_m)
        })
    }

    /// Distance to the ground along the optical axis as the last good sonar reading has it.
    fn sonar_distance_m(&self, time: Timestamp, state: &Nominal) -> Option<f64> {
        let (read_at, height_m) = self.sonar?;
        let recent = time.seconds_since(read_at).abs() <= self.config.sonar.max_age_s;
        let axis = state.world_from_body * (self.body_from_camera.rotation * Vector3::z());
        let distance_m = height_m / -axis.z;
        // As for raw flow: sharp, and not beyond 60 degrees of tilt.
        let usable = axis.z < -0.5 && distance_m >= self.config.flow_min_distance_m;
        (recent && usable).then_some(distance_m)
    }

    pub fn infrared(
        &mut self,
        sample: &RangeSample,
        now: Timestamp,
        state: Option<&Nominal>,
    ) -> Result<Measurement, Rejection> {
        let (ready, repetition) = (state.ok_or(Rejection::Phase), &mut self.infrared_repetition);
        check_range(sample, now, ready, repetition, self.config.stuck_after_s)?;
        Ok(Measurement::Range(RangeMeasurement {
            sensor: Sensor::Infrared,
            range_m: sample.range_m,
            body_from_ranger: self.body_from_ranger,
            sigma_m: self.config.range_sigma_m,
        }))
    }

    /// A wrong echo is found among its neighbours before it meets the filter (document S, section
    /// 2.10.2).
    pub fn sonar(
        &mut self,
        sample: &RangeSample,
        now: Timestamp,
        state: Option<&Nominal>,
    ) -> Result<Measurement, Rejection> {
        let (ready, repetition) = (state.ok_or(Rejection::Phase), &mut self.sonar_repetition);
        let state = check_range(sample, now, ready, repetition, self.config.stuck_after_s)?;
        let measurement = SonarMeasurement {
            range_m: sample.range_m,
            body_from_sonar: self.body_from_camera,
            sigma_m: self.config.sonar.height_sigma_m,
        };
        if self
            .sonar_outliers
            .is_outlier(measurement.residual_m(state))
        {
            self.sonar = None;
            return Err(Rejection::Outlier);
        }
        self.sonar = Some((sample.time, sample.range_m));
        Ok(Measurement::Sonar(measurement))
    }
}
