//! Writing SVG: elements, attributes, escaping.

use std::fmt::Write;

use super::decimate::Px;
use super::paint::Paint;

/// Fonts of the figures: the raster has the first, and Verdana has nearly its widths.
const FONT: &str = "'DejaVu Sans', Verdana, sans-serif";

/// A rectangle of the figure, in pixels, y downwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

impl Rect {
    pub fn right(&self) -> f64 {
        self.x + self.width
    }

    pub fn bottom(&self) -> f64 {
        self.y + self.height
    }

    pub fn overlaps(&self, other: &Rect) -> bool {
        self.x < other.right()
            && other.x < self.right()
            && self.y < other.bottom()
            && other.y < self.bottom()
    }

    pub fn holds(&self, [x, y]: Px) -> bool {
        self.x < x && x < self.right() && self.y < y && y < self.bottom()
    }

    pub fn contains(&self, other: &Rect) -> bool {
        self.x <= other.x
            && self.y <= other.y
            && other.right() <= self.right()
            && other.bottom() <= self.bottom()
    }

    /// The part of the rectangle within the four margins; never of negative size.
    pub fn inset(&self, left: f64, top: f64, right: f64, bottom: f64) -> Rect {
        Rect {
            x: self.x + left,
            y: self.y + top,
            width: (self.width - left - right).max(1.0),
            height: (self.height - top - bottom).max(1.0),
        }
    }
}

/// How lines are drawn.
#[derive(Debug, Clone, Copy)]
pub struct Pen {
    pub paint: Paint,
    pub width: f64,
    /// Lengths of dashes and gaps; empty for a solid line.
    pub dash: &'static str,
    pub opacity: f64,
}

impl Pen {
    pub fn solid(paint: Paint, width: f64) -> Self {
        Pen {
            paint,
            width,
            dash: "",
            opacity: 1.0,
        }
    }
}

/// How areas are filled.
#[derive(Debug, Clone, Copy)]
pub struct Brush {
    pub paint: Paint,
    pub opacity: f64,
}

impl Brush {
    pub fn solid(paint: Paint) -> Self {
        Brush {
            paint,
            opacity: 1.0,
        }
    }
}

/// Which point of a text lies at its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// How text is set.
#[derive(Debug, Clone, Copy)]
pub struct Type {
    pub size: f64,
    pub paint: Paint,
    pub anchor: Anchor,
    pub bold: bool,
    /// Reads upwards.
    pub upright: bool,
    /// A rim of paper that keeps the text readable on lines.
    pub halo: bool,
}

impl Type {
    pub fn plain(size: f64, paint: Paint, anchor: Anchor) -> Self {
        Type {
            size,
            paint,
            anchor,
            bold: false,
            upright: false,
            halo: false,
        }
    }
}

/// Elements of a figure, drawn in the order of the calls.
#[derive(Debug, Default)]
pub struct Canvas {
    body: String,
}

impl Canvas {
    /// A whole document of the given size that holds the elements.
    pub fn into_document(self, width: f64, height: f64, label: &str) -> String {
        let (w, h) = (px(width), px(height));
        let paper = look(Some(Brush::solid(Paint::PAPER)), None);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" width=\"{w}\" height=\"{h}\" \
             viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"{}\" font-family=\"{FONT}\">\n\
             <rect width=\"{w}\" height=\"{h}\"{paper}/>\n{}</svg>\n",
            escape(label),
            self.body
        )
    }

    pub fn line(&mut self, from: Px, to: Px, pen: Pen) {
        self.path(&[&[from, to]], false, None, Some(pen), "");
    }

    pub fn polylines(&mut self, runs: &[Vec<Px>], pen: Pen) {
        let runs: Vec<&[Px]> = runs.iter().map(Vec::as_slice).collect();
        self.path(&runs, false, None, Some(pen), "");
    }

    /// A closed area with a note that browsers show under the pointer.
    pub fn polygon(&mut self, points: &[Px], brush: Option<Brush>, pen: Option<Pen>, note: &str) {
        self.path(&[points], true, brush, pen, note);
    }

    fn path(
        &mut self,
        runs: &[&[Px]],
        closed: bool,
        brush: Option<Brush>,
        pen: Option<Pen>,
        note: &str,
    ) {
        let mut data = String::new();
        for run in runs {
            for (i, point) in run.iter().enumerate() {
                data.push(if i == 0 { 'M' } else { 'L' });
                let _ = write!(data, "{} {}", px(point[0]), px(point[1]));
            }
            if closed {
                data.push('Z');
            }
        }
        if !data.is_empty() {
            self.element("path", &format!("d=\"{data}\"{}", look(brush, pen)), note);
        }
    }

    /// Dots of one colour, as one element: lines of nearly no length with round ends.
    pub fn dots(&mut self, points: &[Px], paint: Paint, radius: f64) {
        let mut data = String::new();
        for [x, y] in points {
            let _ = write!(data, "M{} {}h.01", px(*x), px(*y));
        }
        if !data.is_empty() {
            let pen = look(None, Some(Pen::solid(paint, 2.0 * radius)));
            self.element(
                "path",
                &format!("d=\"{data}\" stroke-linecap=\"round\"{pen}"),
                "",
            );
        }
    }

    pub fn rect(&mut self, rect: Rect, radius: f64, brush: Option<Brush>, pen: Option<Pen>) {
        let Rect {
            x,
            y,
            width,
            height,
        } = rect;
        let place = format!(
            "x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"{}\"{}",
            px(x),
            px(y),
            px(width),
            px(height),
            px(radius),
            look(brush, pen)
        );
        self.element("rect", &place, "");
    }

    pub fn circle(
        &mut self,
        centre: Px,
        radius: f64,
        brush: Option<Brush>,
        pen: Option<Pen>,
        note: &str,
    ) {
        let place = format!(
            "cx=\"{}\" cy=\"{}\" r=\"{}\"{}",
            px(centre[0]),
            px(centre[1]),
            px(radius),
            look(brush, pen)
        );
        self.element("circle", &place, note);
    }

    /// Text with its base line at `at`.
    pub fn text(&mut self, at: Px, style: Type, text: &str) {
        if text.is_empty() {
            return;
        }
        let (x, y) = (px(at[0]), px(at[1]));
        let anchor = match style.anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        let bold = if style.bold {
            " font-weight=\"bold\""
        } else {
            ""
        };
        let turn = if style.upright {
            format!(" transform=\"rotate(-90 {x} {y})\"")
        } else {
            String::new()
        };
        let rim = style.halo.then(|| Pen {
            opacity: 0.8,
            ..Pen::solid(Paint::PAPER, 3.0)
        });
        let order = if style.halo {
            " paint-order=\"stroke\""
        } else {
            ""
        };
        let _ = writeln!(
            self.body,
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\"{anchor}{bold}{order}{}{turn}>{}</text>",
            px(style.size),
            look(Some(Brush::solid(style.paint)), rim),
            escape(text)
        );
    }

    /// A PNG picture that fills `area`, its pixels kept sharp.
    pub fn image(&mut self, area: Rect, png: &[u8]) {
        let [x, y, w, h] = [area.x, area.y, area.width, area.height].map(px);
        let _ = writeln!(
            self.body,
            "<image x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" preserveAspectRatio=\"none\" \
             image-rendering=\"pixelated\" href=\"data:image/png;base64,{}\"/>",
            base64(png)
        );
    }

    /// Clips what `draw` adds to `area`, which needs no identifier that other figures of a page
    /// might use as well.
    pub fn clipped(&mut self, area: Rect, draw: impl FnOnce(&mut Canvas)) {
        let [x, y, w, h] = [area.x, area.y, area.width, area.height].map(px);
        let _ = writeln!(
            self.body,
            "<svg x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" viewBox=\"{x} {y} {w} {h}\" \
             overflow=\"hidden\">"
        );
        draw(self);
        self.body.push_str("</svg>\n");
    }

    fn element(&mut self, name: &str, attributes: &str, note: &str) {
        let _ = if note.is_empty() {
            writeln!(self.body, "<{name} {attributes}/>")
        } else {
            writeln!(
                self.body,
                "<{name} {attributes}><title>{}</title></{name}>",
                escape(note)
            )
        };
    }
}

/// Attributes of fill and stroke, with the classes that dark pages use.
fn look(brush: Option<Brush>, pen: Option<Pen>) -> String {
    let mut classes = Vec::new();
    let mut colours = String::new();
    match brush {
        Some(Brush { paint, opacity }) => {
            classes.push(format!("f-{}", paint.class));
            let _ = write!(colours, " fill=\"{}\"", paint.light);
            if opacity < 1.0 {
                let _ = write!(colours, " fill-opacity=\"{}\"", px(opacity));
            }
        }
        None => colours.push_str(" fill=\"none\""),
    }
    if let Some(Pen {
        paint,
        width,
        dash,
        opacity,
    }) = pen
    {
        classes.push(format!("s-{}", paint.class));
        let _ = write!(
            colours,
            " stroke=\"{}\" stroke-width=\"{}\"",
            paint.light,
            px(width)
        );
        colours.push_str(" stroke-linejoin=\"round\"");
        if !dash.is_empty() {
            let _ = write!(colours, " stroke-dasharray=\"{dash}\"");
        }
        if opacity < 1.0 {
            let _ = write!(colours, " stroke-opacity=\"{}\"", px(opacity));
        }
    }
    format!(" class=\"{}\"{colours}", classes.join(" "))
}

/// Bytes as text: six bits a letter, `=` where the last group is short (RFC 4648, section 4).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |i: usize| u32::from(group.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for i in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= group.len() { letter.into() } else { '=' });
        }
    }
    text
}

/// A length in pixels with at most two decimals.
fn px(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".to_string()
    } else {
        text.to_string()
    }
}

/// Text made safe for element content and attributes of XML and HTML.
pub fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            // XML knows no other control characters, not even escaped.
            c if c.is_control() && !matches!(c, '\n' | '\t') => safe.push('\u{fffd}'),
            '\u{fffe}' | '\u{ffff}' => safe.push('\u{fffd}'),
            c => safe.push(c),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_text_is_escaped() {
        assert_eq!(
            escape("<b a=\"1\">&'\u{1}"),
            "&lt;b a=&quot;1&quot;&gt;&amp;&#39;\u{fffd}"
        );
    }

    #[test]
    fn bytes_are_spelled_as_the_standard_says() {
        // RFC 4648, section 10.
        let spelled =
            ["", "f", "fo", "foo", "foob", "fooba", "foobar"].map(|s| base64(s.as_bytes()));
        let expected = [
            "", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy",
        ];
        assert_eq!(spelled, expected);
    }

    #[test]
    fn lengths_are_short() {
        assert_eq!(
            [1.0, 1.5, 0.126, -0.001, -12.30].map(px),
            ["1", "1.5", "0.13", "0", "-12.3"]
        );
    }

    #[test]
    fn an_inset_larger_than_the_rectangle_leaves_a_pixel() {
        let small = Rect {
            x: 0.0,
            y: 0.0,
            width: 10.0,
            height: 10.0,
        };
        assert_eq!(small.inset(8.0, 0.0, 8.0, 0.0).width, 1.0);
    }
}
