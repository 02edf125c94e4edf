//! A study as a table for the terminal and as a page.

use alula_runtime::study::{Chart, Column, Curve, CurveStyle, Demand, Results, Study, Tone};
use alula_runtime::study::{Frame, Outline as Believed};

use crate::page::{Fact, Page, PageFigure, Row, Span, Status, Table};
use crate::plot::{
    BLANK, Band, Bar, Bars, Colour, Fill, LineChart, MapShape, MapView, Outline, Panel, Picture,
    PictureBox, Series, Style, false_colour,
};

/// Widths of figures that take all and half of the page, pixels.
const FULL_WIDTH: f64 = 1000.0;
const HALF_WIDTH: f64 = 560.0;

/// The page of a study.
pub fn page(study: &Study, seed: u64, results: &Results) -> Page {
    let (header, cells) = table(results);
    let row = |cells| Row {
        cells,
        status: Status::Neutral,
    };
    let figures = Table {
        title: "Measured, and the source's figures beside".to_owned(),
        header,
        rows: cells.into_iter().map(row).collect(),
        caption: String::new(),
    };
    Page {
        title: study.name.to_owned(),
        subtitle: format!(
            "{} ({}). {} {}, seed {seed}",
            study.about, study.source, results.runs, study.runs_are
        ),
        summary: results.demands.iter().map(fact).collect(),
        figures: results.charts.iter().map(figure).collect(),
        tables: vec![demands(results), figures],
        notes: results.notes.clone(),
        footer: format!("alula {}", alula_runtime::VERSION),
    }
}

fn fact(demand: &Demand) -> Fact {
    Fact {
        label: format!("{}, {}", demand.what, demand.asked()),
        value: demand.found(),
        status: status(demand),
    }
}

fn status(demand: &Demand) -> Status {
    if demand.met() {
        Status::Good
    } else {
        Status::Bad
    }
}

fn demands(results: &Results) -> Table {
    let row = |demand: &Demand| Row {
        cells: vec![
            demand.what.clone(),
            demand.asked(),
            demand.found(),
            verdict(demand).to_owned(),
        ],
        status: status(demand),
    };
    Table {
        title: "What is asked".to_owned(),
        header: ["figure", "asked", "measured", "verdict"]
            .map(str::to_owned)
            .to_vec(),
        rows: results.demands.iter().map(row).collect(),
        caption: String::new(),
    }
}

/// Whether a demand is met, in words.
pub fn verdict(demand: &Demand) -> &'static str {
    if demand.met() { "met" } else { "not met" }
}

/// The table of a study: titles of its columns, and the cells of its rows. A column for which the
/// source has figures is followed by one with these.
pub fn table(results: &Results) -> (Vec<String>, Vec<Vec<String>>) {
    let has_theirs = |column: &Column| {
        let mut rows = results.rows.iter();
        rows.any(|row| row.their(&column.key).is_some())
    };
    let columns: Vec<(&Column, bool)> = results
        .columns
        .iter()
        .map(|column| (column, has_theirs(column)))
        .collect();
    let titles = columns.iter().flat_map(|(column, theirs)| {
        let own = column.title.clone();
        [Some(own), theirs.then(|| "theirs".to_owned())]
    });
    let cells = |row: &alula_runtime::study::Row| {
        let pairs = columns.iter().flat_map(|(column, theirs)| {
            let own = column.text(row.figure(&column.key));
            [
                Some(own),
                theirs.then(|| column.text(row.their(&column.key))),
            ]
        });
        pairs.flatten().collect()
    };
    (
        titles.flatten().collect(),
        results.rows.iter().map(cells).collect(),
    )
}

fn figure(chart: &Chart) -> PageFigure {
    match chart {
        Chart::Curves {
            title,
            x_label,
            y_label,
            curves,
            bands,
        } => {
            let band = |band: &alula_runtime::study::CurveBand| Band {
                name: band.name.clone(),
                points: band.points.clone(),
                colour: colour(band.tone),
            };
            half(&LineChart {
                title: title.clone(),
                x_label: x_label.clone(),
                y_label: y_label.clone(),
                series: curves.iter().map(series).collect(),
                bands: bands.iter().map(band).collect(),
                ..LineChart::default()
            })
        }
        Chart::Bars {
            title,
            x_label,
            bars,
            limit,
            decimals,
        } => {
            let bar = |bar: &alula_runtime::study::StudyBar| Bar {
                label: bar.label.clone(),
                value: bar.value,
                colour: colour(bar.tone),
            };
            half(&Bars {
                title: title.clone(),
                x_label: x_label.clone(),
                bars: bars.iter().map(bar).collect(),
                limit: limit.clone(),
                decimals: *decimals,
            })
        }
        Chart::Map {
            title,
            x_label,
            y_label,
            curves,
            outlines,
        } => full(&MapView {
            title: title.clone(),
            x_label: x_label.clone(),
            y_label: y_label.clone(),
            shapes: outlines.iter().map(shape).collect(),
            paths: curves.iter().map(series).collect(),
            ..MapView::default()
        }),
        Chart::Image {
            title,
            columns,
            shares,
            aspect,
            frames,
            scale,
        } => half(&Picture {
            title: title.clone(),
            columns: *columns,
            pixels: shares.iter().copied().map(pixel).collect(),
            aspect: *aspect,
            boxes: frames.iter().map(frame).collect(),
            scale: scale.clone(),
        }),
    }
}

fn half(panel: &impl Panel) -> PageFigure {
    PageFigure {
        svg: panel.to_svg(HALF_WIDTH),
        caption: String::new(),
        span: Span::Half,
    }
}

fn full(panel: &impl Panel) -> PageFigure {
    PageFigure {
        svg: panel.to_svg(FULL_WIDTH),
        caption: String::new(),
        span: Span::Full,
    }
}

fn series(curve: &Curve) -> Series {
    let style = match curve.style {
        CurveStyle::Solid => Style::Solid,
        CurveStyle::Dashed => Style::Dashed,
        CurveStyle::Points => Style::Points,
    };
    Series::new(&curve.name, colour(curve.tone), curve.points.clone()).styled(style)
}

fn colour(tone: Tone) -> Colour {
    match tone {
        Tone::Measured => Colour::Blue,
        Tone::Second => Colour::Purple,
        Tone::Third => Colour::Sky,
        Tone::Theirs => Colour::Orange,
        Tone::Truth => Colour::Ink,
        Tone::Limit => Colour::Grey,
        Tone::Good => Colour::Green,
        Tone::Bad => Colour::Vermillion,
    }
}

fn shape(outline: &Believed) -> MapShape {
    let fill = if outline.truth {
        Fill::Obstacle
    } else {
        Fill::BelievedStill
    };
    MapShape {
        label: outline.label.clone(),
        ..MapShape::new(Outline::Polygon(outline.corners.clone()), fill)
    }
}

fn pixel(share: f32) -> [u8; 3] {
    if share.is_nan() {
        BLANK
    } else {
        false_colour(f64::from(share))
    }
}

fn frame(frame: &Frame) -> PictureBox {
    let [left, top, right, bottom] = frame.edges;
    PictureBox {
        left,
        top,
        right,
        bottom,
        label: frame.label.clone(),
        colour: Colour::Vermillion,
    }
}

#[cfg(test)]
mod tests {
    use alula_runtime::study::Row;

    use super::*;

    fn results() -> Results {
        Results {
            runs: 3,
            columns: vec![
                Column::new("scene", "scene", 0),
                Column::new("error_m", "error (m)", 2),
            ],
            rows: vec![
                Row::new()
                    .with("scene", "hall")
                    .with("error_m", 0.126)
                    .theirs("error_m", 0.26),
                Row::new().with("scene", "yard"),
            ],
            demands: vec![Demand::at_most("error", "m", 0.13, 0.126)],
            charts: vec![Chart::Bars {
                title: "errors".to_owned(),
                x_label: "error (m)".to_owned(),
                bars: Vec::new(),
                limit: None,
                decimals: 2,
            }],
            notes: Vec::new(),
        }
    }

    #[test]
    fn figures_of_the_source_stand_beside_those_measured() {
        let (header, rows) = table(&results());
        assert_eq!(header, ["scene", "error (m)", "theirs"]);
        assert_eq!(rows, [["hall", "0.13", "0.26"], ["yard", "–", "–"]]);
    }

    #[test]
    fn a_demand_that_is_not_met_is_bad() {
        assert_eq!(fact(&results().demands[0]).status, Status::Good);
        let missed = Demand::at_most("error", "m", 0.1, 0.126);
        assert_eq!(fact(&missed).status, Status::Bad);
    }
}
