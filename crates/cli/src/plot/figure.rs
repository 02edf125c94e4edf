//! Several panels in one drawing.

use super::Panel;
use super::paint::Paint;
use super::svg::{Anchor, Canvas, Rect, Type};

/// Gaps between panels and around them, in pixels.
const GAP: f64 = 18.0;
const BORDER: f64 = 20.0;

/// Where a panel stands in the grid of a figure; rows and columns count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// First column.
    pub column: usize,
    /// First row.
    pub row: usize,
    /// Number of columns that it takes.
    pub columns: usize,
    /// Number of rows that it takes.
    pub rows: usize,
}

/// Panels in a grid under a common title.
pub struct Figure<'a> {
    /// Title; empty for none.
    pub title: String,
    /// What stands below the title; empty for nothing.
    pub subtitle: String,
    /// Height as a multiple of the width.
    pub aspect: f64,
    /// Widths of the columns, relative to each other.
    pub columns: Vec<f64>,
    /// Heights of the rows, relative to each other.
    pub rows: Vec<f64>,
    /// The panels and their cells.
    pub panels: Vec<(Cell, &'a dyn Panel)>,
}

impl Figure<'_> {
    fn header_height(&self) -> f64 {
        match (self.title.is_empty(), self.subtitle.is_empty()) {
            (true, true) => 0.0,
            (true, false) | (false, true) => 32.0,
            (false, false) => 52.0,
        }
    }

    fn draw_header(&self, canvas: &mut Canvas, bounds: Rect) {
        let title = Type {
            bold: true,
            ..Type::plain(20.0, Paint::INK, Anchor::Start)
        };
        canvas.text([bounds.x, bounds.y + 18.0], title, &self.title);
        let base = if self.title.is_empty() { 14.0 } else { 39.0 };
        let subtitle = Type::plain(12.5, Paint::MUTED, Anchor::Start);
        canvas.text([bounds.x, bounds.y + base], subtitle, &self.subtitle);
    }
}

impl Panel for Figure<'_> {
    fn label(&self) -> &str {
        &self.title
    }

    fn height_for(&self, width: f64) -> f64 {
        self.aspect * width
    }

    fn draw(&self, canvas: &mut Canvas, bounds: Rect) {
        let inner = bounds.inset(BORDER, BORDER, BORDER, BORDER);
        self.draw_header(canvas, inner);
        let grid = inner.inset(0.0, self.header_height(), 0.0, 0.0);
        for (cell, panel) in &self.panels {
            let (x, width) = track(&self.columns, cell.column, cell.columns, grid.width);
            let (y, height) = track(&self.rows, cell.row, cell.rows, grid.height);
            panel.draw(
                canvas,
                Rect {
                    x: grid.x + x,
                    y: grid.y + y,
                    width,
                    height,
                },
            );
        }
    }
}

/// Start and length of `count` tracks from `first` on, of tracks with these weights and a gap between
/// them within `length`. Tracks that do not exist have no length.
fn track(weights: &[f64], first: usize, count: usize, length: f64) -> (f64, f64) {
    let gaps = GAP * weights.len().saturating_sub(1) as f64;
    let unit = (length - gaps).max(1.0) / weights.iter().sum::<f64>().max(1e-9);
    let first = first.min(weights.len());
    let end = (first + count).min(weights.len());
    let start = unit * weights[..first].iter().sum::<f64>() + GAP * first as f64;
    let inner_gaps = GAP * (end - first).saturating_sub(1) as f64;
    (
        start,
        unit * weights[first..end].iter().sum::<f64>() + inner_gaps,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_and_gaps_fill_the_length() {
        let weights = [1.0, 2.0, 1.0];
        let length = 400.0 + 2.0 * GAP;
        assert_eq!(track(&weights, 0, 1, length), (0.0, 100.0));
        assert_eq!(track(&weights, 1, 2, length), (100.0 + GAP, 300.0 + GAP));
        assert_eq!(track(&weights, 0, 3, length), (0.0, length));
    }

    #[test]
    fn a_cell_outside_of_the_grid_has_no_size() {
        assert_eq!(track(&[1.0], 5, 2, 100.0).1, 0.0);
    }
}
