//! Pictures made of pixels, with boxes drawn over them.

use resvg::tiny_skia::{Pixmap, PremultipliedColorU8};

use super::paint::Paint;
use super::svg::{Anchor, Brush, Canvas, Pen, Rect, Type};
use super::{Colour, Panel};

/// Heights of the title and of the scale below the picture, pixels.
const TITLE: f64 = 24.0;
const SCALE: f64 = 26.0;

/// Height and width of the bar of colours, pixels.
const BAR: [f64; 2] = [8.0, 160.0];

/// Nine colours from near to far (viridis), which readers with colour vision deficiencies tell
/// apart and which fall in brightness on grey paper as well.
const RAMP: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// Where there is nothing to tell.
pub const BLANK: [u8; 3] = [24, 26, 30];

/// False colour of a share from 0 to 1; that of nothing if it is no number.
pub fn false_colour(share: f64) -> [u8; 3] {
    if share.is_nan() {
        return BLANK;
    }
    let place = share.clamp(0.0, 1.0) * (RAMP.len() - 1) as f64;
    let low = (place as usize).min(RAMP.len() - 2);
    let part = place - low as f64;
    std::array::from_fn(|i| {
        let (a, b) = (f64::from(RAMP[low][i]), f64::from(RAMP[low + 1][i]));
        (a + part * (b - a)).round() as u8
    })
}

/// A box over a picture; its corners are in pixels of the picture, from its upper left corner.
#[derive(Debug, Clone)]
pub struct PictureBox {
    /// Left edge.
    pub left: f64,
    /// Upper edge.
    pub top: f64,
    /// Right edge.
    pub right: f64,
    /// Lower edge.
    pub bottom: f64,
    /// What it is; may be empty.
    pub label: String,
    /// Colour of its lines.
    pub colour: Colour,
}

/// A picture in false colours.
#[derive(Debug, Clone, Default)]
pub struct Picture {
    /// Title; empty for none.
    pub title: String,
    /// Number of columns.
    pub columns: usize,
    /// Colours by rows, the upper left pixel first.
    pub pixels: Vec<[u8; 3]>,
    /// Height as a multiple of the width as it is drawn; that of the pixels if not given.
    pub aspect: Option<f64>,
    /// Boxes over it.
    pub boxes: Vec<PictureBox>,
    /// What the first and the last colour stand for; may be empty.
    pub scale: [String; 2],
}

impl Picture {
    fn rows(&self) -> usize {
        self.pixels.len() / self.columns.max(1)
    }

    fn aspect(&self) -> f64 {
        let own = self.rows() as f64 / self.columns.max(1) as f64;
        self.aspect.unwrap_or(own).max(0.01)
    }

    /// The picture as a PNG file; `None` without pixels.
    fn to_png(&self) -> Option<Vec<u8>> {
        let size = |n: usize| u32::try_from(n).ok();
        let mut pixmap = Pixmap::new(size(self.columns)?, size(self.rows())?)?;
        for (pixel, [r, g, b]) in pixmap.pixels_mut().iter_mut().zip(&self.pixels) {
            *pixel = PremultipliedColorU8::from_rgba(*r, *g, *b, 255)?;
        }
        pixmap.encode_png().ok()
    }

    fn draw_boxes(&self, canvas: &mut Canvas, area: Rect) {
        let unit = [
            area.width / self.columns.max(1) as f64,
            area.height / self.rows().max(1) as f64,
        ];
        for b in &self.boxes {
            let frame = Rect {
                x: area.x + b.left * unit[0],
                y: area.y + b.top * unit[1],
                width: (b.right - b.left).max(0.0) * unit[0],
                height: (b.bottom - b.top).max(0.0) * unit[1],
            };
            canvas.rect(frame, 0.0, None, Some(Pen::solid(b.colour.paint(), 1.8)));
            let style = Type {
                halo: true,
                bold: true,
                ..Type::plain(9.5, Paint::INK, Anchor::Start)
            };
            let base = (frame.y - 3.0).max(area.y + 10.0);
            canvas.text([frame.x + 1.0, base], style, &b.label);
        }
    }

    fn draw_scale(&self, canvas: &mut Canvas, area: Rect) {
        if self.scale.iter().all(String::is_empty) {
            return;
        }
        let [height, width] = BAR;
        let style = |anchor| Type::plain(10.0, Paint::MUTED, anchor);
        let middle = area.x + 0.5 * area.width;
        let bar = Rect {
            x: middle - 0.5 * width,
            y: area.bottom() + 9.0,
            width,
            height,
        };
        let ramp = Picture {
            columns: 64,
            pixels: (0..64).map(|i| false_colour(f64::from(i) / 63.0)).collect(),
            ..Picture::default()
        };
        if let Some(png) = ramp.to_png() {
            canvas.image(bar, &png);
        }
        let base = bar.bottom();
        canvas.text([bar.x - 6.0, base], style(Anchor::End), &self.scale[0]);
        canvas.text(
            [bar.right() + 6.0, base],
            style(Anchor::Start),
            &self.scale[1],
        );
    }
}

impl Panel for Picture {
    fn label(&self) -> &str {
        &self.title
    }

    fn height_for(&self, width: f64) -> f64 {
        width * self.aspect() + TITLE + SCALE
    }

    fn draw(&self, canvas: &mut Canvas, bounds: Rect) {
        let room = bounds.inset(0.0, TITLE, 0.0, SCALE);
        let width = room.width.min(room.height / self.aspect());
        let area = Rect {
            x: room.x + 0.5 * (room.width - width),
            y: room.y,
            width,
            height: width * self.aspect(),
        };
        let style = Type {
            bold: true,
            ..Type::plain(13.0, Paint::INK, Anchor::Start)
        };
        canvas.text([area.x, bounds.y + 14.0], style, &self.title);
        match self.to_png() {
            Some(png) => canvas.image(area, &png),
            None => canvas.rect(area, 0.0, Some(Brush::solid(Paint::GRID)), None),
        }
        canvas.clipped(area, |canvas| self.draw_boxes(canvas, area));
        canvas.rect(area, 0.0, None, Some(Pen::solid(Paint::FRAME, 1.0)));
        self.draw_scale(canvas, area);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Picture {
        Picture {
            columns: 2,
            pixels: vec![[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9]],
            ..Picture::default()
        }
    }

    #[test]
    fn the_file_holds_the_pixels_row_by_row() {
        let file = Pixmap::decode_png(&picture().to_png().unwrap()).unwrap();
        let found: Vec<_> = file
            .pixels()
            .iter()
            .map(|p| [p.red(), p.green(), p.blue()])
            .collect();
        assert_eq!((file.width(), file.height()), (2, 2));
        assert_eq!(found, picture().pixels);
    }

    #[test]
    fn a_picture_without_pixels_is_no_file() {
        assert_eq!(Picture::default().to_png(), None);
    }

    #[test]
    fn the_ends_of_the_scale_are_the_ends_of_the_ramp() {
        assert_eq!(false_colour(-3.0), RAMP[0]);
        assert_eq!(false_colour(0.5), RAMP[4]);
        assert_eq!(false_colour(1.0), RAMP[8]);
    }

    #[test]
    fn a_share_that_is_no_number_is_blank() {
        assert_eq!(false_colour(f64::NAN), BLANK);
    }
}
