//! A plot area with its axes: from values to pixels, and the grid that says so.

use super::decimate::Px;
use super::paint::Paint;
use super::scale::{Range, Ticks, power_of_ten};
use super::svg::{Anchor, Brush, Canvas, Pen, Rect, Type};
use super::text;

/// Size of tick labels, in pixels.
const TICK_SIZE: f64 = 10.5;

/// Size of axis labels, in pixels.
const LABEL_SIZE: f64 = 11.0;

/// Least room left of the plot area: areas of charts below each other then start alike.
const LEAST_LEFT: f64 = 54.0;

/// Room below the plot area for tick labels.
const BELOW_TICKS: f64 = 20.0;

/// Room below the tick labels for the label of the axis.
const BELOW_LABEL: f64 = 18.0;

/// Least distance of the labels of a vertical axis, in pixels.
const TIGHT_PX: f64 = 15.0;

/// Room right of the plot area, for half of the last tick label.
pub(super) const RIGHT: f64 = 14.0;

/// One axis.
#[derive(Debug)]
pub(super) struct Axis {
    label: String,
    pub range: Range,
    pub ticks: Ticks,
}

impl Axis {
    pub fn new(label: &str, range: Range, ticks: Ticks) -> Self {
        let power = power_of_ten(ticks.exponent);
        let label = if power.is_empty() {
            label.to_string()
        } else {
            format!("{label} {power}")
        };
        Axis {
            label: label.trim().to_string(),
            range,
            ticks,
        }
    }

    /// An axis across about `length` pixels.
    pub fn horizontal(label: &str, range: Range, length: f64) -> Self {
        Axis::new(
            label,
            range,
            Ticks::over(range, (length / 75.0).clamp(2.0, 12.0)),
        )
    }

    /// An axis upwards along about `length` pixels. A low one has its ticks closer together rather
    /// than a single tick, from which nothing can be read.
    pub fn vertical(label: &str, range: Range, length: f64) -> Self {
        let count = (length / 34.0).clamp(2.0, 8.0);
        let ticks = Ticks::over(range, count);
        let closer = Ticks::over(range, 2.0 * count);
        let fits = TIGHT_PX * closer.values.len() as f64 <= length;
        let ticks = if ticks.values.len() < 3 && fits {
            closer
        } else {
            ticks
        };
        Axis::new(label, range, ticks)
    }

    /// Room that the labels of a vertical axis need beside the plot area.
    pub fn room_beside(&self) -> f64 {
        let title = if self.label.is_empty() {
            0.0
        } else {
            LABEL_SIZE + 8.0
        };
        (self.widest_label() + title + 8.0).max(LEAST_LEFT)
    }

    fn widest_label(&self) -> f64 {
        let widths = self
            .ticks
            .labels()
            .into_iter()
            .map(|label| text::width(&label, TICK_SIZE));
        widths.fold(0.0, f64::max)
    }
}

/// Two axes and the area between them.
#[derive(Debug)]
pub(super) struct Axes {
    pub area: Rect,
    pub x: Axis,
    pub y: Axis,
}

impl Axes {
    pub fn px_x(&self, x: f64) -> f64 {
        self.area.x + (x - self.x.range.low) / self.x.range.span() * self.area.width
    }

    pub fn px_y(&self, y: f64) -> f64 {
        self.area.bottom() - (y - self.y.range.low) / self.y.range.span() * self.area.height
    }

    pub fn at(&self, [x, y]: [f64; 2]) -> Px {
        [self.px_x(x), self.px_y(y)]
    }

    /// The grid, to be drawn below the data.
    pub fn draw_grid(&self, canvas: &mut Canvas) {
        let Rect { x, y, .. } = self.area;
        let pen = Pen::solid(Paint::GRID, 1.0);
        for tick in self.x.ticks.values.iter().map(|tick| self.px_x(*tick)) {
            canvas.line([tick, y], [tick, self.area.bottom()], pen);
        }
        for tick in self.y.ticks.values.iter().map(|tick| self.px_y(*tick)) {
            canvas.line([x, tick], [self.area.right(), tick], pen);
        }
    }

    /// The frame and the labels, to be drawn above the data.
    pub fn draw_frame(&self, canvas: &mut Canvas) {
        canvas.rect(self.area, 0.0, None, Some(Pen::solid(Paint::FRAME, 1.0)));
        self.draw_x_labels(canvas);
        self.draw_y_labels(canvas);
    }

    pub fn draw_x_labels(&self, canvas: &mut Canvas) {
        let bottom = self.area.bottom();
        let style = Type::plain(TICK_SIZE, Paint::MUTED, Anchor::Middle);
        for (tick, label) in self.x.ticks.values.iter().zip(self.x.ticks.labels()) {
            let x = self.px_x(*tick);
            canvas.line(
                [x, bottom],
                [x, bottom + 4.0],
                Pen::solid(Paint::FRAME, 1.0),
            );
            canvas.text([x, bottom + 15.0], style, &label);
        }
        let middle = self.area.x + 0.5 * self.area.width;
        let style = Type::plain(LABEL_SIZE, Paint::INK, Anchor::Middle);
        canvas.text([middle, bottom + 31.0], style, &self.x.label);
    }

    fn draw_y_labels(&self, canvas: &mut Canvas) {
        let style = Type::plain(TICK_SIZE, Paint::MUTED, Anchor::End);
        for (tick, label) in self.y.ticks.values.iter().zip(self.y.ticks.labels()) {
            let y = self.px_y(*tick);
            canvas.line(
                [self.area.x - 4.0, y],
                [self.area.x, y],
                Pen::solid(Paint::FRAME, 1.0),
            );
            canvas.text([self.area.x - 7.0, y + 0.36 * TICK_SIZE], style, &label);
        }
        let middle = self.area.y + 0.5 * self.area.height;
        let style = Type {
            upright: true,
            ..Type::plain(LABEL_SIZE, Paint::INK, Anchor::Middle)
        };
        let beside = self.area.x - 7.0 - self.y.widest_label() - 8.0;
        canvas.text([beside, middle], style, &self.y.label);
    }
}

/// Room that a horizontal axis with this label needs below the plot area.
pub(super) fn room_below(label: &str) -> f64 {
    BELOW_TICKS + if label.is_empty() { 0.0 } else { BELOW_LABEL }
}

/// Fills the plot area, so that it stands out where a figure lies on another background.
pub(super) fn draw_paper(canvas: &mut Canvas, area: Rect) {
    canvas.rect(area, 0.0, Some(Brush::solid(Paint::PAPER)), None);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_low_axis_still_has_three_ticks() {
        let axis = Axis::vertical(
            "",
            Range {
                low: -0.14,
                high: 0.14,
            },
            60.0,
        );
        assert_eq!(axis.ticks.labels(), ["−0.1", "0.0", "0.1"]);
    }

    #[test]
    fn an_axis_takes_the_power_of_ten_into_its_label() {
        let axis = Axis::vertical(
            "time (s)",
            Range {
                low: 0.0,
                high: 2e-5,
            },
            60.0,
        );
        assert_eq!(axis.label, "time (s) ×10⁻⁶");
    }
}
