//! A campaign on one page: how its flights ended, how near they came to things and people, and how
//! to look at those that failed.

use std::collections::BTreeMap;
use std::path::Path;

use alula_runtime::campaign::{Campaign, CampaignSummary, Row as Flown};

use crate::page::{Fact, Page, PageFigure, Row, Span, Status, Table};
use crate::plot::{Bar, Bars, Colour, Panel};

/// Most failed flights that are listed of a kind.
const LISTED: usize = 20;

/// Classes of a histogram, and the width that is tried first, m.
const CLASSES: usize = 16;
const CLASS_M: f64 = 0.05;

/// The page of the flights of a campaign so far.
pub fn page(campaign: &Campaign, rows: &BTreeMap<u64, Flown>) -> Page {
    let summary = CampaignSummary::of(campaign.facts(), rows.values());
    let kept = [
        ("min_clearance_m", "least clearance (surface to surface)"),
        (
            "min_person_distance_m",
            "nearest person (centre to ellipsoid)",
        ),
    ];
    let histograms = kept.iter().filter_map(|(column, title)| {
        let values: Vec<f64> = rows.values().filter_map(|row| row.number(column)).collect();
        (!values.is_empty()).then(|| figure(&histogram(title, &values), Span::Half))
    });
    Page {
        title: format!("{}: {} flights", summary.scenario, summary.runs),
        subtitle: format!(
            "seeds {} to {}, version {}",
            summary.first_seed,
            summary.first_seed + (summary.runs + summary.missing).saturating_sub(1),
            summary.version
        ),
        summary: facts(&summary),
        figures: [figure(&outcomes(&summary), Span::Full)]
            .into_iter()
            .chain(histograms)
            .collect(),
        tables: vec![failures(campaign.folder(), &summary, rows)],
        notes: Vec::new(),
        footer: format!("alula {}", alula_runtime::VERSION),
    }
}

fn figure(bars: &Bars, span: Span) -> PageFigure {
    PageFigure {
        svg: bars.to_svg(if span == Span::Full { 1000.0 } else { 560.0 }),
        caption: String::new(),
        span,
    }
}

fn facts(summary: &CampaignSummary) -> Vec<Fact> {
    let fact = |label: &str, value: String, good: bool| Fact {
        label: label.to_owned(),
        value,
        status: if good { Status::Good } else { Status::Warning },
    };
    let percent = |rate: f64, [low, high]: [f64; 2]| {
        let (rate, low, high) = (100.0 * rate, 100.0 * low, 100.0 * high);
        format!("{rate:.1} % ({low:.1} to {high:.1})")
    };
    let mut facts = vec![
        fact(
            "reached (95 % confidence)",
            percent(summary.success_rate, summary.success_rate_ci95),
            summary.reached == summary.runs,
        ),
        fact(
            "collided (95 % confidence)",
            percent(summary.collision_rate, summary.collision_rate_ci95),
            summary.collisions == 0,
        ),
    ];
    if let Some(clearance) = &summary.min_clearance_m {
        let value = format!("{:.2} m, median {:.2} m", clearance.min, clearance.p50);
        facts.push(fact("least clearance", value, clearance.min > 0.0));
    }
    if let Some(distance) = &summary.min_person_distance_m {
        let value = format!("{:.2} m, median {:.2} m", distance.min, distance.p50);
        facts.push(fact("nearest person", value, distance.min > 0.0));
        let unseen = summary.unseen_contacts;
        facts.push(fact("unseen contacts", unseen.to_string(), unseen == 0));
    }
    if summary.missing > 0 {
        facts.push(fact("not flown yet", summary.missing.to_string(), false));
    }
    facts
}

/// How the flights ended, by kind.
fn outcomes(summary: &CampaignSummary) -> Bars {
    let bar = |label: &str, count: u64, colour| Bar {
        label: label.to_owned(),
        value: count as f64,
        colour,
    };
    let failed = summary.failures.iter().map(|(kind, count)| {
        let colour = if kind.starts_with("collision") {
            Colour::Vermillion
        } else {
            Colour::Orange
        };
        bar(kind, *count, colour)
    });
    Bars {
        title: "how the flights ended".to_owned(),
        x_label: "flights".to_owned(),
        bars: [bar("reached", summary.reached, Colour::Green)]
            .into_iter()
            .chain(failed)
            .collect(),
        limit: None,
        decimals: 0,
    }
}

/// Number of values in classes of equal, round width; the last class has no upper end.
fn histogram(title: &str, values: &[f64]) -> Bars {
    let low = values.iter().copied().fold(0.0, f64::min);
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    // A few large values may not flatten all others.
    let most = sorted[(sorted.len() - 1) * 95 / 100];
    let mut width_m = CLASS_M;
    while low + width_m * CLASSES as f64 <= most {
        width_m *= 2.0;
    }
    let first = (low / width_m).floor();
    let class = |value: f64| {
        let number = (value / width_m - first).floor().max(0.0) as usize;
        number.min(CLASSES - 1)
    };
    let mut counts = [0_u32; CLASSES];
    for value in values {
        counts[class(*value)] += 1;
    }
    let bars = counts.iter().enumerate().map(|(i, count)| {
        let from = (first + i as f64) * width_m;
        let label = match i + 1 {
            CLASSES => format!("{from:.2} m and more"),
            _ => format!("{from:.2} to {:.2} m", from + width_m),
        };
        Bar {
            label,
            value: f64::from(*count),
            colour: if from < 0.0 {
                Colour::Vermillion
            } else {
                Colour::Blue
            },
        }
    });
    Bars {
        title: title.to_owned(),
        x_label: "flights".to_owned(),
        bars: bars.collect(),
        limit: None,
        decimals: 0,
    }
}

/// The flights that failed, each with the command that flies it again and records it.
fn failures(folder: &Path, summary: &CampaignSummary, rows: &BTreeMap<u64, Flown>) -> Table {
    let mut table = Table {
        title: "What stopped the others".to_owned(),
        header: ["kind", "seed", "reason", "fly it again, recorded"]
            .map(str::to_owned)
            .to_vec(),
        rows: Vec::new(),
        caption: String::new(),
    };
    for (kind, seeds) in &summary.failed_seeds {
        for seed in seeds.iter().take(LISTED) {
            let reason = rows.get(seed).and_then(|row| row.text("reason"));
            table.rows.push(Row {
                cells: vec![
                    kind.clone(),
                    seed.to_string(),
                    reason.unwrap_or("-").to_owned(),
                    format!("alula campaign --refly {seed} --out {}", folder.display()),
                ],
                status: if kind.starts_with("collision") {
                    Status::Bad
                } else {
                    Status::Warning
                },
            });
        }
        if seeds.len() > LISTED {
            let more = seeds.len() - LISTED;
            table.caption += &format!("{more} more of {kind} are in flights.csv. ");
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(values: &[f64]) -> Vec<f64> {
        let bars = histogram("", values).bars;
        bars.iter().map(|bar| bar.value).collect()
    }

    #[test]
    fn a_histogram_counts_every_value_once() {
        let values: Vec<f64> = (0..500).map(|i| 0.013 * f64::from(i) - 0.2).collect();
        assert_eq!(counts(&values).iter().sum::<f64>(), 500.0);
    }

    #[test]
    fn values_on_a_border_belong_to_the_upper_class() {
        assert_eq!(counts(&[0.0, 0.049, CLASS_M])[..3], [2.0, 1.0, 0.0]);
    }

    #[test]
    fn what_was_hit_is_coloured() {
        let bars = histogram("", &[-0.01, 0.3]).bars;
        assert_eq!(bars[0].colour, Colour::Vermillion);
        assert_eq!(bars[1].colour, Colour::Blue);
    }
}
