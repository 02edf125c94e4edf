//! Figures as SVG: line charts, maps, bars, and grids of them; and their picture as PNG.
//!
//! Data goes in, text comes out: nothing here knows of flights, reads files or depends on what is
//! installed. The same data gives the same bytes. A value that is not finite is a gap, and an empty
//! figure shows empty axes.

mod axes;
mod bars;
mod decimate;
mod figure;
mod labels;
mod legend;
mod line_chart;
mod map_view;
mod paint;
mod picture;
mod raster;
mod scale;
mod shape;
mod svg;
mod text;

pub use bars::{Bar, Bars};
pub use figure::{Cell, Figure};
pub use line_chart::{Band, LineChart, Marker};
pub use map_view::{Glyph, MapPoint, MapView};
pub use paint::{Colour, Fill, dark_rules};
pub use picture::{BLANK, Picture, PictureBox, false_colour};
pub use raster::{PlotError, render_png};
pub use shape::{MapShape, Outline};
pub use svg::escape;

use svg::{Canvas, Rect};

/// How the points of a series are joined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// A line.
    Solid,
    /// A dashed line.
    Dashed,
    /// Not at all: dots.
    Points,
}

/// Points that belong together.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend; empty for none.
    pub name: String,
    /// `(x, y)` of the points; a value that is not finite leaves a gap.
    pub points: Vec<(f64, f64)>,
    /// How they are joined.
    pub style: Style,
    /// Colour of the line.
    pub colour: Colour,
}

impl Series {
    /// A solid line.
    pub fn new(name: &str, colour: Colour, points: Vec<(f64, f64)>) -> Self {
        Series {
            name: name.to_string(),
            points,
            style: Style::Solid,
            colour,
        }
    }

    /// The same in another style.
    pub fn styled(self, style: Style) -> Self {
        Series { style, ..self }
    }
}

/// Something that draws itself into a rectangle of a figure.
pub trait Panel {
    /// What the figure shows, in a few words, for readers who do not see it.
    fn label(&self) -> &str;

    /// A pleasing height for a width, both in pixels.
    fn height_for(&self, width: f64) -> f64;

    /// Adds the panel to `canvas` within `bounds`.
    fn draw(&self, canvas: &mut Canvas, bounds: Rect);

    /// The panel as an SVG document of its own, `width` pixels wide.
    fn to_svg(&self, width: f64) -> String {
        let height = self.height_for(width).round();
        let mut canvas = Canvas::default();
        self.draw(
            &mut canvas,
            Rect {
                x: 0.0,
                y: 0.0,
                width,
                height,
            },
        );
        canvas.into_document(width, height, self.label())
    }
}

#[cfg(test)]
mod tests;
