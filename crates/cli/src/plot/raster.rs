//! From SVG to PNG, with a font that travels with the program.

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{Options, Tree};

/// Widest picture that is drawn.
const WIDEST_PX: u32 = 16_384;

/// Why a picture could not be drawn.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// The text is not a valid SVG document.
    #[error("the figure is not valid SVG: {0}")]
    Svg(#[from] resvg::usvg::Error),
    /// No picture of this size can be made.
    #[error("no picture can be {width_px} x {height_px} pixels large")]
    Size {
        /// Width asked for, in pixels.
        width_px: u32,
        /// Height that follows from the shape of the figure, in pixels.
        height_px: u32,
    },
    /// The picture could not be encoded.
    #[error("the picture cannot be written as PNG: {0}")]
    Encode(String),
}

/// Draws an SVG document on white as a PNG picture `width_px` wide.
pub fn render_png(svg: &str, width_px: u32) -> Result<Vec<u8>, PlotError> {
    let tree = Tree::from_str(svg, &options())?;
    let scale = f64::from(width_px) / f64::from(tree.size().width());
    let height_px = (scale * f64::from(tree.size().height())).round() as u32;
    let too_large = width_px.max(height_px) > WIDEST_PX;
    let pixmap = if too_large {
        None
    } else {
        Pixmap::new(width_px, height_px)
    };
    let mut pixmap = pixmap.ok_or(PlotError::Size {
        width_px,
        height_px,
    })?;
    pixmap.fill(Color::WHITE);
    let transform = Transform::from_scale(scale as f32, scale as f32);
    resvg::render(&tree, transform, &mut pixmap.as_mut());
    pixmap
        .encode_png()
        .map_err(|error| PlotError::Encode(error.to_string()))
}

/// Options under which every machine draws the same picture: no font of the system is read.
fn options() -> Options<'static> {
    let mut options = Options {
        font_family: "DejaVu Sans".to_string(),
        ..Options::default()
    };
    let fonts = options.fontdb_mut();
    for font in [dejavu::sans::regular(), dejavu::sans::bold()] {
        fonts.load_font_data(font.to_vec());
    }
    // The second is what stands in for a family that is not there.
    fonts.set_sans_serif_family("DejaVu Sans");
    fonts.set_serif_family("DejaVu Sans");
    options
}
