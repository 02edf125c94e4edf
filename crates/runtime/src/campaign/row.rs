//! A flight as one row: its figures, flat, by name.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use serde_json::{Value, json};

use crate::flight::{self, Flight, FlightSummary, RecordTo};
use crate::{RunError, Scenario, VERSION};

/// The columns whose values depend on the machine and its load; a trailing dot means all below.
const WALL_CLOCK: [&str; 2] = ["timing_ms.", "real_time_factor"];

/// A flight of a campaign: the figures of `alula fly --json`, with the names of nested ones joined
/// by dots, such as `estimation.position_rmse_m`.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    seed: u64,
    values: BTreeMap<String, Value>,
}

impl Row {
    /// The row of a flight that is over.
    pub fn of(summary: &FlightSummary) -> Self {
        let mut values = BTreeMap::new();
        // A summary is plain data with text keys: it always has a JSON form.
        flatten("", json!(summary), &mut values);
        Self {
            seed: summary.seed,
            values,
        }
    }

    /// The row of a flight that has no figures.
    fn unflown(scenario: &Scenario, seed: u64, accident: &Accident) -> Self {
        let values = json!({
            "scenario": scenario.config().name,
            "seed": seed,
            "outcome": "aborted",
            "failure": accident.kind,
            "reason": accident.reason,
            "collisions": 0,
            "version": VERSION,
        });
        let mut row = Self {
            seed,
            values: BTreeMap::new(),
        };
        flatten("", values, &mut row.values);
        row
    }

    /// Reads a line of a file of rows.
    pub(super) fn parse(line: &[u8]) -> Result<Self, String> {
        let values: BTreeMap<String, Value> =
            serde_json::from_slice(line).map_err(|error| error.to_string())?;
        let seed = values.get("seed").and_then(Value::as_u64);
        let seed = seed.ok_or("there is no `seed`")?;
        Ok(Self { seed, values })
    }

    /// The line of a file of rows, its end included.
    pub(super) fn to_line(&self) -> Vec<u8> {
        let mut line = serde_json::to_vec(&self.values).unwrap_or_default();
        line.push(b'\n');
        line
    }

    /// Seed of the flight.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// All values, by column.
    pub fn values(&self) -> &BTreeMap<String, Value> {
        &self.values
    }

    /// A number, if the column has one.
    pub fn number(&self, column: &str) -> Option<f64> {
        self.values.get(column).and_then(Value::as_f64)
    }

    /// A text, if the column has one.
    pub fn text(&self, column: &str) -> Option<&str> {
        self.values.get(column).and_then(Value::as_str)
    }

    /// How the flight ended: a word of [`flight::Outcome`].
    pub fn outcome(&self) -> &str {
        self.text("outcome").unwrap_or("aborted")
    }

    /// Whether it reached its goal.
    pub fn reached(&self) -> bool {
        self.outcome() == flight::Outcome::Reached.name()
    }

    /// Number of collisions.
    pub fn collisions(&self) -> u64 {
        self.count("collisions")
    }

    /// A whole number; 0 if the column has none.
    pub fn count(&self, column: &str) -> u64 {
        self.values.get(column).and_then(Value::as_u64).unwrap_or(0)
    }

    /// The kind of failure, if it failed.
    pub fn failure(&self) -> Option<&str> {
        let unnamed = (!self.reached()).then(|| self.outcome());
        self.text("failure").or(unnamed)
    }

    /// The columns in which two flights of the same scenario and seed differ, wall-clock times
    /// apart: none, if flights are what they should be.
    pub(super) fn differences<'a>(&'a self, other: &'a Self) -> Vec<&'a str> {
        let mut columns: Vec<&str> = self
            .values
            .keys()
            .chain(other.values.keys())
            .map(String::as_str)
            .filter(|column| !is_wall_clock(column))
            .filter(|column| self.values.get(*column) != other.values.get(*column))
            .collect();
        columns.sort_unstable();
        columns.dedup();
        columns
    }
}

/// Whether a column depends on the machine and its load.
pub fn is_wall_clock(column: &str) -> bool {
    WALL_CLOCK.iter().any(|name| {
        if name.ends_with('.') {
            column.starts_with(name)
        } else {
            column == *name
        }
    })
}

/// Joins the keys of nested objects with dots.
fn flatten(prefix: &str, value: Value, into: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(members) => {
            for (key, value) in members {
                let dot = if prefix.is_empty() { "" } else { "." };
                flatten(&format!("{prefix}{dot}{key}"), value, into);
            }
        }
        value => {
            into.insert(prefix.to_owned(), value);
        }
    }
}

/// Why a flight has no figures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Accident {
    /// Stable word.
    pub kind: &'static str,
    /// What the program said.
    pub reason: String,
}

/// Flies without a recording; whatever happens becomes a row.
pub fn fly(scenario: &Scenario, seed: u64) -> Row {
    let nothing = RecordTo::Nothing;
    row_of(
        scenario,
        seed,
        &guarded(|| flight::fly(scenario, seed, &nothing, &mut |_| {})),
    )
}

/// The row of a flight or of an accident.
pub fn row_of(scenario: &Scenario, seed: u64, flown: &Result<Flight, Accident>) -> Row {
    match flown {
        Ok(flight) => Row::of(&flight.summary),
        Err(accident) => Row::unflown(scenario, seed, accident),
    }
}

/// Turns errors and panics of a flight into findings: one flight does not end a campaign.
pub fn guarded(fly: impl FnOnce() -> Result<Flight, RunError>) -> Result<Flight, Accident> {
    // What a flight changes is its own, and gone with it.
    match catch_unwind(AssertUnwindSafe(fly)) {
        Ok(Ok(flight)) => Ok(flight),
        Ok(Err(error)) => Err(Accident {
            kind: match error {
                RunError::Scenario { .. } | RunError::World(_) => "impossible_world",
                _ => "error",
            },
            reason: error.to_string(),
        }),
        Err(panic) => Err(Accident {
            kind: "crash",
            reason: match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
                (Some(text), _) => (*text).to_owned(),
                (_, Some(text)) => text.clone(),
                _ => "a panic without a message".to_owned(),
            },
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scenario() -> Scenario {
        Scenario::load(None, &[]).unwrap()
    }

    #[test]
    fn nested_figures_are_joined_by_dots() {
        let mut found = BTreeMap::new();
        flatten(
            "",
            json!({"a": 1, "b": {"c": {"d": null}}, "e": {}}),
            &mut found,
        );
        let expected = [
            ("a".to_owned(), json!(1)),
            ("b.c.d".to_owned(), Value::Null),
        ];
        assert_eq!(found, BTreeMap::from(expected));
    }

    #[test]
    fn a_panic_is_a_flight_that_failed() {
        let flown = guarded(|| panic!("index {} is out of bounds", 7));
        let row = row_of(&scenario(), 3, &flown);
        assert_eq!((row.seed(), row.reached()), (3, false));
        assert_eq!(row.failure(), Some("crash"));
        assert_eq!(row.text("reason"), Some("index 7 is out of bounds"));
    }

    #[test]
    fn an_error_is_a_flight_that_failed() {
        let error = || RunError::Input {
            what: "a".into(),
            finding: "b".into(),
            remedy: "c".into(),
        };
        let row = row_of(&scenario(), 3, &guarded(|| Err(error())));
        assert_eq!(row.failure(), Some("error"));
        assert_eq!(row.text("reason"), Some("a: b. c"));
    }

    #[test]
    fn a_line_reads_back_the_same() {
        let mut row = row_of(
            &scenario(),
            3,
            &guarded(|| panic!("two\nlines, \"quoted\"")),
        );
        row.values.insert("x".into(), json!(0.1 + 0.2));
        let line = row.to_line();
        assert_eq!(line.iter().filter(|byte| **byte == b'\n').count(), 1);
        assert_eq!(Row::parse(&line).unwrap(), row);
    }

    #[test]
    fn only_wall_clock_times_may_differ() {
        let row = |text: &str| Row::parse(text.as_bytes()).unwrap();
        let one = row(r#"{"seed":1,"x":1.0,"timing_ms.a.mean":1.0,"real_time_factor":2.0}"#);
        let same = row(r#"{"seed":1,"x":1.0,"timing_ms.a.mean":3.0}"#);
        let other = row(r#"{"seed":1,"x":2.0,"y":null}"#);
        assert!(one.differences(&same).is_empty());
        assert_eq!(one.differences(&other), ["x", "y"]);
    }
}
