//! What a study shows, as plain data.

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub enum Chart {
    /// Curves, dots and bands over a common axis.
    Curves {
        /// Title.
        title: String,
        /// Quantity and unit of the horizontal axis.
        x_label: String,
        /// Quantity and unit of the vertical axis.
        y_label: String,
        /// Lines and dots, the first at the bottom.
        curves: Vec<Curve>,
        /// Areas below the lines.
        bands: Vec<CurveBand>,
    },
    /// One amount for each of a few names.
    Bars {
        /// Title.
        title: String,
        /// Quantity and unit.
        x_label: String,
        /// The bars, from top to bottom.
        bars: Vec<StudyBar>,
        /// Name and value of a limit to mark.
        limit: Option<(String, f64)>,
        /// Decimals of the values.
        decimals: usize,
    },
    /// A plane, equally scaled on both axes.
    Map {
        /// Title.
        title: String,
        /// Name and unit of the horizontal axis.
        x_label: String,
        /// Name and unit of the vertical axis.
        y_label: String,
        /// Paths and dots.
        curves: Vec<Curve>,
        /// Closed outlines.
        outlines: Vec<Outline>,
    },
    /// An image in false colours with frames over it.
    Image {
        /// Title.
        title: String,
        /// Number of columns.
        columns: usize,
        /// Shares from 0 (dark) to 1 (bright) by rows, the upper left first; NaN is nothing.
        shares: Vec<f32>,
        /// Height as a multiple of the width as it is drawn; that of the pixels if not given.
        aspect: Option<f64>,
        /// Frames over it.
        frames: Vec<Frame>,
        /// What the shares 0 and 1 stand for.
        scale: [String; 2],
    },
}

/// What a line, bar or dot stands for; the same tone means the same in all charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// What is measured here.
    Measured,
    /// A second thing that is measured here.
    Second,
    /// A third thing that is measured here.
    Third,
    /// The source's figure.
    Theirs,
    /// What is true.
    Truth,
    /// A reference, limit or bound.
    Limit,
    /// As it should be.
    Good,
    /// Not as it should be.
    Bad,
}

/// How the points of a curve are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CurveStyle {
    /// A line.
    Solid,
    /// A dashed line.
    Dashed,
    /// Not at all: a scatter of dots.
    Points,
}

/// Points that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Name in the legend; may be empty.
    pub name: String,
    /// `(x, y)`; a value that is not finite leaves a gap.
    pub points: Vec<(f64, f64)>,
    /// How they are joined.
    pub style: CurveStyle,
    /// What it stands for.
    pub tone: Tone,
}

/// An area between two lines.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveBand {
    /// Name in the legend; may be empty.
    pub name: String,
    /// `(x, low, high)`.
    pub points: Vec<(f64, f64, f64)>,
    /// What it stands for.
    pub tone: Tone,
}

/// One bar.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyBar {
    /// Its name.
    pub label: String,
    /// Its length.
    pub value: f64,
    /// What it stands for.
    pub tone: Tone,
}

/// A closed outline on a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Its corners.
    pub corners: Vec<(f64, f64)>,
    /// Whether it is a thing that truly is there; otherwise one that is believed.
    pub truth: bool,
    /// Its name; may be empty.
    pub label: String,
}

/// A frame over an image, in pixels from its upper left corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Left, upper, right and lower edge.
    pub edges: [f64; 4],
    /// What it is; may be empty.
    pub label: String,
}

impl Curve {
    /// A solid line.
    pub fn line(name: &str, tone: Tone, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.to_owned(),
            points,
            style: CurveStyle::Solid,
            tone,
        }
    }

    /// Dots.
    pub fn dots(name: &str, tone: Tone, points: Vec<(f64, f64)>) -> Self {
        Self {
            style: CurveStyle::Points,
            ..Self::line(name, tone, points)
        }
    }

    /// A dashed line.
    pub fn dashed(name: &str, tone: Tone, points: Vec<(f64, f64)>) -> Self {
        Self {
            style: CurveStyle::Dashed,
            ..Self::line(name, tone, points)
        }
    }
}
