//! What a campaign says: rates with their confidence, the worst cases, what stopped the others.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{Facts, Row, clopper_pearson_95};

/// The figures of a campaign: the JSON object of `alula campaign`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CampaignSummary {
    /// Name of the scenario.
    pub scenario: String,
    /// SHA-256 of the resolved scenario.
    pub digest: String,
    /// Seed of the first flight.
    pub first_seed: u64,
    /// Number of flights flown.
    pub runs: u64,
    /// Number of flights that are planned and not flown yet.
    pub missing: u64,
    /// Number of flights that reached their goal.
    pub reached: u64,
    /// Number of collisions in all flights.
    pub collisions: u64,
    /// Share of the flights that reached their goal.
    pub success_rate: f64,
    /// The 95 % confidence interval of that rate, by Clopper and Pearson.
    pub success_rate_ci95: [f64; 2],
    /// Share of the flights that collided.
    pub collision_rate: f64,
    /// The 95 % confidence interval of that rate, by Clopper and Pearson.
    pub collision_rate_ci95: [f64; 2],
    /// Least true distance from the vehicle's surface to the nearest thing, over flights, m.
    pub min_clearance_m: Option<ClearanceFigures>,
    /// Least true distance from the vehicle's centre to a person's surface, over flights, m.
    pub min_person_distance_m: Option<ClearanceFigures>,
    /// Contacts by someone whom the vehicle could not have seen, in all flights.
    pub unseen_contacts: u64,
    /// Seeds of the flights with such contacts.
    pub unseen_contact_seeds: Vec<u64>,
    /// Number of failed flights by kind.
    pub failures: BTreeMap<String, u64>,
    /// Their seeds, by kind.
    pub failed_seeds: BTreeMap<String, Vec<u64>>,
    /// Wall-clock durations of the parts of a step, ms.
    pub timing_ms: BTreeMap<String, TimingFigures>,
    /// Version of the program.
    pub version: String,
}

/// The small end of a distribution over flights. Percentiles are values that occurred.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClearanceFigures {
    /// The least.
    pub min: f64,
    /// First percentile.
    pub p01: f64,
    /// Median.
    pub p50: f64,
}

/// Durations of a part of a step, over flights, ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TimingFigures {
    /// Mean of the flights' means.
    pub mean: f64,
    /// The worst 99th percentile of a flight.
    pub p99: f64,
    /// The longest of all.
    pub max: f64,
}

impl CampaignSummary {
    /// The figures of some flights of a campaign.
    pub fn of<'a>(facts: &Facts, rows: impl Iterator<Item = &'a Row>) -> Self {
        let rows: Vec<&Row> = rows.collect();
        let count =
            |what: &dyn Fn(&Row) -> bool| rows.iter().filter(|row| what(row)).count() as u64;
        let runs = rows.len() as u64;
        let reached = count(&Row::reached);
        let collided = count(&|row| row.collisions() > 0);
        let failed_seeds = failed_seeds(&rows);
        let count_of = |(kind, seeds): (&String, &Vec<u64>)| (kind.clone(), seeds.len() as u64);
        Self {
            scenario: facts.scenario.clone(),
            digest: facts.digest.clone(),
            first_seed: facts.first_seed,
            runs,
            missing: facts.runs.saturating_sub(runs),
            reached,
            collisions: rows.iter().map(|row| row.collisions()).sum(),
            success_rate: share(reached, runs),
            success_rate_ci95: clopper_pearson_95(reached, runs),
            collision_rate: share(collided, runs),
            collision_rate_ci95: clopper_pearson_95(collided, runs),
            min_clearance_m: ClearanceFigures::of(&rows, "min_clearance_m"),
            min_person_distance_m: ClearanceFigures::of(&rows, "min_person_distance_m"),
            unseen_contacts: rows.iter().map(|row| row.count("unseen_contacts")).sum(),
            unseen_contact_seeds: rows
                .iter()
                .filter(|row| row.count("unseen_contacts") > 0)
                .map(|row| row.seed())
                .collect(),
            failures: failed_seeds.iter().map(count_of).collect(),
            failed_seeds,
            timing_ms: timing(&rows),
            version: facts.version.clone(),
        }
    }
}

impl ClearanceFigures {
    fn of(rows: &[&Row], column: &str) -> Option<Self> {
        let mut values: Vec<f64> = rows.iter().filter_map(|row| row.number(column)).collect();
        values.sort_by(f64::total_cmp);
        let rank = |share: f64| {
            let index = (share * values.len() as f64).ceil() as usize;
            values.get(index.max(1) - 1).copied()
        };
        Some(Self {
            min: rank(0.0)?,
            p01: rank(0.01)?,
            p50: rank(0.5)?,
        })
    }
}

fn share(part: u64, whole: u64) -> f64 {
    if whole == 0 {
        return 0.0;
    }
    part as f64 / whole as f64
}

fn failed_seeds(rows: &[&Row]) -> BTreeMap<String, Vec<u64>> {
    let mut found: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    for row in rows {
        if let Some(kind) = row.failure() {
            found.entry(kind.to_owned()).or_default().push(row.seed());
        }
    }
    found
}

/// Figures of the columns `timing_ms.PART.{mean,p99,max}`.
fn timing(rows: &[&Row]) -> BTreeMap<String, TimingFigures> {
    let mut found: BTreeMap<String, (TimingFigures, u64)> = BTreeMap::new();
    let columns = |row: &Row, part: &str| {
        let number = |figure: &str| row.number(&format!("timing_ms.{part}.{figure}"));
        Some((number("mean")?, number("p99")?, number("max")?))
    };
    for row in rows {
        for part in row.values().keys().filter_map(|column| part_of(column)) {
            let Some((mean, p99, max)) = columns(row, part) else {
                continue;
            };
            let nothing = TimingFigures {
                mean: 0.0,
                p99: 0.0,
                max: 0.0,
            };
            let (figures, flights) = found.entry(part.to_owned()).or_insert((nothing, 0));
            *flights += 1;
            figures.mean += (mean - figures.mean) / *flights as f64;
            figures.p99 = figures.p99.max(p99);
            figures.max = figures.max.max(max);
        }
    }
    let figures = |(part, (figures, _))| (part, figures);
    found.into_iter().map(figures).collect()
}

/// `PART` of a column `timing_ms.PART.mean`.
fn part_of(column: &str) -> Option<&str> {
    column.strip_prefix("timing_ms.")?.strip_suffix(".mean")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(lines: &[&str]) -> CampaignSummary {
        let facts = Facts {
            scenario: "s".into(),
            digest: "d".into(),
            first_seed: 1,
            runs: 10,
            version: "v".into(),
        };
        let rows: Vec<Row> = lines
            .iter()
            .map(|line| Row::parse(line.as_bytes()).unwrap())
            .collect();
        CampaignSummary::of(&facts, rows.iter())
    }

    #[test]
    fn failures_are_counted_by_kind() {
        let found = summary(&[
            r#"{"seed":1,"outcome":"reached","collisions":0}"#,
            r#"{"seed":2,"outcome":"collision","failure":"collision_person","collisions":1,"unseen_contacts":2}"#,
            r#"{"seed":3,"outcome":"timeout","failure":"stalled","collisions":0}"#,
            r#"{"seed":4,"outcome":"timeout","collisions":0}"#,
            r#"{"seed":5,"outcome":"timeout","failure":"stalled","collisions":0}"#,
        ]);
        assert_eq!((found.runs, found.missing), (5, 5));
        assert_eq!((found.reached, found.collisions), (1, 1));
        assert_eq!((found.success_rate, found.collision_rate), (0.2, 0.2));
        let seeds = |kind: &str| found.failed_seeds[kind].clone();
        assert_eq!(seeds("collision_person"), [2]);
        assert_eq!(seeds("stalled"), [3, 5]);
        assert_eq!(seeds("timeout"), [4]);
        assert_eq!(found.failures["stalled"], 2);
        assert_eq!(found.unseen_contacts, 2);
        assert_eq!(found.unseen_contact_seeds, [2]);
    }

    #[test]
    fn clearances_are_those_of_the_closest_flights() {
        let lines: Vec<String> = (1..=200)
            .map(|i| format!("{{\"seed\":{i},\"min_clearance_m\":{}.0}}", 201 - i))
            .collect();
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        let found = summary(&lines).min_clearance_m.unwrap();
        assert_eq!((found.min, found.p01, found.p50), (1.0, 2.0, 100.0));
    }

    #[test]
    fn without_a_figure_there_is_no_clearance() {
        assert_eq!(summary(&[]).min_clearance_m, None);
        assert_eq!(summary(&[r#"{"seed":1}"#]).min_clearance_m, None);
    }

    #[test]
    fn timing_is_the_mean_and_the_worst_over_flights() {
        let found = summary(&[
            r#"{"seed":1,"timing_ms.mpc.mean":1.0,"timing_ms.mpc.p99":5.0,"timing_ms.mpc.max":6.0}"#,
            r#"{"seed":2,"timing_ms.mpc.mean":3.0,"timing_ms.mpc.p99":4.0,"timing_ms.mpc.max":9.0}"#,
            r#"{"seed":3}"#,
        ]);
        let expected = TimingFigures {
            mean: 2.0,
            p99: 5.0,
            max: 9.0,
        };
        assert_eq!(
            found.timing_ms,
            BTreeMap::from([("mpc".to_owned(), expected)])
        );
    }
}
