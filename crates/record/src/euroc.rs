//! Flights in the folder layout of the EuRoC dataset (ASL format; Burri et al., "The EuRoC micro
//! aerial vehicle datasets", 2016): `mav0/imu0`, `mav0/state_groundtruth_estimate0`.
//!
//! The body frame of these recordings is that of the IMU as it was mounted, not forward-left-up;
//! the world frame has z up.

use std::fmt;
use std::path::{Path, PathBuf};

use alula_geometry::{Pose, Timestamp};
use alula_messages::ImuSample;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::RecordError;
use crate::text::{Clock, Line, Separator, TextFile};

const IMU_LAYOUT: &str =
    "a line is `t_ns,wx,wy,wz,ax,ay,az` with angular rates (rad/s) and specific forces (m/s^2)";
const TRUTH_LAYOUT: &str = "a line is `t_ns`, position, quaternion (w first), velocity, gyroscope \
                            bias, accelerometer bias";

/// Largest departure of `R R^T` from the identity that rounding in a file explains.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// A folder with a recorded flight.
#[derive(Clone, Debug)]
pub struct Folder {
    mav0: PathBuf,
}

/// What an IMU is, from its `sensor.yaml`.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuFacts {
    /// Pose of the IMU in the body frame, `T_BS`.
    pub body_from_imu: Pose,
    /// Samples per second.
    pub rate_hz: f64,
    /// White noise of the gyroscope, rad/s/sqrt(Hz).
    pub gyroscope_noise_rad_s_sqrt_hz: f64,
    /// Random walk of the gyroscope's bias, rad/s^2/sqrt(Hz).
    pub gyroscope_random_walk_rad_s2_sqrt_hz: f64,
    /// White noise of the accelerometer, m/s^2/sqrt(Hz).
    pub accelerometer_noise_m_s2_sqrt_hz: f64,
    /// Random walk of the accelerometer's bias, m/s^3/sqrt(Hz).
    pub accelerometer_random_walk_m_s3_sqrt_hz: f64,
}

/// The true state of motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthSample {
    /// The instant.
    pub time: Timestamp,
    /// Pose of the IMU in the world.
    pub world_from_imu: Pose,
    /// Velocity of the IMU, world frame, m/s.
    pub velocity_world: Vector3<f64>,
    /// Gyroscope bias, IMU frame, rad/s.
    pub gyroscope_bias: Vector3<f64>,
    /// Accelerometer bias, IMU frame, m/s^2.
    pub accelerometer_bias: Vector3<f64>,
}

/// Something odd that does not prevent reading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Warning {
    /// A line has the time of the line before it and is left out.
    Duplicate {
        /// The file.
        path: PathBuf,
        /// The line that is left out.
        line: usize,
        /// The line that is kept.
        kept_line: usize,
    },
    /// The last line has no end, so that its last number may be cut; it is left out.
    CutOff {
        /// The file.
        path: PathBuf,
        /// The line that is left out.
        line: usize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Duplicate {
                path,
                line,
                kept_line,
            } => write!(
                f,
                "`{}`, line {line}: the same time as line {kept_line}; left out",
                path.display()
            ),
            Self::CutOff { path, line } => write!(
                f,
                "`{}`, line {line}: the file breaks off here; the line is left out",
                path.display()
            ),
        }
    }
}

/// The samples of a file, in order of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Table<T> {
    /// The samples.
    pub samples: Vec<T>,
    /// What was odd.
    pub warnings: Vec<Warning>,
}

impl Folder {
    /// A folder that is `mav0` or contains it.
    ///
    /// # Errors
    /// When neither is the case.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordError> {
        let path = path.as_ref();
        let inner = path.join("mav0");
        let mav0 = if inner.is_dir() {
            inner
        } else {
            path.to_owned()
        };
        if mav0.join("imu0").is_dir() {
            return Ok(Self { mav0 });
        }
        Err(RecordError::Missing {
            what: "EuRoC folder without IMU",
            path: mav0.join("imu0"),
            remedy: "give the folder that contains `mav0`, or `mav0` itself",
        })
    }

    /// Samples of the IMU, in its own frame.
    ///
    /// # Errors
    /// When the file is missing, empty, malformed or not in order of time.
    pub fn imu(&self) -> Result<Table<ImuSample>, RecordError> {
        let path = self.mav0.join("imu0").join("data.csv");
        require(
            &path,
            "EuRoC folder without IMU data",
            "download the sequence again",
        )?;
        read_table(&path, "IMU samples", IMU_LAYOUT, read_imu)
    }

    /// What the IMU is.
    ///
    /// # Errors
    /// When the file is missing or lacks a key.
    pub fn imu_facts(&self) -> Result<ImuFacts, RecordError> {
        let path = self.mav0.join("imu0").join("sensor.yaml");
        require(
            &path,
            "EuRoC folder without description of its IMU",
            "copy `sensor.yaml` of the sequence beside `data.csv`",
        )?;
        let file = TextFile::read(&path)?;
        Ok(ImuFacts {
            body_from_imu: read_transform(&file)?,
            rate_hz: read_positive(&file, "rate_hz")?,
            gyroscope_noise_rad_s_sqrt_hz: read_positive(&file, "gyroscope_noise_density")?,
            gyroscope_random_walk_rad_s2_sqrt_hz: read_positive(&file, "gyroscope_random_walk")?,
            accelerometer_noise_m_s2_sqrt_hz: read_positive(&file, "accelerometer_noise_density")?,
            accelerometer_random_walk_m_s3_sqrt_hz: read_positive(
                &file,
                "accelerometer_random_walk",
            )?,
        })
    }

    /// The true motion of the IMU.
    ///
    /// # Errors
    /// When the file is missing, empty, malformed or not in order of time.
    pub fn truth(&self) -> Result<Table<TruthSample>, RecordError> {
        let path = self.mav0.join("state_groundtruth_estimate0");
        let path = path.join("data.csv");
        require(
            &path,
            "EuRoC folder without truth",
            "give a sequence with truth, or a trajectory with `--truth FILE`",
        )?;
        read_table(&path, "true states", TRUTH_LAYOUT, read_truth)
    }
}

fn require(path: &Path, what: &'static str, remedy: &'static str) -> Result<(), RecordError> {
    if path.is_file() {
        return Ok(());
    }
    Err(RecordError::Missing {
        what,
        path: path.to_owned(),
        remedy,
    })
}

fn read_table<T, const N: usize>(
    path: &Path,
    what: &'static str,
    layout: &'static str,
    read: impl Fn(&Line, Timestamp, [f64; N]) -> Result<T, RecordError>,
) -> Result<Table<T>, RecordError> {
    let file = TextFile::read(path)?;
    let mut clock = Clock::default();
    let mut table = Table {
        samples: Vec::new(),
        warnings: Vec::new(),
    };
    for line in file.data_lines() {
        if !line.is_whole {
            table.warnings.push(Warning::CutOff {
                path: path.to_owned(),
                line: line.number,
            });
            continue;
        }
        let (time_ns, numbers) = read_line(&line, layout)?;
        if let Some(kept_line) = clock.tick(&line, time_ns)? {
            table.warnings.push(Warning::Duplicate {
                path: path.to_owned(),
                line: line.number,
                kept_line,
            });
            continue;
        }
        let time = Timestamp::from_ns(time_ns);
        table.samples.push(read(&line, time, numbers)?);
    }
    if table.samples.is_empty() {
        return Err(RecordError::Empty {
            path: path.to_owned(),
            what,
            remedy: layout,
        });
    }
    Ok(table)
}

/// The time of a line, ns, and the `N` numbers after it.
fn read_line<const N: usize>(
    line: &Line,
    layout: &'static str,
) -> Result<(i64, [f64; N]), RecordError> {
    let columns = line.columns(Separator::Comma, N + 1, layout)?;
    let time = columns[0].parse().map_err(|_| {
        line.malformed(
            format!("column 1 is `{}`, not a time in nanoseconds", columns[0]),
            layout,
        )
    })?;
    Ok((time, line.numbers(&columns[1..], 2)?))
}

fn read_imu(_: &Line, time: Timestamp, numbers: [f64; 6]) -> Result<ImuSample, RecordError> {
    let [wx, wy, wz, ax, ay, az] = numbers;
    Ok(ImuSample {
        time,
        specific_force: Vector3::new(ax, ay, az),
        angular_rate: Vector3::new(wx, wy, wz),
    })
}

fn read_truth(line: &Line, time: Timestamp, n: [f64; 16]) -> Result<TruthSample, RecordError> {
    let vector = |first: usize| Vector3::new(n[first], n[first + 1], n[first + 2]);
    let rotation = line.rotation([n[3], n[4], n[5], n[6]])?;
    Ok(TruthSample {
        time,
        world_from_imu: Pose::from_parts(Translation3::from(vector(0)), rotation),
        velocity_world: vector(7),
        gyroscope_bias: vector(10),
        accelerometer_bias: vector(13),
    })
}

/// The text after a key at the start of a line, up to the end of the file.
fn after_key<'a>(file: &'a TextFile, key: &'static str) -> Result<&'a str, RecordError> {
    let mut rest = file.text();
    while !rest.is_empty() {
        let line = rest.trim_start_matches([' ', '\t']);
        if let Some(value) = line.strip_prefix(key).and_then(|r| r.strip_prefix(':')) {
            return Ok(value);
        }
        rest = rest.split_once('\n').map_or("", |(_, next)| next);
    }
    Err(bad_key(file, key, "it is missing".to_owned()))
}

fn bad_key(file: &TextFile, key: &'static str, finding: String) -> RecordError {
    RecordError::Key {
        path: file.path.clone(),
        key,
        finding,
        remedy: "take `sensor.yaml` from the sequence as it was published",
    }
}

fn read_positive(file: &TextFile, key: &'static str) -> Result<f64, RecordError> {
    let line = after_key(file, key)?.lines().next().unwrap_or("");
    let text = line.split('#').next().unwrap_or("").trim();
    let value: Option<f64> = text.parse().ok();
    value
        .filter(|x| x.is_finite() && *x > 0.0)
        .ok_or_else(|| bad_key(file, key, format!("`{text}` is not a positive number")))
}

/// `T_BS`: a 4 x 4 matrix by rows, under `data`, in brackets that may span lines.
fn read_transform(file: &TextFile) -> Result<Pose, RecordError> {
    const KEY: &str = "T_BS";
    let bad = |finding: &str| bad_key(file, KEY, finding.to_owned());
    let block = after_key(file, KEY)?;
    let (_, data) = block
        .split_once("data:")
        .ok_or_else(|| bad("it has no `data`"))?;
    let list = data.trim_start().strip_prefix('[');
    let list = list.and_then(|rest| rest.split_once(']'));
    let (list, _) = list.ok_or_else(|| bad("its `data` is no list in brackets"))?;
    let numbers: Vec<f64> = list
        .split(',')
        .map(|text| text.trim().parse())
        .collect::<Result<_, _>>()
        .map_err(|_| bad("its `data` holds something that is no number"))?;
    let m: [f64; 16] = numbers
        .try_into()
        .map_err(|n: Vec<f64>| bad(&format!("its `data` has {} numbers instead of 16", n.len())))?;
    let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    let departure = (rotation * rotation.transpose() - Matrix3::identity()).norm();
    // A comparison that a NaN does not pass.
    if !(departure < ROTATION_TOLERANCE && rotation.determinant() > 0.0) {
        return Err(bad("its upper left 3 x 3 numbers are no rotation"));
    }
    let rotation = Rotation3::from_matrix_unchecked(rotation);
    Ok(Pose::from_parts(
        Translation3::new(m[3], m[7], m[11]),
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}
