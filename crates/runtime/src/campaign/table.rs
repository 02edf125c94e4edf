//! The table of all flights as comma-separated values (RFC 4180).

use std::collections::BTreeSet;

use super::Row;
use super::row::is_wall_clock;
use crate::csv::{cell, escaped, line};

/// The columns that come first.
const FIRST: [&str; 8] = [
    "seed",
    "outcome",
    "failure",
    "collisions",
    "min_clearance_m",
    "duration_s",
    "path_length_m",
    "max_speed_m_s",
];

/// A header and a line for each row. Columns are those of all rows together: the important ones
/// first, wall-clock times last. What a row does not have is left empty.
pub fn to_csv<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> String {
    let columns = columns(rows.clone());
    let mut text = line(columns.iter().map(|column| escaped(column)));
    for row in rows {
        text += &line(columns.iter().map(|column| cell(row.values().get(*column))));
    }
    text
}

fn columns<'a>(rows: impl Iterator<Item = &'a Row>) -> Vec<&'a str> {
    let all: BTreeSet<&str> = rows
        .flat_map(|row| row.values().keys().map(String::as_str))
        .collect();
    let place = |column: &str| {
        let first = FIRST.iter().position(|name| *name == column);
        (is_wall_clock(column), first.unwrap_or(FIRST.len()))
    };
    let mut columns: Vec<&str> = all.into_iter().collect();
    columns.sort_by_key(|column| place(column));
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_the_columns_of_all_rows() {
        let rows = [
            r#"{"seed":1,"timing_ms.a":0.5,"outcome":"reached","failure":null,"b":1e-7}"#,
            r#"{"seed":2,"outcome":"aborted","failure":"crash","reason":"a \"b\",\nc"}"#,
        ]
        .map(|line| Row::parse(line.as_bytes()).unwrap());
        let expected = "seed,outcome,failure,b,reason,timing_ms.a\n\
                        1,reached,,1e-7,,0.5\n\
                        2,aborted,crash,,\"a \"\"b\"\",\nc\",\n";
        assert_eq!(to_csv(rows.iter()), expected);
    }
}
