//! Lines, bands and events over a common axis.

use super::axes::{self, Axes, Axis};
use super::decimate::{self, Px};
use super::legend::{self, Entry, Header, Sample};
use super::paint::Paint;
use super::scale::Range;
use super::svg::{Anchor, Canvas, Pen, Rect, Type};
use super::{Colour, Panel, Series, Style, text};

/// Size of the labels of markers, in pixels, and the height of their lines.
const MARKER_SIZE: f64 = 9.5;
const MARKER_LINE: f64 = 12.0;

/// Labels of markers that find no room in this many lines are left to the pointer's note.
const MARKER_LINES: usize = 3;

/// An area between two lines, such as the bounds at three standard deviations.
#[derive(Debug, Clone)]
pub struct Band {
    /// Name in the legend; empty for none.
    pub name: String,
    /// `(x, low, high)` of each point; a value that is not finite leaves a gap.
    pub points: Vec<(f64, f64, f64)>,
    /// Colour of the area.
    pub colour: Colour,
}

/// A moment that a vertical line marks.
#[derive(Debug, Clone)]
pub struct Marker {
    /// Where it stands.
    pub x: f64,
    /// What happened, in a word; may be empty.
    pub label: String,
    /// Colour of the line.
    pub colour: Colour,
}

/// A chart of lines over a common horizontal axis.
#[derive(Debug, Clone, Default)]
pub struct LineChart {
    /// Title; empty for none.
    pub title: String,
    /// Quantity and unit of the horizontal axis, as in `time (s)`.
    pub x_label: String,
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// The lines, the first at the bottom.
    pub series: Vec<Series>,
    /// Areas below the lines.
    pub bands: Vec<Band>,
    /// Moments to mark.
    pub markers: Vec<Marker>,
    /// Range of the horizontal axis; that of the data if not given.
    pub x_range: Option<(f64, f64)>,
    /// Range of the vertical axis; that of the data with some room if not given. Data outside is
    /// cut off.
    pub y_range: Option<(f64, f64)>,
}

impl LineChart {
    fn x_data(&self) -> Range {
        let lines = self
            .series
            .iter()
            .flat_map(|series| series.points.iter().map(|p| p.0));
        let bands = self
            .bands
            .iter()
            .flat_map(|band| band.points.iter().map(|p| p.0));
        Range::of(lines.chain(bands))
    }

    /// Range of what stands within `x`, with some room.
    fn y_data(&self, x: Range) -> Range {
        let lines = self.series.iter().flat_map(|series| &series.points);
        let lines = lines.filter(|p| x.holds(p.0)).map(|p| p.1);
        let bands = self.bands.iter().flat_map(|band| &band.points);
        let bands = bands.filter(|p| x.holds(p.0)).flat_map(|p| [p.1, p.2]);
        Range::of(lines.chain(bands)).roomy()
    }

    fn legend(&self) -> Vec<Entry> {
        let lines = self.series.iter().map(Series::legend_entry);
        let bands = self.bands.iter().map(|band| Entry {
            name: band.name.clone(),
            sample: Sample::Band(band.colour.paint()),
        });
        lines.chain(bands).collect()
    }

    fn draw_bands(&self, canvas: &mut Canvas, axes: &Axes) {
        for band in &self.bands {
            let to_px = |[x, low, high]: [f64; 3]| [axes.px_x(x), axes.px_y(low), axes.px_y(high)];
            let points = band.points.iter().map(|(x, low, high)| [*x, *low, *high]);
            for run in decimate::runs(points, to_px) {
                draw_band(canvas, band.colour, &decimate::envelope(&run));
            }
        }
    }

    fn draw_markers(&self, canvas: &mut Canvas, axes: &Axes) {
        for marker in self.visible_markers(axes.x.range) {
            let x = axes.px_x(marker.x);
            let solid = Pen::solid(marker.colour.paint(), 1.0);
            let pen = Pen {
                dash: "4 3",
                opacity: 0.65,
                ..solid
            };
            let ends = [[x, axes.area.y], [x, axes.area.bottom()]];
            canvas.polygon(&ends, None, Some(pen), &marker.label);
        }
    }

    fn visible_markers(&self, range: Range) -> impl Iterator<Item = &Marker> {
        self.markers.iter().filter(move |m| range.holds(m.x))
    }
}

impl Panel for LineChart {
    fn label(&self) -> &str {
        &self.title
    }

    fn height_for(&self, width: f64) -> f64 {
        (0.42 * width).clamp(200.0, 340.0)
    }

    fn draw(&self, canvas: &mut Canvas, bounds: Rect) {
        let x_range = Range::chosen(self.x_range, || self.x_data());
        let y_range = Range::chosen(self.y_range, || self.y_data(x_range));
        let below = axes::room_below(&self.x_label);
        let y = Axis::vertical(&self.y_label, y_range, bounds.height - below - 30.0);
        let left = y.room_beside();
        let width = bounds.inset(left, 0.0, axes::RIGHT, 0.0).width;
        let x = Axis::horizontal(&self.x_label, x_range, width);

        let header = Header::new(&self.title, self.legend(), width);
        let labels = place_labels(self.visible_markers(x_range), |value| {
            bounds.x + left + (value - x_range.low) / x_range.span() * width
        });
        let lines = labels.iter().map(|label| label.line + 1).max().unwrap_or(0);
        let above = header.height + MARKER_LINE * lines as f64;
        let area = bounds.inset(left, above, axes::RIGHT, below);
        let axes = Axes { area, x, y };

        header.draw(canvas, area.x, bounds.y);
        draw_labels(canvas, &labels, area.y, bounds);
        axes::draw_paper(canvas, area);
        axes.draw_grid(canvas);
        canvas.clipped(area, |canvas| {
            self.draw_bands(canvas, &axes);
            self.draw_markers(canvas, &axes);
            self.series
                .iter()
                .for_each(|series| series.draw(canvas, &axes, decimate::by_column));
        });
        axes.draw_frame(canvas);
    }
}

impl Series {
    pub(super) fn legend_entry(&self) -> Entry {
        let sample = match self.style {
            Style::Points => Sample::Dots(self.colour.paint()),
            _ => Sample::Line(self.pen()),
        };
        Entry {
            name: self.name.clone(),
            sample,
        }
    }

    fn pen(&self) -> Pen {
        let (width, dash) = match self.style {
            Style::Solid | Style::Points => (1.6, ""),
            Style::Dashed => (1.4, "6 3"),
        };
        Pen {
            dash,
            ..Pen::solid(self.colour.paint(), width)
        }
    }

    /// Draws the series, reduced by `reduce` to what the screen can show.
    pub(super) fn draw(&self, canvas: &mut Canvas, axes: &Axes, reduce: fn(&[Px]) -> Vec<Px>) {
        let points = self.points.iter().map(|(x, y)| [*x, *y]);
        let runs = decimate::runs(points, |point| axes.at(point));
        let runs: Vec<Vec<Px>> = runs.iter().map(|run| reduce(run)).collect();
        let (dots, lines): (Vec<_>, Vec<_>) = runs
            .into_iter()
            .partition(|run| self.style == Style::Points || run.len() == 1);
        canvas.polylines(&lines, self.pen());
        canvas.dots(&dots.concat(), self.colour.paint(), 1.5);
    }
}

fn draw_band(canvas: &mut Canvas, colour: Colour, envelope: &[[f64; 3]]) {
    let low: Vec<Px> = envelope.iter().map(|[x, low, _]| [*x, *low]).collect();
    let high: Vec<Px> = envelope.iter().map(|[x, _, high]| [*x, *high]).collect();
    let outline: Vec<Px> = high.iter().chain(low.iter().rev()).copied().collect();
    canvas.polygon(&outline, Some(legend::band_brush(colour.paint())), None, "");
    let edge = Pen {
        opacity: 0.55,
        ..Pen::solid(colour.paint(), 0.8)
    };
    canvas.polylines(&[low, high], edge);
}

/// A label above the plot area: its middle and its line, the lowest being 0.
#[derive(Debug, PartialEq)]
struct Label<'a> {
    text: &'a str,
    x: f64,
    line: usize,
}

/// Puts the labels into lines in which they do not overlap.
fn place_labels<'a>(
    markers: impl Iterator<Item = &'a Marker>,
    to_px: impl Fn(f64) -> f64,
) -> Vec<Label<'a>> {
    let mut markers: Vec<&Marker> = markers.filter(|marker| !marker.label.is_empty()).collect();
    markers.sort_by(|a, b| a.x.total_cmp(&b.x));
    let mut ends = [f64::NEG_INFINITY; MARKER_LINES];
    let mut labels = Vec::new();
    for marker in markers {
        let x = to_px(marker.x);
        let half = 0.5 * text::width(&marker.label, MARKER_SIZE) + 2.0;
        if let Some(line) = ends.iter().position(|end| *end <= x - half) {
            ends[line] = x + half;
            labels.push(Label {
                text: &marker.label,
                x,
                line,
            });
        }
    }
    labels
}

fn draw_labels(canvas: &mut Canvas, labels: &[Label], bottom: f64, bounds: Rect) {
    let style = Type::plain(MARKER_SIZE, Paint::MUTED, Anchor::Middle);
    for label in labels {
        let y = bottom - 4.0 - MARKER_LINE * label.line as f64;
        let half = 0.5 * text::width(label.text, MARKER_SIZE);
        let x = label.x.min(bounds.right() - half).max(bounds.x + half);
        canvas.text([x, y], style, label.text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marker(x: f64, label: &str) -> Marker {
        Marker {
            x,
            label: label.to_string(),
            colour: Colour::Grey,
        }
    }

    #[test]
    fn labels_that_would_overlap_move_up_a_line() {
        let markers = [
            marker(30.0, "far"),
            marker(10.0, "take-off"),
            marker(12.0, "climb"),
        ];
        let labels = place_labels(markers.iter(), |x| 10.0 * x);
        let lines: Vec<_> = labels
            .iter()
            .map(|label| (label.text, label.line))
            .collect();
        assert_eq!(lines, [("take-off", 0), ("climb", 1), ("far", 0)]);
    }

    #[test]
    fn labels_without_room_are_left_out() {
        let markers = [(); 9].map(|()| marker(5.0, "event"));
        assert_eq!(place_labels(markers.iter(), |x| x).len(), MARKER_LINES);
    }

    #[test]
    fn only_what_is_shown_counts_for_the_range() {
        let points = vec![(0.0, 1.0), (1.0, 2.0), (2.0, 900.0)];
        let series = vec![Series::new("", Colour::Blue, points)];
        let chart = LineChart {
            series,
            ..LineChart::default()
        };
        let shown = Range {
            low: 0.0,
            high: 1.0,
        };
        assert!(chart.y_data(shown).high < 3.0);
    }

    #[test]
    fn bands_count_for_the_range() {
        let band = Band {
            name: String::new(),
            points: vec![(0.0, -4.0, 2.0), (1.0, f64::NAN, 9.0)],
            colour: Colour::Blue,
        };
        let chart = LineChart {
            bands: vec![band],
            ..LineChart::default()
        };
        let range = chart.y_data(chart.x_data());
        assert!(range.low <= -4.0 && range.high >= 9.0);
    }
}
