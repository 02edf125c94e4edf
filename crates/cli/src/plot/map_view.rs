//! Shapes, paths and points in a plane, equally scaled on both axes.

use super::axes::{self, Axes, Axis};
use super::decimate::{self, Px};
use super::labels::Places;
use super::legend::{self, Entry, Header, Sample};
use super::paint::Paint;
use super::scale::{Range, Ticks, drawable, round_step};
use super::shape::MapShape;
use super::svg::{Anchor, Brush, Canvas, Pen, Rect, Type};
use super::{Colour, Fill, Panel, Series};

/// Radius of the disc of a waypoint, and half the size of the other glyphs.
const DISC: f64 = 7.0;
const GLYPH: f64 = 5.0;

/// Wanted distance of grid lines, in pixels.
const GRID_PX: f64 = 52.0;

/// Tallest and flattest map, as multiples of the width.
const TALLEST: f64 = 1.1;
const FLATTEST: f64 = 0.12;

/// The sign at a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Glyph {
    /// A disc, with the label inside if it is short.
    Waypoint,
    /// A triangle.
    Start,
    /// A square.
    End,
    /// A small dot, such as a mark of time on a path.
    Dot,
    /// A cross: something went wrong, or was prevented.
    Cross,
}

/// A point to mark on a map.
#[derive(Debug, Clone)]
pub struct MapPoint {
    /// Where it is, in the units of the map.
    pub at: (f64, f64),
    /// What it is; may be empty.
    pub label: String,
    /// Its sign.
    pub glyph: Glyph,
}

/// A map: a view from above, or from the side.
#[derive(Debug, Clone, Default)]
pub struct MapView {
    /// Title; empty for none.
    pub title: String,
    /// Name and unit of the horizontal axis, as in `x (m)`.
    pub x_label: String,
    /// Name and unit of the vertical axis.
    pub y_label: String,
    /// Shapes, drawn in the order of their fills.
    pub shapes: Vec<MapShape>,
    /// Paths, the first at the bottom.
    pub paths: Vec<Series>,
    /// Points, above all.
    pub points: Vec<MapPoint>,
    /// Range that the horizontal axis shows at least; that of the content if not given.
    pub x_range: Option<(f64, f64)>,
    /// Range that the vertical axis shows at least; that of the content if not given.
    pub y_range: Option<(f64, f64)>,
}

impl MapView {
    /// Ranges of all but the ground, with some room.
    fn ranges(&self) -> [Range; 2] {
        let standing = || {
            self.shapes
                .iter()
                .filter(|shape| shape.fill != Fill::Ground)
        };
        let shapes: Vec<_> = standing()
            .flat_map(|shape| shape.outline.corners())
            .collect();
        let paths = self.paths.iter().flat_map(|path| &path.points);
        let points = self.points.iter().map(|point| &point.at);
        let places = paths
            .chain(points)
            .filter(|(x, y)| drawable(*x) && drawable(*y));
        let all: Vec<_> = places.map(|(x, y)| [*x, *y]).chain(shapes).collect();
        let of = |axis: usize| Range::of(all.iter().map(|place| place[axis]));
        // A straight flight has no extent across; it still wants some room beside it.
        let least = 0.1 * of(0).span().max(of(1).span());
        let roomy = |range: Range| range.with_span(range.span().max(least)).padded(0.06);
        [
            Range::chosen(self.x_range, || roomy(of(0))),
            Range::chosen(self.y_range, || roomy(of(1))),
        ]
    }

    fn legend(&self) -> Vec<Entry> {
        let paths = self.paths.iter().map(Series::legend_entry);
        let used = Fill::ALL
            .into_iter()
            .filter(|fill| self.shapes.iter().any(|shape| shape.fill == *fill))
            .map(|fill| Entry {
                name: fill.look().name.to_string(),
                sample: Sample::Shape(fill.look()),
            });
        paths.chain(used).collect()
    }

    /// Room left of the plot area, and the header for the remaining width.
    fn layout(&self, width: f64) -> (f64, Header<'_>) {
        let [x_range, y_range] = self.ranges();
        let steps = Ticks::with_step(y_range, shared_step(x_range.span() / width.max(1.0)));
        let left = Axis::new(&self.y_label, y_range, steps).room_beside();
        let header = Header::new(
            &self.title,
            self.legend(),
            (width - left - axes::RIGHT).max(1.0),
        );
        (left, header)
    }

    /// Where the paths are, in pixels.
    fn trail(&self, axes: &Axes) -> Vec<Vec<Px>> {
        let runs = self.paths.iter().flat_map(|path| {
            let points = path.points.iter().map(|(x, y)| [*x, *y]);
            decimate::runs(points, |point| axes.at(point))
        });
        runs.map(|run| decimate::by_shape(&run)).collect()
    }

    fn draw_shapes(&self, canvas: &mut Canvas, axes: &Axes) {
        for fill in Fill::ALL {
            for shape in self.shapes.iter().filter(|shape| shape.fill == fill) {
                let corners = shape.outline.corners();
                let corners: Vec<Px> = corners.into_iter().map(|c| axes.at(c)).collect();
                let look = fill.look();
                let (brush, pen) = (legend::shape_brush(&look), legend::shape_pen(&look));
                canvas.polygon(&corners, brush, Some(pen), &shape.label);
            }
        }
    }

    fn draw_points(&self, canvas: &mut Canvas, axes: &Axes, places: &mut Places) {
        let visible = self
            .points
            .iter()
            .filter(|p| drawable(p.at.0) && drawable(p.at.1));
        let visible: Vec<(&MapPoint, Px)> = visible
            .map(|point| (point, axes.at([point.at.0, point.at.1])))
            .collect();
        for (point, at) in &visible {
            draw_glyph(canvas, point, *at);
            places.take(Rect {
                x: at[0] - DISC,
                y: at[1] - DISC,
                width: 2.0 * DISC,
                height: 2.0 * DISC,
            });
        }
        for (point, at) in visible
            .into_iter()
            .filter(|(point, _)| !label_fits_inside(point))
        {
            places.label_beside(canvas, at, [DISC; 2], &point.label);
        }
    }

    fn label_shapes(&self, canvas: &mut Canvas, axes: &Axes, places: &mut Places) {
        for shape in self.shapes.iter().filter(|shape| !shape.label.is_empty()) {
            let corners = shape.outline.corners();
            if !corners.is_empty() {
                let of = |axis: usize| Range::of(corners.iter().map(|c| axes.at(*c)[axis]));
                places.label_shape(canvas, of(0), of(1), &shape.label);
            }
        }
    }
}

impl Panel for MapView {
    fn label(&self) -> &str {
        &self.title
    }

    fn height_for(&self, width: f64) -> f64 {
        let [x, y] = self.ranges();
        let (left, header) = self.layout(width);
        let inner = (width - left - axes::RIGHT).max(1.0);
        let height = inner * (y.span() / x.span()).clamp(FLATTEST, TALLEST);
        height + header.height + axes::room_below(&self.x_label)
    }

    fn draw(&self, canvas: &mut Canvas, bounds: Rect) {
        let (left, header) = self.layout(bounds.width);
        let area = bounds.inset(
            left,
            header.height,
            axes::RIGHT,
            axes::room_below(&self.x_label),
        );
        let axes = equal_axes(self, area);

        header.draw(canvas, area.x, bounds.y);
        axes::draw_paper(canvas, area);
        axes.draw_grid(canvas);
        canvas.clipped(area, |canvas| {
            let mut places = Places::new(area, &self.trail(&axes));
            self.draw_shapes(canvas, &axes);
            self.paths
                .iter()
                .for_each(|path| path.draw(canvas, &axes, decimate::by_shape));
            self.draw_points(canvas, &axes, &mut places);
            self.label_shapes(canvas, &axes, &mut places);
        });
        axes.draw_frame(canvas);
    }
}

/// Axes on which a unit is equally long, by showing more of the one that has room.
fn equal_axes(map: &MapView, area: Rect) -> Axes {
    let [x, y] = map.ranges();
    let unit_per_px = (x.span() / area.width).max(y.span() / area.height);
    let step = shared_step(unit_per_px);
    let (x, y) = (
        x.with_span(unit_per_px * area.width),
        y.with_span(unit_per_px * area.height),
    );
    Axes {
        area,
        x: Axis::new(&map.x_label, x, Ticks::with_step(x, step)),
        y: Axis::new(&map.y_label, y, Ticks::with_step(y, step)),
    }
}

/// Step of the grid for both axes.
fn shared_step(unit_per_px: f64) -> f64 {
    round_step(GRID_PX * unit_per_px)
}

fn label_fits_inside(point: &MapPoint) -> bool {
    point.glyph == Glyph::Waypoint && point.label.chars().count() <= 2
}

fn draw_glyph(canvas: &mut Canvas, point: &MapPoint, [x, y]: Px) {
    let rim = Pen::solid(Paint::PAPER, 1.2);
    let filled = |colour: Colour| Some(Brush::solid(colour.paint()));
    match point.glyph {
        Glyph::Waypoint => {
            let pen = Pen::solid(Paint::INK, 1.2);
            let inside = label_fits_inside(point);
            let radius = if inside { DISC } else { 0.6 * DISC };
            canvas.circle(
                [x, y],
                radius,
                Some(Brush::solid(Paint::PAPER)),
                Some(pen),
                &point.label,
            );
            if inside {
                let style = Type {
                    bold: true,
                    ..Type::plain(8.5, Paint::INK, Anchor::Middle)
                };
                canvas.text([x, y + 3.1], style, &point.label);
            }
        }
        Glyph::Start => {
            let (r, h) = (1.1 * GLYPH, 1.3 * GLYPH);
            let corners = [[x, y - h], [x + r, y + 0.7 * h], [x - r, y + 0.7 * h]];
            canvas.polygon(&corners, filled(Colour::Green), Some(rim), &point.label);
        }
        Glyph::End => {
            let r = GLYPH;
            let corners = [
                [x - r, y - r],
                [x + r, y - r],
                [x + r, y + r],
                [x - r, y + r],
            ];
            canvas.polygon(&corners, filled(Colour::Ink), Some(rim), &point.label);
        }
        Glyph::Dot => {
            let (brush, pen) = (Brush::solid(Paint::PAPER), Pen::solid(Paint::MUTED, 1.0));
            canvas.circle([x, y], 0.4 * GLYPH, Some(brush), Some(pen), &point.label);
        }
        Glyph::Cross => {
            let r = GLYPH;
            for pen in [
                Pen::solid(Paint::PAPER, 4.5),
                Pen::solid(Colour::Vermillion.paint(), 2.2),
            ] {
                canvas.line([x - r, y - r], [x + r, y + r], pen);
                canvas.line([x - r, y + r], [x + r, y - r], pen);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::Outline;

    fn flight() -> MapView {
        let points = vec![(0.0, 0.0), (20.0, 5.0)];
        MapView {
            paths: vec![Series::new("", Colour::Blue, points)],
            ..MapView::default()
        }
    }

    #[test]
    fn a_metre_is_equally_long_on_both_axes() {
        let area = Rect {
            x: 0.0,
            y: 0.0,
            width: 300.0,
            height: 200.0,
        };
        let axes = equal_axes(&flight(), area);
        let ([x0, y0], [x1, y1]) = (axes.at([0.0, 0.0]), axes.at([1.0, 1.0]));
        assert!((x1 - x0 - (y0 - y1)).abs() < 1e-9);
    }

    #[test]
    fn the_ground_does_not_widen_the_map() {
        let floor = Outline::Rect {
            centre: (0.0, 0.0),
            size: (900.0, 900.0),
            angle_rad: 0.0,
        };
        let map = MapView {
            shapes: vec![MapShape::new(floor, Fill::Ground)],
            ..flight()
        };
        assert_eq!(map.ranges(), flight().ranges());
    }

    #[test]
    fn a_straight_flight_has_room_beside_it() {
        let points = vec![(0.0, 1.0), (50.0, 1.0)];
        let map = MapView {
            paths: vec![Series::new("", Colour::Blue, points)],
            ..flight()
        };
        assert!(map.ranges()[1].span() > 5.0);
    }
}
