//! Text files with a sample a line: lines with numbers, numbers with places, times in order.

use std::path::{Path, PathBuf};

use nalgebra::{Quaternion, UnitQuaternion};

use crate::RecordError;

/// Orientations in files are rounded; one further from unit length than this is something else.
const QUATERNION_TOLERANCE: f64 = 0.01;

/// A unit quaternion keeps its bits if its squared length is this close to 1: rounding of the
/// squares and sums explains no more.
const UNIT_TOLERANCE: f64 = 8.0 * f64::EPSILON;

/// A text file in memory.
pub(crate) struct TextFile {
    pub path: PathBuf,
    text: String,
}

impl TextFile {
    pub fn read(path: &Path) -> Result<Self, RecordError> {
        let bytes = std::fs::read(path).map_err(RecordError::read(path))?;
        let text = String::from_utf8(bytes).map_err(|error| {
            let good = error.utf8_error().valid_up_to();
            let before = &error.as_bytes()[..good];
            RecordError::Malformed {
                path: path.to_owned(),
                line: 1 + before.iter().filter(|byte| **byte == b'\n').count(),
                finding: "bytes that are not text".to_owned(),
                remedy: "give the text file, not a binary or compressed one",
            }
        })?;
        Ok(Self {
            path: path.to_owned(),
            text,
        })
    }

    pub fn text(&self) -> &str {
        &self.text
    }

    /// Lines with data, each with its number from 1, without comments and empty lines.
    pub fn data_lines(&self) -> impl Iterator<Item = Line<'_>> {
        let lines = self.text.split_inclusive('\n').enumerate();
        lines.filter_map(|(index, raw)| {
            let text = raw.trim();
            let has_data = !text.is_empty() && !text.starts_with('#');
            has_data.then_some(Line {
                path: &self.path,
                number: index + 1,
                text,
                is_whole: raw.ends_with('\n'),
            })
        })
    }
}

/// A line with data.
#[derive(Clone, Copy)]
pub(crate) struct Line<'a> {
    path: &'a Path,
    pub number: usize,
    text: &'a str,
    /// Whether it has its end; without it the last number may be cut.
    pub is_whole: bool,
}

impl<'a> Line<'a> {
    pub fn malformed(&self, finding: String, remedy: &'static str) -> RecordError {
        RecordError::Malformed {
            path: self.path.to_owned(),
            line: self.number,
            finding,
            remedy,
        }
    }

    /// The columns between separators, `expected` of them; `layout` names them for the message.
    pub fn columns(
        &self,
        separator: Separator,
        expected: usize,
        layout: &'static str,
    ) -> Result<Vec<&'a str>, RecordError> {
        let columns: Vec<&str> = match separator {
            Separator::Comma => self.text.split(',').map(str::trim).collect(),
            Separator::Space => self.text.split_whitespace().collect(),
        };
        let found = columns.len();
        if found == expected {
            return Ok(columns);
        }
        Err(self.malformed(format!("{found} columns instead of {expected}"), layout))
    }

    /// Finite numbers from columns; `first` is the number of the first column, from 1.
    pub fn numbers<const N: usize>(
        &self,
        columns: &[&str],
        first: usize,
    ) -> Result<[f64; N], RecordError> {
        let mut numbers = [0.0; N];
        for (i, (number, column)) in numbers.iter_mut().zip(columns).enumerate() {
            *number = self.number(column, first + i)?;
        }
        Ok(numbers)
    }

    fn number(&self, text: &str, column: usize) -> Result<f64, RecordError> {
        let value: Option<f64> = text.parse().ok();
        value.filter(|x| x.is_finite()).ok_or_else(|| {
            self.malformed(
                format!("column {column} is `{text}`, not a finite number"),
                "correct or remove the line",
            )
        })
    }

    /// A rotation from a quaternion that a file rounds.
    pub fn rotation(&self, [w, x, y, z]: [f64; 4]) -> Result<UnitQuaternion<f64>, RecordError> {
        let q = Quaternion::new(w, x, y, z);
        let norm_squared = q.norm_squared();
        if (norm_squared - 1.0).abs() <= UNIT_TOLERANCE {
            return Ok(UnitQuaternion::new_unchecked(q));
        }
        let norm = norm_squared.sqrt();
        if (norm - 1.0).abs() > QUATERNION_TOLERANCE {
            return Err(self.malformed(
                format!("the quaternion has length {norm}"),
                "an orientation is a quaternion of length 1",
            ));
        }
        Ok(UnitQuaternion::new_normalize(q))
    }
}

/// What stands between columns.
#[derive(Clone, Copy)]
pub(crate) enum Separator {
    Comma,
    Space,
}

/// Holds the times of a file against each other.
#[derive(Default)]
pub(crate) struct Clock {
    last: Option<(i64, usize)>,
}

impl Clock {
    /// The earlier line with the same time, if there is one; an error if time goes backwards.
    pub fn tick(&mut self, line: &Line, time_ns: i64) -> Result<Option<usize>, RecordError> {
        let last = self.last.replace((time_ns, line.number));
        match last {
            Some((earlier_ns, earlier_line)) if time_ns < earlier_ns => {
                Err(RecordError::Backwards {
                    path: line.path.to_owned(),
                    line: line.number,
                    time_ns,
                    earlier_line,
                    earlier_ns,
                })
            }
            Some((earlier_ns, earlier_line)) if time_ns == earlier_ns => Ok(Some(earlier_line)),
            _ => Ok(None),
        }
    }
}
