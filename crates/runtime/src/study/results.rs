//! What a study found.

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::Value;

use super::Chart;
use crate::csv;

/// What a study found.
#[derive(Clone, Debug, Default)]
pub struct Results {
    /// Number of runs that went into it.
    pub runs: u64,
    /// The columns that people see, in order. A row may hold more.
    pub columns: Vec<Column>,
    /// The rows of its table.
    pub rows: Vec<Row>,
    /// What is asked of the figures. They are met or the study has failed.
    pub demands: Vec<Demand>,
    /// What it shows.
    pub charts: Vec<Chart>,
    /// Remarks: how something is measured, where it differs from the source.
    pub notes: Vec<String>,
}

impl Results {
    /// Whether all demands are met.
    pub fn met(&self) -> bool {
        self.demands.iter().all(Demand::met)
    }

    /// The rows as comma-separated values; the source's figure of `key` is in `theirs.key`.
    pub fn to_csv(&self) -> String {
        let keys = keys(self.rows.iter().map(|row| &row.figures));
        let theirs = keys_of_theirs(&self.rows);
        let names = theirs.iter().map(|key| format!("theirs.{key}"));
        let header = keys.iter().map(|key| (*key).to_owned()).chain(names);
        let mut text = csv::line(header.map(|name| csv::escaped(&name)));
        for row in &self.rows {
            let own = keys.iter().map(|key| csv::cell(row.figure(key)));
            let others = theirs.iter().map(|key| csv::cell(row.their(key)));
            text += &csv::line(own.chain(others));
        }
        text
    }
}

fn keys_of_theirs(rows: &[Row]) -> Vec<&str> {
    keys(rows.iter().map(|row| &row.theirs))
}

/// All keys in the order in which they first occur.
fn keys<'a>(maps: impl Iterator<Item = &'a Figures>) -> Vec<&'a str> {
    let mut keys: Vec<&str> = Vec::new();
    for (key, _) in maps.flatten() {
        if !keys.contains(&key.as_str()) {
            keys.push(key);
        }
    }
    keys
}

/// A column of the table that people see.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Its key in the rows.
    pub key: String,
    /// What it is, with its unit.
    pub title: String,
    /// Decimals of its numbers.
    pub decimals: usize,
}

impl Column {
    /// A column.
    pub fn new(key: &str, title: &str, decimals: usize) -> Self {
        Self {
            key: key.to_owned(),
            title: title.to_owned(),
            decimals,
        }
    }

    /// A figure as text for people; a dash where there is none.
    pub fn text(&self, figure: Option<&Value>) -> String {
        match figure {
            None | Some(Value::Null) => "–".to_owned(),
            Some(Value::String(text)) => text.clone(),
            Some(Value::Number(number)) if number.is_f64() => {
                format!("{:.*}", self.decimals, number.as_f64().unwrap_or(f64::NAN))
            }
            Some(other) => other.to_string(),
        }
    }
}

/// Figures by key, in order.
type Figures = Vec<(String, Value)>;

/// One row of a study: figures measured here, and the source's beside them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    figures: Figures,
    theirs: Figures,
}

impl Row {
    /// An empty row.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a measured figure: a number, a text or `None`. A number that is not finite is none.
    pub fn with(mut self, key: &str, figure: impl Into<Value>) -> Self {
        self.figures.push((key.to_owned(), figure.into()));
        self
    }

    /// Adds the source's figure of a key.
    pub fn theirs(mut self, key: &str, figure: impl Into<Value>) -> Self {
        self.theirs.push((key.to_owned(), figure.into()));
        self
    }

    /// A measured figure.
    pub fn figure(&self, key: &str) -> Option<&Value> {
        find(&self.figures, key)
    }

    /// A figure of the source.
    pub fn their(&self, key: &str) -> Option<&Value> {
        find(&self.theirs, key)
    }

    /// A measured figure that is a number.
    pub fn number(&self, key: &str) -> Option<f64> {
        self.figure(key).and_then(Value::as_f64)
    }
}

fn find<'a>(figures: &'a Figures, key: &str) -> Option<&'a Value> {
    figures.iter().find(|(k, _)| k == key).map(|(_, v)| v)
}

impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (key, figure) in &self.figures {
            map.serialize_entry(key, figure)?;
        }
        map.serialize_entry("theirs", &Theirs(&self.theirs))?;
        map.end()
    }
}

struct Theirs<'a>(&'a Figures);

impl Serialize for Theirs<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(key, figure)| (key, figure)))
    }
}

/// What is asked of a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Demand {
    /// Which figure, in words.
    pub what: String,
    /// Its unit; may be empty.
    pub unit: String,
    /// Its bound.
    pub bound: Bound,
    /// What was measured.
    pub measured: f64,
}

/// A bound of a figure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// Not more than this.
    AtMost(f64),
    /// Not less than this.
    AtLeast(f64),
}

impl Demand {
    /// A figure that may not be greater than `limit`.
    pub fn at_most(what: &str, unit: &str, limit: f64, measured: f64) -> Self {
        Self::bounded(what, unit, Bound::AtMost(limit), measured)
    }

    /// A figure that may not be less than `limit`.
    pub fn at_least(what: &str, unit: &str, limit: f64, measured: f64) -> Self {
        Self::bounded(what, unit, Bound::AtLeast(limit), measured)
    }

    fn bounded(what: &str, unit: &str, bound: Bound, measured: f64) -> Self {
        Self {
            what: what.to_owned(),
            unit: unit.to_owned(),
            bound,
            measured,
        }
    }

    /// Whether it is met; what could not be measured is not.
    pub fn met(&self) -> bool {
        match self.bound {
            Bound::AtMost(limit) => self.measured <= limit,
            Bound::AtLeast(limit) => self.measured >= limit,
        }
    }

    /// What is asked, in words.
    pub fn asked(&self) -> String {
        match self.bound {
            Bound::AtMost(limit) => self.amount("at most", limit),
            Bound::AtLeast(limit) => self.amount("at least", limit),
        }
    }

    /// What was measured, with its unit.
    pub fn found(&self) -> String {
        if self.measured.is_nan() {
            return "nothing".to_owned();
        }
        let rounded = three_digits(self.measured);
        // A figure beyond its bound may not look as if it were on it.
        let shown = if self.met_by(rounded) == self.met() {
            rounded
        } else {
            self.measured
        };
        self.amount("", shown)
    }

    fn met_by(&self, measured: f64) -> bool {
        let other = Self {
            measured,
            ..self.clone()
        };
        other.met()
    }

    fn amount(&self, word: &str, value: f64) -> String {
        let text = format!("{word} {value} {}", self.unit);
        text.trim().to_owned()
    }
}

/// A number with three significant digits, or all those before its point.
fn three_digits(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let digits = 2 - value.abs().log10().floor() as i32;
    let scale = 10f64.powi(digits.max(0));
    (value * scale).round() / scale
}

impl Serialize for Demand {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("what", &self.what)?;
        map.serialize_entry("unit", &self.unit)?;
        match self.bound {
            Bound::AtMost(limit) => map.serialize_entry("at_most", &limit)?,
            Bound::AtLeast(limit) => map.serialize_entry("at_least", &limit)?,
        }
        map.serialize_entry("measured", &self.measured)?;
        map.serialize_entry("met", &self.met())?;
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<Row> {
        vec![
            Row::new()
                .with("scene", "one, two")
                .with("error_m", 0.125)
                .theirs("error_m", 0.26),
            Row::new().with("scene", "three").with("frames", 7_u64),
        ]
    }

    #[test]
    fn a_row_has_the_figures_of_the_source_beside_its_own() {
        let json = serde_json::to_string(&rows()[0]).unwrap();
        assert_eq!(
            json,
            r#"{"scene":"one, two","error_m":0.125,"theirs":{"error_m":0.26}}"#
        );
    }

    #[test]
    fn the_table_has_a_line_for_each_row_and_the_columns_of_all() {
        let results = Results {
            rows: rows(),
            ..Results::default()
        };
        assert_eq!(
            results.to_csv(),
            "scene,error_m,frames,theirs.error_m\n\"one, two\",0.125,,0.26\nthree,,7,\n"
        );
    }

    #[test]
    fn what_could_not_be_measured_is_not_met() {
        assert!(Demand::at_most("", "", 1.0, 1.0).met());
        assert!(Demand::at_least("", "", 1.0, 1.0).met());
        assert!(!Demand::at_most("", "", 1.0, f64::NAN).met());
        assert!(!Demand::at_least("", "", 1.0, f64::NAN).met());
    }

    #[test]
    fn a_figure_just_beyond_its_bound_does_not_look_as_if_it_were_on_it() {
        let found = |measured| Demand::at_most("", "m", 0.13, measured).found();
        assert_eq!(found(0.123_45), "0.123 m");
        assert_eq!(found(0.130_01), "0.13001 m");
        assert_eq!(found(1234.56), "1235 m");
    }

    #[test]
    fn absent_figures_are_dashes() {
        let column = Column::new("error_m", "error (m)", 2);
        let text = |row: &Row| column.text(row.figure("error_m"));
        assert_eq!([text(&rows()[0]), text(&rows()[1])], ["0.12", "–"]);
    }
}
