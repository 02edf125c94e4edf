//! What happened in a flight, as figures and as a page.

use std::path::Path;

use alula_geometry::Timestamp;
use alula_runtime::flight_log::{EventKind, FlightLog, Sample};
use alula_sim::world::World;
use nalgebra::Vector3;

use crate::belief::BeliefFigures;
use crate::outlines::{View, shapes};
use crate::page::{Fact, Page, PageFigure, Span, Table};
use crate::plot::{
    Band, Cell, Colour, Figure, Glyph, LineChart, MapPoint, MapView, Marker, Panel, PlotError,
    Series, Style, render_png,
};

/// Width of a figure that spans the page, pixels.
const FULL_WIDTH: f64 = 1000.0;

/// Width of a figure that takes half the page, pixels.
const HALF_WIDTH: f64 = 560.0;

/// All that is drawn of a flight.
pub struct FlightFigures {
    title: String,
    subtitle: String,
    top: MapView,
    side: MapView,
    speed: LineChart,
    clearance: Option<LineChart>,
    height: LineChart,
    position_errors: [LineChart; 3],
    velocity_errors: [LineChart; 3],
    attitude_errors: [LineChart; 3],
    belief: Option<BeliefFigures>,
}

impl FlightFigures {
    /// Figures of a flight in a world.
    pub fn new(
        title: &str,
        subtitle: &str,
        log: &FlightLog,
        world: &World,
        waypoints: &[[f64; 3]],
    ) -> Self {
        let markers = markers(log);
        Self {
            title: title.to_owned(),
            subtitle: subtitle.to_owned(),
            top: map(View::Top, log, world, waypoints),
            side: map(View::Side, log, world, waypoints),
            speed: speed_chart(log, &markers),
            clearance: clearance_chart(log, &markers),
            height: height_chart(log, &markers),
            position_errors: axes(|i| {
                let name = ["east", "north", "up"][i];
                let title = format!("position error, {name}");
                bounded(&title, "m", log, 1.0, |s| {
                    (s.position[i] - s.true_position[i], s.position_sigma[i])
                })
            }),
            velocity_errors: axes(|i| {
                let name = ["east", "north", "up"][i];
                let title = format!("velocity error, {name}");
                bounded(&title, "m/s", log, 1.0, |s| {
                    (s.velocity[i] - s.true_velocity[i], s.velocity_sigma[i])
                })
            }),
            attitude_errors: axes(|i| {
                let title = format!("{} error", ["roll", "pitch", "yaw"][i]);
                let degrees = 1f64.to_degrees();
                bounded(&title, "deg", log, degrees, |s| {
                    (-s.attitude_error[i], s.attitude_sigma[i])
                })
            }),
            belief: None,
        }
    }

    /// The same with figures of what was believed.
    pub fn with_belief(self, belief: Option<BeliefFigures>) -> Self {
        Self { belief, ..self }
    }

    /// The overview as one drawing.
    pub fn overview_svg(&self) -> String {
        let cell = |column, row, columns, rows| Cell {
            column,
            row,
            columns,
            rows,
        };
        let top = self.belief.as_ref().map_or(&self.top, |b| &b.overview);
        let mut panels: Vec<(Cell, &dyn Panel)> = vec![
            (cell(0, 0, 2, 2), top),
            (cell(0, 2, 2, 1), &self.side),
            (cell(2, 0, 1, 1), &self.speed),
            (cell(2, 1, 1, 1), &self.height),
        ];
        for (i, chart) in self.position_errors.iter().enumerate() {
            panels.push((cell(i, 3, 1, 1), chart));
        }
        let fourth: &dyn Panel = match &self.clearance {
            Some(chart) => chart,
            None => &self.velocity_errors[0],
        };
        panels.push((cell(2, 2, 1, 1), fourth));
        Figure {
            title: self.title.clone(),
            subtitle: self.subtitle.clone(),
            aspect: 0.86,
            columns: vec![1.0, 1.0, 1.0],
            rows: vec![1.0, 1.0, 1.0, 1.0],
            panels,
        }
        .to_svg(1400.0)
    }

    /// The overview as a PNG image.
    ///
    /// # Errors
    /// When the drawing cannot be rasterised.
    pub fn overview_png(&self) -> Result<Vec<u8>, PlotError> {
        render_png(&self.overview_svg(), 1400)
    }

    /// The page with all figures.
    pub fn page(&self, summary: Vec<Fact>, tables: Vec<Table>, notes: Vec<String>) -> Page {
        let mut tables = tables;
        tables.extend(self.belief.iter().flat_map(BeliefFigures::tables));
        let full = |panel: &dyn Panel, caption: &str| figure(panel, Span::Full, caption);
        let half = |panel: &dyn Panel| figure(panel, Span::Half, "");
        let mut figures = vec![
            full(
                &self.top,
                "Seen from above. Things stand where they are at the end.",
            ),
            full(&self.side, "Seen from the south."),
        ];
        figures.extend(self.belief.iter().flat_map(BeliefFigures::figures));
        figures.extend([half(&self.speed), half(&self.height)]);
        figures.extend(self.clearance.as_ref().map(|chart| half(chart)));
        for charts in [
            &self.position_errors,
            &self.velocity_errors,
            &self.attitude_errors,
        ] {
            figures.extend(charts.iter().map(|chart| half(chart)));
        }
        Page {
            title: self.title.clone(),
            subtitle: self.subtitle.clone(),
            summary,
            figures,
            tables,
            notes,
            footer: format!("alula {}", alula_runtime::VERSION),
        }
    }
}

fn figure(panel: &dyn Panel, span: Span, caption: &str) -> PageFigure {
    let width = match span {
        Span::Full => FULL_WIDTH,
        Span::Half => HALF_WIDTH,
    };
    PageFigure {
        svg: panel.to_svg(width),
        caption: caption.to_owned(),
        span,
    }
}

fn axes(chart: impl Fn(usize) -> LineChart) -> [LineChart; 3] {
    std::array::from_fn(chart)
}

fn series(log: &FlightLog, value: impl Fn(&Sample) -> f64) -> Vec<(f64, f64)> {
    log.samples.iter().map(|s| (s.t_s, value(s))).collect()
}

fn time_chart(title: &str, y_label: &str) -> LineChart {
    LineChart {
        title: title.to_owned(),
        x_label: "time (s)".to_owned(),
        y_label: y_label.to_owned(),
        ..LineChart::default()
    }
}

/// An error with its bounds at three standard deviations.
fn bounded(
    title: &str,
    unit: &str,
    log: &FlightLog,
    factor: f64,
    error_and_sigma: impl Fn(&Sample) -> (f64, f64),
) -> LineChart {
    let rows: Vec<_> = log
        .samples
        .iter()
        .map(|s| (s.t_s, error_and_sigma(s)))
        .collect();
    let error = rows.iter().map(|(t, (e, _))| (*t, e * factor)).collect();
    let band = rows
        .iter()
        .map(|(t, (_, s))| (*t, -3.0 * s * factor, 3.0 * s * factor))
        .collect();
    LineChart {
        series: vec![Series::new("error", Colour::Blue, error)],
        bands: vec![Band {
            name: "3 sigma".to_owned(),
            points: band,
            colour: Colour::Sky,
        }],
        ..time_chart(title, &format!("{title} ({unit})"))
    }
}

fn speed_chart(log: &FlightLog, markers: &[Marker]) -> LineChart {
    LineChart {
        series: vec![
            Series::new("true", Colour::Ink, series(log, |s| s.true_velocity.norm())),
            Series::new(
                "estimated",
                Colour::Blue,
                series(log, |s| s.velocity.norm()),
            )
            .styled(Style::Dashed),
        ],
        markers: markers.to_vec(),
        ..time_chart("speed", "speed (m/s)")
    }
}

fn height_chart(log: &FlightLog, markers: &[Marker]) -> LineChart {
    let reference = |s: &Sample| s.reference.map_or(f64::NAN, |r| r.z);
    LineChart {
        series: vec![
            Series::new("reference", Colour::Grey, series(log, reference)),
            Series::new("true", Colour::Ink, series(log, |s| s.true_position.z)),
            Series::new("estimated", Colour::Blue, series(log, |s| s.position.z))
                .styled(Style::Dashed),
        ],
        markers: markers.to_vec(),
        ..time_chart("height", "z (m)")
    }
}

fn clearance_chart(log: &FlightLog, markers: &[Marker]) -> Option<LineChart> {
    log.samples
        .iter()
        .any(|s| s.clearance_m.is_some())
        .then(|| LineChart {
            series: vec![Series::new(
                "",
                Colour::Vermillion,
                series(log, |s| s.clearance_m.unwrap_or(f64::NAN)),
            )],
            markers: markers.to_vec(),
            ..time_chart("clearance to the nearest thing", "clearance (m)")
        })
}

fn markers(log: &FlightLog) -> Vec<Marker> {
    log.events
        .iter()
        .filter(|event| !matches!(event.kind, EventKind::Refused(_)))
        .map(|event| Marker {
            x: event.t_s,
            label: event.describe(),
            colour: match event.kind {
                EventKind::Guard(..) => Colour::Vermillion,
                _ => Colour::Grey,
            },
        })
        .collect()
}

fn map(view: View, log: &FlightLog, world: &World, waypoints: &[[f64; 3]]) -> MapView {
    let end = log.samples.last().map_or(0.0, |s| s.t_s);
    let (title, y_label) = match view {
        View::Top => ("from above", "y north (m)"),
        View::Side => ("from the south", "z up (m)"),
    };
    MapView {
        title: title.to_owned(),
        x_label: "x east (m)".to_owned(),
        y_label: y_label.to_owned(),
        shapes: shapes(view, world, Timestamp::from_s(end)),
        paths: paths(view, log),
        points: points(view, log, waypoints),
        ..MapView::default()
    }
}

fn paths(view: View, log: &FlightLog) -> Vec<Series> {
    let path = |place: &dyn Fn(&Sample) -> Option<Vector3<f64>>| {
        log.samples
            .iter()
            .map(|s| place(s).map_or((f64::NAN, f64::NAN), |p| view.of(&p)))
            .collect::<Vec<_>>()
    };
    vec![
        Series::new("reference", Colour::Grey, path(&|s| s.reference)),
        Series::new("true path", Colour::Ink, path(&|s| Some(s.true_position))),
        Series::new("estimated path", Colour::Blue, path(&|s| Some(s.position)))
            .styled(Style::Dashed),
    ]
}

fn points(view: View, log: &FlightLog, waypoints: &[[f64; 3]]) -> Vec<MapPoint> {
    let numbered = waypoints.iter().enumerate().map(|(i, p)| MapPoint {
        at: view.of(&Vector3::from(*p)),
        label: (i + 1).to_string(),
        glyph: Glyph::Waypoint,
    });
    let ends = [
        (log.samples.first(), "start", Glyph::Start),
        (log.samples.last(), "end", Glyph::End),
    ];
    let ends = ends.into_iter().filter_map(|(sample, label, glyph)| {
        let at = view.of(&sample?.true_position);
        Some(MapPoint {
            at,
            label: label.to_owned(),
            glyph,
        })
    });
    let acts = log.events.iter().filter_map(|event| {
        let EventKind::Guard(..) = event.kind else {
            return None;
        };
        let sample = log.samples.iter().find(|s| s.t_s >= event.t_s)?;
        let at = view.of(&sample.true_position);
        Some(MapPoint {
            at,
            label: event.describe(),
            glyph: Glyph::Cross,
        })
    });
    numbered.chain(ends).chain(acts).collect()
}

/// Writes the page and the picture of a flight to a folder.
///
/// # Errors
/// When a file cannot be written; drawing itself fails only on a broken font.
pub fn write(
    folder: &Path,
    page: &Page,
    figures: &FlightFigures,
) -> Result<(), alula_runtime::RunError> {
    let html = folder.join("report.html");
    alula_runtime::write_file(&html, page.to_html().as_bytes())?;
    let png = folder.join("report.png");
    match figures.overview_png() {
        Ok(bytes) => alula_runtime::write_file(&png, &bytes),
        Err(error) => Err(alula_runtime::RunError::Input {
            what: png.display().to_string(),
            finding: format!("the picture could not be drawn: {error}"),
            remedy: "The page report.html holds the same figures".to_owned(),
        }),
    }
}
