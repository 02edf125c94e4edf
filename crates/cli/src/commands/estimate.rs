//! `alula estimate`: an estimator over a flight recorded before.

use std::path::{Path, PathBuf};

use alula_messages::PoseSample;
use alula_record::tum;
use alula_runtime::RunError;
use alula_runtime::estimate::{
    AlignTo, Estimation, EstimationReport, Job, PoseFeed, TrueMotion, estimate,
};
use clap::ValueEnum;

use super::{Outcome, Verdict, print_json};

/// Run an estimator over a recorded flight.
///
/// Reads EuRoC folders (ASL layout) and alula recordings. Writes the estimated trajectory in TUM
/// format, for evo and others, and prints its errors where the truth is known.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// EuRoC folder or .mcap recording.
    log: PathBuf,
    /// Estimator: flow-odometry, cascade or pose-imu.
    #[arg(long, value_name = "NAME")]
    estimator: Option<String>,
    /// True trajectory (TUM), in place of the log's own.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Folder for the estimated trajectory.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object instead of the summary.
    #[arg(long)]
    json: bool,
    /// Thin external poses to this rate, Hz.
    #[arg(long, default_value_t = 10.0, value_name = "HZ")]
    pose_rate_hz: f64,
    /// Time from measurement to arrival of external poses, s.
    #[arg(long, default_value_t = 0.1, value_name = "S")]
    pose_delay_s: f64,
    /// Lose all poses from START for DURATION, s; may be given often.
    #[arg(long, value_name = "START,DURATION", value_parser = outage)]
    pose_outage_s: Vec<[f64; 2]>,
    /// Share of poses lost at random.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    pose_loss: f64,
    /// Alignment before position errors are taken [default: none for pose-imu, else position-yaw].
    #[arg(long, value_enum)]
    align: Option<AlignChoice>,
    /// Duration of the pieces whose relative errors are taken, s.
    #[arg(long, default_value_t = 0.5, value_name = "S")]
    rpe_delta_s: f64,
    /// Seed of noise and losses where sensor data are made from truth.
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Change a key of the estimation, for example
    /// parameters.pose_imu.position_sigma_m=0.002; may be given often.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
}

const EXAMPLES: &str = "Examples:
  alula estimate V1_01_easy --estimator pose-imu
  alula estimate V1_01_easy --estimator pose-imu --pose-outage-s 60,0.5 --json
  alula estimate V1_01_easy --estimator flow-odometry --out estimates
  alula estimate out/among-people-1/flight.mcap";

/// How the estimate is moved onto the truth.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum AlignChoice {
    /// Not at all.
    None,
    /// First poses agree.
    Origin,
    /// Position and heading.
    PositionYaw,
    /// Position and rotation.
    Rigid,
    /// Position, rotation and scale.
    Similarity,
}

impl From<AlignChoice> for AlignTo {
    fn from(choice: AlignChoice) -> Self {
        match choice {
            AlignChoice::None => Self::None,
            AlignChoice::Origin => Self::Origin,
            AlignChoice::PositionYaw => Self::PositionYaw,
            AlignChoice::Rigid => Self::Rigid,
            AlignChoice::Similarity => Self::Similarity,
        }
    }
}

fn outage(text: &str) -> Result<[f64; 2], String> {
    let expected = "expected START,DURATION in seconds, for example 60,0.5";
    let (start, duration) = text.split_once(',').ok_or(expected)?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| expected.to_owned());
    Ok([number(start)?, number(duration)?])
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Outcome {
    let job = Job {
        log: arguments.log.clone(),
        estimator: arguments.estimator.clone(),
        truth: arguments.truth.clone(),
        poses: PoseFeed {
            rate_hz: Some(arguments.pose_rate_hz),
            delay_s: arguments.pose_delay_s,
            outages_s: arguments.pose_outage_s.clone(),
            loss_share: arguments.pose_loss,
        },
        align: arguments.align.map(AlignTo::from),
        rpe_delta_s: arguments.rpe_delta_s,
        seed: arguments.seed,
        overrides: arguments.overrides.clone(),
    };
    let estimation = estimate(&job)?;
    let written = arguments
        .out
        .as_deref()
        .map(|folder| write(folder, &estimation))
        .transpose()?;
    if arguments.json {
        print_json(&estimation.report);
    } else {
        print(&estimation.report);
        for file in written.into_iter().flatten() {
            println!("  written     {}", file.display());
        }
    }
    Ok(Verdict::of(estimation.report.completed_fraction > 0.0))
}

/// Writes estimate and truth as TUM trajectories.
fn write(folder: &Path, estimation: &Estimation) -> Result<Vec<PathBuf>, RunError> {
    alula_runtime::make_folder(folder)?;
    let states: Vec<PoseSample> = estimation
        .states
        .iter()
        .map(|s| PoseSample {
            time: s.time,
            sensor: 0,
            world_from_body: s.world_from_body,
        })
        .collect();
    let truth = estimation
        .truth
        .iter()
        .map(TrueMotion::pose_sample)
        .collect();
    let mut written = Vec::new();
    for (name, poses) in [("estimate.tum", states), ("truth.tum", truth)] {
        if !poses.is_empty() {
            let path = folder.join(name);
            tum::write(&path, &poses)?;
            written.push(path);
        }
    }
    Ok(written)
}

fn print(report: &EstimationReport) {
    println!("{} over {}", report.estimator, report.log.display());
    println!(
        "  completed   {:.1} % of {} inertial samples",
        100.0 * report.completed_fraction,
        report.samples
    );
    let rejected: Vec<String> = report
        .rejected
        .iter()
        .map(|(reason, count)| format!("{count} by {reason}"))
        .collect();
    let rejected = if rejected.is_empty() {
        "none".to_owned()
    } else {
        rejected.join(", ")
    };
    println!(
        "  rejected    {rejected} of {} measurements",
        report.measurements
    );
    if let Some(errors) = &report.errors {
        println!(
            "  position    ATE {:.4} m, worst {:.4} m, at the end {:.4} m ({:?} alignment)",
            errors.ate_rmse_m, errors.ate_max_m, errors.final_error_m, errors.alignment
        );
        println!(
            "  relative    RPE {:.4} m over {} s, scale error {:.3} %",
            errors.rpe_rmse_m,
            errors.rpe_delta_s,
            100.0 * errors.scale_error
        );
        println!("  orientation {:.3} deg", errors.orientation_rmse_deg);
        if let Some(velocity) = errors.velocity_rmse_m_s {
            println!("  velocity    {velocity:.4} m/s");
        }
        if let (Some(velocity), Some(tilt)) = (errors.nees_velocity, errors.nees_tilt) {
            println!(
                "  consistency NEES of velocity {velocity:.2} (3 expected), of tilt {tilt:.2} (2)"
            );
        }
    }
    println!("  jumps       none above {:.4} m", report.max_jump_m);
    let timing = &report.timing_ms;
    println!(
        "  update      median {:.1} us, p99 {:.1} us, worst {:.1} us",
        1e3 * timing.p50,
        1e3 * timing.p99,
        1e3 * timing.max
    );
    for note in &report.notes {
        println!("  note: {note}");
    }
}
