//! Title and legend of a panel. Both stand above the plot area, so they never cover data.

use super::paint::{FillLook, Paint};
use super::svg::{Anchor, Brush, Canvas, Pen, Rect, Type};
use super::text;

/// Size of titles, in pixels.
const TITLE_SIZE: f64 = 13.0;

/// Size of the names in the legend, in pixels.
const NAME_SIZE: f64 = 10.5;

/// Height of a line of the legend.
const LINE: f64 = 16.0;

/// Height of the line of the title.
const TITLE_LINE: f64 = 22.0;

/// Width of a sample, and the gaps after it and after its name.
const SAMPLE: f64 = 20.0;
const AFTER_SAMPLE: f64 = 5.0;
const AFTER_NAME: f64 = 14.0;

/// What a name in the legend looks like in the plot.
#[derive(Debug, Clone, Copy)]
pub(super) enum Sample {
    Line(Pen),
    Dots(Paint),
    Band(Paint),
    Shape(FillLook),
}

/// A name and its sample.
#[derive(Debug)]
pub(super) struct Entry {
    pub name: String,
    pub sample: Sample,
}

impl Entry {
    fn width(&self) -> f64 {
        SAMPLE + AFTER_SAMPLE + text::width(&self.name, NAME_SIZE)
    }
}

/// Title and legend, laid out for a width.
#[derive(Debug)]
pub(super) struct Header<'a> {
    title: &'a str,
    entries: Vec<Entry>,
    /// Offset of each entry from the left end of the header, and its line below the title.
    places: Vec<(f64, f64)>,
    /// Height of all.
    pub height: f64,
}

impl<'a> Header<'a> {
    /// Puts the legend beside the title if both fit into `width`, otherwise below it. Entries
    /// without a name are left out, as is a second entry of a name.
    pub fn new(title: &'a str, entries: Vec<Entry>, width: f64) -> Self {
        let mut named: Vec<Entry> = Vec::new();
        for entry in entries {
            if !entry.name.is_empty() && named.iter().all(|other| other.name != entry.name) {
                named.push(entry);
            }
        }
        let title_width = text::bold_width(title, TITLE_SIZE);
        let title_height = if title.is_empty() { 6.0 } else { TITLE_LINE };
        let legend_width = total_width(&named);
        if title_width + 2.0 * AFTER_NAME + legend_width <= width && !title.is_empty() {
            let places = flow(&named, width - legend_width, 0.0, f64::INFINITY);
            return Header {
                title,
                entries: named,
                places,
                height: title_height,
            };
        }
        let places = flow(&named, 0.0, title_height, width);
        let bottom = places.last().map_or(title_height, |(_, y)| y + LINE + 2.0);
        Header {
            title,
            entries: named,
            places,
            height: bottom,
        }
    }

    pub fn draw(&self, canvas: &mut Canvas, left: f64, top: f64) {
        let style = Type {
            bold: true,
            ..Type::plain(TITLE_SIZE, Paint::INK, Anchor::Start)
        };
        canvas.text([left, top + 14.0], style, self.title);
        let style = Type::plain(NAME_SIZE, Paint::INK, Anchor::Start);
        for (entry, (x, y)) in self.entries.iter().zip(&self.places) {
            let base = if *y == 0.0 {
                top + 14.0
            } else {
                top + y + 10.0
            };
            draw_sample(canvas, entry.sample, left + x, base - 3.8);
            canvas.text([left + x + SAMPLE + AFTER_SAMPLE, base], style, &entry.name);
        }
    }
}

fn total_width(entries: &[Entry]) -> f64 {
    let gaps = AFTER_NAME * entries.len().saturating_sub(1) as f64;
    entries.iter().map(Entry::width).sum::<f64>() + gaps
}

/// Places of the entries from left to right, in lines no longer than `width`.
fn flow(entries: &[Entry], left: f64, top: f64, width: f64) -> Vec<(f64, f64)> {
    let (mut x, mut y) = (left, top);
    let mut places = Vec::new();
    for entry in entries {
        if x > left && x + entry.width() > width {
            (x, y) = (left, y + LINE);
        }
        places.push((x, y));
        x += entry.width() + AFTER_NAME;
    }
    places
}

fn draw_sample(canvas: &mut Canvas, sample: Sample, x: f64, y: f64) {
    let patch = Rect {
        x,
        y: y - 5.0,
        width: SAMPLE,
        height: 10.0,
    };
    match sample {
        Sample::Line(pen) => canvas.line([x, y], [x + SAMPLE, y], pen),
        Sample::Dots(paint) => {
            canvas.dots(
                &[0.15, 0.5, 0.85].map(|along| [x + along * SAMPLE, y]),
                paint,
                1.8,
            );
        }
        Sample::Band(paint) => canvas.rect(patch, 1.0, Some(band_brush(paint)), None),
        Sample::Shape(look) => canvas.rect(patch, 1.0, shape_brush(&look), Some(shape_pen(&look))),
    }
}

/// Fill of a band: light enough for lines and grid to show through.
pub(super) fn band_brush(paint: Paint) -> Brush {
    Brush {
        paint,
        opacity: 0.2,
    }
}

/// Fill of a shape on a map; none for shapes that are outlines only.
pub(super) fn shape_brush(look: &FillLook) -> Option<Brush> {
    (look.opacity > 0.0).then_some(Brush {
        paint: look.area,
        opacity: look.opacity,
    })
}

/// Outline of a shape on a map.
pub(super) fn shape_pen(look: &FillLook) -> Pen {
    Pen {
        dash: look.dash,
        ..Pen::solid(look.edge, 1.2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::Colour;

    fn entries(names: &[&str]) -> Vec<Entry> {
        let sample = Sample::Band(Colour::Blue.paint());
        names
            .iter()
            .map(|name| Entry {
                name: name.to_string(),
                sample,
            })
            .collect()
    }

    #[test]
    fn a_short_legend_stands_beside_the_title() {
        let header = Header::new("Title", entries(&["a", "b"]), 300.0);
        assert_eq!(header.height, TITLE_LINE);
        let end = header.places[1].0 + header.entries[1].width();
        assert!((end - 300.0).abs() < 1e-9, "flush right: {end}");
    }

    #[test]
    fn a_long_legend_wraps_within_the_width() {
        let names = [
            "truth of the flight",
            "estimate of the filter",
            "reference of the planner",
        ];
        let header = Header::new("Title", entries(&names), 200.0);
        assert_eq!(header.height, TITLE_LINE + 3.0 * LINE + 2.0);
        assert!(header.places.iter().all(|(x, _)| *x == 0.0));
    }

    #[test]
    fn a_name_stands_once_and_no_name_stands_not_at_all() {
        assert_eq!(
            Header::new("", entries(&["a", "", "a"]), 300.0)
                .entries
                .len(),
            1
        );
    }
}
