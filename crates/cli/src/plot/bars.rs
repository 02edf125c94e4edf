//! Horizontal bars: one amount for each of a few names.

use super::axes::{self, Axes, Axis};
use super::decimate::Px;
use super::legend::{Entry, Header, Sample};
use super::paint::Paint;
use super::scale::{Range, drawable, number};
use super::svg::{Anchor, Brush, Canvas, Pen, Rect, Type};
use super::{Colour, Panel, text};

/// Size of names and values, in pixels.
const SIZE: f64 = 10.5;

/// Height of a bar with its gap.
const PITCH: f64 = 19.0;

/// One bar.
#[derive(Debug, Clone)]
pub struct Bar {
    /// Name, to the left.
    pub label: String,
    /// Length; a value that is not finite draws no bar.
    pub value: f64,
    /// Colour of the bar.
    pub colour: Colour,
}

/// Bars over a common axis.
#[derive(Debug, Clone, Default)]
pub struct Bars {
    /// Title; empty for none.
    pub title: String,
    /// Quantity and unit of the axis.
    pub x_label: String,
    /// The bars, from top to bottom.
    pub bars: Vec<Bar>,
    /// Name and value of a limit to mark.
    pub limit: Option<(String, f64)>,
    /// Decimals of the values at the ends of the bars.
    pub decimals: usize,
}

impl Bars {
    /// Range of the values, of the limit and of zero, with room for the values in text.
    fn range(&self) -> Range {
        let values = self.bars.iter().map(|bar| bar.value);
        let limit = self.limit.iter().map(|(_, value)| *value);
        let range = Range::of(values.chain(limit).chain([0.0]));
        let room = 0.14 * range.span();
        let low = if range.low < 0.0 {
            range.low - room
        } else {
            0.0
        };
        Range {
            low,
            high: range.high + room,
        }
    }

    fn legend(&self) -> Vec<Entry> {
        let limits = self.limit.iter();
        limits
            .map(|(name, _)| Entry {
                name: name.clone(),
                sample: Sample::Line(limit_pen()),
            })
            .collect()
    }

    fn draw_bar(&self, canvas: &mut Canvas, axes: &Axes, bar: &Bar, middle: f64, pitch: f64) {
        if drawable(bar.value) {
            let (zero, end) = (axes.px_x(0.0), axes.px_x(bar.value));
            let height = 0.68 * pitch;
            let y = middle - 0.5 * height;
            let rect = Rect {
                x: zero.min(end),
                y,
                width: (end - zero).abs(),
                height,
            };
            canvas.rect(
                rect,
                1.0,
                Some(Brush {
                    paint: bar.colour.paint(),
                    opacity: 0.9,
                }),
                None,
            );
        }
    }

    fn draw_text(&self, canvas: &mut Canvas, axes: &Axes, bar: &Bar, middle: f64) {
        let base = middle + 0.36 * SIZE;
        let name = Type::plain(SIZE, Paint::INK, Anchor::End);
        canvas.text([axes.area.x - 7.0, base], name, &bar.label);
        let (value, text) = if drawable(bar.value) {
            (bar.value, number(bar.value, self.decimals))
        } else {
            (0.0, "–".to_string())
        };
        let (anchor, gap) = if value < 0.0 {
            (Anchor::End, -5.0)
        } else {
            (Anchor::Start, 5.0)
        };
        let style = Type {
            halo: true,
            ..Type::plain(SIZE, Paint::INK, anchor)
        };
        canvas.text([axes.px_x(value) + gap, base], style, &text);
    }

    fn draw_limit(&self, canvas: &mut Canvas, axes: &Axes) {
        if let Some((_, value)) = self.limit.as_ref().filter(|(_, value)| drawable(*value)) {
            let x = axes.px_x(*value);
            let ends: [Px; 2] = [[x, axes.area.y], [x, axes.area.bottom()]];
            canvas.line(ends[0], ends[1], limit_pen());
        }
    }
}

impl Panel for Bars {
    fn label(&self) -> &str {
        &self.title
    }

    fn height_for(&self, _width: f64) -> f64 {
        24.0 + axes::room_below(&self.x_label) + PITCH * self.bars.len().max(2) as f64 + 6.0
    }

    fn draw(&self, canvas: &mut Canvas, bounds: Rect) {
        let names = self.bars.iter().map(|bar| text::width(&bar.label, SIZE));
        let left = (names.fold(0.0, f64::max) + 12.0).clamp(30.0, 0.5 * bounds.width.max(60.0));
        let width = bounds.inset(left, 0.0, axes::RIGHT, 0.0).width;
        let header = Header::new(&self.title, self.legend(), width);
        let area = bounds.inset(
            left,
            header.height,
            axes::RIGHT,
            axes::room_below(&self.x_label),
        );
        let x = Axis::horizontal(&self.x_label, self.range(), area.width);
        let y = Axis::vertical(
            "",
            Range {
                low: 0.0,
                high: 1.0,
            },
            area.height,
        );
        let mut axes = Axes { area, x, y };
        axes.y.ticks.values.clear();

        header.draw(canvas, area.x, bounds.y);
        axes::draw_paper(canvas, area);
        axes.draw_grid(canvas);
        let pitch = (area.height - 6.0) / self.bars.len().max(1) as f64;
        let middle = |i: usize| area.y + 3.0 + pitch * (i as f64 + 0.5);
        for (i, bar) in self.bars.iter().enumerate() {
            self.draw_bar(canvas, &axes, bar, middle(i), pitch.min(1.2 * PITCH));
        }
        self.draw_limit(canvas, &axes);
        for (i, bar) in self.bars.iter().enumerate() {
            self.draw_text(canvas, &axes, bar, middle(i));
        }
        axes.draw_frame(canvas);
    }
}

fn limit_pen() -> Pen {
    Pen {
        dash: "6 3",
        ..Pen::solid(Colour::Vermillion.paint(), 1.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bars(values: &[f64]) -> Bars {
        let bar = |value: &f64| Bar {
            label: "a".to_string(),
            value: *value,
            colour: Colour::Blue,
        };
        Bars {
            bars: values.iter().map(bar).collect(),
            ..Bars::default()
        }
    }

    #[test]
    fn bars_start_at_zero() {
        assert_eq!(bars(&[3.0, 4.0]).range().low, 0.0);
        assert!(bars(&[-3.0, 4.0]).range().low < -3.0);
    }

    #[test]
    fn the_limit_is_within_the_range() {
        let chart = Bars {
            limit: Some(("limit".to_string(), 9.0)),
            ..bars(&[1.0])
        };
        assert!(chart.range().high > 9.0);
    }

    #[test]
    fn a_missing_value_has_no_bar() {
        let svg = bars(&[f64::NAN, 2.0]).to_svg(400.0);
        assert_eq!(svg.matches("fill-opacity=\"0.9\"").count(), 1);
    }
}
