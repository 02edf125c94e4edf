//! Trajectories in the format of the TUM RGB-D benchmark: `t x y z qx qy qz qw` a line, seconds
//! and metres, comments after `#`. The quaternion is Hamilton's with w last.

use std::fmt::Write as _;
use std::path::Path;

use alula_geometry::{Pose, Timestamp};
use alula_messages::PoseSample;
use nalgebra::Translation3;

use crate::RecordError;
use crate::text::{Clock, Line, Separator, TextFile};

const LAYOUT: &str = "a line is `t x y z qx qy qz qw`";
const NS_PER_S: i64 = 1_000_000_000;

/// Reads a trajectory. Times are read to the nanosecond.
///
/// # Errors
/// When the file cannot be read, a line cannot be understood, or the times do not increase.
pub fn read(path: impl AsRef<Path>) -> Result<Vec<PoseSample>, RecordError> {
    let path = path.as_ref();
    if !path.exists() {
        return Err(RecordError::Missing {
            what: "TUM trajectory",
            path: path.to_owned(),
            remedy: "check the name",
        });
    }
    let file = TextFile::read(path)?;
    let mut clock = Clock::default();
    let poses: Vec<PoseSample> = file
        .data_lines()
        .map(|line| read_pose(&line, &mut clock))
        .collect::<Result<_, _>>()?;
    if poses.is_empty() {
        return Err(RecordError::Empty {
            path: path.to_owned(),
            what: "poses",
            remedy: LAYOUT,
        });
    }
    Ok(poses)
}

fn read_pose(line: &Line, clock: &mut Clock) -> Result<PoseSample, RecordError> {
    let columns = line.columns(Separator::Space, 8, LAYOUT)?;
    let time_ns = parse_seconds(columns[0]).ok_or_else(|| {
        line.malformed(
            format!("column 1 is `{}`, not a time in seconds", columns[0]),
            LAYOUT,
        )
    })?;
    if let Some(earlier_line) = clock.tick(line, time_ns)? {
        return Err(line.malformed(
            format!("its time is that of line {earlier_line}"),
            "remove one of the two lines",
        ));
    }
    let [x, y, z, qx, qy, qz, qw] = line.numbers(&columns[1..], 2)?;
    let rotation = line.rotation([qw, qx, qy, qz])?;
    Ok(PoseSample {
        time: Timestamp::from_ns(time_ns),
        sensor: 0,
        world_from_body: Pose::from_parts(Translation3::new(x, y, z), rotation),
    })
}

/// Nanoseconds from seconds in decimal notation, exactly; further digits are cut off.
fn parse_seconds(text: &str) -> Option<i64> {
    if text.contains(['e', 'E']) {
        let seconds: f64 = text.parse().ok()?;
        return seconds
            .is_finite()
            .then(|| Timestamp::from_s(seconds).as_ns());
    }
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let all_digits = |s: &str| s.bytes().all(|byte| byte.is_ascii_digit());
    if whole.is_empty() || !all_digits(whole) || !all_digits(fraction) {
        return None;
    }
    let seconds: i64 = whole.parse().ok()?;
    let fraction_ns: i64 = format!("{fraction:0<9}").get(..9)?.parse().ok()?;
    let ns = seconds.checked_mul(NS_PER_S)?.checked_add(fraction_ns)?;
    Some(if negative { -ns } else { ns })
}

/// Writes a trajectory: times to the nanosecond, numbers so that reading gives the same bits.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: impl AsRef<Path>, poses: &[PoseSample]) -> Result<(), RecordError> {
    let path = path.as_ref();
    std::fs::write(path, to_text(poses)).map_err(RecordError::write(path))
}

/// A trajectory as text.
pub fn to_text(poses: &[PoseSample]) -> String {
    let mut text = String::from("# timestamp_s x_m y_m z_m qx qy qz qw\n");
    for pose in poses {
        let [x, y, z] = pose.world_from_body.translation.vector.into();
        let q = &pose.world_from_body.rotation;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{} {x} {y} {z} {} {} {} {}",
            Seconds(pose.time),
            q.i,
            q.j,
            q.k,
            q.w
        );
    }
    text
}

/// A time in seconds with all its nine decimals.
struct Seconds(Timestamp);

impl std::fmt::Display for Seconds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ns = self.0.as_ns();
        let sign = if ns < 0 { "-" } else { "" };
        let (seconds, rest) = (
            ns.unsigned_abs() / NS_PER_S as u64,
            ns.unsigned_abs() % NS_PER_S as u64,
        );
        write!(f, "{sign}{seconds}.{rest:09}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::so3;
    use nalgebra::Vector3;

    fn read_text(text: &str) -> Result<Vec<PoseSample>, RecordError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.tum");
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    fn check_message(text: &str, parts: &[&str]) {
        let message = read_text(text).unwrap_err().to_string();
        for part in ["path.tum"].iter().chain(parts) {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }

    #[test]
    fn a_written_trajectory_reads_back_to_the_bit() {
        let poses: Vec<PoseSample> = (0..200)
            .map(|i| {
                let s = f64::from(i);
                let rotation = so3::exp(&Vector3::new(0.01 * s, 1.0 / (s + 3.0), -0.02 * s));
                PoseSample {
                    time: Timestamp::from_ns(1_403_715_273_262_142_976 + i64::from(i) * 12_345_679),
                    sensor: 0,
                    world_from_body: Pose::from_parts(
                        Translation3::new(s / 3.0, -0.0, 1e-12 * s),
                        rotation,
                    ),
                }
            })
            .collect();
        assert_eq!(
            format!("{:?}", read_text(&to_text(&poses)).unwrap()),
            format!("{poses:?}")
        );
    }

    #[test]
    fn times_are_read_to_the_nanosecond() {
        for (text, ns) in [
            ("1403715273.262142976", 1_403_715_273_262_142_976),
            ("0.5", 500_000_000),
            ("-1.25", -1_250_000_000),
            ("7", 7_000_000_000),
            ("2.5e1", 25_000_000_000),
        ] {
            assert_eq!(parse_seconds(text), Some(ns), "{text}");
        }
        for text in ["", ".5", "1.2.3", "abc", "1,5", "-", "99999999999"] {
            assert_eq!(parse_seconds(text), None, "{text}");
        }
    }

    #[test]
    fn comments_empty_lines_and_a_missing_last_line_end_are_allowed() {
        let poses = read_text("# a\n\n0 1 2 3 0 0 0 1\r\n 1  1 2 3 0 0 0 1").unwrap();
        assert_eq!(poses.len(), 2);
        assert_eq!(poses[0].world_from_body.translation.z, 3.0);
    }

    #[test]
    fn a_malformed_line_is_named_with_its_finding() {
        check_message(
            "0 1 2 3 0 0 0 1\n1 2 3\n",
            &["line 2", "3 columns instead of 8"],
        );
        check_message("0 1 2 x 0 0 0 1\n", &["line 1", "column 4 is `x`"]);
        check_message("0 1 2 nan 0 0 0 1\n", &["line 1", "column 4 is `nan`"]);
        check_message("zero 1 2 3 0 0 0 1\n", &["line 1", "`zero`", "seconds"]);
        check_message("0 1 2 3 0 0 0 2\n", &["line 1", "length 2"]);
    }

    #[test]
    fn times_must_increase() {
        check_message(
            "#\n1 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n",
            &["line 3", "before", "line 2", "sort"],
        );
        check_message(
            "1 0 0 0 0 0 0 1\n1.0 0 0 0 0 0 0 1\n",
            &["line 2", "that of line 1"],
        );
    }

    #[test]
    fn a_file_without_poses_is_refused() {
        check_message("# nothing\n", &["holds no poses"]);
        let message = read("no/such.tum").unwrap_err().to_string();
        assert!(message.contains("no/such.tum") && message.contains("does not exist"));
    }
}
