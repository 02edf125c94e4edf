//! Errors of a trajectory against a reference, both in TUM format
//! (`time_s x y z q_x q_y q_z q_w`): prints one JSON object. Used to compare with the `evo` tool.
//!
//! `metrics REFERENCE.tum ESTIMATE.tum [--align none|origin|yaw|rigid|similarity] [--delta FRAMES]
//! [--max-difference SECONDS]`

#![allow(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

use std::error::Error;

use alula_estimation::metrics::{
    Alignment, Pairing, Statistics, Trajectory, absolute_rotation_errors,
    absolute_translation_errors, align, associate, relative_errors, scale_error, statistics,
};
use alula_geometry::{Pose, Timestamp};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use serde_json::{Value, json};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments) {
        Ok(report) => println!("{report}"),
        Err(error) => {
            eprintln!("metrics: {error}");
            std::process::exit(2);
        }
    }
}

struct Options {
    alignment: Alignment,
    delta: usize,
    max_difference_s: f64,
    files: Vec<String>,
}

fn options(arguments: &[String]) -> Result<Options, Box<dyn Error>> {
    let mut options = Options {
        alignment: Alignment::None,
        delta: 1,
        max_difference_s: 0.01,
        files: Vec::new(),
    };
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--align" => options.alignment = alignment(value()?)?,
            "--delta" => options.delta = value()?.parse()?,
            "--max-difference" => options.max_difference_s = value()?.parse()?,
            _ => options.files.push(argument.clone()),
        }
    }
    Ok(options)
}

fn alignment(name: &str) -> Result<Alignment, String> {
    match name {
        "none" => Ok(Alignment::None),
        "origin" => Ok(Alignment::Origin),
        "yaw" => Ok(Alignment::PositionYaw),
        "rigid" => Ok(Alignment::Rigid),
        "similarity" => Ok(Alignment::Similarity),
        _ => Err(format!("unknown alignment {name}")),
    }
}

fn run(arguments: &[String]) -> Result<Value, Box<dyn Error>> {
    let options = options(arguments)?;
    let [reference, estimate] = options.files.as_slice() else {
        return Err("give a reference and an estimate".into());
    };
    let (reference, estimate) = associate(
        &read(reference)?,
        &read(estimate)?,
        options.max_difference_s,
    )?;
    let alignment = align(&reference.poses, &estimate.poses, options.alignment)?;
    let aligned: Vec<Pose> = estimate.poses.iter().map(|p| alignment.apply(p)).collect();
    let relative = relative_errors(
        &reference.times,
        &reference.poses,
        &aligned,
        Pairing::Frames(options.delta),
    )?;
    let all = |errors: &[f64]| statistics(errors).map(table);
    Ok(json!({
        "poses": reference.len(),
        "scale": alignment.scale,
        "ape_trans": all(&absolute_translation_errors(&reference.poses, &aligned)?),
        "ape_angle_rad": all(&absolute_rotation_errors(&reference.poses, &aligned)?),
        "rpe_trans": all(&relative.translation_m),
        "rpe_angle_rad": all(&relative.rotation_rad),
        "scale_error": scale_error(&reference.poses, &aligned, 10)?,
    }))
}

fn table(s: Statistics) -> Value {
    json!({"rmse": s.rmse, "mean": s.mean, "median": s.median, "max": s.max, "min": s.min})
}

fn read(path: &str) -> Result<Trajectory, Box<dyn Error>> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
    let mut trajectory = Trajectory::default();
    for (i, line) in text.lines().enumerate() {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let (time, pose) = parse(line).map_err(|e| format!("{path}:{}: {e}", i + 1))?;
        trajectory.push(time, pose);
    }
    Ok(trajectory)
}

fn parse(line: &str) -> Result<(Timestamp, Pose), Box<dyn Error>> {
    let values = line
        .split_whitespace()
        .map(str::parse)
        .collect::<Result<Vec<f64>, _>>()?;
    let [time_s, x, y, z, q_x, q_y, q_z, q_w] = values.as_slice() else {
        return Err(format!("{} numbers instead of 8", values.len()).into());
    };
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(*q_w, *q_x, *q_y, *q_z));
    Ok((
        Timestamp::from_s(*time_s),
        Pose::from_parts(Translation3::new(*x, *y, *z), rotation),
    ))
}
