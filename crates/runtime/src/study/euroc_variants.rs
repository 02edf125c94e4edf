//! The filters of document S, table 2.1, on the inertial data of a real flight.

use std::path::Path;

use alula_estimation::SensorSet;
use alula_estimation::eskf::Variant;
use alula_messages::error_index::GYROSCOPE_BIAS;
use alula_record::euroc::Folder;
use nalgebra::Vector3;
use serde::Serialize;

use super::{Column, Demand, Request, Results, Row, Study, Watch, data_folder};
use crate::RunError;
use crate::estimate::{Errors, Estimation, Job, PoseFeed, estimate};

/// All variants on EuRoC V1_01_easy.
pub const STUDY: Study = Study {
    name: "euroc-variants",
    source: "document S, table 2.1, on EuRoC V1_01_easy",
    about: "all variants of the flow odometry on the inertial data of a real flight",
    runs_are: "flights",
    default_runs: FLIGHTS,
    execute,
};

/// Each variant with each sensor set.
const FLIGHTS: u64 = 54;

const SETS: [(SensorSet, &str); 2] = [
    (SensorSet::FlowAndInfrared, "flow and infrared"),
    (SensorSet::VelocityAndSonar, "velocity and sonar"),
];

/// Least share of the flight for which there has to be an estimate; the rest is the alignment.
const ASKED_COMPLETED: f64 = 0.95;

/// Greatest error of the gyroscope's bias at the end, in standard deviations.
const ASKED_BIAS_SIGMAS: f64 = 3.0;

/// One variant on the flight.
struct Flown {
    variant: Variant,
    sensors: &'static str,
    completed: f64,
    errors: Errors,
    /// Error of the gyroscope's bias at the end, in standard deviations.
    bias_sigmas: Vector3<f64>,
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let folder = data_folder(
        "euroc_v1_01",
        "Unpack the sequence V1_01_easy of the EuRoC dataset into a folder of this name",
    )?;
    let mut runs = Vec::new();
    for set in SETS {
        runs.extend(Variant::all().map(|variant| (variant, set)));
    }
    let tasks: Vec<u64> = (0..request.runs.min(runs.len() as u64)).collect();
    let flown = request.do_all(&tasks, watch, &|i| {
        let (variant, set) = runs[i as usize];
        fly(&folder, request.seed, variant, set)
    })?;
    Ok(results(&flown))
}

fn fly(
    log: &Path,
    seed: u64,
    variant: Variant,
    (set, sensors): (SensorSet, &'static str),
) -> Result<Flown, RunError> {
    let key = "parameters.flow_odometry";
    let job = Job {
        log: log.to_owned(),
        estimator: Some("flow-odometry".to_owned()),
        truth: None,
        poses: PoseFeed::default(),
        align: None,
        rpe_delta_s: 0.5,
        seed,
        overrides: vec![
            format!("{key}.sensors={}", word(&set)),
            format!("{key}.variant.filter={}", word(&variant.filter)),
            format!("{key}.variant.integration={}", word(&variant.integration)),
            format!("{key}.variant.transition={}", word(&variant.transition)),
        ],
    };
    let estimation = estimate(&job)?;
    let errors = estimation.report.errors.ok_or_else(|| RunError::Input {
        what: log.display().to_string(),
        finding: "no estimate can be compared with the truth".into(),
        remedy: "Use the whole sequence, with its ground truth".into(),
    })?;
    Ok(Flown {
        variant,
        sensors,
        completed: estimation.report.completed_fraction,
        errors,
        bias_sigmas: bias_sigmas(log, &estimation)?,
    })
}

/// The word for a choice in a configuration, in quotes.
fn word(choice: &impl Serialize) -> String {
    serde_json::to_string(choice).unwrap_or_default()
}

/// The estimated bias of the gyroscope at the end less the true one, in standard deviations.
fn bias_sigmas(log: &Path, estimation: &Estimation) -> Result<Vector3<f64>, RunError> {
    let truth = Folder::open(log)?.truth()?.samples;
    let ends = (
        truth.first(),
        truth.last(),
        estimation.truth.first(),
        estimation.states.last(),
    );
    let (Some(first), Some(last), Some(body), Some(state)) = ends else {
        return Ok(Vector3::repeat(f64::INFINITY));
    };
    let imu_from_body = first.world_from_imu.rotation.inverse() * body.world_from_body.rotation;
    let bias = imu_from_body.inverse() * last.gyroscope_bias;
    Ok((state.gyroscope_bias - bias).component_div(&state.sigma(GYROSCOPE_BIAS)))
}

impl Flown {
    fn row(&self) -> Row {
        Row::new()
            .with("variant", self.variant.to_string())
            .with("sensors", self.sensors)
            .with("completed", self.completed)
            .with("nees_velocity", self.errors.nees_velocity)
            .with("nees_tilt", self.errors.nees_tilt)
            .with("bias_sigmas", self.bias_sigmas.amax())
            .with("velocity_rmse_m_s", self.errors.velocity_rmse_m_s)
            .with("ate_rmse_m", self.errors.ate_rmse_m)
    }
}

fn results(flown: &[Flown]) -> Results {
    let least = flown
        .iter()
        .map(|f| f.completed)
        .fold(f64::INFINITY, f64::min);
    let worst = flown
        .iter()
        .map(|f| f.bias_sigmas.amax())
        .fold(0.0, f64::max);
    Results {
        runs: flown.len() as u64,
        columns: vec![
            Column::new("variant", "variant", 0),
            Column::new("sensors", "sensors", 0),
            Column::new("completed", "completed", 3),
            Column::new("nees_velocity", "error of velocity, of 3", 2),
            Column::new("nees_tilt", "of tilt, of 2", 2),
            Column::new("bias_sigmas", "gyroscope bias (sigma)", 2),
            Column::new("velocity_rmse_m_s", "velocity (m/s)", 3),
            Column::new("ate_rmse_m", "position (m)", 3),
        ],
        rows: flown.iter().map(Flown::row).collect(),
        demands: vec![
            Demand::at_least(
                "share of the flight with an estimate, worst variant",
                "",
                ASKED_COMPLETED,
                least,
            ),
            Demand::at_most(
                "error of the gyroscope's bias at the end, worst variant and axis",
                "sigma",
                ASKED_BIAS_SIGMAS,
                worst,
            ),
        ],
        charts: Vec::new(),
        notes: vec![
            "The inertial data are real; flow, range and sonar are made from the truth, over an \
             imagined flat floor. Errors of velocity and tilt are normalised squared errors, \
             averaged over the flight."
                .to_owned(),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_a_flight_for_each_variant_and_sensor_set() {
        let flights = Variant::all().count() * SETS.len();
        assert_eq!(flights as u64, FLIGHTS);
    }

    #[test]
    fn choices_are_the_words_of_a_configuration() {
        assert_eq!(word(&SETS[0].0), "\"flow-and-infrared\"");
        assert_eq!(word(&Variant::default().transition), "\"f1\"");
    }
}
